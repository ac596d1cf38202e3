"""Models of one resolution, where pixels per degree differ from place to place.

A model is computed at several resolutions, half an octave apart, and each place takes from the two
that are next to its own, in proportion by the logarithm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
    found: list[Planes] = []
    for factor, share in shares(scale, screen, step):
        planes = [np.where(screen, share * plane, 0) for plane in model(factor)]
        found = planes if not found else [a + b for a, b in zip(found, planes, strict=True)]
    return tuple(found)


def shares(
    scale: Planes, screen: NDArray[np.bool_], step: float = STEP
) -> Iterator[tuple[float, NDArray[np.float32]]]:
    """Factors of the resolution, and (row, col) how much a place has of each.

    Off the screen it is the least resolution.

    Parameters
    ----------
    scale, screen, step
        As for `by_resolution`.
    """
    octaves = np.log2(np.where(screen, scale, 1.0))
    low, high = float(octaves[screen].min()), float(octaves[screen].max())
    octaves = np.where(screen, octaves, low)
    count = 1 + int(np.ceil((high - low) / step))
    levels = np.linspace(low, max(high, low + 1e-6), max(count, 2))
    for level in levels:
        share = np.maximum(1 - np.abs(octaves - level) / (levels[1] - levels[0]), 0)
        yield float(2**level), share.astype(np.float32)
