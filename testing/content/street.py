"""A stereo pair of a wet street at night."""

from __future__ import annotations

import numpy as np

from domesim.light import Light
from testing.content.stage import HIGH, Painter, Stage
from testing.content.texture import Colour, Floats, mixed, noise, smoothstep, tinted


def night_street(width: int) -> Light:
    """A wet street at night: lamps and their reflections, dark houses with lit windows."""
    stage = Stage(width)
    horizon = 0.3
    stage.put(
        -0.03, lambda x, y: (tinted(0.0015 * smoothstep(0, horizon, y), (0.8, 0.8, 1)), x < 9)
    )
    for row in range(4, -1, -1):
        for left in (True, False):
            near, far = 0.52 / 1.6**row, 0.49 / 1.6 ** (row + 1)
            box = (0.5 - near, 0.5 - far) if left else (0.5 + far, 0.5 + near)
            stage.put(-0.028 + 0.008 * (4 - row), _houses(row, left), (*box, 0, HIGH))
    road = -0.03 + 0.05 * smoothstep(horizon, HIGH, stage.y)
    lamps = [
        (side, near, (0.5 + side * (0.04 + 0.3 * near), horizon - 0.015 - 0.2 * near))
        for near in (0.12, 0.25, 0.5, 1.0)
        for side in (-1, 1)
    ]

    def wet(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        depth = np.maximum(y - horizon, 1e-3)
        across = (x - 0.5) / depth
        stones = noise(101, 0.25 * across, 0.02 / depth, 1.3)
        puddle = smoothstep(-0.6, 1.0, noise(102, 0.1 * across, 0.012 / depth, 1.9))
        light = tinted(0.006 * np.clip(1 + 0.5 * stones, 0.1, None), (0.8, 0.85, 1.0))
        kerb = smoothstep(0.09, 0.05, np.abs(np.abs(across) - 1.35))
        light += tinted(0.01 * kerb, (1, 0.9, 0.7))
        ripple = 0.012 * noise(103, 0.5 * x, 4 * y, 1.2) * (0.3 + 4 * depth)
        for side, near, (lamp, top) in lamps:
            mirror = 2 * horizon - top
            long = np.exp(-(((y - mirror) / (0.05 + 0.12 * near)) ** 2))
            thin = np.exp(-np.abs(x - lamp + ripple) / (0.006 + 0.014 * near))
            glitter = np.clip(0.6 + 0.5 * stones, 0.1, None) * (0.15 + puddle)
            light += tinted(0.4 * long * thin * glitter, _SODIUM if side < 0 else _WHITE)
            pool = np.exp(
                -(((x - lamp) / (0.03 + 0.12 * near)) ** 2)
                - ((depth - 0.22 * near) / (0.03 + 0.05 * near)) ** 2
            )
            light += tinted(0.03 * pool * np.clip(1 + 0.4 * stones, 0, None), _SODIUM)
        return light, smoothstep(horizon - 0.001, horizon + 0.001, y)

    stage.put(road, wet)
    stage.put(-0.018, _car, (0.4, 0.51, 0.3, 0.37))
    stage.shine(-0.018, _headlights, (0.3, 0.6, 0.2, HIGH))
    for side, near, (lamp, top) in lamps:
        _lamp(stage, -0.026 + 0.05 * near, (lamp, top), near, _SODIUM if side < 0 else _WHITE)
    stage.put(0.035, _walker, (0.53, 0.83, 0.15, HIGH))
    return stage.light()


def _houses(row: int, left: bool) -> Painter:
    """A house at one side of the street; row 0 is the nearest."""
    random = np.random.default_rng(160 + 2 * row + left)
    near, far = 0.5 / 1.6**row, 0.5 / 1.6 ** (row + 1.0)
    tall, tint = random.uniform(0.7, 1.1), random.uniform(0.6, 1.0, 3)
    lit, hues = random.uniform(0, 1, (12, 12)), random.uniform(0, 1, (12, 12))

    def painter(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        off = (0.5 - x) if left else (x - 0.5)
        scale = np.clip(off, 0.01, None)
        up = (0.3 - y) / scale
        along = np.clip(1 / scale, None, 60)
        inside = (off > far) & (off < near * 1.02) & (up < tall) & (up > -0.42)
        bricks = noise(104, 0.2 * along, 0.6 * up, 1.3)
        lampglow = np.exp(-(((up + 0.1) / 0.35) ** 2))
        light = tinted(
            (0.0025 + 0.014 * lampglow) * np.clip(1 + 0.35 * bricks, 0.1, None),
            tint * (1, 0.8, 0.6),
        )
        u = (along - 1 / near) / (1 / far - 1 / near) * 4
        v = (up + 0.42) * 5.2
        col, story = (
            np.clip(np.floor(u), 0, 11).astype(int),
            np.clip(np.floor(v), 0, 11).astype(int),
        )
        frame = (np.abs(np.mod(u, 1) - 0.5) < 0.27) & (np.abs(np.mod(v, 1) - 0.5) < 0.3)
        cross = (np.abs(np.mod(u, 1) - 0.5) < 0.03) | (np.abs(np.mod(v, 1) - 0.6) < 0.025)
        on = lit[col, story] > 0.72
        warm = hues[col, story][..., None]
        glow = (0.1 + 0.4 * warm) * np.array([1.0, 0.7, 0.35]) + (1 - warm) * np.array(
            [0.0, 0.03, 0.1]
        )
        glow = glow * np.clip(0.8 + 0.3 * noise(105, u, v, 1.6), 0.1, 1.4)[..., None]
        pane = np.where(on[..., None], glow, np.array([0.001, 0.0012, 0.002]))
        shop = (v < 1) & (hues[0, 0] > 0.3)
        return mixed(light, pane, frame & ~cross & ~shop), inside

    return painter


def _lamp(
    stage: Stage, disparity: float, at: tuple[float, float], near: float, colour: Colour
) -> None:
    """A street lamp: its post, its head and its halo."""
    big = 0.004 + 0.012 * near

    def post(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        foot = 0.31 + 0.2 * near
        inside = (np.abs(x - at[0]) < 0.25 * big) & (y > at[1]) & (y < foot)
        shine = 0.02 * np.exp(-(y - at[1]) / (0.06 * (1 + near))) + 0.002
        return tinted(shine, colour), inside

    def head(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        away = np.hypot((x - at[0]) / big, (y - at[1]) / (0.7 * big))
        return tinted(np.ones_like(x), 0.4 + 0.6 * np.array(colour)), smoothstep(1.0, 0.8, away)

    def halo(x: Floats, y: Floats) -> Floats:
        away = np.hypot(x - at[0], y - at[1]) / big
        return tinted(0.12 * np.exp(-away / 1.6) + 0.012 * np.exp(-away / 6), colour)

    box = (at[0] - big, at[0] + big)
    stage.put(disparity, post, (*box, at[1], HIGH))
    stage.put(disparity, head, (*box, at[1] - big, at[1] + big))
    wide = 45 * big
    stage.shine(disparity, halo, (at[0] - wide, at[0] + wide, at[1] - wide, at[1] + wide))


def _car(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """A car that comes towards us."""
    u, v = (x - 0.455) / 0.04, (y - 0.335) / 0.04
    body = (np.abs(u) < 1) & (v > -0.15) & (v < 0.5)
    cabin = (np.abs(u) < 0.75 + 0.25 * v) & (v > -0.65) & (v <= -0.1)
    glass = (np.abs(u) < 0.64 + 0.25 * v) & (v > -0.55) & (v < -0.16)
    light = tinted(0.006 + 0.012 * smoothstep(0.3, -0.6, v), (0.9, 0.35, 0.3))
    return mixed(light, (0.002, 0.003, 0.005), glass), body | cabin


def _headlights(x: Floats, y: Floats) -> Floats:
    """The car's headlights, and their streaks on the road."""
    total = np.zeros_like(x)
    for side in (0.425, 0.485):
        away = np.hypot(x - side, y - 0.338)
        total += 1.2 * np.exp(-((away / 0.005) ** 2)) + 0.15 * np.exp(-away / 0.012)
        streak = np.exp(-np.abs(x - side + 0.006 * noise(103, x, 5 * y, 1.2)) / 0.006)
        total += 0.25 * streak * np.exp(-(y - 0.36) / 0.05) * (y > 0.356)
    return tinted(total, (0.95, 0.97, 1.0))


def _walker(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Someone with an umbrella, dark against the street, with a lit rim."""
    u, v = (x - 0.68) / 0.1, (y - 0.33) / 0.1
    dome = 1 - (u / 1.25) ** 2
    umbrella = (
        (v < -0.75 + 0.12 * np.abs(np.sin(5.0 * u)))
        & (v > -0.85 - 0.75 * np.sqrt(np.clip(dome, 0, 1)) + 0.1)
        & (dome > 0)
    )
    stick = (np.abs(u - 0.12) < 0.03) & (v > -0.9) & (v < 0.3)
    head = np.hypot(u, (v + 0.45) / 1.2) < 0.22
    coat = (
        (np.abs(u) < 0.28 + 0.16 * np.clip(v + 0.2, 0, 2) - 0.2 * np.clip(-v, 0, 1))
        & (v > -0.25)
        & (v < 1.45)
    )
    legs = (np.abs(np.abs(u) - 0.17) < 0.11) & (v >= 1.4) & (v < 2.2)
    rim = np.exp(-np.abs(u + 0.45 - 0.1 * v) / 0.12) * ~umbrella + 0.5 * umbrella * np.exp(
        -np.clip(dome, 0, 1) / 0.15
    )
    cloth = np.clip(1 + 0.5 * noise(106, 0.3 * u, 0.15 * v, 1.5), 0.1, None)
    light = tinted((0.003 + 0.07 * rim) * cloth, (1.0, 0.7, 0.45))
    panels = 0.02 * umbrella * np.clip(0.4 + np.abs(np.sin(2.5 * u)), 0, 1.2)
    return light + tinted(panels, (0.9, 0.12, 0.1)), umbrella | stick | head | coat | legs


_SODIUM: Colour = (1.0, 0.6, 0.22)

_WHITE: Colour = (0.85, 0.93, 1.0)
