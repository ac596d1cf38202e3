"""What the command does with bad stereo input: one line that helps, exit code 2, no files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from test_bad_input import store, touched, truncated, with_sample, written

from domesim.observation.transport import Transport
from domesim.scene import load_dome, load_stereo
from domesim.scene.crosstalk_maps import CrosstalkMaps

SCENE = "stereo_polarised_paper"
ROWS, COLS = 12, 20
COMMANDS = ("compensate", "observe", "compare")


def view(seed: int = 0, rows: int = ROWS, cols: int = COLS) -> np.ndarray:
    return (0.1 + 0.6 * np.random.default_rng(seed).random((rows, cols, 3))).astype(np.float32)


@dataclass(frozen=True)
class Pair:
    """Left and right on the disk, in a folder of their own."""

    folder: Path

    @property
    def left(self) -> Path:
        return store(self.folder / "l.exr", view(0))

    @property
    def right(self) -> Path:
        return store(self.folder / "r.exr", view(1))

    @property
    def arguments(self) -> tuple[object, ...]:
        return ("--left", self.left, "--right", self.right)


@pytest.fixture
def pair(tmp_path: Path) -> Pair:
    folder = tmp_path / "in"
    folder.mkdir()
    return Pair(folder)


def place(command: str, out: Path) -> Path:
    return out / "page.html" if command == "compare" else out


def numbered(folder: Path, name: str, numbers: list[int], first_seed: int = 0) -> Path:
    for number in numbers:
        store(folder / f"{name}.{number:04d}.exr", view(first_seed + number))
    return folder / f"{name}.####.exr"


# Which files.

Arguments = Callable[[Pair], tuple[object, ...]]
SHOWS: dict[str, tuple[Arguments, tuple[str, ...]]] = {
    "nothing": (lambda p: (), ("wanted a master, or --left and --right", "got none", "name")),
    "left alone": (
        lambda p: ("--left", p.left),
        ("wanted --left and --right", "l.exr only", "as --right"),
    ),
    "right alone": (
        lambda p: ("--right", p.right),
        ("wanted --left and --right", "r.exr only", "as --left"),
    ),
    "master and left": (
        lambda p: (p.right, "--left", p.left),
        ("wanted one master or --left and --right", "r.exr and", "l.exr", "leave one"),
    ),
    "unknown packing": (
        lambda p: (p.left, "--packing", "diagonal"),
        ("'diagonal'", "side-by-side, top-bottom, multi-view, multi-part"),
    ),
    "packing of two files": (
        lambda p: (*p.arguments, "--packing", "side-by-side"),
        ("--packing side-by-side", "one file of two views", "leave --packing out"),
    ),
    "a packing that it has not": (
        lambda p: (p.left, "--packing", "multi-view"),
        ("l.exr", "packed as multi-view", "got single", "Leave the packing out"),
    ),
    "an odd width to halve": (
        lambda p: (store(p.folder / "odd.png", view(0, 8, 9), "uint8"), "--packing=side-by-side"),
        ("odd.png", "even width", "9 x 8", "Crop"),
    ),
    "mono": (
        lambda p: (p.left,),
        ("l.exr", "left and right for stereo_polarised_paper", "one picture", "--packing"),
    ),
    "a file twice": (
        lambda p: ("--left", p.left, "--right", p.left),
        ("l.exr", "the same file twice", "Name the other one", "--allow-identical"),
    ),
    "a file and a link to it": (
        lambda p: ("--left", p.left, "--right", linked(p.left, p.folder / "r.exr")),
        ("l.exr", "r.exr", "the same file twice", "Name the other one"),
    ),
    "the same picture twice": (
        lambda p: ("--left", p.left, "--right", store(p.folder / "r.exr", view(0))),
        ("l.exr", "r.exr", "the same image twice", "--allow-identical"),
    ),
    "two sizes": (
        lambda p: ("--left", p.left, "--right", store(p.folder / "r.exr", view(1, 14, 20))),
        ("r.exr", "one size", "20 x 12 and 20 x 14", "Render both alike"),
    ),
    "two encodings": (
        lambda p: ("--left", p.left, "--right", store(p.folder / "r.png", view(1), "uint8")),
        ("r.png", "one encoding", "linear", "sRGB", "Convert"),
    ),
    "a file and a pattern": (
        lambda p: ("--left", p.left, "--right", numbered(p.folder, "r", [1, 2])),
        ("two files or two numbered patterns", "one of each"),
    ),
    "frames missing on one side": (
        lambda p: (
            "--left",
            numbered(p.folder, "l", [1, 2, 3]),
            "--right",
            numbered(p.folder, "r", [2, 3], 10),
        ),
        ("the same frames on both sides", "missing 1 on the right", "--frames 2-3"),
    ),
    "no right": (
        lambda p: ("--left", p.left, "--right", p.folder / "no.exr"),
        ("no.exr", "no such file", "Check the path"),
    ),
    "a cut right": (
        lambda p: ("--left", p.left, "--right", truncated(p.right)),
        ("r.exr", "complete EXR", "again"),
    ),
    "NaN on the right": (
        lambda p: ("--left", store(p.folder / "l.exr"), "--right", nan(p)),
        ("n.exr", "4 NaN", "row 4, col 20, channel G", "--repair"),
    ),
    "too bright": (
        lambda p: ("--left", store(p.folder / "l.exr", kind="float"), "--right", bright(p)),
        ("l.exr", "1e+09", "got 1e+30", "clamp"),
    ),
}


def linked(path: Path, link: Path) -> Path:
    link.symlink_to(path)
    return link


def nan(pair: Pair) -> Path:
    return with_sample(pair.folder / "n.exr", np.nan)


def bright(pair: Pair) -> Path:
    return with_sample(pair.folder / "b.exr", 1e30)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("case", SHOWS)
def test_a_show_that_is_no_pair(run: Run, pair: Pair, out: Path, command: str, case: str) -> None:
    make, words = SHOWS[case]
    target = place(command, out)
    run(command, *make(pair), "--scene", SCENE, "--out", target).is_refused(*words)
    assert written(out) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_a_stereo_master_for_a_dome(run: Run, pair: Pair, out: Path, command: str) -> None:
    outcome = run(
        command, *pair.arguments, "--scene", "dome_hemisphere", "--out", place(command, out)
    )
    outcome.is_refused("l.exr", "a domemaster for dome_hemisphere", "left and right", "each alone")
    assert written(out) == []


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_the_other_frames_of_a_stereo_sequence_are_written(
    run: Run, pair: Pair, out: Path, command: str
) -> None:
    left = numbered(pair.folder, "l", [1, 2, 3])
    right = numbered(pair.folder, "r", [1, 2, 3], 10)
    truncated(pair.folder / "r.0002.exr")
    arguments = ("--left", left, "--right", right, "--scene", SCENE, "--out", out, "--json")
    outcome = run(command, *arguments, "--workers", 0)
    outcome.is_refused("r.0002.exr", "complete EXR")
    assert written(out) == ["l.0001.exr", "l.0003.exr", "r.0001.exr", "r.0003.exr"]
    figures = json.loads(outcome.out)
    assert (len(figures["frames"]), len(figures["failed"])) == (2, 1)


# Settings that do not go together.


@pytest.mark.parametrize("command", COMMANDS)
def test_a_seat_that_is_not_there(run: Run, pair: Pair, out: Path, command: str) -> None:
    arguments = (command, *pair.arguments, "--out", place(command, out), "--seat", "balcony")
    run(*arguments, "--scene", SCENE).is_refused("no seat 'balcony'", "sweet spot, left, right")
    refused = run(command, pair.left, *arguments[5:], "--scene", "dome_hemisphere")
    refused.is_refused("dome_hemisphere has no seat 'balcony'", "names none")
    assert written(out) == []


def test_what_is_seen_is_seen_from_one_seat(run: Run, pair: Pair, out: Path) -> None:
    outcome = run("observe", *pair.arguments, "--scene", SCENE, "--seat", "all", "--out", out)
    outcome.is_refused("--seat all", "one seat", "name one of sweet spot, left, right")
    assert written(out) == []


@pytest.mark.parametrize(
    ("scene", "options", "words"),
    [
        ("dome_hemisphere", ["--method", "paper"], ("'paper'", "dome_hemisphere", "perceptual")),
        (SCENE, ["--method", "best"], ("'best'", SCENE, "perceptual, paper, subtractive")),
        ("stereo_shutter", ["--method", "paper"], ("'paper'", "stereo_shutter", "subtractive")),
    ],
)
def test_a_method_of_another_kind(
    run: Run, pair: Pair, out: Path, scene: str, options: list[str], words: tuple[str, ...]
) -> None:
    shown = pair.arguments if scene.startswith("stereo") else (pair.left,)
    outcome = run("compensate", *shown, "--scene", scene, "--out", out, *options)
    outcome.is_refused(*words)
    assert written(out) == []


@pytest.mark.parametrize("command", ["demo", "render"])
def test_commands_of_a_dome(run: Run, out: Path, command: str) -> None:
    scene = [SCENE] if command == "render" else ["--scene", SCENE]
    target = out / "x.exr" if command == "render" else out
    run(command, *scene, "--out", target).is_refused(SCENE, "dome theatre")
    assert written(out) == []


def test_there_is_no_hardware_to_trace(run: Run, out: Path) -> None:
    outcome = run("tabulate", SCENE, "--out", out / "x.npz")
    outcome.is_refused(SCENE, "[crosstalk.polarisation]", "leave --transport out")
    assert written(out) == []


@pytest.mark.parametrize(
    "options", [("--walks", 1e5), ("--error", 0.1), ("--degree", 2), ("--no-check",)]
)
def test_options_of_a_dome(run: Run, out: Path, options: tuple[object, ...]) -> None:
    outcome = run("tabulate", CINEMA, "--out", out / "x.npz", *options)
    outcome.is_refused(str(options[0]), f"{CINEMA} is a stereo system", "leave it out")
    assert written(out) == []


# Stored crosstalk maps.

CINEMA = "stereo_cinema_silver"


def maps(path: Path, **facts: object) -> Path:
    """Maps of `CINEMA`, as far as one can tell."""
    scene = load_stereo(CINEMA)
    seats = tuple(scene.seats)
    share = np.full((len(seats), 2, 9, 15), 0.02)
    provenance = {"scene": scene.name, "digest": scene.digest, **facts}
    CrosstalkMaps(seats, share, share / 100, provenance).save(path)
    return path


def dome_transport(path: Path) -> Path:
    scene = load_dome("dome_hemisphere")
    Transport(
        scene.dome,
        modes=np.ones((1, 9, 9)),
        core=np.full((3, 1, 1), 0.2),
        core_error=np.full((3, 1, 1), 1e-4),
        ambient=np.zeros((3, 9, 9)),
        provenance={"scene": scene.name, "digest": scene.digest},
    ).save(path)
    return path


TABLES: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "missing": (lambda d: d / "no.npz", ("no.npz", "No such file")),
    "text": (lambda d: touched(d / "t.npz", b"hello" * 99), ("t.npz", "domesim tabulate")),
    "cut": (lambda d: truncated(maps(d / "c.npz")), ("c.npz", "damaged")),
    "another system": (
        lambda d: maps(d / "o.npz", scene="the old one", digest="0"),
        ("o.npz", "'the old one'", "domesim tabulate stereo_cinema_silver"),
    ),
    "a dome's": (
        lambda d: dome_transport(d / "d.npz"),
        ("d.npz", "'domesim crosstalk maps 1'", "got domesim transport"),
    ),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("case", TABLES)
def test_crosstalk_maps_that_are_none(
    run: Run, pair: Pair, tmp_path: Path, out: Path, command: str, case: str
) -> None:
    make, words = TABLES[case]
    arguments = (command, *pair.arguments, "--scene", CINEMA, "--out", place(command, out))
    run(*arguments, "--transport", make(tmp_path)).is_refused(*words)
    assert written(out) == []


def test_crosstalk_maps_for_a_dome(run: Run, pair: Pair, tmp_path: Path, out: Path) -> None:
    outcome = run(
        "observe",
        pair.left,
        "--scene",
        "dome_hemisphere",
        "--transport",
        maps(tmp_path / "m.npz"),
        "--out",
        out,
    )
    outcome.is_refused("m.npz", "'domesim transport 1'", "got domesim crosstalk maps 1")
    assert written(out) == []


def test_crosstalk_maps_without_hardware(run: Run, pair: Pair, tmp_path: Path, out: Path) -> None:
    arguments = ("observe", *pair.arguments, "--scene", SCENE, "--out", out)
    outcome = run(*arguments, "--transport", maps(tmp_path / "m.npz"))
    outcome.is_refused("m.npz", f"{SCENE} has no hardware to trace", "leave --transport out")
    assert "tabulate" not in outcome.err


def test_the_maps_above_work_undamaged(run: Run, pair: Pair, tmp_path: Path, out: Path) -> None:
    table = maps(tmp_path / "m.npz")
    arguments = ("observe", *pair.arguments, "--scene", CINEMA, "--out", out)
    outcome = run(*arguments, "--transport", table)
    assert (outcome.code, outcome.err) == (0, "")
    assert "traced" in outcome.out


# Scene files.

WORKING = """
name = "a test"
screen = { width_m = 2.5, height_m = 1.4 }
projector = { white_cd_m2 = 50 }
crosstalk = { share = 0.02 }
viewing = { distance_m = 3, adaptation_cd_m2 = 5 }
seats = [{ name = "middle" }, { name = "side", map = [[1, 2]] }]
"""
HARDWARE = (
    "crosstalk.polarisation = { lenses_m = [[-0.2, -30, 2], [0.2, -30, 2]], roughness = 0.3, "
    "depolarising_share = 0.04 }"
)
TABLE = "crosstalk.table = {{ levels = {}, to_left = {}, to_right = {} }}"
READINGS = 'crosstalk.readings = "no.csv"'
SHARE, SEATS = "crosstalk = { share = 0.02 }", WORKING.splitlines()[-1]
SCENE_FILES: dict[str, tuple[dict[str, str], tuple[str, ...]]] = {
    "no way": ({SHARE: "crosstalk = {}"}, ("crosstalk: ", "one way", "got none")),
    "two ways": (
        {SHARE: 'crosstalk = { share = 0.02, readings = "r.csv" }'},
        ("crosstalk: ", "one way", "got share and readings"),
    ),
    "one direction": (
        {SHARE: "crosstalk = { to_left = 0.02 }"},
        ("crosstalk: ", "both to_left and to_right"),
    ),
    "no section": ({SHARE: "crosstalk = 0.02"}, ("crosstalk: ", "a section [crosstalk]")),
    "unknown key": ({"share": "shares"}, ("crosstalk.shares: ", "did you mean 'share'")),
    "unknown section": (
        {"viewing =": "ambiant = {}\nviewing ="},
        ("ambiant: ", "did you mean 'ambient'"),
    ),
    "no crosstalk": ({SHARE: ""}, ("needs [crosstalk] (3D)",)),
    "NaN": ({"share = 0.02": "share = nan"}, ("crosstalk.share: ", "finite", "got nan")),
    "text": ({"share = 0.02": 'share = "much"'}, ("crosstalk.share: ", "got 'much'")),
    "percent": ({"share = 0.02": "share = 2"}, ("crosstalk.share: ", "0.9", "got 2")),
    "negative": (
        {"share = 0.02": "share = -0.02"},
        ("to the left eye", "must add light", "got -0.02", "exchanged"),
    ),
    "two numbers": ({"share = 0.02": "share = [0.1, 0.2]"}, ("crosstalk.share[2]: is missing",)),
    "a matrix with text": (
        {"share = 0.02": 'share = [[0, 0, 0], [0, "x", 0], [0, 0, 0]]'},
        ("crosstalk.share[1][1]: ", "got 'x'"),
    ),
    "too much at a seat": (
        {"[[1, 2]]": "[[1, 60]]"},
        ("seat 'side': ", "to the left eye", "well below", "120%"),
    ),
    "a ragged map": ({"[[1, 2]]": "[[1, 2], [1]]"}, ("seats[1]: ", "map", "all as long")),
    "two maps": (
        {"map = [[1, 2]]": "map = [[1]], map_left = [[1]], map_right = [[1]]"},
        ("seats[1]: ", "give one of the two"),
    ),
    "half a map": ({"map =": "map_left ="}, ("seats[1]: ", "both map_left and map_right")),
    "seats of one name": ({'"side"': '"middle"'}, ("seats: ", "must differ", "middle")),
    "a seat called all": ({'"side"': '"all"'}, ("seats: ", "'all'", "several")),
    "a seat without a name": ({'name = "side", ': ""}, ("seats[1].name: ", "is missing")),
    "no position": ({SHARE: HARDWARE}, ("seats[0].position_m: ", "is missing")),
    "hardware without seats": (
        {SHARE: HARDWARE, SEATS: ""},
        ("seats: ", "polarisation depends on the seat"),
    ),
    "a table that is not square": (
        {SHARE: TABLE.format("[0, 1]", "[[0, 0.1]]", "[[0, 0.1], [0, 0]]"), ", map = [[1, 2]]": ""},
        ("crosstalk.table: ", "to_left: must be 2 rows of 2"),
    ),
    "levels that fall": (
        {SHARE: TABLE.format("[0, 1, 0.5]", [[0] * 3] * 3, [[0] * 3] * 3), ", map = [[1, 2]]": ""},
        ("levels",),
    ),
    "primaries": (
        {"white_cd": 'primaries = "sRGB", white_cd'},
        ("projector: ", "'sRGB' are not known", "BT.709", "or measured with [crosstalk] readings"),
    ),
    "measured by nothing": (
        {"white_cd_m2 = 50": 'primaries = "measured"'},
        ("projector.primaries: ", "need [crosstalk] readings", "name the primaries"),
    ),
    "no white": ({"white_cd_m2 = 50": ""}, ("projector.white_cd_m2: is missing",)),
    "black of no readings": (
        {"share = 0.02": 'share = 0.02, black = "subtracted"'},
        ("crosstalk: ", "black says how to take readings", "leave it out"),
    ),
    "primaries beside readings": (
        {SHARE: READINGS, "white_cd": 'primaries = "P3-D65", white_cd'},
        ("projector.primaries: ", "leave primaries out"),
    ),
    "readings that are not there": (
        {SHARE: READINGS, "white_cd_m2 = 50": ""},
        ("no.csv", "No such file", "check the path"),
    ),
}


@pytest.mark.parametrize("case", SCENE_FILES)
def test_a_mistake_in_a_stereo_scene_is_one_line(
    run: Run, pair: Pair, tmp_path: Path, out: Path, case: str
) -> None:
    changes, words = SCENE_FILES[case]
    text = WORKING
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after, 1)
    scene = touched(tmp_path / "my.toml", text.encode())
    outcome = run("compensate", *pair.arguments, "--scene", scene, "--out", out)
    outcome.is_refused(str(scene), *words)
    assert len(outcome.err) < 500
    assert written(out) == []


def test_a_misspelt_section_is_no_dome(run: Run, pair: Pair, tmp_path: Path, out: Path) -> None:
    scene = touched(tmp_path / "my.toml", WORKING.replace("crosstalk =", "crosstlk =").encode())
    outcome = run("compensate", *pair.arguments, "--scene", scene, "--out", out)
    assert outcome.code == 2
    assert [line.strip() for line in outcome.err.splitlines()[1:]] == [
        "crosstalk: is missing",
        "crosstlk: is not a key of a scene (did you mean 'crosstalk'?)",
    ]


def test_the_stereo_scene_above_works_without_its_mistakes(
    run: Run, pair: Pair, tmp_path: Path, out: Path
) -> None:
    scene = touched(tmp_path / "my.toml", WORKING.encode())
    outcome = run("compensate", *pair.arguments, "--scene", scene, "--seat", "all", "--out", out)
    assert (outcome.code, outcome.err) == (0, "")
    assert written(out) == ["l.exr", "r.exr"]


def test_all_mistakes_of_a_stereo_scene_in_one_go(
    run: Run, pair: Pair, tmp_path: Path, out: Path
) -> None:
    text = WORKING.replace("1.4", "-1").replace("white_cd_m2 = 50", "lumens = 3")
    text = text.replace("share = 0.02", "share = [0.02, 3, 0.02]")
    scene = touched(tmp_path / "my.toml", text.encode())
    outcome = run("observe", *pair.arguments, "--scene", scene, "--out", out)
    assert outcome.code == 2
    assert [line.split(": ")[0].strip() for line in outcome.err.splitlines()[1:]] == [
        "screen.height_m",
        "projector.white_cd_m2",
        "projector.lumens",
        "crosstalk.share[1]",
    ]
    assert written(out) == []
