"""Passes over the pixels of a pair, compiled by Numba; see `compensate.live.dome_loops`.

Light is (6, col) of one row: three primaries of the left view, then of the right.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from compensate.live.dome_loops import (
    _COMPILED,
    _INSIDE,
    _TINY,
    _added,
    _along,
    _between,
    _by_cells,
    _decoded,
    _encoded,
    _rounded,
    _rows_of,
    mixed,
)
from compensate.live.noise import APART


@_INSIDE
def _leaked(source: Any, factor: Any, target: Any) -> None:
    if factor != 0:
        for j in range(len(target)):
            target[j] += factor * source[j]


@_INSIDE
def _leak(source: Any, row: Any, own: int, work: Any) -> Any:
    """What a primary gets of the other view's (primary, col), over a factor: both."""
    if row[own - 1] == 0 and row[own - 2] == 0:
        return source[own], row[own]
    work[:] = 0
    for q in range(3):
        _leaked(source[q], row[q], work)
    return work, np.float32(1)


@_INSIDE
def _clipped(wanted: Any, offset: Any, factor: Any, share: Any, leak: Any, found: Any) -> None:
    for j in range(len(found)):
        left = wanted[j] - offset - factor * share[j] * leak[j]
        found[j] = min(max(left, np.float32(0)), np.float32(1))


@_INSIDE
def _subtracted(light: Any, share: Any, matrices: Any, black: Any, turns: int, found: Any) -> None:
    """What to project so that light is seen: (6, col), of a row's (2, col) share."""
    work = np.empty(light.shape[1], np.float32)
    for k in range(3, 6):
        _clipped(light[k], black[1, k - 3], np.float32(0), share[1], light[k], found[k])
    for turn in range(turns):
        view = turn % 2
        for p in range(3):
            other = found[3:] if view == 0 else found[:3]
            leak, factor = _leak(other, matrices[view, p], p, work)
            k = 3 * view + p
            _clipped(light[k], black[view, p], factor, share[view], leak, found[k])


@_INSIDE
def _too_bright(
    shown: Any, offset: Any, factor: Any, share: Any, leak: Any, wanted: Any, found: Any
) -> None:
    for j in range(len(found)):
        seen = shown[j] + factor * share[j] * leak[j] + offset
        found[j] = max(seen - wanted[j], np.float32(0))


@_INSIDE
def _ghosts(light: Any, shown: Any, share: Any, matrices: Any, black: Any, found: Any) -> None:
    """How much more is seen of `shown` than wanted."""
    work = np.empty(light.shape[1], np.float32)
    for k in range(6):
        view, p = k // 3, k % 3
        other = shown[3:] if view == 0 else shown[:3]
        leak, factor = _leak(other, matrices[view, p], p, work)
        _too_bright(shown[k], black[view, p], factor, share[view], leak, light[k], found[k])


@_COMPILED
def ghosts(
    left: Any,
    right: Any,
    on: Any,
    table: Any,
    mixing: Any,
    mixes: bool,
    weights: Any,
    shares: Any,
    cell: int,
    places: Any,
    parts: Any,
    matrices: Any,
    black: Any,
    turns: int,
    block: int,
    counts: Any,
    found: Any,
    near: Any,
) -> None:
    """Means over blocks of what subtraction leaves, of its square, and of luminance.

    `left`, `right`: (row, col, channel) codes.
    `shares`: (2, cell row, cell col + 1): the map.
    `counts`: (block row, block col): one over the pixels of each block.
    `found`: (12, block row, block col): of the left view, of the right, and of the squares of both.
    `near`: (2, block row, block col): luminance.
    """
    rows, cols = on.shape
    for band in numba.prange(found.shape[1]):
        light = np.empty((6, cols), np.float32)
        shown = np.empty((6, cols), np.float32)
        ghost = np.empty((6, cols), np.float32)
        kept = np.empty((2, 2, cols), np.float32)
        share = np.empty((2, cols), np.float32)
        held = np.full(1, -9)
        lines = np.zeros((14, cols), np.float32)
        for i in range(band * block, min((band + 1) * block, rows)):
            a, b = np.uint64(0), np.uint64(cols)
            _decoded(left, i, a, b, on, table, mixing, mixes, light[:3])
            _decoded(right, i, a, b, on, table, mixing, mixes, light[3:])
            part = _rows_of(shares, i, cell, held, places, parts, kept)
            _between(kept[0], kept[1], part, share, a, b)
            _subtracted(light, share, matrices, black, turns, shown)
            _ghosts(light, shown, share, matrices, black, ghost)
            for k in range(6):
                for j in range(cols):
                    lines[k, j] += ghost[k, j]
                    lines[6 + k, j] += ghost[k, j] * ghost[k, j]
            for view in range(2):
                for j in range(cols):
                    mean = weights[0] * light[3 * view, j] + weights[1] * light[3 * view + 1, j]
                    mean += weights[2] * light[3 * view + 2, j]
                    lines[12 + view, j] += max(mean, np.float32(0))
        _by_cells(lines[:12], block, found, band)
        _by_cells(lines[12:], block, near, band)
        for c in range(counts.shape[1]):
            for k in range(12):
                found[k, band, c] *= counts[band, c]
            for view in range(2):
                near[view, band, c] *= counts[band, c]


