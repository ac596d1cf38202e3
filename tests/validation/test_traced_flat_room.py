"""Light that comes back from a flat room: traced, it is what radiosity says."""

from __future__ import annotations

import numpy as np
import pytest
from flat_cinemas import ROOM, SILVER

from validation.experiments.flat_cinema import both_ways

ROWS, COLS = 20, 40


@pytest.mark.long
@pytest.mark.parametrize("room", [ROOM, SILVER], ids=["matt", "gain"])
def test_a_picture_of_one_side_comes_back_as_radiosity_says(room):
    picture = np.zeros((ROWS, COLS))
    picture[: ROWS // 2, :12] = 1
    row, col = (each.ravel() for each in np.mgrid[2:ROWS:4, 2:COLS:6])
    found, expected = both_ways(room, picture, row, col, samples=1 << 17, seed=3)
    error = np.sqrt(np.mean(found.error**2, axis=0) / len(row)) / expected.mean(axis=0)
    off = expected.mean(axis=0) / found.light.mean(axis=0) - 1
    assert error.max() < 2e-3
    assert np.abs(off).max() < 5e-3 + 2 * error.max()
    # Light is brightest beside the picture, and left is not right
    assert np.corrcoef(found.light[:, 0], expected[:, 0])[0, 1] > 0.99
