"""Visual masking: how much differently the eye's mechanisms respond to two pictures.

Each mechanism sees one band of frequencies and orientations. Its response saturates, so that a
difference on top of strong contrast in its band counts for less:

    v(x) = sum_i sum_theta [R(S_i C_test(x)) - R(S_i C_reference(x))]²            (eq. 11)

Contrast C is the band's luminance over the local adaptation luminance, S_i the contrast
sensitivity at the band's peak, and R the transducer. R(1) = 1: one mechanism at its threshold on a
plain field gives v = 1.

Ferwerda, J., Shirley, P., Pattanaik, S. and Greenberg, D. (1997), "A model of visual masking for
computer graphics", SIGGRAPH 97, 143-152. The bands are those of Watson's cortex transform (1987,
"The cortex transform: rapid computation of simulated neural images", CVGIP 39, 311-327) in the form
that Daly gave it (1993, chapter cited in `csf`): differences of mesas, cut into fans, both with
raised cosines for flanks. They reach 0, so that coarse bands can be computed exactly on a reduced
grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from compensate.fourier import Fourier
from compensate.vision.csf import daly
from domesim.errors import InputError
from domesim.light.guarded import guarded
from domesim.light.strips import in_strips
from domesim.room.viewing import Viewing

Floats = NDArray[np.floating[Any]]
Planes = NDArray[np.float32]

DARKEST = 10**-2.6
"""Least luminance that contrast is relative to, cd/m²: below it the cones' threshold no longer
falls (Ferwerda 1996), so that the same difference is no easier to see."""


@guarded
def transducer(signal: ArrayLike) -> Floats:
    """Response of a mechanism; odd in the signal.

    ``R = 3.291 [(1 + (S C)³)^(1/3) - 1] / (0.2599 (3.433 + S C)^0.8)`` (Ferwerda 1997): the cube
    of weak signals, and about the 0.2nd power of strong ones.

    Parameters
    ----------
    signal
        S C, contrast in units of its threshold, any shape.

    Returns
    -------
    R, of the same shape; float32 stays float32.
    """
    signed = np.asarray(signal)
    if not np.issubdtype(signed.dtype, np.floating):
        signed = signed.astype(np.float64)
    size = np.abs(signed)
    cubed = size * size * size
    root = np.cbrt(1 + cubed)
    # root - 1, written so that weak signals do not cancel
    grown = cubed / (root * root + root + 1)
    return np.asarray(np.copysign(3.291 * grown / (0.2599 * (3.433 + size) ** 0.8), signed))


@guarded
def sensitivity(frequency: ArrayLike, viewing: Viewing) -> Floats:
    """The 1-D CSF of the 2-D one (section 5): Daly's, averaged over orientations.

    Parameters
    ----------
    frequency
        Cycles/degree, any shape.
    viewing
        Where the picture is seen from.

    Returns
    -------
    1 / threshold contrast, of the same shape.

    Raises
    ------
    InputError
        If a frequency is negative.
    """
    theta = np.linspace(0, np.pi / 2, 16, endpoint=False)  # its period is pi / 2
    found = daly(
        np.asarray(frequency, np.float64)[..., None],
        theta,
        adaptation=viewing.adaptation,
        image_area=viewing.image_area,
        distance=viewing.distance,
    )
    return np.asarray(found.mean(axis=-1))


@guarded
def mesa(frequency: Floats, edge: float) -> Floats:
    """Low pass: 1 up to an edge, falling as a raised cosine to 0 at twice its frequency.

    Parameters
    ----------
    frequency, edge
        Cycles/degree, any shape.

    Returns
    -------
    gain
        Of the frequency's shape, 0..1.
    """
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * np.clip(frequency / edge - 1, 0, 1)))


@guarded
def dom(frequency: Floats, peak: float) -> Floats:
    """Band pass, a difference of mesas: 1 at `peak`, 0 up to ``peak / 2`` and from ``2 peak``.

    It is one octave wide at half height, and it and its neighbours at ``peak / 2`` and ``2 peak``
    add up to 1.

    Parameters
    ----------
    frequency, peak
        Cycles/degree, any shape.

    Returns
    -------
    gain
        Of the frequency's shape, 0..1.
    """
    return np.asarray(mesa(frequency, peak) - mesa(frequency, peak / 2))


@guarded
def fan(angle: Floats, index: int, orientations: int) -> Floats:
    """Passes orientations around ``index pi / orientations``; all fans add up to 1.

    Parameters
    ----------
    angle
        Angle of the frequency (row, col) from the column axis, radians, 0..pi.
    index
        Which fan, from 0.
    orientations
        How many fans there are.

    Returns
    -------
    gain
        (row, col), 0..1.
    """
    away = np.abs(angle - index * np.pi / orientations)
    away = np.minimum(away, np.pi - away) * orientations
    return np.asarray(0.5 + 0.5 * np.cos(np.minimum(away, np.pi)))


@final
@dataclass(frozen=True)
class Cortex:
    """The mechanisms: octave bands, each cut into orientations.

    Below the lowest band is the low-pass rest (the mean level and slow gradients), above the
    highest the high-pass rest; no mechanism looks at either.

    Parameters
    ----------
    orientations
        Mechanisms of a band; six, 30 degrees wide at half height, are Daly's (1993).
    lowest
        Peak of the lowest band, cycles/degree. The default, 0.5, reaches down to 0.25: inside a
        wide uniform veil v is 0, and with it the product of eq. 12. Only its edges are seen.

    Raises
    ------
    InputError
        If there are fewer than two orientations or the lowest peak is not above 0.
    """

    orientations: int = 6
    lowest: float = 0.5

    def __post_init__(self) -> None:
        if self.orientations < 2:
            raise InputError(f"a cortex takes 2 orientations or more, got {self.orientations}")
        if not (np.isfinite(self.lowest) and self.lowest > 0):
            raise InputError(f"a cortex takes a lowest peak above 0, got {self.lowest:g}")

    def peaks(self, pixels_per_degree: float) -> list[float]:
        """Peaks of the bands, cycles/degree: octaves from `lowest` up to Nyquist's frequency."""
        count = int(np.floor(np.log2(pixels_per_degree / 2 / self.lowest))) + 1
        return [self.lowest * 2**i for i in range(count)]


