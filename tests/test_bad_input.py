"""What the command does with bad input: one line that helps, exit code 2, nothing half-written."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import Run, run_for_real

from domesim.frames import ColourTag, Frame, read_frame, write_frame
from domesim.observation.transport import Transport
from domesim.scene import load_scene, scene_names

SCENE = "dome_hemisphere"
SIZE = 32
WORKING = """
name = "a test"
dome = { radius_m = 5.0 }
screen = { albedo = 0.45 }
projector = { white_cd_m2 = 13.7 }
viewing = { adaptation_cd_m2 = 1.4 }
"""


def written(folder: Path) -> list[str]:
    """All that is in `folder`, hidden files too, but for a job's records."""
    found = (path.relative_to(folder) for path in folder.rglob("*"))
    return sorted(str(path) for path in found if path.parts[0] != "job")


def picture(rows: int = SIZE, cols: int = SIZE, channels: int = 3) -> np.ndarray:
    rng = np.random.default_rng(3)
    return (0.6 * rng.random((rows, cols, channels))).astype(np.float32)


def store(
    path: Path, samples: np.ndarray | None = None, kind: str = "half", names: str = ""
) -> Path:
    """An image file, by OpenImageIO alone: it holds what domesim would not write."""
    samples = picture() if samples is None else samples
    spec = oiio.ImageSpec(*samples.shape[1::-1], samples.shape[2], kind)
    if names:
        spec.channelnames = tuple(names.split(","))
    writer = oiio.ImageOutput.create(str(path))
    assert writer.open(str(path), spec), writer.geterror()
    assert writer.write_image(samples), writer.geterror()
    assert writer.close()
    return path


def truncated(path: Path) -> Path:
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])
    return path


def with_sample(path: Path, value: float) -> Path:
    """An EXR with four samples of `value`, the first at row 4, col 20, G."""
    samples = picture()
    samples[4, 20, 1] = samples[5, 20] = value
    return store(path, samples, "float")


def sequence(folder: Path, numbers: range | list[int]) -> Path:
    """Numbered EXRs, and their pattern."""
    folder.mkdir()
    first = store(folder / f"show.{numbers[0]:04d}.exr")
    for number in numbers[1:]:
        os.link(first, folder / f"show.{number:04d}.exr")
    return folder / "show.####.exr"


def damage(path: Path) -> None:
    """Truncate `path` alone, not the files that it is linked with."""
    content = path.read_bytes()
    path.unlink()
    path.write_bytes(content[: len(content) // 2])


# Masters that are no masters: what is made in an empty folder, and words of the message.

MASTERS: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "missing": (lambda d: d / "no.exr", ("no.exr", "no such file", "Check the path")),
    "folder": (lambda d: d, ("got a folder", "Name a file")),
    "nothing matches": (lambda d: d / "no.####.exr", ("no.####.exr", "none matches")),
    "gap": (lambda d: sequence(d / "s", [1, 2, 4]), ("missing 3", "--frames 1-2,4")),
    "long name": (lambda d: d / ("x" * 300 + ".exr"), ("xxx", "name too long", "Check")),
    "line break": (lambda d: d / "a\nb\x1b[31m.exr", (r"a\nb\x1b[31m.exr", "no such file")),
    "device": (lambda _: Path("/dev/zero"), ("/dev/zero", "got a device or pipe")),
    "empty": (lambda d: touched(d / "e.exr", b""), ("e.exr", "empty file", "Copy or render")),
    "text": (lambda d: touched(d / "t.exr", b"hello" * 99), ("t.exr", "wanted an image")),
    "cut EXR": (lambda d: truncated(store(d / "c.exr")), ("c.exr", "complete EXR", "again")),
    "cut PNG": (lambda d: truncated(store(d / "c.png", kind="uint8")), ("c.png", "complete PNG")),
    "cut TIFF": (
        lambda d: truncated(store(d / "c.tif", kind="uint16")),
        ("c.tif", "complete TIFF"),
    ),
    "cut JPEG": (lambda d: truncated(store(d / "c.jpg", kind="uint8")), ("c.jpg", "complete JPEG")),
    "grey": (
        lambda d: store(d / "g.png", picture(channels=1), "uint8"),
        ("g.png", "channels R, G, B", "got Y", "R=Y,G=Y,B=Y"),
    ),
    "two channels": (
        lambda d: store(d / "2.exr", picture(channels=2), names="left,right"),
        ("2.exr", "channels R, G, B", "got left, right", "Convert"),
    ),
    "NaN": (
        lambda d: with_sample(d / "n.exr", np.nan),
        ("n.exr", "4 NaN", "row 4, col 20, channel G"),
    ),
    "Inf": (
        lambda d: with_sample(d / "i.exr", np.inf),
        ("i.exr", "4 Inf", "row 4, col 20, channel G"),
    ),
    "negative": (lambda d: with_sample(d / "m.exr", -0.5), ("m.exr", "4 negative", "--repair")),
}
# These are found when the theatre is asked for the picture's size and brightness.
UNSUITABLE: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "not square": (
        lambda d: store(d / "w.png", picture(20, 32), "uint8"),
        ("w.png", "square", "32 x 20", "crop or pad"),
    ),
    "one pixel": (
        lambda d: store(d / "1.exr", picture(1, 1)),
        ("1.exr", "at least 2 x 2", "1 x 1"),
    ),
    "too bright": (
        lambda d: with_sample(d / "b.exr", 1e30),
        ("b.exr", "1e+09", "got 1e+30", "clamp"),
    ),
}


