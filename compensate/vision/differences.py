"""ColorVideoVDP's model of a still: what the eye sees of the differences between two pictures, JOD.

The eye's mechanisms (`castle`) look at each band of frequencies b, an octave wide. With R_k,b the
response of mechanism k at level b of a Gaussian pyramid, and ^ an expansion to the level below, a
band's contrast is relative to the light around:

    C_k = (R_k,b - ^R_k,b+1) / ^R_achromatic,b+1

It counts in multiples of its threshold at the band's peak and the local luminance of the wanted
picture, T_k = S_k C_k / g_b. A band's gain g_b at its peak is taken as 1/2, and as 1 in the finest.
What both pictures have masks what only one has:

    M_j = (c G * min(|T_j|, |T'_j|))^q_j
    D_k = |T_k - T'_k|^p / (1 + sum_j w_jk M_j),    D_k <- D_max D_k / (D_max + D_k)

G is a Gaussian, for what masks need not lie on the same pixel. The coarsest level, the base band,
is compared as shares of each picture's mean light, to which the eye adapts: a veil over all of it
is seen by the contrast that it takes, and by its hue. Differences are pooled over the pixels of
each band, then over bands, then over mechanisms, and become a quality that is lost:

    Q = s (sum_k sum_b mean(D_k,b^2)^(4/2))^(1/4)
    v = a Q^e,    but linear in Q below `TOE`

Its unit is the just-objectionable difference (JOD): of two pictures 1 JOD apart, 75 of 100 people
prefer the better. A *map* of v has for each place what would be lost if all of the picture were
like it: D_b = (sum_k D_k^4)^(1/4) in each band, and bands as they add up to a picture,
Q = s sum_b ^...^(g_b D_b).

On ten pictures the figure is within 0.006 JOD, or 0.5 %, of that of the authors' own code
(``tests/compensate/test_ruler.py``). Four things differ:

- Sensitivity is castleCSF's formula with the parameters of the authors' table
  (`castle.COLORVIDEOVDP`), where they interpolate in the table. The table is twice as sensitive to
  yellow-violet as people are (``validation/notes/0012``), but the JOD were calibrated with it.
- Contrasts above 1000 are not clipped: no pixel can be so much brighter than its own surroundings.
- Their map is up to 0.06 of Q lower in each band, by what they add below a root for its slope's
  sake. The figure has that, too, where it hardly counts.
- At the right edge of a picture with an even number of columns and an odd number of rows, or the
  reverse, their pyramid's weights do not sum to 1. Ours do.

Mantiuk, R. K., Hanji, P., Ashraf, M., Asano, Y., Chapiro, A. (2024), "ColorVideoVDP: A visual
difference predictor for image, video and display distortions", ACM Trans. Graph. 43(4), 129; the
constants are those of its authors' version 0.5.7 (cvvdp_parameters.json, MIT licence). The pyramid
is that of Burt, P. J., Adelson, E. H. (1983), "The Laplacian pyramid as a compact image code", IEEE
Trans. Commun. 31(4), 532-540, a = 0.4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from compensate.vision.castle import COLORVIDEOVDP, DETAIL, DKL_FROM_XYZ, castle
from domesim.errors import InputError
from domesim.light import Array, as_sent, namespace, on_host
from domesim.light.guarded import guarded
from domesim.light.strips import in_strips

Floats = NDArray[np.floating[Any]]
Planes = NDArray[np.float32]
T = TypeVar("T")

LOWEST = 0.2
"""The coarsest band peaks at this frequency or the next below, cycles/degree."""
BASE_FREQUENCY = 0.1
"""Frequency at which the base band's sensitivity is taken, cycles/degree."""
PEAK = 2 * 0.3228
"""Frequency that a band stands for, over the Nyquist frequency of its pixels; the finest has 1."""
DARKEST = 0.01
"""Least luminance that contrast is relative to, cd/m²."""
STILL = 0.577918291091919
"""s, by which stills differ from films."""
JOD, EXPONENT = 0.0439569391310215, 0.9302042722702026
"""a and e."""
TOE = 0.1
"""Q below which v is linear."""

