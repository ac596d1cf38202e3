"""Threshold versus intensity: the least luminance difference that the adapted eye can see.

Ferwerda, J., Pattanaik, S., Shirley, P. and Greenberg, D. (1996), "A model of visual adaptation for
realistic image synthesis", SIGGRAPH 96, 249-258: one function for the cones, one for the rods, both
of the adaptation luminance L_a. They are published in pieces that do not quite meet: the cones'
threshold drops by 0.7 % at 10^1.9 cd/m², the rods' by 2.8 % at 10^-1.44 cd/m².
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.light.guarded import guarded

Floats = NDArray[np.floating[Any]]


@final
class MesopicBlend(Enum):
    """Whose threshold holds where both rods and cones see: cinemas, domes, twilight.

    The paper (section 5) blends both, as Ferwerda et al. suggest, and does not say how; programs
    that follow them differ. These two can be traced to a publication:
    """

    MORE_SENSITIVE = "more-sensitive"
    """The lower of the two: what either system sees is seen. Rods up to 0.96 cd/m², cones above
    (Ward Larson, Rushmeier and Piatko 1997, "A visibility matching tone reproduction operator for
    high dynamic range scenes", LBNL 39882). The default: of the two it calls more light
    pollution visible, and a predictor should rather solve too much than leave a ghost."""

    CIE_191 = "cie-191"
    """``m T_cone + (1 - m) T_rod`` with the adaptation coefficient of CIE 191:2010 (system MES2),
    ``m = 0.7670 + 0.3334 log10 L_a`` within 0..1: rods alone up to 0.005 cd/m², cones alone from
    5 cd/m². The CIE blends luminous efficiencies with it; that thresholds blend alike is an
    assumption made here, and light is taken to be as bright to rods as to cones (S/P = 1)."""


@guarded
def cone_threshold(luminance: ArrayLike) -> Floats:
    """The cones' threshold (Ferwerda 1996, photopic).

    ``log10 T = -0.72`` for ``log10 L_a <= -2.6``, ``log10 L_a - 1.255`` from 1.9 on, and
    ``(0.249 log10 L_a + 0.65)^2.7 - 0.72`` between.

    Parameters
    ----------
    luminance
        L_a, adaptation luminance, cd/m², any shape; 0 has the floor's threshold.

    Returns
    -------
    Least visible difference, cd/m², of the same shape; float32 stays float32.

    Raises
    ------
    InputError
        If a luminance is negative or not finite.
    """
    return _CONES(_checked(luminance))


@guarded
def rod_threshold(luminance: ArrayLike) -> Floats:
    """The rods' threshold (Ferwerda 1996, scotopic).

    ``log10 T = -2.86`` for ``log10 L_a <= -3.94``, ``log10 L_a - 0.395`` from -1.44 on, and
    ``(0.405 log10 L_a + 1.6)^2.18 - 2.86`` between. Parameters, result and errors are those of
    `cone_threshold`.
    """
    return _RODS(_checked(luminance))


@guarded
def threshold(luminance: ArrayLike, blend: MesopicBlend = MesopicBlend.MORE_SENSITIVE) -> Floats:
    """The threshold of rods and cones together (Δ_TVI in eq. 10).

    Parameters
    ----------
    luminance
        L_a, adaptation luminance, cd/m², any shape.
    blend
        Whose threshold holds in mesopic light.

    Returns
    -------
    Least visible difference, cd/m², of the same shape; float32 stays float32.

    Raises
    ------
    InputError
        If a luminance is negative or not finite.
    """
    light = _checked(luminance)
    cones, rods = _CONES(light), _RODS(light)
    if blend is MesopicBlend.MORE_SENSITIVE:
        return np.minimum(cones, rods)
    m = np.clip(0.7670 + 0.3334 * _log10(light), 0, 1)
    return np.asarray(m * cones + (1 - m) * rods)


@final
@dataclass(frozen=True)
class _Published:
    """``log10 T``: `floor` up to `dark`, ``log10 L - weber`` from `bright` on, a power between."""

    dark: float
    bright: float
    slope: float
    offset: float
    power: float
    floor: float
    weber: float

    def __call__(self, light: Floats) -> Floats:
        log = _log10(light)
        # just above `dark` the base is about 0, and below it negative
        between = np.maximum(self.slope * log + self.offset, 0) ** self.power + self.floor
        result = np.where(log >= self.bright, log - self.weber, between)
        return np.asarray(10 ** np.where(log <= self.dark, self.floor, result))


_CONES = _Published(-2.6, 1.9, 0.249, 0.65, 2.7, -0.72, 1.255)
_RODS = _Published(-3.94, -1.44, 0.405, 1.6, 2.18, -2.86, 0.395)


def _log10(light: Floats) -> Floats:
    with np.errstate(divide="ignore"):
        return np.asarray(np.log10(light))


def _checked(luminance: ArrayLike) -> Floats:
    light = np.asarray(luminance)
    if not np.issubdtype(light.dtype, np.floating):
        light = light.astype(np.float64)
    if light.size and not (light.min() >= 0 and light.max() < np.inf):
        wrong = light[~((light >= 0) & (light < np.inf))].flat[0]
        raise InputError(
            f"a visual threshold takes luminances of at least 0 cd/m², finite, got {wrong:g}"
        )
    return light
