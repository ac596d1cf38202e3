"""The ghost contour: how much of a ghost's edges is left.

With e and g the luminance that is seen too much, now and of the untouched master, it is

    C = sqrt(sum (grad e . n)² / sum (grad g . n)²),  n = grad g / |grad g|

over the strongest edges of the ghost, of planes smoothed as for the ghost edge energy
(`compensate.ghosts`). It is 1 if nothing is done, and 0 if none of the edges is left.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from compensate.ghosts import edge_sigma

EDGES = 0.9
"""Share of the ghost's squared slopes that its edges hold."""
FAINTEST = 0.01
"""Light, of white, far below which the eye has no contrast beside brighter light."""

Floats = NDArray[np.float64]


def ghost_contours(
    master: Floats,
    shown: Floats,
    untouched: Floats,
    where: NDArray[np.bool_],
    pixels_per_degree: float,
) -> tuple[float | None, float | None]:
    """Ghost contours of light and of contrast; None where the ghost has no edges.

    Parameters
    ----------
    master, shown, untouched
        (view, row, col) luminance, white = 1: wanted, seen, and seen of the untouched master.
    where, pixels_per_degree
        As for `ghost_contour`.
    """
    of_light = ghost_contour(shown - master, untouched - master, where, pixels_per_degree)
    master, shown, untouched = (np.log(y + FAINTEST) for y in (master, shown, untouched))
    of_contrast = ghost_contour(shown - master, untouched - master, where, pixels_per_degree)
    return of_light, of_contrast


def ghost_contour(
    error: Floats, ghost: Floats, where: NDArray[np.bool_], pixels_per_degree: float
) -> float | None:
    """C above; None where the ghost has no edges.

    Parameters
    ----------
    error, ghost
        (view, row, col) luminance that is seen too much: now, and of the untouched master.
    where
        (view, row, col) pixels of which the edges are taken.
    pixels_per_degree
        As the audience sees it.
    """
    sigma = edge_sigma(pixels_per_degree)
    edges, slopes = (
        np.stack([_slope(plane, sigma, axis) for axis in (1, 2)]) for plane in (ghost, error)
    )
    strength = np.sum(edges**2, axis=0)
    inside = np.sort(strength[where])[::-1]
    if not np.any(inside > 0):
        return None
    sums = np.cumsum(inside)
    weakest = inside[np.searchsorted(sums, EDGES * sums[-1])]
    at = where & (strength >= weakest)
    across = np.sum(edges * slopes, axis=0)[at] ** 2 / strength[at]
    return float(np.sqrt(across.sum() / strength[at].sum()))


def _slope(planes: Floats, sigma: float, axis: int) -> Floats:
    """(view, row, col) slopes of smoothed planes along an axis; borders are no edges."""
    order = [0, 0, 0]
    order[axis] = 1
    slopes: Floats = gaussian_filter(planes, (0, sigma, sigma), order=order, mode="nearest")
    return slopes