_TAPS = (0.05, 0.25, 0.4, 0.25, 0.05)
_CALIBRATION = 10 ** (-0.2797423303127289 / 20)  # of all sensitivities
_WEIGHTS = _CALIBRATION * np.array([1.0, 1.45, 1.0])  # of the mechanisms' contrasts
_P = 2.264355182647705
_Q = (1.302622675895691, 2.8885908126831055, 3.6807713508605957)
_MASKING = 10**-0.7954971194267273  # c
# w_jk: how much mechanism j (row) masks k
_ACROSS = 2.0 ** np.array(
    [
        [-0.18950104713439941, -5.962151050567627, -4.31834602355957],
        [2.5655593872070312, 0.34406712651252747, -2.719646453857422],
        [3.8118371963500977, -1.0051705837249756, -0.5193376541137695],
    ]
)
_REACH = 3  # of G, pixels of the band
_SPREAD = 2 * _REACH  # what G sees, pixels to either side
_MOST = 10**2.5642454624176025  # D_max
_BASE = np.array([0.0036334486212581396, 1.6627724170684814, 4.11874532699585])
_ROOTED = 1e-5  # added below a root, so that it has a slope at 0
_STEPS = 256  # of luminance, an octave


@final
@dataclass(frozen=True)
class Band:
    """What the mechanisms make of two pictures in one band.

    Parameters
    ----------
    frequency
        Its peak, cycles/degree.
    wanted, seen
        T and T', (view, mechanism, row, col), in multiples of the threshold.
    """

    frequency: float
    wanted: Planes
    seen: Planes


@guarded(wanted="view row col 3, finite", seen="view row col 3, finite")
def visible_difference(wanted: Floats, seen: Floats, pixels_per_degree: float) -> Planes:
    """Maps how much worse `seen` looks than `wanted`.

    Parameters
    ----------
    wanted, seen
        XYZ of light, (view, row, col, 3), cd/m².
    pixels_per_degree
        Resolution of the pictures.

    Returns
    -------
    The map of v, (view, row, col), JOD, float32: 0 where nothing differs.

    Raises
    ------
    InputError
        If the shapes do not fit, or the resolution is not above 0.
    """
    return Reference(wanted, pixels_per_degree).difference(seen)


def quality_lost(differences: Array) -> Array:
    """Returns the quality v that is lost by differences Q, any shape, JOD."""
    xp, toe = namespace(differences), JOD * TOE ** (EXPONENT - 1)
    beyond = JOD * xp.clip(differences, TOE, None) ** EXPONENT  # its slope at 0 has no end
    return xp.where(differences > TOE, beyond, toe * differences)


@guarded
def in_thresholds(lost: Floats) -> Planes:
    """Returns Q / s of v, any shape: 1 for one mechanism at its threshold in one band.

    It is what a page calls just-noticeable differences (JND); parameters as `visible_difference`
    returns them.
    """
    lost = np.maximum(lost, 0)
    toe = JOD * TOE ** (EXPONENT - 1)
    found = np.where(lost > toe * TOE, (lost / JOD) ** (1 / EXPONENT), lost / toe)
    return np.asarray(found / STILL, np.float32)


@guarded(wanted="view row col 3, finite", seen="view row col 3, finite")
def bands(wanted: Floats, seen: Floats, pixels_per_degree: float) -> list[Band]:
    """Compares two pictures band by band.

    Parameters
    ----------
    wanted, seen, pixels_per_degree
        As for `visible_difference`.

    Returns
    -------
    bands
        From fine to coarse.

    Raises
    ------
    InputError
        As `visible_difference`.
    """
    return Reference(wanted, pixels_per_degree).bands(seen)


def pooled(squares: Sequence[Array], base: Array | None = None) -> Array:
    """Pools differences over bands and mechanisms to Q.

    Parameters
    ----------
    squares
        Means of D_k^2 over the pixels of each band, (..., mechanism).
    base
        The same of the base band, if it counts.

    Returns
    -------
    (...): without the last axis.
    """
    xp = namespace(*squares)
    roots = [_root(each, 2) for each in squares]
    if base is not None:
        roots.append(as_sent(_BASE, base) * _root(base, 2))
    of_mechanisms = _root(xp.sum(xp.stack(roots) ** 4, axis=0), 4)
    return STILL * _root(xp.sum(of_mechanisms**4, axis=-1), 4)


