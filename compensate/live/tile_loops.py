"""What the passes over domes and pairs share, compiled by Numba: tiles of rows in planes.

Only `compensate.live.dome`, `pair` and their loops import this module: Numba is of the extra
``fast``. A tile is some of a row's columns: (plane, col) float32, which stay in a core's cache. Its
planes lie as far apart as the compiler is told, but no power of two, for they would push each other
out. It can then prove that they do not overlap, and makes vectors of whole formulas, of loops that
hold no other. Places in arrays are unsigned: Numba takes signed numbers for places from the end,
too, and then has no vectors. Numba does not see that a loop of another file has changed: whoever
edits this file deletes ``__pycache__/*.nb?``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from compensate.live.coding import Coding, PixelFormat
from compensate.live.noise import APART, noise_of

COMPILED: Any = numba.njit(
    parallel=True, cache=True, nogil=True, error_model="numpy", fastmath=True
)
INSIDE: Any = numba.njit(
    forceinline=True, cache=True, nogil=True, error_model="numpy", fastmath=True
)

LEAST_LOG = -24
"""Power of 2 of the light at which tables for encoding begin."""
TINY = np.float32(1e-9)
ZERO, ONE = np.float32(0), np.float32(1)
START, NEXT = np.uint64(0), np.uint64(1)
"""The first place of an array, and the step from one to the next: unsigned, see above."""

_LEAST = np.float32(2.0**LEAST_LOG)
_SHIFT = np.uint32(16)  # bits of a float32 that do not choose the place in a table
_REST = np.uint32((1 << 16) - 1)
_OF_REST = np.float32(2.0**-16)
_FIRST = np.uint32((127 + LEAST_LOG) << 7)
_AFTER = np.uint32(1)
_HALF = np.float32(0.5)
LINE = np.uint64(16)
"""Numbers of a line of the cache, and of a vector."""
_SOME = np.uint64(512)
"""Columns that are encoded at once: they leave room for the table in a core's first cache."""
_TWO, _THREE, _FOUR = np.uint64(2), np.uint64(3), np.uint64(4)
_LN2 = np.float32(np.log(2))
_INVERSE_LN2 = np.float32(1 / np.log(2))


def _fitted(curve: Any, degree: int) -> tuple[np.float32, ...]:
    """Coefficients of a polynomial over 0..1, from the lowest."""
    best = Chebyshev.interpolate(curve, degree, domain=[0, 1]).convert(kind=Polynomial)
    return tuple(np.float32(each) for each in best.coef)


_L0, _L1, _L2, _L3, _L4, _L5, _L6, _L7 = _fitted(np.log1p, 7)
_E0, _E1, _E2, _E3, _E4, _E5 = _fitted(np.exp2, 5)


class Code(NamedTuple):
    """How raw frames are read and written.

    Parameters
    ----------
    channels
        Of a pixel.
    table
        (code,) light of each code; within 0..1 if nothing is mixed.
    mixes, mixing, back
        Whether codes have primaries of their own; (3, 3) matrices from them to light, and back.
    codes_of
        (place,) codes of light, see `encoded`.
    largest
        The largest code; 0 of formats of floating point, which are not rounded.
    noise
        (2, place) of -0.5..0.5, more than columns and shifts; zeros for none.
    keeps, kept
        Whether there is light without a picture that belongs to the grade, and (view primary,) how
        much.
    """

    channels: np.uint64
    table: NDArray[np.float32]
    mixes: bool
    mixing: NDArray[np.float32]
    back: NDArray[np.float32]
    codes_of: NDArray[np.float32]
    largest: np.float32
    noise: NDArray[np.float32]
    keeps: bool
    kept: NDArray[np.float32]


def code_of(
    coding: Coding, pixels: PixelFormat, cols: int, kept: NDArray[np.floating], *, dithers: bool
) -> Code:
    """Tables of a layout for tiles of `cols` columns in all, for the grade's (view, primary)."""
    places = np.arange(-LEAST_LOG * (1 << 7) + 2, dtype=np.uint32) + _FIRST
    light = (places << _SHIFT).view(np.float32).astype(np.float64)
    codes = coding.curve_of_each.encode(np.maximum(light - 2.0**LEAST_LOG, 0))
    table = coding.table(pixels)
    return Code(
        channels=np.uint64(pixels.channels),
        table=table if coding.mixes else np.clip(table, 0, 1),
        mixes=coding.mixes,
        mixing=coding.mixing.astype(np.float32),
        back=np.linalg.inv(coding.mixing).astype(np.float32),
        codes_of=np.asarray(codes * (pixels.largest or 1), np.float32),
        largest=np.float32(pixels.largest),
        noise=noise_of(cols) * np.float32(dithers),
        keeps=bool(kept.any()),
        kept=kept.ravel().astype(np.float32),
    )


