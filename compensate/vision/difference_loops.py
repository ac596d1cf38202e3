"""`differences` by rows, each pass fused, compiled by Numba: the same but for rounding.

Only `differences` imports this module: Numba is of the extra ``fast``. Nothing here runs in
parallel: whoever calls gives rows to threads.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

_COMPILED: Any = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"nsz"})
_INSIDE: Any = numba.njit(
    forceinline=True, cache=True, nogil=True, error_model="numpy", fastmath={"nsz"}
)


def _fitted(curve: Any, degree: int) -> tuple[np.float32, ...]:
    """Coefficients of a polynomial over 0..1, from the lowest."""
    best = Chebyshev.interpolate(curve, degree, domain=[0, 1]).convert(kind=Polynomial)
    return tuple(np.float32(each) for each in best.coef)


_L0, _L1, _L2, _L3, _L4, _L5, _L6, _L7 = _fitted(lambda t: np.log2(1 + t), 7)
_E0, _E1, _E2, _E3, _E4, _E5 = _fitted(np.exp2, 5)


@_INSIDE
def _logarithm(value: Any) -> Any:
    """Logarithm to base 2 of a float32 above 0; -127 of 0. The C library's makes no vectors."""
    bits = np.float32(value).view(np.int32)
    whole = np.float32((bits >> np.int32(23)) - np.int32(127))
    t = np.int32((bits & np.int32(0x7FFFFF)) | np.int32(0x3F800000)).view(np.float32)
    t -= np.float32(1)
    high = ((_L7 * t + _L6) * t + _L5) * t + _L4
    return whole + ((((high * t + _L3) * t + _L2) * t + _L1) * t + _L0)


@_INSIDE
def _power(value: Any, exponent: Any) -> Any:
    """A float32 of at least 0 to the power of one above 0; 2^-126 at least."""
    scaled = min(max(_logarithm(value) * exponent, np.float32(-126)), np.float32(126))
    whole = np.int32(scaled + np.float32(128)) - np.int32(128)  # floor, of what is above -128
    t = scaled - np.float32(whole)
    scale = np.int32((whole + np.int32(127)) << np.int32(23)).view(np.float32)
    return scale * (((((_E5 * t + _E4) * t + _E3) * t + _E2) * t + _E1) * t + _E0)


@_INSIDE
def _mirrored(place: int, size: int) -> Any:
    """A place within 0..size - 1; beyond an edge the picture is mirrored, as often as it takes."""
    while place < 0 or place >= size:
        place = -1 - place if place < 0 else 2 * size - 1 - place
    return place


@_COMPILED
def reduce_rows(plane: Any, taps: Any, found: Any, start: int, stop: int) -> None:
    """Rows of `differences.reduced` of one (row, col) plane."""
    rows, cols = plane.shape
    outer, between, middle = taps
    line = np.empty(cols + 4, np.float32)
    for i in range(start, stop):
        first, second = plane[_mirrored(2 * i - 2, rows)], plane[_mirrored(2 * i - 1, rows)]
        third, fourth = plane[2 * i], plane[_mirrored(2 * i + 1, rows)]
        fifth = plane[_mirrored(2 * i + 2, rows)]
        for j in range(cols):
            line[j + 2] = outer * (first[j] + fifth[j]) + between * (second[j] + fourth[j])
            line[j + 2] += middle * third[j]
        for k in (-2, -1, cols, cols + 1):
            line[k + 2] = line[_mirrored(k, cols) + 2]
        for j in range(found.shape[1]):
            at = 2 * j
            total = outer * (line[at] + line[at + 4]) + between * (line[at + 1] + line[at + 3])
            found[i, j] = total + middle * line[at + 2]