def touched(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("command", ["compensate", "observe", "compare"])
@pytest.mark.parametrize("case", MASTERS)
def test_a_bad_master_is_named_in_one_line(
    run: Run, tmp_path: Path, out: Path, command: str, case: str
) -> None:
    make, words = MASTERS[case]
    folder = tmp_path / "in"
    folder.mkdir()
    target = out / "page.html" if command == "compare" else out
    run(command, make(folder), "--scene", SCENE, "--out", target).is_refused(*words)
    assert written(out) == []


@pytest.mark.parametrize(
    ("command", "case"),
    [
        *((command, case) for command in ("compensate", "observe") for case in UNSUITABLE),
        ("compare", "not square"),
        ("compare", "one pixel"),
        ("compare", "too bright"),
    ],
)
def test_an_unsuitable_master_is_named_in_one_line(
    run: Run, tmp_path: Path, out: Path, command: str, case: str
) -> None:
    make, words = UNSUITABLE[case]
    target = out / "page.html" if command == "compare" else out
    run(command, make(tmp_path), "--scene", SCENE, "--out", target).is_refused(*words)
    assert written(out) == []


@pytest.mark.parametrize("command", ["compensate", "compare"])
def test_weightings_have_names(run: Run, tmp_path: Path, out: Path, command: str) -> None:
    target = out / "page.html" if command == "compare" else out
    arguments = (command, store(tmp_path / "a.exr"), "--scene", SCENE, "--out", target)
    run(*arguments, "--weighting", "contours").is_refused("use one of contrast, paper")
    assert written(out) == []


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_a_file_whose_name_is_no_text(run: Run, tmp_path: Path, out: Path, command: str) -> None:
    path = store(tmp_path / "a.exr").rename(tmp_path / os.fsdecode(b"\xff.exr"))
    run(command, path, "--scene", SCENE, "--out", out).is_refused(r"\udcff.exr", "UTF-8", "Rename")
    assert written(out) == []


@pytest.mark.parametrize("value", [np.nan, np.inf, -0.5])
@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_repair_says_how_many_samples(
    run: Run, tmp_path: Path, out: Path, command: str, value: float
) -> None:
    master = with_sample(tmp_path / "r.exr", value)
    arguments = (command, master, "--scene", SCENE, "--out", out, "--repair")
    outcome = run(*arguments)
    assert (outcome.code, outcome.err) == (0, "")
    assert "4 impossible samples repaired" in outcome.out
    (frame,) = json.loads(run(*arguments, "--json").out)["frames"]
    assert frame["repaired"] == 4
    assert read_frame(out / "r.exr").pixels.min() >= 0  # it refuses NaN and Inf itself


@pytest.mark.parametrize("command", ["compensate", "observe"])
@pytest.mark.parametrize("size", [2, 3])
def test_the_smallest_masters_work(
    run: Run, tmp_path: Path, out: Path, command: str, size: int
) -> None:
    master = store(tmp_path / "s.exr", picture(size, size))
    outcome = run(command, master, "--scene", SCENE, "--out", out)
    assert (outcome.code, outcome.err) == (0, "")
    assert read_frame(out / "s.exr").pixels.shape == (size, size, 3)


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_what_half_cannot_hold_is_clipped_and_said(
    run: Run, tmp_path: Path, out: Path, command: str
) -> None:
    master = store(tmp_path / "h.exr", picture() + 65000)
    outcome = run(command, master, "--scene", SCENE, "--out", out)
    assert (outcome.code, outcome.err) == (0, "")
    assert read_frame(out / "h.exr").pixels.max() <= 65504
    if command == "observe":
        assert "clipped: 100.0% of the screen" in outcome.out


# Sequences: one bad frame is no reason to lose the others.


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_the_other_frames_of_a_sequence_are_written(
    run: Run, tmp_path: Path, out: Path, command: str
) -> None:
    pattern = sequence(tmp_path / "s", range(1, 4))
    damage(pattern.with_name("show.0002.exr"))
    outcome = run(command, pattern, "--scene", SCENE, "--out", out, "--workers", 0)
    outcome.is_refused("show.0002.exr", "complete EXR")
    assert written(out) == ["show.0001.exr", "show.0003.exr"]
    for name in written(out):
        assert name in outcome.out
        assert read_frame(out / name).pixels.shape == (SIZE, SIZE, 3)


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_json_stays_json_when_frames_fail(
    run: Run, tmp_path: Path, out: Path, command: str
) -> None:
    pattern = sequence(tmp_path / "s", range(1, 4))
    damage(pattern.with_name("show.0001.exr"))
    store(pattern.with_name("show.0003.exr").with_suffix(".png"), picture(4, 5), "uint8").rename(
        pattern.with_name("show.0003.exr")
    )
    alone = ("--workers", 0)
    outcome = run(command, pattern, "--scene", SCENE, "--out", out, "--json", *alone)
    assert outcome.code == 2
    figures = json.loads(outcome.out)
    assert [Path(frame["output"]).name for frame in figures["frames"]] == ["show.0002.exr"]
    assert [f"domesim: {message}" for message in figures["failed"]] == outcome.err.splitlines()
    first, third = figures["failed"]
    assert "show.0001.exr" in first
    assert "complete EXR" in first
    assert "show.0003.exr" in third
    assert "square" in third
    assert written(out) == ["show.0002.exr"]


def test_compare_takes_one_frame(run: Run, tmp_path: Path, out: Path) -> None:
    pattern = sequence(tmp_path / "s", range(1, 4))
    outcome = run("compare", pattern, "--scene", SCENE, "--out", out / "page.html")
    outcome.is_refused("show.####.exr", "one frame", "got 3", "name one")
    assert written(out) == []


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ("1-9", ("wanted frames 1-9", "missing 4-9", "--frames 1-3")),
        ("x", ("--frames", "1-100x10", "got 'x'")),
        ("1-999999999", ("--frames", "got '1-999999999'")),
    ],
)
def test_frames_that_there_are_not(
    run: Run, tmp_path: Path, out: Path, frames: str, words: tuple[str, ...]
) -> None:
    pattern = sequence(tmp_path / "s", range(1, 4))
    run("observe", pattern, "--scene", SCENE, "--out", out, "--frames", frames).is_refused(*words)
    assert written(out) == []


