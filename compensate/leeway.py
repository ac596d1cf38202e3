"""How far compensation of a stereo pair may leave subtraction: no further than a ghost is bright.

Where contrast is weighted locally, errors in bright places cost little. So a solver would lift a
dark edge beside something bright by many times the ghost that this hides, and take a seventh of its
light from a lamp whose ghost falls on black. Neither is what a producer wants of a method that
hides ghosts, and judges see both. So the light x stays within

    -min(times G, share x_s) <= x - x_s <= times G,
    G(r, p) = max over r' within reach of r, of psi(x_s) - seen

of what exact clipped subtraction x_s projects: G is the brightest ghost nearby that subtraction
leaves, in either eye, of that primary. A veil is hardly brighter than the ghost it hides, and
nothing lit loses much more than it leaves as a ghost, nor more than a small share of its light;
where there is no ghost, nothing changes. These are bounds like the projector's own, so the problem
stays as convex as it was.

The paper has only the projector's bounds. See ``validation/notes/0007`` for what decided.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from domesim.errors import require_positive
from domesim.light import Light
from domesim.strips import in_strips

_BLOCKS = 4  # in a reach: of each only the maximum counts

Limits = tuple[Light, Light]
"""Lower and upper bounds, (view, row, col, primary)."""


@final
@dataclass(frozen=True)
class Leeway:
    """How far the light may be from subtraction's.

    Parameters
    ----------
    times
        How many times as far as the brightest ghost nearby.
    share
        Share of its own light that a pixel may lose.
    reach
        How far away the ghost may be, degrees.

    Raises
    ------
    InputError
        If one is not above 0 or not finite.
    """

    times: float = 1.1
    share: float = 0.09
    reach: float = 1.3

    def __post_init__(self) -> None:
        require_positive("leeway", **vars(self))

    def limits(self, subtractive: Light, left: Light, bounds: Limits, density: float) -> Limits:
        """The bounds of a pair, and this leeway.

        Parameters
        ----------
        subtractive
            What exact clipped subtraction projects, (view, row, col, primary).
        left
            What it shows too much, of the same shape.
        bounds
            The projector's, which broadcast with it; `subtractive` is within.
        density
            Pixels per degree.
        """
        far = brightest_nearby(left, self.reach * density)
        far *= self.times
        lower, upper = np.empty_like(subtractive), np.empty_like(subtractive)
        least, most = (np.broadcast_to(bound, subtractive.shape) for bound in bounds)

        def work(view: int, rows: slice) -> None:
            base, room = subtractive[view, rows], far[rows]
            down = np.minimum(room, base * self.share)
            np.maximum(base - down, least[view, rows], out=lower[view, rows])
            np.minimum(base + room, most[view, rows], out=upper[view, rows])

        in_strips(work, subtractive.shape)
        return lower, upper


def brightest_nearby(light: Light, reach: float) -> Light:
    """The greatest value of any view around each pixel, at least 0: (row, col, primary).

    It looks at a square, block by block, and changes linearly from one block to the next.

    Parameters
    ----------
    light
        (view, row, col, primary).
    reach
        Half a side of the square, pixels.
    """
    _, rows, cols, primaries = light.shape
    side = max(1, round(reach / _BLOCKS))
    near = 2 * round(reach / side) + 1
    down, across = (np.arange(0, size, side) for size in (rows, cols))
    blocks = np.maximum.reduceat(light, down, axis=1).max(axis=0)
    blocks = np.maximum(np.maximum.reduceat(blocks, across, axis=1), 0)
    blocks = maximum_filter(blocks, size=(near, near, 1), mode="nearest")
    wide = _between(across, cols).astype(light.dtype) @ blocks
    tall = _between(down, rows).astype(light.dtype) @ wide.reshape(len(down), -1)
    result: Light = tall.reshape(rows, cols, primaries)
    return result


def _between(starts: NDArray[np.intp], size: int) -> NDArray[np.floating[Any]]:
    """(pixel, block) weights that interpolate linearly between the middles of blocks."""
    middles = (starts + np.append(starts[1:], size) - 1) / 2
    pixels = np.arange(size)
    return np.stack([np.interp(pixels, middles, one) for one in np.eye(len(starts))], axis=1)
