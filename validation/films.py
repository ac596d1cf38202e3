"""Films for experiments: fades, and what moves before a picture that stands still."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from domesim.light import Light
from domesim.scene import Scene

DISPARITY = 0.02
"""Disparity of what moves before a stereo pair, in shares of the width."""
RADIUS = 0.04
"""Radius of what moves, in shares of the width."""
COLOUR = (1.0, 0.9, 0.8)


def faded(first: Light, last: Light, count: int) -> Iterator[Light]:
    """`count` frames from one picture to another, linear in light."""
    for share in np.linspace(0, 1, count, dtype=np.float32):
        yield (1 - share) * first + share * last


def even_grey(picture: Light, scene: Scene, level: float) -> Light:
    """Even light of a level on the screen, in a picture's shape."""
    inside = scene.screen(*picture.shape[1:3])[None, :, :, None]
    return np.where(inside, np.float32(level), np.zeros_like(picture))


def moving_disc(
    picture: Light, start: tuple[float, float], end: tuple[float, float], count: int
) -> Iterator[Light]:
    """`count` frames of a bright disc that goes from `start` to `end` before a picture.

    Parameters
    ----------
    picture
        (view, row, col, primary) that stands still; of a pair, the disc is before the screen.
    start, end
        (x, y) of the disc's centre, in shares of the width.
    count
        Number of frames.
    """
    rows, cols = picture.shape[1:3]
    y, x = (np.mgrid[:rows, :cols] + 0.5) / cols
    for share in np.linspace(0, 1, count):
        frame = picture.copy()
        for view in range(len(frame)):
            aside = DISPARITY * (0.5 - view) if len(frame) > 1 else 0.0
            centre = [(1 - share) * a + share * b for a, b in zip(start, end, strict=True)]
            distance = np.hypot(x - centre[0] - aside, y - centre[1])
            cover = np.clip((RADIUS - distance) * cols + 0.5, 0, 1)[..., None]
            frame[view] += cover * (np.array(COLOUR) - frame[view])
        yield frame