@final
class Reference:
    """A picture that others are compared with.

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
        # Of each band S / g_b and T, (view, mechanism, row, col)
        self._sensitive = [np.empty_like(level) for level in self._levels[:-1]]
        self._contrasts = [np.empty_like(level) for level in self._levels[:-1]]
        for number in range(len(self._contrasts)):
            self._look(number)

    def difference(self, seen: Floats) -> Planes:
        """Computes `visible_difference` of another picture of its shape."""
        levels = self._levels_of(seen)
        base = _base_band(self._levels[-1], levels[-1])
        total = _of_all(base * _BASE[:, None, None].astype(np.float32))
        for number in reversed(range(len(levels) - 1)):
            total = self._added(total, levels, number)
        return np.asarray(quality_lost(STILL * total), np.float32)

    def pooled(self, seen: Floats, share: Planes | None = None) -> Floats:
        """Pools the differences of another picture of its shape.

        Parameters
        ----------
        seen
            As for `visible_difference`.
        share
            (row, col) how much a pixel's differences count, 0..1; all of them do by default.

        Returns
        -------
        differences
            (view,) Q.

        Raises
        ------
        InputError
            If the shapes do not fit.
        """
        levels = self._levels_of(seen)
        shares = [None] * len(levels) if share is None else _pyramid(share, len(levels))
        squares = [
            self._mean_square(levels, number, shares[number]) for number in range(len(levels) - 1)
        ]
        base = _base_band(self._levels[-1], levels[-1]) ** 2
        if shares[-1] is not None:
            base *= shares[-1]
        found: Floats = pooled(squares, base.mean((-2, -1), dtype=np.float64))
        return found

    def pooled_anywhere(self, seen: Array, share: Planes | None = None) -> Array:
        """`pooled` by an array library that differentiates: no strips, nothing in place.

        Parameters
        ----------
        seen
            (view, row, col, 3) XYZ of any library, cd/m².
        share
            As for `pooled`.

        Returns
        -------
        differences
            (view,) Q, of the same library, precision and device.

        Raises
        ------
        InputError
            If the shapes do not fit.
        """
        self._require_alike(seen)
        xp, shares = namespace(seen), [None] * len(self._levels)
        if share is not None:
            shares = [as_sent(each, seen) for each in _pyramid(share, len(self._levels))]
        level = xp.permute_dims(seen @ as_sent(DKL_FROM_XYZ.T, seen), (0, 3, 1, 2))
        weights = as_sent(_ACROSS, seen)
        squares = []
        for number, (sensitive, own) in enumerate(
            zip(self._sensitive, self._contrasts, strict=True)
        ):
            size, wanted = level.shape[-2:], as_sent(own, seen)
            coarse = _along_both(_halving, size, level)
            around = _along_both(_doubling, size, coarse)
            light = xp.clip(around[:, :1, ...], DARKEST, None)
            contrast = as_sent(sensitive, seen) * (level - around) / light
            both = _along_both(_smoothing, size, xp.minimum(xp.abs(wanted), xp.abs(contrast)))
            masks = xp.stack([(_MASKING * both[:, k, ...]) ** q for k, q in enumerate(_Q)], axis=-1)
            masked = xp.abs(contrast - wanted) ** _P / xp.moveaxis(1 + masks @ weights, -1, 1)
            square = (_MOST * masked / (_MOST + masked)) ** 2
            squares.append(_mean(square, shares[number]))
            level = coarse
        base = _base_band(as_sent(self._levels[-1], seen), level) ** 2
        return pooled(squares, _mean(base, shares[-1]))

    def bands(self, seen: Floats) -> list[Band]:
        """Compares it with another picture of its shape, band by band; raises what `bands` does."""
        levels = self._levels_of(seen)
        bands = []
        for number, wanted in enumerate(self._contrasts):
            views, every = range(len(wanted)), slice(0, wanted.shape[-2])
            contrasts = np.stack([self._seen(levels, number, view, every) for view in views])
            frequency = _frequency(number, self._per_degree)
            bands.append(Band(frequency, wanted, contrasts))
        return bands

    def _levels_of(self, seen: Floats) -> list[Planes]:
        self._require_alike(seen)
        return _levels(seen, self._per_degree)

    def _require_alike(self, seen: Array) -> None:
        if tuple(seen.shape) != self._shape:
            raise InputError(
                f"visible differences are of two pictures of one shape, got {self._shape} and "
                f"{tuple(seen.shape)}"
            )

    def _look(self, number: int) -> None:
        """Find S / g_b and T of a band."""
        sensitive, contrasts = self._sensitive[number], self._contrasts[number]
        frequency = _frequency(number, self._per_degree)

        def work(view: int, rows: slice) -> None:
            relative, light = _relative(self._levels, number, view, rows)
            weights = (_WEIGHTS / _gain(number)).astype(np.float32)
            for k, found in enumerate(_sensitivities(frequency, light)):
                np.multiply(found, weights[k], out=sensitive[view, k, rows])
            np.multiply(relative, sensitive[view, :, rows], out=contrasts[view, :, rows])

        in_strips(work, _strips_of(contrasts))

    def _seen(self, levels: list[Planes], number: int, view: int, rows: slice) -> Planes:
        """T' of a band in some rows of a view, (mechanism, row, col)."""
        contrast, _ = _relative(levels, number, view, rows)
        contrast *= self._sensitive[number][view, :, rows]
        return contrast

    def _added(self, total: Planes, levels: list[Planes], number: int) -> Planes:
        """Q / s of all bands from the base to this one, (view, row, col), from those before."""
        wanted = self._contrasts[number]
        views, _, rows, cols = wanted.shape
        result = np.empty((views, rows, cols), np.float32)

        def add(view: int, some: slice, masked: Planes) -> None:
            result[view, some] = np.float32(_gain(number)) * _of_all(masked[None])[0]
            result[view, some] += _expanded_rows(total[view], some, cols)

        self._compare(levels, number, add)
        return result

    def _mean_square(self, levels: list[Planes], number: int, share: Planes | None) -> Floats:
        """Mean of D_k^2 over the pixels of a band, (view, mechanism)."""
        wanted = self._contrasts[number]

        def square(view: int, some: slice, masked: Planes) -> tuple[int, Floats]:
            masked *= masked
            if share is not None:
                masked *= share[some]
            return view, masked.sum((-2, -1), dtype=np.float64)

        total = np.zeros(wanted.shape[:2])
        for view, part in self._compare(levels, number, square):
            total[view] += part
        return np.asarray(total / (wanted.shape[-2] * wanted.shape[-1]))

    def _compare(
        self, levels: list[Planes], number: int, use: Callable[[int, slice, Planes], T]
    ) -> list[T]:
        """`use` a view, some of its rows and D_k there, (mechanism, row, col), for all rows."""
        wanted = self._contrasts[number]
        rows, cols = wanted.shape[-2:]
        spread = _spread(rows, cols)
        both, apart = np.empty_like(wanted), np.empty_like(wanted)
        # What lies so many rows beyond the strip's, mirrored at the edges
        beyond = np.pad(np.arange(rows), spread, "reflect")

        def compare(view: int, some: slice) -> None:
            seen = self._seen(levels, number, view, some)
            common, apart[view, :, some] = _compared(wanted[view, :, some], seen)
            both[view, :, some] = _smoothed(common, -1, spread)

        def mask(view: int, some: slice) -> T:
            around = both[view][:, beyond[some.start : some.stop + 2 * spread]]
            return use(view, some, _masked(_weighted(around, -2, spread), apart[view, :, some]))

        in_strips(compare, _strips_of(wanted))
        return in_strips(mask, _strips_of(wanted))


