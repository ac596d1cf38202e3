"""White and gamut of a display in a colourist's figures, by colour-science.

White's colour temperature is Ohno's (2013): `colour.xy_to_CCT` looks for daylight and is 400 K off
beside it. A colour difference is CIE Delta E 2000, and that of ITU-R BT.2124, which knows how
bright colours are. Coverage is by area in CIE 1976 u'v'.

colour-science takes two seconds to import: that is done when a figure is asked for.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.frames.colour import CHROMATICITIES
from domesim.readings.gamut import area_of, intersection, triangle
from domesim.readings.response import uv

Floats = NDArray[np.float64]

COVERED = ("BT.709", "P3-D65", "BT.2020")
"""Gamuts whose coverage is told."""

_FAR = 0.05  # Duv beyond which a colour has no temperature (CIE 15:2018, 9.5)
_D65 = np.array(CHROMATICITIES["BT.709"][6:])


@final
@dataclass(frozen=True)
class Colours:
    """White and gamut of a display.

    Parameters
    ----------
    primaries
        (XYZ, RGB) light of each, cd/m², black not included.
    """

    primaries: Floats

    @property
    def white(self) -> Floats:
        """(XYZ,) of white, cd/m²."""
        return np.asarray(self.primaries.sum(axis=1))

    @cached_property
    def temperature(self) -> tuple[float, float] | None:
        """Correlated colour temperature, K, and Duv, + if greener; None far from Planck's locus."""
        u, v = uv(self.white)
        find = science().temperature.uv_to_CCT_Ohno2013
        try:
            with warnings.catch_warnings(action="error"):  # beyond 1000 to 100 000 K
                kelvin, away = find(np.array([u, 2 * v / 3]))
        except Warning:
            return None
        return (float(kelvin), float(away)) if abs(away) <= _FAR else None

    @cached_property
    def from_d65(self) -> tuple[float, float]:
        """Delta E 2000 and ITP of white from D65 as bright."""
        return difference(self.white, _light(_D65) * self.white[1])

    @cached_property
    def coverage(self) -> dict[str, float]:
        """Share of each gamut of `COVERED` that is shown, 0..1."""
        own = triangle(self.primaries)
        shares = {}
        for name in COVERED:
            xy = np.reshape(CHROMATICITIES[name][:6], (3, 2))
            wanted = triangle(np.stack([_light(each) for each in xy], -1))
            shown = intersection(own, wanted)
            shares[name] = area_of(shown) / area_of(wanted)
        return shares

    def lines(self) -> list[str]:
        """Lines for a person."""
        temperature = "no colour temperature"
        if self.temperature is not None:
            kelvin, away = self.temperature
            temperature = f"{kelvin:.0f} K, Duv {away:+.4f}"
        two_thousand, itp = self.from_d65
        gamuts = ", ".join(f"{share:.1%} of {name}" for name, share in self.coverage.items())
        return [
            f"white: {temperature}; from D65 Delta E 2000 {two_thousand:.1f}, ITP {itp:.1f}",
            f"gamut (u'v'): {gamuts}",
        ]

    def figures(self) -> dict[str, Any]:
        """For a program."""
        kelvin, away = self.temperature or (None, None)
        two_thousand, itp = self.from_d65
        return {
            "white_cct_k": kelvin,
            "white_duv": away,
            "white_from_d65_delta_e_2000": two_thousand,
            "white_from_d65_delta_e_itp": itp,
            "coverage": dict(self.coverage),
        }


def difference(one: ArrayLike, other: ArrayLike) -> tuple[float, float]:
    """How different two colours are, seen by an eye that takes D65 as white.

    Parameters
    ----------
    one, other
        (XYZ,) cd/m²; the brighter one's luminance is white for Delta E 2000.

    Returns
    -------
    differences
        CIE Delta E 2000, and Delta E ITP (ITU-R BT.2124).
    """
    colour, both = science(), np.stack([one, other]).astype(np.float64)
    lab = colour.XYZ_to_Lab(both / both[:, 1].max(), illuminant=_D65)
    to_rgb = colour.RGB_COLOURSPACES["ITU-R BT.2020"].matrix_XYZ_to_RGB
    # Of light below 0 the PQ encoder makes full white
    rgb = np.maximum(both @ np.transpose(to_rgb), 0)
    itp = colour.models.RGB_to_ICtCp(rgb, method="ITU-R BT.2100-2 PQ", L_p=10_000)
    return (
        float(colour.difference.delta_E_CIE2000(*lab)),
        float(colour.difference.delta_E_ITP(*itp)),
    )


def locus() -> Floats:
    """(wavelength, u'v') of spectral colours, 390 to 700 nm, by the CIE 1931 observer."""
    observer = science().MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    seen = (observer.wavelengths >= 390) & (observer.wavelengths <= 700)
    return uv(observer.values[seen])


@cache
def science() -> Any:
    """colour-science, without what it says of parts that are not installed."""
    with warnings.catch_warnings(action="ignore"):
        return import_module("colour")


def _light(xy: Floats) -> Floats:
    """(XYZ,) of luminance 1."""
    x, y = xy
    return np.array([x / y, 1, (1 - x - y) / y])
