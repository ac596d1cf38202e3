"""Accelerated projected gradient with restart: the simplest fast method, kept for comparison.

Projected gradient descent, ``x = P(y - grad f(y) / L)``, needs of the order of 1/gap steps. Beck
and Teboulle (2009, "A fast iterative shrinkage-thresholding algorithm for linear inverse problems",
*SIAM J. Imaging Sciences* 2, 183-202; after Nesterov 1983) take the step from a point beyond the
last, and need 1/sqrt(gap):

    x_k   = P(y_k - grad f(y_k) / L)
    t_k+1 = (1 + sqrt(1 + 4 t_k²)) / 2
    y_k+1 = x_k + (t_k - 1) / t_k+1 (x_k - x_k-1)

With the momentum of a worse conditioned problem than the one at hand, the cost goes up and down.
O'Donoghue and Candès (2015, "Adaptive restart for accelerated gradient schemes", *Foundations of
Computational Mathematics* 15, 715-732, section 3.2) drop the momentum when f(x_k) > f(x_k-1), which
gives linear convergence without the strong convexity being known.

f is quadratic, so that gradients at x_k do for all of it: y is an affine combination of two x, its
gradient the same of theirs, and

    f(x_k) - f(x_k-1) = (x_k - x_k-1)' (grad f(x_k) + grad f(x_k-1)) / 2
    d' H d = d' (grad f(x_k) - grad f(y_k)),      d = x_k - y_k

the first without the rounding of the difference of two costs. Where the second, d's curvature, is
above L |d|², L was too small, and the step is taken again with a larger one (Beck and Teboulle's
backtracking). Each step costs two FFTs a plane.

With a regulariser the cost is strongly convex, H >= m = mu l², l the least singular value of L.
Then no light y within the bounds costs less than (with the gradient g at x)

    f(x) - sum_i max_y (g_i (x_i - y_i) - m/2 (x_i - y_i)²)

which certifies the answer (`certified`). It needs no inverse of H and knows no observation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np

from compensate.problem import Problem
from compensate.solver.result import Result, Status
from domesim.light import Light, dot, namespace, total


@final
@dataclass(frozen=True)
class Accelerated:
    """Settings of the solver; call it with a problem and a start.

    Parameters
    ----------
    tolerance
        It stops when the largest KKT residual has fallen to this share of the start's; or below the
        last digit of the brightest light, where rounding is all that is left (`Status.STALLED`).
    max_iterations
        Steps after which it gives up.
    growth
        By how much L exceeds the curvature that was found to be above it.
    gap
        It also stops at this certified relative gap; None to certify nothing. Far from the optimum,
        and where L has no inverse, nothing is certified either.
    progress
        Told the iteration and the gap, now and then.
    """

    tolerance: float = 1e-4
    max_iterations: int = 2000
    growth: float = 1.2
    gap: float | None = None
    progress: Callable[[int, float], None] | None = None

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Minimise `problem` from the light `start` (view, row, col, primary)."""
        before = problem.ffts
        x = problem.begun(start, "Accelerated")
        cost, gradient = problem.quadratic(x)
        optimality = problem.kkt_residual(x, gradient)
        goal = self.tolerance * optimality
        status = Status.CONVERGED if optimality <= goal else Status.EXHAUSTED
        largest = self._curvature(problem, gradient)
        modulus = None if self.gap is None else convexity(problem)
        y, at_y, momentum = x, gradient, 1.0
        iteration = 0
        while status is Status.EXHAUSTED and iteration < self.max_iterations:
            iteration += 1
            new = problem.project(y - at_y / float(largest))
            new_cost, new_gradient = problem.quadratic(new)
            step = new - y
            length, curvature = dot(step, step), dot(step, new_gradient - at_y)
            if curvature > largest * length * _ROUNDING:
                largest = self.growth * curvature / length
                continue
            if dot(new - x, new_gradient + gradient) >= 0:
                if momentum == 1:
                    status = Status.STALLED
                y, at_y, momentum = x, gradient, 1.0
                continue
            following = (1 + math.sqrt(1 + 4 * momentum**2)) / 2
            beyond = (momentum - 1) / following
            y = new + beyond * (new - x)
            at_y = new_gradient + beyond * (new_gradient - gradient)
            x, cost, gradient, momentum = new, new_cost, new_gradient, following
            optimality = problem.kkt_residual(x, gradient)
            if optimality <= goal:
                status = Status.CONVERGED
            elif optimality <= _last_digit(x):
                status = Status.STALLED
            if modulus is not None and iteration % _CHECKED == 0:
                status, relative_gap = self._checked(problem, x, cost, gradient, modulus, status)
                if self.progress is not None:
                    self.progress(iteration, relative_gap)
        gap = None
        if modulus is not None:
            relative_gap = relative(cost, certified(problem, x, gradient, modulus))
            gap = relative_gap if math.isfinite(relative_gap) else None
        return Result(x, cost, optimality, status, iteration, problem.ffts - before, gap)

    def _checked(
        self,
        problem: Problem,
        light: Light,
        cost: float,
        gradient: Light,
        modulus: float,
        status: Status,
    ) -> tuple[Status, float]:
        """Whether what is certified is enough, and the relative gap."""
        gained = certified(problem, light, gradient, modulus)
        relative_gap = relative(cost, gained)
        if self.gap is not None and relative_gap <= self.gap:
            status = Status.CONVERGED
        elif gained <= problem.negligible:
            status = Status.INVISIBLE
        return status, relative_gap

    def _curvature(self, problem: Problem, direction: Light) -> float:
        """Curvature along a direction: the first L."""
        length = dot(direction, direction)
        return self.growth * problem.curvature(direction)[0] / length if length else 1.0


