"""What the eye sees of the differences between two pictures, at all its scales, in JOD.

The mechanisms of castleCSF look at each band of frequencies b, an octave wide. With R_k,b the
response of mechanism k (`castle.DKL_FROM_XYZ`) at level b of a Gaussian pyramid, and ^ an expansion
to the level below, a band's contrast is relative to the light around:

    C_k = (R_k,b - ^R_k,b+1) / ^R_achromatic,b+1

It counts in multiples of its threshold at the band's peak and the local luminance of the wanted
picture, T_k = S_k C_k / g_b, with g_b the band's gain at its peak: a grating there that castleCSF
has at its threshold has T = 1. What both pictures have masks what only one has:

    D_k = |T_k - T'_k|^p / (1 + (c G * min(|T_k|, |T'_k|))^q_k),    D_k <- D_max D_k / (D_max + D_k)

G is a Gaussian, for what masks need not lie on the same pixel. Mechanisms count as
D_b = (sum_k D_k^4)^(1/4), and bands as they add up to a picture, D = sum_b ^...^(g_b D_b). The
coarsest level, the base band, is compared as shares of each picture's mean light, to which the eye
adapts: a veil over all of it is seen by the contrast that it takes, and by its hue. At last

    v = a (s D)^e

is the quality that would be lost if all of the picture were like that place, in just-objectionable
differences (JOD): of two pictures 1 JOD apart, 75 of 100 people prefer the better.

All this is ColorVideoVDP's model of a still, with its constants. Its mechanisms mask each other
besides, which makes no better mask (``validation/notes/0009``); it takes 1/2 for g_b; its weights
of 1.45 for red-green and 0.97 for all are left out; and its table has twice castleCSF's sensitivity
for yellow-violet (``validation/notes/0012``), so that this model minds such differences less. So
when `validation` asks ColorVideoVDP how well this predicts what is seen, it does not ask a
stranger.

Mantiuk, R. K., Hanji, P., Ashraf, M., Asano, Y., Chapiro, A. (2024), "ColorVideoVDP: A visual
difference predictor for image, video and display distortions", ACM Trans. Graph. 43(4), 129; the
constants are those of its authors' version 0.5.7 (cvvdp_parameters.json, MIT licence). The pyramid
is that of Burt, P. J., Adelson, E. H. (1983), "The Laplacian pyramid as a compact image code", IEEE
Trans. Commun. 31(4), 532-540, a = 0.4.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.vision.castle import DETAIL, DKL_FROM_XYZ, MECHANISMS, castle
from domesim.errors import InputError
from domesim.light.strips import in_strips

Floats = NDArray[np.floating[Any]]
Planes = NDArray[np.float32]

LOWEST = 0.2
"""Bands peak above this, cycles/degree; what is coarser is the base band."""
BASE_FREQUENCY = 0.1
"""Frequency at which the base band's sensitivity is taken, cycles/degree."""
PEAK = 2 * 0.3228
"""Frequency that a band stands for, over the Nyquist frequency of its pixels; the finest has 1."""
DARKEST = 0.01
"""Least luminance that contrast is relative to, cd/m²."""

_TAPS = (0.05, 0.25, 0.4, 0.25, 0.05)
_P = 2.264355182647705
_Q = (1.302622675895691, 2.8885908126831055, 3.6807713508605957)
_MASKING = 10**-0.7954971194267273  # c
_REACH = 3  # of G, pixels of the band
_SPREAD = 2 * _REACH  # what G sees, pixels to either side
_MOST = 10**2.5642454624176025  # D_max
_BASE = (0.0036334486212581396, 1.6627724170684814, 4.11874532699585)
STILL = 0.577918291091919  # s
JOD, EXPONENT = 0.0439569391310215, 0.9302042722702026  # a, e
_STEPS = 256  # of luminance, an octave


@final
@dataclass(frozen=True)
class Band:
    """What the mechanisms make of two pictures in one band.

    Parameters
    ----------
    frequency
        Its peak, cycles/degree.
    gain
        g_b, the band's gain there.
    wanted, seen
        T and T', (view, mechanism, row, col), in multiples of the threshold.
    """

    frequency: float
    gain: float
    wanted: Planes
    seen: Planes


def visible_difference(wanted: Floats, seen: Floats, pixels_per_degree: float) -> Planes:
    """How much worse `seen` looks than `wanted`, place by place.

    Parameters
    ----------
    wanted, seen
        XYZ of light, (view, row, col, 3), cd/m².
    pixels_per_degree
        Resolution of the pictures.

    Returns
    -------
    v, (view, row, col), JOD, float32: 0 where nothing differs.

    Raises
    ------
    InputError
        If the shapes do not fit, or the resolution is not above 0.
    """
    return Reference(wanted, pixels_per_degree).difference(seen)


