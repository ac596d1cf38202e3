"""Separable local means of pictures that are averaged by blocks, for any array library.

How far a mean reaches is some degrees, and so are blocks: it takes some blocks, whatever the size
of a picture, and its cost is O(n). Three boxes one after the other come close to a
Gaussian (the central limit theorem; W. M. Wells, "Efficient synthesis of Gaussian filters by
cascaded uniform filters", IEEE Trans. PAMI 8(2), 1986). The guided filter keeps edges: K. He, J.
Sun, X. Tang, "Guided Image Filtering", ECCV 2010, with the picture as its own guide. Its
coefficients are smooth, so that they are found of blocks of pixels, and are linear in between: K.
He, J. Sun, "Fast Guided Filter", arXiv 1505.00996, 2015.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

from domesim.light import Array, namespace
from domesim.light.strips import in_strips

_BOXES = 3


def near_sum(planes: Array, radius: int) -> Array:
    """Sums planes around each pixel by weights that fall linearly, to 0 beyond `radius`.

    Parameters
    ----------
    planes
        (..., row, col); nothing lies outside the picture.
    radius
        How far away a pixel counts along a row or a column, pixels.

    Returns
    -------
    sums
        (..., row, col) around each pixel, whose own weight is 1.
    """
    return _weighed(planes, [falling(radius)], means=False)


def falling(radius: int) -> tuple[float, ...]:
    """Returns weights by distance, which fall linearly from 1 to 0 beyond `radius`."""
    return tuple(1 - far / (radius + 1) for far in range(radius + 1))


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
    radii = [small + 1] * large + [small] * (_BOXES - large)
    return _weighed(planes, [(1.0,) * (radius + 1) for radius in radii], means=True)


def guided(
    pixels: Array, weight: Array, first: Array, second: Array, radius: int, edge: float
) -> tuple[Array, Array]:
    """Computes an edge-preserving mean of a value by blocks: the guided filter of He et al.

    The picture is its own guide: slope and offset, enlarged, make the mean of each pixel's value.
    Weights fall linearly. An edge that comes into a box would change its mean at once, and
    neighbours that look alike would not be lifted alike.

    Parameters
    ----------
    pixels, weight
        (row, col) of blocks: how many pixels count, and the sum of their importance.
    first, second
        (row, col) sums of the value and of its square, by importance.
    radius
        How far away blocks count, with weights that fall linearly, blocks.
    edge
        Standard deviation within a box at which half of it is kept: the root of their epsilon.

    Returns
    -------
    slope, offset
        (row, col) of blocks.
    """
    xp = namespace(pixels)
    within = _mean_by(near_sum(weight, radius), radius)
    middle = within(first)
    # Of each pixel from the middle of its own block
    spread = second - 2 * middle * first + middle**2 * weight
    variance = within(xp.maximum(spread, xp.zeros_like(spread)))
    slope = variance / (variance + edge**2)
    mean = _mean_by(near_sum(pixels, radius), radius)
    return mean(pixels * slope), mean(pixels * (1 - slope) * middle)


def _mean_by(weight: Array, radius: int) -> Callable[[Array], Array]:
    """Means of what is weighted already, by the sum of its weights; 0 where nothing counts."""
    xp = namespace(weight)
    weight = xp.where(weight > 0, weight, xp.ones_like(weight))
    return lambda values: near_sum(values, radius) / weight


_Weights: TypeAlias = tuple[float, ...]
"""By distance, on both sides."""


def _weighed(planes: Array, passes: Sequence[_Weights], *, means: bool) -> Array:
    """Sums along columns and rows, pass by pass; with `means`, over the sum of the weights."""
    if not isinstance(planes, np.ndarray):
        # Two products, which a GPU begins at once; neighbours one by one are some hundred kernels
        down, across = (
            _matrix(namespace(planes), planes.dtype, planes.device, size, tuple(passes), means)
            for size in planes.shape[-2:]
        )
        return down @ planes @ namespace(planes).matrix_transpose(across)
    result = planes.reshape(-1, *planes.shape[-2:])
    for axis in (1, 2):
        result = _along(result, axis, passes, means=means)
    return result.reshape(planes.shape)


def _along(planes: Array, axis: int, passes: Sequence[_Weights], *, means: bool) -> Array:
    """`_weighed` of (plane, row, col) along an axis, in strips that a core's cache holds."""
    result = np.empty_like(planes, order="C")

    def work(plane: int, beside: slice) -> None:
        place = (plane, slice(None), beside) if axis == 1 else (plane, beside, slice(None))
        lines = planes[place]
        for weights in passes:
            lines = _sums(lines, axis - 1, weights)
            if means:
                share = (1 / _sums(np.ones(lines.shape[axis - 1]), 0, weights)).astype(lines.dtype)
                lines *= share[:, None] if axis == 1 else share
        result[place] = lines

    in_strips(work, (len(planes), planes.shape[3 - axis], planes.shape[axis]))
    return result


def _sums(lines: Array, axis: int, weights: _Weights) -> Array:
    """Weighed sums of (row, col) or (place,) along an axis."""
    total = weights[0] * lines
    # Neighbours one by one: running sums in single precision lose what is dark beside what is
    # bright, and those of a library in double precision take twice as long for so few
    ahead = (slice(None),) * axis
    for far in range(1, min(len(weights), lines.shape[axis])):
        after, before = (*ahead, slice(far, None)), (*ahead, slice(None, -far))
        beside = weights[far] * lines
        total[after] += beside[before]
        total[before] += beside[after]
    return total


@lru_cache(maxsize=32)
def _matrix(
    xp: Any, dtype: Any, device: Any, size: int, passes: tuple[_Weights, ...], means: bool
) -> Array:
    """(place, of) by which `_weighed` weighs a line of `size` values."""
    matrix = np.eye(size)
    apart = np.abs(np.arange(size)[:, None] - np.arange(size))
    for weights in passes:
        by_distance = np.zeros(size)
        by_distance[: len(weights)] = weights[:size]
        step = by_distance[apart]
        matrix = (step / step.sum(axis=1, keepdims=True) if means else step) @ matrix
    return xp.asarray(matrix, dtype=dtype, device=device)
