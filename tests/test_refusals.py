"""What every command does with bad input: one line that helps, exit code 2, nothing half-written.

What is refused, and in which words, the tests of the library say.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Outcome, Run, run_for_real
from stored_masters import (
    picture,
    sequence,
    store,
    touched,
    truncated,
    with_sample,
    written,
)
from typer.main import get_command

from domesim.commands import build
from domesim.frames import read_frame
from domesim.observation.transport import Transport
from domesim.scene import load_dome, load_stereo, scene_names
from domesim.scene.crosstalk_maps import CrosstalkMaps

DOME, PAIR, CINEMA = "dome_hemisphere", "stereo_polarised_paper", "stereo_cinema_silver"


def leaves(command: Any, *path: str) -> Iterator[tuple[tuple[str, ...], list[Any]]]:
    """Names and parameters of each registered command that has no further ones."""
    for name, each in getattr(command, "commands", {}).items():
        if getattr(each, "commands", None):
            yield from leaves(each, *path, name)
        else:
            yield (*path, name), each.params


COMMANDS = dict(leaves(get_command(build())))
NAMES = {
    ("compare",): "page.html",
    ("preview",): "film.mp4",
    ("report-card",): "page.html",
    ("render",): "seen.exr",
    ("tabulate",): "table.npz",
    ("scene", "show"): "page.html",
    ("scene", "export"): "dome.mpcdi",
    ("shader",): "show.glsl",
}
"""What commands write that write one file."""
NEEDED: dict[tuple[str, ...], tuple[object, ...]] = {
    ("shader",): ("--size", "64x64"),
    ("measure", "patterns"): ("--dome",),
}
"""What commands need besides."""
SCENES = {("report-card",): PAIR}


def takes(name: str) -> list[tuple[str, ...]]:
    """The commands that have a parameter of that name."""
    return [path for path, found in COMMANDS.items() if name in {each.name for each in found}]


def called(path: tuple[str, ...], out: Path, **given: object) -> list[object]:
    """Words of a command with what it needs, and what is `given`."""
    words: list[object] = [*path, *NEEDED.get(path, ())]
    needed = {"scene": SCENES.get(path, DOME), "out": out / NAMES.get(path, "")} | given
    for each in COMMANDS[path]:
        if each.name in given or (each.required and each.name in needed):
            option = [each.opts[0]] if each.opts[0].startswith("-") else []
            words += [*option, needed[each.name]]
        elif each.required and not each.opts[0].startswith("-"):
            words.append("x")
    return words


def name_of(path: tuple[str, ...]) -> str:
    return " ".join(path)


@pytest.mark.parametrize("path", takes("master"), ids=name_of)
def test_a_bad_master(run: Run, tmp_path: Path, out: Path, path: tuple[str, ...]) -> None:
    master = truncated(store(tmp_path / "cut.exr"))
    run(*called(path, out, master=master)).is_refused("cut.exr", "complete EXR", "again")
    assert not any(path.is_file() for path in out.rglob("*"))


@pytest.mark.parametrize("path", takes("scene"), ids=name_of)
def test_a_bad_scene(run: Run, tmp_path: Path, out: Path, path: tuple[str, ...]) -> None:
    given = {"master": store(tmp_path / "m.exr")} if path in takes("master") else {}
    refused = run(*called(path, out, scene="dome_imx", **given))
    refused.is_refused("'dome_imx'", "did you mean 'dome_imax'?", *scene_names(), ".toml")
    assert not any(path.is_file() for path in out.rglob("*"))


@pytest.mark.parametrize("path", takes("transport"), ids=name_of)
def test_a_bad_transport(run: Run, tmp_path: Path, out: Path, path: tuple[str, ...]) -> None:
    given = {"master": store(tmp_path / "m.exr")} if path in takes("master") else {}
    table = touched(tmp_path / "t.npz", b"hello" * 99)
    run(*called(path, out, transport=table, **given)).is_refused("t.npz", "domesim tabulate")
    assert not any(path.is_file() for path in out.rglob("*"))


@pytest.mark.parametrize("path", takes("scheduler"), ids=name_of)
def test_a_films_name_for_a_folder(
    run: Run, tmp_path: Path, out: Path, path: tuple[str, ...]
) -> None:
    master = store(tmp_path / "m.exr")
    refused = run(*called(path, out / "film.mov", master=master))
    refused.is_refused("film.mov: wanted a folder", f"--out {out / 'film'})")
    assert not (out / "film.mov").exists()


@pytest.mark.parametrize("path", COMMANDS, ids=name_of)
def test_a_bad_option(run: Run, out: Path, path: tuple[str, ...]) -> None:
    """Typer's own message, of more lines than one."""
    outcome = run(*called(path, out), "--nope")
    assert outcome.code == 2
    assert "No such option: --nope" in outcome.err
    assert "--help" in outcome.err
    assert not any(path.is_file() for path in out.rglob("*"))


