"""castleCSF: contrast sensitivity of the eye's achromatic and two colour mechanisms.

Light falls on the cones (L, M, S), whose responses are compared with one another: their sum is the
*achromatic* mechanism, their differences are *red-green* and *yellow-violet* (DKL: Derrington,
Krauskopf, Lennie 1984). A static grating stands out for mechanism k when its contrast, the change
of k's response over the achromatic response to the background, exceeds 1 / S_k:

    C_k = |Delta R_k| / R_achromatic(background)        seen when  sum_k (S_k C_k)^2 >= 1

    S_k(rho) = S_max(l) Lambda(rho) rho sqrt(A_c / (1 + A_c / A)),     A_c = A_0 / (1 + (rho/f_0)^2)

Lambda is a log-parabola about the peak frequency, cut off below it; the root is the integration
over the stimulus's area A, up to a critical area A_c (Rovamo, Luntinen, Näsänen 1993). The
parameters are those of version 0.2 of the authors' code and later, which are the paper's.

Left out is the tail of the transient channel that the authors' code adds at 0 Hz, because it is an
artefact: exp(-|omega_0|^0.38 / 0.084), omega_0 = 4.7 + 2.41 log10 l, is below 0.3 % of S from
0.02 cd/m² up (to 16 cycles/degree), but runs to 1 where omega_0 crosses zero, and would make S tens
of times larger in a narrow band about l = 0.0113 cd/m². The authors' own table in ColorVideoVDP
shows no trace of it.

Along yellow-violet these parameters are 0.32 to 0.40 log10 less sensitive than the table of
ColorVideoVDP (``weber_fixed_size``), which is of an older calibration. The thresholds that the
authors publish decide for the parameters: in four sets of three laboratories they are off by -0.04
to 0.11 log10 in the mean, the table by 0.26 to 0.45 (``validation/notes/0012``).

Eccentricity is 0.

Ashraf, M., Mantiuk, R. K., Chapiro, A., Wuerger, S. (2024), "castleCSF: a contrast sensitivity
function of color, area, spatiotemporal frequency, luminance and eccentricity", Journal of Vision
24(4), 5. Parameters from the authors' code, github.com/gfxdisp/castleCSF (MIT licence, copyright
2023 Graphics and Displays group, University of Cambridge).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.light.guarded import guarded

Floats = NDArray[np.floating[Any]]

LMS_FROM_XYZ: Floats = np.array(
    [
        [0.187596268556126, 0.585168649077728, -0.026384263306304],
        [-0.133397430663221, 0.405505777260049, 0.034502127690364],
        [0.000244379021663, -0.000542995890619, 0.019406849066323],
    ]
)
"""CIE 2006 cone responses from CIE 1931 XYZ, for the spectra of an LED display (xyz2lms2006.m)."""

DKL_FROM_LMS: Floats = np.array([[1, 1, 0], [1, -2.3112, 0], [-1, -1, 50.9875]])
"""Responses of achromatic, red-green, yellow-violet; about (1, 0, 0) x luminance for D65
(CSF_castleCSF.m, colmat; Wuerger et al. 2020, J. Vision 20(4) 23)."""

DKL_FROM_XYZ: Floats = DKL_FROM_LMS @ LMS_FROM_XYZ
"""Responses of the three mechanisms from XYZ; the first is about Y."""


@final
@dataclass(frozen=True)
class Saturating:
    """A quantity that grows with luminance and levels off: ``a (1 + b / l)^-c``."""

    limit: float  # a
    knee: float  # b, cd/m²
    power: float  # c

    def __call__(self, luminance: Floats) -> Floats:
        """The value at `luminance`, cd/m²."""
        return np.asarray(self.limit * (1 + self.knee / luminance) ** -self.power)


@final
@dataclass(frozen=True)
class Decline:
    """The loss of sensitivity in bright light: ``1 - (1 + d / l)^-e``."""

    knee: float  # d, cd/m²
    power: float  # e

    def __call__(self, luminance: Floats) -> Floats:
        """The share left at `luminance`, cd/m²."""
        # d / l is near the rounding of 1, and e near its inverse
        return np.asarray(-np.expm1(-self.power * np.log1p(self.knee / luminance)))


@final
@dataclass(frozen=True)
class Mechanism:
    """One of the eye's three mechanisms, as `castle` takes it.

    Parameters
    ----------
    peak_sensitivity
        S_max, per square root of deg², as a function of luminance.
    peak_frequency
        f_max, cycles/degree: a function of luminance, or one value for all luminances.
    bandwidth
        bw: the log-parabola's width is 2^bw decades².
    plateau
        Least share of the peak that the log-parabola keeps below the peak frequency, 0..1.
    critical_area
        A_0, deg², the critical area at frequency 0.
    corner_frequency
        f_0, cycles/degree, from which on the critical area shrinks.
    decline
        The loss in bright light, if any.
    """

    peak_sensitivity: Saturating
    peak_frequency: Saturating | float
    bandwidth: float
    plateau: float
    critical_area: float
    corner_frequency: float
    decline: Decline | None = None


ACHROMATIC = Mechanism(
    peak_sensitivity=Saturating(56.4947, 7.54726, 0.144532),
    decline=Decline(5.58341e-07, 9.66862e09),
    peak_frequency=Saturating(1.78119, 91.5718, 0.256682),
    bandwidth=0.000213047,
    plateau=1 - 0.100207,
    critical_area=157.103,
    corner_frequency=0.702338,
)
"""The sustained achromatic channel (CSF_castleCSF.m, par.ach.ach_sust)."""

RED_GREEN = Mechanism(
    peak_sensitivity=Saturating(681.434, 38.0038, 0.480386),
    peak_frequency=0.0178364,
    bandwidth=2.42104,
    plateau=1.0,
    critical_area=2816.44,
    corner_frequency=0.0711058,
)
"""The red-green channel (CSF_castleCSF.m, par.rg)."""

YELLOW_VIOLET = Mechanism(
    peak_sensitivity=Saturating(166.683, 62.8974, 0.41193),
    peak_frequency=0.00425753,
    bandwidth=2.68197,
    plateau=1.0,
    critical_area=2.82789e07,
    corner_frequency=0.000635093,
)
"""The yellow-violet channel (CSF_castleCSF.m, par.yv)."""

MECHANISMS = (ACHROMATIC, RED_GREEN, YELLOW_VIOLET)
"""All mechanisms, in the order of the rows of `DKL_FROM_LMS`."""

COLORVIDEOVDP = (
    Mechanism(
        peak_sensitivity=Saturating(68.0670588671466, 59.50394302395729, 0.16427390269455916),
        decline=Decline(9.264027307591269e-07, 6333543813.281867),
        peak_frequency=Saturating(1.6214411268627504, 36.65594630701373, 0.2558234212911915),
        bandwidth=0.0002196132565581701,
        plateau=0.8963162538854287,
        critical_area=1388579.993948143,
        corner_frequency=0.009181573710128874,
    ),
    Mechanism(
        peak_sensitivity=Saturating(3842.367573436226, 36.787, 0.486759),
        peak_frequency=0.000367109,
        bandwidth=3.15666,
        plateau=1.0,
        critical_area=19246644.86381889,
        corner_frequency=0.0009552985594687426,
    ),
    Mechanism(
        peak_sensitivity=Saturating(437.45369314267634, 70.9537, 0.38997),
        peak_frequency=0.00194905,
        bandwidth=2.92254,
        plateau=1.0,
        critical_area=3.4989824330226314e18,
        corner_frequency=1.7886287748786725e-09,
    ),
)
"""The same mechanisms in an older calibration by the authors: that of ColorVideoVDP's table
(``csf_lut_weber_fixed_size.json``), where S > 1. log10 S is met to 2e-5 (achromatic) and 2e-15
(colours) at `DETAIL`."""


DETAIL = float(np.pi * 1.5**2)
"""Area of a pattern, deg², where none is given: that of ColorVideoVDP's table, of 3° across."""


