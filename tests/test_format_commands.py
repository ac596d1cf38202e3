"""Formats through the command line: what is computed of them, and what is said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from image_files import store

from domesim.frames import read_frame

DOME = "dome_hemisphere"
SIDE = 40


def picture(kind: str) -> np.ndarray:
    """(row, col, channel) of light or codes."""
    light = np.random.default_rng(0).random((SIDE, SIDE, 3))
    return (light * (np.iinfo(kind).max if "int" in kind else 1)).astype(kind)


# What is said.


def test_what_was_read_is_said_once_and_where_it_changes(
    run: Run, tmp_path: Path, out: Path
) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    for number in (1, 2, 3):
        kind = "float16" if number < 3 else "float32"
        store(folder / f"show.{number}.exr", picture(kind))
    arguments = (folder / "show.#.exr", "--scene", DOME, "--method", "none", "--out", out)
    arguments += ("--workers", "0")
    told = [line for line in run("compensate", *arguments).out.splitlines() if " x " in line]
    assert told == [
        "show.1.exr: 40 x 40 EXR, 16 bit float, linear (assumed for EXR)",
        "show.3.exr: 40 x 40 EXR, 32 bit float, linear (assumed for EXR)",
    ]
    figures = json.loads(run("compensate", *arguments, "--json").out)["frames"]
    assert [frame["read"] for frame in figures] == [
        "40 x 40 EXR, 16 bit float, linear (assumed for EXR)",
        "40 x 40 EXR, 16 bit float, linear (assumed for EXR)",
        "40 x 40 EXR, 32 bit float, linear (assumed for EXR)",
    ]
    expected = {"transfer": "linear", "primaries": "BT.709", "source": "assumed for EXR"}
    assert all(frame["encoding"] == expected for frame in figures)


@pytest.mark.parametrize("command", ["compensate", "compare", "predict", "observe"])
def test_each_command_takes_an_encoding_and_says_it(
    run: Run, tmp_path: Path, out: Path, command: str
) -> None:
    source = store(tmp_path / "in.png", picture("uint16"))
    target = out / "page.html" if command == "compare" else out
    arguments = (command, source, "--scene", DOME, "--out", target)
    said = "in.png: 40 x 40 PNG, 16 bit, gamma 2.6 P3-D65 (--encoding p3-d65)"
    assert said in run(*arguments, "--encoding", "P3-D65").out.splitlines()
    figures = json.loads(run(*arguments, "--encoding", "p3-d65", "--json").out)
    frame = figures if command == "compare" else figures["frames"][0]
    assert f"in.png: {frame['read']}" == said
    expected = {"transfer": "gamma2.6", "primaries": "P3-D65", "source": "--encoding p3-d65"}
    assert frame["encoding"] == expected


# What was computed.


def gradient(path: Path) -> Path:
    """Float EXR of a few codes of 8 bits over its width; light that subtraction reaches."""
    row, col = np.mgrid[:256, :256] / 256
    return store(path, np.stack([0.4 + 0.02 * col + 0.001 * row] * 3, -1).astype(np.float32))


def error_of_bands(result: Path, wanted: Path) -> float:
    """Largest mean error over 16 x 16 px within the dome, in codes."""
    codes = read_frame(result).pixels[..., 1].astype(float) * 255
    exact = read_frame(wanted).pixels[..., 1].astype(float) * 255
    error = (codes - exact)[64:192, 64:192].reshape(8, 16, 8, 16).mean(axis=(1, 3))
    return float(np.abs(error).max())


@pytest.mark.parametrize("command", ["compensate", "observe"])
def test_what_was_computed_has_no_bands(run: Run, tmp_path: Path, out: Path, command: str) -> None:
    source = gradient(tmp_path / "show.0042.exr")
    common = (command, source, "--scene", DOME)
    common += ("--method", "subtractive")[: 2 if command == "compensate" else 0]
    to_png = ("--format", "png", "--bits", "8")
    assert run(*common, "--out", out / "float").code == 0
    for name, how in (
        ("tpdf", ()),
        ("again", ("--dither", "tpdf")),
        ("none", ("--dither", "none")),
    ):
        assert run(*common, *to_png, *how, "--out", out / name).code == 0
    exact = out / "float" / "show.0042.exr"
    errors = {
        name: error_of_bands(out / name / "show.0042.png", exact) for name in ("tpdf", "none")
    }
    assert errors["none"] > 0.3
    assert errors["tpdf"] < 5 * 0.5 / 16
    same = [(out / name / "show.0042.png").read_bytes() for name in ("tpdf", "again")]
    assert same[0] == same[1]
    # Off the screen nothing was computed.
    for name in ("tpdf", "none"):
        corner = read_frame(out / name / "show.0042.png").pixels[:20, :20, 1] * 255
        wanted = read_frame(source).pixels[:20, :20, 1] * 255
        assert np.abs(corner - wanted).max() <= (0.51 if name == "none" else 1.51)
