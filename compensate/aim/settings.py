"""What an aim knows: how far the user lets black be lifted, and how a picture is seen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from domesim.errors import InputError, require_not_negative
from domesim.light import Array, Light, namespace
from domesim.light.planes import Columns

MOST_LIFT = 4.0


@final
@dataclass(frozen=True)
class Aim:
    """How much black is given up for contrast.

    Parameters
    ----------
    lift
        How many times the missing light the dark places of a dome are lifted, and how bright a
        pair's veils are beside their ghosts: from 0, plain subtraction, to 4.

    Raises
    ------
    InputError
        If it is negative, above 4, or not finite.
    """

    lift: float = 1.0

    def __post_init__(self) -> None:
        require_not_negative("the aim", lift=self.lift)
        if self.lift > MOST_LIFT:
            raise InputError(f"the aim's lift must be at most {MOST_LIFT:g}, got {self.lift:g}")


@final
@dataclass(frozen=True)
class Sight:
    """How a picture is seen: what an aim must know of a theatre.

    Parameters
    ----------
    screen
        (row, col) bool: pixels that count.
    weights
        (primary,) of luminance.
    white
        Luminance of 1.0, cd/m².
    density
        Pixels per degree.
    """

    screen: Array
    weights: Array
    white: float
    density: float

    def columns(self, rows: slice, block: int = 1) -> slice:
        """Returns the columns outside which some rows have no screen: see `Columns.of`."""
        if self._columns is None:
            return slice(0, self.screen.shape[1])
        return self._columns.of(rows, block)

    @cached_property
    def _columns(self) -> Columns | None:
        """None where another library than NumPy computes, which takes all rows at once."""
        return Columns(self.screen) if isinstance(self.screen, np.ndarray) else None

    def luminance(self, light: Light) -> Array:
        """Returns the (..., row, col) luminance of light, 1 = white, at least 0."""
        xp = namespace(light)
        weights = xp.asarray(self.weights, dtype=light.dtype, device=light.device)
        return xp.maximum(light @ weights, xp.zeros_like(light[..., 0]))
