"""Passes over the pixels of a dome, compiled by Numba; see `compensate.live.tile_loops`.

Only `compensate.live.dome` imports this module. Names are as in `compensate.live.constants`. Rows
are done in bands as high as a cell, by all threads.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from compensate.live.tile_loops import (
    COMPILED,
    INSIDE,
    LINE,
    NEXT,
    ONE,
    START,
    TINY,
    ZERO,
    about,
    between,
    copied,
    decoded,
    encoded,
    exponential,
    logarithm,
    stored,
    summed,
    within,
)

MASTER, AIMED, WRITTEN = range(3)
"""What `sweep` adds up: what subtraction shows of the master, and of the aim; or what it writes."""

_WIDE, _PITCH = np.uint64(2048), 2064
"""Columns of a tile, and of its planes."""

# Planes of a tile: light; 1 on the screen; sums by cells; sums by blocks
_HERE, _SUMS, _HEAP, _PLANES = 3, 4, 10, 14
_OF_CELLS, _OF_BLOCKS = _HEAP - _SUMS, _PLANES - _HEAP
_TWO, _LEAST = np.float32(2), np.float32(1e-30)


class Dome(NamedTuple):
    """What passes know of a dome: see `compensate.live.constants.DomeConstants`.

    Parameters
    ----------
    cols
        Of the picture.
    spans
        (row, piece, 2) columns between which a row has screen.
    cell, block
        As there.
    weights, dark
        As there, of float32.
    """

    cols: np.uint64
    spans: NDArray[np.uint64]
    cell: np.uint64
    block: np.uint64
    weights: NDArray[np.float32]
    dark: np.float32


@INSIDE
def _set(w: Any, k: int, a: Any, b: Any, value: Any) -> None:
    for j in range(a, b):
        w[k, j] = value


@INSIDE
def _luminance(k: Any, red: Any, green: Any, blue: Any) -> Any:
    return max(k.weights[0] * red + k.weights[1] * green + k.weights[2] * blue, ZERO)


@INSIDE
def _moments(k: Any, floors: Any, at: Any, first: Any, a: Any, b: Any, w: Any) -> None:
    """Add what the base is made of, by columns."""
    for j in range(a, b):
        seen = _luminance(k, w[0, j], w[1, j], w[2, j]) * between(floors, 3, at, first + j)
        m = seen + k.dark
        log, here = logarithm(m), w[_HERE, j]
        importance = here * k.dark / m
        w[_HEAP, j] += importance
        w[_HEAP + 1, j] += importance * log
        w[_HEAP + 2, j] += importance * log * log
        w[_HEAP + 3, j] += here * seen


@INSIDE
def _lifted(
    k: Any, below: Any, base: Any, v: Any, lifts: Any, i: Any, at: Any, up: Any, first: Any,
    a: Any, b: Any, w: Any,
) -> None:  # fmt: skip
    """How much the light is lifted: m' / m."""
    for j in range(a, b):
        c = first + j
        red, green, blue = w[0, j], w[1, j], w[2, j]
        m = _luminance(k, red, green, blue) * between(below, 3, at, c) + k.dark
        over_b = exponential(-between(base, 0, up, c) * logarithm(m) - between(base, 1, up, c))
        t = min(ONE / (over_b * m), ONE)
        own = v * over_b * t * (_TWO - t)
        gain = np.sqrt(ONE + own * own)
        lifts[i, c] = max(min(gain, ONE / max(red, green, blue, TINY)), ONE)


@INSIDE
def _aimed(
    k: Any, below: Any, lifts: Any, i: Any, at: Any, first: Any, a: Any, b: Any, w: Any
) -> None:
    """The aim in the place of the light: mixed with grey as far as it is lifted, and no harm."""
    for j in range(a, b):
        c = first + j
        gain = lifts[i, c]
        red, green, blue = w[0, j] * gain, w[1, j] * gain, w[2, j] * gain
        y = _luminance(k, red, green, blue)
        low_red, low_green = between(below, 0, at, c), between(below, 1, at, c)
        low_blue = between(below, 2, at, c)
        least = min(red / max(low_red, TINY), green / max(low_green, TINY))
        least = min(least, blue / max(low_blue, TINY), ONE)
        own = ONE - (ONE - ONE / gain) * (ONE - max(_TWO * least - ONE, ZERO))
        red, green, blue = y + own * (red - y), y + own * (green - y), y + own * (blue - y)
        over_red, over_green = max(red - low_red, ZERO), max(green - low_green, ZERO)
        over_blue = max(blue - low_blue, ZERO)
        over = max(_luminance(k, over_red, over_green, over_blue), TINY)
        less = ONE - min(y / (gain * over), ONE)
        w[0, j], w[1, j] = red - less * over_red, green - less * over_green
        w[2, j] = blue - less * over_blue


