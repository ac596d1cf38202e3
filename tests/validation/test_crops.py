"""Crops: where pictures look, and how bright they show it."""

from __future__ import annotations

import numpy as np
import pytest

from compensate.pose import pose
from compensate.weighting import PerceptualWeighting
from domesim.scene import load_scene
from validation.crops import Crop, caption

GHOST = (slice(20, 28), slice(50, 58))


def pair(grey: float) -> np.ndarray:
    """What the left eye cannot be spared: a square of the right eye's, where its own is black."""
    light = np.full((2, 36, 64, 3), grey, np.float32)
    light[0, :12] = 1.0
    light[:, *GHOST] = [[[[0.0]]], [[[1.0]]]]
    light[1, :12, :8] = 1.0  # over what the left eye sees lit: subtracted
    return light


def crop_of(light, scene="stereo_polarised_paper") -> Crop:
    return Crop(pose(light, load_scene(scene), PerceptualWeighting()))


def test_a_pair_is_cropped_to_the_ghost_that_is_left():
    rows, cols = crop_of(pair(0.0)).window
    assert (rows.stop - rows.start, cols.stop - cols.start) == (18, 18)
    assert rows.start <= GHOST[0].start < GHOST[0].stop <= rows.stop
    assert cols.start <= GHOST[1].start < GHOST[1].stop <= cols.stop


@pytest.mark.parametrize(("grey", "brighter"), [(0.0, 10), (0.12, 5), (0.3, 2), (0.6, 1)])
def test_a_crop_is_as_bright_as_can_be_seen(grey, brighter):
    assert crop_of(pair(grey)).brighter == brighter


def test_a_domemaster_is_shown_whole():
    light = np.full((1, 16, 16, 3), 0.01, np.float32)
    crop = crop_of(light, "dome_hemisphere")
    assert crop.window == (slice(16), slice(16))
    assert crop.panel("seen", light).alt == "Domemaster: seen"
    assert "whole domemaster. Shown 10 times" in caption("night", crop.brighter, views=1)


def test_a_panel_is_of_the_left_eye_and_as_bright_as_its_crop():
    crop = crop_of(pair(0.0))
    panel, brighter = crop.master
    light = pair(0.0)
    light[1] = 1.0
    assert panel.alt == "Left eye, dark crop: master"
    assert crop.panel("master", light) == panel
    assert crop.panel("master", light * 2, brighter=brighter / 2) == panel
