"""Stereo pairs of 16:9, (2, round(width * 9 / 16), width, 3): what 3D films show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from domesim.light import Light
from testing.content.evening import candles, fireworks, lamps
from testing.content.landscapes import daylight, snow
from testing.content.orbit import space
from testing.content.portrait import face
from testing.content.stage import HIGH, Painter, Stage
from testing.content.street import night_street
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


def credits_roll(width: int) -> Light:
    """Names at several depths on black, and one before a dim picture."""
    stage = Stage(width)
    rows, cols = stage.x.shape

    def still(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        light = tinted(np.exp(-y / 0.2), (0.1, 0.05, 0.03))
        light += tinted(0.006 * np.clip(1 + noise(111, x, 2 * y, 1.6), 0, None), (1, 0.6, 0.5))
        for row, (top, colour) in enumerate(
            ((0.36, (0.014, 0.011, 0.02)), (0.42, (0.005, 0.005, 0.008)))
        ):
            crest = top + 0.018 * noise(112 + row, x, 0.3, 1.6)
            grain = np.clip(1 + 0.4 * noise(114, 2 * x, 3 * y, 1.2), 0.1, None)
            light = mixed(light, tinted(grain, colour), smoothstep(-0.001, 0.001, y - crest))
        inside = (np.abs(x - 0.27) < 0.2) & (np.abs(y - 0.36) < 0.1125)
        return light, inside

    stage.put(-0.02, still)
    for disparity, colour, lines in _LINES:
        tile = text_tile(lines, rows, cols)
        stage.put(disparity, _written(tile, colour))
    return stage.light()


def faces(width: int) -> Light:
    """Two softly lit people with dark hair before a dark brown wall."""
    stage = Stage(width)

    def wall(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        pool = 0.006 + 0.05 * np.exp(-(((x - 0.62) / 0.3) ** 2) - ((y - 0.2) / 0.22) ** 2)
        grain = np.clip(1 + 0.18 * noise(140, x, y, 1.6) + 0.05 * noise(141, 5 * x, 5 * y, 1), 0, 2)
        return tinted(pool * grain, (0.8, 0.45, 0.25)), np.ones_like(x)

    stage.put(-0.025, wall)
    for disparity, at, high, sun, seed, gain in _SITTERS:
        box = (at[0] - 2 * high, at[0] + 2 * high, 0, HIGH)
        stage.put(disparity, _portrait(at, high, sun, seed, gain), box)
    return stage.light()


def _portrait(at: tuple[float, float], high: float, sun: Colour, seed: int, gain: float) -> Painter:
    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        light, cover = face((x - at[0]) / high, (y - at[1]) / high, sun, seed)
        return gain * light, cover

    return painter


def _written(tile: Floats, colour: Colour) -> Painter:
    return lambda x, y: (tinted(np.ones_like(x), colour), looked_up(tile, x, y))


_SITTERS: tuple[tuple[float, tuple[float, float], float, Colour, int, float], ...] = (
    (-0.008, (0.69, 0.27), 0.125, (-0.75, -0.3, 0.5), 145, 0.75),
    (0.02, (0.31, 0.27), 0.165, (0.75, -0.35, 0.55), 143, 1.0),
)
"""Disparity, middle of the face, half its height, direction to the lamp, seed, light."""

_LINES: tuple[tuple[float, Colour, Sequence[tuple[str, float, float, float]]], ...] = (
    (0.0, (0.85, 0.85, 0.85), (
        ("directed by", 0.022, 0.72, 0.2), ("MARIT SOLBERG", 0.042, 0.72, 0.24),
        ("photographed by", 0.022, 0.72, 0.35), ("Ken Adeyemi", 0.034, 0.72, 0.385),
    )),
    (-0.015, (0.4, 0.42, 0.45), (
        ("edited by  Lucie Charron", 0.024, 0.72, 0.45),
        ("music by  Tomas Reyes", 0.024, 0.72, 0.485),
    )),
    (0.015, (0.9, 0.9, 0.9), (("on location in the north", 0.026, 0.27, 0.37),)),
    (0.035, (0.95, 0.75, 0.3), (("THE LONG WINTER", 0.075, 0.5, 0.1),)),
)  # fmt: skip
"""Disparity, colour, and lines of text: words, height, middle (x, y)."""

PAIRS: Mapping[str, Callable[[int], Light]] = {
    "night street": night_street,
    "credits": credits_roll,
    "daylight": daylight,
    "space": space,
    "faces": faces,
    "snow": snow,
    "lamps": lamps,
    "candles": candles,
    "fireworks": fireworks,
}
"""Name -> the width of a pair -> the pair."""
