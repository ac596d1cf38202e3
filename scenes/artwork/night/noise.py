"""Repeatable value noise in three dimensions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def fractal_noise(points: ArrayLike, octaves: int, seed: int) -> Floats:
    """Sum of `octaves` of value noise, each twice as fine and half as strong: about 0..1, mean 0.5.

    Parameters
    ----------
    points
        (..., xyz); the coarsest octave varies over a distance of 1.
    octaves
        How many.
    seed
        Same seed, same noise.
    """
    points = np.asarray(points, dtype=np.float64)
    total = np.zeros(points.shape[:-1])
    for octave in range(octaves):
        total += value_noise(points * 2.0**octave + 17.3 * octave, seed + octave) * 0.5**octave
    return total / (2.0 - 0.5 ** (octaves - 1))


def value_noise(points: ArrayLike, seed: int) -> Floats:
    """Random values in 0..1 on the integer lattice, interpolated at `points` (..., xyz)."""
    points = np.asarray(points, dtype=np.float64)
    corner = np.floor(points)
    part = points - corner
    weight = part * part * (3.0 - 2.0 * part)
    x, y, z = np.moveaxis(corner.astype(np.int64), -1, 0)
    a, b, c = np.moveaxis(weight, -1, 0)
    total = np.zeros(points.shape[:-1])
    for i, j, k in np.ndindex(2, 2, 2):
        factor = (a if i else 1.0 - a) * (b if j else 1.0 - b) * (c if k else 1.0 - c)
        total += factor * _hash(x + i, y + j, z + k, seed)
    return total


def _hash(x: NDArray[np.int64], y: NDArray[np.int64], z: NDArray[np.int64], seed: int) -> Floats:
    mixed = (x * 73856093 ^ y * 19349663 ^ z * 83492791).astype(np.uint32)
    mixed ^= np.uint32((seed * 2654435761) % 2**32)
    for multiplier in (2246822519, 3266489917):
        mixed ^= mixed >> np.uint32(15)
        mixed *= np.uint32(multiplier)
    mixed ^= mixed >> np.uint32(16)
    value: Floats = mixed / 2.0**32
    return value
