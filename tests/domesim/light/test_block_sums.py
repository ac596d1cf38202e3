"""Sums, means and values between blocks are what a loop over all pixels finds."""

from __future__ import annotations

import array_api_strict
import numpy as np
import pytest

from domesim.light.blocks import block_sums, enlarged, light_means, light_sums

RNG = np.random.default_rng(4)
PICTURE = RNG.random((5, 7))


def test_the_last_block_is_cut_off():
    sums = block_sums(PICTURE, 3)
    assert sums.shape == (2, 3)
    assert sums[1, 2] == pytest.approx(PICTURE[3:, 6:].sum())
    assert sums.sum() == pytest.approx(PICTURE.sum())


def test_means_are_of_pixels_on_the_screen(monkeypatch):
    monkeypatch.setattr("domesim.light.strips.SAMPLES", 4)  # strips of one row of blocks
    light, screen = RNG.random((2, 5, 7, 3)), RNG.random((5, 7)) < 0.5
    screen[3:, 6:] = False
    light[:, ~screen] = np.nan
    means = light_means(light, 3, screen)
    assert means.shape == (2, 2, 3, 3)
    assert not means[:, 1, 2].any()  # no pixel of this block is on the screen
    for row, col in ((0, 0), (0, 1), (1, 1)):
        place = slice(3 * row, 3 * row + 3), slice(3 * col, 3 * col + 3)
        on = light[:, *place][:, screen[place]]
        np.testing.assert_allclose(means[:, row, col], on.mean(axis=1))
        np.testing.assert_allclose(light_sums(light, 3, screen)[:, row, col], on.sum(axis=1))
    np.testing.assert_allclose(light_means(PICTURE[None, ..., None], 7), PICTURE.mean())


@pytest.mark.parametrize("block", [1, 2, 3, 4])
def test_a_slope_is_enlarged_to_itself_between_the_middles_of_blocks(block):
    rows, cols = 5 * block, 7 * block
    slope = np.arange(rows)[:, None] + 10.0 * np.arange(cols)
    first, inside = block // 2, slice(block // 2, -(block // 2) or None)
    found = enlarged(block_sums(slope, block) / block**2, block, slice(0, rows), cols)
    np.testing.assert_allclose(found[inside, inside], slope[inside, inside])
    assert (found[:first, :] == found[:1, :]).all()  # flat beyond the first middle
    assert (found[:, :first] == found[:, :1]).all()


@pytest.mark.parametrize("block", [1, 2, 3, 4])
def test_rows_are_enlarged_alone_as_together(block):
    coarse = RNG.random((2, 5, 7))
    rows, cols = 5 * block - block // 2, 7 * block - block // 2
    whole, some = enlarged(coarse, block, slice(0, rows), cols), slice(block, rows - 1)
    np.testing.assert_allclose(enlarged(coarse, block, some, cols), whole[:, some])


def test_any_array_library():
    there = array_api_strict.asarray(PICTURE)
    light, screen = there[None, :, :, None], there > 0.5
    for found, expected in (
        (enlarged(there, 3, slice(2, 9), 20), enlarged(PICTURE, 3, slice(2, 9), 20)),
        (light_means(light, 2, screen), light_means(PICTURE[None, ..., None], 2, PICTURE > 0.5)),
    ):
        np.testing.assert_allclose(np.asarray(found), expected, rtol=1e-12)
