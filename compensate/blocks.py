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
from functools import lru_cache, reduce
from typing import Any

import numpy as np

from domesim.light import Array, namespace
from domesim.light.strips import in_parts, in_strips

_BOXES = 3


def box_mean(planes: Array, radius: int, count: Array | None = None) -> Array:
    """Means over squares of 2 `radius` + 1 pixels.

    Parameters
    ----------
    planes
        (..., row, col); 0 where nothing counts.
    radius
        Pixels.
    count
        `box_sum` of what counts, if not every pixel of the picture does.
    """
    if count is None:
        return _boxes(planes, [radius], means=True)
    return box_sum(planes, radius) / count


def box_sum(planes: Array, radius: int) -> Array:
    """Sums over squares of 2 `radius` + 1 pixels; nothing lies outside the picture."""
    return _boxes(planes, [radius], means=False)


def smooth(planes: Array, sigma: float) -> Array:
    """Means by nearly a Gaussian of standard deviation `sigma`, pixels.

    A box of radius r has the variance r (r + 1) / 3. Boxes of the two nearest radii are taken, as
    many of each as come closest to the variance sigma².
    """
    small = int((sigma**2 + 0.25) ** 0.5 - 0.5)
    wanted = (sigma**2 - small * (small + 1)) / (2 * (small + 1) / 3)
    large = min(max(round(wanted), 0), _BOXES)
    return _boxes(planes, [small + 1] * large + [small] * (_BOXES - large), means=True)


def guided(
    pixels: Array, weight: Array, first: Array, second: Array, radius: int, edge: float
) -> tuple[Array, Array]:
    """Slope and offset of the edge-preserving mean of a value, (row, col) of blocks each.

    It is the guided filter of He et al., with the picture as its own guide: both, `enlarged`, make
    the mean of each pixel's value.

    Parameters
    ----------
    pixels, weight
        Of each block: how many pixels count, and the sum of their importance.
    first, second
        Sums of the value and of its square, by importance.
    radius
        Radius of the boxes, blocks.
    edge
        Standard deviation within a box at which half of it is kept: the root of their epsilon.
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


def by_blocks(
    sums: Callable[[int, slice], Array], shape: tuple[int, ...], block: int, like: Array
) -> Array:
    """Sums by blocks, computed in strips of whole rows of blocks.

    Parameters
    ----------
    sums
        View and rows -> (plane, row, col) sums of these rows by blocks, as of `block_sums`.
    shape
        (view, row, col, primary) of the picture.
    block
        Pixels of a block's side.
    like
        An array of the library that computes.

    Returns
    -------
    sums
        (view, plane, row, col) of blocks.
    """
    views, rows, cols, primaries = shape
    xp, strips = namespace(like), (views, -(-rows // block), block * cols * primaries)

    def strip(view: int, blocks: slice) -> Array:
        return sums(view, slice(blocks.start * block, min(blocks.stop * block, rows)))

    parts = in_parts(strip, strips, like)
    each = len(parts) // views
    return xp.stack([xp.concat(parts[v * each : (v + 1) * each], axis=1) for v in range(views)])


def block_sums(planes: Array, block: int) -> Array:
    """(..., row, col) sums of `planes` over squares of `block` pixels; the last may be cut off."""
    for axis in (-2, -1):
        planes = _sums_of(planes, block, axis)
    return planes


def enlarged(coarse: Array, block: int, size: tuple[int, ...]) -> Array:
    """Returns planes (..., row, col) of `size` from blocks: linear between their middles."""
    return _linear_along(_linear_along(coarse, block, -2, size[-2]), block, -1, size[-1])


def enlarged_rows(coarse: Array, block: int, rows: slice, cols: int) -> Array:
    """Some rows of `enlarged`, of `cols` columns."""
    places = (np.arange(rows.start, rows.stop) + 0.5) / block - 0.5
    places = np.clip(places, 0, coarse.shape[-2] - 1)
    first, last = int(places[0]), int(np.ceil(places[-1]))
    weights = np.maximum(1 - np.abs(places[:, None] - np.arange(first, last + 1)), 0)
    weights = namespace(coarse).asarray(weights, dtype=coarse.dtype, device=coarse.device)
    return _linear_along(weights @ coarse[..., first : last + 1, :], block, -1, cols)


def _sums_of(planes: Array, block: int, axis: int) -> Array:
    """Sums of `block` neighbours along an axis."""
    if block == 1:
        return planes
    xp = namespace(planes)
    lacking = -planes.shape[axis] % block
    if lacking:
        shape = list(planes.shape)
        shape[axis] = lacking
        nothing = xp.zeros(tuple(shape), dtype=planes.dtype, device=planes.device)
        planes = xp.concat([planes, nothing], axis=axis)

    if not isinstance(planes, np.ndarray):
        # One kernel on a GPU, where many small ones take longer to begin than to run
        after = planes.shape[-1:] if axis == -2 else ()
        return xp.sum(xp.reshape(planes, (*planes.shape[:axis], -1, block, *after)), axis=axis)

    def every(first: int) -> Array:
        place = slice(first, None, block)
        return planes[..., place, :] if axis == -2 else planes[..., place]

    return reduce(lambda found, first: found + every(first), range(1, block), every(0))


def _linear_along(coarse: Array, block: int, axis: int, count: int) -> Array:
    """`enlarged` along an axis: flat beyond the first and the last middle."""
    if block == 1:
        return coarse
    xp = namespace(coarse)

    def along(rows: slice) -> tuple[Any, ...]:
        return (..., rows, slice(None)) if axis == -2 else (..., rows)

    ends = coarse[along(slice(0, 1))], coarse[along(slice(-1, None))]
    coarse = xp.concat([ends[0], coarse, ends[1]], axis=axis)
    # From each middle to the next one there are as many places as in a block
    steps = xp.astype(xp.arange(block, device=coarse.device), coarse.dtype)
    part = (steps + (0.5 if block % 2 == 0 else 0.0)) / block
    below, above = coarse[along(slice(0, -1))], coarse[along(slice(1, None))]
    shape = list(below.shape)
    shape[axis] = -1
    if isinstance(coarse, np.ndarray):
        # Along an axis that is as short as a block NumPy takes ten times as long
        found = np.stack([below + (above - below) * each for each in part], axis)
    elif axis == -2:
        found = below[..., None, :] + (above - below)[..., None, :] * part[:, None]
    else:
        found = below[..., None] + (above - below)[..., None] * part
    found = xp.reshape(found, tuple(shape))
    first = (block + 1) // 2
    return found[along(slice(first, first + count))]


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
    found = planes.reshape(-1, *planes.shape[-2:])
    for axis in (1, 2):
        found = _along(found, axis, radii, means=means)
    return found.reshape(planes.shape)


def _along(planes: Array, axis: int, radii: Sequence[int], *, means: bool) -> Array:
    """`_boxes` of (plane, row, col) along rows or columns, in strips that a core's cache holds."""
    found = np.empty_like(planes, order="C")

    def work(plane: int, beside: slice) -> None:
        place = (plane, slice(None), beside) if axis == 1 else (plane, beside, slice(None))
        lines = planes[place]
        for radius in radii:
            lines = _box(lines, axis - 1, radius, means=means)
        found[place] = lines

    in_strips(work, (len(planes), planes.shape[3 - axis], planes.shape[axis]))
    return found


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
    found = np.eye(size)
    apart = np.abs(np.arange(size)[:, None] - np.arange(size))
    for radius in radii:
        box = (apart <= radius).astype(float)
        found = (box / box.sum(axis=1, keepdims=True) if means else box) @ found
    return xp.asarray(found, dtype=dtype, device=device)
