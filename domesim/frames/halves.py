"""Samples of half precision by their bits: NumPy converts and compares halves one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_LARGEST = int(np.finfo(np.float16).max.view(np.uint16))


def are_sound(halves: NDArray[np.float16]) -> bool:
    """Says whether none is NaN, infinite or negative, nor a zero with a sign."""
    return int(halves.view(np.uint16).max()) <= _LARGEST
