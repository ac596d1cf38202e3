"""Ways in which left and right lie in one picture, as players, projectors and screens take them.

| packing | left | right |
| --- | --- | --- |
| ``side-by-side``, ``top-bottom`` | on the left, on top | beside it, below it |
| ``side-by-side-half``, ``top-bottom-half`` | the same, at half the width or height | |
| ``frame-packed`` (HDMI 1.4a, 8.2.3.2) | first 1080 rows of 2205, or 720 of 1470 | the last ones |
| ``row-interleaved`` | the first row, the third, ... | the second row, the fourth, ... |
| ``anaglyph`` | red, seen through a red filter | green and blue, through a cyan one |

Halves are means of two pixels, in linear light; when they are read, each pixel is two again. An
anaglyph is written only, by the matrices of E. Dubois, A projection method to generate anaglyph
stereo images, Proc. ICASSP 2001, which are of linear light.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Shared: TypeAlias = Literal[
    "side-by-side",
    "top-bottom",
    "side-by-side-half",
    "top-bottom-half",
    "frame-packed",
    "row-interleaved",
    "anaglyph",
]
"""Packings of one picture."""
ANAGLYPH: Literal["anaglyph"] = "anaglyph"
AXES: Mapping[Shared, int] = {
    "side-by-side": 1,
    "top-bottom": 0,
    "side-by-side-half": 1,
    "top-bottom-half": 0,
}
"""Axis along which views follow each other."""
HALVES: tuple[Shared, ...] = ("side-by-side-half", "top-bottom-half")
GAPS: Mapping[tuple[int, int], int] = {(1080, 1920): 45, (720, 1280): 30}
"""Rows between the views of a frame-packed picture, by their rows and columns."""

# Dubois 2001, red and cyan, as FFmpeg's stereo3d has them (in 65536ths)
_LEFT = np.array([[29884, 32799, 11559], [-2627, -2479, -1033], [-997, -1350, -358]]) / 65536
_RIGHT = np.array([[-2849, -5763, -102], [24804, 48080, -1209], [-4729, -7403, 80373]]) / 65536

Curve: TypeAlias = Callable[[NDArray[Any]], NDArray[Any]]


def put_together(
    views: Sequence[NDArray[Any]], packing: Shared, decode: Curve, encode: Curve
) -> NDArray[Any]:
    """Makes one picture of left and right.

    Parameters
    ----------
    views
        Two (row, col, ...) samples.
    packing
        How they lie in it.
    decode, encode
        Samples to linear light, and back.

    Returns
    -------
    picture
        (row, col, ...) samples.

    Raises
    ------
    ValueError
        If views of that size do not lie in a picture so.
    """
    left, right = views
    rows, cols = left.shape[:2]
    if packing in AXES:
        if packing in HALVES:
            if (rows, cols)[AXES[packing]] % 2:
                raise ValueError(f"views of an even {('height', 'width')[AXES[packing]]}")
            left, right = (_halved(view, AXES[packing], decode, encode) for view in views)
        return np.concatenate((left, right), AXES[packing])
    if packing == "frame-packed":
        if (rows, cols) not in GAPS:
            raise ValueError("views of 1920 x 1080 or 1280 x 720 px")
        gap = np.zeros((GAPS[rows, cols], *left.shape[1:]), left.dtype)
        return np.concatenate((left, gap, right))
    if packing == "row-interleaved":
        picture = np.array(left)
        picture[1::2] = right[1::2]
        return picture
    if left.ndim < 3:  # alpha
        return np.asarray(np.maximum(left, right))
    light = decode(left) @ _LEFT.T + decode(right) @ _RIGHT.T
    return np.asarray(encode(np.clip(light, 0, 1)).astype(left.dtype))


def taken_apart(picture: NDArray[Any], packing: Shared) -> tuple[NDArray[Any], NDArray[Any]]:
    """Takes left and right out of one picture.

    Parameters
    ----------
    picture
        (row, col, ...) samples.
    packing
        How they lie in it; not ``anaglyph``.

    Returns
    -------
    left, right
        (row, col, ...) samples of whole views.

    Raises
    ------
    ValueError
        If views do not lie in a picture of that size so.
    """
    rows, cols = picture.shape[:2]
    if packing in AXES:
        axis = AXES[packing]
        if (rows, cols)[axis] % 2:
            raise ValueError(f"an even {('height', 'width')[axis]}")
        left, right = np.split(picture, 2, axis)
        if packing in HALVES:
            left, right = np.repeat(left, 2, axis), np.repeat(right, 2, axis)
        return left, right
    if packing == "frame-packed":
        sizes = {(2 * high + gap, width): high for (high, width), gap in GAPS.items()}
        if (rows, cols) not in sizes:
            raise ValueError("1920 x 2205 or 1280 x 1470 px")
        high = sizes[rows, cols]
        return picture[:high], picture[-high:]
    if packing == "row-interleaved":
        if rows % 2:
            raise ValueError("an even height")
        return np.repeat(picture[0::2], 2, 0), np.repeat(picture[1::2], 2, 0)
    raise ValueError("another packing: an anaglyph cannot be taken apart")


def _halved(view: NDArray[Any], axis: int, decode: Curve, encode: Curve) -> NDArray[Any]:
    """Means of two neighbours, in linear light."""
    light = decode(view) if view.ndim > 2 else view.astype(np.float64)
    first, second = (light[:, k::2] if axis else light[k::2] for k in (0, 1))
    means: NDArray[Any] = 0.5 * (first + second)
    if view.ndim > 2:
        return np.asarray(encode(means).astype(view.dtype))
    return (np.rint(means) if np.issubdtype(view.dtype, np.integer) else means).astype(view.dtype)
