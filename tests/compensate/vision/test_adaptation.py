"""The mean over a degree: what is counted, what is not, and on which grid."""

from __future__ import annotations

import numpy as np
import pytest

from compensate.vision.adaptation import adaptation_luminance
from domesim.errors import InputError


def picture(views, rows, cols, seed=0):
    return np.random.default_rng(seed).uniform(0.01, 20, (views, rows, cols))


def disc_screen(rows, cols):
    down, across = np.mgrid[:rows, :cols]
    return np.hypot((down - rows / 2.3) / rows, (across - cols / 2) / cols) < 0.4


def directly(plane, screen, across):
    """Pixel by pixel: weights 1 inside the disc, 0 outside, half a pixel of soft rim each way."""
    down, along = np.mgrid[: plane.shape[0], : plane.shape[1]]
    means = np.zeros(plane.shape)
    for row, col in zip(*np.nonzero(screen), strict=True):
        reach = across / 2 + 0.5 - np.hypot(down - row, along - col)
        weight = np.clip(reach, 0, 1) * screen
        means[row, col] = (weight * plane).sum() / weight.sum()
    return means


@pytest.mark.parametrize("across", [0.6, 3.0, 7.4, 15.0])
@pytest.mark.parametrize("masked", [False, True])
def test_the_mean_over_the_disc(across, masked):
    light = picture(2, 23, 37)
    screen = disc_screen(23, 37) if masked else np.ones((23, 37), bool)
    found = adaptation_luminance(light, across, screen)
    for view in range(2):
        # blocks are averaged only from 16 pixels across on, so this differs by rounding alone
        expected = directly(light[view], screen, across)
        assert found[view] == pytest.approx(expected, rel=1e-4, abs=2e-5)


@pytest.mark.parametrize("across", [0.1, 5.0, 16.0, 43.0, 500.0])
@pytest.mark.parametrize("masked", [False, True])
def test_constant_in_constant_out(across, masked):
    screen = disc_screen(61, 83) if masked else np.ones((61, 83), bool)
    found = adaptation_luminance(np.full((1, 61, 83), 3.7), across, screen)
    assert found[0][screen] == pytest.approx(np.full(screen.sum(), 3.7), rel=1e-4)
    assert (found[0][~screen] == 0).all()


def test_the_reduced_grid_agrees_with_the_fine_one():
    rows, cols = 90, 140
    down, across = np.mgrid[:rows, :cols]
    light = 5 + 4 * np.sin(down / 23) * np.cos(across / 31)
    light[30:60, 50:70] += 10
    screen = disc_screen(rows, cols)
    truth = directly(light, screen, 24.0)
    found = adaptation_luminance(light[None], 24.0, screen)[0]  # blocks of 3 pixels
    error = (found - truth)[screen] / truth[screen]
    assert np.percentile(np.abs(error), 99) < 0.06
    assert np.abs(error).max() < 0.2  # beside the bright block's edge, which blocks blur
    assert found[screen].mean() == pytest.approx(truth[screen].mean(), rel=1e-3)


@pytest.mark.parametrize("across", [9.0, 40.0])
def test_beyond_the_disc_nothing_counts(across):
    light = np.ones((1, 60, 150))
    light[..., 75:] = 9.0
    found = adaptation_luminance(light, across)
    assert found[..., : 75 - 25] == pytest.approx(1, rel=1e-3)
    assert found[..., 75 + 25 :] == pytest.approx(9, rel=1e-3)
    assert found[0, 30, 75] == pytest.approx(5, rel=0.12)


def test_it_is_a_disc_and_the_diameter_is_in_degrees():
    light = np.zeros((1, 31, 31))
    light[0, 15, 15] = 1
    found = adaptation_luminance(light, 5.0, diameter=2.0)[0] > 1e-4
    assert found[15, 20]  # 5 pixels away: within the radius of 1 degree
    assert not found[15, 21]
    assert not found[19, 19]  # 5.7 pixels away, though within the square
    assert (found == found.T).all()


def test_off_the_screen_is_not_looked_at():
    screen = disc_screen(40, 64)
    light = picture(1, 40, 64)
    other = np.where(screen, light, np.nan)
    for across in (6.0, 30.0):
        expected = adaptation_luminance(light, across, screen)
        assert (adaptation_luminance(other, across, screen) == expected).all()
        assert (expected[0] > 0).tolist() == screen.tolist()


def test_views_do_not_mix():
    light = picture(2, 30, 44)
    light[1] *= 100
    for across in (5.0, 20.0):
        found = adaptation_luminance(light, across)
        alone = np.stack([adaptation_luminance(v[None], across)[0] for v in light])
        assert found == pytest.approx(alone, rel=1e-4)


def test_never_below_black():
    light = np.zeros((1, 64, 100), np.float32)
    light[0, 7, 9] = 1e6
    for across in (5.0, 30.0):
        found = adaptation_luminance(light, across)
        assert found.dtype == np.float32
        assert (found >= 0).all()
        assert found[0, 60, 90] < 1e-2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pixels_per_degree": 0.0}, "pixels per degree above 0"),
        ({"diameter": np.nan}, "diameter above 0"),
        ({"screen": np.ones((5, 4), bool)}, r"screen of \(4, 5\) pixels, got \(5, 4\)"),
    ],
)
def test_bad_input(change, message):
    good = {"luminance": np.ones((1, 4, 5)), "pixels_per_degree": 3.0}
    with pytest.raises(InputError, match=message):
        adaptation_luminance(**{**good, **change})