@guarded
def masked_difference(
    reference: Floats,
    test: Floats,
    adaptation: Floats,
    viewing: Viewing,
    *,
    cortex: Cortex | None = None,
) -> Planes:
    """Squares the difference of the mechanisms' responses to two pictures (v in eq. 11).

    Bands to which the eye is blind are left out: those with S < 1, where a contrast of 1 is below
    threshold. Each band is computed on the coarsest of the grids, each half as fine as the one
    before, that has five pixels a cycle of its peak; between a coarser grid's pixels v is
    interpolated. Beyond its edges the picture is mirrored.

    Parameters
    ----------
    reference, test
        Luminance without and with light pollution, (view, row, col), cd/m².
    adaptation
        Local adaptation luminance, (view, row, col), cd/m² (`adaptation.adaptation_luminance` of
        the reference).
    viewing
        Where the picture is seen from; S is taken at its adaptation luminance.
    cortex
        The mechanisms. Default: ``Cortex()``.

    Returns
    -------
    v, (view, row, col), float32: 0 where nothing differs, 1 where one mechanism on a plain field
    is at its threshold.

    Raises
    ------
    InputError
        If the shapes do not fit, a luminance is negative or not finite, or the picture is too
        coarse to hold the lowest band.
    """
    mechanisms = Cortex() if cortex is None else cortex
    planes = {"reference": reference, "test": test, "adaptation": adaptation}
    for name, plane in planes.items():
        _check(name, plane, np.shape(reference))
    views, rows, cols = reference.shape
    per_degree = viewing.pixels_per_degree(rows, cols)
    peaks = mechanisms.peaks(per_degree)
    if not peaks:
        raise InputError(
            f"masking takes {2 * mechanisms.lowest:g} pixels per degree or more, "
            f"got {per_degree:.3g}; use a larger picture or a cortex with a lower lowest peak"
        )
    levels = [max(0, int(np.floor(np.log2(per_degree / (5 * peak))))) for peak in peaks]
    mirrored = _Mirrored(rows, cols, round(per_degree / mechanisms.lowest / 2), levels[0])
    lightness = np.reciprocal(mirrored.widened(np.maximum(adaptation, DARKEST)))
    fourier = Fourier(mirrored.rows, mirrored.cols)
    spectra = fourier.forward(mirrored.widened(np.concatenate([reference, test])))
    grids = [fourier]
    for _ in range(levels[0]):
        grids.append(grids[-1].coarser())
    total = np.zeros((views, grids[-1].rows, grids[-1].cols), np.float32)
    for level in range(levels[0], -1, -1):
        here = [peak for peak, at in zip(peaks, levels, strict=True) if at == level]
        gains = {peak: float(sensitivity(peak, viewing)) for peak in here}
        seen = {peak: gain for peak, gain in gains.items() if gain >= 1}
        step = 2**level
        _add_responses(
            total,
            _reduced(spectra, grids[level], step),
            lightness[:, ::step, ::step],
            grids[level],
            per_degree / step,
            seen,
            mechanisms.orientations,
        )
        if level:
            total = _doubled(total)
    return np.ascontiguousarray(mirrored.narrowed(total))


