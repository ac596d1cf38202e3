"""Gauss-Newton on the box: for grey-to-grey crosstalk, which is not linear.

Each round minimises the problem with the table linearised at the light so far, and goes there, or
half as far until the *true* cost falls (Nocedal & Wright 2006, *Numerical Optimization*, 10.3, here
with bounds). A fixed point satisfies the true problem's first-order conditions. The gap that is
certified is that of the last linearisation: the true cost need not be convex.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import final

from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.result import Result, Status
from domesim.light import Light
from domesim.observation.grey_to_grey import GreyToGrey, Linearised


@final
@dataclass(frozen=True)
class Relinearised:
    """Settings of the solver; call it with a problem of a linearised table, and a start.

    Parameters
    ----------
    inner
        What solves each linearised problem.
    tolerance
        It stops when a round lowers the cost by less than this share; its status then is that of
        the last round's inner solver.
    max_rounds
        Rounds after which it gives up.
    """

    inner: Callable[[Problem, Light], Result] = field(default_factory=ADMM)
    tolerance: float = 1e-3
    max_rounds: int = 12

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Minimise `problem`, with its table as it is, from `start` (view, row, col, primary).

        Raises
        ------
        ValueError
            If what is observed is no linearised table.
        """
        if not isinstance(problem.observation, Linearised):
            raise ValueError(
                f"Relinearised takes a linearised table, got {type(problem.observation).__name__}"
            )
        exact, before, iterations = problem.observation.exact, problem.ffts, 0
        light = problem.project(start)
        cost = true_cost(problem, exact, light)
        status, gap = Status.EXHAUSTED, None
        for _ in range(self.max_rounds):
            local = problem.observed_by(exact.linearised(light))
            found = self.inner(local, light)
            iterations += found.iterations
            new, new_cost = _downhill(problem, exact, light, found.light, cost)
            # What is certified is of the inner solution, and goes with it only.
            whole = new is found.light
            gained, light, cost = cost - new_cost, new, new_cost
            if gained <= self.tolerance * cost:
                status, gap = found.status, found.gap if whole else None
                break
        local = problem.observed_by(exact.linearised(light))
        optimality = local.optimality(light)
        return Result(light, cost, optimality, status, iterations, problem.ffts - before, gap)


def true_cost(problem: Problem, exact: GreyToGrey, light: Light) -> float:
    """The objective with the table as it is."""
    energy = problem.weighting.energy(exact.observe(light) - problem.desired)
    return 0.5 * energy + problem.penalty(light)


def _downhill(
    problem: Problem, exact: GreyToGrey, light: Light, towards: Light, cost: float
) -> tuple[Light, float]:
    """The farthest of a few points on the way whose true cost is lower; else where we are."""
    step = towards - light
    if (whole := true_cost(problem, exact, towards)) < cost:
        return towards, whole
    for halvings in range(1, 8):
        new = light + 0.5**halvings * step
        new_cost = true_cost(problem, exact, new)
        if new_cost < cost:
            return new, new_cost
    return light, cost
