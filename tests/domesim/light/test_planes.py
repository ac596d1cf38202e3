"""Light that is told part by part is the light that it tells."""

import numpy as np
import pytest

from domesim.light.planes import Columns, compact, every, gathered, once, planes_of

LIGHT = np.random.default_rng(0).random((2, 30, 20, 3), np.float32)


def test_what_is_told_is_gathered_again():
    np.testing.assert_array_equal(gathered(planes_of(LIGHT), LIGHT.shape), LIGHT)
    np.testing.assert_array_equal(every(planes_of(LIGHT), 2, 7), LIGHT[:, ::7, ::7])
    rows, cols = np.array([3, 29]), np.array([19, 0])
    told = np.stack(planes_of(LIGHT)(1, rows[:, None], cols), -1)
    np.testing.assert_array_equal(told, LIGHT[1][rows[:, None], cols])


@pytest.mark.parametrize("block", [1, 4, 7])
@pytest.mark.parametrize("kind", ["disc", "cut", "two", "none", "all"])
def test_columns_hold_the_screen_and_no_block_more(kind, block):
    row, col = np.mgrid[:40, :37]
    disc = np.hypot(row - 20, col - 17) < 15
    screen = {
        "disc": disc,
        "cut": disc & (row < 25),
        "two": (abs(col - 10) < 3) | (abs(col - 30) < 4),  # apart from each other
        "none": np.zeros((40, 37), bool),
        "all": np.ones((40, 37), bool),
    }[kind]
    columns = Columns(screen)
    for start in range(0, 40, 8):
        rows = slice(start, start + 8)
        cols, full = columns.of(rows, block), columns.full(rows)
        on = np.flatnonzero(screen[rows].any(axis=0))
        assert cols.start % block == 0
        assert cols.stop % block == 0 or cols.stop == 37
        assert cols.stop > cols.start
        assert screen[rows, full].all()
        if on.size:
            assert on[0] - block < cols.start <= on[0]
            assert on[-1] < cols.stop <= on[-1] + block
        off = np.ones(40, bool)[: cols.stop - cols.start]
        for part in columns.partly(rows, cols):
            off[part] = False
        assert screen[rows, cols][:, off].all()
        whole = np.flatnonzero(screen[rows].all(axis=0))
        if kind in ("disc", "cut", "all"):
            assert full.stop - full.start == whole.size


def test_what_is_repeated_is_kept_once():
    wide = np.broadcast_to(LIGHT[:, :, :1, :], LIGHT.shape)[:, ::3]
    assert once(wide).shape == (2, 10, 1, 3)
    np.testing.assert_array_equal(compact(wide), wide)
    assert once(compact(wide)).flags.c_contiguous
