"""Domemasters, (1, size, size, 3), in which a fault of a method shows: what is right can be told.

All are of 8 bits: their light is that of whole sRGB codes.

    sky        a dark sky of one colour, smooth balls and stars of known light
    boards     dark and light boxes of text over a dim sky
    pieces     dark, polished things, each in its own colour
    gradient   a dark sky whose codes rise one by one, and a bright disc

Places are x to the right and y down, 1 at the rim; colours are codes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np

from domesim.light import Light
from domesim.light.transfer import named
from testing.content.dome import Dome
from testing.content.texture import (
    Colour,
    Floats,
    looked_up,
    mixed,
    noise,
    smoothstep,
    text_tile,
    tinted,
)

Ball: TypeAlias = tuple[float, float, float, Colour]
"""x, y, radius, and the colour of its middle."""

Star: TypeAlias = tuple[float, float, float]
"""x, y, code."""

Board: TypeAlias = tuple[float, float, float, float, float, Sequence[str]]
"""Azimuth, altitude, width, codes of its ground and of its letters, lines."""

CELLS = 384
"""Size at which a star is one pixel."""
LIMB = 0.4
"""Exponent of a ball's codes in the cosine of the angle at which they are seen."""

_CODES = 255
_CURVE = named("srgb", white=1.0)


def sky(size: int, colour: Colour, balls: Sequence[Ball], stars: Sequence[Star]) -> Light:
    """A dark sky of one colour, with balls that darken to their limbs, and stars of one pixel."""
    dome = Dome(size)
    codes = tinted(np.ones_like(dome.x), colour)
    for x, y, radius, middle in balls:
        away = np.hypot(dome.x - x, dome.y - y) / radius
        height = np.sqrt(np.clip(1 - away**2, 0, None))
        codes = mixed(codes, tinted(height**LIMB, middle), away < 1)
    columns, rows = (np.floor((grid + 1) / 2 * CELLS) for grid in (dome.x, dome.y))
    for x, y, code in stars:
        column, row = (np.floor((place + 1) / 2 * CELLS) for place in (x, y))
        codes[(columns == column) & (rows == row)] = code
    return _shown(dome, _decoded(codes))