PAPER = ("--weighting", "paper")
OPTIONS: list[tuple[str, tuple[object, ...], tuple[str, ...]]] = [
    ("compensate", ("--method", "best"), ("'best'", "perceptual", "subtractive", "none")),
    ("compensate", ("--weighting", "contours"), ("use one of contrast, paper",)),
    ("compensate", ("--tolerance", 0), ("tolerance", "between 0 and 1", "got 0")),
    ("compensate", ("--lift", -1), ("lift", "at least 0", "got -1")),
    ("compensate", (*PAPER, "--low-frequency-gain", 2), ("gain", "0..1", "got 2")),
    ("compensate", ("--frames", "1-9"), ("--frames", "one file")),
    ("compensate", ("--frames", "1-9", "--like"), ("--like", "--dry-run --frames 1-36000")),
    ("compare", ("--lift", "nan"), ("lift", "at least 0", "got nan")),
    ("observe", ("--format", "gif"), ("gif", "use exr, png, tif, dpx, jpg")),
    ("observe", ("--dither", "blue"), ("--dither 'blue' is not known; use tpdf or none",)),
    ("observe", ("--encoding", "rec709"), ("--encoding 'rec709' is not known",)),
    ("predict", ("--combination", "both"), ("'both'", "with-veils, paper")),
    ("predict", ("--mesopic", "rods"), ("'rods'", "more-sensitive, cie-191")),
    ("predict", ("--age", 12), ("--age", "20 to 80", "got 12")),
    ("predict", ("--threshold", "nan"), ("threshold", "got nan")),
    ("predict", ("--seat", "left"), ("dome", "no seat 'left'", "names none")),
    ("render", ("--size", 1), ("--size", "2..16384", "got 1")),
    ("render", ("--seed", -1), ("--seed", "at least 0", "got -1")),
    ("render", ("--view", "seat:1"), ("'seat:1'", "domemaster", "cutaway", "no seats")),
    ("render", ("--view", "cutaway"), ("seen.exr", "'cutaway'", ".png")),
    ("tabulate", ("--error", -1), ("error", "above 0", "got -1")),
    ("tabulate", ("--walks", "nan"), ("--walks", "at least 1", "got nan")),
    ("tabulate", ("--degree", 13), ("degree", "0..12", "got 13")),
    ("master", ("--size", 10**9), ("--size", "1 to 16384", "got 1000000000")),
    ("master", ("--seed", -1), ("seed", "got -1")),
    ("master", ("--kind", "cube"), ("'cube'", "dome", "stereo")),
    ("master", ("--frames", "0x"), ("--frames", "got '0x'")),
    ("master", ("--fps", "nan"), ("--fps", "above 0", "got nan")),
    ("master", ("--kind", "stereo", "--interaxial", "nan"), ("--interaxial", "got nan")),
]


@pytest.mark.parametrize(
    ("command", "options", "words"),
    OPTIONS,
    ids=[" ".join(map(str, (command, *options))) for command, options, _ in OPTIONS],
)
def test_a_value_that_cannot_be(
    run: Run, tmp_path: Path, out: Path, command: str, options: Any, words: tuple[str, ...]
) -> None:
    path = (command,)
    given = {"master": store(tmp_path / "m.exr")} if path in takes("master") else {}
    run(*called(path, out, **given), *options).is_refused(*words)
    assert written(out) == []