def in_thresholds(lost: Floats) -> Planes:
    """D of v, any shape: a difference of one mechanism in one band at its threshold has 1.

    It is what a page calls just-noticeable differences (JND); parameters as `visible_difference`
    returns them.
    """
    return np.asarray((np.maximum(lost, 0) / JOD) ** (1 / EXPONENT) / STILL, np.float32)


def bands(wanted: Floats, seen: Floats, pixels_per_degree: float) -> list[Band]:
    """The bands, from fine to coarse; parameters and errors as of `visible_difference`."""
    return Reference(wanted, pixels_per_degree).bands(seen)


@final
class Reference:
    """A picture that others are compared with: what of it all comparisons share.

    Parameters
    ----------
    wanted, pixels_per_degree
        As for `visible_difference`.

    Raises
    ------
    InputError
        If the picture's shape does not fit, or the resolution is not above 0.
    """

    def __init__(self, wanted: Floats, pixels_per_degree: float) -> None:
        if not (np.isfinite(pixels_per_degree) and pixels_per_degree > 0):
            raise InputError(
                f"visible differences take pixels per degree above 0, got {pixels_per_degree:g}"
            )
        self._shape, self._per_degree = np.shape(wanted), pixels_per_degree
        self._levels = _levels(wanted, pixels_per_degree)
        # Of each band S and T, (view, mechanism, row, col)
        self._sensitive = [np.empty_like(level) for level in self._levels[:-1]]
        self._contrasts = [np.empty_like(level) for level in self._levels[:-1]]
        for number in range(len(self._contrasts)):
            self._look(number)

    def difference(self, seen: Floats) -> Planes:
        """`visible_difference` of the picture and another of its shape; raises what that does."""
        levels = self._levels_of(seen)
        total = _base_band(self._levels[-1], levels[-1])
        for number in reversed(range(len(levels) - 1)):
            total = self._added(total, levels, number)
        return np.asarray(JOD * (STILL * total) ** EXPONENT)

    def bands(self, seen: Floats) -> list[Band]:
        """`bands` of the picture and another of its shape; raises what that does."""
        levels = self._levels_of(seen)
        found = []
        for number, wanted in enumerate(self._contrasts):
            views, every = range(len(wanted)), slice(0, wanted.shape[-2])
            contrasts = np.stack([self._seen(levels, number, view, every) for view in views])
            frequency = _frequency(number, self._per_degree)
            found.append(Band(frequency, gain(number, _place(number)), wanted, contrasts))
        return found

    def _levels_of(self, seen: Floats) -> list[Planes]:
        if np.shape(seen) != self._shape:
            raise InputError(
                f"visible differences are of two pictures of one shape, got {self._shape} and "
                f"{np.shape(seen)}"
            )
        return _levels(seen, self._per_degree)

    def _look(self, number: int) -> None:
        """Find S and T of a band."""
        sensitive, contrasts = self._sensitive[number], self._contrasts[number]
        frequency = _frequency(number, self._per_degree)

        def work(view: int, rows: slice) -> None:
            relative, light = _relative(self._levels, number, view, rows)
            for k, found in enumerate(_sensitivities(frequency, light)):
                sensitive[view, k, rows] = found
            np.multiply(relative, sensitive[view, :, rows], out=contrasts[view, :, rows])

        in_strips(work, _strips_of(contrasts))

    def _seen(self, levels: list[Planes], number: int, view: int, rows: slice) -> Planes:
        """T' of a band in some rows of a view, (mechanism, row, col)."""
        contrast, _ = _relative(levels, number, view, rows)
        contrast *= self._sensitive[number][view, :, rows]
        return contrast

    def _added(self, total: Planes, levels: list[Planes], number: int) -> Planes:
        """D of all bands from the base to this one, (view, row, col), from that of those before."""
        wanted = self._contrasts[number]
        views, _, rows, cols = wanted.shape
        both, apart = np.empty_like(wanted), np.empty_like(wanted)
        result = np.empty((views, rows, cols), np.float32)
        at_peak = np.float32(gain(number, _place(number)))
        # What lies so many rows beyond the strip's, mirrored at the edges
        beyond = np.pad(np.arange(rows), _SPREAD, "symmetric")

        def compare(view: int, some: slice) -> None:
            seen = self._seen(levels, number, view, some)
            both[view, :, some], apart[view, :, some] = _compared(wanted[view, :, some], seen)

        def add(view: int, some: slice) -> None:
            around = both[view][:, beyond[some.start : some.stop + 2 * _SPREAD]]
            masked = _masked(_weighted(around, -2), apart[view, :, some])
            result[view, some] = at_peak * _pooled(masked[None])[0]
            result[view, some] += _expanded_rows(total[view], some, cols)

        for work in (compare, add):
            in_strips(work, _strips_of(wanted))
        return result


