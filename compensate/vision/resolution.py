"""Models of one resolution, where pixels per degree differ from place to place.

A model is computed at several resolutions, half an octave apart, and each place takes from the two
that are next to its own, in proportion by the logarithm.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Planes = NDArray[np.floating[Any]]

STEP = 0.5
"""Distance between resolutions, octaves. Against steps of a sixteenth, maps of visible differences
are 1 % off at this step (``tests/compensate/solver/test_seats.py``)."""


def by_resolution(
    scale: NDArray[np.floating[Any]],
    screen: NDArray[np.bool_],
    model: Callable[[float], tuple[Planes, ...]],
    step: float = STEP,
) -> tuple[Planes, ...]:
    """Planes (view, row, col) of a model, as its local resolution has them.

    Parameters
    ----------
    scale
        (row, col) local resolution over the one that the model has at 1.
    screen
        (row, col) where it counts.
    model
        Planes by the factor of the resolution.
    step
        Distance between resolutions, octaves.
    """
    octaves = np.log2(np.where(screen, scale, 1.0))
    low, high = float(octaves[screen].min()), float(octaves[screen].max())
    count = 1 + int(np.ceil((high - low) / step))
    levels = np.linspace(low, max(high, low + 1e-6), max(count, 2))
    found: list[Planes] = []
    for level in levels:
        share = np.maximum(1 - np.abs(octaves - level) / (levels[1] - levels[0]), 0)
        share = np.where(screen, share, 0).astype(np.float32)
        planes = [share * plane for plane in model(float(2**level))]
        found = planes if not found else [a + b for a, b in zip(found, planes, strict=True)]
    return tuple(found)
