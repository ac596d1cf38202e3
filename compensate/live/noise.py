"""Noise for rounding live pictures: as `domesim.frames.dithering` has it, from a fixed supply."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

APART = 4099
"""Places of noise between planes, of which there are six at most."""

_SHIFTS = 1 << 14


def noise_of(cols: int) -> NDArray[np.float32]:
    """(2, place) two uniform numbers of -0.5..0.5 each, whose sum is added to a code."""
    generator = np.random.Generator(np.random.PCG64(0))
    return generator.random((2, cols + _SHIFTS + 6 * APART), np.float32) - np.float32(0.5)


def shifts_of(number: int, rows: int) -> NDArray[np.uint64]:
    """(row,) where in `noise_of` each row of a frame begins: a function of the frame's number."""
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence((1, number))))
    return generator.integers(0, _SHIFTS, rows, np.uint64)