# Masters that do not fit the theatre.


@pytest.mark.parametrize(
    ("rows", "cols", "value", "words"),
    [
        (20, 32, 0.5, ("m.exr", "square", "32 x 20", "crop or pad")),
        (1, 1, 0.5, ("m.exr", "at least 2 x 2", "1 x 1")),
        (8, 8, 1e30, ("m.exr", "1e+09", "got 1e+30", "clamp")),
    ],
)
def test_an_unsuitable_master(
    run: Run, tmp_path: Path, out: Path, rows: int, cols: int, value: float, words: tuple[str, ...]
) -> None:
    master = store(tmp_path / "m.exr", np.full((rows, cols, 3), value, np.float32), "float")
    run("observe", master, "--scene", DOME, "--out", out).is_refused(*words)
    assert written(out) == []


def pair(folder: Path) -> tuple[object, ...]:
    """Options of a left and a right file."""
    files = [store(folder / f"{eye}.exr", picture(12, 20, seed)) for seed, eye in enumerate("lr")]
    return "--left", files[0], "--right", files[1]


def observed(run: Run, out: Path, scene: str, *words: object) -> Outcome:
    return run("observe", *words, "--scene", scene, "--out", out)


def test_one_picture_for_two_eyes_and_two_for_one(run: Run, tmp_path: Path, out: Path) -> None:
    eyes = pair(tmp_path)
    observed(run, out, PAIR, eyes[1]).is_refused("l.exr", f"left and right for {PAIR}", "--packing")
    told = observed(run, out, DOME, *eyes)
    told.is_refused("l.exr", f"a domemaster for {DOME}", "left and right", "each alone")
    assert written(out) == []


def test_seats_that_are_not_there(run: Run, tmp_path: Path, out: Path) -> None:
    eyes = pair(tmp_path)
    seat = ("--seat", "balcony")
    observed(run, out, PAIR, *eyes, *seat).is_refused(
        "no seat 'balcony'", "sweet spot, left, right"
    )
    observed(run, out, DOME, eyes[1], *seat).is_refused(
        f"{DOME} has no seat 'balcony'", "names none"
    )
    every = observed(run, out, PAIR, *eyes, "--seat", "all")
    every.is_refused("--seat all", "one seat", "name one of sweet spot, left, right")
    every = run("predict", *eyes, "--scene", PAIR, "--out", out, "--seat", "all")
    every.is_refused("--seat all", "predicted for one seat")
    assert written(out) == []


def test_commands_of_a_dome(run: Run, out: Path) -> None:
    run("demo", "--scene", PAIR, "--out", out).is_refused(PAIR, "dome theatre")
    run("render", PAIR, "--out", out / "x.exr").is_refused(PAIR, "dome theatre")
    table = ("--out", out / "x.npz")
    run("tabulate", PAIR, *table).is_refused("[crosstalk.polarisation]", "leave --transport out")
    for options in (("--walks", 1e5), ("--error", 0.1), ("--degree", 2), ("--no-check",)):
        told = run("tabulate", CINEMA, *table, *options)
        told.is_refused(options[0], f"{CINEMA} is a stereo system", "leave it out")
    assert written(out) == []