@_COMPILED
def halved(planes: Any, block: int, found: Any) -> None:
    """Means of (plane, row, col) over squares of `block`, the last cut off."""
    rows, cols = planes.shape[1:]
    for i in numba.prange(found.shape[1]):
        last = min((i + 1) * block, rows)
        line = np.empty(cols, np.float32)
        for k in range(planes.shape[0]):
            line[:] = 0
            for y in range(i * block, last):
                _added(planes[k, y], line)
            for j in range(found.shape[2]):
                end = min((j + 1) * block, cols)
                some = np.float32(0)
                for x in range(j * block, end):
                    some += line[x]
                found[k, i, j] = some / np.float32((last - i * block) * (end - j * block))


@_INSIDE
def _weighed(line: Any, table: Any, found: Any) -> None:
    """Local means of a row, by weights of `compensate.live.smoothing`."""
    count, kept = len(line), table.shape[0]
    reach = table.shape[1] // 2
    found[:] = 0
    if line.max() <= 0:
        return
    inner = max(count - 2 * reach, 0)
    if inner:
        for d in range(2 * reach + 1):
            _leaked(line[d : d + inner], table[kept - 1, d], found[reach : reach + inner])
    for j in range(count):
        if inner and reach <= j < count - reach:
            continue
        far = count - 1 - j
        row, sign = min(j, far, kept - 1), -1 if far < j else 1
        some = np.float32(0)
        for d in range(max(-reach, -j), min(reach, far) + 1):
            some += table[row, reach + sign * d] * line[j + d]
        found[j] = some


@_COMPILED
def smoothed(planes: Any, across: Any, down: Any, work: Any) -> None:
    """Local means of (plane, row, col), in their place."""
    rows = planes.shape[1]
    kept, reach = down.shape[0], down.shape[1] // 2
    for at in numba.prange(planes.shape[0] * rows):
        k, i = at // rows, at % rows
        _weighed(planes[k, i], across, work[k, i])
    for at in numba.prange(planes.shape[0] * rows):
        k, i = at // rows, at % rows
        far = rows - 1 - i
        row, sign = min(i, far, kept - 1), -1 if far < i else 1
        planes[k, i] = 0
        for d in range(max(-reach, -i), min(reach, far) + 1):
            _leaked(work[k, i + d], down[row, reach + sign * d], planes[k, i])


@_INSIDE
def _higher(mean: Any, square: Any, lift: Any, veil: Any) -> None:
    for j in range(len(veil)):
        found = min(lift * mean[j], square[j] / max(mean[j], _TINY))
        veil[j] = max(veil[j], found)


