"""The sky in astronomers' words: how bright it is, and the faintest star that is seen in it.

A sky of luminance B, cd/m², has the surface brightness

    mu = 12.58 - 2.5 log10 B    mag/arcsec²,

and a star of illuminance I at the eye, lux, the magnitude m = -2.5 log10(I / 2.54e-6) [1, 1.2].

*Crumey's threshold* [1, eqs. 28, 34, 39-44] rests on Blackwell's observers. A spot of solid angle A
is just seen at

    I = F B ((R)^q + (A C)^q)^(1/q),   R = (sqrt(a1 B^-1/2 + a2 B^-1/4 + a3) + a4 B^-1/4 + a5)^2,
                                       C =  sqrt(b1 B^-1/2 + b2 B^-1/4 + b3) + b4 B^-1/4 + b5

A = 0 is a point (eq. 34). F is 1 for forced choice in a laboratory, and 2 for his typical observer
under the sky. Three faults of the fit are mended. From 0.0216 to 0.047 cd/m² it sees fainter stars
in brighter skies, by 0.029 magnitudes: the limit is its running minimum from the dark. It falls
without end in the dark: it is held at 1e-5 cd/m², as its author does. Blackwell's lamp had 2850 K.
Other light counts as the lamp's of equal mesopic luminance [2]: the sky's, and the star's.

*Schaefer's threshold* [3] is Hecht's formula with data of Knoll, Tousey and Hulburt. It lies 0.5 to
0.9 magnitudes below Crumey's for F = 1 at 0.003 to 0.2 cd/m². For a spot it loses what Crumey's
does. Authors differ by so much: both are shown, as a span.

A show may have brighter stars than the sky. Its scene says which light is which magnitude
(``[sky]``), and by that the faintest star is told. A *star projector* beside the video keeps its
own light: all that the video takes from it is the darkness of the sky.

[1] A. Crumey, "Human contrast threshold and astronomical visibility", MNRAS 442, 2600 (2014).
[2] CIE 191:2010, MES2. [3] B. E. Schaefer, "Telescopic limiting magnitudes", PASP 102, 212 (1990).
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.room.viewing import large_threshold
from domesim.scene import DomeScene

Floats = NDArray[np.floating[Any]]

LAMP, D65 = 1.408, 2.465
"""Scotopic over photopic luminance: of Blackwell's lamp, and of projectors' white."""
FORCED_CHOICE, TYPICAL = 1.0, 2.0
"""Crumey's field factors F."""
SOURCES = f"Schaefer 1990, and Crumey 2014 with F = {TYPICAL:g}"
"""Whose thresholds the ends of `Faintest` are."""

_ZERO = 2.54e-6  # lux of magnitude 0
_ARCMINUTE = float(np.radians(1 / 60))
_DARKEST, _BRIGHTEST = 1e-5, 1e5  # cd/m²
_PER_DECADE = 1000
_R = (5.949e-8, -2.389e-7, 2.459e-7, 4.120e-4, -4.225e-4)
_RODS = 683 / 1699  # V'(555 nm), of equal energy
_ROUNDS = 60  # MES2 converges to rounding in fewer


class Faintest(NamedTuple):
    """Magnitude of the faintest star that is seen, by each of `SOURCES`."""

    schaefer: float
    crumey: float

    def fainter(self, magnitudes: float) -> Faintest:
        """The same where stars have so many magnitudes more light than they should."""
        return Faintest(self.schaefer + magnitudes, self.crumey + magnitudes)

    @property
    def told(self) -> str:
        """Both ends, in words."""
        low, high = (f"{each:.1f}" for each in sorted(self))
        return low if low == high else f"{low} to {high}"


def sky_brightness(luminance: float) -> float:
    """Returns the surface brightness of a luminance in cd/m², mag/arcsec²; infinite for none."""
    return 12.58 - 2.5 * float(np.log10(luminance)) if luminance > 0 else float("inf")


def faintest_star(luminance: float, area: float) -> Faintest:
    """Returns what a typical observer just sees of a projected sky.

    Parameters
    ----------
    luminance
        The sky's, cd/m².
    area
        Solid angle of a star's image, sr.

    Returns
    -------
    faintest
        Magnitudes, whose zero is that of the sky's stars.
    """
    crumey = limiting_magnitude(luminance, field_factor=TYPICAL, area=area, scotopic=D65)
    return Faintest(float(schaefer(luminance, area=area)), float(crumey))


def video_star(scene: DomeScene, luminance: float, area: float) -> Faintest:
    """Returns the faintest star of a dome's video, in the magnitudes of its show.

    Parameters
    ----------
    scene
        The dome: its ``[sky] zero_point``.
    luminance, area
        As for `faintest_star`.
    """
    faintest, zero = faintest_star(luminance, area), scene.sky.zero_point
    if zero is None:
        return faintest
    lux = scene.projector.white * _ARCMINUTE**2
    return faintest.fainter(zero + 2.5 * float(np.log10(lux / _ZERO)))


