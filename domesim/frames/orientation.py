"""How a picture is turned from its file to the screen, and back (Exif 2.32, tag 274)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

UPRIGHT = 1
_BACK = {6: 8, 8: 6}


def known(stated: object) -> int:
    """The orientation that a file states; upright if that is none of the eight."""
    return stated if isinstance(stated, int) and 1 <= stated <= 8 else UPRIGHT


def turned(samples: NDArray[Any], orientation: int) -> NDArray[Any]:
    """(row, col, ...) as stored -> as it is shown."""
    if orientation >= 5:
        samples = samples.swapaxes(0, 1)
    rows = -1 if orientation in (3, 4, 7, 8) else 1
    cols = -1 if orientation in (2, 3, 6, 7) else 1
    return np.ascontiguousarray(samples[::rows, ::cols])


def turned_back(samples: NDArray[Any], orientation: int) -> NDArray[Any]:
    """(row, col, ...) as it is shown -> as stored."""
    return turned(samples, _BACK.get(orientation, orientation))
