"""What the planets, moons and the sun look like: maps (row, col, rgb) of albedo, made of noise.

A map covers the ball by longitude (columns) and angle from its north pole (rows). Inner planets are
dark and outer ones bright: the lamp's light falls 20 times from the first orbit to the last.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from scenes.artwork.night.noise import Floats, fractal_noise

ROWS, COLS = 320, 640


@lru_cache(maxsize=32)
def surface(name: str, seed: int) -> Floats:
    """The map of the body called `name`; for the sun its radiance, 1.0 at the brightest."""
    theta, phi = np.meshgrid(
        (np.arange(ROWS) + 0.5) / ROWS * np.pi,
        (np.arange(COLS) + 0.5) / COLS * 2 * np.pi,
        indexing="ij",
    )
    ring = np.sin(theta)
    points = np.stack([ring * np.cos(phi), ring * np.sin(phi), np.cos(theta)], -1)
    made: Floats = np.clip(_MAKERS[name](points, seed), 0.0, 1.0)
    return made


def _sun(points: Floats, seed: int) -> Floats:
    grains = fractal_noise(points * 14.0, 3, seed + 1)
    flows = fractal_noise(points * 3.0 + 2 * _warp(points, seed + 2), 4, seed + 3)
    spots = _step(0.66, 0.74, fractal_noise(points * 2.5, 3, seed + 4))
    heat = 0.60 + 0.35 * _step(0.25, 0.75, flows) + 0.35 * (grains - 0.5) - 0.5 * spots
    return _ramp(heat, [(0.0, (0.55, 0.10, 0.02)), (0.5, (1.0, 0.52, 0.16)),
                        (0.8, (1.0, 0.80, 0.42)), (1.0, (1.0, 0.94, 0.72))])  # fmt: skip


def _ember(points: Floats, seed: int) -> Floats:
    rough = fractal_noise(points * 6.0, 5, seed + 11)
    pits = _step(0.55, 0.62, fractal_noise(points * 9.0, 2, seed + 12))
    return _tinted(0.075 * (0.5 + rough - 0.45 * pits), (1.0, 0.86, 0.74))


def _pearl(points: Floats, seed: int) -> Floats:
    bands = fractal_noise(points * [1.5, 1.5, 5.0] + 1.2 * _warp(points, seed + 21), 5, seed + 22)
    return _ramp(bands, [(0.25, (0.12, 0.085, 0.045)), (0.5, (0.19, 0.155, 0.10)),
                         (0.7, (0.23, 0.205, 0.16))])  # fmt: skip


def _ocean(points: Floats, seed: int) -> Floats:
    land = fractal_noise(points * 1.7 + 0.3 * _warp(points, seed + 31), 6, seed + 32)
    dry = fractal_noise(points * 4.0, 4, seed + 33)
    ground = _ramp(dry, [(0.3, (0.06, 0.13, 0.04)), (0.5, (0.13, 0.15, 0.06)),
                         (0.7, (0.28, 0.21, 0.12))])  # fmt: skip
    sea = np.array([0.012, 0.055, 0.14]) * (0.7 + 0.6 * dry[..., None])
    colour = np.where((land > 0.52)[..., None], ground, sea)
    ice = _step(0.80, 0.90, np.abs(points[..., 2]) + 0.25 * (dry - 0.5))
    cloud = fractal_noise(points * [2.5, 2.5, 4.5] + 0.9 * _warp(points, seed + 34), 6, seed + 35)
    white = np.maximum(ice, 0.9 * _step(0.53, 0.72, cloud))[..., None]
    covered: Floats = colour * (1 - white) + white * 0.42
    return covered


def _rust(points: Floats, seed: int) -> Floats:
    dust = fractal_noise(points * 2.2 + 0.5 * _warp(points, seed + 41), 6, seed + 42)
    colour = _ramp(dust, [(0.3, (0.16, 0.055, 0.03)), (0.5, (0.42, 0.16, 0.07)),
                          (0.7, (0.60, 0.32, 0.17))])  # fmt: skip
    ice = _step(0.88, 0.93, np.abs(points[..., 2]) + 0.15 * (dust - 0.5))[..., None]
    covered: Floats = colour * (1 - ice) + ice * np.array([0.62, 0.60, 0.58])
    return covered


def _giant(points: Floats, seed: int) -> Floats:
    swirl = _warp(points * [2.0, 2.0, 4.0], seed + 51)
    height = points[..., 2] + 0.10 * swirl[..., 2]
    storm = np.exp(-(((points - [0.80, -0.45, -0.38]) / [0.30, 0.30, 0.13]) ** 2).sum(-1))
    belts = np.sin(19.0 * height + 1.6 * np.sin(5.0 * height)) * 0.5 + 0.5
    fine = fractal_noise(points * [3.0, 3.0, 22.0] + 1.5 * swirl, 5, seed + 52)
    tone = 0.62 * belts + 0.55 * (fine - 0.5) + 0.15
    colour = _ramp(tone, [(0.0, (0.34, 0.18, 0.10)), (0.35, (0.62, 0.42, 0.27)),
                          (0.6, (0.80, 0.69, 0.54)), (0.9, (0.90, 0.86, 0.78))])  # fmt: skip
    red = np.clip(1.3 * storm, 0, 1)[..., None]
    stormy: Floats = colour * (1 - red) + red * np.array([0.62, 0.20, 0.10])
    return stormy


def _ringed(points: Floats, seed: int) -> Floats:
    height = points[..., 2]
    fine = fractal_noise(points * [1.5, 1.5, 26.0], 4, seed + 61)
    tone = 0.5 + 0.35 * np.sin(13.0 * height) + 0.5 * (fine - 0.5)
    return _ramp(tone, [(0.0, (0.66, 0.50, 0.30)), (0.5, (0.86, 0.74, 0.52)),
                        (1.0, (0.96, 0.90, 0.74))])  # fmt: skip


def _moon(bright: float, colour: tuple[float, float, float]) -> Callable[[Floats, int], Floats]:
    def made(points: Floats, seed: int) -> Floats:
        rough = fractal_noise(points * 5.0, 5, seed + 71)
        plains = _step(0.48, 0.58, fractal_noise(points * 1.8, 3, seed + 72))
        return _tinted(bright * (0.45 + rough) * (1 - 0.45 * plains), colour)

    return made


_MAKERS: dict[str, Callable[[Floats, int], Floats]] = {
    "sun": _sun,
    "ember": _ember,
    "pearl": _pearl,
    "ocean": _ocean,
    "rust": _rust,
    "giant": _giant,
    "ringed": _ringed,
    "grey moon": _moon(0.55, (1.0, 0.97, 0.92)),
    "ice moon": _moon(0.85, (0.90, 0.97, 1.0)),
    "amber moon": _moon(0.75, (1.0, 0.78, 0.45)),
}


def _warp(points: Floats, seed: int) -> Floats:
    """(..., xyz): a displacement in -0.5..0.5 that curls what it is added to."""
    return (
        np.stack([fractal_noise(points * 2.0, 3, seed + 101 * axis) for axis in range(3)], -1) - 0.5
    )


def _tinted(shade: Floats, colour: tuple[float, float, float]) -> Floats:
    tinted: Floats = shade[..., None] * np.array(colour)
    return tinted


def _ramp(value: Floats, stops: list[tuple[float, tuple[float, float, float]]]) -> Floats:
    places, colours = [stop[0] for stop in stops], np.array([stop[1] for stop in stops])
    return np.stack([np.interp(value, places, colours[:, k]) for k in range(3)], -1)


def _step(low: float, high: float, value: Floats) -> Floats:
    part: Floats = np.clip((value - low) / (high - low), 0.0, 1.0)
    return part * part * (3.0 - 2.0 * part)