@guarded(wanted="mechanism row col", seen="mechanism row col")
def mutually_masked(wanted: Planes, seen: Planes) -> Planes:
    """Masks differences by what both pictures have in common.

    Parameters
    ----------
    wanted, seen
        (mechanism, row, col) T and T'.

    Returns
    -------
    differences
        (mechanism, row, col) D_k: 1 for a difference at threshold on nothing.
    """
    spread = _spread(*wanted.shape[-2:])
    both, apart = _compared(wanted, seen)
    for axis in (-1, -2):
        both = _smoothed(both, axis, spread)
    return _masked(both, apart)


@guarded(planes="... row col")
def reduced(planes: Planes) -> Planes:
    """The next level of the Gaussian pyramid, (..., row, col): every second pixel, smoothed."""
    each = planes.reshape(-1, *planes.shape[-2:])
    results = in_strips(lambda number, _: _halved(_halved(each[number], 0), 1), (len(each), 1))
    return np.stack(results).reshape(*planes.shape[:-2], *results[0].shape)


@guarded
def expanded(planes: Planes, size: tuple[int, ...]) -> Planes:
    """Expands a level of the Gaussian pyramid to the one below, with as much light.

    Parameters
    ----------
    planes
        (..., row, col).
    size
        (row, col) of the level below.

    Returns
    -------
    planes
        (..., row, col) of `size`.
    """
    return _expanded_rows(planes, slice(0, size[-2]), size[-1])


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


