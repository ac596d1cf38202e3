"""Plain figures of made-up pictures whose figures are known."""

from __future__ import annotations

import numpy as np
import pytest

from domesim.scene import load_scene
from validation import seen

DOME = load_scene("dome_imax")
PAIR = load_scene("stereo_cinema_silver")
SIZE = 180  # a pixel a degree
SCREEN = DOME.screen(SIZE, SIZE)
RANDOM = np.random.default_rng(5)


def grey(*planes):
    return np.repeat(np.stack(planes)[..., None], 3, axis=-1).astype(np.float64)


def coloured(shape=(2, 40, 60)):
    return RANDOM.uniform(0.02, 0.9, (*shape, 3))


def test_light_kept_is_the_ratio_where_it_is_asked_for():
    master = coloured()
    left, right = np.zeros((2, 40, 60), bool), np.zeros((2, 40, 60), bool)
    left[0, :, :50], right[1] = True, True
    kept = master * np.array([0.5, 3.0])[:, None, None, None]
    kept[0, :, 50:] = 7  # not asked for
    for where, ratio in ((left, 0.5), (right, 3.0)):
        found = seen.light_kept(master, kept, where, PAIR)
        assert (found.median, found.fifth) == pytest.approx((ratio, ratio))


def test_light_kept_has_a_median_and_a_fifth_percentile():
    master, ratio = np.full((2, 40, 60, 3), 0.2), np.linspace(0, 1, 2400).reshape(1, 40, 60, 1)
    found = seen.light_kept(master, master * ratio, np.ones((40, 60), bool), PAIR)
    assert (found.median, found.fifth) == pytest.approx((0.5, 0.05), abs=1e-3)


def test_black_keeps_no_light_and_the_corners_do_not_count():
    master = grey(np.where(SCREEN, 0.1, 0.3))
    veiled = grey(np.where(SCREEN, 0.2, 0.3))
    everywhere = np.ones((SIZE, SIZE), bool)
    assert seen.light_kept(master, veiled, everywhere, DOME).median == pytest.approx(2)
    assert seen.light_kept(0 * master, veiled, everywhere, DOME) is None
    assert seen.light_kept(master, veiled, ~SCREEN, DOME) is None


@pytest.mark.parametrize(("distance", "expected"), [(0.009, 0.0), (0.011, 0.25)])
def test_chroma_shift_is_a_share_of_the_pixels_asked_for(distance, expected):
    """A quarter is shifted by that distance in u', the rest not at all."""
    to_xyz = PAIR.projector.to_xyz
    u, v = 0.2 + np.zeros((2, 40, 60)), np.full((2, 40, 60), 0.47)

    def light(u):
        xyz = np.stack([9 * u / (4 * v), np.ones_like(u), (12 - 3 * u - 20 * v) / (4 * v)], -1)
        return 0.1 * xyz @ np.linalg.inv(to_xyz).T

    shifted = u.copy()
    shifted[0, :10] += distance
    where = np.zeros((2, 40, 60), bool)
    where[0] = True
    assert seen.chroma_shift(light(u), 2 * light(shifted), where, PAIR) == expected
    moved = seen.chromaticity(light(shifted) @ to_xyz.T) - seen.chromaticity(light(u) @ to_xyz.T)
    assert np.abs(moved).max() == pytest.approx(distance)
    assert seen.chroma_shift(0 * light(u), light(u), where, PAIR) is None


def turned(light, degrees, saturation):
    """The same luminance, its (R - Y, B - Y) turned and scaled; G follows from them."""
    weights = PAIR.projector.luminance_weights
    y = light @ weights
    opponent = (light[..., 0] - y + 1j * (light[..., 2] - y)) * saturation
    opponent = opponent * np.exp(1j * np.deg2rad(degrees))
    red, blue = y + opponent.real, y + opponent.imag
    green = (y - weights[0] * red - weights[2] * blue) / weights[1]
    return np.stack([red, green, blue], axis=-1)


@pytest.mark.parametrize(("degrees", "saturation"), [(0, 1), (25, 0.6), (-170, 1.5)])
def test_hue_and_saturation_are_those_that_were_made(degrees, saturation):
    master = coloured()
    found = seen.saturation_and_hue(master, turned(master, degrees, saturation), PAIR)
    assert found.hue_shift == pytest.approx(abs(degrees), abs=1e-6)
    assert found.saturation == pytest.approx(saturation)


def test_only_the_darker_half_has_its_hue_judged():
    master = coloured()
    y = master @ PAIR.projector.luminance_weights
    bright = y >= np.median(y, axis=(1, 2), keepdims=True)
    shown = np.where(bright[..., None], turned(master, 120, 3), turned(master, 10, 0.9))
    found = seen.saturation_and_hue(master, shown, PAIR)
    assert found.hue_shift == pytest.approx(10)
    assert found.saturation == pytest.approx(0.9)


def test_grey_has_no_hue():
    plane = RANDOM.uniform(0.1, 1, (2, 40, 60))
    assert seen.saturation_and_hue(grey(*plane).astype(np.float32), coloured(), PAIR) is None


def test_black_level_is_the_first_percentile_on_the_screen():
    plane = np.zeros((SIZE, SIZE))
    plane[SCREEN] = RANDOM.permutation(np.linspace(0.1, 1.1, SCREEN.sum()))
    found = seen.black_level(grey(plane), DOME)
    assert found == pytest.approx(0.11 * DOME.projector.white, rel=1e-3)