def boards(size: int, colour: Colour, seed: int, texts: Sequence[Board]) -> Light:
    """Boxes of text over a dim sky with clouds."""
    dome = Dome(size)
    clouds = np.clip(1 + 0.6 * noise(seed, 0.6 * dome.x, 0.6 * dome.y, 1.7), 0.1, None)
    light = _decoded(tinted(clouds, colour))
    for azimuth, altitude, wide, ground, letters, lines in texts:
        right, up, ahead = dome.turned(azimuth, altitude)
        along = np.maximum(ahead, 0.1) * wide
        x, y = right / along + 0.5, 0.5 - up / along
        high = 0.8 / len(lines)
        rows = [(line, min(0.12, high), 0.5, (row + 0.7) * high) for row, line in enumerate(lines)]
        tile = text_tile(rows, dome.samples // 2, dome.samples // 2)
        inside = (np.abs(x - 0.5) < 0.5) & (np.abs(y - 0.45) < 0.45) & (ahead > 0.1)
        box = ground + (letters - ground) * looked_up(tile, x, y)
        light = mixed(light, _decoded(tinted(box, (1, 1, 1))), inside)
    return _shown(dome, light)


def pieces(size: int, colours: Sequence[Colour], seed: int, count: int) -> Light:
    """Polished balls on a dark ground; each has one of the colours and a small highlight."""
    dome = Dome(size)
    random = np.random.default_rng(seed)
    grain = np.clip(1 + 0.5 * noise(seed, 0.5 * dome.x, 4 * dome.y, 1.4), 0.1, None)
    light = _decoded(tinted(grain, np.mean(colours, axis=0) / 4))
    sun = np.array([-0.5, -0.6, 0.62])
    for number in range(count):
        x, y = random.uniform(-0.7, 0.7, 2)
        radius = random.uniform(0.08, 0.2)
        u, v = (dome.x - x) / radius, (dome.y - y) / radius
        away = np.hypot(u, v)
        w = np.sqrt(np.clip(1 - away**2, 0, None))
        lit = np.clip(sun[0] * u + sun[1] * v + sun[2] * w, 0, 1)
        ball = _decoded(tinted(0.35 + 0.65 * lit, colours[number % len(colours)]))
        ball += tinted(0.5 * lit**60, (1, 0.9, 0.8))
        light = mixed(light, ball, smoothstep(1.01, 0.99, away))
    return _shown(dome, light)


def gradient(size: int, low: Colour, high: Colour, turn: float, moon: Ball) -> Light:
    """A sky from one dark colour at the rim to another at the other side, and a flat bright disc.

    `turn` is where it is highest, radians from the right downwards.
    """
    dome = Dome(size)
    share = 0.5 + 0.5 * (np.cos(turn) * dome.x + np.sin(turn) * dome.y)
    x, y, radius, colour = moon
    inside = np.hypot(dome.x - x, dome.y - y) < radius
    return _shown(
        dome, _decoded(mixed(tinted(1 - share, low) + tinted(share, high), colour, inside))
    )


def _decoded(codes: Floats) -> Floats:
    return np.asarray(_CURVE.decode(np.clip(codes / _CODES, 0, 1)), np.float32)


def _shown(dome: Dome, light: Floats) -> Light:
    """The picture, in whole codes."""
    codes = np.round(_CODES * _CURVE.encode(dome.light(light))) / _CODES
    return np.asarray(_CURVE.decode(codes), np.float32)


_TEN = tuple(
    (-0.511 + 0.0977 * at, -0.511, code)
    for at, code in enumerate((30.0, 50.0, 70.0, 100.0, 130.0, 160.0, 190.0, 220.0, 240.0, 255.0))
)
_MAGNITUDES = tuple(
    (0.8 * float(np.sin(turn)), 0.8 * float(np.cos(turn)), float(code))
    for turn, code in zip(
        np.linspace(0.2, 5.8, 8), _CODES * _CURVE.encode(10 ** (-0.4 * np.arange(8))), strict=True
    )
)
"""Stars of magnitudes 0 to 7, where 0 is white."""

BALLS: Mapping[str, Sequence[Ball]] = {
    "ten stars": ((0.0, 0.5, 0.4, (242.0, 217.0, 178.0)),),
    "smooth limb": ((0.1, -0.05, 0.55, (174.0, 120.0, 90.0)),),
    "magnitudes": (
        (-0.3, -0.2, 0.22, (210.0, 222.0, 255.0)),
        (0.35, 0.25, 0.12, (255.0, 150.0, 90.0)),
        (0.1, -0.45, 0.05, (120.0, 120.0, 120.0)),
    ),
}
"""Name of a chart -> its balls."""

CHARTS: Mapping[str, Callable[[int], Light]] = {
    "ten stars": partial(
        sky,
        colour=(1.0, 2.0, 3.0),
        balls=BALLS["ten stars"],
        stars=_TEN,
    ),
    "smooth limb": partial(sky, colour=(0.0, 0.0, 0.0), balls=BALLS["smooth limb"], stars=()),
    "dark notice": partial(
        boards,
        colour=(24.0, 26.0, 34.0),
        seed=80,
        texts=(
            (0.0, 0.5, 0.8, 0.0, 200.0, ("NO FLASH", "No phones", "Thank you")),
            (1.9, 0.6, 0.6, 3.0, 120.0, ("Tonight", "20:30", "22:00")),
            (-2.0, 0.7, 0.7, 40.0, 230.0, ("Exit", "to the left")),
        ),
    ),
    "dark reds": partial(
        pieces,
        colours=(
            *((70.0, 16.0, 10.0), (40.0, 8.0, 6.0), (24.0, 4.0, 4.0)),
            (235.0, 215.0, 180.0),
        ),
        seed=81,
        count=10,
    ),
    "first codes": partial(
        gradient,
        low=(0.0, 0.0, 0.0),
        high=(9.0, 11.0, 16.0),
        turn=1.2,
        moon=(-0.4, 0.1, 0.25, (255.0, 250.0, 240.0)),
    ),
    "magnitudes": partial(
        sky,
        colour=(4.0, 3.0, 2.0),
        balls=BALLS["magnitudes"],
        stars=_MAGNITUDES,
    ),
    "boards": partial(
        boards,
        colour=(14.0, 20.0, 22.0),
        seed=82,
        texts=(
            (0.3, 0.45, 0.9, 8.0, 160.0, ("Jupiter", "five times as far", "as the Sun")),
            (-1.1, 0.5, 0.6, 0.0, 90.0, ("Io", "Europa", "Ganymede", "Callisto")),
            (2.6, 0.8, 0.8, 60.0, 255.0, ("Next", "Saturn")),
        ),
    ),
    "mahogany": partial(
        pieces,
        colours=(
            *((58.0, 22.0, 14.0), (34.0, 12.0, 18.0), (18.0, 14.0, 30.0), (12.0, 20.0, 12.0)),
            (200.0, 190.0, 170.0),
        ),
        seed=83,
        count=14,
    ),
    "dusk": partial(
        gradient,
        low=(14.0, 6.0, 3.0),
        high=(1.0, 2.0, 6.0),
        turn=-0.4,
        moon=(0.3, 0.5, 0.15, (230.0, 225.0, 210.0)),
    ),
}
"""Name -> the size of a domemaster -> the domemaster."""