def test_tables_of_another_kind(run: Run, tmp_path: Path, out: Path) -> None:
    eyes, dome, cinema = pair(tmp_path), load_dome(DOME), load_stereo(CINEMA)
    planes = {"modes": np.ones((1, 9, 9)), "ambient": np.zeros((3, 9, 9))}
    core = {"core": np.full((3, 1, 1), 0.2), "core_error": np.full((3, 1, 1), 1e-4)}
    facts = {"scene": dome.name, "digest": dome.digest}
    Transport(dome.dome, **planes, **core, provenance=facts).save(tmp_path / "d.npz")
    share = np.full((len(cinema.seats), 2, 9, 15), 0.02)
    facts = {"scene": "the old one", "digest": "0"}
    CrosstalkMaps(tuple(cinema.seats), share, share / 100, facts).save(tmp_path / "m.npz")
    for scene, shown, table, words in (
        (CINEMA, eyes, "d.npz", ("'domesim crosstalk maps 1'", "got domesim transport")),
        (CINEMA, eyes, "m.npz", ("'the old one'", f"domesim tabulate {CINEMA}")),
        (DOME, eyes[1:2], "m.npz", ("'domesim transport 1'", "got domesim crosstalk maps 1")),
        (PAIR, eyes, "m.npz", ("has no hardware to trace", "leave --transport out")),
        ("dome_dark", eyes[1:2], "d.npz", (f"'{dome.name}'", "domesim tabulate dome_dark")),
    ):
        told = observed(run, out, scene, *shown, "--transport", tmp_path / table)
        told.is_refused(table, *words)
    assert written(out) == []


# Sequences: one bad frame is no reason to lose the others.


def test_compare_takes_one_frame(run: Run, tmp_path: Path, out: Path) -> None:
    pattern = sequence(tmp_path / "s", 3)
    outcome = run("compare", pattern, "--scene", DOME, "--out", out / "page.html")
    outcome.is_refused("show.####.exr", "one frame", "got 3", "name one")
    assert written(out) == []


# What is odd, and goes well.


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_repair_says_how_many_samples(run: Run, tmp_path: Path, out: Path, command: str) -> None:
    master = with_sample(tmp_path / "r.exr", np.nan)
    arguments = (command, master, "--scene", DOME, "--out", out, "--repair")
    outcome = run(*arguments)
    assert (outcome.code, outcome.err) == (0, "")
    assert "4 impossible samples repaired" in outcome.out
    (frame,) = run(*arguments, "--json").figures()["frames"]
    assert frame["repaired"] == 4
    assert read_frame(out / "r.exr").pixels.min() >= 0  # it refuses NaN and Inf itself


def test_a_repaired_master_is_rendered(run: Run, tmp_path: Path, out: Path) -> None:
    master = with_sample(tmp_path / "r.exr", -0.5)
    outcome = run(*called(("render",), out, master=master), "--samples", 2, "--repair")
    assert (outcome.code, outcome.err) == (0, "")
    assert "r.exr: 4 impossible samples repaired" in outcome.out
    assert written(out) == ["seen.exr", "seen.png"]


@pytest.mark.parametrize("command", ["compensate", "observe"])
@pytest.mark.parametrize("size", [2, 3])
def test_the_smallest_masters_work(
    run: Run, tmp_path: Path, out: Path, command: str, size: int
) -> None:
    master = store(tmp_path / "s.exr", picture(size, size))
    outcome = run(command, master, "--scene", DOME, "--out", out)
    assert (outcome.code, outcome.err) == (0, "")
    assert read_frame(out / "s.exr").pixels.shape == (size, size, 3)


# Places to write to.


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("m.exr/below", ("m.exr/below", "not a directory", "Choose")),
        ("m.exr", ("m.exr", "file exists", "Choose")),
        ("/proc/x", ("/proc/x", "no such file", "Choose")),
        ("/proc", ("/proc", "wanted a folder for the results", "Choose")),
        (os.fsdecode(b"\xff"), ("UTF-8",)),
    ],
)
def test_a_folder_that_cannot_be_written(
    run: Run, tmp_path: Path, place: str, words: tuple[str, ...]
) -> None:
    """Once, not once a frame, and before any work."""
    pattern = sequence(tmp_path / "s", 2)
    store(tmp_path / "m.exr")
    outcome = observed(run, tmp_path / place, DOME, pattern)
    outcome.is_refused(*words)
    assert outcome.out == ""
    assert written(tmp_path) == ["m.exr", "s", "s/show.0001.exr", "s/show.0002.exr"]


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_results_do_not_replace_the_master(run: Run, tmp_path: Path, command: str) -> None:
    pattern = sequence(tmp_path / "s", 2)
    before = pattern.with_name("show.0001.exr").read_bytes()
    outcome = run(command, pattern, "--scene", DOME, "--out", tmp_path / "s")
    outcome.is_refused("show.0001.exr", "the input itself", "another folder")
    assert written(tmp_path / "s") == ["show.0001.exr", "show.0002.exr"]
    assert pattern.with_name("show.0001.exr").read_bytes() == before


