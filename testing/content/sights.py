"""Four domemasters, (1, size, size, 3): a spiral galaxy, a skyline, a network and lava."""

from __future__ import annotations

import numpy as np

from domesim.light import Light
from testing.content.dome import Dome
from testing.content.texture import magnitudes, mixed, noise, ridges, smoothstep, tinted


def spiral(size: int) -> Light:
    """A spiral galaxy, seen from beside its plane: a warm bulge, blue arms, dust and red clouds."""
    dome = Dome(size)
    random = np.random.default_rng(91)
    cos, sin = np.cos(0.6), np.sin(0.6)
    u, v = cos * dome.x + sin * dome.y, 1.8 * (cos * dome.y - sin * dome.x)
    away, turn = np.hypot(u, v) + 1e-3, np.arctan2(v, u)
    wound = 2 * (turn + 3.2 * np.log(away)) + 0.5 * noise(90, 0.5 * u, 0.5 * v)
    arms = np.exp(3 * (np.cos(wound) - 1)) * np.exp(-away / 0.32) * smoothstep(0.03, 0.15, away)
    knots = smoothstep(0.8, 2.2, noise(91, 3 * u, 3 * v, 1.2)) * arms
    dust = smoothstep(-0.3, 1.6, noise(92, 1.5 * u, 1.5 * v, 1.4) + np.cos(wound - 0.8))
    gas = np.clip(1 + 0.5 * noise(93, 2 * u, 2 * v, 1.3), 0.1, None)
    light = tinted(0.3 * arms * gas, (0.6, 0.75, 1.0))
    light += tinted(0.5 * knots, (1.0, 0.3, 0.45))
    light += tinted(0.9 * np.exp(-away / 0.06) + 0.05 * np.exp(-away / 0.25), (1.0, 0.8, 0.55))
    light *= np.exp(-1.1 * dust)[..., None]
    places = dome.scattered(random, 900)
    light += dome.stars(places, magnitudes(random, len(places), 0.02), random)
    return dome.light(1 - np.exp(-light))


def skyline(size: int) -> Light:
    """Towers with lit windows around the horizon, a moon, and the last light of the sky."""
    dome = Dome(size)
    random = np.random.default_rng(95)
    altitude = np.pi / 2 - dome.angle
    towards = 0.5 + 0.5 * np.cos(dome.azimuth - 1.1)
    light = tinted(0.002 + 0.06 * towards * np.exp(-altitude / 0.18), (1.0, 0.5, 0.35))
    light += tinted(0.006 * (1 - dome.angle / np.pi), (0.3, 0.45, 1.0))
    right, up, ahead = dome.turned(azimuth=-2.2, altitude=0.9)
    moon = smoothstep(0.052, 0.048, np.hypot(right, up)) * (ahead > 0)
    light += tinted(moon * (0.75 + 0.1 * noise(95, 3 * right, 3 * up)), (1.0, 0.96, 0.88))
    across = (dome.azimuth / (2 * np.pi) + 0.5) * 40
    number = np.floor(across).astype(int) % 40
    high = random.uniform(0.08, 0.4, 40)[number]
    storeys = altitude / 0.035
    column, row = np.floor(across % 1 * 4).astype(int), np.floor(storeys).astype(int) % 12
    on = (random.uniform(0, 1, (40, 4, 12)) > 0.72)[number, column, row]
    pane = smoothstep(0.42, 0.28, np.abs(across * 4 % 1 - 0.5))
    pane = pane * smoothstep(0.42, 0.28, np.abs(storeys % 1 - 0.5)) * on
    hues = np.array([(0.7, 0.5, 0.2), (0.5, 0.55, 0.6), (0.35, 0.18, 0.08)])
    lit = hues[random.integers(0, 3, (40, 4, 12))][number, column, row]
    wall = tinted(0.004 * random.uniform(0.3, 1, 40)[number], (0.8, 0.9, 1.0))
    tower = mixed(wall, lit, pane)
    return dome.light(mixed(light, tower, smoothstep(0.002, -0.002, altitude - high)))


def network(size: int) -> Light:
    """Thin coloured circles and glowing knots on black, as data are shown."""
    dome = Dome(size)
    random = np.random.default_rng(96)
    light = np.zeros((*dome.x.shape, 3), np.float32)
    for colour in 0.7 * random.uniform(0.1, 1, (9, 3)):
        right, up, ahead = dome.turned(random.uniform(-np.pi, np.pi), random.uniform(0.1, 1.4))
        light += tinted(0.6 * smoothstep(0.009, 0.003, np.abs(up)), colour)
        for turn in random.uniform(-np.pi, np.pi, 7):
            off = np.arccos(np.clip(np.cos(turn) * ahead + np.sin(turn) * right, -1, 1))
            knot = smoothstep(0.022, 0.016, off) + 0.12 * np.exp(-off / 0.04)
            light += tinted(knot, colour / colour.max())
    return dome.light(light)


def lava(size: int) -> Light:
    """Dark rock with glowing cracks, brighter to one side."""
    dome = Dome(size)
    x, y = 0.5 * dome.x, 0.5 * dome.y
    u, v = x + 0.05 * noise(97, x, y, 2.0), y + 0.05 * noise(98, x, y, 2.0)
    heat = np.exp(-np.hypot(dome.x - 0.5, dome.y - 0.3) / 0.5)
    cracks = ridges(99, u, v, 1.9, 0.05) + 0.5 * ridges(100, 2 * u, 2 * v, 1.8, 0.06)
    rock = 0.012 * np.clip(1 + 0.6 * noise(101, 2 * x, 2 * y, 1.2), 0.05, None)
    light = tinted(rock * (0.3 + heat), (0.8, 0.75, 0.7))
    light += tinted(1.3 * heat * cracks, (1.0, 0.28, 0.05))
    light += tinted(0.5 * heat**2 * cracks**3, (0.4, 0.5, 0.2))
    return dome.light(1 - np.exp(-light))