def mutually_masked(wanted: Planes, seen: Planes) -> Planes:
    """D_k of T and T', (..., mechanism, row, col): 1 for a difference at threshold on nothing."""
    both, apart = _compared(wanted, seen)
    return _masked(_smoothed(both, -2), apart)


def reduced(planes: Planes) -> Planes:
    """The next level of the Gaussian pyramid, (..., row, col): every second pixel, smoothed."""
    each = planes.reshape(-1, *planes.shape[-2:])
    results = in_strips(lambda number, _: _halved(_halved(each[number], 0), 1), (len(each), 1))
    return np.stack(results).reshape(*planes.shape[:-2], *results[0].shape)


def expanded(planes: Planes, size: tuple[int, ...]) -> Planes:
    """The level below, of `size` (row, col), that has as much light."""
    return _expanded_rows(planes, slice(0, size[-2]), size[-1])


def gain(number: int, frequency: float) -> float:
    """Gain of a band of the pyramid, 0 the finest.

    Parameters
    ----------
    number
        Number of the band.
    frequency
        Frequency of a grating along an axis, in shares of the Nyquist frequency of the band's own
        pixels.
    """
    passed = [_low_pass(frequency / 2.0**k) for k in range(1, number + 1)]
    return float(np.prod([*passed, 1 - _low_pass(frequency) ** 2]))


def _expanded_rows(planes: Planes, rows: slice, cols: int) -> Planes:
    """Some rows of `expanded`, (..., row, col)."""
    first, last = rows.start // 2, -(-rows.stop // 2)
    around = np.clip(np.arange(first - 1, last + 1), 0, planes.shape[-2] - 1)
    lines = _doubled(planes[..., around, :], -2)
    lines = lines[..., rows.start - 2 * first : rows.stop - 2 * first, :]
    return _doubled(np.concatenate([lines[..., :1], lines, lines[..., -1:]], -1), -1)[..., :cols]


def _doubled(planes: Planes, axis: int) -> Planes:
    """Twice as many rows or columns, but of the first and the last, which lie beyond the edge."""
    outer, between, middle = (np.float32(2 * tap) for tap in _TAPS[:3])
    shape = list(planes.shape)
    shape[axis] = 2 * (shape[axis] - 2)
    result = np.empty(shape, planes.dtype)
    lines, finer = planes.swapaxes(axis, -2), result.swapaxes(axis, -2)
    before, here, after = lines[..., :-2, :], lines[..., 1:-1, :], lines[..., 2:, :]
    finer[..., ::2, :] = middle * here + outer * (before + after)
    finer[..., 1::2, :] = between * (here + after)
    return result


def _halved(plane: Planes, axis: int) -> Planes:
    """Every second row or column, smoothed; beyond its edge the plane is mirrored."""
    outer, between, middle = (np.float32(tap) for tap in _TAPS[:3])
    size = plane.shape[axis]
    around = np.pad(plane, [(2, 2) if axis == k else (0, 0) for k in (0, 1)], "symmetric")
    lines = [
        around[k : k + size : 2] if axis == 0 else around[:, k : k + size : 2]
        for k in range(len(_TAPS))
    ]
    result: Planes = outer * (lines[0] + lines[4])
    result += between * (lines[1] + lines[3])
    result += middle * lines[2]
    return result


def _low_pass(frequency: float) -> float:
    """Transfer function of the taps; 1 is the Nyquist frequency."""
    outer, between, middle = _TAPS[:3]
    angle = np.pi * frequency
    return float(middle + 2 * between * np.cos(angle) + 2 * outer * np.cos(2 * angle))


def _frequency(number: int, pixels_per_degree: float) -> float:
    return _place(number) * pixels_per_degree / 2 / 2.0**number


def _place(number: int) -> float:
    """The frequency that a band stands for, as a share of its pixels' Nyquist frequency."""
    return PEAK if number else 1.0


def _levels(picture: Floats, pixels_per_degree: float) -> list[Planes]:
    """Gaussian pyramid of the responses, (view, mechanism, row, col)."""
    shape = np.shape(picture)
    if len(shape) != 4 or 0 in shape or shape[3] != len(DKL_FROM_XYZ):
        raise InputError(f"visible differences are of XYZ, (view, row, col, 3), got {shape}")
    responses = np.empty((shape[0], shape[3], *shape[1:3]), np.float32)
    to_responses = DKL_FROM_XYZ.T.astype(np.float32)

    def respond(view: int, rows: slice) -> None:
        found = picture[view, rows].astype(np.float32, copy=False) @ to_responses
        responses[view, :, rows] = np.moveaxis(found, -1, 0)

    in_strips(respond, shape)
    levels = [responses]
    while _frequency(len(levels) - 1, pixels_per_degree) > LOWEST and min(
        levels[-1].shape[-2:]
    ) >= len(_TAPS):
        levels.append(reduced(levels[-1]))
    return levels