def _frequency(number: int, pixels_per_degree: float) -> float:
    return _place(number) * pixels_per_degree / 2 / 2.0**number


def _place(number: int) -> float:
    """The frequency that a band stands for, as a share of its pixels' Nyquist frequency."""
    return PEAK if number else 1.0


def _gain(number: int) -> float:
    """g_b."""
    return 0.5 if number else 1.0


def _root(values: Array, power: int) -> Array:
    """Root of values of at least 0, as the authors take it."""
    return (values + _ROOTED) ** (1 / power) - _ROOTED ** (1 / power)


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
    # Halved while four pixels are left at least, and until the last band is low enough
    most = max(min(shape[1:3]).bit_length() - 2, 0)
    count = next(k for k in range(most + 1) if k == most or _is_last(k, pixels_per_degree))
    return _pyramid(responses, 1 + count)


def _is_last(number: int, pixels_per_degree: float) -> bool:
    """Whether so many bands hold one that is low enough."""
    return number > 0 and _frequency(number - 1, pixels_per_degree) <= LOWEST


def _pyramid(planes: Planes, count: int) -> list[Planes]:
    """`count` levels of the Gaussian pyramid, (..., row, col)."""
    levels = [planes]
    while len(levels) < count:
        levels.append(reduced(levels[-1]))
    return levels


def _spread(rows: int, cols: int) -> int:
    """What G sees of a band, pixels to either side: nothing in a small one."""
    return _SPREAD if min(rows, cols) > _SPREAD else 0


def _strips_of(planes: Planes) -> tuple[int, ...]:
    """Shape for `in_strips` of (view, mechanism, row, col), of two pictures."""
    views, mechanisms, rows, cols = planes.shape
    return views, rows, 2 * mechanisms * cols


def _relative(levels: list[Planes], number: int, view: int, rows: slice) -> tuple[Planes, Planes]:
    """C, (mechanism, row, col), and the light that it is relative to, (row, col)."""
    fine, coarse = levels[number][view, :, rows], levels[number + 1][view]
    around = _expanded_rows(coarse, rows, fine.shape[-1])
    light = np.maximum(around[0], np.float32(DARKEST))
    contrast = np.subtract(fine, around, out=around)
    contrast /= light
    return contrast, light


def _compared(wanted: Planes, seen: Planes) -> tuple[Planes, Planes]:
    """What T and T' have in common, and |T - T'|^p of what they have not."""
    return np.minimum(np.abs(wanted), np.abs(seen)), _power(np.abs(seen - wanted), _P)


