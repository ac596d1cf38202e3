"""Generated stereo pairs: a night, of shapes at several depths.

They are Light (2, row, col, 3) in 0..1: the left eye's picture, and the right eye's, 16:9. A shape
is shown to the left eye half its disparity to the right of where it is, to the right eye half to
the left, so that positive ones are before the screen (xL - xR, in shares of the picture's width).
From far to near there are

    a sky, black at the top, with a faint gradient and texture     -2.5 %
    a row of lit houses, with windows in other colours             -1.5 %
    a black wall in the middle, at the screen                       0
    lamps, as bright as white, with a faint halo                   -2 to 3.5 %
    striped and shaded discs                                        -1 to 4 %
    a lit pole, before all                                          5 %

What lies before the black wall or the black sky leaves a ghost there that no negative light could
take away; ghosts on lit texture can be subtracted.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from domesim.light import Light

Floats = NDArray[np.float64]
Colour: TypeAlias = tuple[float, float, float]

LAMPS: tuple[tuple[float, tuple[float, float], Colour], ...] = (
    (-0.02, (0.36, 0.16), (1.0, 0.9, 0.7)),
    (0.015, (0.5, 0.2), (1.0, 1.0, 1.0)),
    (0.035, (0.62, 0.38), (1.0, 0.55, 0.3)),
    (0.02, (0.12, 0.06), (0.6, 0.8, 1.0)),
)
"""Lamps: disparity, place (x, y) in widths, colour."""
DISCS: tuple[tuple[float, tuple[float, float], float, Colour], ...] = (
    (-0.01, (0.2, 0.4), 0.05, (0.3, 0.9, 0.4)),
    (0.02, (0.44, 0.36), 0.06, (1.0, 0.3, 0.25)),
    (0.04, (0.8, 0.25), 0.07, (0.35, 0.5, 1.0)),
)
"""Discs: disparity, place, radius, colour."""

_TWICE = 2  # samples a pixel and axis


def generated(size: int, seed: int = 0) -> Light:
    """The generated night, `size` pixels wide, float32; `seed` is of its texture and places."""
    rows = round(size * 9 / 16)
    random = np.random.default_rng(seed)
    canvas = _Canvas(rows * _TWICE, size * _TWICE)
    x, y = canvas.x, canvas.y
    texture = gaussian_filter(random.standard_normal(x.shape), 0.004 * size * _TWICE)
    texture /= np.abs(texture).max()
    sky = 0.03 * np.clip(y - 0.12, 0, 1) * (1 + 0.5 * texture)
    canvas.paint(-0.025, np.ones_like(x, bool), sky, (0.5, 0.7, 1.0))
    for k in range(9):
        left, top = 0.01 + 0.11 * k, random.uniform(0.27, 0.36)
        house = (x > left) & (x < left + 0.09) & (y > top)
        canvas.paint(-0.015, house, 0.05 * (1.2 - y) * (1 + 0.4 * texture), (1.0, 0.85, 0.7))
        windows = (np.mod(60 * (x - left), 1) < 0.5) & (np.mod(40 * (y - top), 1) < 0.5)
        lit = windows & house & (np.floor(40 * (y - top)) % 3 == k % 3)
        red, green, blue = random.uniform(0.3, 1.0, 3)
        grey = np.full_like(x, random.uniform(0.15, 0.4))
        canvas.paint(-0.015, lit, grey, (red, green, blue))
    canvas.paint(0.0, (x > 0.3) & (x < 0.7) & (y > 0.08) & (y < 0.5), np.zeros_like(x), (1, 1, 1))
    for disparity, centre, colour in LAMPS:
        distance = np.hypot(x - centre[0], y - centre[1])
        canvas.add(disparity, 0.08 * np.exp(-distance / 0.015), colour)
        canvas.paint(disparity, distance < 0.011, np.ones_like(x), colour)
    for disparity, centre, radius, colour in DISCS:
        distance = np.hypot(x - centre[0], y - centre[1])
        shade = np.sqrt(np.clip(1 - (distance / radius) ** 2, 0, 1))
        stripes = np.where(np.mod(70 * (x + 0.5 * y), 1) < 0.5, 1.0, 0.35)
        canvas.paint(disparity, distance < radius, 0.6 * shade * stripes, colour)
    pole = np.abs(x - 0.56 - 0.1 * y) < 0.006
    canvas.paint(0.05, pole, np.full_like(x, 0.5) * (1 - y), (0.9, 0.9, 0.8))
    return canvas.light()


def no_wider(light: Light, cols: int) -> Light:
    """A picture `averaged` to at most that many columns."""
    return averaged(light, -(-light.shape[2] // cols))


def averaged(light: Light, times: int) -> Light:
    """A picture `times` smaller, each pixel the mean of `times`²; rows and cols over are left out.

    Parameters
    ----------
    light
        (view, row, col, primary).
    times
        A whole number.
    """
    rows, cols = (side // times for side in light.shape[1:3])
    cells = light[:, : rows * times, : cols * times]
    cells = cells.reshape(len(light), rows, times, cols, times, -1)
    return np.asarray(cells.mean(axis=(2, 4)), light.dtype)


class _Canvas:
    """Two views that are painted from far to near, `_TWICE` as fine as they will be."""

    def __init__(self, rows: int, cols: int) -> None:
        self._cols = cols
        self._views = np.zeros((2, rows, cols, 3))
        # Wider than the picture: what is moved in from the side was painted, too
        self._margin = round(0.05 * cols)
        across = np.arange(-self._margin, cols + self._margin) + 0.5
        self.y, self.x = (
            np.array(grid)
            for grid in np.meshgrid((np.arange(rows) + 0.5) / cols, across / cols, indexing="ij")
        )

    def paint(
        self, disparity: float, where: NDArray[np.bool_], grey: Floats, colour: Colour
    ) -> None:
        """Paint an opaque shape."""
        light = grey[..., None] * np.array(colour)
        for view, moved in self._moves(disparity):
            self._views[view] = np.where(where[:, moved, None], light[:, moved], self._views[view])

    def add(self, disparity: float, grey: Floats, colour: Colour) -> None:
        """Add light, as of a halo."""
        light = grey[..., None] * np.array(colour)
        for view, moved in self._moves(disparity):
            self._views[view] += light[:, moved]

    def light(self) -> Light:
        """The views, at their size."""
        return averaged(self._views, _TWICE).clip(0, 1).astype(np.float32)

    def _moves(self, disparity: float) -> list[tuple[int, slice]]:
        """Where each view's columns are in what is painted."""
        half = round(disparity * self._cols / 2)
        starts = (self._margin - half, self._margin + half)
        return [(view, slice(start, start + self._cols)) for view, start in enumerate(starts)]