# Scenes.


@pytest.mark.parametrize("command", ["compensate", "observe", "compare"])
def test_an_unknown_scene_is_suggested(run: Run, tmp_path: Path, out: Path, command: str) -> None:
    master = store(tmp_path / "m.exr")
    outcome = run(command, master, "--scene", "dome_imx", "--out", out)
    outcome.is_refused("'dome_imx'", "did you mean 'dome_imax'?", *scene_names(), ".toml")
    assert written(out) == []


@pytest.mark.parametrize("name", ["", "dome imax", "a\nb"])
def test_a_scene_that_is_like_no_other(run: Run, tmp_path: Path, out: Path, name: str) -> None:
    outcome = run("observe", store(tmp_path / "m.exr"), "--scene", name, "--out", out)
    outcome.is_refused(f"scene {name!r} is not known", *scene_names())


SCENE_FILES: dict[str, tuple[tuple[str, str], tuple[str, ...]]] = {
    "misspelt key": (("5.0", "5.0, titl_deg = 3"), ("dome.titl_deg", "did you mean 'tilt_deg'?")),
    "misspelt section": (("screen", "ambiant = {}\nscreen"), ("ambiant", "mean 'ambient'?")),
    "quoted key": (("radius_m", '"a b" = 1, radius_m'), ('dome."a b"', "known: radius_m")),
    "missing key": (("radius_m = 5.0", ""), ("dome.radius_m", "is missing")),
    "no section": (("{ radius_m = 5.0 }", "5"), ("dome: must be a section [dome]", "got 5")),
    "albedo 1.2": (("0.45", "1.2"), ("screen.albedo", "less than or equal to 1", "got 1.2")),
    "albedo nan": (("0.45", "nan"), ("screen.albedo", "finite", "got nan")),
    "albedo true": (("0.45", "true"), ("screen.albedo", "valid number", "got True")),
    "albedo of two": (("0.45", "[0.4, 0.5]"), ("screen.albedo[2]", "is missing")),
    "albedo of four": (("0.45", "[0, 0, 0, 0]"), ("screen.albedo", "3 values", "got [0, 0, 0, 0]")),
    "radius 0": (("5.0", "0"), ("dome.radius_m", "greater than 0", "got 0")),
    "radius in mm": (("5.0", "5000"), ("dome.radius_m", "less than or equal to 1000", "got 5000")),
    "radius 1e-300": (("5.0", "1e-300"), ("dome.radius_m", "at least 0.01", "got 1e-300")),
    "radius 1e300": (("5.0", "1e300"), ("dome.radius_m", "1000", "got 1e+300")),
    "radius as text": (("5.0", "'5.0'"), ("dome.radius_m", "valid number", "got '5.0'")),
    "long text": (("5.0", f"'{'5' * 9999}'"), ("dome.radius_m", "valid number", "got '555")),
    "white 0": (("13.7", "0"), ("projector.white_cd_m2", "greater than", "got 0")),
    "black above white": (("13.7", "1, black_cd_m2 = 2"), ("black", "below white", "got 2")),
    "primaries": (
        ("white", 'primaries = "BT.70", white'),
        ("projector", "'BT.70'", "use one of BT.709"),
    ),
    "closed white sphere": (
        ("5.0 }\nscreen = { albedo = 0.45", "5.0, half_angle_deg = 180 }\nscreen = { albedo = 1"),
        ("albedo 1", "never loses light", "lower the albedo"),
    ),
    "adaptation 1e-300": (("1.4", "1e-300"), ("viewing.adaptation_cd_m2", "got 1e-300")),
    "syntax": (("{ radius_m", "radius_m"), ("not valid TOML", "line 3")),
    "key twice": (("radius_m", "radius_m = 3, radius_m"), ("not valid TOML", "line 3")),
    "number too long": (("5.0", "5" * 9999), ("not valid TOML", "digits")),
    "too deep": (("5.0", "[" * 9999), ("not valid TOML", "recursion")),
}


@pytest.mark.parametrize("case", SCENE_FILES)
def test_a_mistake_in_a_scene_file_is_one_line(
    run: Run, tmp_path: Path, out: Path, case: str
) -> None:
    (before, after), words = SCENE_FILES[case]
    assert before in WORKING
    scene = tmp_path / "my.toml"
    scene.write_text(WORKING.replace(before, after, 1))
    master = store(tmp_path / "m.exr")
    outcome = run("compensate", master, "--scene", scene, "--out", out)
    outcome.is_refused(str(scene), *words)
    assert len(outcome.err) < 400
    assert written(out) == []


