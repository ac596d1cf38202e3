"""A certified upper bound on how far a feasible light is from the optimum.

At any w with gradient g and Hessian H, every feasible v has
``f(v) >= f(w) + g'(v - w) + 1/2 (v - w)' H (v - w)``. Split g = g_B + g_F. On B the bounds limit
how much can be won: ``g_i (v_i - w_i) >= -|g_i| dist_i`` with the distance to the bound that -g
points to (negative where w is beyond it). On F the quadratic does. So, for any split,

    f(w) - f* <= 1/2 g_F' H^-1 g_F + sum_B |g_i| dist_i

H over the whole padded plane may stand for H over the picture: more freedom only lowers the
minimum. The split takes a pixel to B where |g| dist is less than its own share g² / (2 h) of the
quadratic, for a curvature h (any split is valid): the median of Omega², within limits. Where pixels
are finer than the eye, what is left on F is of frequencies that are hardly seen, and with h = 0.1
the bound is up to four times as wide (``validation/notes/0006``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from domesim.light import namespace, total

Planes = Any


def gap_bound(
    dual_energy: Callable[[Planes], float],
    planes: Planes,
    gradient: Planes,
    bounds: Sequence[tuple[Any, Any]],
    curvature: float,
) -> float:
    """Upper bound on f(w) - f*.

    Parameters
    ----------
    dual_energy
        g' H^-1 g of planes g, or an upper bound of it.
    planes, gradient
        (row, col) planes w, and the gradient there.
    bounds
        Lower and upper planes.
    curvature
        h.
    """
    at_bounds, free = 0.0, []
    for w, g, (lower, upper) in zip(planes, gradient, bounds, strict=True):
        known, rest = parted(w, g, lower, upper, curvature)
        at_bounds += known
        free.append(rest)
    return 0.5 * dual_energy(free) + at_bounds


def parted(w: Any, g: Any, lower: Any, upper: Any, curvature: float) -> tuple[float, Any]:
    """Sum over B of |g| dist, and g_F, of a plane (or a strip of one)."""
    xp = namespace(g)
    distance = xp.where(g > 0, w - lower, upper - w)
    size = xp.abs(g)
    bound = distance * (2 * curvature) <= size
    return float(total(xp.where(bound, size * distance, 0 * size))), xp.where(bound, 0 * g, g)