def _masked(both: Planes, apart: Planes) -> Planes:
    """D_k of what `_compared` finds, (mechanism, row, col), with `both` smoothed by G."""
    masks = np.stack(
        [_power(np.float32(_MASKING) * each, q) for each, q in zip(both, _Q, strict=True)]
    )
    result = np.empty_like(apart)
    for k, weights in enumerate(_ACROSS.T.astype(np.float32)):
        mask = 1 + weights[0] * masks[0]
        for weight, each in zip(weights[1:], masks[1:], strict=True):
            mask += weight * each
        np.divide(apart[k], mask, out=result[k])
    return np.asarray(_MOST * result / (_MOST + result))


def _power(values: Planes, exponent: float) -> Planes:
    """Values of at least 0 to a power: far faster by logarithms, which NumPy has in vectors."""
    with np.errstate(divide="ignore"):  # of 0: its power is 0
        result = np.log(values)
    result *= np.float32(exponent)
    return np.exp(result, out=result)


def _smoothed(planes: Planes, axis: int, spread: int) -> Planes:
    """G along an axis; beyond its edges planes are mirrored."""
    width = [(0, 0)] * planes.ndim
    width[axis] = (spread, spread)
    return _weighted(np.pad(planes, width, "reflect"), axis, spread)


def _weighted(padded: Planes, axis: int, spread: int) -> Planes:
    """G along an axis, -2 or -1, of planes that have what lies beyond."""
    size = padded.shape[axis] - 2 * spread

    def moved(by: int) -> Planes:
        place = slice(spread + by, spread + by + size)
        return padded[..., place] if axis == -1 else padded[..., place, :]

    weights = np.exp(-((np.arange(spread + 1) / _REACH) ** 2) / 2)
    weights = (weights / (2 * weights.sum() - 1)).astype(np.float32)
    result: Planes = weights[0] * moved(0)
    for by, weight in enumerate(weights[1:], 1):
        pair = moved(by) + moved(-by)
        pair *= weight
        result += pair
    return result


def _base_band(wanted: Array, seen: Array) -> Array:
    """D_k of the base band, (view, mechanism, row, col), of both pictures' coarsest levels."""
    xp = namespace(wanted)
    means = [
        xp.mean(xp.clip(each[:, :1, ...], DARKEST, None), axis=(-2, -1), keepdims=True)
        for each in (wanted, seen)
    ]
    found = np.stack(list(_sensitivities(BASE_FREQUENCY, on_host(means[0][:, 0, ...]))), axis=1)
    sensitivity = as_sent(np.float32(_CALIBRATION) * found, seen)
    return xp.abs(seen / means[1] - wanted / means[0]) * sensitivity


def _mean(squares: Array, share: Array | None) -> Array:
    """Mean over rows and columns of (view, mechanism, row, col), (view, mechanism)."""
    return namespace(squares).mean(squares if share is None else squares * share, axis=(-2, -1))


Along: TypeAlias = Callable[[int, bool], Floats]
"""Size of an axis, and whether G sees anything -> the matrix that works along it."""


def _along_both(along: Along, size: tuple[int, int], planes: Array) -> Array:
    """What matrices make of (..., row, col); `size` is that of the finer planes."""
    wide = _spread(*size) > 0
    rows, cols = (as_sent(along(side, wide), planes) for side in size)
    return rows @ planes @ namespace(planes).permute_dims(cols, (1, 0))


@lru_cache(maxsize=64)
def _halving(size: int, wide: bool) -> Floats:
    return _halved(np.eye(size, dtype=np.float32), 0)


@lru_cache(maxsize=64)
def _doubling(size: int, wide: bool) -> Floats:
    half = np.eye(-(-size // 2), dtype=np.float32)
    return _doubled(np.concatenate([half[:1], half, half[-1:]]), -2)[:size]


@lru_cache(maxsize=64)
def _smoothing(size: int, wide: bool) -> Floats:
    return _smoothed(np.eye(size, dtype=np.float32), -2, _SPREAD if wide else 0)


def _of_all(differences: Planes) -> Planes:
    """D of all mechanisms, (view, row, col), of (view, mechanism, row, col)."""
    squares = differences * differences
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
    for mechanism in COLORVIDEOVDP:
        yield castle(frequency, luminance, mechanism, area=DETAIL).astype(np.float32)
