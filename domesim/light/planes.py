"""Light that is told part by part: no picture of all of it need be kept.

Half codes of a file are decoded in less time than their light takes to come from memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from domesim.light import Array, Light
from domesim.light.strips import in_strips

Index: TypeAlias = slice | NDArray[np.intp]
"""Rows, or columns: as NumPy takes them."""

Planes: TypeAlias = Callable[[int, Index, Index], Sequence[Array]]
"""A view, some rows and some columns of it -> (row, col) light of each primary."""


def planes_of(light: Light) -> Planes:
    """Tells light that is there, part by part.

    Parameters
    ----------
    light
        (view, row, col, primary).

    Returns
    -------
    planes
        Of the same values; slices of it are not copied.
    """
    return lambda view, rows, cols: [light[view, rows, cols, p] for p in range(light.shape[-1])]


def compact(array: NDArray[Any]) -> NDArray[Any]:
    """Copies an array so that it lies in one piece; what is repeated is kept once."""
    return np.broadcast_to(np.ascontiguousarray(once(array)), array.shape)


def once(array: NDArray[Any]) -> NDArray[Any]:
    """Returns an array without repetitions: axes along which it is one value have one place."""
    return array[tuple(slice(0, None if step else 1) for step in array.strides)]


def dtype_of(planes: Planes) -> np.dtype[Any]:
    """Returns the type of NumPy's light that is told part by part."""
    first = slice(0, 1)
    found: np.dtype[Any] = planes(0, first, first)[0].dtype
    return found


def every(planes: Planes, views: int, step: int) -> Light:
    """Takes every so many rows and columns of light that is told part by part.

    Parameters
    ----------
    planes
        What tells it.
    views
        How many it has.
    step
        From one to the next.

    Returns
    -------
    light
        (view, row, col, primary).
    """
    some = slice(None, None, step)
    return np.moveaxis(np.stack([planes(view, some, some) for view in range(views)]), 1, -1)


def gathered(planes: Planes, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Gathers light that is told part by part.

    Parameters
    ----------
    planes
        What tells it.
    shape
        (view, row, col, primary).

    Returns
    -------
    light
        Of that shape, float32. A primary's plane lies in one piece: what goes through planes is
        twice as fast so.
    """
    light = empty_light(shape)

    def gather(view: int, rows: slice) -> None:
        for p, plane in enumerate(planes(view, rows, slice(0, shape[2]))):
            light[view, rows, :, p] = plane

    in_strips(gather, shape)
    return light


def empty_light(shape: tuple[int, ...], dtype: Any = np.float32) -> NDArray[Any]:
    """Light of any values, (view, row, col, primary), whose planes lie in one piece each."""
    views, rows, cols, primaries = shape
    return np.moveaxis(np.empty((views, primaries, rows, cols), dtype), 1, -1)


@final
class Columns:
    """Columns that a screen takes in strips of its rows: a fifth of a domemaster is off it.

    Parameters
    ----------
    screen
        (row, col) bool.
    """

    def __init__(self, screen: NDArray[np.bool_]) -> None:
        self._screen = screen

    @cached_property
    def _ends(self) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
        """(row,) first column, the one after the last, and whether all between are on it."""
        screen, cols = self._screen, self._screen.shape[1]
        count = np.count_nonzero(screen, axis=1)
        first = np.where(count, screen.argmax(axis=1), cols)
        last = np.where(count, cols - screen[:, ::-1].argmax(axis=1), 0)
        return first, last, count == last - first

    def of(self, rows: slice, block: int = 1) -> slice:
        """Returns columns outside which none of the rows has a pixel of the screen.

        Parameters
        ----------
        rows
            Some rows.
        block
            Both ends are multiples of it, or the picture's.

        Returns
        -------
        cols
            Of one column, or block, at least.
        """
        first, last, _ = self._ends
        cols = self._screen.shape[1]
        start = min(int(first[rows].min()), cols - 1) // block * block
        stop = max(int(last[rows].max()), start + 1)
        return slice(start, min(-(-stop // block) * block, cols))

    def full(self, rows: slice) -> slice:
        """Returns columns within which all pixels of the rows are on the screen; maybe none."""
        first, last, whole = self._ends
        start = int(first[rows].max()) if whole[rows].all() else self._screen.shape[1]
        return slice(start, max(start, int(last[rows].min())))

    def partly(self, rows: Index, cols: Index) -> list[slice]:
        """Returns the parts of `cols` in which some pixel of the rows may be off the screen."""
        if not (isinstance(cols, slice) and isinstance(rows, slice) and cols.step is None):
            return [slice(None)]
        start, stop, _ = cols.indices(self._screen.shape[1])
        full = self.full(rows)
        ends = slice(start, min(full.start, stop)), slice(max(full.stop, start), stop)
        if full.stop <= full.start:
            return [slice(None)]
        return [
            slice(each.start - start, each.stop - start) for each in ends if each.stop > each.start
        ]
