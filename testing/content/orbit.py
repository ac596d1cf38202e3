"""A stereo pair of a spacecraft before a planet and its moon."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from domesim.light import Light
from testing.content.stage import HIGH, Painter, Stage
from testing.content.texture import Colour, Floats, mixed, noise, smoothstep, tinted


def space(width: int) -> Light:
    """A lit planet, its moon, and a spacecraft with bright edges before stars on black."""
    stage = Stage(width)
    for k, disparity in enumerate((-0.03, -0.027, -0.022)):
        stage.stars(disparity, 130 + k, 350, 0.01)
    stage.put(
        -0.018, _globe((0.3, 0.34), 0.2, (-0.75, -0.45, 0.42), _gas), (0.09, 0.51, 0.13, 0.55)
    )
    stage.shine(-0.018, _air((0.3, 0.34), 0.2, (-0.75, -0.45)))
    stage.put(
        -0.008, _globe((0.6, 0.14), 0.035, (-0.75, -0.45, 0.42), _rock), (0.56, 0.64, 0.1, 0.18)
    )
    for disparity, painter in _craft():
        stage.put(disparity, painter, (0.5, 1, 0, HIGH))

    def engine(x: Floats, y: Floats) -> Floats:
        away = np.hypot(x - 0.895, y - 0.35)
        return tinted(np.exp(-away / 0.006) + 0.06 * np.exp(-away / 0.02), (0.5, 0.7, 1))

    stage.shine(0.036, engine)
    return stage.light()


def _globe(
    centre: tuple[float, float],
    radius: float,
    sun: Colour,
    ground: Callable[[Floats, Floats], Floats],
) -> Painter:
    """A lit sphere, whose ground is looked up by longitude and latitude in turns."""
    towards = np.array(sun) / np.linalg.norm(sun)

    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        u, v = (x - centre[0]) / radius, (y - centre[1]) / radius
        away = np.hypot(u, v)
        w = np.sqrt(np.clip(1 - away**2, 0, 1))
        day = towards[0] * u + towards[1] * v + towards[2] * w
        tilted = np.cos(0.35) * v + np.sin(0.35) * u, np.cos(0.35) * u - np.sin(0.35) * v
        latitude = np.arcsin(np.clip(tilted[0], -1, 1)) / (2 * np.pi)
        longitude = np.arctan2(tilted[1], w) / (2 * np.pi)
        light = ground(longitude, latitude) * smoothstep(-0.05, 0.9, day)[..., None]
        return light, smoothstep(1.002, 0.996, away)

    return painter


def _gas(longitude: Floats, latitude: Floats) -> Floats:
    """Belts of a gas giant, with eddies."""
    bent = latitude + 0.006 * noise(131, longitude, 3 * latitude, 1.7)
    belts = noise(132, 0.5, 1.3 * bent, 1.5) + 0.3 * noise(133, 1.5 * longitude, 9 * bent, 1.3)
    light = mixed(
        tinted(np.ones_like(belts), (0.8, 0.68, 0.5)),
        (0.42, 0.22, 0.12),
        smoothstep(-1.3, 1.5, belts),
    )
    storm = np.hypot((longitude + 0.06) / 0.05, (bent - 0.06) / 0.022)
    return mixed(light, (0.62, 0.2, 0.1), smoothstep(1.1, 0.7, storm))


def _rock(longitude: Floats, latitude: Floats) -> Floats:
    relief = noise(134, longitude, latitude, 1.5) - noise(134, longitude + 0.004, latitude, 1.5)
    grey = 0.4 * np.clip(1 + 1.1 * relief + 0.25 * noise(135, longitude, latitude, 1.8), 0.1, 2)
    return tinted(grey, (1.0, 0.95, 0.9))


def _air(
    centre: tuple[float, float], radius: float, sun: tuple[float, float]
) -> Callable[[Floats, Floats], Floats]:
    def painter(x: Floats, y: Floats) -> Floats:
        u, v = (x - centre[0]) / radius, (y - centre[1]) / radius
        away = np.hypot(u, v)
        lit = np.clip((u * sun[0] + v * sun[1]) / away + 0.02, 0, None)
        return tinted(0.3 * lit * np.exp(-(away - 1) / 0.02) * (away > 0.999), (0.9, 0.75, 0.5))

    return painter


def _craft() -> Sequence[tuple[float, Painter]]:
    """A spacecraft: wings of solar cells, a hull of drums, and a dish; far parts first."""
    cos, sin = np.cos(-0.3), np.sin(-0.3)

    def turned(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        u, v = (x - 0.74) / 0.17, (y - 0.3) / 0.17
        return cos * u - sin * v, sin * u + cos * v

    def wing(side: int) -> Painter:
        def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
            u, v = turned(x, y)
            u = u - 0.25 * v
            high = side * v - 0.25
            inside = (np.abs(u + 0.1) < 0.24) & (high > 0) & (high < 0.85)
            boom = (np.abs(u + 0.1) < 0.02) & (side * v > 0.05) & (high < 0.9)
            grid = (np.mod(u * 25, 1) < 0.1) | (np.mod(high * 14, 1) < 0.07)
            edge = (np.abs(u + 0.1) > 0.225) | (high < 0.015) | (high > 0.835)
            sheen = 0.04 + 0.2 * np.exp(-(((u + 0.6 * high - 0.25) / 0.2) ** 2))
            cells = tinted(
                sheen * np.clip(1 + 0.12 * noise(136, 2 * u, 2 * v, 1.1), 0, 2), (0.25, 0.35, 1.0)
            )
            light = mixed(cells, (0.25, 0.26, 0.3), 0.7 * grid)
            light = mixed(light, (0.95, 0.93, 0.85), (edge & inside) | (boom & ~inside))
            return light, inside | boom

        return painter

    def hull(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        u, v = turned(x, y)
        wide = np.interp(
            u,
            [-0.85, -0.6, -0.58, 0.1, 0.12, 0.45, 0.47, 0.75, 0.9],
            [0.05, 0.17, 0.2, 0.2, 0.14, 0.14, 0.19, 0.19, 0.12],
        )
        inside = (np.abs(v) < wide) & (u > -0.85) & (u < 0.9)
        across = v / wide
        facing = np.clip(-0.75 * across + 0.5 * np.sqrt(np.clip(1 - across**2, 0, 1)), 0, 1)
        plates = 1 - 0.5 * (
            (np.mod(9 * u, 1) < 0.05)
            | (np.abs(np.mod(3 * np.arcsin(np.clip(across, -1, 1)), 1)) < 0.04)
        )
        foil = np.clip(1 + 0.35 * noise(137, 1.5 * u, 1.5 * v, 1.0), 0.2, None)
        gold = (u > 0.13) & (u < 0.45)
        light = np.where(
            gold[..., None],
            tinted(facing * foil, (0.8, 0.5, 0.15)),
            tinted(facing * plates, (0.78, 0.78, 0.8)),
        )
        rim = np.exp(-(across + 1) / 0.07)
        window = (
            (np.abs(across + 0.15) < 0.13) & (np.mod(7 * u, 1) > 0.6) & (u < 0.05) & (u > -0.55)
        )
        light = mixed(light.astype(np.float32) + 0.004, (1.0, 0.97, 0.9), np.clip(rim, 0, 1))
        return mixed(light, (0.9, 0.75, 0.4), window), inside

    def dish(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        u, v = turned(x, y)
        away = np.hypot((u + 0.95) / 0.11, v / 0.26)
        grey = 0.12 + 0.6 * smoothstep(-0.2, 0.2, (u + 0.95) + 0.6 * v) * (0.6 + 0.4 * away**2)
        light = mixed(tinted(grey, (0.9, 0.92, 1.0)), (1, 1, 1), smoothstep(0.93, 0.97, away))
        return light, away < 1

    return ((0.022, wing(-1)), (0.03, hull), (0.034, dish), (0.036, wing(1)))
