"""A domemaster of constellations, drawn as figures over a few stars."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter

from domesim.light import Light
from testing.content.dome import Dome
from testing.content.texture import (
    Points,
    closed,
    looked_up,
    magnitudes,
    noise,
    shape_tile,
    smoothstep,
    tinted,
)


def art_on_black(size: int) -> Light:
    """Figures of constellations in muted colours and thin lines over a few stars on black."""
    dome = Dome(size)
    random = np.random.default_rng(81)
    places = dome.scattered(random, 420)
    light = dome.stars(places, magnitudes(random, len(places), 0.02), random)
    tile = round(0.32 * dome.samples)
    for figure in _FIGURES:
        right, up, ahead = dome.turned(figure.azimuth, figure.altitude)
        along = np.maximum(ahead, 1e-3)
        u, v = right / along / figure.wide, -up / along / figure.wide
        cos, sin = np.cos(figure.turn), np.sin(figure.turn)
        x, y = cos * u + sin * v + 0.5, cos * v - sin * u + 0.5
        here = (ahead > 0.3) & (np.abs(x - 0.5) < 0.5) & (np.abs(y - 0.5) < 0.5)
        x, y = x[here], y[here]
        fill = looked_up(shape_tile(figure.outlines, tile, tile), x, y)
        brush = np.clip(1 + 0.35 * noise(80, 0.8 * x, 3 * y, 1.4), 0.1, None)
        # Painted as if round: dark towards the outline
        soft = gaussian_filter(shape_tile(figure.outlines, tile, tile), 0.035 * tile)
        round_ = 0.15 + 1.1 * smoothstep(0.5, 1.0, looked_up(soft, x, y))
        light[here] += tinted(0.13 * fill * brush * round_, figure.colour)
        for outline in figure.outlines:
            contour = dome.line(closed(outline) - 0.5, figure)
            light += tinted(0.16 * contour, figure.colour)
        for stroke in figure.strokes:
            inner = dome.line(np.array(stroke) - 0.5, figure, 0.0009)
            light += tinted(0.07 * inner, figure.colour)
        bones = dome.line(np.array(figure.stars) - 0.5, figure)
        light += tinted(0.11 * bones, (0.45, 0.65, 1.0))
        spots = dome.on_plane(np.array(figure.stars) - 0.5, figure)
        light += dome.stars(spots, np.full(len(spots), 1.1, np.float32), random)
    return dome.light(light)


class Figure(NamedTuple):
    """A constellation; its outlines and its stars are in widths of its square."""

    azimuth: float
    altitude: float
    turn: float
    wide: float
    colour: tuple[float, float, float]
    outlines: tuple[Points, ...]
    stars: Points
    strokes: tuple[Points, ...]


_SWAN = (
    (
        (0.5, 0.03), (0.53, 0.1), (0.52, 0.2), (0.55, 0.32), (0.66, 0.36), (0.8, 0.33),
        (0.96, 0.38), (0.88, 0.45), (0.78, 0.5), (0.66, 0.54), (0.58, 0.62), (0.57, 0.74),
        (0.63, 0.9), (0.5, 0.95), (0.38, 0.9), (0.44, 0.74), (0.42, 0.62), (0.33, 0.54),
        (0.2, 0.5), (0.11, 0.44), (0.04, 0.36), (0.2, 0.33), (0.34, 0.36), (0.45, 0.32),
        (0.48, 0.2), (0.47, 0.1),
    ),
)  # fmt: skip

_DOLPHIN = (
    (
        (0.95, 0.52), (0.85, 0.45), (0.8, 0.36), (0.68, 0.28), (0.55, 0.25), (0.5, 0.12),
        (0.42, 0.1), (0.43, 0.25), (0.3, 0.33), (0.17, 0.48), (0.05, 0.47), (0.03, 0.53),
        (0.12, 0.57), (0.1, 0.68), (0.16, 0.7), (0.23, 0.57), (0.36, 0.48), (0.5, 0.48),
        (0.56, 0.62), (0.63, 0.63), (0.64, 0.5), (0.76, 0.5), (0.86, 0.54),
    ),
)  # fmt: skip

_LYRE = (
    (
        (0.3, 0.08), (0.22, 0.15), (0.26, 0.28), (0.22, 0.45), (0.2, 0.65), (0.3, 0.85),
        (0.5, 0.93), (0.7, 0.85), (0.8, 0.65), (0.78, 0.45), (0.74, 0.28), (0.78, 0.15),
        (0.7, 0.08), (0.66, 0.18), (0.68, 0.3), (0.67, 0.5), (0.6, 0.68), (0.5, 0.72),
        (0.4, 0.68), (0.33, 0.5), (0.32, 0.3), (0.34, 0.18),
    ),
)  # fmt: skip

_FEATHERS = (
    *(
        (
            (0.5 + side * a, 0.37 + 0.25 * abs(a - 0.15)),
            (0.5 + side * (a + 0.05), 0.46 - 0.1 * a),
            (0.5 + side * (a + 0.06), 0.55 - 0.3 * a),
        )
        for side in (-1, 1)
        for a in (0.08, 0.12, 0.16, 0.2, 0.24, 0.28)
    ),
    *(((0.5 + 0.3 * a, 0.74), (0.5 + 0.7 * a, 0.82), (0.5 + a, 0.9)) for a in (-0.06, 0, 0.06)),
)
_FIGURES = (
    Figure(
        0.1, 0.95, 0.35, 1.7, (1.0, 0.82, 0.62), _SWAN,
        ((0.5, 0.07), (0.51, 0.34), (0.5, 0.6), (0.51, 0.9), (0.5, 0.6), (0.51, 0.38),
         (0.2, 0.4), (0.05, 0.36), (0.2, 0.4), (0.51, 0.38), (0.78, 0.41), (0.95, 0.39)),
        (*_FEATHERS,
         ((0.47, 0.1), (0.5, 0.12), (0.53, 0.1))),
    ),
    Figure(
        -1.25, 0.55, -0.3, 1.1, (0.5, 0.78, 0.9), _DOLPHIN,
        ((0.92, 0.51), (0.72, 0.36), (0.5, 0.38), (0.3, 0.42), (0.07, 0.5)),
        (((0.9, 0.51), (0.8, 0.46), (0.74, 0.47)), ((0.75, 0.41), (0.76, 0.415), (0.75, 0.42)),
         ((0.7, 0.45), (0.5, 0.42), (0.3, 0.45), (0.15, 0.55))),
    ),
    Figure(
        1.45, 0.75, 0.25, 0.95, (0.9, 0.62, 0.5), _LYRE,
        ((0.27, 0.12), (0.24, 0.55), (0.5, 0.84), (0.76, 0.55), (0.73, 0.12)),
        (((0.27, 0.24), (0.73, 0.24)), *(((a, 0.24),
           (a, 0.74)) for a in (0.4, 0.45, 0.5, 0.55, 0.6))),
    ),
)  # fmt: skip