def test_the_scene_file_above_works_without_its_mistakes(
    run: Run, tmp_path: Path, out: Path
) -> None:
    scene = touched(tmp_path / "my.toml", WORKING.encode())
    assert run("compensate", store(tmp_path / "m.exr"), "--scene", scene, "--out", out).code == 0
    assert written(out) == ["m.exr"]


@pytest.mark.parametrize("command", ["compensate", "observe", "compare"])
def test_all_mistakes_of_a_scene_file_in_one_go(
    run: Run, tmp_path: Path, out: Path, command: str
) -> None:
    changes = {
        "5.0": "0, titl_deg = 3",
        "0.45": "[0.4, 1.2, -1]",
        "white_cd_m2": "whit_cd_m2",
        "1.4": '"bright"',
    }
    text = WORKING
    for before, after in changes.items():
        text = text.replace(before, after, 1)
    scene = touched(tmp_path / "my.toml", text.encode())
    outcome = run(command, store(tmp_path / "m.exr"), "--scene", scene, "--out", out)
    assert outcome.code == 2
    assert outcome.err.splitlines() == [
        f"domesim: {scene} has 7 mistakes:",
        "  dome.radius_m: must be greater than 0, got 0",
        "  dome.titl_deg: is not a key of a scene (did you mean 'tilt_deg'?)",
        "  screen.albedo[1]: must be less than or equal to 1, got 1.2",
        "  screen.albedo[2]: must be greater than or equal to 0, got -1",
        "  projector.lumens: is missing, and so is white_cd_m2: one of the two says how bright",
        "  projector.whit_cd_m2: is not a key of a scene (did you mean 'white_cd_m2'?)",
        "  viewing.adaptation_cd_m2: must be a valid number, got 'bright'",
    ]
    assert written(out) == []


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda d: d / "no.toml", ("no.toml", "No such file", "Check the path", *scene_names())),
        (lambda d: d, ("Is a directory", "Check the path", *scene_names())),
        (lambda d: touched(d / "b.toml", bytes(range(256))), ("b.toml", "TOML text file in UTF-8")),
        (lambda d: store(d / "s.exr"), ("s.exr", "TOML text file in UTF-8")),
    ],
    ids=["missing", "folder", "binary", "image"],
)
def test_a_scene_file_that_is_none(
    run: Run,
    tmp_path: Path,
    out: Path,
    make: Callable[[Path], Path],
    words: tuple[str, ...],
) -> None:
    master = store(tmp_path / "m.exr")
    run("observe", master, "--scene", make(tmp_path), "--out", out).is_refused(*words)
    assert written(out) == []


# Places to write to.


@pytest.mark.parametrize("command", ["compensate", "observe"])
@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("m.exr/below", ("m.exr/below", "not a directory", "Choose")),
        ("m.exr", ("m.exr", "file exists", "Choose")),
        ("/proc/x", ("/proc/x", "no such file", "Choose")),
        ("/proc", ("/proc", "wanted a folder for the results", "Choose")),
    ],
)
def test_a_folder_that_cannot_be_written(
    run: Run, tmp_path: Path, command: str, place: str, words: tuple[str, ...]
) -> None:
    """Once, not once a frame, and before any work."""
    pattern = sequence(tmp_path / "s", range(1, 3))
    store(tmp_path / "m.exr")
    outcome = run(command, pattern, "--scene", SCENE, "--out", tmp_path / place)
    outcome.is_refused(*words)
    assert outcome.out == ""
    assert written(tmp_path) == ["m.exr", "s", "s/show.0001.exr", "s/show.0002.exr"]


@pytest.mark.parametrize("command", ["compensate", "observe"])
@pytest.mark.parametrize("place", ["s", "s/../s", "link"])
def test_results_do_not_replace_the_master(
    run: Run, tmp_path: Path, command: str, place: str
) -> None:
    pattern = sequence(tmp_path / "s", range(1, 3))
    (tmp_path / "link").symlink_to("s")
    before = pattern.with_name("show.0001.exr").read_bytes()
    outcome = run(command, pattern, "--scene", SCENE, "--out", tmp_path / place)
    outcome.is_refused("show.0001.exr", "the input itself", "another folder")
    assert written(tmp_path / "s") == ["show.0001.exr", "show.0002.exr"]
    assert pattern.with_name("show.0001.exr").read_bytes() == before