@pytest.mark.parametrize(
    ("master", "out", "options"),
    [
        ("m.exr", "m.exr", []),
        ("m.exr", "link.exr", []),
        ("m.png", "m.exr", []),  # a preview would be written there
        ("m.png", "m.png", ["--view", "cutaway"]),
    ],
)
def test_a_picture_does_not_replace_its_master(
    run: Run, tmp_path: Path, master: str, out: str, options: list[str]
) -> None:
    path = store(tmp_path / master, kind="half" if master.endswith("exr") else "uint16")
    (tmp_path / "link.exr").symlink_to(path)
    before = path.read_bytes()
    outcome = run("render", DOME, "--master", path, "--out", tmp_path / out, *options)
    outcome.is_refused("the input itself", "another name")
    assert path.read_bytes() == before
    assert written(tmp_path) == sorted(["link.exr", master])


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("seen.jpg", ("seen.jpg", "name it so")),
        ("seen", ("seen", "name it so")),
        (".npz", (".npz", "name it so")),
        ("m.exr/seen.npz", ("m.exr", "wanted a folder", "Choose")),
        ("folder.npz", ("folder", "wanted a file", "is a directory", "Choose")),
        ("/proc/seen.npz", ("/proc", "wanted a folder", "Choose")),
        ("x" * 250 + ".npz", ("xxx", "wanted a file", "name too long", "Choose")),
        (os.fsdecode(b"\xff.npz"), (r"\udcff", "UTF-8", "Choose")),
    ],
)
def test_a_file_that_cannot_be_written(
    run: Run, tmp_path: Path, name: str, words: tuple[str, ...]
) -> None:
    """Said before any work."""
    store(tmp_path / "m.exr")
    (tmp_path / "folder.npz").mkdir()
    outcome = run("tabulate", DOME, "--out", tmp_path / name)
    outcome.is_refused(*words)
    assert outcome.out == ""
    assert written(tmp_path) == ["folder.npz", "m.exr"]


# Real processes.


def test_a_real_process_says_the_same(run: Run, tmp_path: Path, out: Path) -> None:
    """OpenImageIO prints errors that nobody fetched when the process ends."""
    master = truncated(store(tmp_path / "c.jpg", kind="uint8"))
    arguments = ("compensate", master, "--scene", DOME, "--out", out)
    real = run_for_real(*arguments)
    real.is_refused("c.jpg", "complete JPEG")
    assert real == run(*arguments)
    assert written(out) == []


def test_standard_output_that_is_full(tmp_path: Path, out: Path) -> None:
    master = store(tmp_path / "m.exr")
    with Path("/dev/full").open("w") as full:
        outcome = run_for_real("observe", master, "--scene", DOME, "--out", out, stdout=full)
    outcome.is_refused("standard output", "no space left on device", "elsewhere")
    assert written(out) == ["m.exr"]


def test_standard_output_that_knows_ascii_only(tmp_path: Path) -> None:
    out = tmp_path / "naïf"
    master = store(tmp_path / "m.exr")
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii"}
    outcome = run_for_real("observe", master, "--scene", DOME, "--out", out, env=ascii_only)
    assert (outcome.code, outcome.err) == (0, "")
    assert r"na\xeff/m.exr" in outcome.out
    assert written(out) == ["m.exr"]


def test_a_file_whose_name_is_no_text(run: Run, tmp_path: Path, out: Path) -> None:
    path = store(tmp_path / "a.exr").rename(tmp_path / os.fsdecode(b"\xff.exr"))
    observed(run, out, DOME, path).is_refused(r"\udcff.exr", "UTF-8", "Rename")
    assert written(out) == []
