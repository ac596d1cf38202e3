"""Light that comes back from a flat room: traced, it is what radiosity says."""

from __future__ import annotations

import numpy as np
import pytest
from flat_cinemas import ROOM, SILVER

from domesim.observation.flat_room import room_observation
from domesim.pathtrace.flat_room import returning

ROWS, COLS = 20, 40


@pytest.mark.long
@pytest.mark.parametrize("room", [ROOM, SILVER], ids=["matt", "gain"])
def test_a_picture_of_one_side_comes_back_as_radiosity_says(room):
    picture = np.zeros((ROWS, COLS))
    picture[: ROWS // 2, :12] = 1
    row, col = (each.ravel() for each in np.mgrid[2:ROWS:4, 2:COLS:6])
    width, height = room.screen
    places = np.stack([((col + 0.5) / COLS - 0.5) * width, (0.5 - (row + 0.5) / ROWS) * height], 1)
    found = returning(room, picture, places, samples=1 << 17, seed=3)
    light = np.repeat(picture[None, :, :, None], 3, axis=3)
    expected = (room_observation(room, ROWS, COLS, 0.0).linear(light) - light)[0, row, col]
    error = np.sqrt(np.mean(found.error**2, axis=0) / len(places)) / expected.mean(axis=0)
    off = expected.mean(axis=0) / found.light.mean(axis=0) - 1
    assert error.max() < 2e-3
    assert np.abs(off).max() < 5e-3 + 2 * error.max()
    # Light is brightest beside the picture, and left is not right
    assert np.corrcoef(found.light[:, 0], expected[:, 0])[0, 1] > 0.99
