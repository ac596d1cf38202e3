"""Exchanged eyes are told by what one eye alone sees, before the first frame is done."""

from __future__ import annotations

import numpy as np
import pytest

from compensate.shows.eyes import told, votes
from compensate.vision.binocular.exchanged import Votes
from domesim.scene import load_scene
from testing.content.stage import HIGH, Painter, Stage
from testing.content.stereo import PAIRS
from testing.content.texture import noise, tinted

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


def leaves(seed: int, width: int = 512) -> np.ndarray:
    """Dead leaves: boards and discs at random depths, nearer ones before those farther away."""
    random, stage = np.random.default_rng(seed), Stage(width)

    def leaf(key: int, at: tuple[float, float], size: float) -> Painter:
        grey, rough, fine = random.uniform((0.01, 0.1, 0.5), (0.5, 0.6, 5.0))
        colour = tuple(random.uniform(0.4, 1, 3))
        flat = random.random() < 0.4

        def painter(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            u, v = np.abs(x - at[0]), np.abs(y - at[1])
            inside = (u < size) & (v < 0.6 * size) if flat else u * u + v * v < size * size
            grain = 1 + rough * noise(100 * seed + key, fine * x, fine * y, 1.4)
            return tinted(grey * np.clip(grain, 0.05, None), colour), inside.astype(np.float32)

        return painter

    stage.put(-0.033, leaf(99, (0.5, 0.28), 9.0))
    for key, depth in enumerate(np.sort(random.uniform(-0.03, 0.05, random.integers(12, 40)))):
        place = (random.uniform(0, 1), random.uniform(0, HIGH))
        size = np.clip(0.015 + 0.02 * random.pareto(1.6), 0, 0.2)
        stage.put(float(depth), leaf(key, place, float(size)))
    return stage.light()


@pytest.mark.long
def test_no_scene_of_leaves_is_doubted_and_most_are_when_exchanged() -> None:
    counted = [votes(leaves(seed), SCENE) for seed in range(100, 112)]
    speak = [each for each in counted if each.enough]
    assert len(speak) >= 4
    assert not any(each.exchanged for each in counted)
    # Exchanged, each strip votes for the other side
    found = sum(Votes(each.count - each.behind, each.count).exchanged for each in speak)
    assert found >= 0.75 * len(speak)
    same = votes(leaves(100)[::-1], SCENE)
    assert (same.behind, same.count) == (counted[0].count - counted[0].behind, counted[0].count)
