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

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from compensate.compiled import compiles
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
    levels = _levels(wanted, seen, pixels_per_degree)
    total = _base_band(levels[-1])
    add_band = _add_band_compiled if compiles() else _add_band
    for number in reversed(range(len(levels) - 1)):
        total = add_band(total, levels, number, pixels_per_degree)
    return np.asarray(JOD * (STILL * total) ** EXPONENT)


def in_thresholds(lost: Floats) -> Planes:
    """D of v, any shape: a difference of one mechanism in one band at its threshold has 1.

    It is what a page calls just-noticeable differences (JND); parameters as `visible_difference`
    returns them.
    """
    return np.asarray((np.maximum(lost, 0) / JOD) ** (1 / EXPONENT) / STILL, np.float32)


def bands(wanted: Floats, seen: Floats, pixels_per_degree: float) -> list[Band]:
    """The bands, from fine to coarse; parameters and errors as of `visible_difference`."""
    levels = _levels(wanted, seen, pixels_per_degree)
    return [_band(levels, number, pixels_per_degree) for number in range(len(levels) - 1)]


def mutually_masked(wanted: Planes, seen: Planes) -> Planes:
    """D_k of T and T', (..., mechanism, row, col): 1 for a difference at threshold on nothing."""
    both = np.minimum(np.abs(wanted), np.abs(seen))
    both = np.float32(_MASKING) * _filtered(
        both, partial(gaussian_filter, sigma=_REACH, radius=_SPREAD)
    )
    result = np.abs(seen - wanted) ** np.float32(_P)
    for k, q in enumerate(_Q):
        result[..., k, :, :] /= 1 + both[..., k, :, :] ** np.float32(q)
    return np.asarray(_MOST * result / (_MOST + result))


def reduced(planes: Planes) -> Planes:
    """The next level of the Gaussian pyramid, (..., row, col): every second pixel, smoothed."""
    if compiles():
        return _reduced_compiled(planes)
    return _filtered(planes, lambda plane: _halved(_halved(plane, 0), 1))


def expanded(planes: Planes, size: tuple[int, ...]) -> Planes:
    """The level below, of `size` (row, col), that has as much light."""
    outer, between, middle = (np.float32(2 * tap) for tap in _TAPS[:3])
    for axis, count in zip((-2, -1), size, strict=True):
        shape = list(planes.shape)
        shape[axis] = count
        result = np.empty(shape, planes.dtype)
        lines, finer = np.moveaxis(planes, axis, 0), np.moveaxis(result, axis, 0)
        before, after = lines[:-1], lines[1:]
        even, odd = finer[::2], finer[1::2]
        np.multiply(middle, lines, out=even)
        even[1:] += outer * before
        even[:-1] += outer * after
        even[0] += outer * lines[0]
        even[-1] += outer * lines[-1]
        odd[: len(after)] = between * (before + after)
        odd[len(after) :] = 2 * between * lines[-1]
        planes = result
    return planes


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


def _filtered(planes: Planes, filtering: Callable[[Planes], Planes]) -> Planes:
    """Each (row, col) of (..., row, col) filtered, by all threads."""
    each = planes.reshape(-1, *planes.shape[-2:])
    results = in_strips(lambda number, _: filtering(each[number]), (len(each), 1))
    return np.stack(results).reshape(*planes.shape[:-2], *results[0].shape)


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


def _levels(wanted: Floats, seen: Floats, pixels_per_degree: float) -> list[Planes]:
    """Gaussian pyramid of the responses, (picture, view, mechanism, row, col)."""
    shape = np.shape(wanted)
    if len(shape) != 4 or 0 in shape or shape[3] != len(DKL_FROM_XYZ):
        raise InputError(f"visible differences are of XYZ, (view, row, col, 3), got {shape}")
    if np.shape(seen) != shape:
        raise InputError(
            f"visible differences are of two pictures of one shape, got {shape} and "
            f"{np.shape(seen)}"
        )
    if not (np.isfinite(pixels_per_degree) and pixels_per_degree > 0):
        raise InputError(
            f"visible differences take pixels per degree above 0, got {pixels_per_degree:g}"
        )
    responses = np.stack([wanted, seen]).astype(np.float32, copy=False) @ DKL_FROM_XYZ.T.astype(
        np.float32
    )
    levels = [np.ascontiguousarray(np.moveaxis(responses, -1, 2))]
    while _frequency(len(levels) - 1, pixels_per_degree) > LOWEST and min(
        levels[-1].shape[-2:]
    ) >= len(_TAPS):
        levels.append(reduced(levels[-1]))
    return levels


