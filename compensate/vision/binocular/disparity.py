"""Disparity of a pair: which place of the right picture belongs to one of the left, and how surely.

OpenCV's semi-global matching [1] does it, on the logarithm of luminance, as eyes compare contrasts.
It is done twice, from left to right and from right to left. A place is *sure* if both ways agree
within a pixel. Others are seen by one eye only, or have nothing to compare: dark and plain ones.
These get the disparity of the nearest sure place: nothing there tells the eyes to turn.

[1] H. Hirschmüller, "Stereo processing by semiglobal matching and mutual information", IEEE Trans.
Pattern Anal. Mach. Intell. 30, 328 (2008); OpenCV's StereoSGBM, with the penalties that its
documentation gives: 8 and 32 times the block's area.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light.guarded import guarded

WIDEST = 0.1
"""Largest disparity either way, of the picture's width; trunks of the test data have 0.09."""
DARKEST = 1e-3
"""Luminance that counts as black, of white."""
_BLOCK = 5
_UNIQUE = 10
_STEPS = 16  # OpenCV's unit of disparity, and what their number must be a multiple of

Floats = NDArray[np.floating[Any]]


@final
@dataclass(frozen=True)
class Disparity:
    """Disparity at each place of one picture.

    Attributes
    ----------
    shift
        (row, col) x in this picture less x in the other one, pixels.
    sure
        (row, col) whether matching from the other picture agrees.
    """

    shift: Floats
    sure: NDArray[np.bool_]

    def fused(self, other: Floats) -> Floats:
        """The other picture (row, col, ...) moved to where this one has the same things.

        Its border goes on beyond it.
        """
        rows, cols = self.shift.shape
        y, x = np.mgrid[:rows, :cols]
        places = np.stack([y, x - self.shift])
        planes = np.moveaxis(other.reshape(rows, cols, -1), -1, 0)
        moved = [
            scipy.ndimage.map_coordinates(plane, places, order=1, mode="nearest")
            for plane in planes
        ]
        return np.stack(moved, axis=-1).reshape(other.shape)


@guarded
def disparities(left: Floats, right: Floats) -> tuple[Disparity, Disparity]:
    """Matches two pictures, each with the other.

    Parameters
    ----------
    left, right
        (row, col) luminance, white = 1.

    Returns
    -------
    left, right
        Disparity of the left picture, and of the right one.

    Raises
    ------
    InputError
        If the pictures have not one shape, are narrower than 32 pixels, or OpenCV is not installed.
    """
    if left.shape != right.shape or left.ndim != 2 or left.shape[1] < 2 * _STEPS:
        raise InputError(
            f"disparity is of two pictures (row, col) of one shape and 32 columns at least, got "
            f"{left.shape} and {right.shape}"
        )
    one, other = (_coded(picture) for picture in (left, right))
    from_left, from_right = _matched(one, other), _matched(other, one)
    return _checked(from_left, from_right), _checked(from_right, from_left)


def _coded(luminance: Floats) -> NDArray[np.uint8]:
    light = np.clip(luminance, DARKEST, 1)
    return np.asarray(np.rint(255 * (1 - np.log(light) / np.log(DARKEST))), np.uint8)


def _matched(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> Floats:
    """(row, col) disparity of the first picture; NaN where none is found."""
    try:
        cv2: Any = importlib.import_module("cv2")
    except ImportError:
        raise InputError("disparity needs OpenCV: pip install 'domesim[disparity]'") from None
    most = _STEPS * max(1, round(WIDEST * one.shape[1] / _STEPS))
    matcher = cv2.StereoSGBM_create(
        minDisparity=-most,
        numDisparities=2 * most,
        blockSize=_BLOCK,
        P1=8 * _BLOCK**2,
        P2=32 * _BLOCK**2,
        uniquenessRatio=_UNIQUE,
        mode=cv2.STEREO_SGBM_MODE_HH,
    )
    # Columns nearer to the border than the search reaches would be left out
    around = [np.pad(each, ((0, 0), (2 * most, 2 * most)), "edge") for each in (one, other)]
    found = matcher.compute(*around)[:, 2 * most : -2 * most].astype(np.float64) / _STEPS
    found[found < -most] = np.nan
    return np.asarray(found)


def _checked(own: Floats, other: Floats) -> Disparity:
    """Disparities that the other way agrees with; elsewhere the nearest of these."""
    rows, cols = own.shape
    y, x = np.mgrid[:rows, :cols]
    there = np.rint(x - np.nan_to_num(own)).astype(int)
    inside = (there >= 0) & (there < cols)
    back = other[y, np.clip(there, 0, cols - 1)]
    sure = inside & (np.abs(own + back) <= 1)  # NaN compares as False
    if not sure.any():
        return Disparity(np.zeros(own.shape), sure)
    nearest = scipy.ndimage.distance_transform_edt(
        ~sure, return_distances=False, return_indices=True
    )
    return Disparity(own[tuple(nearest)], sure)
