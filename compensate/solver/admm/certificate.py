"""A certified upper bound on how far a feasible light is from the optimum.

At any w with gradient g and Hessian H, every feasible v has
``f(v) >= f(w) + g'(v - w) + 1/2 (v - w)' H (v - w)``. Split g = g_B + g_F, and let v = M d be what
is seen of a light d. On B the bounds of light limit how much can be won, on F the quadratic does.
So, for any split,

    f* >= f(w) - g_B' w + sum_i min_d (M' g_B)_i d_i - 1/2 g_F' H^-1 g_F

H over the whole padded plane may stand for H over the picture: more freedom only lowers the
minimum. The split takes a pixel to B where |q| dist is less than its own share q² / (2 h) of the
quadratic, for q = M' g, the distance to the bound that -q points to, and a curvature h (any split
is valid): the median of Omega², within limits. Where pixels are finer than the eye, what is left
on F is of frequencies that are hardly seen, and with h = 0.1 the bound is up to four times as wide
(``validation/notes/0006``).
"""

from __future__ import annotations

import math
from typing import final

from compensate.solver.admm.pixels import Pixels, Planes
from compensate.solver.result import Status
from domesim.light import namespace, total

_PATIENCE = 40  # iterations in which the certified gap does not fall by a tenth
_ROUNDINGS = 16  # of the base's cost, and twice as many of the bound


def split(
    pixels: Pixels, curvature: float, gradient: Planes, w: Planes, light: Planes
) -> tuple[float, Planes]:
    """Splits a gradient between bounds and quadratic.

    Parameters
    ----------
    pixels
        M and the bounds.
    curvature
        h.
    gradient, w
        (seen plane, row, col): g at w.
    light
        A feasible d near w.

    Returns
    -------
    least, free
        The least of g_B'(v - w) within the bounds, and g_F, (seen plane, row, col).
    """
    xp = namespace(w)
    lower, upper = pixels.lower, pixels.upper
    q = pixels.back(gradient)
    distance = xp.where(q > 0, light - lower, upper - light)
    bounded = 2 * curvature * pixels.curvature() * distance <= xp.abs(q)
    # What no light can be seen to follow goes with what the bounds limit
    free = pixels.forward(xp.where(bounded, 0 * q, q))
    rest = gradient - free
    q = pixels.back(rest)
    least = total(q * xp.where(q > 0, lower, upper)) - total(rest * w)
    return float(least), free


@final
class Certificate:
    """The last feasible cost, and the best lower bound of the minimum.

    Parameters
    ----------
    base
        Cost of the base. Costs and bounds are differences from it: a bound is only as good as those
        are rounded.
    eps
        Of the arithmetic.
    tolerance, negligible
        Relative gap, and difference of costs, at which to stop.
    """

    def __init__(self, base: float, eps: float, tolerance: float, negligible: float) -> None:
        self._base, self._rounding = base, _ROUNDINGS * eps
        self._tolerance, self.negligible = tolerance, negligible
        self._lower = 0.0
        self._least, self._progress_at = math.inf, 0

    def gap(self, cost: float) -> float:
        """Returns the certified (cost - minimum) / minimum; infinite while nothing is certified."""
        return max(cost - self._lower, 0.0) / self._lower if self._lower > 0 else math.inf

    def raise_to(self, bound: float) -> None:
        """Notes a new lower bound of the minimum."""
        rounded = max(abs(bound), self._base) + 2 * abs(bound)
        self._lower = max(self._lower, bound - self._rounding * rounded)

    def verdict(self, cost: float, iteration: int) -> Status | None:
        """Decides whether to stop.

        Parameters
        ----------
        cost
            Of a feasible light.
        iteration
            Iterations done.

        Returns
        -------
        status
            None to go on.
        """
        gap = self.gap(cost)
        if gap < 0.9 * self._least:
            self._least, self._progress_at = gap, iteration
        if gap <= self._tolerance:
            return Status.CONVERGED
        if cost - self._lower <= self.negligible:
            return Status.INVISIBLE
        if iteration - self._progress_at >= _PATIENCE and math.isfinite(gap):
            return Status.STALLED
        return None

    def wait(self, iteration: int) -> None:
        """Begins to be patient anew."""
        self._progress_at = iteration
