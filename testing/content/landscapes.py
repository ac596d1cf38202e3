"""Stereo pairs of landscapes: a meadow by day, and snow by night."""

from __future__ import annotations

import numpy as np

from domesim.light import Light
from testing.content.stage import HIGH, Painter, Stage
from testing.content.texture import (
    Colour,
    Floats,
    looked_up,
    mixed,
    noise,
    shape_tile,
    smoothstep,
    tinted,
)


def daylight(width: int) -> Light:
    """A bright meadow: sky with clouds, hills, and dark trunks in front."""
    stage = Stage(width)

    def sky(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        clear = mixed(
            tinted(np.ones_like(x), (0.2, 0.4, 0.78)), (0.78, 0.82, 0.85), np.clip(y / 0.3, 0, 1)
        )
        clouds = smoothstep(0.0, 1.5, noise(121, 0.6 * x, 1.6 * y, 1.6))
        shade = 0.93 + 0.06 * noise(122, 1.5 * x, 3 * y, 1.5)
        return mixed(clear, tinted(shade, (1, 0.98, 0.95)), 0.9 * clouds), np.ones_like(x)

    stage.put(-0.03, sky)
    for row, (top, rise, colour) in enumerate(_HILLS):
        stage.put(-0.027 + 0.004 * row, _hill(row, top, rise, colour))
    meadow = -0.016 + 0.046 * smoothstep(0.36, HIGH, stage.y)

    def grass(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        depth = np.maximum(y - 0.33, 0.01)
        u, v = 0.12 * (x - 0.5) / depth, 0.03 / depth
        blades = 0.4 * noise(123, 6 * u, 1.5 * v, 1.0) + 0.35 * noise(124, u, v, 1.7)
        shadow = 1 - 0.6 * sum(
            np.exp(-(((x - at - 0.9 * (y - foot)) / 0.025) ** 2)) * (y < foot)
            for at, foot, *_ in _TRUNKS
        )
        flowers = smoothstep(2.2, 2.6, noise(125, 8 * u, 8 * v, 0.8))
        green = tinted(np.clip(1 + blades, 0.1, None) * shadow, (0.2, 0.3, 0.07))
        light = mixed(green, (0.85, 0.8, 0.3), flowers)
        return light, smoothstep(-0.001, 0.001, y - 0.365 - 0.004 * noise(126, x, 0.2, 1.5))

    stage.put(meadow, grass)
    for trunk in _TRUNKS:
        at, foot, wide, disparity = trunk
        stage.put(disparity, _trunk(at, foot, wide), (at - 3 * wide, at + 3 * wide, 0, foot + 0.02))
    for k, (disparity, low) in enumerate(((0.012, 0.05), (0.03, 0.02))):
        stage.put(disparity, _leaves(k, low), (-1, 2, 0, 0.35))
    return stage.light()


def snow(width: int) -> Light:
    """Bright snow under a dark sky: dark figures and trees, and flakes at many depths."""
    stage = Stage(width)

    def sky(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        clouds = np.clip(1 + 0.25 * noise(150, x, 2 * y, 1.8), 0, 2)
        return tinted((0.003 + 0.02 * smoothstep(0, 0.3, y)) * clouds, (0.5, 0.6, 1)), np.ones_like(
            x
        )

    stage.put(-0.03, sky)
    stage.put(-0.024, _wood(0.27, 0.06, 0.012))
    ground = -0.024 + 0.052 * smoothstep(0.27, HIGH, stage.y)

    def drifts(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        depth = np.maximum(y - 0.24, 0.01)
        u, v = 0.15 * (x - 0.5) / depth, 0.04 / depth
        relief = noise(152, u, v, 1.9) - noise(152, u + 0.012, v, 1.9)
        fine = noise(153, 4 * u, 2 * v, 1.1)
        lamp = np.exp(-(((x - 0.45) / 0.35) ** 2) - ((y - 0.42) / 0.13) ** 2)
        grey = (0.1 + 0.62 * lamp) * np.clip(1 + 0.9 * relief + 0.06 * fine, 0.1, 1.5)
        prints = smoothstep(
            0.8,
            0.4,
            np.hypot(
                np.mod(40 * v, 1) - 0.5,
                9 * (u - 0.02 + 0.004 * np.sign(np.mod(20 * v, 1) - 0.5)) * 8,
            ),
        )
        edge = smoothstep(-0.001, 0.001, y - 0.285 - 0.006 * noise(154, 0.7 * x, 0.6, 1.8))
        return tinted(grey * (1 - 0.35 * prints), (0.88, 0.94, 1.0)), edge

    stage.put(ground, drifts)
    for disparity, at, high, seed in (
        (-0.012, 0.56, 0.085, 1),
        (-0.010, 0.605, 0.075, 2),
        (0.004, 0.33, 0.16, 3),
    ):
        stage.put(
            disparity, _figure(at, 0.3 + 0.75 * high, high, seed), (at - high, at + high, 0, HIGH)
        )
    stage.put(0.022, _bare_tree, (0.68, 1, 0, HIGH))
    for k, disparity in enumerate(np.linspace(-0.022, 0.04, 9)):
        stage.put(float(disparity), _flakes(k))
    return stage.light()


def _hill(row: int, top: float, rise: float, colour: Colour) -> Painter:
    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        crest = top + rise * noise(170, 0.5 * x + 0.3 * row, 0.2 + 0.3 * row, 1.7)
        relief = noise(171, x + 0.4 * y, 1.5 * y + 0.3 * row, 1.9)
        relief = relief - noise(171, x + 0.4 * y + 0.006, 1.5 * y + 0.3 * row, 1.9)
        grain = 1 + 3 * relief + 0.12 * noise(172, 5 * x, 7 * y, 1.0)
        return tinted(np.clip(grain, 0.2, 2), colour), smoothstep(-0.0007, 0.0007, y - crest)

    return painter


def _trunk(at: float, foot: float, wide: float) -> Painter:
    """A dark trunk with a bark that the sun grazes."""

    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        middle = at + 0.006 * noise(173, 0.1 + at, 0.4 * y, 2.2)
        flare = 1 + 0.9 * np.exp((y - foot) / 0.03) + 0.15 * noise(174, at, 0.5 * y, 1.6)
        u = (x - middle) / (wide * flare)
        round_ = np.sqrt(np.clip(1 - u**2, 0, 1))
        bark = noise(175, 3 * at + 0.2 * np.arcsin(np.clip(u, -1, 1)), 0.5 * y, 1.3)
        shade = np.clip(0.25 + 0.75 * smoothstep(-0.2, 1.0, u), 0, 1) * (0.3 + 0.7 * round_)
        grey = np.clip(1 + 0.55 * bark, 0.08, None) * shade
        return tinted(grey, (0.07, 0.05, 0.035)), (np.abs(u) < 1) & (
            y < foot + 0.005 * noise(175, x, 0.5, 1.0)
        )

    return painter


def _leaves(seed: int, low: float) -> Painter:
    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        clumps = noise(176 + seed, x, 1.2 * y, 1.5) + 0.7 * noise(178, 6 * x, 8 * y, 0.9)
        share = smoothstep(0.1, 0.25, clumps + 14 * (low - y) - 1.5 * np.abs(x - 0.55) + 0.2)
        lit = np.clip(1 + 0.6 * noise(179, 7 * x, 7 * y, 1.0), 0.15, None)
        return tinted(lit, (0.05, 0.09, 0.015)), share

    return painter


def _wood(top: float, rise: float, grey: float) -> Painter:
    """Dark firs in a row."""

    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        cone = np.abs(np.mod(23 * x + 0.8 * noise(155, 0.6 * x, 0.1, 1.4), 1) - 0.5)
        tall = 1 + 0.3 * noise(156, np.floor(23 * x) / 23, 0.7, 1.0)
        crest = top - rise * tall * (1 - 2 * cone) + 0.006 * noise(157, 4 * x, 8 * y, 1.0)
        needles = np.clip(1 + 0.5 * noise(158, 5 * x, 5 * y, 1.0), 0.1, None)
        frost = smoothstep(0.02, 0.0, y - crest)
        return tinted((grey + 0.05 * frost) * needles, (0.6, 0.75, 0.9)), smoothstep(
            -0.001, 0.001, y - crest
        )

    return painter


def _figure(at: float, foot: float, high: float, seed: int) -> Painter:
    """Someone in a dark coat, lit along one side."""
    parts = shape_tile(_PERSON, 2048, 1024)
    lean = 0.04 * (seed - 2)

    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        v = (y - foot) / high + 2
        u = (x - at) / high + 0.5 + lean * (2 - v)
        share = looked_up(parts, u, v)
        rim = np.clip(share - looked_up(parts, u + 0.018, v - 0.012), 0, 1)
        cloth = np.clip(1 + 0.5 * noise(159, 0.4 * u + 0.2 * seed, 0.2 * v, 1.5), 0.1, None)
        light = tinted(0.008 * cloth, (0.7, 0.7, 1.0)) + tinted(0.16 * rim, (0.8, 0.88, 1.0))
        scarf = (np.abs(v - 0.46) < 0.045) & (np.abs(u - 0.5) < 0.13)
        return mixed(light, (0.11, 0.012, 0.015), 0.9 * scarf), share

    return painter


def _bare_tree(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """A dark birch in front, with snow on its branches."""
    share, white = np.zeros_like(x), np.zeros_like(x)
    for start, end, wide in _BRANCHES:
        along = np.array(end) - start
        part = np.clip(
            ((x - start[0]) * along[0] + (y - start[1]) * along[1]) / (along @ along), 0, 1
        )
        bend = 0.012 * np.sin(3 * np.pi * part)
        off = y - start[1] - part * along[1], x - start[0] - part * along[0] + bend
        girth = wide * (1 - 0.6 * part)
        share = np.maximum(share, smoothstep(1.1, 0.9, np.hypot(*off) / girth))
        white = np.maximum(
            white,
            (off[0] < -0.25 * girth) * (abs(along[0]) > abs(along[1])) * (np.hypot(*off) < girth),
        )
    bark = np.clip(1 + 0.6 * noise(160, 1.5 * x, 3 * y, 1.2), 0.1, None)
    return mixed(tinted(0.012 * bark, (0.8, 0.8, 1.0)), (0.4, 0.44, 0.5), white), share


def _flakes(layer: int) -> Painter:
    """Falling flakes; the nearer, the larger, the fewer and the more blurred."""
    random = np.random.default_rng(190 + layer)
    count, big = round(320 / (1 + 0.8 * layer)), 0.0011 + 0.00042 * layer
    places = random.uniform((-0.05, 0), (1.05, HIGH), (count, 2))
    sizes = big * random.uniform(0.6, 1.4, count)

    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        cols = x.shape[1]
        share = np.zeros_like(x)
        for (left, top), size in zip(places, sizes, strict=True):
            # `x` is a row of places that were all moved alike
            low = np.floor(np.array([top - 2 * size, left - 2 * size - x[0, 0]]) * cols).astype(int)
            high = low + int(4 * size * cols) + 3
            box = slice(max(low[0], 0), max(high[0], 0)), slice(max(low[1], 0), max(high[1], 0))
            away = np.hypot(x[box] - left, (y[box] - top) * 0.9) / size
            share[box] = np.maximum(share[box], smoothstep(1.25, 0.55, away))
        return tinted(np.full_like(x, 0.62 - 0.025 * layer), (0.92, 0.96, 1.0)), 0.85 * share

    return painter


_HILLS: tuple[tuple[float, float, Colour], ...] = (
    (0.23, 0.025, (0.36, 0.46, 0.6)), (0.3, 0.016, (0.17, 0.26, 0.24)),
    (0.34, 0.01, (0.1, 0.16, 0.06)),
)  # fmt: skip
"""Height of the crest from the top, its roughness, colour; far ones first."""

_TRUNKS: tuple[tuple[float, float, float, float], ...] = (
    (0.62, 0.41, 0.009, -0.004), (0.36, 0.43, 0.012, 0.002), (0.82, 0.47, 0.02, 0.014),
    (0.13, 0.53, 0.034, 0.032),
)  # fmt: skip
"""Place, foot, half the width, disparity."""

_PERSON = (
    ((0.5, 0.1), (0.6, 0.15), (0.63, 0.27), (0.58, 0.39), (0.5, 0.42), (0.42, 0.39),
     (0.37, 0.27), (0.4, 0.15)),
    ((0.5, 0.38), (0.66, 0.47), (0.76, 0.6), (0.8, 0.9), (0.77, 1.12), (0.72, 1.1), (0.7, 0.85),
     (0.72, 1.3),
     (0.68, 1.4), (0.5, 1.43), (0.32, 1.4), (0.28, 1.3), (0.3, 0.85), (0.28, 1.1), (0.22, 1.12),
     (0.2, 0.9),
     (0.24, 0.6), (0.34, 0.47)),
    ((0.34, 1.38), (0.48, 1.38), (0.47, 1.7), (0.46, 1.96), (0.3, 1.97), (0.37, 1.9), (0.36, 1.65)),
    ((0.52, 1.38), (0.66, 1.38), (0.64, 1.65), (0.65, 1.88), (0.72, 1.95), (0.55, 1.96),
     (0.53, 1.7)),
)  # fmt: skip
"""Head, coat and legs; in widths of a tile that is twice as high as wide."""

_BRANCHES = (
    ((0.88, 0.58), (0.9, -0.05), 0.02), ((0.885, 0.36), (0.74, 0.12), 0.008), ((0.8, 0.22),
     (0.7, 0.2), 0.004),
    ((0.89, 0.25), (1.02, 0.08), 0.008), ((0.895, 0.16), (0.79, -0.02), 0.006), ((0.78, 0.18),
     (0.76, 0.05), 0.004),
    ((0.95, 0.17), (1.02, 0.18), 0.004),
)  # fmt: skip
"""Start, end, half the width."""