class About(NamedTuple):
    """A row between rows of a coarse grid: those below and above it, and how far it is."""

    low: Any
    high: Any
    part: Any


@INSIDE
def within(value: Any) -> Any:
    """The value, at least 0 and at most 1."""
    return min(max(value, ZERO), ONE)


@INSIDE
def logarithm(value: Any) -> Any:
    """Natural logarithm of a float32 above 0."""
    bits = np.float32(value).view(np.int32)
    power = np.float32(np.int32(bits >> np.int32(23))) - np.float32(127)
    t = np.int32((bits & np.int32(0x7FFFFF)) | np.int32(0x3F800000)).view(np.float32) - ONE
    high = ((_L7 * t + _L6) * t + _L5) * t + _L4
    return power * _LN2 + ((((high * t + _L3) * t + _L2) * t + _L1) * t + _L0)


@INSIDE
def exponential(value: Any) -> Any:
    """Exponential of a float32."""
    scaled = min(max(value * _INVERSE_LN2, np.float32(-120)), np.float32(120))
    # Numba would count whole numbers in 64 bits
    whole = np.int32(scaled + np.float32(128))  # floor, of what is above -128
    t = scaled - (np.float32(whole) - np.float32(128))
    power = np.int32(np.int32(whole - np.int32(1)) << np.int32(23)).view(np.float32)
    return power * (((((_E5 * t + _E4) * t + _E3) * t + _E2) * t + _E1) * t + _E0)


@INSIDE
def mixed(w: Any, k: int, matrix: Any, a: Any, b: Any) -> None:
    """Other primaries, in the place of planes `k` to `k` + 2."""
    for j in range(a, b):
        red, green, blue = w[k, j], w[k + 1, j], w[k + 2, j]
        w[k, j] = matrix[0, 0] * red + matrix[0, 1] * green + matrix[0, 2] * blue
        w[k + 1, j] = matrix[1, 0] * red + matrix[1, 1] * green + matrix[1, 2] * blue
        w[k + 2, j] = matrix[2, 0] * red + matrix[2, 1] * green + matrix[2, 2] * blue


@INSIDE
def decoded(code: Any, codes: Any, i: Any, first: Any, a: Any, b: Any, w: Any, k: int) -> None:
    """Light within 0..1 into planes from `k`: of columns `first` + `a` to `b` of row `i`.

    What the grade keeps of light without a picture is added.
    `codes`: (row, sample).
    """
    for j in range(a, b):
        at = (first + j) * code.channels
        w[k, j] = code.table[codes[i, at]]
        w[k + 1, j] = code.table[codes[i, at + NEXT]]
        w[k + 2, j] = code.table[codes[i, at + _TWO]]
    if code.mixes:
        mixed(w, k, code.mixing, a, b)
        for p in range(3):
            for j in range(a, b):
                w[k + p, j] = within(w[k + p, j])
    if code.keeps:
        for p in range(3):
            for j in range(a, b):
                w[k + p, j] += code.kept[k + p]


@INSIDE
def encoded(code: Any, w: Any, k: int, a: Any, b: Any, noise: Any, places: Any, coded: Any) -> None:
    """Codes of the light in planes from `k`, which is lost, into `coded` (3, col).

    A table is linear in between: its places are a float's exponent and the first 7 bits after it.
    Noise is as of `domesim.frames.dithering`, from place `noise` on.
    """
    if code.mixes:
        mixed(w, k, code.back, a, b)
    for p in range(3):
        for begin in range(a, b, _SOME):
            end = min(begin + _SOME, b)
            for j in range(begin, end):
                bits = np.float32(within(w[k + p, j]) + _LEAST).view(np.uint32)
                places[j] = (bits >> _SHIFT) - _FIRST
                w[k + p, j] = np.float32(np.int32(bits & _REST)) * _OF_REST
            for j in range(begin, end):
                place = places[j]
                low = code.codes_of[place]
                w[k + p, j] = low + (code.codes_of[place + _AFTER] - low) * w[k + p, j]
            if code.largest <= ZERO:
                for j in range(begin, end):
                    coded[p, j] = w[k + p, j]
                continue
            at = noise + np.uint64(p * APART)
            for j in range(begin, end):
                value = w[k + p, j]
                second = code.noise[1, at + j]
                inside = min(value, code.largest - value) >= _HALF
                some = code.noise[0, at + j] + (second if inside else ZERO)
                coded[p, j] = np.int32(min(max(value + some + _HALF, ZERO), code.largest))


