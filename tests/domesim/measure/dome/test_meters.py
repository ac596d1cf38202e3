"""A meter alone tells a dome's light and albedo: what the sheet asks for, `measure` takes."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from command_line import exit_code

from domesim.errors import InputError
from domesim.measure.dome.meter_table import read_meter_task
from domesim.measure.dome.meters import metered
from domesim.scene import load_dome
from domesim.scene.loading import scene_content
from domesim.scene.writing import as_toml
from testing.meters import NONE, Faults, Room, fill
from testing.statistics import calibration

ALBEDO = (0.5, 0.4, 0.3)
GREY = (0.45,) * 3
WHITE, BLACK = 9.0, 0.004
COLUMNS = {"lux": "lux", "luminance": "Lv", "colorimeter": "X,Y,Z"}
THEATRE = {
    "name": "theatre",
    "dome": {"radius_m": 6.0, "half_angle_deg": 80.0, "tilt_deg": 15.0},
    "screen": {"albedo": 0.6, "perforation": 0.2},
    "projector": {"white_cd_m2": 7.0, "black_cd_m2": 0.002},
    "viewing": {"adaptation_cd_m2": 0.5},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A theatre, and the sheets of all meters."""
    path = tmp_path_factory.mktemp("dome")
    (path / "theatre.toml").write_text(as_toml(THEATRE))
    for meter in COLUMNS:
        options = ("--scene", path / "theatre.toml", "--size", "64", "--with", meter, "--quiet")
        assert not exit_code("measure", "patterns", "--dome", "--out", path / meter, *options)
    return path


def room(folder, albedo=GREY, faults=NONE, seed=0, white=WHITE):
    return Room(load_dome(folder / "theatre.toml").dome, albedo, white, BLACK, faults, seed)


def found(folder, meter, at, path, columns=None, **options):
    """What the sheet of a meter tells once it is filled in."""
    sheet = folder / meter / "dome.csv"
    if columns is not None:
        text = sheet.read_text().replace(f"place,{COLUMNS[meter]},", f"place,{columns},", 1)
        short = COLUMNS[meter].count(",") - columns.count(",")
        lines = [line.replace(",," + "," * short, ",,", 1) for line in text.splitlines()]
        sheet = path / "columns.csv"
        sheet.write_text("\n".join(lines if short > 0 else text.splitlines()) + "\n")
    fill(sheet, at, path / "filled.csv", **options)
    scene = folder / "theatre.toml"
    return metered(read_meter_task(path / "filled.csv", load_dome(scene), scene_content(scene)))


@pytest.mark.parametrize(
    ("meter", "columns"),
    [
        ("lux", None), ("lux", "Ev"), ("luminance", None), ("luminance", "fL"),
        ("luminance", "Y"), ("colorimeter", None), ("colorimeter", "Lv,x,y"),
        ("colorimeter", "Y,x,y"), ("colorimeter", "fL,x,y"),
    ],
)  # fmt: skip
def test_what_the_sheet_asks_for_tells_white_and_albedo(folder, tmp_path, meter, columns):
    """Masks have edges of pixels, in 128 x 128 of which the meter's world is made."""
    coloured = meter == "colorimeter"
    albedo = ALBEDO if coloured else GREY
    result = found(folder, meter, room(folder, albedo), tmp_path, columns)
    assert result.of_primaries == coloured
    assert result.albedo == pytest.approx(albedo, rel=0.01)
    assert result.white == pytest.approx(WHITE, rel=0.01)
    assert result.black == pytest.approx(BLACK, rel=0.03)


def test_luminance_sees_one_albedo_of_all_primaries(folder, tmp_path):
    """Not less than the least and not more than the largest, and nearest to green's."""
    result = found(folder, "luminance", room(folder, ALBEDO), tmp_path)
    assert len(set(result.albedo)) == 1
    assert abs(result.albedo[0] - ALBEDO[1]) < 0.03


@pytest.mark.long
@pytest.mark.parametrize("meter", COLUMNS)
def test_intervals_are_what_they_say(folder, tmp_path, meter):
    """Of the projector's light, uneven beyond what the fit knows, and of noise and digits."""
    scores = []
    for seed in range(40):
        albedo, white = np.random.default_rng(seed).uniform([0.2, 4], [0.7, 30])
        at = room(folder, (albedo,) * 3, Faults(), seed, white)
        result = found(folder, meter, at, tmp_path)
        scores += [
            (result.white - white) / result.white_error,
            (result.albedo[1] - albedo) / result.albedo_error[1],
        ]
    assert calibration(scores[::2]) > 1e-3
    assert calibration(scores[1::2]) > 1e-3


def test_rings_in_the_middle_tell_less_than_the_screen(folder, tmp_path):
    whole = found(folder, "lux", room(folder, faults=Faults(), seed=4), tmp_path)
    middle = found(folder, "lux", room(folder, faults=Faults(), seed=4), tmp_path, empty=["front"])
    assert middle.assumed is None
    assert middle.albedo_error[0] > 3 * whole.albedo_error[0]


@pytest.mark.parametrize(("place", "columns"), [("middle", "lux"), ("front", "Lv")])
def test_white_and_black_alone_bound_white(folder, tmp_path, place, columns):
    """White is direct and reflected light; which is which, one picture does not tell."""
    lines = [f"pattern,place,{columns}", f"black,{place},", f"white,{place},"]
    (tmp_path / "two.csv").write_text("\n".join(lines) + "\n")
    fill(tmp_path / "two.csv", room(folder), tmp_path / "filled.csv")
    scene = load_dome(folder / "theatre.toml")
    task = read_meter_task(tmp_path / "filled.csv", scene, scene_content(folder / "theatre.toml"))
    result = metered(task)
    assert result.assumed == pytest.approx(0.48)
    assert result.bounds[0] < WHITE < result.bounds[1]
    assert result.bounds[1] < 1.8 * result.bounds[0]
    assert abs(result.white - WHITE) < 2 * result.white_error


