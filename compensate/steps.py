"""Whether a master's codes are too coarse for what is shown of it.

A dark place that is lifted shows the steps between its codes, too. In 8 bits the lowest codes lie
a third of their light apart: over a floor they become contours.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from domesim.frames import Master
from domesim.light import Light
from domesim.light.strips import in_strips

VISIBLE = 0.1
"""Contrast of a step that counts as seen, of the darker side."""
COARSE = 1e-3
"""Least share of the screen that a report mentions."""
BITS = 8
"""Bits of the finest codes whose steps can be seen."""
_EVERY = 5  # each fifth row and the next are looked at; masters repeat by even numbers

_Pair: TypeAlias = tuple[NDArray[Any], NDArray[Any]]
"""Of pixels, and of their neighbours to the right, or below."""


def are_fine(frame: Master) -> bool:
    """Says whether a master's codes are so fine that none of their steps is seen."""
    return frame.frames[0].floating or frame.frames[0].bits > BITS


def visible_steps(
    frame: Master, seen: Light, screen: NDArray[np.bool_], weights: NDArray[np.floating]
) -> float:
    """Measures where neighbouring codes of a master are seen as a step.

    Parameters
    ----------
    frame
        The master.
    seen
        (view, row, col, primary) what is seen of it.
    screen
        (row, col) bool: pixels that count.
    weights
        (primary,) of luminance.

    Returns
    -------
    share
        Share of all pixels. A pixel counts if its code differs from its neighbour's by one in some
        primary and by no more in any, and its luminance by `VISIBLE`. 0 for depths above 8 bits.
    """
    if are_fine(frame):
        return 0.0
    pixels = [each.pixels for each in frame.frames]
    return share_of_steps(pixels, 2 ** frame.frames[0].bits - 1, seen, screen, weights)


def share_of_steps(
    pixels: Sequence[NDArray[np.floating]],
    largest: int,
    seen: Light,
    screen: NDArray[np.bool_],
    weights: NDArray[np.floating],
) -> float:
    """Measures where neighbouring codes are seen as a step.

    Parameters
    ----------
    pixels
        Of each view: (row, col, primary) codes over the largest.
    largest
        Code.
    seen, screen, weights
        As for `visible_steps`.

    Returns
    -------
    share
        As of `visible_steps`.
    """

    def count(view: int, rows: slice) -> tuple[int, int]:
        begin = rows.start + -rows.start % _EVERY
        some, below = slice(begin, rows.stop - 1, _EVERY), slice(begin + 1, rows.stop, _EVERY)
        on, others = (
            (
                screen[each],
                np.rint(pixels[view][each] * largest).astype(np.int16),
                seen[view, each] @ weights.astype(seen.dtype),
            )
            for each in (some, below)
        )
        beside = [(plane[:, :-1], plane[:, 1:]) for plane in on]
        found = [_steps(*beside), _steps(*zip(on, others, strict=True))]
        return sum(steps for steps, _ in found), sum(pairs for _, pairs in found)

    counts = in_strips(count, seen.shape)
    return sum(steps for steps, _ in counts) / max(sum(pairs for _, pairs in counts), 1)


def _steps(on: _Pair, codes: _Pair, light: _Pair) -> tuple[int, int]:
    """Number of pixels whose neighbour is a visible step away, and of all that have one."""
    both = on[0] & on[1]
    near = both & (np.abs(codes[0] - codes[1]).max(axis=-1) == 1)
    step = near & (np.abs(light[0] - light[1]) > VISIBLE * np.minimum(*light))
    return int(np.count_nonzero(step)), int(np.count_nonzero(both))
