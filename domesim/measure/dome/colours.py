"""A camera's own colours -> the projector's primaries.

A camera's channel c sees a share M[c, p] of primary p's light, the same at every pixel, as each
primary is reflected as itself. Photographs of full red, green and blue, less black, tell M's
columns: the ratios of the channels' sums over the picture. How bright a primary is, they do not
tell: light of p is measured in units of what channel p (red, green, blue) sees of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError

Floats = NDArray[np.float64]

HARDEST = 20.0
"""Condition number of the matrix from which colours cannot be distinguished."""
_SEEN = 0.05
"""Least share of the brightest channel that the primary's own channel must see of it."""


def mixing(black: Floats, primaries: Sequence[Floats]) -> Floats:
    """(channel, primary) how a camera sees primaries, 1 on the diagonal.

    Parameters
    ----------
    black
        (row, col, channel) photograph of black at unit exposure.
    primaries
        The same of full red, green and blue.

    Raises
    ------
    InputError
        If one is not brighter than black, or the camera hardly tells them apart.
    """
    columns = []
    for number, photograph in enumerate(primaries):
        name = ("red", "green", "blue")[number]
        sums = (photograph - black).sum((0, 1))
        if not sums[number] > _SEEN * max(float(sums.max()), 0.0) > 0:
            shares = ", ".join(f"{part / max(abs(float(sums.max())), 1e-300):.3f}" for part in sums)
            raise InputError(
                f"colours.{name}: wanted a photograph of full {name}, brighter than black and most "
                f"of all in the channel {name} or near it, got R, G, B as {shares}; is it that of "
                f"another pattern?"
            )
        columns.append(sums / sums[number])
    matrix = np.stack(columns, 1)
    hard = float(np.linalg.cond(matrix))
    if hard > HARDEST:
        raise InputError(
            f"colours: the camera sees the primaries nearly alike (condition number {hard:.0f}, "
            f"wanted {HARDEST:g} or less); are red, green and blue those of different patterns?"
        )
    return matrix


def unmixed(light: Floats, matrix: Floats) -> Floats:
    """(..., primary) light of the primaries of (..., channel) a camera's."""
    return np.asarray(light @ np.linalg.inv(matrix).T)


def unmixed_variance(variance: Floats, matrix: Floats) -> Floats:
    """(..., primary) variance of `unmixed` light, of (..., channel) independent ones."""
    return np.asarray(variance @ (np.linalg.inv(matrix) ** 2).T)