@pytest.mark.parametrize("command", ["compensate", "observe"])
@pytest.mark.parametrize(("suffix", "bits"), [(".exr", 16), (".png", 16), (".jpg", 8)])
def test_a_full_disk(
    run: Run, tmp_path: Path, small_disk: Path, command: str, suffix: str, bits: int
) -> None:
    """What fitted is whole; what did not leaves nothing."""
    noise = np.random.default_rng(1).random((64, 64, 3)).astype(np.float32) * 0.8
    frame = Frame(noise, tmp_path, ColourTag("linear", "BT.709", "a test"), bits, suffix == ".exr")
    (tmp_path / "s").mkdir()
    for number in range(1, 7):
        write_frame(replace(frame, pixels=noise), tmp_path / "s" / f"show.{number}{suffix}")
    room = small_disk.joinpath("filler")
    room.write_bytes(bytes(24 * 1024))
    pattern = tmp_path / "s" / f"show.#{suffix}"
    outcome = run(command, pattern, "--scene", SCENE, "--out", small_disk, "--workers", 0)
    assert outcome.code == 2
    names = [f"show.{number}{suffix}" for number in range(1, 7)]
    complete = [name for name in names if (small_disk / name).exists()]
    assert 0 < len(complete) < 6
    assert written(small_disk) == ["filler", *complete]
    for name in complete:
        assert read_frame(small_disk / name).pixels.shape == noise.shape
    *lines, last = outcome.err.splitlines()
    if "job/" in lines[-1] + last:  # the report did not fit either
        assert "wanted to write it, got 'no space left on device'" in last
    told = 0
    for name in names:
        if name in complete and (small_disk / "job" / f"{name}.json").exists():
            continue
        for line in (line for line in (*lines, last) if name in line):
            assert "wanted to write it, got 'no space left on device'" in line
            assert "Free some space" in line
            told += 1
    alike = re.search("([0-9]) under way failed likewise", outcome.err)
    told += int(alike[1]) if alike else 0
    not_begun = re.search("([0-9]) of 6 frames were not begun after that", outcome.err)
    missing = 6 - len(list((small_disk / "job").glob("show.*.json")))
    assert told + (int(not_begun[1]) if not_begun else 0) == missing


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("page.txt", ("page.txt", ".html")),
        ("page", ("page", ".html")),
        ("m.exr/page.html", ("m.exr: wanted a folder", "file exists")),
        ("/proc/page.html", ("/proc: wanted a folder", "o such file")),
    ],
)
def test_a_page_that_cannot_be_written(
    run: Run, tmp_path: Path, name: str, words: tuple[str, ...]
) -> None:
    master = store(tmp_path / "m.exr")
    run("compare", master, "--scene", SCENE, "--out", tmp_path / name).is_refused(*words)
    assert written(tmp_path) == ["m.exr"]


def test_a_page_makes_its_folder(run: Run, tmp_path: Path) -> None:
    master = store(tmp_path / "m.exr")
    page = tmp_path / "new" / "page.html"
    assert run("compare", master, "--scene", SCENE, "--out", page).code == 0
    assert page.is_file()


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_another_format(run: Run, tmp_path: Path, command: str) -> None:
    master, out = store(tmp_path / "m.exr"), tmp_path / "out"
    run(command, master, "--scene", SCENE, "--out", out, "--format", "gif").is_refused(
        "gif", "use exr, png, tif, dpx, jpg"
    )
    assert run(command, master, "--scene", SCENE, "--out", out, "--format", "png").code == 0
    assert read_frame(out / "m.png").bits == 16


# Options.


SETTINGS = [
    (["--tolerance", "0"], ("tolerance", "between 0 and 1", "got 0")),
    (["--tolerance", "-1"], ("tolerance", "between 0 and 1", "got -1")),
    (["--tolerance", "inf"], ("tolerance", "between 0 and 1", "got inf")),
    (["--tolerance", "nan"], ("tolerance", "between 0 and 1", "got nan")),
    (["--lift", "-1"], ("lift", "at least 0", "got -1")),
    (["--lift", "nan"], ("lift", "at least 0", "got nan")),
    (["--lift", "2", "--weighting", "paper"], ("--lift is of --weighting contrast",)),
    (["--low-frequency-gain", "0.2"], ("of contrast, use --lift",)),
    (["--weighting", "paper", "--low-frequency-gain", "2"], ("gain", "0..1", "got 2")),
    (["--weighting", "paper", "--low-frequency-gain", "-0.1"], ("gain", "0..1", "got -0.1")),
    (["--weighting", "paper", "--low-frequency-gain", "nan"], ("gain", "0..1", "got nan")),
]
METHOD = (["--method", "best"], ("'best'", "perceptual", "subtractive", "raised-black", "none"))


@pytest.mark.parametrize(
    ("command", "options", "words"),
    [
        ("compensate", *METHOD),
        *(("compensate", *setting) for setting in SETTINGS),
        *(("compare", *setting) for setting in SETTINGS),
    ],
)
def test_impossible_settings(
    run: Run, tmp_path: Path, out: Path, command: str, options: list[str], words: tuple[str, ...]
) -> None:
    target = out / "page.html" if command == "compare" else out
    master = store(tmp_path / "m.exr")
    run(command, master, "--scene", SCENE, "--out", target, *options).is_refused(*words)
    assert written(out) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["compensate", "m.exr", "--scene", SCENE, "--out", "x", "--nope"],
            "No such option: --nope",
        ),
        (
            ["observe", "m.exr", "--scene", SCENE, "--out", "x", "--tolerance", "1"],
            "No such option",
        ),
        (["compensate", "m.exr", "--out", "x"], "Missing option '--scene'"),
        (["observe", "m.exr", "--scene", SCENE], "Missing option '--out'"),
        (["compare"], "Missing option"),
        (
            ["compensate", "m.exr", "--scene", SCENE, "--out", "x", "--tolerance", "y"],
            "'--tolerance'",
        ),
        (["compensat"], "No such command 'compensat'"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_wrong_usage(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], words: str
) -> None:
    """Typer's own message, of more lines than one."""
    monkeypatch.chdir(tmp_path)
    outcome = run(*arguments)
    assert outcome.code == 2
    assert words in outcome.err
    assert "--help" in outcome.err
    assert written(tmp_path) == []


# A real process says the same as `run` above.


