"""Whether light differs by more than rounding."""

from __future__ import annotations

import threading

import numpy as np

from domesim.light import Light, namespace
from domesim.light.strips import in_parts

ROUNDING = 8 * float(np.finfo(np.float32).eps)
"""Light, of white, that is nothing: what is seen is a sum of a few products in single precision,
each of them off by half an epsilon of white."""


def is_rounding(light: Light, expected: Light | None = None) -> bool:
    """Says whether light is nowhere more than rounding away from what is expected.

    Parameters
    ----------
    light
        (view, row, col, ...), 1 = projector white.
    expected
        Of the same shape; 0 if it is None.
    """
    xp = namespace(light)
    beyond = threading.Event()  # which ends the search

    def work(view: int, rows: slice) -> None:
        if beyond.is_set():
            return
        part = light[view, rows, ...]
        if expected is not None:
            part = part - expected[view, rows, ...]
        if max(float(xp.max(part)), -float(xp.min(part))) > ROUNDING:
            beyond.set()

    in_parts(work, light.shape, light)
    return not beyond.is_set()
