"""Passes over the pixels of a dome, each fused into one, compiled by Numba.

Only `compensate.live.dome` and `pair_loops` import this module: Numba is of the extra ``fast``.
Names are as in `compensate.live.constants`; light is (primary, col) of one row. Rows are done in
bands as high as a cell, by all threads. Places in arrays are unsigned, or slices: Numba takes
signed numbers for places from the end, too, and then has no vectors.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from compensate.live.noise import APART

_COMPILED: Any = numba.njit(
    parallel=True, cache=True, nogil=True, error_model="numpy", fastmath=True
)
_INSIDE: Any = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)

LEAST_LOG = -24
"""Power of 2 of the light at which tables for encoding begin."""
_SHIFT = np.uint32(16)  # bits of a float32 that do not choose the place in a table
_REST = np.uint32((1 << 16) - 1)
_OF_REST = np.float32(2.0**-16)
_FIRST = np.uint32((127 + LEAST_LOG) << 7)
_TINY = np.float32(1e-9)
_LN2 = np.float32(np.log(2))


def _fitted(curve: Any, degree: int) -> tuple[np.float32, ...]:
    """Coefficients of a polynomial over 0..1, from the lowest."""
    best = Chebyshev.interpolate(curve, degree, domain=[0, 1]).convert(kind=Polynomial)
    return tuple(np.float32(each) for each in best.coef)


_L0, _L1, _L2, _L3, _L4, _L5, _L6, _L7 = _fitted(np.log1p, 7)
_E0, _E1, _E2, _E3, _E4, _E5 = _fitted(np.exp2, 5)
_INVERSE_LN2 = np.float32(1 / np.log(2))


def table_of(encode: Any, largest: float) -> Any:
    """(place,) codes 0..`largest` for `encoded`, of a transfer function's `encode`."""
    places = np.arange(-LEAST_LOG * (1 << 7) + 2, dtype=np.uint32) + _FIRST
    light = (places << _SHIFT).view(np.float32).astype(np.float64)
    codes = encode(np.maximum(light - 2.0**LEAST_LOG, 0))
    return np.asarray(codes * largest, np.float32)


@_INSIDE
def _decoded(
    codes: Any, i: int, a: int, b: int, on: Any, table: Any, mixing: Any, mixes: bool, light: Any
) -> None:
    """Light of row `i` from column `a` to `b`, within 0..1; 0 off the screen."""
    for j in range(a, b):
        light[0, j] = table[codes[i, j, 0]]
        light[1, j] = table[codes[i, j, 1]]
        light[2, j] = table[codes[i, j, 2]]
    if mixes:
        for j in range(a, b):
            red, green, blue = light[0, j], light[1, j], light[2, j]
            for p in range(3):
                light[p, j] = mixing[p, 0] * red + mixing[p, 1] * green + mixing[p, 2] * blue
    for p in range(3):
        for j in range(a, b):
            light[p, j] = min(max(light[p, j], np.float32(0)), np.float32(1)) * on[i, j]


@_INSIDE
def _logarithms(values: Any, bits: Any, found: Any, a: int, b: int) -> None:
    """Natural logarithms of float32 `values`, of which `bits` is an int32 view."""
    for j in range(a, b):
        power = (bits[j] >> 23) - 127
        t = values[j] * np.float32(0)
        found[j] = np.float32(power) * _LN2 + t
    for j in range(a, b):
        bits[j] = (bits[j] & 0x7FFFFF) | 0x3F800000
    for j in range(a, b):
        t = values[j] - np.float32(1)
        high = ((_L7 * t + _L6) * t + _L5) * t + _L4
        found[j] += (((high * t + _L3) * t + _L2) * t + _L1) * t + _L0


