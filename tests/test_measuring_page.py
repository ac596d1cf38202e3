"""docs/measuring.md: its commands say what stands there, its pictures are what is written."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import exit_code
from made_up_domes import THEATRE, store_survey
from made_up_photographs import made_up
from told_numbers import assert_same_but_for_last_digits

from domesim.frames import read_frame
from testing.surveys import theatre_file

FOLDER = Path(__file__).parents[1] / "docs"
PAGE = (FOLDER / "measuring.md").read_text()
SMALLER = {"4096": "64", "2048x1080": "96x64"}
"""Sizes of the page's patterns, and those of a test."""
PROJECTED = (*range(6), 6, 8, 10, *range(12, 17))
"""Black, white, halves, every second sector, rings and boards."""


def commands():
    """What is typed, and what is said."""
    for block in re.findall(r"^```\n(\$ .*?)^```", PAGE, re.MULTILINE | re.DOTALL):
        command, _, said = block.partition("\n")
        slow = [pytest.mark.long] if command.endswith("measured.toml") else []
        yield pytest.param(command[2:], said, id=" ".join(command.split()[2:5]), marks=slow)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("page")
    for name in ("readings.csv", "pair.csv"):
        shutil.copy(FOLDER / "measuring" / name, path)
    rows = (path / "readings.csv").read_text().splitlines()
    *first, x, y, z = rows[16].split(",")
    rows[16] = ",".join([*first, *(f"{float(each) / 3.426:.4f}" for each in (x, y, z))])
    (path / "wrong.csv").write_text("\n".join(rows))
    toml = next(
        each for each in re.findall(r"^```toml\n(.*?)^```", PAGE, re.M | re.S) if "corners" in each
    )
    made_up(path, toml)
    store_survey(path, theatre_file(THEATRE.dome), PROJECTED)
    return path


@pytest.mark.parametrize(("command", "said"), list(commands()))
def test_commands_say_what_the_page_says(folder, command, said, monkeypatch, run):
    arguments = [SMALLER.get(word, word) for word in shlex.split(command)]
    monkeypatch.chdir(folder)
    _, out, err = run(*arguments[1:])
    told = (out + err).replace("64 x 64", "4096 x 4096").replace("96 x 64", "2048 x 1080")
    assert_same_but_for_last_digits(told, said)


@pytest.mark.parametrize(("kind", "size"), [("dome", "160"), ("stereo", "160x84")])
def test_pictures_are_what_the_program_writes(tmp_path, kind, size):
    options = ("--size", size, "--out", tmp_path, "--quiet")
    assert not exit_code("measure", "patterns", f"--{kind}", *options)
    kept = sorted((FOLDER / "measuring").glob(f"{kind}-*.png"))
    assert len(kept) >= 3
    for picture in kept:
        name = picture.stem.removeprefix(f"{kind}-")
        side = next((side for side in ("left", "right") if name.endswith(f"-{side}")), "left")
        name = name.removesuffix(f"-{side}") if kind == "stereo" else name
        (file,) = (tmp_path / side if kind == "stereo" else tmp_path).glob(f"*_{name}.png")
        assert np.array_equal(read_frame(file).pixels, read_frame(picture).pixels), name
        assert f"measuring/{picture.name}" in PAGE


def test_the_pictures_are_small():
    assert sum(path.stat().st_size for path in (FOLDER / "measuring").iterdir()) < 300_000