@guarded(frequency="*s", luminance="*s")
def castle(
    frequency: ArrayLike, luminance: ArrayLike, mechanism: Mechanism, *, area: float
) -> Floats:
    """Computes the sensitivity (1 / threshold contrast) to a static grating in the fovea.

    The contrast is `opponent_contrast`'s: for `ACHROMATIC` the Weber contrast, for the colours the
    change of the mechanism's response over the background's *achromatic* response.

    Parameters
    ----------
    frequency
        rho, cycles/degree, any shape; measured from 1/16 to 64.
    luminance
        l of the background, cd/m², broadcast with `frequency`; measured from 0.001 to 10 000.
    mechanism
        `ACHROMATIC`, `RED_GREEN` or `YELLOW_VIOLET`.
    area
        A, the grating's area, deg² (pi sigma² for a Gaussian window).

    Returns
    -------
    sensitivity
        Of the common shape; 0 at frequency 0.

    Raises
    ------
    InputError
        If a frequency is negative, or a luminance or the area is not above 0 and finite.
    """
    rho = np.asarray(frequency, np.float64)
    l = np.asarray(luminance, np.float64)  # noqa: E741
    if not (np.isfinite(area) and area > 0):
        raise InputError(f"castleCSF takes an area above 0, got {area:g}")
    if rho.size and not rho.min() >= 0:
        raise InputError(f"castleCSF takes frequencies of at least 0, got {rho.min():g}")
    if l.size and not (l.min() > 0 and np.isfinite(l.max())):
        raise InputError(f"castleCSF takes luminances above 0, got {l.min():g} to {l.max():g}")
    S_max = mechanism.peak_sensitivity(l)
    if mechanism.decline is not None:
        S_max = S_max * mechanism.decline(l)
    A_c = mechanism.critical_area / (1 + (rho / mechanism.corner_frequency) ** 2)
    integration = np.sqrt(A_c / (1 + A_c / area))
    return np.asarray(S_max * _shape(rho, l, mechanism) * integration * rho)


