"""A certified upper bound on how far a feasible light is from the optimum.

At a feasible w with gradient g and Hessian H, every feasible v has
``f(v) >= f(w) + g'(v - w) + 1/2 (v - w)' H (v - w)``. Split g = g_B + g_F. On B the bounds limit
how much can be won: ``g_i (v_i - w_i) >= -|g_i| dist_i`` with the distance to the bound that -g
points to. On F the quadratic does. So, for any split,

    f(w) - f* <= 1/2 g_F' H^-1 g_F + sum_B |g_i| dist_i

H over the whole padded plane may stand for H over the picture: more freedom only lowers the
minimum. The split takes a pixel to B where |g| dist is less than its own share g² / (2 h) of the
quadratic, for a typical curvature h. (The choice matters little: any split is valid.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Planes = Any

_CURVATURE = 0.1  # h, with weights of peak 1


def gap_bound(
    dual_energy: Callable[[Planes], float],
    planes: Planes,
    gradient: Planes,
    bounds: tuple[Planes, Planes],
) -> float:
    """Upper bound on f(w) - f*.

    Parameters
    ----------
    dual_energy
        g' H^-1 g of planes g, or an upper bound of it.
    planes, gradient
        (plane, padded row, padded col) w, within its bounds, and the gradient there.
    bounds
        Lower and upper planes (or broadcastable).
    """
    lower, upper = bounds
    distance = np.where(gradient > 0, planes - lower, upper - planes)
    size = np.abs(gradient)
    bound = distance * (2 * _CURVATURE) <= size
    at_bounds = float(np.sum(size * distance, where=bound, dtype=np.float64))
    free = np.where(bound, 0, gradient).astype(gradient.dtype, copy=False)
    return 0.5 * dual_energy(free) + at_bounds
