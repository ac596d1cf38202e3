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
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from compensate.problem import Problem
from compensate.solver.result import Result, Status
from domesim.light import Light, dot


@final
@dataclass(frozen=True)
class Accelerated:
    """Settings of the solver; call it with a problem and a start.

    Parameters
    ----------
    tolerance
        It stops when the largest KKT residual has fallen to this share of the start's.
    max_iterations
        Steps after which it gives up.
    growth
        By how much L exceeds the curvature that was found to be above it.
    """

    tolerance: float = 1e-4
    max_iterations: int = 2000
    growth: float = 1.2

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Minimise `problem` from the light `start` (view, row, col, primary)."""
        before = problem.ffts
        x = problem.project(start)
        cost, gradient = problem.quadratic(x)
        optimality = problem.kkt_residual(x, gradient)
        goal = self.tolerance * optimality
        status = Status.CONVERGED if optimality <= goal else Status.EXHAUSTED
        largest = self._curvature(problem, gradient)
        y, at_y, momentum = x, gradient, 1.0
        iteration = 0
        while status is Status.EXHAUSTED and iteration < self.max_iterations:
            iteration += 1
            new = problem.project(y - at_y / x.dtype.type(largest))
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
            following = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
            beyond = x.dtype.type((momentum - 1) / following)
            y = new + beyond * (new - x)
            at_y = new_gradient + beyond * (new_gradient - gradient)
            x, cost, gradient, momentum = new, new_cost, new_gradient, following
            optimality = problem.kkt_residual(x, gradient)
            if optimality <= goal:
                status = Status.CONVERGED
        return Result(x, cost, optimality, status, iteration, problem.ffts - before)

    def _curvature(self, problem: Problem, direction: Light) -> float:
        """Curvature along a direction: the first L."""
        length = dot(direction, direction)
        return self.growth * problem.curvature(direction)[0] / length if length else 1.0


_ROUNDING = 1 + 1e-3  # of the curvature, in float32