@INSIDE
def _counted(
    floors: Any, at: Any, first: Any, begin: Any, end: Any, a: Any, b: Any, w: Any
) -> None:
    """Add subtracted light, and which of it moves with the floor, by columns."""
    for p in range(3):
        _set(w, p, a, begin, ZERO)
        _set(w, p, end, b, ZERO)
        for j in range(a, b):
            free = w[p, j] - between(floors, p, at, first + j)
            w[_SUMS + p, j] += within(free)
            w[_SUMS + 3 + p, j] += ONE if free > ZERO and free < ONE else ZERO


@INSIDE
def _subtracted(floors: Any, at: Any, first: Any, a: Any, b: Any, w: Any) -> None:
    """What to project, in the place of the aim."""
    for p in range(3):
        for j in range(a, b):
            w[p, j] = within(w[p, j] - between(floors, p, at, first + j))


@INSIDE
def _begun(sums: Any, planes: int) -> None:
    """Sums begin anew."""
    for p in range(planes):
        sums[p] = ZERO


@COMPILED
def sweep(
    stage: int,
    code: Any,
    k: Any,
    codes: Any,
    floors: Any,
    below: Any,
    base: Any,
    v: Any,
    lifts: Any,
    heap: Any,
    sums: Any,
    noise: Any,
    out: Any,
) -> None:
    """One pass over a frame of codes, (row, sample).

    `floors`: (4, cell row, col): ambient and reflected light that is taken off the light of
    `stage`, and the direct gain.
    `below`: those of MASTER, below which the aim has no primary.
    `base`, `v`: (2, block row, col) slope and offset of the base, and how far black is lifted: of
    AIMED, which writes `lifts`: (row, col) m' / m.
    `heap`: (4, block row, block col) of MASTER: sums of importance, of logarithms and of their
    squares by it, and of luminance.
    `sums`: (6, cell row, cell col): of light, and of the pixels that move with the floor.
    `noise`: (row,) places at which noise begins.
    """
    rows = codes.shape[0]
    _begun(sums, _OF_CELLS)
    _begun(heap, _OF_BLOCKS if stage == MASTER else 0)
    for band in numba.prange(sums.shape[1]):
        w = np.zeros((_PLANES, _PITCH), np.float32)
        places, coded = np.empty(_WIDE, np.uint32), np.empty((3, _WIDE), out.dtype)
        last = min((band + 1) * k.cell, rows) - 1
        for first in range(START, k.cols, _WIDE):
            wide = min(_WIDE, k.cols - first)
            for i in range(band * k.cell, last + 1):
                at, done = about(i, k.cell, floors), START
                for piece in range(k.spans.shape[1]):
                    a = max(k.spans[i, piece, 0], first) - first
                    b = min(max(k.spans[i, piece, 1], first) - first, wide)
                    if a >= b:
                        continue
                    # Whole vectors: what is beyond the piece is left out of all that is kept
                    begin, end = a, b
                    a, b = a - a % LINE, min((b + LINE - NEXT) // LINE * LINE, wide)
                    decoded(code, codes, i, first, a, b, w, 0)
                    if stage == MASTER:
                        _set(w, _HERE, a, b, ONE)
                        _set(w, _HERE, a, begin, ZERO)
                        _set(w, _HERE, end, b, ZERO)
                        _moments(k, floors, at, first, a, b, w)
                    else:
                        if stage == AIMED:
                            up = about(i, k.block, base)
                            _lifted(k, below, base, v, lifts, i, at, up, first, a, b, w)
                        _aimed(k, below, lifts, i, at, first, a, b, w)
                    if stage != WRITTEN:
                        _counted(floors, at, first, begin, end, a, b, w)
                        continue
                    _subtracted(floors, at, first, a, b, w)
                    encoded(code, w, 0, a, b, noise[i] + first, places, coded)
                    copied(code, codes, i, first + done, first + begin, out)
                    stored(code, codes, i, first, begin, end, coded, out)
                    done = end
                if stage == WRITTEN:
                    copied(code, codes, i, first + done, first + wide, out)
                elif stage == MASTER and ((i + 1) % k.block == 0 or i == last):
                    summed(w, _HEAP, _OF_BLOCKS, first, wide, k.block, i // k.block, heap)
            if stage != WRITTEN:
                summed(w, _SUMS, _OF_CELLS, first, wide, k.cell, band, sums)


@INSIDE
def _near(planes: Any, i: Any, weights: Any, line: Any, sums: Any) -> None:
    """`compensate.blocks.near_sum` of row `i` of (plane, row, col)."""
    radius = len(weights) - 1
    reach, cols = np.uint64(radius), np.uint64(planes.shape[2])
    for k in range(planes.shape[0]):
        line[:] = ZERO
        for near in range(max(i - radius, 0), min(i + radius + 1, planes.shape[1])):
            weight = weights[abs(near - i)]
            for j in range(cols):
                line[reach + j] += weight * planes[k, near, j]
        sums[k] = ZERO
        for d in range(-radius, radius + 1):
            weight, at = weights[abs(d)], np.uint64(radius + d)
            for j in range(cols):
                sums[k, j] += weight * line[at + j]


@COMPILED
def guided(
    counted: Any, around: Any, heap: Any, weights: Any, variance: Any, work: Any, result: Any
) -> None:
    """`compensate.blocks.guided` from the sums of `sweep`.

    `counted`, `around`: (row, col) of blocks: pixels that count, and their `near_sum`.
    `weights`: by distance.
    `variance`: of an edge.
    `work`: (5, row, col), for use in between.
    `result`: (2, row, col): slope and offset.
    """
    rows, cols = counted.shape
    wide = cols + 2 * (len(weights) - 1)
    for i in numba.prange(rows):
        line, sums = np.empty(wide, np.float32), np.empty((2, cols), np.float32)
        _near(heap[:2], i, weights, line, sums)
        for j in range(cols):
            weight = max(sums[0, j], _LEAST)
            middle = sums[1, j] / weight
            spread = heap[2, i, j] + (middle * heap[0, i, j] - 2 * heap[1, i, j]) * middle
            work[0, i, j], work[1, i, j], work[2, i, j] = max(spread, ZERO), middle, weight
    for i in numba.prange(rows):
        line, sums = np.empty(wide, np.float32), np.empty((1, cols), np.float32)
        _near(work[:1], i, weights, line, sums)
        for j in range(cols):
            spread = sums[0, j] / work[2, i, j]
            slope = spread / (spread + variance)
            work[3, i, j] = counted[i, j] * slope
            work[4, i, j] = counted[i, j] * (ONE - slope) * work[1, i, j]
    for i in numba.prange(rows):
        line, sums = np.empty(wide, np.float32), np.empty((2, cols), np.float32)
        _near(work[3:], i, weights, line, sums)
        for k in range(2):
            for j in range(cols):
                result[k, i, j] = sums[k, j] / max(around[i, j], _LEAST)


@COMPILED
def lacking(floor: Any, side: int, luminance: Any, counted: Any, missing: Any) -> None:
    """(block row, block col) missing light: of a (1, cell row, block col) floor, what is shown.

    `side`: blocks along a cell.
    """
    for i in numba.prange(counted.shape[0]):
        at = about(i, side, floor)
        for j in range(np.uint64(counted.shape[1])):
            seen = luminance[i, j] / max(counted[i, j], ONE)
            missing[i, j] = max(between(floor, 0, at, j) - seen, ZERO)


@COMPILED
def excess(counted: Any, values: Any, level: Any) -> Any:
    """Share of `counted` whose value is above a level, and the mean excess, of (row, col) each."""
    above: Any = 0.0
    more: Any = 0.0
    total: Any = 0.0
    for i in numba.prange(counted.shape[0]):
        line_above, line_more, line_total = ZERO, ZERO, ZERO
        for j in range(counted.shape[1]):
            value = values[i, j] - level
            line_total += counted[i, j]
            line_above += counted[i, j] if value > 0 else ZERO
            line_more += counted[i, j] * max(value, ZERO)
        above += line_above
        more += line_more
        total += line_total
    return above / total, more / total
