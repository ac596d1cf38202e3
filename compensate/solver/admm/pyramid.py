"""Planes of half the rows and columns, and back."""

from __future__ import annotations

from typing import TypeAlias

from compensate.fourier import Fourier
from compensate.solver.admm.hessian import each_strip
from domesim.light import Array, namespace

Value: TypeAlias = float | Array
"""One value for all pixels, or a (row, col) plane of them."""


def padded(picture: Array, fourier: Fourier) -> Array:
    """A (padded row, padded col) plane with a (row, col) one in its corner, and 0 around."""
    result = namespace(picture).zeros(
        (fourier.rows, fourier.cols), dtype=picture.dtype, device=picture.device
    )
    result[: picture.shape[0], : picture.shape[1]] = picture
    return result


def halved(plane: Array) -> Array:
    """A plane of half the rows and columns: means of 2 x 2, with a 0 beyond an odd edge."""
    xp = namespace(plane)
    rows, cols = plane.shape
    if rows % 2 or cols % 2:
        even = xp.zeros((rows + rows % 2, cols + cols % 2), dtype=plane.dtype, device=plane.device)
        even[:rows, :cols] = plane
        return halved(even)
    result = xp.empty((rows // 2, cols // 2), dtype=plane.dtype, device=plane.device)

    def work(strip: slice) -> None:
        across = plane[2 * strip.start : 2 * strip.stop, :]
        across = across[::2, :] + across[1::2, :]
        result[strip, :] = 0.25 * (across[:, ::2] + across[:, 1::2])

    each_strip(work, result)
    return result


def halved_value(value: Value) -> Value:
    """`halved` where it is a plane."""
    return value if isinstance(value, float) else halved(value)


def doubled(plane: Array, rows: int, cols: int, times: float = 1.0) -> Array:
    """Repeats each pixel 2 x 2, cut to `rows` and `cols`, and multiplies all by `times`."""
    xp = namespace(plane)
    result = xp.empty((rows, cols), dtype=plane.dtype, device=plane.device)

    def work(strip: slice) -> None:
        to = result[strip, :]
        for i in range(2):
            first, number = (strip.start + i) // 2, (strip.stop - strip.start - i + 1) // 2
            part = plane[first : first + number, :] * times
            for j in range(2):
                to[i::2, j::2] = part[:, : (cols - j + 1) // 2]

    each_strip(work, result)
    return result


def rows_of(value: Value, rows: slice) -> Value:
    """Rows of a plane, where it is one."""
    return value if isinstance(value, float) else value[rows, ...]
