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
    NO,
    NONE,
    ONE,
    TINY,
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
_HERE, _SUMS, _HEAP, _PLANES = 3, 4, 10, 16


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
    weights, dark, hue
        As there, of float32.
    over_fade, over_edge
        One over the aim's.
    """

    cols: np.uint64
    spans: NDArray[np.uint64]
    cell: np.uint64
    block: np.uint64
    weights: NDArray[np.float32]
    dark: np.float32
    hue: np.float32
    over_fade: np.float32
    over_edge: np.float32


@INSIDE
def _set(w: Any, k: int, a: Any, b: Any, value: Any) -> None:
    for j in range(a, b):
        w[k, j] = value


@INSIDE
def _adapting(k: Any, w: Any, j: Any, gain: Any) -> Any:
    """Luminance that is seen of the light, and what the eye loses."""
    mean = k.weights[0] * w[0, j] + k.weights[1] * w[1, j] + k.weights[2] * w[2, j]
    return max(mean * gain, NO) + k.dark


@INSIDE
def _moments(k: Any, floors: Any, at: Any, first: Any, a: Any, b: Any, w: Any) -> None:
    """Add what the base is made of, by columns."""
    for j in range(a, b):
        seen = _adapting(k, w, j, between(floors, 3, at, first + j))
        log = logarithm(seen)
        here = w[_HERE, j]
        importance = here * k.dark / seen
        w[_HEAP, j] += importance
        w[_HEAP + 1, j] += here * log
        w[_HEAP + 2, j] += here * log * log
        w[_HEAP + 3, j] += importance * log
        w[_HEAP + 4, j] += importance * log * log
        w[_HEAP + 5, j] += here * (seen - k.dark)


@INSIDE
def _lifted(
    k: Any, below: Any, bases: Any, missing: Any, lifts: Any, i: Any, at: Any, up: Any, first: Any,
    a: Any, b: Any, w: Any,
) -> None:  # fmt: skip
    """How much the light is lifted: B' / B."""
    for j in range(a, b):
        c = first + j
        log = logarithm(_adapting(k, w, j, between(below, 3, at, c)))
        of_all = between(bases, 0, up, c) * log + between(bases, 1, up, c)
        of_dark = between(bases, 2, up, c) * log + between(bases, 3, up, c)
        of_both = of_dark + (of_all - of_dark) * within((log - of_dark) * k.over_edge)
        gain = ONE + max(missing * exponential(-of_both) - k.over_fade, NO)
        top = max(w[0, j], w[1, j], w[2, j])
        lifts[i, c] = max(min(gain, ONE / max(top, TINY)), ONE)


@INSIDE
def _aimed(
    k: Any, below: Any, lifts: Any, i: Any, at: Any, first: Any, a: Any, b: Any, w: Any
) -> None:
    """The aim in the place of the light, with hues kept over what is there.

    A primary that lacks more than it gets stays below its floor: none of it is projected.
    """
    for j in range(a, b):
        c = first + j
        gain = lifts[i, c]
        red, green, blue = w[0, j], w[1, j], w[2, j]
        top = max(red, green, blue)
        raised = ONE - top / max(top * gain, TINY)
        red, green, blue = red * gain, green * gain, blue * gain
        lack = max(between(below, 0, at, c) - red, between(below, 1, at, c) - green)
        lack = max(lack, between(below, 2, at, c) - blue, NO)
        shared = k.hue * raised * lack
        w[0, j], w[1, j], w[2, j] = red + shared, green + shared, blue + shared


@INSIDE
def _counted(
    floors: Any, at: Any, first: Any, begin: Any, end: Any, a: Any, b: Any, w: Any
) -> None:
    """Add subtracted light, and which of it moves with the floor, by columns."""
    for p in range(3):
        _set(w, p, a, begin, NO)
        _set(w, p, end, b, NO)
        for j in range(a, b):
            free = w[p, j] - between(floors, p, at, first + j)
            w[_SUMS + p, j] += within(free)
            w[_SUMS + 3 + p, j] += ONE if free > NO and free < ONE else NO


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
        sums[p] = NO


