"""Blocks of pixels: sums over them, and values between their centres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Planes = NDArray[np.float32]


def block_sums(plane: Planes, block: int) -> Planes:
    """Sums over blocks of `block` x `block` pixels; the last ones may be cut off by the edge."""
    if block == 1:
        return plane
    by_rows = np.add.reduceat(plane, np.arange(0, plane.shape[0], block), axis=0)
    return np.asarray(np.add.reduceat(by_rows, np.arange(0, plane.shape[1], block), axis=1))


def interpolated(blocks: Planes, block: int, rows: slice, cols: int) -> Planes:
    """Some rows of the pixels, linearly between the blocks' centres and constant beyond them."""
    if block == 1:
        return blocks[rows]
    low, high, share = _between(np.arange(rows.start, rows.stop), block, blocks.shape[0])
    part = blocks[low] + share[:, None] * (blocks[high] - blocks[low])
    low, high, share = _between(np.arange(cols), block, blocks.shape[1])
    left = part[:, low]
    return np.asarray(left + share * (part[:, high] - left))


def _between(
    pixels: NDArray[np.int_], block: int, count: int
) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.float32]]:
    """The blocks on both sides of each pixel, and how far it is from the first to the second."""
    place = np.clip((pixels + 0.5) / block - 0.5, 0, count - 1)
    low = place.astype(np.int_)
    return low, np.minimum(low + 1, count - 1), (place - low).astype(np.float32)