def _strips_of(planes: Planes) -> tuple[int, ...]:
    """Shape for `in_strips` of (view, mechanism, row, col), of two pictures."""
    views, mechanisms, rows, cols = planes.shape
    return views, rows, 2 * mechanisms * cols


def _relative(levels: list[Planes], number: int, view: int, rows: slice) -> tuple[Planes, Planes]:
    """C over g_b, (mechanism, row, col), and the light that it is relative to, (row, col)."""
    fine, coarse = levels[number][view, :, rows], levels[number + 1][view]
    around = _expanded_rows(coarse, rows, fine.shape[-1])
    light = np.maximum(around[0], np.float32(DARKEST))
    contrast = np.subtract(fine, around, out=around)
    contrast /= light * np.float32(gain(number, _place(number)))
    return contrast, light


def _compared(wanted: Planes, seen: Planes) -> tuple[Planes, Planes]:
    """What T and T' have in common, smoothed along rows, and |T - T'|^p of what they have not."""
    both = np.minimum(np.abs(wanted), np.abs(seen))
    return _smoothed(both, -1), _power(np.abs(seen - wanted), _P)


def _masked(both: Planes, apart: Planes) -> Planes:
    """D_k of what `_compared` finds, smoothed along columns, too."""
    result = np.empty_like(apart)
    for k, q in enumerate(_Q):
        mask = _power(np.float32(_MASKING) * both[..., k, :, :], q)
        mask += 1
        np.divide(apart[..., k, :, :], mask, out=result[..., k, :, :])
    return np.asarray(_MOST * result / (_MOST + result))


def _power(values: Planes, exponent: float) -> Planes:
    """Values of at least 0 to a power: far faster by logarithms, which NumPy has in vectors."""
    with np.errstate(divide="ignore"):  # of 0: its power is 0
        result = np.log(values)
    result *= np.float32(exponent)
    return np.exp(result, out=result)


def _smoothed(planes: Planes, axis: int) -> Planes:
    """G along an axis; beyond its edges planes are mirrored."""
    width = [(0, 0)] * planes.ndim
    width[axis] = (_SPREAD, _SPREAD)
    return _weighted(np.pad(planes, width, "symmetric"), axis)


def _weighted(padded: Planes, axis: int) -> Planes:
    """G along an axis, -2 or -1, of planes that have what lies beyond."""
    size = padded.shape[axis] - 2 * _SPREAD

    def moved(by: int) -> Planes:
        place = slice(_SPREAD + by, _SPREAD + by + size)
        return padded[..., place] if axis == -1 else padded[..., place, :]

    weights = np.exp(-((np.arange(_SPREAD + 1) / _REACH) ** 2) / 2)
    weights = (weights / (2 * weights.sum() - 1)).astype(np.float32)
    result: Planes = weights[0] * moved(0)
    for by, weight in enumerate(weights[1:], 1):
        pair = moved(by) + moved(-by)
        pair *= weight
        result += pair
    return result


def _base_band(wanted: Planes, seen: Planes) -> Planes:
    """D of the base band, (view, row, col), of both pictures' coarsest levels."""
    means = [
        np.maximum(each[:, :1], np.float32(DARKEST)).mean((-2, -1), keepdims=True)
        for each in (wanted, seen)
    ]
    difference = np.abs(seen / means[1] - wanted / means[0])
    found = _sensitivities(BASE_FREQUENCY, means[0][:, 0])
    for k, (weight, sensitivity) in enumerate(zip(_BASE, found, strict=True)):
        difference[:, k] *= np.float32(weight) * sensitivity
    return _pooled(difference)


def _pooled(difference: Planes) -> Planes:
    """D of all mechanisms, (view, row, col)."""
    squares = difference * difference
    return np.asarray(np.sqrt(np.sqrt(np.sum(squares * squares, axis=1))))


def _sensitivities(frequency: float, luminance: Planes) -> Iterator[Planes]:
    """S of each mechanism at each pixel's luminance, cd/m², from tables: 0.1 % accurate."""
    number = _steps(luminance)
    least, most = int(number.min()), int(number.max())
    for table in _tables(frequency, least, most):
        yield table[number - least]


def _steps(luminance: Planes) -> NDArray[np.intp]:
    """Places of luminances, cd/m², in a table."""
    return np.rint(np.log2(luminance) * np.float32(_STEPS)).astype(np.intp)


def _tables(frequency: float, least: int, most: int) -> Iterator[Planes]:
    """S of each mechanism at luminances of `least` to `most` steps."""
    luminance = 2 ** (np.arange(least, most + 1) / _STEPS)
    for mechanism in MECHANISMS:
        yield castle(frequency, luminance, mechanism, area=DETAIL).astype(np.float32)