@COMPILED
def sweep(
    stage: int,
    code: Any,
    k: Any,
    codes: Any,
    floors: Any,
    below: Any,
    bases: Any,
    missing: Any,
    lifts: Any,
    heap: Any,
    sums: Any,
    noise: Any,
    out: Any,
) -> None:
    """One pass over a frame of codes, (row, sample).

    `floors`: (4, cell row, col): ambient and reflected light that is taken off the light of
    `stage`, and the direct gain.
    `below`: those of MASTER, over which the aim keeps hues.
    `bases`, `missing`: (4, block row, col) slopes and offsets of the base of all, and of the dark;
    and the missing light: of AIMED, which writes `lifts`: (row, col) B' / B.
    `heap`: (6, block row, block col) of MASTER: sums of importance, of logarithms and their
    squares, without and with it, and of luminance.
    `sums`: (6, cell row, cell col): of light, and of the pixels that move with the floor.
    `noise`: (row,) places at which noise begins.
    """
    rows = codes.shape[0]
    _begun(sums, 6)
    _begun(heap, 6 if stage == MASTER else 0)
    for band in numba.prange(sums.shape[1]):
        w = np.zeros((_PLANES, _PITCH), np.float32)
        places, found = np.empty(_WIDE, np.uint32), np.empty((3, _WIDE), out.dtype)
        last = min((band + 1) * k.cell, rows) - 1
        for first in range(NONE, k.cols, _WIDE):
            wide = min(_WIDE, k.cols - first)
            for i in range(band * k.cell, last + 1):
                at, done = about(i, k.cell, floors), NONE
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
                        _set(w, _HERE, a, begin, NO)
                        _set(w, _HERE, end, b, NO)
                        _moments(k, floors, at, first, a, b, w)
                    else:
                        if stage == AIMED:
                            up = about(i, k.block, bases)
                            _lifted(k, below, bases, missing, lifts, i, at, up, first, a, b, w)
                        _aimed(k, below, lifts, i, at, first, a, b, w)
                    if stage != WRITTEN:
                        _counted(floors, at, first, begin, end, a, b, w)
                        continue
                    _subtracted(floors, at, first, a, b, w)
                    encoded(code, w, 0, a, b, noise[i] + first, places, found)
                    copied(code, codes, i, first + done, first + begin, out)
                    stored(code, codes, i, first, begin, end, found, out)
                    done = end
                if stage == WRITTEN:
                    copied(code, codes, i, first + done, first + wide, out)
                elif stage == MASTER and ((i + 1) % k.block == 0 or i == last):
                    summed(w, _HEAP, first, wide, k.block, i // k.block, heap)
            if stage != WRITTEN:
                summed(w, _SUMS, first, wide, k.cell, band, sums)


@INSIDE
def _boxed(planes: Any, i: Any, radius: int, line: Any, found: Any) -> None:
    """Sums over squares about row `i` of (plane, row, col)."""
    reach, cols = np.uint64(radius), np.uint64(planes.shape[2])
    for k in range(planes.shape[0]):
        line[:] = NO
        for near in range(max(i - radius, 0), min(i + radius + 1, planes.shape[1])):
            for j in range(cols):
                line[reach + j] += planes[k, near, j]
        found[k] = NO
        for d in range(reach + reach + NEXT):
            for j in range(cols):
                found[k, j] += line[d + j]


@COMPILED
def bases(
    counted: Any, around: Any, heap: Any, radius: int, edge: Any, work: Any, result: Any
) -> None:
    """`compensate.blocks.coefficients` of all, and by importance, from what `sweep` has found.

    `counted`, `around`: (row, col) of blocks: pixels that count, and their sums over boxes.
    `work`: (12, row, col), for use in between; the first three are planes 0, 1 and 3 of `heap`.
    `result`: (4, row, col): slopes and offsets.
    """
    rows, cols = counted.shape
    variance = edge * edge
    least = np.float32(1e-30)
    for i in numba.prange(rows):
        line, sums = np.empty(cols + 2 * radius, np.float32), np.empty((3, cols), np.float32)
        _boxed(work[:3], i, radius, line, sums)
        for j in range(cols):
            count, weight = max(around[i, j], least), max(sums[0, j], least)
            of_all, of_dark = sums[1, j] / count, sums[2, j] / weight
            spread = heap[2, i, j] + (of_all * counted[i, j] - 2 * heap[1, i, j]) * of_all
            work[3, i, j] = max(spread, NO)
            spread = heap[4, i, j] + (of_dark * heap[0, i, j] - 2 * heap[3, i, j]) * of_dark
            work[4, i, j] = max(spread, NO)
            work[5, i, j], work[6, i, j], work[7, i, j] = of_all, of_dark, weight
    for i in numba.prange(rows):
        line, sums = np.empty(cols + 2 * radius, np.float32), np.empty((2, cols), np.float32)
        _boxed(work[3:5], i, radius, line, sums)
        for j in range(cols):
            spread = sums[0, j] / max(around[i, j], least)
            slope = spread / (spread + variance)
            work[8, i, j] = counted[i, j] * slope
            work[9, i, j] = counted[i, j] * (ONE - slope) * work[5, i, j]
            spread = sums[1, j] / work[7, i, j]
            slope = spread / (spread + variance)
            work[10, i, j] = counted[i, j] * slope
            work[11, i, j] = counted[i, j] * (ONE - slope) * work[6, i, j]
    for i in numba.prange(rows):
        line, sums = np.empty(cols + 2 * radius, np.float32), np.empty((4, cols), np.float32)
        _boxed(work[8:12], i, radius, line, sums)
        for k in range(4):
            for j in range(cols):
                result[k, i, j] = sums[k, j] / max(around[i, j], least)


@COMPILED
def lacking(floor: Any, side: int, luminance: Any, counted: Any, found: Any) -> None:
    """(block row, block col) missing light: of a (1, cell row, block col) floor, what is shown.

    `side`: blocks along a cell.
    """
    for i in numba.prange(counted.shape[0]):
        at = about(i, side, floor)
        for j in range(np.uint64(counted.shape[1])):
            shown = luminance[i, j] / max(counted[i, j], ONE)
            found[i, j] = max(between(floor, 0, at, j) - shown, NO)


@COMPILED
def excess(counted: Any, values: Any, level: Any) -> Any:
    """Share of `counted` whose value is above a level, and the mean excess, of (row, col) each."""
    above: Any = 0.0
    more: Any = 0.0
    total: Any = 0.0
    for i in numba.prange(counted.shape[0]):
        line_above, line_more, line_total = NO, NO, NO
        for j in range(counted.shape[1]):
            value = values[i, j] - level
            line_total += counted[i, j]
            line_above += counted[i, j] if value > 0 else NO
            line_more += counted[i, j] * max(value, NO)
        above += line_above
        more += line_more
        total += line_total
    return above / total, more / total