@_INSIDE
def _exponentials(values: Any, found: Any, bits: Any, a: int, b: int) -> None:
    """Exponentials of float32 `values` into `found`, of which `bits` is an int32 view."""
    for j in range(a, b):
        scaled = min(max(values[j] * _INVERSE_LN2, np.float32(-120)), np.float32(120))
        whole = np.int32(scaled + np.float32(128)) - np.int32(128)  # floor, of what is above -128
        values[j] = scaled - np.float32(whole)
        bits[j] = (whole + 127) << 23
    for j in range(a, b):
        t = values[j]
        found[j] *= ((((_E5 * t + _E4) * t + _E3) * t + _E2) * t + _E1) * t + _E0


@_INSIDE
def _along(coarse: Any, places: Any, parts: Any, found: Any) -> None:
    """A coarse row at all columns: linear between middles."""
    for j in range(len(found)):
        low = coarse[places[j]]
        found[j] = low + (coarse[places[j] + np.uint32(1)] - low) * parts[j]


@_INSIDE
def _expanded(planes: Any, row: int, places: Any, parts: Any, found: Any) -> None:
    """Row `row` of (plane, row, col) coarse planes, whose last column is there twice."""
    last = min(row, planes.shape[1] - 1)
    for k in range(planes.shape[0]):
        _along(planes[k, last], places, parts, found[k])


@_INSIDE
def _place(i: int, side: int, last: int) -> Any:
    """Coarse row below row `i`, and how far it is towards the next."""
    at = min(max((i + 0.5) / side - 0.5, 0.0), float(last))
    low = int(at)
    return low, np.float32(at - low)


@_INSIDE
def _between(low: Any, high: Any, part: Any, found: Any, a: int, b: int) -> None:
    for k in range(found.shape[0]):
        for j in range(a, b):
            found[k, j] = low[k, j] + (high[k, j] - low[k, j]) * part


@_INSIDE
def _rows_of(planes: Any, i: int, side: int, held: Any, places: Any, parts: Any, kept: Any) -> Any:
    """See that `kept` holds the two expanded coarse rows about row `i`; return the part."""
    low, part = _place(i, side, planes.shape[1] - 1)
    if held[0] != low:
        if held[0] == low - 1:
            for k in range(planes.shape[0]):
                for j in range(kept.shape[2]):
                    kept[0, k, j] = kept[1, k, j]
        else:
            _expanded(planes, low, places, parts, kept[0])
        _expanded(planes, low + 1, places, parts, kept[1])
        held[0] = low
    return part


@_INSIDE
def _by_cells(lines: Any, side: int, found: Any, cell_row: int) -> None:
    """Sums over the columns of each cell, of (plane, col) sums over its rows."""
    for k in range(lines.shape[0]):
        for c in range(found.shape[2]):
            some = np.float32(0)
            for j in range(c * side, min((c + 1) * side, lines.shape[1])):
                some += lines[k, j]
            found[k, cell_row, c] = some


@_INSIDE
def _hued(light: Any, gain: Any, floor: Any, hue: Any, a: int, b: int) -> None:
    """The lifted aim of a row, with hues kept over the floor, in place of the light."""
    for j in range(a, b):
        red, green, blue = light[0, j], light[1, j], light[2, j]
        top = max(red, green, blue)
        raised = np.float32(1) - top / max(top * gain[j], _TINY)
        red, green, blue = red * gain[j], green * gain[j], blue * gain[j]
        lack_r = max(floor[0, j] - red, np.float32(0))
        lack_g = max(floor[1, j] - green, np.float32(0))
        lack_b = max(floor[2, j] - blue, np.float32(0))
        shared = hue * raised * max(lack_r, lack_g, lack_b)
        light[0, j] = red + max(lack_r, shared)
        light[1, j] = green + max(lack_g, shared)
        light[2, j] = blue + max(lack_b, shared)


@_INSIDE
def _counted(light: Any, floor: Any, on: Any, i: int, lines: Any, a: int, b: int) -> None:
    """Add a row's subtracted light, and which of it moves with the floor, to (6, col) sums."""
    for p in range(3):
        for j in range(a, b):
            free = light[p, j] - floor[p, j]
            shown = min(max(free, np.float32(0)), np.float32(1)) * on[i, j]
            lines[p, j] += shown
            lines[3 + p, j] += on[i, j] if shown == free else np.float32(0)


