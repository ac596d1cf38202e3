"""Local means of `compensate.blocks.smooth` as weights of neighbours, for passes over pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from compensate.blocks import smooth


def weights_of(count: int, sigma: float) -> NDArray[np.float64]:
    """(place, neighbour) weights along a line of `count` values.

    The neighbours are those from as far before the place as the mean reaches to as far behind it.
    The places are those from the line's beginning up to the first whose mean reaches no end, or to
    its middle: the others are alike, or alike but turned round.
    """
    full = smooth(np.eye(count)[:, None, :], sigma)[:, 0, :].T  # (place, of)
    where = np.argwhere(full > 1e-9)  # running sums leave rounding
    reach = int(np.abs(where[:, 0] - where[:, 1]).max())
    places = min(reach + 1, (count + 1) // 2)
    wide = np.zeros((places, count + 2 * reach))
    wide[:, reach : reach + count] = full[:places]
    return np.stack([wide[place, place : place + 2 * reach + 1] for place in range(places)])
