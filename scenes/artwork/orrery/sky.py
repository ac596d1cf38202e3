"""The night above the glass: a band of nebulae, and stars as points.

Both are given by direction, so that every camera draws them at its own sharpness.
"""

from __future__ import annotations

import numpy as np

from scenes.artwork.night.noise import Floats, fractal_noise
from scenes.artwork.night.sky import Stars, star_catalogue

_POLE = np.array([0.62, 0.45, 0.64])


def stars(seed: int) -> Stars:
    """Stars, their flux bent so that faint ones show: 1.0 is projector white in a star's middle."""
    catalogue = star_catalogue(seed, count=7000, faintest=6.6)
    brightest = catalogue.flux.max(axis=1)
    seen = brightest > 0
    flux = catalogue.flux[seen]
    return Stars(catalogue.directions[seen], np.clip(2.2 * flux**0.55, 0.0, 1.0))


def nebulae(directions: Floats, seed: int) -> Floats:
    """Radiance (..., rgb) of the sky without stars in `directions` (..., xyz)."""
    pole = _POLE / np.linalg.norm(_POLE)
    latitude = directions @ pole
    clouds = fractal_noise(directions * 3.2, 6, seed + 201)
    dust = fractal_noise(directions * 5.0 + 7.0, 5, seed + 202)
    tint = fractal_noise(directions * 1.5 + 3.0, 2, seed + 203)[..., None]
    band = np.exp(-(((latitude + 0.35 * (clouds - 0.5)) / 0.20) ** 2))
    lanes = np.clip((dust - 0.42) * 5.0, 0.0, 1.0)
    glow = band * (0.25 + 1.2 * np.clip(clouds - 0.25, 0, 1)) * (1 - 0.8 * lanes * band)
    cool, warm = np.array([0.040, 0.068, 0.124]), np.array([0.116, 0.060, 0.088])
    night = np.array([0.0016, 0.0026, 0.0055])
    light: Floats = night + glow[..., None] * (cool * (1 - tint) + warm * tint)
    return light
