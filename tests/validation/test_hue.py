"""Shift of hue in the dark."""

from __future__ import annotations

import numpy as np
import pytest

from domesim.scene import load_scene
from validation.hue import shift_in_the_dark

SCENE = load_scene("dome_hemisphere")
SIZE = 32


def coloured(luminance, angle, distance=0.02):
    """(1, row, col, primary) light of a hue: so far from white in u'v', at that angle."""
    x, y, z = SCENE.projector.to_xyz @ np.ones(3)
    turn = np.deg2rad(angle) * np.ones(luminance.shape)
    u = 4 * x / (x + 15 * y + 3 * z) + distance * np.cos(turn)
    v = 9 * y / (x + 15 * y + 3 * z) + distance * np.sin(turn)
    xyz = np.stack([9 * u / (4 * v), np.ones_like(u), (12 - 3 * u - 20 * v) / (4 * v)], axis=-1)
    return (luminance[..., None] * xyz @ np.linalg.inv(SCENE.projector.to_xyz).T)[None]


@pytest.fixture
def luminance():
    return np.random.default_rng(3).uniform(0.001, 0.1, (SIZE, SIZE))


@pytest.mark.parametrize("shift", [-170.0, -20.0, 0.0, 35.0])
def test_it_is_the_angle_that_the_hue_was_turned_by(luminance, shift):
    wanted, seen = coloured(luminance, 200.0), coloured(3 * luminance, 200.0 + shift, 0.01)
    assert shift_in_the_dark(wanted, seen, SCENE) == pytest.approx(abs(shift), abs=1e-6)


def test_only_the_darker_half_counts(luminance):
    wanted = coloured(luminance, 30.0)
    middle = np.median(luminance[SCENE.screen(SIZE, SIZE)])
    seen = coloured(luminance, np.where(luminance < middle, 40.0, 150.0))
    assert shift_in_the_dark(wanted, seen, SCENE) == pytest.approx(10, abs=1e-6)


def test_black_has_no_hue(luminance):
    wanted = coloured(np.where(luminance < 0.03, 5e-5, luminance), 30.0)
    seen = coloured(np.where(luminance < 0.03, 5e-5, luminance), np.where(luminance < 0.03, 90, 31))
    assert shift_in_the_dark(wanted, seen, SCENE) == pytest.approx(1, abs=1e-6)
    assert shift_in_the_dark(0 * wanted, seen, SCENE) is None
