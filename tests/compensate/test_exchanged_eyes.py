"""Exchanged eyes are told by what one eye alone sees, before the first frame is done."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import Run

from compensate.shows.eyes import exchanged, told, votes
from compensate.vision.binocular.exchanged import Votes
from domesim.frames import ColourTag, Frame, write_frame
from domesim.scene import load_scene
from domesim.shows.show import find_show
from testing.content.stereo import PAIRS

pytest.importorskip("cv2")

SCENE = load_scene("stereo_spectral")


@pytest.fixture(scope="module")
def street() -> np.ndarray:
    return np.asarray(PAIRS["night street"](512), np.float32)


def sequence(folder: Path, light: np.ndarray) -> tuple[str, str]:
    colour = ColourTag("srgb", "BT.709", "test")
    patterns = []
    for eye, view in zip("LR", light, strict=True):
        for number in (1, 2):
            path = folder / f"{eye}.{number:04}.png"
            write_frame(Frame(np.clip(view, 0, 1) ** (1 / 2.2), path, colour, 16, False), path)
        patterns.append(str(folder / f"{eye}.####.png"))
    return patterns[0], patterns[1]


def test_a_street_says_which_eye_is_which(street) -> None:
    right, wrong = votes(street, SCENE), votes(street[::-1], SCENE)
    assert right.count > 100
    assert right.behind > 0.55 * right.count
    assert wrong.behind < 0.45 * wrong.count


def test_few_strips_say_nothing() -> None:
    assert told(Votes(20, 100)) is None
    assert told(Votes(90, 200)) is None
    assert "of 200 strips that one eye alone sees, 40% look" in (told(Votes(80, 200)) or "")
    assert told(Votes(30, 100) + Votes(30, 100)) is not None


def test_flat_pictures_say_nothing() -> None:
    flat = np.repeat(np.random.default_rng(1).random((1, 60, 100, 3), np.float32), 2, 0)
    assert votes(flat, SCENE).count == 0
    assert votes(flat[:, :, :20], SCENE).count == 0


def test_a_show_is_asked_for_its_eyes(run: Run, street, tmp_path: Path) -> None:
    left, right = sequence(tmp_path, street)
    assert exchanged(find_show(None, left, right), SCENE, repair=False) is None
    swapped = exchanged(find_show(None, right, left), SCENE, repair=False)
    assert swapped is not None
    assert "may be exchanged" in swapped
    arguments = ("--scene", "stereo_spectral", "--method", "none", "--workers", 0, "--out")
    asked = run("compensate", "--left", right, "--right", left, *arguments, tmp_path / "a")
    assert "left and right may be exchanged" in asked.out
    fine = run("compensate", "--left", left, "--right", right, *arguments, tmp_path / "b")
    assert "exchanged" not in fine.out
