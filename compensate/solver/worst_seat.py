"""The seat that is worst off, made as well off as can be: min over x of max over seats of f_s(x).

For any weights w >= 0 that sum to 1, min_x sum_s w_s f_s(x) is at most that minimum of the maximum
(and equal for the best weights: both problems are convex). So weighted sums give lower bounds, any
x an upper one, and the weights rise where a seat is worse off than the average: multiplicative
weights (Arora, Hazan & Kale 2012, *Theory of Computing* 8, 121-164).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.result import Result, Status
from compensate.weighting import CsfWeighting
from domesim.light import Light
from domesim.observation.seats import SeveralSeats


@final
@dataclass(frozen=True)
class WorstSeat:
    """Settings of the solver; call it with a problem of several seats, and a start.

    Parameters
    ----------
    inner
        What solves each weighted sum; its result's gap must be certified.
    tolerance
        Certified relative distance of the worst seat's cost from the least possible.
    max_rounds
        Weighted sums after which it gives up.
    speed
        How fast weights follow the seats' costs.
    """

    inner: Callable[[Problem, Light], Result] = field(
        default_factory=lambda: ADMM(tolerance=2e-4, stop_when_invisible=False)
    )
    tolerance: float = 5e-3
    max_rounds: int = 30
    speed: float = 2.0

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Minimise the worst seat's cost; `Result.cost` is that cost.

        Raises
        ------
        ValueError
            If the problem is not one of several seats under a `CsfWeighting`.
        """
        before = problem.ffts
        seats = _require_seats(problem)
        weights = np.full(seats, 1 / seats)
        best, least, light, chosen_weights = np.inf, 0.0, start, weights
        chosen, iterations, status = start, 0, Status.EXHAUSTED
        for number in range(self.max_rounds):
            weighted = _reweighted(problem, weights)
            found = self.inner(weighted, light)
            light, iterations = found.light, iterations + found.iterations
            if found.gap is not None:
                least = max(least, found.cost / (1 + found.gap))
            costs = np.array([_reweighted(problem, one).cost(light) for one in np.eye(seats)])
            if costs.max() < best:
                best, chosen, chosen_weights = float(costs.max()), light, weights
            if best - least <= self.tolerance * least:
                status = Status.CONVERGED
                break
            weights = weights * np.exp(self.speed / np.sqrt(1 + number) * (costs / costs.max() - 1))
            weights /= weights.sum()
        gap = (best - least) / least if least > 0 else None
        worst = _reweighted(problem, chosen_weights)
        return Result(
            chosen,
            best,
            worst.optimality(chosen),
            status,
            iterations,
            problem.ffts - before,
            gap,
        )


def seat_importance(weights: Any) -> Any:
    """(seen view,) importance of each seat's two views, of (seat,) weights; seats' sum to 1."""
    weights = np.asarray(weights, np.float64)
    return np.repeat(weights / weights.sum(), 2)


def _reweighted(problem: Problem, weights: Any) -> Problem:
    weighting = problem.weighting
    assert isinstance(weighting, CsfWeighting)
    return problem.weighted_by(weighting.with_importance(seat_importance(weights)))


def _require_seats(problem: Problem) -> int:
    if not isinstance(problem.observation, SeveralSeats):
        raise ValueError(f"WorstSeat takes several seats, got {type(problem.observation).__name__}")
    if not isinstance(problem.weighting, CsfWeighting):
        raise ValueError(f"WorstSeat takes a CsfWeighting, got {type(problem.weighting).__name__}")
    return len(problem.observation.seats)
