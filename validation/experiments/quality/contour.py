"""The ghost contour (`compensate.ghosts`) of light, and of contrast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from compensate.ghosts import ghost_contour

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