@_INSIDE
def _expand_row(plane: Any, taps: Any, i: int, line: Any, found: Any) -> None:
    """Row `i` of `differences.expanded` of a plane; `line` is room for one of its rows."""
    rows, cols = plane.shape
    outer, between, middle = taps
    here = plane[i // 2]
    after = plane[min(i // 2 + 1, rows - 1)]
    if i % 2:
        for j in range(cols):
            line[j] = between * (here[j] + after[j])
    else:
        before = plane[max(i // 2 - 1, 0)]
        for j in range(cols):
            line[j] = middle * here[j] + outer * (before[j] + after[j])
    for j in range(found.shape[0] // 2):
        left, right = line[max(j - 1, 0)], line[min(j + 1, cols - 1)]
        found[2 * j] = middle * line[j] + outer * (left + right)
        found[2 * j + 1] = between * (line[j] + right)
    if found.shape[0] % 2:
        last = cols - 1
        found[2 * last] = middle * line[last] + outer * (line[max(last - 1, 0)] + line[last])


@_INSIDE
def _smooth_row(values: Any, kernel: Any, padded: Any, found: Any) -> None:
    """Values smoothed by a symmetric kernel, of which one half is given; `padded` is room."""
    size, reach = len(values), len(kernel) - 1
    for j in range(size):
        padded[j + reach] = values[j]
        found[j] = kernel[0] * values[j]
    for t in range(1, reach + 1):
        padded[reach - t] = values[_mirrored(-t, size)]
        padded[reach + size - 1 + t] = values[_mirrored(size - 1 + t, size)]
    for t in range(1, reach + 1):
        for j in range(size):
            found[j] += kernel[t] * (padded[j + reach - t] + padded[j + reach + t])


@_INSIDE
def _find_light(around: Any, constants: Any, least: int, relative: Any, step: Any) -> None:
    """What contrasts are multiplied by, and the place of the wanted one's light in tables."""
    peak, darkest, steps, _ = constants
    for p in range(2):
        for j in range(around.shape[1]):
            relative[p, j] = np.float32(1) / (max(around[p, j], darkest) * peak)
    for j in range(around.shape[1]):
        step[j] = int(np.rint(_logarithm(max(around[0, j], darkest)) * steps)) - least


@_COMPILED
def compare_rows(
    fine: Any,
    coarse: Any,
    constants: Any,
    taps: Any,
    kernel: Any,
    table: Any,
    least: int,
    found: Any,
    start: int,
    stop: int,
) -> None:
    """What both pictures have, smoothed along rows, and |T - T'|^p of what only one has.

    `fine` and `coarse` are levels of one view, (picture, mechanism, row, col); `table` is
    (mechanism, step of luminance) from step `least`; both are `found`, (2, mechanism, row, col).
    """
    power, cols = constants[3], fine.shape[3]
    line = np.empty(coarse.shape[3], np.float32)
    padded = np.empty(cols + 2 * len(kernel), np.float32)
    around, relative = np.empty((2, cols), np.float32), np.empty((2, cols), np.float32)
    contrast, step = np.empty((2, cols), np.float32), np.empty(cols, np.int64)
    own = np.empty(cols, np.float32)
    for i in range(start, stop):
        for k in range(fine.shape[1]):
            for p in range(2):
                _expand_row(coarse[p, k], taps, i, line, around[p])
            if k == 0:
                _find_light(around, constants, least, relative, step)
            sensitive = table[k]
            for j in range(cols):
                own[j] = sensitive[step[j]]
            for p in range(2):
                values = fine[p, k, i]
                for j in range(cols):
                    contrast[p, j] = (values[j] - around[p, j]) * relative[p, j] * own[j]
            for j in range(cols):
                own[j] = min(abs(contrast[0, j]), abs(contrast[1, j]))
            _smooth_row(own, kernel, padded, found[0, k, i])
            apart = found[1, k, i]
            for j in range(cols):
                apart[j] = _power(abs(contrast[1, j] - contrast[0, j]), power)


@_COMPILED
def mask_rows(
    compared: Any,
    constants: Any,
    powers: Any,
    taps: Any,
    kernel: Any,
    below: Any,
    total: Any,
    start: int,
    stop: int,
) -> None:
    """Writes the sum of those `below`, expanded, and a band's masked difference into `total`.

    `compared` is what `compare_rows` found; `below` and `total` are (row, col).
    """
    masking, most, gain = constants
    _, mechanisms, rows, cols = compared.shape
    line, both = np.empty(below.shape[1], np.float32), np.empty(cols, np.float32)
    fourth = np.empty(cols, np.float32)
    for i in range(start, stop):
        _expand_row(below, taps, i, line, total[i])
        fourth[:] = np.float32(0)
        for k in range(mechanisms):
            here = compared[0, k, i]
            for j in range(cols):
                both[j] = kernel[0] * here[j]
            for t in range(1, len(kernel)):
                up = compared[0, k, _mirrored(i - t, rows)]
                down = compared[0, k, _mirrored(i + t, rows)]
                for j in range(cols):
                    both[j] += kernel[t] * (up[j] + down[j])
            apart, exponent = compared[1, k, i], powers[k]
            for j in range(cols):
                one = apart[j] / (np.float32(1) + _power(masking * both[j], exponent))
                one = most * one / (most + one)
                fourth[j] += (one * one) * (one * one)
        for j in range(cols):
            total[i, j] += gain * math.sqrt(math.sqrt(fourth[j]))