def _shape(rho: Floats, l: Floats, mechanism: Mechanism) -> Floats:  # noqa: E741
    """Lambda, 0..1: the log-parabola about the peak frequency, cut off below it."""
    peak = mechanism.peak_frequency
    f_max = peak(l) if isinstance(peak, Saturating) else peak
    with np.errstate(divide="ignore"):  # frequency 0 lies on the plateau
        parabola = 10.0 ** (-(np.log10(rho / f_max) ** 2) / 2**mechanism.bandwidth)
    return np.asarray(np.where(rho < f_max, np.maximum(parabola, mechanism.plateau), parabola))


@guarded(difference="*s 3", background="*s 3")
def opponent_contrast(difference: ArrayLike, background: ArrayLike) -> Floats:
    """Returns signed contrasts of a coloured difference, in the order of `MECHANISMS`.

    ``C_k = (M difference)_k / (M background)_achromatic``, M = `DKL_FROM_XYZ` (the authors'
    post-receptoral contrast, csf_chrom_directions in CSF_castleCSF.m, with its sign kept).

    Parameters
    ----------
    difference
        Change of XYZ, (..., 3), in the background's unit.
    background
        XYZ of the background, broadcast with `difference`.

    Returns
    -------
    Floats
        (..., 3).

    Raises
    ------
    InputError
        If the last axis does not hold three values, or the background is not brighter than black.
    """
    change, around = np.asarray(difference, np.float64), np.asarray(background, np.float64)
    achromatic = around @ DKL_FROM_XYZ[0]
    if achromatic.size and not achromatic.min() > 0:
        raise InputError("opponent contrast takes a background brighter than black")
    return np.asarray((change @ DKL_FROM_XYZ.T) / achromatic[..., np.newaxis])