def projected_star(scene: DomeScene, luminance: float) -> Faintest | None:
    """Returns the faintest star of a dome's star projector, in its magnitudes.

    Parameters
    ----------
    scene
        The dome.
    luminance
        Of the sky behind it, which is the video's black, cd/m².

    Returns
    -------
    faintest
        None without a star projector.
    """
    stars = scene.sky.star_projector
    if stars is None:
        return None
    disc = np.pi / 4 * (stars.image_arcmin * _ARCMINUTE) ** 2
    brighter = 2.5 * float(np.log10(stars.zero_point_lux / _ZERO))
    return faintest_star(luminance, float(disc)).fainter(brighter)


def limiting_magnitude(
    luminance: ArrayLike,
    *,
    field_factor: float = FORCED_CHOICE,
    area: float = 0.0,
    scotopic: float = LAMP,
) -> Floats:
    """Computes Crumey's threshold.

    Parameters
    ----------
    luminance
        B of the sky, cd/m², any shape; held at 1e-5 and 1e5.
    field_factor
        F.
    area
        A, the solid angle of a star's image, sr; 0 for a point.
    scotopic
        Scotopic over photopic luminance of sky and star.

    Returns
    -------
    magnitude
        Of the same shape; it never rises with B.

    Raises
    ------
    InputError
        If a luminance is negative or not finite, or another value is not above 0.
    """
    for name, value in (("field factor", field_factor), ("scotopic ratio", scotopic)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"a star's threshold takes a {name} above 0, got {value:g}")
    crumey, _ = _tables(_required(area), scotopic)
    return np.asarray(_at(luminance, crumey) - 2.5 * np.log10(field_factor))


def schaefer(luminance: ArrayLike, *, area: float = 0.0) -> Floats:
    """Computes Schaefer's threshold, as he gives it for the naked eye.

    Parameters, result and errors are those of `limiting_magnitude`.
    """
    return _at(luminance, _tables(_required(area))[1])


def _required(area: float) -> float:
    if not (np.isfinite(area) and area >= 0):
        raise InputError(f"a star's image has a solid angle of at least 0 sr, got {area:g}")
    return float(area)


def _at(luminance: ArrayLike, magnitudes: Floats) -> Floats:
    """Magnitudes of the grid at luminances, cd/m²."""
    B = np.asarray(luminance, np.float64)
    if B.size and not (B.min() >= 0 and B.max() < np.inf):
        raise InputError(
            f"a star's threshold takes luminances of at least 0 cd/m², finite, got {B.min():g} to "
            f"{B.max():g}"
        )
    held = np.log10(np.clip(B, _DARKEST, _BRIGHTEST))
    return np.asarray(np.interp(held, np.log10(_grid()), magnitudes))


@cache
def _grid() -> Floats:
    """Luminances at which the thresholds are computed, cd/m²."""
    decades = round(np.log10(_BRIGHTEST / _DARKEST))
    return np.geomspace(_DARKEST, _BRIGHTEST, decades * _PER_DECADE + 1)


@lru_cache(maxsize=8)  # areas of stars' images differ from frame to frame
def _tables(area: float, scotopic: float = LAMP) -> tuple[Floats, Floats]:
    """Magnitudes on the grid by Crumey (F = 1) and Schaefer: running minima."""
    B = _grid()
    point, spot = (-2.5 * np.log10(_illuminance(B, each) / _ZERO) for each in (0.0, area))
    lamps = _lamps(B, scotopic)
    crumey = -2.5 * np.log10(_illuminance(lamps * B, area) / lamps / _ZERO)
    return np.minimum.accumulate(crumey), np.minimum.accumulate(_hecht(B) + spot - point)


def _illuminance(B: Floats, area: float) -> Floats:
    """I for F = 1, lux (eqs. 28, 39-44)."""
    R, C = _of(B, _R) ** 2, large_threshold(B)
    log = np.log10(B)
    q = np.where(log < np.log10(0.193), 0.6, np.minimum(0.8861 + 0.4 * log, 1.146 - 0.0885 * log))
    return np.asarray(B * (R**q + (area * C) ** q) ** (1 / q))


def _of(B: Floats, x: tuple[float, ...]) -> Floats:
    return np.asarray(np.sqrt(x[0] * B**-0.5 + x[1] * B**-0.25 + x[2]) + x[3] * B**-0.25 + x[4])


def _hecht(B: Floats) -> Floats:
    """Schaefer's magnitude: I = C (1 + sqrt(K b))^2 footcandles, b in nanolamberts."""
    b = 1e5 * np.pi * B
    rods = b < 1479
    C, K = np.where(rods, 10**-9.8, 10**-8.35), np.where(rods, 10**-1.9, 10**-5.9)
    return np.asarray(-16.57 - 2.5 * np.log10(C * (1 + np.sqrt(K * b)) ** 2))


def _lamps(B: Floats, scotopic: float) -> Floats:
    """How many times as bright the lamp is by photopic light that looks as bright (MES2)."""

    def mesopic(m: Floats, ratio: float) -> Floats:
        return (m + (1 - m) * ratio * _RODS) / (m + (1 - m) * _RODS)

    m = np.full(B.shape, 0.5)
    for _ in range(_ROUNDS):
        log = np.log10(np.maximum(B * mesopic(m, scotopic), _DARKEST))
        m = np.clip(0.7670 + 0.3334 * log, 0, 1)
    return np.asarray(mesopic(m, scotopic) / mesopic(m, LAMP))
