"""The canvas of a stereo pair: things are put on it from far to near.

The first view is the left eye's. A disparity is positive before the screen and in widths of the
picture; the left eye sees a thing half its disparity to the right of where it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np

from domesim.light import Light
from testing.content.texture import TWICE, Floats, magnitudes, mixed, star_colours, stars, tinted
from testing.pairs import averaged

Painter: TypeAlias = Callable[[Floats, Floats], tuple[Floats, Floats]]
"""Places to the right and down, in widths -> light (..., 3), and how opaque it is."""

Shine: TypeAlias = Callable[[Floats, Floats], Floats]
"""Places to the right and down, in widths -> light (..., 3)."""

Box: TypeAlias = tuple[float, float, float, float]
"""Left, right, top and bottom, in widths: nothing is painted outside."""

HIGH = 9 / 16
"""Height of a picture in widths."""

ALL: Box = (-1.0, 2.0, 0.0, 1.0)
"""The whole picture."""


class Stage:
    """Two views, on which things are put from far to near."""

    def __init__(self, width: int) -> None:
        cols, rows = width * TWICE, round(width * HIGH) * TWICE
        across, down = ((np.arange(n, dtype=np.float32) + 0.5) / cols for n in (cols, rows))
        self.x, self.y = (np.ascontiguousarray(grid) for grid in np.meshgrid(across, down))
        self._views = [np.zeros((rows, cols, 3), np.float32) for _ in "LR"]

    def put(self, disparity: float | Floats, painter: Painter, within: Box = ALL) -> None:
        """Something opaque, or partly so; its disparity may change from row to row."""
        for view, x, y in self._seen(disparity, within):
            light, share = painter(x, y)
            view[:] = mixed(view, light, share)

    def shine(self, disparity: float | Floats, painter: Shine, within: Box = ALL) -> None:
        """Light that is added to what is behind it."""
        for view, x, y in self._seen(disparity, within):
            view[:] += painter(x, y)

    def stars(self, disparity: float, seed: int, count: int, faintest: float) -> None:
        """Stars all over the picture."""
        random = np.random.default_rng(seed)
        places = random.uniform((-0.05, 0), (1.05, HIGH), (count, 2))
        peaks = magnitudes(random, count, faintest)
        kelvin = np.exp(random.normal(np.log(6500), 0.35, count)).clip(2800, 25000)
        light = tinted(peaks, (1, 1, 1)) * star_colours(kelvin)
        for eye, half in enumerate((disparity / 2, -disparity / 2)):
            moved = places + np.array([half, 0])
            self._views[eye] += stars(self.x.shape, moved, light, 0.0006)

    def light(self) -> Light:
        """The pair."""
        return averaged(np.stack(self._views).clip(0, 1), TWICE)

    def _seen(
        self, disparity: float | Floats, within: Box
    ) -> Iterator[tuple[Floats, Floats, Floats]]:
        """The left and the right eye's samples, and where they are on what has that disparity."""
        half = np.asarray(disparity, np.float32) / 2
        cols = self.x.shape[1]
        for view, moved in zip(self._views, (half, -half), strict=True):
            left, right = within[0] + float(moved.min()), within[1] + float(moved.max())
            across = slice(max(int(left * cols), 0), max(int(right * cols) + 1, 0))
            down = slice(max(int(within[2] * cols), 0), max(int(within[3] * cols) + 1, 0))
            box = (down, across)
            yield view[box], self.x[box] - (moved[box] if moved.ndim else moved), self.y[box]
