"""Exchanged eyes are told by what one eye alone sees, before the first frame is done."""

from __future__ import annotations

import numpy as np
import pytest

from compensate.shows.eyes import told, votes
from compensate.vision.binocular.exchanged import Votes
from domesim.scene import load_scene
from testing.content.stereo import PAIRS

pytest.importorskip("cv2")

SCENE = load_scene("stereo_spectral")


@pytest.fixture(scope="module")
def street() -> np.ndarray:
    return np.asarray(PAIRS["night street"](512), np.float32)


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
