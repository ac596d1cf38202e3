"""Passes over the pixels of a pair, compiled by Numba; see `compensate.live.tile_loops`.

Planes of a tile are three primaries of the left view, then of the right.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from compensate.live.noise import APART
from compensate.live.tile_loops import (
    COMPILED,
    INSIDE,
    NEXT,
    START,
    TINY,
    ZERO,
    about,
    between,
    decoded,
    encoded,
    stored,
    widened_row,
    within,
)

_WIDE, _PITCH = np.uint64(512), 528
"""Columns of a tile, and of its planes: fewer than of a dome, for it has many."""

# Planes of a tile: light; what is shown of it; the map; rows of veils; sums, and room to add up
_SHOWN, _SHARE, _VEILS, _SUMS, _ROOM, _PLANES = 6, 12, 14, 26, 32, 34
_BAND = 32
"""Rows that a thread does at once: whole blocks."""


class Pair(NamedTuple):
    """What passes know of a pair: see `compensate.live.constants.PairConstants`.

    Parameters
    ----------
    rows, cols
        Of a view.
    down, across
        Where the right view begins in a frame.
    block
        Pixels along a side of the blocks: a power of two.
    cell
        Pixels along a side of the cells of the map, or of the picture.
    rounds
        How often both eyes take their turn.
    weights, matrices, black
        As there, of float32.
    """

    rows: int
    cols: np.uint64
    down: np.uint64
    across: np.uint64
    block: np.uint64
    cell: int
    rounds: int
    weights: NDArray[np.float32]
    matrices: NDArray[np.float32]
    black: NDArray[np.float32]


@INSIDE
def _leak(k: Any, w: Any, view: int, p: int, other: int, j: Any) -> Any:
    """What a primary gets of the light in planes from `other`, where the map is 1."""
    m = k.matrices
    leak = m[view, p, 0] * w[other, j] + m[view, p, 1] * w[other + 1, j]
    return leak + m[view, p, 2] * w[other + 2, j]


@INSIDE
def _turned(k: Any, view: int, wide: Any, w: Any) -> None:
    """An eye's turn: what is wanted less what leaks of what the other is shown."""
    mine, other = 3 * view, _SHOWN + 3 - 3 * view
    for j in range(START, wide):
        for p in range(3):
            leaks = w[_SHARE + view, j] * _leak(k, w, view, p, other, j)
            w[_SHOWN + mine + p, j] = within(w[mine + p, j] - k.black[view, p] - leaks)


@INSIDE
def _subtracted(k: Any, wide: Any, w: Any) -> None:
    """What to project so that the light is seen."""
    for p in range(3, 6):
        for j in range(START, wide):
            w[_SHOWN + p, j] = within(w[p, j] - k.black[1, p - 3])
    for _ in range(k.rounds):
        _turned(k, 0, wide, w)
        _turned(k, 1, wide, w)


@INSIDE
def _ghost(k: Any, w: Any, view: int, p: int, j: Any) -> Any:
    """How much more is seen of a primary than is wanted."""
    leaks = w[_SHARE + view, j] * _leak(k, w, view, p, _SHOWN + 3 - 3 * view, j)
    mine = 3 * view + p
    return max(w[_SHOWN + mine, j] + k.black[view, p] + leaks - w[mine, j], ZERO)


@INSIDE
def _counted(k: Any, view: int, wide: Any, w: Any) -> None:
    """Add ghosts of a view, by columns."""
    for j in range(START, wide):
        for p in range(3):
            w[_SUMS + 3 * view + p, j] += _ghost(k, w, view, p, j)


@INSIDE
def _veiled(k: Any, up: Any, view: int, wide: Any, w: Any) -> None:
    """Add a view's veils to its light, where they are brighter than its ghosts."""
    mine = 3 * view
    for j in range(START, wide):
        red, green = _rim(k, w, view, 0, up, j), _rim(k, w, view, 1, up, j)
        blue = _rim(k, w, view, 2, up, j)
        rim = k.weights[0] * red + k.weights[1] * green + k.weights[2] * blue
        part = rim / max(_luminance(k, w, mine, j) + rim, TINY)
        w[mine, j] += (w[mine, j] + red) * part
        w[mine + 1, j] += (w[mine + 1, j] + green) * part
        w[mine + 2, j] += (w[mine + 2, j] + blue) * part


