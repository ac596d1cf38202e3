"""Crosstalk from readings through the eyewear: the paper's section 4.

Through the filter of one eye, M_intended (XYZ, RGB) are the primaries of the projector that this
eye should see, M_unintended those of the other one, black subtracted from both. The eye takes
light c (linear RGB) of the other projector for M_intended^-1 M_unintended c of its own:

    C = M_intended^-1 M_unintended          observed = own + C other

To first order, dC = M_intended^-1 (dM_unintended - dM_intended C); each reading's error is
independent, but that of black is in all three columns.

Woods' definitions (A. J. Woods, *Crosstalk in stereoscopic displays: a review*, Journal of
Electronic Imaging 21, 040902, 2012), with L_ab the luminance that the eye sees while its own
picture is a and the other's b, K black and W white:

    system crosstalk = (L_KW - L_KK)/(L_WK - L_KK)        a property of the equipment
    viewer crosstalk = leaked light / own light           at one place of a picture (Huang 2003)
    extinction ratio = 1/system crosstalk
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.host.numbers import decimal, ratio
from domesim.readings.meter import words
from domesim.readings.response import SIGMAS, Display

Floats = NDArray[np.float64]

BRIGHTEST_LEAK = 0.5
"""System crosstalk from which the filters must have been exchanged."""
SAME_BLACK = 0.05
"""Blacks that differ by less were both read while both projectors shone."""


@final
@dataclass(frozen=True, eq=False)
class MeasuredCrosstalk:
    """Crosstalk to one eye, with standard errors.

    Parameters
    ----------
    eye
        The eye that sees: left or right.
    matrix
        (own primary, other primary) C, in linear RGB, small negative entries set to 0.
    measured
        The same as it was measured.
    error
        Standard errors of `measured`.
    intended, unintended
        (XYZ, RGB) primaries of the own and of the other projector through this eye's filter, cd/m².
    system, system_error
        System crosstalk, and its standard error.
    black
        (XYZ,) that this eye sees while both projectors show black, cd/m²; None if it was not read.
    notes
        What a person should know, a line each.
    """

    eye: str
    matrix: Floats
    measured: Floats
    error: Floats
    intended: Floats
    unintended: Floats
    system: float
    system_error: float
    black: Floats | None
    notes: tuple[str, ...]

    @property
    def extinction(self) -> float:
        """Intended over unintended luminance, white against white."""
        return 1 / self.system if self.system > 0 else np.inf

    def viewer(self, own: ArrayLike, other: ArrayLike) -> float:
        """Viewer crosstalk at one place of a picture: leaked luminance over the own one's.

        Parameters
        ----------
        own, other
            (primary,) linear RGB of both pictures there, 1.0 = white.

        Raises
        ------
        InputError
            If the own picture is black there: the ratio is without bound.
        """
        luminance = self.intended[1]
        seen = float(luminance @ np.asarray(own, np.float64))
        if not seen > 0:
            raise InputError(
                f"viewer crosstalk needs light in the eye's own picture, got {seen:g} cd/m²; "
                f"use the system crosstalk for black"
            )
        return float(luminance @ self.matrix @ np.asarray(other, np.float64)) / seen

    def report(self) -> list[str]:
        """Lines for a person."""
        lines = [
            f"crosstalk to the {self.eye} eye: system {self.system:.2%} ± {self.system_error:.2%}, "
            f"extinction {ratio(self.extinction)}"
        ]
        for name, row, errors in zip("RGB", self.matrix, self.error, strict=True):
            cells = zip("RGB", row, errors, strict=True)
            told_row = ", ".join(f"{n} {value:.2%} ± {error:.2%}" for n, value, error in cells)
            lines.append(f"  own {name} sees of the other's {told_row}")
        grey = self.viewer((0.5, 0.5, 0.5), (1, 1, 1))
        lines.append(f"  viewer crosstalk of white on a picture of half its light: {grey:.2%}")
        if self.black is not None:
            lines.append(f"  black of both projectors: {decimal(self.black[1])} cd/m²")
        return [*lines, *(f"  {note}" for note in self.notes)]


def measured_crosstalk(
    eye: str, intended: Display, unintended: Display, *, allow_negative: bool = False
) -> MeasuredCrosstalk:
    """Crosstalk to one eye.

    Parameters
    ----------
    eye
        left or right.
    intended, unintended
        The own and the other projector, both through this eye's filter.
    allow_negative
        Whether to keep negative entries beyond their uncertainty. A ghost more saturated than the
        eye's own primaries has some; so have mistakes.

    Raises
    ------
    InputError
        If the ghost is as bright as the picture, takes light away, or has negative entries.
    """
    system, system_error = _system(intended, unintended)
    where = f"crosstalk to the {eye} eye"
    if system > BRIGHTEST_LEAK:
        raise InputError(
            f"{where}: the other projector must be much dimmer than the own one through this "
            f"filter, got {system:.0%} of it; were the filters or the projectors exchanged?"
        )
    if system < -SIGMAS * system_error:
        raise InputError(
            f"{where}: the other projector's white must be brighter than its black, got "
            f"{system:.2%} of the own white; was black read under other light?"
        )
    inverse = np.asarray(np.linalg.inv(intended.primaries), np.float64)
    measured = inverse @ unintended.primaries
    error = _matrix_error(inverse, measured, intended, unintended)
    matrix, notes = without_small_negatives(where, measured, error, allow_negative)
    black, told_black = _seen_black(intended, unintended)
    return MeasuredCrosstalk(
        eye=eye,
        matrix=matrix,
        measured=measured,
        error=error,
        intended=intended.primaries,
        unintended=unintended.primaries,
        system=system,
        system_error=system_error,
        black=black,
        notes=(*notes, *told_black),
    )


def _system(intended: Display, unintended: Display) -> tuple[float, float]:
    own, other = float(intended.white[1]), float(unintended.white[1])
    if not own > 0:
        raise InputError(
            f"{intended.name}: white must be brighter than black, got {decimal(own)} cd/m²"
        )
    ratio = other / own
    variances = [float(_white_variance(display)[1]) for display in (intended, unintended)]
    return ratio, float(np.sqrt(variances[1] + ratio**2 * variances[0]) / own)


def _white_variance(display: Display) -> Floats:
    # Black was subtracted from each of the three readings of a sum.
    times = 1 if display.additivity is not None else 3
    return np.asarray(display.white_variance + times**2 * display.black_variance)


def _matrix_error(
    inverse: Floats, matrix: Floats, intended: Display, unintended: Display
) -> Floats:
    """(3, 3) standard errors of C, to first order."""
    rows = inverse**2
    variance = rows @ unintended.primaries_variance
    variance += (rows @ intended.primaries_variance) @ matrix**2
    variance += (rows @ unintended.black_variance)[:, None]
    variance += (rows @ intended.black_variance)[:, None] * matrix.sum(axis=0) ** 2
    return np.asarray(np.sqrt(variance))


def without_small_negatives(
    where: str, measured: Floats, error: Floats, allow_negative: bool
) -> tuple[Floats, list[str]]:
    """Sets negative entries of a crosstalk matrix to 0 where they are within their errors.

    Parameters
    ----------
    where
        Whose, for messages.
    measured, error
        The matrix and its standard errors.
    allow_negative
        See `measured_crosstalk`.

    Raises
    ------
    InputError
        If entries beyond their errors are negative, and are not to be kept.
    """
    small = (measured < 0) & (measured >= -SIGMAS * error)
    large = (measured < 0) & ~small
    cells = [
        f"{measured[i, j]:.3%} ± {error[i, j]:.3%} (own {'RGB'[i]} of the other's {'RGB'[j]})"
        for i, j in np.argwhere(large)
    ]
    if cells and not allow_negative:
        raise InputError(
            f"{where}: entries must be at least 0 within {SIGMAS:g} standard errors, got "
            f"{', '.join(cells)}; were filters exchanged, did the lamps drift, was black not "
            f"subtracted, is the meter noisier than stated? A ghost more saturated than the own "
            f"primaries is possible too: then allow negative entries"
        )
    notes = [
        f"entry {'RGB'[i]} {'RGB'[j]}: {measured[i, j]:.3%} ± {error[i, j]:.3%}, set to 0"
        for i, j in np.argwhere(small)
    ]
    if cells:
        notes.append(f"negative entries were kept: {', '.join(cells)}")
    return np.where(small, 0.0, measured), notes


def _seen_black(intended: Display, unintended: Display) -> tuple[Floats | None, list[str]]:
    own, other = intended.black, unintended.black
    if own is None or other is None:
        return own if other is None else other, []
    noise = SIGMAS * np.sqrt(intended.black_variance + unintended.black_variance)
    if (np.abs(own - other) <= np.maximum(noise, SAME_BLACK * own)).all():
        return (own + other) / 2, []
    note = (
        f"black differs with the projector (XYZ {words(own)} of the own, {words(other)} of the "
        f"other): taken as read with the other one off, so both add up, ambient light twice"
    )
    return own + other, [note]