@pytest.mark.parametrize("case", ["cut JPEG", "cut EXR"])
def test_a_real_process_says_the_same(run: Run, tmp_path: Path, out: Path, case: str) -> None:
    """OpenImageIO prints errors that nobody fetched when the process ends."""
    make, words = MASTERS[case]
    arguments = ("compensate", make(tmp_path), "--scene", SCENE, "--out", out)
    real = run_for_real(*arguments)
    real.is_refused(*words)
    assert real == run(*arguments)
    assert written(out) == []


def test_standard_output_that_is_full(tmp_path: Path, out: Path) -> None:
    master = store(tmp_path / "m.exr")
    with Path("/dev/full").open("w") as full:
        outcome = run_for_real("observe", master, "--scene", SCENE, "--out", out, stdout=full)
    outcome.is_refused("standard output", "no space left on device", "elsewhere")
    assert written(out) == ["m.exr"]


def test_standard_output_that_knows_ascii_only(tmp_path: Path) -> None:
    out = tmp_path / "naïf"
    master = store(tmp_path / "m.exr")
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii"}
    outcome = run_for_real("observe", master, "--scene", SCENE, "--out", out, env=ascii_only)
    assert (outcome.code, outcome.err) == (0, "")
    assert r"na\xeff/m.exr" in outcome.out
    assert written(out) == ["m.exr"]


