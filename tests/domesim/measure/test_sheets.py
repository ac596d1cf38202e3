"""Sheets: what is shown, printed and filled in for one instrument is just what `measure` takes."""

from __future__ import annotations

import csv
import re
import shlex

import numpy as np
import pytest
from command_line import exit_code
from rigs import refused

from domesim.measure.patterns.listing import read_patterns
from domesim.measure.patterns.sheets import INSTRUMENTS
from domesim.readings.luminance import luminance_alone, measured_shares
from domesim.scene import load_dome
from domesim.scene.loading import load_scene
from domesim.scene.writing import as_toml
from testing.meters import XYZ, Room, fill

THEATRE = {
    "name": "theatre",
    "dome": {"radius_m": 6.0},
    "screen": {"albedo": 0.5},
    "projector": {"white_cd_m2": 7.0},
    "viewing": {"adaptation_cd_m2": 0.5},
}
SHARES = {"left": 0.02, "right": 0.012}
WHITE = 20.0


def written(run, folder, kind, *options):
    """What `measure patterns` says last is the command that follows."""
    size = "64" if kind == "dome" else "96x64"
    code, out, err = run("measure", "patterns", f"--{kind}", "--size", size, "--out", folder,
                         *options)  # fmt: skip
    assert (code, err) == (0, "")
    return next(line[6:] for line in out.splitlines() if line.startswith("Then: "))


def fill_pair(path, light, rng=None):
    """Readings of a pair through both glasses; in the columns of light alone."""
    rows = list(csv.DictReader(path.read_text().splitlines()))
    codes = {"W": (1, 1, 1), "R": (1, 0, 0), "G": (0, 1, 0), "B": (0, 0, 1), "K": (0, 0, 0)}
    for row in rows:
        eye, level = row["filter"], float(row.get("level") or 1)
        share = 1 if row["projector"] == eye else SHARES[eye]
        said = share * WHITE * XYZ @ codes[row["channel"]] * level**2.2 + 0.01
        if rng is not None:
            said = said * (1 + 0.01 * rng.standard_normal(3))
        values = dict(zip("XYZ", said, strict=True)) | {"Lv": said[1], "fL": said[1] / 3.4262591}
        row.update({name: f"{values[name]:.6f}" for name in light})
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


@pytest.mark.parametrize("kind", ["dome", "stereo"])
@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_a_sheet_shows_what_is_filled_in(run, tmp_path, kind, instrument):
    if (kind, instrument) == ("stereo", "lux"):
        refused(run("measure", "patterns", "--stereo", "--with", "lux", "--out", tmp_path),
                "--with lux is for --dome")  # fmt: skip
        return
    command = written(run, tmp_path, kind, "--with", instrument)
    page = (tmp_path / "how-to.html").read_text()
    assert command in re.sub(r"\s+", " ", page)
    shown = {each.name for each in read_patterns(tmp_path).patterns}
    assert {"registration", "black"} <= shown
    for table in tmp_path.glob("*.csv"):
        assert table.name in page
        for row in csv.DictReader(table.read_text().splitlines()):
            assert row.get("pattern") or row["note"] in shown
            assert row.get("pattern") is None or row["pattern"] in shown
    if instrument == "eye":
        assert shown == {"registration", "black"}
        assert not [*tmp_path.glob("*.csv"), *tmp_path.glob("*.toml")]


def test_an_instrument_that_is_not_known_is_refused(run, tmp_path):
    refused(run("measure", "patterns", "--dome", "--with", "ruler", "--out", tmp_path), "luminance")


@pytest.mark.parametrize("instrument", ["lux", "luminance", "colorimeter"])
def test_the_command_of_a_dome_takes_its_table(run, tmp_path, monkeypatch, instrument):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "theatre.toml").write_text(as_toml(THEATRE))
    command = written(run, "sheet", "dome", "--scene", "theatre.toml", "--with", instrument)
    room = Room(load_dome("theatre.toml").dome, (0.6,) * 3, WHITE, 0.01)
    table = tmp_path / "sheet" / "dome.csv"
    fill(table, room, table)
    assert not exit_code(*shlex.split(command)[1:])
    assert load_dome("measured.toml").theatre.albedo[0] == pytest.approx(0.6, rel=0.01)