@_COMPILED
def raised(
    means: Any, lift: Any, weights: Any, block: int, places: Any, parts: Any, first: bool,
    veil: Any, own: Any,
) -> None:  # fmt: skip
    """Raise the veil of blocks to that of an octave; of the `first`, note how bright it may be.

    `means`: (12, row, col) as of `ghosts`, smoothed.
    `veil`, `own`: (6, block row, block col), and (2, block row, block col) of luminance.
    """
    rows, cols = means.shape[1:]
    for i in numba.prange(veil.shape[1]):
        if block == 1 and not first:
            for k in range(6):
                _higher(means[k, i], means[6 + k, i], lift, veil[k, i])
            continue
        at = min(max((i + 0.5) / block - 0.5, 0.0), float(rows - 1))
        low = int(at)
        part = np.float32(at - low)
        coarse = np.empty(cols + 1, np.float32)
        lines = np.empty((2, veil.shape[2]), np.float32)
        for k in range(6):
            for peak in range(2 if first else 1):
                for side in range(2):
                    row = min(low + side, rows - 1)
                    for j in range(cols):
                        mean = means[k, row, j]
                        value = means[6 + k, row, j] / max(mean, _TINY)
                        coarse[j] = value if peak else min(lift * mean, value)
                    coarse[cols] = coarse[cols - 1]
                    _along(coarse, places, parts, lines[side])
                if peak:
                    weight = weights[k % 3]
                    for j in range(veil.shape[2]):
                        some = lines[0, j] + (lines[1, j] - lines[0, j]) * part
                        before = own[k // 3, i, j] if k % 3 else np.float32(0)
                        own[k // 3, i, j] = before + weight * some
                else:
                    for j in range(veil.shape[2]):
                        some = lines[0, j] + (lines[1, j] - lines[0, j]) * part
                        veil[k, i, j] = some if first else max(veil[k, i, j], some)


@_COMPILED
def written(
    left: Any,
    right: Any,
    on: Any,
    table: Any,
    mixing: Any,
    mixes: bool,
    shares: Any,
    cell: int,
    places: Any,
    parts: Any,
    matrices: Any,
    black: Any,
    turns: int,
    block: int,
    veils: Any,
    block_places: Any,
    block_parts: Any,
    back: Any,
    codes_of: Any,
    largest: Any,
    noise: Any,
    shifts: Any,
    out_left: Any,
    out_right: Any,
) -> None:
    """The frames to project, in codes.

    `veils`: (8, block row, block col + 1): of both views, and how much fainter they are.
    """
    rows, cols = on.shape
    for band in numba.prange(veils.shape[1]):
        light = np.empty((6, cols), np.float32)
        shown = np.empty((6, cols), np.float32)
        bits = shown.view(np.uint32)
        ghost = np.empty((6, cols), np.float32)
        veil = np.empty((8, cols), np.float32)
        kept_veils = np.empty((2, 8, cols), np.float32)
        kept = np.empty((2, 2, cols), np.float32)
        share = np.empty((2, cols), np.float32)
        held, held_veils = np.full(1, -9), np.full(1, -9)
        for i in range(band * block, min((band + 1) * block, rows)):
            a, b = np.uint64(0), np.uint64(cols)
            _decoded(left, i, a, b, on, table, mixing, mixes, light[:3])
            _decoded(right, i, a, b, on, table, mixing, mixes, light[3:])
            part = _rows_of(shares, i, cell, held, places, parts, kept)
            _between(kept[0], kept[1], part, share, a, b)
            _subtracted(light, share, matrices, black, turns, shown)
            _ghosts(light, shown, share, matrices, black, ghost)
            part = _rows_of(veils, i, block, held_veils, block_places, block_parts, kept_veils)
            _between(kept_veils[0], kept_veils[1], part, veil, a, b)
            for k in range(6):
                for j in range(cols):
                    rim = max(veil[k, j] - ghost[k, j], np.float32(0))
                    light[k, j] += rim * veil[6 + k // 3, j]
            _subtracted(light, share, matrices, black, turns, shown)
            if mixes:
                mixed(shown[:3], back)
                mixed(shown[3:], back)
            for k in range(6):
                _encoded(shown[k], bits[k], codes_of, a, b)
                if largest > 0:
                    begin = shifts[i] + np.uint64(k * APART)
                    _rounded(shown[k], noise, begin, largest, a, b)
            for j in range(cols):
                for p in range(3):
                    out_left[i, j, p] = shown[p, j]
                    out_right[i, j, p] = shown[3 + p, j]
                for p in range(3, left.shape[2]):
                    out_left[i, j, p] = left[i, j, p]
                    out_right[i, j, p] = right[i, j, p]