def test_a_folder_that_is_not_utf_8(run: Run, tmp_path: Path) -> None:
    out, master = tmp_path / os.fsdecode(b"\xff"), store(tmp_path / "m.exr")
    run("observe", master, "--scene", SCENE, "--out", out).is_refused("UTF-8")
    assert not out.exists()


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_ctrl_c_leaves_whole_frames(tmp_path: Path, out: Path, command: str) -> None:
    count = 599
    pattern = sequence(tmp_path / "s", range(1, count + 1))
    arguments = [command, str(pattern), "--scene", SCENE, "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "domesim", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        # Whoever runs the tests in the background makes their children ignore Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )
    deadline = time.monotonic() + 30
    while sum(not name.startswith(".") for name in written(out)) < 5:
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    names = written(out)
    assert err.splitlines() == [
        f"domesim: {len(names)} of {count} frames are done; the same command goes on with the rest",
        "domesim: interrupted; what was written is complete",
    ]
    assert process.returncode == 130
    assert 5 <= len(names) < count
    for name in names:
        assert read_frame(out / name).pixels.shape == (SIZE, SIZE, 3)


# Commands that trace paths.

TRACING = ("render", "tabulate")


def traced(command: str, out: Path, *options: object) -> tuple[object, ...]:
    """Arguments for a result in `out`."""
    name = {"render": "seen.exr", "tabulate": "table.npz"}[command]
    return (command, "dome_hemisphere", "--out", out / name, *options)


@pytest.mark.parametrize("case", [case for case in (*MASTERS, *UNSUITABLE) if case != "gap"])
def test_a_bad_master_is_not_rendered(run: Run, tmp_path: Path, out: Path, case: str) -> None:
    make, words = {**MASTERS, **UNSUITABLE}[case]
    folder = tmp_path / "in"
    folder.mkdir()
    # `render` takes one file, as it is.
    others = dict.fromkeys(("no such file", "none matches"), "there is none")
    words = tuple(others.get(word, word) for word in words)
    run(*traced("render", out, "--master", make(folder))).is_refused(*words)
    assert written(out) == []


@pytest.mark.parametrize("value", [np.nan, np.inf, -0.5])
def test_a_repaired_master_is_rendered(run: Run, tmp_path: Path, out: Path, value: float) -> None:
    master = with_sample(tmp_path / "r.exr", value)
    outcome = run(*traced("render", out, "--master", master, "--samples", 2, "--repair"))
    assert (outcome.code, outcome.err) == (0, "")
    assert "r.exr: 4 impossible samples repaired" in outcome.out
    assert written(out) == ["seen.exr", "seen.png"]


OPTIONS: list[tuple[str, list[object], tuple[str, ...]]] = [
    ("render", ["--size", 1], ("--size", "2..16384", "got 1")),
    ("render", ["--size", -5], ("--size", "got -5")),
    ("render", ["--size", 10**9], ("--size", "got 1000000000")),
    ("render", ["--error", 0], ("error", "above 0", "got 0")),
    ("render", ["--error", -0.1], ("error", "above 0", "got -0.1")),
    ("render", ["--error", "nan"], ("error", "above 0", "got nan")),
    ("render", ["--error", "inf"], ("error", "above 0", "got inf")),
    ("render", ["--samples", 0], ("--samples", "at least 2", "got 0")),
    ("render", ["--samples", -7], ("--samples", "at least 2", "got -7")),
    ("render", ["--seed", -1], ("--seed", "at least 0", "got -1")),
    ("render", ["--view", "cube"], ("'cube'", "domemaster", "cutaway")),
    ("render", ["--view", "seat:1"], ("'seat:1'", "domemaster", "cutaway", "no seats")),
    ("render", ["--view", "cutaway"], ("seen.exr", "'cutaway'", ".png")),
    ("tabulate", ["--error", 0], ("error", "above 0", "got 0")),
    ("tabulate", ["--error", -1], ("error", "above 0", "got -1")),
    ("tabulate", ["--error", "nan"], ("error", "above 0", "got nan")),
    ("tabulate", ["--walks", 0], ("--walks", "at least 1", "got 0")),
    ("tabulate", ["--walks", -1e6], ("--walks", "at least 1", "got -1e+06")),
    ("tabulate", ["--walks", "nan"], ("--walks", "at least 1", "got nan")),
    ("tabulate", ["--degree", 13], ("degree", "0..12", "got 13")),
    ("tabulate", ["--degree", -1], ("degree", "0..12", "got -1")),
    ("tabulate", ["--seed", -1], ("--seed", "at least 0", "got -1")),
    ("master", ["--size", 0], ("--size", "1 to 16384", "got 0")),
    ("master", ["--size", 10**9], ("--size", "1 to 16384", "got 1000000000")),
    ("master", ["--samples", 0], ("--samples", "1 to 65536", "got 0")),
    ("master", ["--samples", -3], ("--samples", "1 to 65536", "got -3")),
    ("master", ["--seed", -1], ("seed", "got -1")),
    ("master", ["--kind", "cube"], ("'cube'", "dome", "stereo")),
    ("master", ["--frames", "0x"], ("--frames", "got '0x'")),
    ("master", ["--frames", ""], ("--frames", "got ''")),
    ("master", ["--fps", 0], ("--fps", "above 0", "got 0")),
    ("master", ["--fps", "nan"], ("--fps", "above 0", "got nan")),
    ("master", ["--loop", -1], ("loop", "got -1")),
    ("master", ["--loop", "nan"], ("loop", "got nan")),
    ("master", ["--kind", "stereo", "--interaxial", "nan"], ("--interaxial", "got nan")),
    ("master", ["--kind", "stereo", "--convergence", "nan"], ("--convergence", "got nan")),
]


@pytest.mark.parametrize(
    ("command", "options", "words"),
    OPTIONS,
    ids=[" ".join(map(str, (command, *options))) for command, options, _ in OPTIONS],
)
def test_impossible_ways_to_trace(
    run: Run, tmp_path: Path, out: Path, command: str, options: list[object], words: tuple[str, ...]
) -> None:
    if command == "master":
        run(command, "--out", out, *options).is_refused(*words)
    else:
        master = store(tmp_path / "m.exr")
        if command == "render":
            options = ["--master", master, *options]
        run(*traced(command, out, *options)).is_refused(*words)
    assert written(out) == []


@pytest.mark.parametrize("command", TRACING)
@pytest.mark.parametrize("scene", ["dome_hemispere", "no.toml", ""])
def test_an_unknown_scene_is_not_traced(run: Run, out: Path, command: str, scene: str) -> None:
    name = "seen.exr" if command == "render" else "table.npz"
    outcome = run(command, scene, "--out", out / name)
    outcome.is_refused(scene, *scene_names())
    assert written(out) == []


@pytest.mark.parametrize("command", TRACING)
def test_a_mistake_in_a_scene_is_not_traced(
    run: Run, tmp_path: Path, out: Path, command: str
) -> None:
    scene = touched(tmp_path / "my.toml", WORKING.replace("0.45", "1.2").encode())
    name = "seen.exr" if command == "render" else "table.npz"
    run(command, scene, "--out", out / name).is_refused(str(scene), "screen.albedo", "got 1.2")
    assert written(out) == []


PLACES: dict[str, tuple[str, tuple[str, ...]]] = {
    "wrong suffix": ("seen.jpg", ("seen.jpg", "name it so")),
    "no suffix": ("seen", ("seen", "name it so")),
    "only a suffix": (".exr", (".exr", "name it so")),
    "below a file": ("m.exr/seen", ("m.exr", "wanted a folder", "Choose")),
    "a folder": ("folder", ("folder", "wanted a file", "is a directory", "Choose")),
    "unwritable": ("/proc/seen", ("/proc", "wanted a folder", "Choose")),
    "long": ("x" * 250, ("xxx", "wanted a file", "name too long", "Choose")),
    "no UTF-8": (os.fsdecode(b"\xff"), (r"\udcff", "UTF-8", "Choose")),
}


@pytest.mark.parametrize("command", TRACING)
@pytest.mark.parametrize("case", PLACES)
def test_a_result_that_cannot_be_written(run: Run, tmp_path: Path, command: str, case: str) -> None:
    """Said before any work."""
    name, words = PLACES[case]
    if not case.endswith("suffix"):
        name += ".exr" if command == "render" else ".npz"
    master = store(tmp_path / "m.exr")
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "folder.npz").mkdir()
    options = ["--master", master] if command == "render" else []
    outcome = run(command, "dome_hemisphere", "--out", tmp_path / name, *options)
    outcome.is_refused(*words)
    assert outcome.out == ""
    assert written(tmp_path) == ["folder.exr", "folder.npz", "m.exr"]


