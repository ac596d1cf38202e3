"""Damaged and huge inputs that are no pictures: read or refused in a line, at a bounded cost."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import Outcome
from damaged_inputs import MEMORY, READERS, Cost, cost, costs, sound_inputs

from domesim.frames import ColourTag, Frame, write_frame
from validation.audience.files import read_study
from validation.audience.rehearsal import attentive


@pytest.fixture
def folder(run: Callable[..., Outcome], tmp_path: Path) -> Path:
    """Sound inputs of each kind."""
    colour = ColourTag("srgb", "BT.709", "test")
    for eye, at in (("L", 3), ("R", 7)):
        pixels = np.full((12, 20, 3), 0.1, np.float32)
        pixels[:, at : at + 4] = 0.8
        path = tmp_path / f"{eye}.png"
        write_frame(Frame(pixels, path, colour, 8, floating=False), path)
    eyes = ("--left", tmp_path / "L.png", "--right", tmp_path / "R.png")
    more = ("--methods", "none,subtractive", "--side-by-side", "--viewers", 3)
    out = tmp_path / "study"
    scene = ("--scene", "stereo_polarised_paper")
    assert run("study", "new", *eyes, *scene, "--out", out, *more).code == 0
    study = read_study(out)
    for viewer in (1, 2):
        given = attentive(study, viewer, [0, 1], np.random.default_rng(viewer))
        (out / f"answers/viewer-{viewer:03}.json").write_text(given.model_dump_json())
    sound_inputs(tmp_path)
    return tmp_path


def require_cheap(found: list[Cost]) -> None:
    wrong = [each for each in found if each.found.startswith("WRONG") or each.mebibytes > MEMORY]
    assert wrong == []


def test_sound_inputs_are_read_and_a_few_damaged_ones_are_cheap(folder: Path) -> None:
    require_cheap(found := costs(folder, 0, 40))
    assert any(each.found.startswith("refused") for each in found)
    for kind in READERS:
        if kind != "survey.toml":  # whose photographs are not there
            assert cost(kind, kind, folder / kind).found == "read"


@pytest.mark.long
def test_damaged_inputs_are_cheap(folder: Path) -> None:
    require_cheap(found := costs(folder, 40, 140))
    assert len(found) == 100


@pytest.mark.long
def test_huge_inputs_are_cheap(folder: Path) -> None:
    require_cheap(found := costs(folder, 0, 0))
    assert len(found) > 50