@INSIDE
def stored(code: Any, codes: Any, i: Any, first: Any, a: Any, b: Any, coded: Any, out: Any) -> None:
    """Write codes of columns `first` + `a` to `b` of row `i`; alpha stays as it was in `codes`."""
    if code.channels == _THREE:  # a step that is known makes vectors
        for j in range(a, b):
            at = (first + j) * _THREE
            out[i, at], out[i, at + NEXT], out[i, at + _TWO] = coded[0, j], coded[1, j], coded[2, j]
    else:
        for j in range(a, b):
            at = (first + j) * _FOUR
            out[i, at], out[i, at + NEXT], out[i, at + _TWO] = coded[0, j], coded[1, j], coded[2, j]
            out[i, at + _THREE] = codes[i, at + _THREE]


@INSIDE
def copied(code: Any, codes: Any, i: Any, begin: Any, end: Any, out: Any) -> None:
    """Write columns `begin` to `end` of row `i` as they were."""
    for at in range(begin * code.channels, end * code.channels):
        out[i, at] = codes[i, at]


def places_along(count: int, side: int, cells: int) -> tuple[NDArray[np.uint32], Any]:
    """(col,) the coarse column below each of `count` columns, and how far it is to the next.

    Coarse columns are `side` columns each: linear between their middles, flat beyond the last.
    """
    at = np.clip((np.arange(count) + 0.5) / side - 0.5, 0, cells - 1)
    low = np.floor(at).astype(np.uint32)
    return low, (at - low).astype(np.float32)


@INSIDE
def widened_row(
    coarse: Any, p: Any, i: Any, lows: Any, parts: Any, first: Any, wide: Any, out: Any, k: Any
) -> None:
    """Row `i` of plane `p` of a coarse array, at columns from `first` on, into plane `k`."""
    last = np.uint64(coarse.shape[2] - 1)
    for j in range(START, wide):
        at = np.uint64(lows[first + j])
        low = coarse[p, i, at]
        out[k, j] = low + (coarse[p, i, min(at + NEXT, last)] - low) * parts[first + j]


@COMPILED
def widened(coarse: Any, lows: Any, parts: Any, out: Any) -> None:
    """Coarse (plane, row, col) at all columns."""
    count, rows = coarse.shape[:2]
    cols = np.uint64(out.shape[2])
    for i in numba.prange(rows):
        for p in range(count):
            widened_row(coarse, p, i, lows, parts, START, cols, out[p], i)


@INSIDE
def about(i: Any, side: int, planes: Any) -> Any:
    """Where row `i` is among the rows of (plane, row, col), of `side` pixels each."""
    last = planes.shape[1] - 1
    at = min(max((i + 0.5) / side - 0.5, 0.0), float(last))
    low = np.uint64(at)
    return About(low, min(low + NEXT, np.uint64(last)), np.float32(at - np.float64(low)))


@INSIDE
def between(planes: Any, k: int, row: Any, j: Any) -> Any:
    """Plane `k` in a row `about`, at a column."""
    low = planes[k, row.low, j]
    return low + (planes[k, row.high, j] - low) * row.part


@INSIDE
def summed(
    w: Any, k: int, planes: int, first: Any, wide: Any, side: Any, row: Any, sums: Any
) -> None:
    """Add planes of a tile to sums over the columns of cells or blocks, and begin anew."""
    for p in range(planes):
        j, c = START, first // side
        while j < wide:
            end = min((c + NEXT) * side - first, wide)
            some = ZERO
            while j < end:
                some += w[k + p, j]
                j += NEXT
            sums[p, row, c] += some
            c += NEXT
        for place in range(START, wide):
            w[k + p, place] = ZERO
