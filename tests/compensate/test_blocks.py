"""Local means in O(n) are what a loop over all pixels finds."""

from __future__ import annotations

import array_api_compat
import array_api_strict
import numpy as np
import pytest
from scipy.signal import convolve2d

from compensate.blocks import falling, guided, near_sum, smooth
from domesim.light.blocks import block_sums, enlarged

RNG = np.random.default_rng(4)
PICTURE = RNG.random((5, 7))


def edge_preserving(plane, screen, radius, edge, importance=None, *, block=1):
    """The edge-preserving mean of a plane, by its coefficients."""
    xp = array_api_compat.array_namespace(plane)
    on = xp.astype(screen, plane.dtype)
    weights = on if importance is None else on * importance
    weighted = weights * plane
    sums = [block_sums(each, block) for each in (on, weights, weighted, weighted * plane)]
    slope, offset = guided(*sums, radius, edge)
    slope, offset = (
        enlarged(each, block, slice(0, plane.shape[0]), plane.shape[1]) for each in (slope, offset)
    )
    return slope * plane + offset


@pytest.mark.parametrize("radius", [1, 2, 9])
def test_a_sum_weighs_what_lies_in_the_picture(radius):
    line = (*reversed(falling(radius)), *falling(radius)[1:])
    whole = convolve2d(PICTURE, np.outer(line, line))
    expected = whole[radius : radius + 5, radius : radius + 7]
    np.testing.assert_allclose(near_sum(PICTURE, radius), expected, rtol=1e-12)


def test_single_precision_keeps_what_is_dark_beside_what_is_bright():
    dark = np.full((3, 4000), 1e-6, np.float32)
    dark[:, :2000] = 1.0
    assert near_sum(dark, 1)[1, 3000] == pytest.approx(4e-6, rel=1e-3)


@pytest.mark.parametrize("sigma", [1.25, 2.0, 6.0])
def test_three_boxes_have_the_variance_of_a_gaussian(sigma):
    impulse = np.zeros((101, 101))
    impulse[50, 50] = 1
    row = smooth(impulse, sigma).sum(axis=0)
    place = np.arange(101) - 50
    assert row.sum() == pytest.approx(1)
    assert np.sqrt(row @ place**2) == pytest.approx(sigma, rel=0.1)


def test_a_guided_mean_smooths_texture_and_keeps_an_edge():
    everywhere = np.ones((60, 60), bool)
    step = np.where(np.arange(60) < 30, 0.0, 10.0) * np.ones((60, 1))
    noise = 0.2 * RNG.standard_normal((60, 60))
    found = edge_preserving(step + noise, everywhere, 6, 1.0)
    flat = found[10:50, 4:14]
    assert flat.std() < 0.3 * noise.std()
    assert np.abs(found - step)[:, 25:35].max() < 1.5  # a plain mean is off by 5 there
    np.testing.assert_allclose(edge_preserving(0 * step + 3, everywhere, 6, 1.0), 3)


def test_what_is_off_the_screen_does_not_count():
    screen = np.ones((9, 9), bool)
    screen[:, 6:] = False
    plane = RNG.random((9, 9))
    other = np.where(screen, plane, 1e3)
    found = edge_preserving(other, screen, 2, 0.5)[:, :4]
    np.testing.assert_allclose(found, edge_preserving(plane * screen, screen, 2, 0.5)[:, :4])


@pytest.mark.parametrize("edge", [0.3, 2.0])
def test_texture_as_strong_as_an_edge_keeps_half_of_it(edge):
    board = edge * (-1.0) ** np.indices((32, 32)).sum(0)
    found = edge_preserving(board, np.ones((32, 32), bool), 6, edge)
    np.testing.assert_allclose(found, board / 2, atol=0.03 * edge)


def test_a_guided_mean_of_blocks_is_nearly_that_of_pixels():
    rows, cols = np.mgrid[:96, :96]
    screen = np.hypot(rows - 48, cols - 48) < 46
    picture = np.where(cols < 41, 0.0, 4.0) + 0.5 * np.sin(rows / 3)
    plain, fast = (
        edge_preserving(picture, screen, 10 // block - 1, 1.0, np.exp(-picture), block=block)
        for block in (1, 2)
    )
    apart = np.abs(plain - fast)[screen]
    assert 0 < apart.mean() < 0.03
    assert apart.max() < 0.3  # of a step of 4


def test_any_array_library():
    there = array_api_strict.asarray(PICTURE)
    on = array_api_strict.asarray(np.ones((5, 7), bool))
    for found, expected in (
        (smooth(there, 1.0), smooth(PICTURE, 1.0)),
        (
            edge_preserving(there, on, 1, 0.3),
            edge_preserving(PICTURE, np.ones((5, 7), bool), 1, 0.3),
        ),
        (
            edge_preserving(there, on, 1, 0.3, block=2),
            edge_preserving(PICTURE, np.ones((5, 7), bool), 1, 0.3, block=2),
        ),
    ):
        np.testing.assert_allclose(np.asarray(found), expected, rtol=1e-12)
