"""Local means of blocks, of arrays of any library: boxes of few pixels.

How far a mean reaches is some degrees, and so are blocks: its boxes are some blocks wide, whatever
the size of a picture, and its cost is O(n). Three boxes one after the other come close to a
Gaussian (the central limit theorem; W. M. Wells, "Efficient synthesis of Gaussian filters by
cascaded uniform filters", IEEE Trans. PAMI 8(2), 1986). The guided filter keeps edges: K. He, J.
Sun, X. Tang, "Guided Image Filtering", ECCV 2010, with the picture as its own guide. Its
coefficients are smooth, so that they are found of blocks of pixels, and are linear in between: K.
He, J. Sun, "Fast Guided Filter", arXiv 1505.00996, 2015.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from domesim.light import Array, namespace
from domesim.light.strips import in_strips

_BOXES = 3


def box_mean(planes: Array, radius: int, count: Array | None = None) -> Array:
    """Averages planes over squares of pixels.

    Parameters
    ----------
    planes
        (..., row, col); 0 where nothing counts.
    radius
        A square has 2 `radius` + 1 pixels a side.
    count
        `box_sum` of what counts, if not every pixel of the picture does.

    Returns
    -------
    means
        (..., row, col) around each pixel.
    """
    if count is None:
        return _boxes(planes, [radius], means=True)
    return box_sum(planes, radius) / count


def box_sum(planes: Array, radius: int) -> Array:
    """Sums planes over squares of pixels; nothing lies outside the picture.

    Parameters
    ----------
    planes, radius
        As for `box_mean`.

    Returns
    -------
    sums
        (..., row, col) around each pixel.
    """
    return _boxes(planes, [radius], means=False)


def smooth(planes: Array, sigma: float) -> Array:
    """Averages planes by nearly a Gaussian, in three boxes.

    A box of radius r has the variance r (r + 1) / 3. Boxes of the two nearest radii are taken, as
    many of each as come closest to the variance sigma².

    Parameters
    ----------
    planes
        (..., row, col).
    sigma
        Standard deviation, pixels.

    Returns
    -------
    means
        (..., row, col) around each pixel.
    """
    small = int((sigma**2 + 0.25) ** 0.5 - 0.5)
    wanted = (sigma**2 - small * (small + 1)) / (2 * (small + 1) / 3)
    large = min(max(round(wanted), 0), _BOXES)
    return _boxes(planes, [small + 1] * large + [small] * (_BOXES - large), means=True)


def guided(
    pixels: Array, weight: Array, first: Array, second: Array, radius: int, edge: float
) -> tuple[Array, Array]:
    """Computes an edge-preserving mean of a value by blocks: the guided filter of He et al.

    The picture is its own guide: slope and offset, enlarged, make the mean of each pixel's value.

    Parameters
    ----------
    pixels, weight
        (row, col) of blocks: how many pixels count, and the sum of their importance.
    first, second
        (row, col) sums of the value and of its square, by importance.
    radius
        Radius of the boxes, blocks.
    edge
        Standard deviation within a box at which half of it is kept: the root of their epsilon.

    Returns
    -------
    slope, offset
        (row, col) of blocks.
    """
    xp = namespace(pixels)
    within = _mean_over(box_sum(weight, radius), radius)
    middle = within(first)
    # Of each pixel from the middle of its own block
    spread = second - 2 * middle * first + middle**2 * weight
    variance = within(xp.maximum(spread, xp.zeros_like(spread)))
    slope = variance / (variance + edge**2)
    mean = _mean_over(box_sum(pixels, radius), radius)
    return mean(pixels * slope), mean(pixels * (1 - slope) * middle)


def _mean_over(count: Array, radius: int) -> Callable[[Array], Array]:
    """Means over boxes of what is weighted already; 0 where nothing counts."""
    xp = namespace(count)
    count = xp.where(count > 0, count, xp.ones_like(count))
    return lambda values: box_mean(values, radius, count)


def _boxes(planes: Array, radii: Sequence[int], *, means: bool) -> Array:
    """Sums over boxes, one after the other; with `means`, means of what lies in the picture."""
    if not isinstance(planes, np.ndarray):
        # Two products, which a GPU begins at once; neighbours one by one are some hundred kernels
        down, across = (
            _weights(namespace(planes), planes.dtype, planes.device, size, tuple(radii), means)
            for size in planes.shape[-2:]
        )
        return down @ planes @ namespace(planes).matrix_transpose(across)
    result = planes.reshape(-1, *planes.shape[-2:])
    for axis in (1, 2):
        result = _along(result, axis, radii, means=means)
    return result.reshape(planes.shape)


def _along(planes: Array, axis: int, radii: Sequence[int], *, means: bool) -> Array:
    """`_boxes` of (plane, row, col) along rows or columns, in strips that a core's cache holds."""
    result = np.empty_like(planes, order="C")

    def work(plane: int, beside: slice) -> None:
        place = (plane, slice(None), beside) if axis == 1 else (plane, beside, slice(None))
        lines = planes[place]
        for radius in radii:
            lines = _box(lines, axis - 1, radius, means=means)
        result[place] = lines

    in_strips(work, (len(planes), planes.shape[3 - axis], planes.shape[axis]))
    return result


def _box(lines: Array, axis: int, radius: int, *, means: bool) -> Array:
    """`_boxes` of (row, col) along an axis, of one radius."""
    size = lines.shape[axis]
    reach = min(radius, size - 1)
    total = lines.copy(order="C")
    # Neighbours one by one: running sums in single precision lose what is dark beside what is
    # bright, and those of a library in double precision take twice as long for so few
    for far in range(1, reach + 1):
        after, before = slice(far, None), slice(None, -far)
        if axis == 0:
            total[after] += lines[before]
            total[before] += lines[after]
        else:
            total[:, after] += lines[:, before]
            total[:, before] += lines[:, after]
    if means:
        place = np.arange(size)
        inside = np.minimum(place + reach + 1, size) - np.maximum(place - reach, 0)
        share = (1 / inside).astype(lines.dtype)
        total *= share[:, None] if axis == 0 else share
    return total


@lru_cache(maxsize=32)
def _weights(
    xp: Any, dtype: Any, device: Any, size: int, radii: tuple[int, ...], means: bool
) -> Array:
    """(place, of) by which `_boxes` weighs a line of `size` values."""
    weights = np.eye(size)
    apart = np.abs(np.arange(size)[:, None] - np.arange(size))
    for radius in radii:
        box = (apart <= radius).astype(float)
        weights = (box / box.sum(axis=1, keepdims=True) if means else box) @ weights
    return xp.asarray(weights, dtype=dtype, device=device)