def _last_digit(light: Light) -> float:
    """What the brightest light is known to: a residual is the difference of two lights."""
    xp = namespace(light)
    return float(xp.finfo(light.dtype).eps * xp.max(xp.abs(light)))


_ROUNDING = 1 + 1e-3  # of the curvature, in float32

_CHECKED = 10  # iterations from one certificate to the next


def convexity(problem: Problem) -> float:
    """Returns m, a lower bound of the Hessian's eigenvalues, by the regulariser alone.

    L is made of a matrix in each pixel. Its least singular value is at least that of its diagonal
    less the mean of what is beside it in row and column (C. R. Johnson, "A Gersgorin-type lower
    bound for the smallest singular value", Linear Algebra and its Applications 112, 1989).
    """
    observation, desired = problem.observation, problem.desired
    if not problem.regularisation or observation.shape != observation.seen_shape:
        return 0.0
    xp = namespace(desired)
    views, _, _, primaries = observation.shape
    beside = xp.zeros_like(desired)
    own = xp.zeros_like(desired)
    for view, primary in np.ndindex(views, primaries):
        unit = np.zeros((views, 1, 1, primaries))
        unit[view, ..., primary] = 1
        one = xp.zeros_like(desired) + xp.asarray(unit, dtype=desired.dtype, device=desired.device)
        seen = xp.abs(observation.local(one))
        column = xp.sum(seen * (1 - one), axis=(0, 3), keepdims=True)
        own = own + seen * one
        beside = beside + (seen * (1 - one) + one * column) / 2
    least = max(float(xp.min(own - beside)), 0.0)
    return problem.regularisation * least**2


def certified(problem: Problem, light: Light, gradient: Light, modulus: float) -> float:
    """Bounds how much less any light within the bounds can cost.

    Parameters
    ----------
    problem
        What is minimised.
    light, gradient
        (view, row, col, primary) where, and the cost's gradient there.
    modulus
        m, as of `convexity`.

    Returns
    -------
    gain
        In the cost's unit; infinite where m is 0.
    """
    if modulus <= 0:
        return math.inf
    xp = namespace(light)
    step = gradient / modulus
    step = xp.minimum(xp.maximum(step, light - problem.upper), light - problem.lower)
    return float(total(gradient * step - modulus / 2 * step**2))


def relative(cost: float, gained: float) -> float:
    """Divides what could be gained by the least cost that is possible.

    Parameters
    ----------
    cost
        Cost of a light.
    gained
        What `certified` returns for it.

    Returns
    -------
    gap
        Infinite where nothing is certified.
    """
    return gained / (cost - gained) if gained < cost else math.inf