def test_a_scene_says_how_sure_it_is(folder, tmp_path, run):
    fill(folder / "luminance/dome.csv", room(folder, faults=Faults()), tmp_path / "filled.csv")
    arguments = (tmp_path / "filled.csv", "--scene", folder / "theatre.toml")
    code, out, err = run("measure", "dome", *arguments, "--out", tmp_path / "mine.toml")
    assert (code, err) == (0, "")
    assert "one for all primaries: these readings do not tell them apart" in out
    assert "of the paint between the holes (20% of the screen)" in out
    scene = load_dome(tmp_path / "mine.toml")
    assert scene.theatre.screen_albedo[0] == pytest.approx(GREY[0], abs=0.05)
    assert scene.projector.white == pytest.approx(WHITE, rel=0.1)
    assert scene.uncertain(32, 32) is not None


def test_what_a_bare_dome_leaves_out_is_told(folder, tmp_path, run):
    fill(folder / "luminance/dome.csv", room(folder), tmp_path / "filled.csv")
    content = {**THEATRE, "floor": {"height_m": -1.5, "albedo": 0.3}}
    (tmp_path / "floor.toml").write_text(as_toml(content))
    for scene, told in (("floor.toml", True), (folder / "theatre.toml", False)):
        arguments = (tmp_path / "filled.csv", "--scene", tmp_path / scene, "--overwrite")
        code, out, _ = run("measure", "dome", *arguments, "--out", tmp_path / "mine.toml")
        assert code == 0
        assert ("a bare dome: the floor reflects (albedo 0.3)" in out) == told


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_rows_that_were_exchanged_are_refused(folder, tmp_path, run):
    """Both halves, of which one leaves the place dark."""
    fill(folder / "luminance/dome.csv", room(folder, faults=Faults()), tmp_path / "filled.csv")
    rows = rows_of(tmp_path / "filled.csv")
    (lit,), (dark,) = (
        [row for row in rows if row[:2] == [f"half-{half}", "front"]] for half in ("front", "back")
    )
    lit[2], dark[2] = dark[2], lit[2]
    with (tmp_path / "wrong.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    scene = ("--scene", folder / "theatre.toml", "--out", tmp_path / "no.toml")
    code, _, err = run("measure", "dome", tmp_path / "wrong.csv", *scene)
    assert code == 2
    assert "wrong.csv: line" in err
    assert "at front must be about" in err
    assert not (tmp_path / "no.toml").exists()


def test_a_repeat_that_is_none_is_refused(folder, tmp_path):
    fill(folder / "lux/dome.csv", room(folder, faults=Faults()), tmp_path / "filled.csv")
    rows = rows_of(tmp_path / "filled.csv")
    at = [n for n, row in enumerate(rows) if row[:2] == ["white", "middle"]][1]
    rows[at][2] = str(1.15 * float(rows[at][2]))
    with (tmp_path / "wrong.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    scene = folder / "theatre.toml"
    with pytest.raises(InputError, match=f"line {at + 1}: white at middle must repeat what was"):
        read_meter_task(tmp_path / "wrong.csv", load_dome(scene), scene_content(scene))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pattern,place,lux\nwhite,middle,\n", "got a table that nobody has filled in"),
        ("pattern,place,lux\nwhite,middle,20\n", "place middle: no reading of black"),
        ("pattern,place,lux\nblack,middle,0.1\n", "wanted a reading of a lit picture"),
        ("pattern,place,Lv\nwhite,middle,20\n", "place must be on the screen"),
        ("pattern,place,lux\nwhite,roof,20\n", "place must be middle, right, front, left or back"),
        ("pattern,place,lux\nhalf-frnt,front,20\n", "such as half-front, got 'half-frnt'"),
        ("pattern,place,lux\nramp-white-01,front,20\n", "pattern must be one of full light"),
        ("pattern,place,lux\nblack,front,0.1\nhalf-right,front,2\n", "edge of half-right is at"),
        ("pattern,place,Lv,x\nwhite,front,20,0.3\n", "column 'x' is not known"),
    ],
)
def test_what_is_no_table_is_refused(folder, tmp_path, text, message):
    (tmp_path / "wrong.csv").write_text(text)
    scene = folder / "theatre.toml"
    with pytest.raises(InputError, match=message):
        metered(read_meter_task(tmp_path / "wrong.csv", load_dome(scene), scene_content(scene)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "--scene THEATRE.toml"),
        (("--hold", "floor=0.1"), "--hold is for photographs"),
        (("--without-geometry",), "--without-geometry is for photographs"),
    ],
)
def test_options_that_a_meter_has_not_are_refused(folder, tmp_path, run, options, message):
    code, _, err = run("measure", "dome", folder / "lux/dome.csv", *options, "--out", "no.toml")
    assert code == 2
    assert message in err


def test_a_survey_names_its_theatre_itself(tmp_path, run):
    options = ("--scene", "dome_imax", "--out", tmp_path / "no.toml")
    code, _, err = run("measure", "dome", tmp_path / "survey.toml", *options)
    assert code == 2
    assert "is for a meter's table" in err
