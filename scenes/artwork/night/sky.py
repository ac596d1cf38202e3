"""The sky: airglow, Milky Way and moon as radiance by direction, stars as points of light.

Directions are (..., xyz) unit vectors with x to the right, y to the front and z up. Radiance is
linear BT.709 (..., rgb) with 1.0 = projector white. Proportions are chosen for the eye, not
measured: the moon is sixteen times its real size, and the Milky Way ignores its light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.artwork.night.noise import Floats, fractal_noise

MOON_RADIUS = np.radians(4.0)


def direction(azimuth: float, elevation: float) -> Floats:
    """Unit vector at `azimuth` (degrees, from the front to the right) and `elevation` (degrees)."""
    a, e = np.radians([azimuth, elevation])
    return np.array([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)])


MOON = direction(-55.0, 37.0)
_SUN = direction(-120.0, 2.0)
_GALACTIC_POLE = direction(128.0, 24.0)
_GALACTIC_CENTRE = direction(48.0, 22.0)


@dataclass(frozen=True)
class Stars:
    """A star catalogue: directions (star, xyz) and flux (star, rgb), 1.0 for magnitude 0."""

    directions: Floats
    flux: Floats


def star_catalogue(seed: int, count: int = 11000, faintest: float = 7.2) -> Stars:
    """Stars all round, as many of each magnitude as in the sky, denser towards the Milky Way.

    The number of stars up to magnitude m grows as 10^(0.5 m) near the naked eye's limit.
    """
    rng = np.random.default_rng(seed)
    brightest = -1.2
    quantile = rng.uniform(10 ** (0.5 * (brightest - faintest)), 1.0, count)
    magnitude = faintest + 2.0 * np.log10(quantile)

    toward = rng.standard_normal((count, 3))
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    faint = np.clip((magnitude - 3.0) / 4.0, 0.0, 1.0)
    pull = 1.0 - faint * rng.uniform(0.0, 0.8, count)
    toward -= (1.0 - pull)[:, None] * (toward @ _GALACTIC_POLE)[:, None] * _GALACTIC_POLE
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)

    # From blue-white to orange; most stars seen by the naked eye are white.
    warmth = np.clip(rng.normal(0.42, 0.28, count), 0.0, 1.0)[:, None]
    colour = (1 - warmth) * np.array([0.68, 0.84, 1.35]) + warmth * np.array([1.3, 0.92, 0.55])
    flux = 10.0 ** (-0.4 * magnitude[:, None]) * colour
    through_air = np.exp(-0.12 / np.clip(toward[:, 2:], 0.03, 1.0)) * (toward[:, 2:] > 0)
    behind_moon = (toward @ MOON > np.cos(MOON_RADIUS))[:, None]
    return Stars(toward, flux * through_air * ~behind_moon)


def radiance(directions: Floats, seed: int) -> Floats:
    """Sky without stars: what lights the garden and is mirrored in the water."""
    disc, covered = moon(directions, seed)
    light: Floats = background(directions, seed) * (1.0 - covered[..., None]) + disc
    return light


def background(directions: Floats, seed: int) -> Floats:
    """Airglow, Milky Way, the towns' light on the horizon, and the glow round the moon."""
    up = np.clip(directions[..., 2:], 0.0, 1.0)
    air = np.array([0.0024, 0.0046, 0.0122]) + np.array([0.011, 0.019, 0.030]) * (1 - up) ** 4
    airglow = np.array([0.0025, 0.0060, 0.0028]) * np.exp(-(((up - 0.16) / 0.09) ** 2))
    patches = fractal_noise(directions * [3.0, 3.0, 9.0], 4, seed + 11)[..., None]

    town = np.clip(directions @ direction(-28.0, 0.0), 0.0, 1.0)[..., None] ** 3
    town_glow = np.array([0.040, 0.024, 0.011]) * town * np.exp(-up / 0.10)

    from_moon = np.arccos(np.clip(directions @ MOON, -1.0, 1.0))[..., None]
    halo = np.exp(-from_moon / 0.035) * 0.05 + np.exp(-from_moon / 0.20) * 0.012
    moonlit_air = halo * np.array([0.75, 0.88, 1.0])
    stars_beyond = _milky_way(directions, seed) * (0.25 + 0.75 * np.clip(up / 0.4, 0.0, 1.0))
    light: Floats = air + airglow * (0.3 + 1.4 * patches) + town_glow + moonlit_air + stars_beyond
    return light


def moon(directions: Floats, seed: int) -> tuple[Floats, Floats]:
    """Radiance of the moon's disc (..., rgb), and 1.0 where it covers the sky, else 0.0."""
    right = np.cross(MOON, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    above = np.cross(right, MOON)
    across = np.stack([directions @ right, directions @ above], axis=-1) / np.sin(MOON_RADIUS)
    radius_squared = (across**2).sum(axis=-1)
    covered = ((radius_squared < 1.0) & (directions @ MOON > 0)).astype(float)

    toward_us = np.sqrt(np.clip(1.0 - radius_squared, 0.0, 1.0))
    surface = np.concatenate([across, toward_us[..., None]], axis=-1)
    maria = fractal_noise(surface * 1.7 + 3.1, 4, seed + 1)
    craters = fractal_noise(surface * 9.0, 3, seed + 2)
    albedo = 0.92 - 0.55 * _step(0.50, 0.60, maria) + 0.30 * (craters - 0.5)
    sun = np.array([_SUN @ right, _SUN @ above, -(_SUN @ MOON)])
    cosine = np.clip(surface @ np.array([sun[0], sun[1], max(sun[2], 0.32)]), 0.0, 1.0)
    # The full moon has no darkening towards its limb: flatter than a Lambertian ball.
    lit = _step(0.0, 0.22, cosine) * (0.35 + 0.65 * cosine)
    colour = np.array([1.0, 0.96, 0.88]) * (albedo * lit)[..., None]
    earthshine = np.array([0.010, 0.013, 0.018]) * albedo[..., None]
    return (1.15 * colour + earthshine) * covered[..., None], covered


def _milky_way(directions: Floats, seed: int) -> Floats:
    latitude = directions @ _GALACTIC_POLE
    toward_centre = (0.5 + 0.5 * (directions @ _GALACTIC_CENTRE)) ** 2
    bend = 0.10 * (fractal_noise(directions * 2.0, 3, seed + 21) - 0.5)
    clouds = fractal_noise(directions * 5.0, 6, seed + 22)
    dust = fractal_noise(directions * [4.0, 4.0, 6.0], 6, seed + 23)

    width = 0.10 + 0.09 * toward_centre
    glow = np.exp(-(((latitude + bend) / width) ** 2)) * (0.35 + 0.65 * toward_centre)
    rift = np.exp(-(((latitude + 0.6 * bend + 0.015) / 0.055) ** 2)) * _step(0.40, 0.62, dust)
    mottled = glow * _step(0.20, 0.80, clouds) * (1.0 - 0.88 * rift)
    warm = toward_centre[..., None]
    tint = (1 - warm) * np.array([0.80, 0.92, 1.20]) + warm * np.array([1.10, 0.98, 0.86])
    light: Floats = 0.15 * mottled[..., None] * tint
    return light


def _step(low: float, high: float, value: Floats) -> Floats:
    """Smooth step from 0 at `low` to 1 at `high`."""
    part = np.clip((value - low) / (high - low), 0.0, 1.0)
    return part * part * (3.0 - 2.0 * part)
