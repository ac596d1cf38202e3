"""A face, as films show it: a relief that a lamp lights from one side."""

from __future__ import annotations

import numpy as np

from testing.content.texture import Colour, Floats, mixed, noise, smoothstep, tinted


def face(x: Floats, y: Floats, sun: Colour, seed: int) -> tuple[Floats, Floats]:
    """A portrait, lit from one side, and its coverage.

    Parameters
    ----------
    x, y
        To the right and down from the middle of the face, in halves of its height.
    sun
        Direction towards the lamp: right, down, towards the viewer.
    seed
        Picks skin, hair and the folds of the coat.
    """
    random = np.random.default_rng(seed)
    skin = np.array([0.72, 0.47, 0.36]) * random.uniform(0.75, 1.1)
    hair = np.array([0.04, 0.026, 0.018]) * random.uniform(0.75, 1.1)
    coat = np.array([0.12, 0.1, 0.12]) * random.uniform(0.4, 1.1, 3)

    def bump(at: tuple[float, float], wide: float, high: float) -> Floats:
        return np.exp(-(((x - at[0]) / wide) ** 2) - ((y - at[1]) / high) ** 2)

    jaw = 0.74 - 0.16 * smoothstep(0.1, 1.0, y)
    across = (x / jaw) ** 2 + y**2
    height = 0.75 * np.sqrt(np.clip(1 - across, 1e-4, None))
    height += 0.16 * bump((0, 0.12), 0.11, 0.24) + 0.05 * bump((0, 0.26), 0.16, 0.08)
    height += 0.05 * bump((0, 0.52), 0.24, 0.09) - 0.025 * bump((0, 0.53), 0.26, 0.015)
    height += 0.06 * bump((0, 0.85), 0.2, 0.12)
    for side in (-0.29, 0.29):
        height += -0.09 * bump((side, -0.1), 0.16, 0.1) + 0.045 * bump((side, -0.08), 0.1, 0.065)
        height += 0.04 * bump((side, -0.28), 0.24, 0.06) + 0.04 * bump((side, 0.3), 0.22, 0.2)
    height += 0.002 * noise(seed, 0.4 * x, 0.4 * y, 1.6)
    light = _lambert(height, x, y, sun)
    picture = tinted(0.03 + 0.97 * light, skin)
    lips = bump((0, 0.53), 0.22, 0.07)
    picture *= 1 - lips[..., None] * np.array([0.25, 0.5, 0.45], np.float32)
    for side in (-0.29, 0.29):
        brow = bump((side, -0.27), 0.2, 0.035)
        lash = bump((side, -0.1), 0.12, 0.022)
        iris = smoothstep(0.062, 0.05, np.hypot(x - side, y + 0.075))
        white = smoothstep(1.0, 0.8, ((x - side) / 0.12) ** 2 + ((y + 0.075) / 0.05) ** 2)
        picture = mixed(picture, tinted(0.15 + light, (0.5, 0.5, 0.5)), 0.8 * white)
        picture = mixed(picture, tinted(0.2 + light, (0.08, 0.06, 0.05)), iris * white)
        picture = mixed(picture, 0.6 * hair, np.clip(0.85 * (brow + lash), 0, 1))
        glint = smoothstep(0.018, 0.01, np.hypot(x - side - 0.02 * np.sign(sun[0]), y + 0.095))
        picture = mixed(picture, (0.9, 0.9, 0.85), glint)
    covered = smoothstep(1.03, 0.98, across)

    neck = smoothstep(0.46, 0.42, np.abs(x)) * (y > 0.4)
    throat = tinted(
        0.4 * np.clip(0.25 + sun[0] * x - 0.25 * np.exp(-((y - 0.9) ** 2) / 0.06), 0.02, 1), skin
    )
    top = 1.28 + 0.35 * np.abs(x) ** 2.2 - 0.25 * np.exp(-((np.abs(x) - 0.45) ** 2) / 0.02)
    shoulder = smoothstep(-0.02, 0.02, y - top)
    folds = np.clip(0.4 + 0.35 * sun[0] * x + 0.22 * noise(seed + 1, 0.15 * x, 0.08 * y, 1.8), 0, 2)
    strands = noise(seed + 2, 0.9 * x + 0.15 * y, 0.07 * y + 0.1 * x, 1.1)
    shine = np.clip(
        0.7 + 1.5 * np.exp(-(((x - 0.4 * sun[0]) / 0.35) ** 2) - (y + 0.75) ** 2 / 0.1), 0, 3
    )
    locks = tinted(np.clip(0.75 + 0.3 * strands, 0.1, None) * shine, hair)
    edge = 0.05 * noise(seed + 3, 0.3 * x, 0.3 * y, 1.2)
    back = smoothstep(1.05, 1.0, (x / 0.9) ** 2 + ((y + 0.12) / 1.1) ** 2 + edge) * (y < 0.9)
    parting = y + 0.55 - 0.75 * np.abs(x + 0.15) ** 1.8 + edge
    fringe = smoothstep(0.02, -0.06, parting) * back

    result = mixed(locks, throat, neck)
    result = mixed(result, tinted(folds, coat), shoulder)
    result = mixed(result, picture, covered)
    result = mixed(result, locks, fringe)
    coverage = np.maximum.reduce([back, neck, shoulder, covered])
    return result.clip(0, 1), coverage


def _lambert(height: Floats, x: Floats, y: Floats, sun: Colour) -> Floats:
    """Light of a surface that is `height` towards the viewer."""
    step = abs(float(y[1, 0] - y[0, 0])) + abs(float(y[0, 1] - y[0, 0])) or 1.0
    across = abs(float(x[0, 1] - x[0, 0])) or 1.0
    down, right = np.gradient(height, step, across)
    facing = sun[2] - sun[0] * right - sun[1] * down
    facing /= np.sqrt(1 + right**2 + down**2) * np.linalg.norm(sun)
    return np.asarray(np.clip(facing + 0.3, 0, None) / 1.3, np.float32)
