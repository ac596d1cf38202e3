"""Whether a master's codes are too coarse for what is shown of it.

A dark place that is lifted shows the steps between its codes, too. In 8 bits the lowest codes lie
a third of their light apart: over a floor they become contours.
"""

from __future__ import annotations

from collections.abc import Sequence

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
_EVERY = 4  # every fourth row is looked at


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
    first = frame.frames[0]
    if first.floating or first.bits > BITS:
        return 0.0
    pixels = [each.pixels for each in frame.frames]
    return share_of_steps(pixels, 2**first.bits - 1, seen, screen, weights)


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
        some = slice(rows.start + -rows.start % _EVERY, rows.stop, _EVERY)
        codes = np.rint(pixels[view][some] * largest).astype(np.int16)
        on = screen[some, 1:] & screen[some, :-1]
        near = on & (np.abs(np.diff(codes, axis=1)).max(axis=-1) == 1)
        light = seen[view, some] @ weights.astype(seen.dtype)
        lower = np.minimum(light[:, 1:], light[:, :-1])
        step = near & (np.abs(np.diff(light, axis=1)) > VISIBLE * lower)
        return int(np.count_nonzero(step)), int(np.count_nonzero(on))

    counts = in_strips(count, seen.shape)
    return sum(steps for steps, _ in counts) / max(sum(pairs for _, pairs in counts), 1)