@pytest.mark.parametrize("command", TRACING)
def test_a_full_disk_after_tracing(
    run: Run, tmp_path: Path, small_disk: Path, command: str
) -> None:
    small_disk.joinpath("filler").write_bytes(bytes(52 * 1024))
    options = {
        "render": ["--master", store(tmp_path / "m.exr", picture(64, 64)), "--samples", 2],
        "tabulate": ["--walks", 1, "--degree", 2, "--no-check"],
    }
    outcome = run(*traced(command, small_disk, *options[command]))
    words = {"render": ("seen.exr", "cannot be written"), "tabulate": ("table.npz", "o space left")}
    outcome.is_refused(*words[command])
    assert written(small_disk) == ["filler"]


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
    outcome = run("render", "dome_hemisphere", "--master", path, "--out", tmp_path / out, *options)
    outcome.is_refused("the input itself", "another name")
    assert path.read_bytes() == before
    assert written(tmp_path) == sorted(["link.exr", master])


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("m.exr", ("m.exr", "file exists", "Choose")),
        ("m.exr/below", ("m.exr/below", "not a directory", "Choose")),
        ("/proc/x", ("/proc/x", "no such file", "Choose")),
    ],
)
def test_a_folder_that_films_cannot_be_written_to(
    run: Run, tmp_path: Path, place: str, words: tuple[str, ...]
) -> None:
    store(tmp_path / "m.exr")
    run("master", "--out", tmp_path / place).is_refused(*words)
    assert written(tmp_path) == ["m.exr"]


# Stored transports.


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A transport of `SCENE`, as far as one can tell."""
    scene = load_scene(SCENE)
    nodes = 9
    transport = Transport(
        scene.dome,
        modes=np.ones((1, nodes, nodes)),
        core=np.full((3, 1, 1), 0.2),
        core_error=np.full((3, 1, 1), 1e-4),
        ambient=np.zeros((3, nodes, nodes)),
        provenance={"scene": scene.name, "digest": scene.digest},
    )
    path = tmp_path_factory.mktemp("table") / "whole.npz"
    transport.save(path)
    return path


def changed(path: Path, whole: Path, at: int) -> Path:
    """A copy with one byte changed, `at` from the start (or the end)."""
    content = bytearray(whole.read_bytes())
    content[at] ^= 0x55
    path.write_bytes(content)
    return path


def restored(path: Path, whole: Path, **arrays: object) -> Path:
    """A copy with other arrays, and no checksum that says so."""
    with np.load(whole) as stored:
        np.savez_compressed(path, **{**stored, **arrays})
    return path


TABLES: dict[str, tuple[Callable[[Path, Path], Path], tuple[str, ...]]] = {
    "missing": (lambda d, _: d / "no.npz", ("no.npz", "No such file")),
    "folder": (lambda d, _: d, ("s a directory",)),
    "empty": (lambda d, _: touched(d / "e.npz", b""), ("e.npz", "transport")),
    "text": (lambda d, _: touched(d / "t.npz", b"hello" * 99), ("t.npz", "domesim tabulate")),
    "image": (lambda d, _: store(d / "i.exr"), ("i.exr", "domesim tabulate")),
    "other arrays": (
        lambda d, _: np.savez(d / "o.npz", core=np.ones(3)) or d / "o.npz",
        ("o.npz", "domesim tabulate"),
    ),
    "one array": (
        lambda d, _: np.save(d / "a.npy", np.ones(3)) or d / "a.npy",
        ("a.npy", "domesim tabulate"),
    ),
    "cut": (lambda d, w: truncated(touched(d / "c.npz", w.read_bytes())), ("c.npz", "damaged")),
    "later format": (
        lambda d, w: restored(d / "f.npz", w, format=np.array("domesim transport 2")),
        ("f.npz", "'domesim transport 1'", "got domesim transport 2"),
    ),
    "other values": (
        lambda d, w: restored(d / "v.npz", w, core=np.full((3, 1, 1), 0.4)),
        ("v.npz", "damaged", "checksum", "again"),
    ),
    "no dome": (
        lambda d, w: restored(d / "n.npz", w, dome=np.zeros(0)),
        ("n.npz", "damaged"),
    ),
}


@pytest.mark.parametrize("command", ["compensate", "observe", "compare"])
@pytest.mark.parametrize("case", TABLES)
def test_a_transport_that_is_none(
    run: Run, tmp_path: Path, out: Path, table: Path, command: str, case: str
) -> None:
    make, words = TABLES[case]
    folder = tmp_path / "in"
    folder.mkdir()
    master = store(tmp_path / "m.exr")
    target = out / "page.html" if command == "compare" else out
    outcome = run(
        command, master, "--scene", SCENE, "--transport", make(folder, table), "--out", target
    )
    outcome.is_refused(*words)
    assert written(out) == []


def test_a_transport_with_any_byte_changed(
    run: Run, tmp_path: Path, out: Path, table: Path
) -> None:
    """It is refused, or what was changed does not matter (dates, the folder of the archive)."""
    master, refused = store(tmp_path / "m.exr"), 0
    size = table.stat().st_size
    for at in range(0, size, size // 40):
        damaged = changed(tmp_path / "d.npz", table, at)
        outcome = run("observe", master, "--scene", SCENE, "--transport", damaged, "--out", out)
        if outcome.code:
            outcome.is_refused("d.npz")
            refused += 1
    assert refused > 20


def test_the_transport_above_works_undamaged(
    run: Run, tmp_path: Path, out: Path, table: Path
) -> None:
    master = store(tmp_path / "m.exr")
    outcome = run("observe", master, "--scene", SCENE, "--transport", table, "--out", out)
    assert (outcome.code, outcome.err) == (0, "")
    assert written(out) == ["m.exr"]


def test_the_transport_of_another_scene(run: Run, tmp_path: Path, out: Path, table: Path) -> None:
    master = store(tmp_path / "m.exr")
    outcome = run("observe", master, "--scene", "dome_dark", "--transport", table, "--out", out)
    outcome.is_refused(str(table), f"'{load_scene(SCENE).name}'", "domesim tabulate dome_dark")
    assert written(out) == []
