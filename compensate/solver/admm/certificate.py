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
the bound is up to four times as wide (``validation/notes/0006``). `Level.lower_bound` has the
split.
"""

from __future__ import annotations

import math
from typing import final

from compensate.solver.result import Status
from domesim.light import Light, namespace

_SHARE = 1.6  # of the certified gap: rho P ||alpha (w - z)||² , as is usual
_PATIENCE = 40  # iterations in which the certified gap does not fall by a tenth
_OF_THE_BOUND = 2  # roundings of the bound itself, beside those of what it is a difference from


@final
class Certificate:
    """The last feasible cost, the best lower bound of the minimum, and what they tell."""

    def __init__(self, base: Light, start: float, negligible: float, tolerance: float) -> None:
        self.negligible = negligible
        self._tolerance = tolerance
        # Costs and bounds are differences from the base's: a bound is only as good as those are.
        self._rounding = 16 * float(namespace(base).finfo(base.dtype).eps)
        self._lower = 0.0
        self._least, self._progress_at = math.inf, 0
        self._share, self._sign = _SHARE, 0.0
        self._start = start
        self._expected = 0.5 * start
        self._due = 0
        self.cost = math.inf
        self.iterations = 0

    @property
    def gap(self) -> float:
        """Certified (cost - minimum) / minimum; infinite as long as nothing is certified."""
        return self.gap_of(self.cost)

    def gap_of(self, cost: float) -> float:
        """`gap` of another feasible cost."""
        return max(cost - self._lower, 0.0) / self._lower if self._lower > 0 else math.inf

    def raise_to(self, bound: float) -> None:
        """Note a new lower bound of the minimum."""
        rounded = max(abs(bound), self._start) + _OF_THE_BOUND * abs(bound)
        self._lower = max(self._lower, bound - self._rounding * rounded)

    def expect(self, cost: float) -> None:
        """Note about how large the minimum will be."""
        self._expected = min(max(cost, 0.01 * self._start), self._start)

    def verdict(self, cost: float, iteration: int) -> Status | None:
        """Status to stop with at a feasible cost after `iteration` iterations; None to go on."""
        before, since = self.gap, iteration - self.iterations
        self.cost, self.iterations = cost, iteration
        gap = self.gap
        if gap < before < math.inf:
            wanted = max(self._tolerance, self.negligible / self._lower)
            left = since * math.log(gap / wanted) / math.log(before / gap)
            self._due = iteration + int(left / 2)  # at half of the way, as it may fall faster
        if math.isfinite(gap) and gap > 0 and self._sign > 0:
            # It tends to fall
            found = self._sign / (cost * gap)
            self._share = 0.85 * min(max(found, _SHARE / 4), 4 * _SHARE)
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
        """Be patient anew."""
        self._least, self._progress_at = self.gap, iteration

    def likely(self, sign: float, iteration: int) -> bool:
        """Whether the gap is likely to be small enough.

        It is judged by a `sign` that goes with the gap, and by how fast the gap fell between the
        last two certificates.
        """
        self._sign = sign
        if iteration < self._due:
            return False
        cost = self.cost if math.isfinite(self.cost) else self._expected
        return sign <= self._share * max(self._tolerance * cost, self.negligible)
