"""Blocks of pixels: sums and means over them, and values between their middles.

A block is a square of `block` x `block` pixels; the last ones of a picture may be cut off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np

from domesim.light import Array, Light, namespace
from domesim.light.strips import in_parts


def block_sums(planes: Array, block: int) -> Array:
    """Sums planes over blocks.

    Parameters
    ----------
    planes
        (..., row, col).
    block
        Pixels along a block's side.

    Returns
    -------
    sums
        (..., row, col) of blocks.
    """
    for axis in (-2, -1):
        planes = _sums_along(planes, block, axis)
    return planes


def block_sums_within(planes: Sequence[Array], block: int, cols: slice, width: int) -> Array:
    """Sums some columns of planes over blocks of a picture; outside of them are zeros.

    Parameters
    ----------
    planes
        (row, col) each, of these columns.
    block
        Pixels along a block's side.
    cols
        Columns: the first is a block's first one, and so is that after the last, or the picture's.
    width
        Columns of the picture.

    Returns
    -------
    sums
        (plane, row, col) of blocks of the whole width.
    """
    xp = namespace(planes[0])
    found = _sums_along(xp.stack([_sums_along(plane, block, -2) for plane in planes]), block, -1)
    if cols == slice(0, width):
        return found
    wide = np.zeros((*found.shape[:2], -(-width // block)), found.dtype)
    first = cols.start // block
    wide[..., first : first + found.shape[2]] = found
    return wide


def by_blocks(
    sums: Callable[[int, slice], Array], shape: tuple[int, ...], block: int, like: Array
) -> Array:
    """Sums a picture over blocks, in strips of whole rows of blocks.

    Parameters
    ----------
    sums
        Takes a view and rows, and returns their `block_sums`, (plane, row, col) of blocks.
    shape
        (view, row, col, primary) of the picture.
    block
        Pixels along a block's side.
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
    count = len(parts) // views
    return xp.stack([xp.concat(parts[v * count : (v + 1) * count], axis=1) for v in range(views)])


def light_sums(light: Light, block: int, screen: Array | None = None) -> Light:
    """Sums light over the pixels of each block that lie on the screen.

    Parameters
    ----------
    light
        (view, row, col, primary).
    block
        Pixels along a block's side.
    screen
        (row, col) bool; all pixels count if it is None.

    Returns
    -------
    sums
        (view, row, col, primary) of blocks.
    """
    xp = namespace(light)

    def sums(view: int, rows: slice) -> Array:
        # Plane by plane: neighbours of one primary are added many at once
        planes = [light[view, rows, :, p] for p in range(light.shape[-1])]
        if screen is not None:
            on = screen[rows, :]
            planes = [xp.where(on, plane, xp.zeros_like(plane)) for plane in planes]
        return xp.stack([block_sums(plane, block) for plane in planes])

    return xp.moveaxis(by_blocks(sums, light.shape, block, light), 1, -1)


def light_means(light: Light, block: int, screen: Array | None = None) -> Light:
    """Averages light over the pixels of each block that lie on the screen.

    Parameters
    ----------
    light, block, screen
        As for `light_sums`.

    Returns
    -------
    means
        (view, row, col, primary) of blocks; 0 where a block has no pixel on the screen.
    """
    xp = namespace(light)
    on = xp.ones_like(light[0, :, :, 0]) if screen is None else xp.astype(screen, light.dtype)
    count = block_sums(on, block)
    return light_sums(light, block, screen) / xp.maximum(count, xp.ones_like(count))[..., None]


def enlarged(coarse: Array, block: int, rows: slice, cols: int) -> Array:
    """Interpolates values of blocks linearly between their middles.

    Parameters
    ----------
    coarse
        (..., row, col) of blocks. They are constant beyond the first and the last middle.
    block
        Pixels along a block's side.
    rows
        Rows of the picture that are wanted.
    cols
        Columns of the picture.

    Returns
    -------
    planes
        (..., row, col) of these rows.
    """
    return enlarged_down(enlarged_across(coarse, block, cols), block, rows)


def enlarged_across(coarse: Array, block: int, cols: int) -> Array:
    """Interpolates values of blocks along rows alone: once for all strips of `enlarged_down`.

    Parameters
    ----------
    coarse, block, cols
        As for `enlarged`.

    Returns
    -------
    wide
        (..., row of blocks, col).
    """
    return coarse if block == 1 else _linear_across(coarse, block, cols)


def enlarged_down(wide: Array, block: int, rows: slice) -> Array:
    """Completes `enlarged_across`.

    Parameters
    ----------
    wide
        (..., row of blocks, col).
    block, rows
        As for `enlarged`.

    Returns
    -------
    planes
        (..., row, col) of these rows.
    """
    if block == 1:
        return wide[..., rows, :]
    places = (np.arange(rows.start, rows.stop) + 0.5) / block - 0.5
    places = np.clip(places, 0, wide.shape[-2] - 1)
    first, last = int(places[0]), int(np.ceil(places[-1]))
    weights = np.maximum(1 - np.abs(places[:, None] - np.arange(first, last + 1)), 0)
    weights = namespace(wide).asarray(weights, dtype=wide.dtype, device=wide.device)
    return weights @ wide[..., first : last + 1, :]


def _sums_along(planes: Array, block: int, axis: int) -> Array:
    """Sums `block` neighbours along an axis, -2 or -1."""
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

    if axis == -2:
        *before, rows, cols = planes.shape
        return np.add.reduce(planes.reshape(*before, rows // block, block, cols), axis=-2)
    return reduce(np.add, (planes[..., first::block] for first in range(block)))


def _linear_across(coarse: Array, block: int, cols: int) -> Array:
    """`enlarged` along rows."""
    xp = namespace(coarse)
    coarse = xp.concat([coarse[..., :1], coarse, coarse[..., -1:]], axis=-1)
    # From each middle to the next one there are as many places as in a block
    steps = xp.astype(xp.arange(block, device=coarse.device), coarse.dtype)
    part = (steps + (0.5 if block % 2 == 0 else 0.0)) / block
    below, above = coarse[..., :-1], coarse[..., 1:]
    if isinstance(coarse, np.ndarray):
        # Along an axis that is as short as a block NumPy takes ten times as long
        found = np.stack([below + (above - below) * share for share in part], -1)
    else:
        found = below[..., None] + (above - below)[..., None] * part
    found = xp.reshape(found, (*below.shape[:-1], -1))
    first = (block + 1) // 2
    return found[..., first : first + cols]