@INSIDE
def _luminance(k: Any, w: Any, plane: int, j: Any) -> Any:
    """Luminance of the light in a plane and the two after it."""
    luminance = k.weights[0] * w[plane, j] + k.weights[1] * w[plane + 1, j]
    return max(luminance + k.weights[2] * w[plane + 2, j], ZERO)


@INSIDE
def _rim(k: Any, w: Any, view: int, p: int, up: Any, j: Any) -> Any:
    """How much brighter a primary's veil is than its ghost."""
    return max(_row_between(w, 3 * view + p, up, j) - _ghost(k, w, view, p, j), ZERO)


@INSIDE
def _row_between(w: Any, plane: int, part: Any, j: Any) -> Any:
    """Veils between the two rows of them that a tile holds."""
    low = w[_VEILS + plane, j]
    return low + (w[_VEILS + 6 + plane, j] - low) * part


@INSIDE
def _added(k: Any, w: Any, first: Any, wide: Any, row: Any, counts: Any, ghosts: Any) -> None:
    """Means over a row of blocks, of sums by columns, which begin anew."""
    begin, blocks = first // k.block, (wide + k.block - NEXT) // k.block
    for p in range(ghosts.shape[0]):
        source, width = _SUMS + p, _WIDE
        while width > _WIDE // k.block:
            width //= np.uint64(2)
            target = _ROOM + 1 if source == _ROOM else _ROOM
            for c in range(width):
                w[target, c] = w[source, c + c] + w[source, c + c + NEXT]
            source = target
        for c in range(blocks):
            ghosts[p, row, begin + c] = w[source, c] * counts[row, begin + c]
        for j in range(_WIDE):
            w[_SUMS + p, j] = ZERO


@COMPILED
def sweep(
    writes: bool,
    code: Any,
    k: Any,
    codes: Any,
    shares: Any,
    counts: Any,
    ghosts: Any,
    veils: Any,
    lows: Any,
    parts: Any,
    noise: Any,
    out: Any,
) -> None:
    """One pass over a frame of codes, (row, sample): it finds ghosts, or `writes` what to project.

    `shares`: (2, cell row, col): the map.
    `counts`: (block row, block col): one over the pixels of each block.
    `ghosts`: (6, block row, block col): means of ghosts, of both views.
    `veils`: the same, of veils.
    `lows`, `parts`: (col,) blocks' columns below, see `places_along`.
    `noise`: (row,) places at which noise begins.
    """
    block = np.int64(k.block)
    band = max(_BAND, block)
    for number in numba.prange((k.rows + band - 1) // band):
        w = np.zeros((_PLANES, _PITCH), np.float32)
        places, kept = np.empty(_WIDE, np.uint32), np.empty((3, _WIDE), out.dtype)
        last = min((number + 1) * band, k.rows) - 1
        for first in range(START, k.cols, _WIDE):
            wide = min(_WIDE, k.cols - first)
            held: Any = -9
            for i in range(number * band, last + 1):
                right = i + np.int64(k.down)
                at = about(i, k.cell, shares)
                decoded(code, codes, i, first, START, wide, w, 0)
                decoded(code, codes, right, first + k.across, START, wide, w, 3)
                for view in range(2):
                    for j in range(START, wide):
                        w[_SHARE + view, j] = between(shares, view, at, first + j)
                _subtracted(k, wide, w)
                if not writes:
                    _counted(k, 0, wide, w)
                    _counted(k, 1, wide, w)
                    if (i + 1) % block == 0 or i == last:
                        _added(k, w, first, wide, i // block, counts, ghosts)
                    continue
                up = about(i, block, veils)
                low = np.int64(up.low)
                for p in range(6 if held != low else 0):
                    if held == low - 1:
                        for j in range(wide):
                            w[_VEILS + p, j] = w[_VEILS + 6 + p, j]
                    else:
                        widened_row(veils, p, up.low, lows, parts, first, wide, w, _VEILS + p)
                    widened_row(veils, p, up.high, lows, parts, first, wide, w, _VEILS + 6 + p)
                held = low
                _veiled(k, up.part, 0, wide, w)
                _veiled(k, up.part, 1, wide, w)
                _subtracted(k, wide, w)
                begin = noise[i] + first
                encoded(code, w, _SHOWN, START, wide, begin, places, kept)
                stored(code, codes, i, first, START, wide, kept, out)
                begin += np.uint64(3 * APART)
                encoded(code, w, _SHOWN + 3, START, wide, begin, places, kept)
                stored(code, codes, right, first + k.across, START, wide, kept, out)