@_COMPILED
def moments(
    codes: Any,
    on: Any,
    spans: Any,
    table: Any,
    mixing: Any,
    mixes: bool,
    weights: Any,
    dark: Any,
    block: int,
    cell: int,
    floors: Any,
    places: Any,
    parts: Any,
    found: Any,
    sums: Any,
) -> None:
    """What the base is made of, by blocks; and what subtraction shows of the master, by cells.

    `floors`: (4, cell row, cell col + 1): ambient and reflected light, and the direct gain.
    `spans`: (row, 2): columns between which there is any screen.
    `found`: (6, block row, block col): sums of importance, of logarithms and their squares, without
    and with it, and of luminance.
    `sums`: (6, cell row, cell col): of light, and of the pixels that move with the floor.
    """
    rows, cols = on.shape
    for band in numba.prange(sums.shape[1]):
        light = np.empty((3, cols), np.float32)
        line = np.empty(cols, np.float32)
        bits = line.view(np.int32)
        seen = np.empty(cols, np.float32)
        logs = np.empty(cols, np.float32)
        kept = np.empty((2, 4, cols), np.float32)
        floor = np.empty((4, cols), np.float32)
        held = np.full(1, -9)
        lines = np.zeros((6, cols), np.float32)
        for first in range(band * cell, min((band + 1) * cell, rows), block):
            heap = np.zeros((6, cols), np.float32)
            for i in range(first, min(first + block, rows)):
                a, b = spans[i, 0], spans[i, 1]
                _decoded(codes, i, a, b, on, table, mixing, mixes, light)
                part = _rows_of(floors, i, cell, held, places, parts, kept)
                _between(kept[0], kept[1], part, floor, a, b)
                for j in range(a, b):
                    mean = weights[0] * light[0, j] + weights[1] * light[1, j]
                    mean += weights[2] * light[2, j]
                    line[j] = max(mean * floor[3, j], np.float32(0)) + dark
                    seen[j] = line[j]
                _logarithms(line, bits, logs, a, b)
                for j in range(a, b):
                    here = on[i, j]
                    importance = here * dark / seen[j]
                    heap[0, j] += importance
                    heap[1, j] += here * logs[j]
                    heap[2, j] += here * logs[j] * logs[j]
                    heap[3, j] += importance * logs[j]
                    heap[4, j] += importance * logs[j] * logs[j]
                    heap[5, j] += here * (seen[j] - dark)
                _counted(light, floor, on, i, lines, a, b)
            _by_cells(heap, block, found, first // block)
        _by_cells(lines, cell, sums, band)


@_COMPILED
def gains(
    codes: Any,
    on: Any,
    spans: Any,
    table: Any,
    mixing: Any,
    mixes: bool,
    weights: Any,
    dark: Any,
    aim: Any,
    block: int,
    cell: int,
    bases: Any,
    floors: Any,
    block_places: Any,
    block_parts: Any,
    places: Any,
    parts: Any,
    found: Any,
    sums: Any,
) -> None:
    """How much each pixel is lifted, and what subtraction shows of that.

    `aim`: (missing light, fade, edge).
    `bases`: (4, block row, block col + 1): slopes and offsets of the base of all, and of the dark.
    `found`: (row, col): B' / B.
    """
    rows, cols = on.shape
    missing, fade, edge = aim[0], aim[1], aim[2]
    for band in numba.prange(sums.shape[1]):
        light = np.empty((3, cols), np.float32)
        line = np.empty(cols, np.float32)
        bits = line.view(np.int32)
        logs = np.empty(cols, np.float32)
        kept = np.empty((2, 4, cols), np.float32)
        floor = np.empty((4, cols), np.float32)
        kept_base = np.empty((2, 4, cols), np.float32)
        held, held_base = np.full(1, -9), np.full(1, -9)
        lines = np.zeros((6, cols), np.float32)
        for i in range(band * cell, min((band + 1) * cell, rows)):
            a, b = spans[i, 0], spans[i, 1]
            _decoded(codes, i, a, b, on, table, mixing, mixes, light)
            part = _rows_of(floors, i, cell, held, places, parts, kept)
            _between(kept[0], kept[1], part, floor, a, b)
            for j in range(a, b):
                mean = weights[0] * light[0, j] + weights[1] * light[1, j]
                mean += weights[2] * light[2, j]
                line[j] = max(mean * floor[3, j], np.float32(0)) + dark
            _logarithms(line, bits, logs, a, b)
            part = _rows_of(bases, i, block, held_base, block_places, block_parts, kept_base)
            low, high = kept_base[0], kept_base[1]
            for j in range(a, b):
                log = logs[j]
                slope = low[0, j] + (high[0, j] - low[0, j]) * part
                of_all = slope * log + low[1, j] + (high[1, j] - low[1, j]) * part
                slope = low[2, j] + (high[2, j] - low[2, j]) * part
                of_dark = slope * log + low[3, j] + (high[3, j] - low[3, j]) * part
                share = min(max((log - of_dark) / edge, np.float32(0)), np.float32(1))
                logs[j] = of_dark + (of_all - of_dark) * share
            _exponentials(logs, line, bits, a, b)
            for j in range(a, b):
                base = line[j]
                top = max(light[0, j], light[1, j], light[2, j])
                gain = np.float32(1) + max(missing - base / fade, np.float32(0)) / base
                gain = max(min(gain, np.float32(1) / max(top, _TINY)), np.float32(1))
                found[i, j] = gain
                for p in range(3):
                    light[p, j] *= gain
            _counted(light, floor, on, i, lines, a, b)
        _by_cells(lines, cell, sums, band)


@_COMPILED
def shown(
    codes: Any,
    on: Any,
    spans: Any,
    table: Any,
    mixing: Any,
    mixes: bool,
    lifts: Any,
    hue: Any,
    cell: int,
    below: Any,
    floors: Any,
    places: Any,
    parts: Any,
    sums: Any,
) -> None:
    """What subtraction of `floors` shows of the aim with hues kept over `below`, by cells.

    `lifts` is what `gains` found. A `hue` below 0 leaves hues alone.
    """
    rows, cols = on.shape
    for band in numba.prange(sums.shape[1]):
        light = np.empty((3, cols), np.float32)
        kept = np.empty((2, 4, cols), np.float32)
        kept_below = np.empty((2, 4, cols), np.float32)
        floor = np.empty((4, cols), np.float32)
        held, held_below = np.full(1, -9), np.full(1, -9)
        lines = np.zeros((6, cols), np.float32)
        for i in range(band * cell, min((band + 1) * cell, rows)):
            a, b = spans[i, 0], spans[i, 1]
            _decoded(codes, i, a, b, on, table, mixing, mixes, light)
            if hue < 0:
                for p in range(3):
                    for j in range(a, b):
                        light[p, j] *= lifts[i, j]
            else:
                part = _rows_of(below, i, cell, held_below, places, parts, kept_below)
                _between(kept_below[0], kept_below[1], part, floor, a, b)
                _hued(light, lifts[i], floor, hue, a, b)
            part = _rows_of(floors, i, cell, held, places, parts, kept)
            _between(kept[0], kept[1], part, floor, a, b)
            _counted(light, floor, on, i, lines, a, b)
        _by_cells(lines, cell, sums, band)


@_INSIDE
def _encoded(line: Any, bits: Any, table: Any, a: int, b: int) -> None:
    """Codes of a row's light, of which `bits` is a uint32 view, in its place."""
    for j in range(a, b):
        line[j] = min(max(line[j], np.float32(0)), np.float32(1)) + np.float32(2.0**LEAST_LOG)
    for j in range(a, b):
        place = np.uint32((bits[j] >> _SHIFT) - _FIRST)
        part = np.float32(np.int32(bits[j] & _REST)) * _OF_REST
        low = table[place]
        line[j] = low + (table[place + np.uint32(1)] - low) * part


@_INSIDE
def _rounded(line: Any, noise: Any, begin: Any, largest: Any, a: int, b: int) -> None:
    """Codes with noise, as `domesim.frames.dithering` has it, in their place."""
    for j in range(a, b):
        value = line[j]
        second = noise[1, begin + j]
        inside = min(value, largest - value) >= np.float32(0.5)
        some = noise[0, begin + j] + (second if inside else np.float32(0))
        noisy = max(value + some + np.float32(0.5), np.float32(0))
        line[j] = np.float32(np.int32(min(noisy, largest)))


@_INSIDE
def mixed(light: Any, matrix: Any) -> None:
    """Other primaries of a row, in the light's place."""
    for j in range(light.shape[1]):
        red, green, blue = light[0, j], light[1, j], light[2, j]
        for p in range(3):
            light[p, j] = matrix[p, 0] * red + matrix[p, 1] * green + matrix[p, 2] * blue


@_INSIDE
def _stored(codes: Any, on: Any, i: int, a: int, b: int, light: Any, out: Any) -> None:
    """A row of codes from column `a` to `b`; what is off the screen as it was, and alpha."""
    for j in range(a):
        for p in range(codes.shape[2]):
            out[i, j, p] = codes[i, j, p]
    for j in range(b, np.uint64(on.shape[1])):
        for p in range(codes.shape[2]):
            out[i, j, p] = codes[i, j, p]
    for j in range(a, b):
        for p in range(3, codes.shape[2]):
            out[i, j, p] = codes[i, j, p]
        there = on[i, j] > 0
        out[i, j, 0] = light[0, j] if there else np.float32(codes[i, j, 0])
        out[i, j, 1] = light[1, j] if there else np.float32(codes[i, j, 1])
        out[i, j, 2] = light[2, j] if there else np.float32(codes[i, j, 2])


@_COMPILED
def written(
    codes: Any,
    on: Any,
    spans: Any,
    table: Any,
    mixing: Any,
    mixes: bool,
    lifts: Any,
    hue: Any,
    cell: int,
    below: Any,
    floors: Any,
    places: Any,
    parts: Any,
    back: Any,
    codes_of: Any,
    largest: Any,
    noise: Any,
    shifts: Any,
    out: Any,
) -> None:
    """The frame to project, in codes; what is off the screen as it was.

    `back`: (3, 3) matrix from light to the codes' primaries.
    `codes_of`: As of `table_of`.
    `largest`: The largest code; 0 for formats of floating point, which are not rounded.
    `noise`: (2, place) of -0.5..0.5, more than columns and shifts; zeros for none.
    `shifts`: (row,) places at which noise begins.
    """
    rows, cols = on.shape
    for band in numba.prange(floors.shape[1]):
        light = np.empty((3, cols), np.float32)
        bits = light.view(np.uint32)
        kept = np.empty((2, 4, cols), np.float32)
        kept_below = np.empty((2, 4, cols), np.float32)
        floor = np.empty((4, cols), np.float32)
        held, held_below = np.full(1, -9), np.full(1, -9)
        for i in range(band * cell, min((band + 1) * cell, rows)):
            a, b = spans[i, 0], spans[i, 1]
            _decoded(codes, i, a, b, on, table, mixing, mixes, light)
            part = _rows_of(below, i, cell, held_below, places, parts, kept_below)
            _between(kept_below[0], kept_below[1], part, floor, a, b)
            _hued(light, lifts[i], floor, hue, a, b)
            part = _rows_of(floors, i, cell, held, places, parts, kept)
            _between(kept[0], kept[1], part, floor, a, b)
            for p in range(3):
                for j in range(a, b):
                    free = light[p, j] - floor[p, j]
                    light[p, j] = min(max(free, np.float32(0)), np.float32(1))
            if mixes:
                mixed(light, back)
            for p in range(3):
                _encoded(light[p], bits[p], codes_of, a, b)
                if largest > 0:
                    begin = shifts[i] + np.uint64(p * APART)
                    _rounded(light[p], noise, begin, largest, a, b)
            _stored(codes, on, i, a, b, light, out)


@_COMPILED
def excess(counted: Any, values: Any, level: Any) -> Any:
    """Share of `counted` whose value is above a level, and the mean excess, of (row, col) each."""
    above: Any = 0.0
    more: Any = 0.0
    total: Any = 0.0
    for i in numba.prange(counted.shape[0]):
        line_above, line_more, line_total = np.float32(0), np.float32(0), np.float32(0)
        for j in range(counted.shape[1]):
            value = values[i, j] - level
            line_total += counted[i, j]
            line_above += counted[i, j] if value > 0 else np.float32(0)
            line_more += counted[i, j] * max(value, np.float32(0))
        above += line_above
        more += line_more
        total += line_total
    return above / total, more / total


@_INSIDE
def _added(source: Any, target: Any) -> None:
    for j in range(len(target)):
        target[j] += source[j]


@_INSIDE
def _boxed(planes: Any, i: int, radius: int, found: Any) -> None:
    """Sums over squares about row `i` of (plane, row, col)."""
    rows, cols = planes.shape[1:]
    line = np.empty(cols + 2 * radius, np.float32)
    for k in range(planes.shape[0]):
        line[:] = 0
        for near in range(max(i - radius, 0), min(i + radius + 1, rows)):
            _added(planes[k, near], line[radius : radius + cols])
        found[k] = 0
        for reach in range(2 * radius + 1):
            _added(line[reach : reach + cols], found[k])


@_COMPILED
def bases(
    counted: Any, around: Any, found: Any, radius: int, edge: Any, work: Any, result: Any
) -> None:
    """`compensate.means.coefficients` of all, and by importance, from what `moments` has found.

    `counted`, `around`: (row, col) of blocks: pixels that count, and their sums over boxes.
    `work`: (12, row, col), for use in between.
    `result`: (4, row, col + 1): slopes and offsets, their last column twice.
    """
    rows, cols = counted.shape
    variance = edge * edge
    least = np.float32(1e-30)
    for i in numba.prange(rows):
        sums = np.empty((3, cols), np.float32)
        _boxed(work[:3], i, radius, sums)
        for j in range(cols):
            count, weight = max(around[i, j], least), max(sums[0, j], least)
            of_all, of_dark = sums[1, j] / count, sums[2, j] / weight
            spread = found[2, i, j] + (of_all * counted[i, j] - 2 * found[1, i, j]) * of_all
            work[3, i, j] = max(spread, np.float32(0))
            spread = found[4, i, j] + (of_dark * found[0, i, j] - 2 * found[3, i, j]) * of_dark
            work[4, i, j] = max(spread, np.float32(0))
            work[5, i, j], work[6, i, j], work[7, i, j] = of_all, of_dark, weight
    for i in numba.prange(rows):
        sums = np.empty((2, cols), np.float32)
        _boxed(work[3:5], i, radius, sums)
        for j in range(cols):
            spread = sums[0, j] / max(around[i, j], least)
            slope = spread / (spread + variance)
            work[8, i, j] = counted[i, j] * slope
            work[9, i, j] = counted[i, j] * (np.float32(1) - slope) * work[5, i, j]
            spread = sums[1, j] / work[7, i, j]
            slope = spread / (spread + variance)
            work[10, i, j] = counted[i, j] * slope
            work[11, i, j] = counted[i, j] * (np.float32(1) - slope) * work[6, i, j]
    for i in numba.prange(rows):
        sums = np.empty((4, cols), np.float32)
        _boxed(work[8:12], i, radius, sums)
        for k in range(4):
            for j in range(cols):
                result[k, i, j] = sums[k, j] / max(around[i, j], least)
            result[k, i, cols] = result[k, i, cols - 1]