def _add_responses(
    total: Planes,
    spectra: NDArray[np.complex64],
    lightness: Planes,
    fourier: Fourier,
    per_degree: float,
    gains: dict[float, float],
    orientations: int,
) -> None:
    """Add the squared differences of the bands (peak: sensitivity) on one grid to `total`."""
    if not gains:
        return
    down, across = (f.astype(np.float32) for f in fourier.frequencies(per_degree))
    rho = np.hypot(down, across)
    angle = np.arctan2(down, across)
    angle = np.where(angle < 0, angle + np.float32(np.pi), angle)
    bands = [np.float32(gain) * dom(rho, peak) for peak, gain in gains.items()]
    views = len(total)
    for index in range(orientations):
        part = fan(angle, index, orientations)
        for band in bands:
            signals = fourier.inverse(spectra * (part * band))

            def add(view: int, rows: slice, signals: Planes = signals) -> None:
                local = lightness[view, rows]
                before = transducer(signals[view, rows] * local)
                after = transducer(signals[views + view, rows] * local)
                total[view, rows] += (after - before) ** 2  # eq. 11

            in_strips(add, total.shape)


def _reduced(spectra: NDArray[np.complex64], fourier: Fourier, step: int) -> NDArray[np.complex64]:
    """The spectra's low frequencies: those of every `step`-th pixel, once they are band-limited."""
    if step == 1:
        return spectra
    half, cols = fourier.rows // 2, fourier.cols // 2 + 1
    kept = np.concatenate([spectra[:, :half, :cols], spectra[:, -half:, :cols]], axis=1)
    return np.asarray(kept / np.float32(step**2))


def _doubled(planes: Planes) -> Planes:
    """Twice the rows and columns, linearly between them; periodic."""
    views, rows, cols = planes.shape
    tall = np.empty((views, 2 * rows, cols), np.float32)
    tall[:, ::2] = planes
    tall[:, 1::2] = (planes + np.roll(planes, -1, axis=1)) / 2
    result = np.empty((views, 2 * rows, 2 * cols), np.float32)
    result[..., ::2] = tall
    result[..., 1::2] = (tall + np.roll(tall, -1, axis=2)) / 2
    return result


@final
class _Mirrored:
    """Planes with a mirrored margin on all sides, of a size that can be halved `levels` times."""

    def __init__(self, rows: int, cols: int, margin: int, levels: int) -> None:
        step = 2**levels
        self._before = step * -(-margin // step)  # a pixel of the coarsest grid
        self._picture = (rows, cols)
        unit = 2 * step
        self.rows, self.cols = (
            unit * int(scipy.fft.next_fast_len(-(-(n + self._before + margin) // unit), real=True))
            for n in self._picture
        )

    def widened(self, planes: Floats) -> Planes:
        first = self._before
        after = (self.rows - first - self._picture[0], self.cols - first - self._picture[1])
        margins = ((0, 0), (first, after[0]), (first, after[1]))
        return np.pad(planes.astype(np.float32, copy=False), margins, mode="symmetric")

    def narrowed(self, planes: Planes) -> Planes:
        rows, cols = self._picture
        first = self._before
        return planes[:, first : first + rows, first : first + cols]


def _check(name: str, plane: Floats, shape: tuple[int, ...]) -> None:
    if len(shape) != 3 or 0 in shape or np.shape(plane) != shape:
        raise InputError(
            f"masking takes reference, test and adaptation (view, row, col) of one shape, "
            f"got {name} {np.shape(plane)} beside reference {shape}"
        )
    if not (plane.min() >= 0 and plane.max() < np.inf):
        raise InputError(
            f"masking takes a {name} of at least 0 cd/m², finite, "
            f"got {plane.min():g} to {plane.max():g}"
        )