@pytest.mark.parametrize(
    ("instrument", "light"),
    [
        ("luminance", ("Lv",)),
        ("colorimeter", ("X", "Y", "Z")),
        ("colorimeter", ("Y",)),  # of a luminance meter, in a colorimeter's table
    ],
)
def test_the_command_of_a_pair_takes_its_table(run, tmp_path, monkeypatch, instrument, light):
    monkeypatch.chdir(tmp_path)
    command = written(run, "sheet", "stereo", "--levels", "4", "--with", instrument)
    fill_pair(tmp_path / "sheet" / "readings.csv", light)
    code, out, err = run(*shlex.split(command)[1:])
    assert (code, err) == (0, "")
    assert ("one share for all primaries" in out) == (len(light) == 1)
    scene = load_scene("measured.toml")
    for view, eye in enumerate(("left", "right")):
        leak = np.zeros((2, 8, 8, 3))
        leak[1 - view] = 0.5
        room = scene.observation(8, 8)
        black = np.asarray(room.observe(np.zeros_like(leak)))
        seen = (np.asarray(room.observe(leak)) - black)[view, 4, 4] / 0.5
        assert seen == pytest.approx(SHARES[eye], rel=0.01)


def test_foot_lamberts_of_a_pair_are_luminance(run, tmp_path):
    written(run, tmp_path, "stereo", "--with", "luminance")
    table = tmp_path / "readings.csv"
    table.write_text(table.read_text().replace("channel,Lv,", "channel,fL,"))
    fill_pair(table, ("fL",))
    code, out, _ = run("measure", "crosstalk", table, "--out", tmp_path / "m.toml")
    assert code == 0
    assert "own white 20 cd/m²" in out


def test_errors_of_shares_are_what_they_say(tmp_path, run):
    written(run, tmp_path, "stereo", "--with", "luminance")
    blank = (tmp_path / "readings.csv").read_text()
    scores = []
    for seed in range(200):
        (tmp_path / "read.csv").write_text(blank)
        fill_pair(tmp_path / "read.csv", ("Lv",), np.random.default_rng(seed))
        found = measured_shares(luminance_alone(tmp_path / "read.csv"))
        scores += [(each.share - SHARES[each.eye]) / each.error for each in found.shares]
    # Noise of 1 % is stated to have 0.001 cd/m² more, which these have not
    assert 0.6 < np.std(scores) < 1.1
    assert abs(np.mean(scores)) < 0.2


@pytest.mark.parametrize(
    ("row", "word"),
    [
        (("left", "left", "K"), "no reading of black (K) through the left filter"),
        (("right", "left", "W"), "no reading of white (W) of the right projector through the left"),
    ],
)
def test_what_a_luminance_meter_has_not_read_is_named(run, tmp_path, row, word):
    written(run, tmp_path, "stereo", "--with", "luminance")
    table = tmp_path / "readings.csv"
    fill_pair(table, ("Lv",))
    start = ",".join(row)
    kept = [line for line in table.read_text().splitlines() if not line.startswith(start)]
    table.write_text("\n".join(kept))
    refused(run("measure", "crosstalk", table, "--out", tmp_path / "m.toml"), word)


def test_exchanged_glasses_are_refused_by_luminance(run, tmp_path):
    written(run, tmp_path, "stereo", "--with", "luminance")
    table = tmp_path / "readings.csv"
    fill_pair(table, ("Lv",))
    text = table.read_text()
    for one, other in (("left,left,W", "right,left,w"), ("right,left,W", "left,left,w")):
        text = text.replace(one, other)
    table.write_text(text.replace(",w,", ",W,"))
    refused(run("measure", "crosstalk", table, "--out", tmp_path / "m.toml"), "exchanged")


def test_a_repeat_that_is_none_is_refused_with_its_line(run, tmp_path):
    """Two digits exchanged in one of three readings of a ghost."""
    written(run, tmp_path, "stereo", "--with", "luminance")
    table = tmp_path / "readings.csv"
    fill_pair(table, ("Lv",))
    lines = table.read_text().splitlines()
    at = next(n for n, line in enumerate(lines) if line.startswith("right,left,W"))
    said = lines[at].split(",")[3]
    lines[at] = lines[at].replace(said, f"{1.3 * float(said):.6f}")
    table.write_text("\n".join(lines))
    out = run("measure", "crosstalk", table, "--out", tmp_path / "m.toml")
    refused(out, f"line {at + 1}: white (W) of the right projector through the left filter must")
    assert not (tmp_path / "m.toml").exists()


def test_an_empty_luminance_table_is_told(run, tmp_path):
    written(run, tmp_path, "stereo", "--with", "luminance")
    refused(
        run("measure", "crosstalk", tmp_path / "readings.csv", "--out", tmp_path / "m.toml"),
        "wanted readings in Lv, got a table that nobody has filled in",
    )


def test_a_filled_table_is_not_written_over(run, tmp_path):
    written(run, tmp_path, "stereo", "--with", "luminance")
    fill_pair(tmp_path / "readings.csv", ("Lv",))
    before = (tmp_path / "readings.csv").read_text()
    code, _, err = run("measure", "patterns", "--stereo", "--size", "96x64", "--with", "luminance",
                       "--out", tmp_path)  # fmt: skip
    assert code == 2
    assert "readings.csv" in err
    assert (tmp_path / "readings.csv").read_text() == before
