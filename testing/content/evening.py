"""Three stereo pairs of an evening: lamps on black, candles in a dark room, and fireworks."""

from __future__ import annotations

import numpy as np

from domesim.light import Light
from testing.content.stage import Painter, Shine, Stage
from testing.content.texture import Colour, Floats, noise, smoothstep, tinted


def lamps(width: int) -> Light:
    """Sharp lamps on pure black, at depths before and behind the screen."""
    stage = Stage(width)
    random = np.random.default_rng(120)
    for disparity in np.linspace(-0.03, 0.04, 12):
        at, colour = random.uniform((0.1, 0.06), (0.9, 0.5)), random.uniform(0.5, 1, 3)
        stage.put(float(disparity), _disc(at, random.uniform(0.004, 0.016), colour))
    return stage.light()


def candles(width: int) -> Light:
    """Candles on a table, the glow that they cast on a panelled wall, and dark bottles."""
    stage = Stage(width)
    places = [(0.2, 0.36, -0.006), (0.47, 0.33, 0.004), (0.74, 0.38, 0.018), (0.62, 0.31, -0.012)]

    def wall(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        glow = sum(np.exp(-np.hypot(x - at, y - top) / 0.1) for at, top, _ in places)
        panel = smoothstep(0.0, 0.1, np.abs(np.mod(9 * x, 1) - 0.5)) * (0.7 + 0.3 * (y > 0.2))
        grain = np.clip(1 + 0.25 * noise(121, 0.7 * x, 5 * y, 1.4), 0.2, None)
        return tinted((0.0015 + 0.03 * glow) * panel * grain, (1, 0.6, 0.32)), np.ones_like(x)

    def table(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        glow = sum(np.exp(-((x - at) ** 2) / 0.006) for at, *_ in places)
        grain = np.clip(1 + 0.4 * noise(122, 4 * x, 0.6 * y, 1.5), 0.1, None)
        return tinted((0.002 + 0.05 * glow) * grain, (1, 0.5, 0.22)), smoothstep(0.459, 0.461, y)

    stage.put(-0.025, wall)
    stage.put(0.01, table)
    for at, top, disparity in places:
        stage.put(disparity, _column((at, top + 0.03), 0.012, 0.09, (0.5, 0.34, 0.18)))
        stage.shine(disparity, _glow((at, top), 0.006, (1.0, 0.75, 0.35)))
    for at, disparity in ((0.33, 0.014), (0.87, 0.026), (0.06, 0.022)):
        stage.put(disparity, _column((at, 0.27), 0.03, 0.2, (0.002, 0.006, 0.003)))
    return stage.light()


def fireworks(width: int) -> Light:
    """Bursts of sparks at several depths over a dark lake, below a black sky."""
    stage = Stage(width)
    random = np.random.default_rng(123)
    shore = 0.42

    def lake(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        ripple = np.clip(1 + 0.9 * noise(124, 0.5 * x, 9 * y, 1.3), 0, None)
        depth = np.exp(-np.abs(y - shore) / 0.06)
        return tinted(0.004 + 0.012 * ripple * depth, (0.7, 0.6, 1.0)), smoothstep(
            shore - 0.001, shore + 0.001, y
        )

    stage.put(-0.02, lake)
    for disparity in (-0.022, -0.012, -0.004, 0.008, 0.02):
        centre = random.uniform((0.15, 0.1), (0.85, 0.26))
        colour = random.uniform(0.3, 1, 3)
        turns, lengths = random.uniform(0, 2 * np.pi, 26), random.uniform(0.05, 0.13, 26)
        for turn, length in zip(turns, lengths, strict=True):
            way = length * np.array([np.cos(turn), np.sin(turn)])
            ends = centre + 0.3 * way, centre + 1.3 * way
            (left, top), (right, low) = np.min(ends, axis=0) - 0.005, np.max(ends, axis=0) + 0.005
            stage.shine(disparity, _spark(ends[0], way, colour), (left, right, top, low))
    return stage.light()


def _disc(at: Floats, radius: float, colour: Floats) -> Painter:
    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        away = np.hypot(x - at[0], y - at[1])
        return tinted(np.ones_like(x), colour), smoothstep(radius + 5e-4, radius - 5e-4, away)

    return painter


def _column(top: tuple[float, float], half: float, high: float, colour: Colour) -> Painter:
    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        u = (x - top[0]) / half
        round_ = np.sqrt(np.clip(1 - u**2, 0, None))
        inside = (np.abs(u) < 1) & (y > top[1]) & (y < top[1] + high)
        return tinted(0.25 + 0.75 * round_, colour), inside.astype(np.float32)

    return painter


def _glow(at: tuple[float, float], size: float, colour: Colour) -> Shine:
    def shine(x: Floats, y: Floats) -> Floats:
        away = np.hypot(1.8 * (x - at[0]), y - at[1])
        return tinted(
            smoothstep(1.6 * size, 0.8 * size, away) + 0.08 * np.exp(-away / 0.02), colour
        )

    return shine


def _spark(start: Floats, way: Floats, colour: Floats) -> Shine:
    """A streak that fades towards where it came from."""

    def shine(x: Floats, y: Floats) -> Floats:
        share = ((x - start[0]) * way[0] + (y - start[1]) * way[1]) / (way @ way)
        part = np.clip(share, 0, 1)
        away = np.hypot(x - start[0] - part * way[0], y - start[1] - part * way[1])
        return tinted(part**2 * smoothstep(0.003, 0.001, away), colour)

    return shine