def _band(levels: list[Planes], number: int, pixels_per_degree: float) -> Band:
    fine, coarse = levels[number], levels[number + 1]
    around = expanded(coarse, fine.shape[-2:])
    light = np.maximum(around[:, :, :1], np.float32(DARKEST))
    at_peak, frequency = gain(number, _place(number)), _frequency(number, pixels_per_degree)
    contrast = (fine - around) / (light * np.float32(at_peak))
    for k, sensitivity in enumerate(_sensitivities(frequency, light[0, :, 0])):
        contrast[:, :, k] *= sensitivity
    return Band(frequency, at_peak, contrast[0], contrast[1])


def _add_band(total: Planes, levels: list[Planes], number: int, pixels_per_degree: float) -> Planes:
    """D of all bands from the base to this one, (view, row, col), from that of those before."""
    band = _band(levels, number, pixels_per_degree)
    difference = _pooled(mutually_masked(band.wanted, band.seen))
    return expanded(total, difference.shape[-2:]) + np.float32(band.gain) * difference


def _add_band_compiled(
    total: Planes, levels: list[Planes], number: int, pixels_per_degree: float
) -> Planes:
    """`_add_band` by compiled loops."""
    from compensate.vision import difference_loops as loops  # noqa: PLC0415

    fine, coarse = levels[number], levels[number + 1]
    at_peak, frequency = gain(number, _place(number)), _frequency(number, pixels_per_degree)
    brightest = max(DARKEST, float(coarse[0, :, 0].max()))
    least, most = _steps(np.array([DARKEST, brightest], np.float32))
    table = np.stack(list(_tables(frequency, least, most + 1)))
    expanding, powers = _singles(*(2 * tap for tap in _TAPS[:3])), _singles(*_Q)
    kernel = np.exp(-((np.arange(_SPREAD + 1) / _REACH) ** 2) / 2)
    kernel = (kernel / (2 * kernel.sum() - 1)).astype(np.float32)
    compared = np.empty((fine.shape[1], 2, *fine.shape[2:]), np.float32)
    result = np.empty((fine.shape[1], *fine.shape[-2:]), np.float32)

    def compare(view: int, rows: slice) -> None:
        constants = _singles(at_peak, DARKEST, _STEPS, _P)
        given = fine[:, view], coarse[:, view], constants, expanding, kernel, table, least
        loops.compare_rows(*given, compared[view], rows.start, rows.stop)

    def mask(view: int, rows: slice) -> None:
        constants = _singles(_MASKING, _MOST, at_peak)
        given = compared[view], constants, powers, expanding, kernel, total[view]
        loops.mask_rows(*given, result[view], rows.start, rows.stop)

    for work in (compare, mask):
        in_strips(work, (*result.shape, 2 * len(MECHANISMS)))
    return result


def _reduced_compiled(planes: Planes) -> Planes:
    """`reduced` by compiled loops."""
    from compensate.vision import difference_loops as loops  # noqa: PLC0415

    each = planes.reshape(-1, *planes.shape[-2:])
    rows, cols = (-(-side // 2) for side in planes.shape[-2:])
    result = np.empty((len(each), rows, cols), np.float32)
    taps = _singles(*_TAPS[:3])

    def work(number: int, lines: slice) -> None:
        loops.reduce_rows(each[number], taps, result[number], lines.start, lines.stop)

    in_strips(work, (*result.shape, 4))
    return result.reshape(*planes.shape[:-2], rows, cols)


def _singles(*numbers: float) -> tuple[np.float32, ...]:
    return tuple(map(np.float32, numbers))


def _base_band(coarsest: Planes) -> Planes:
    """D of the base band, (view, row, col)."""
    mean = np.maximum(coarsest[:, :, :1], np.float32(DARKEST)).mean((-2, -1), keepdims=True)
    difference = np.abs(np.diff(coarsest / mean, axis=0))[0]
    found = _sensitivities(BASE_FREQUENCY, mean[0, :, 0])
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
