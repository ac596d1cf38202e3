"""Gradient projection, conjugate gradients (GPCG): the solver of the paper, kept readable.

Moré, J. J. and Toraldo, G. (1991), "On the solution of large quadratic programming problems with
bound constraints", SIAM J. Optimization 1, 93-113 (sections 3-5). For a convex quadratic q on a box
each iteration does two things:

1. *Gradient projection* finds the face of the box that holds the solution:
   ``y_{j+1} = P[y_j - alpha_j grad q(y_j)]``, with a step that decreases q sufficiently,

       q(y_{j+1}) <= q(y_j) + mu <grad q(y_j), y_{j+1} - y_j>,

   until the active set settles, or the decrease falls below eta_1 times the best one so far.

2. *Conjugate gradients* minimise q over that face (the free variables), until their decrease falls
   below eta_2 times the best one so far; a projected search along the result decreases q
   sufficiently. While the new point's active set is its binding set (the face is the right one),
   they go on.

The paper (section 3.4, eq. 9) keeps the pollution constant during one iteration and updates it
after each. That *frozen* variant converges to a point that is not the minimiser once pixels are
clipped, since its gradient lacks the pollution's part; it is here to be compared with.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

from compensate.problem import Problem
from compensate.solver.result import Result, Status
from domesim.light import Light, dot, namespace


@final
@dataclass(frozen=True)
class GPCG:
    """Settings of the solver; call it with a problem and a start.

    Parameters
    ----------
    frozen
        Keep the pollution constant during each iteration, as the paper does.
    tolerance
        It stops when the norm of the projected gradient has fallen to this share of the start's.
        Frozen: when an iteration changes the light by less than this share of its norm.
    max_iterations
        Iterations (of both phases) after which it gives up.
    max_gradient_steps, max_cg_steps
        Longest gradient projection and conjugate gradient phase of an iteration.
    max_phases
        Most conjugate gradient phases of an iteration, while the face stays the right one.
    decrease, gradient_progress, cg_progress
        mu, eta_1 and eta_2 above.
    progress
        Called after each iteration with (iteration, cost).
    """

    frozen: bool = False
    tolerance: float = 1e-4
    max_iterations: int = 200
    max_gradient_steps: int = 10
    max_cg_steps: int = 10
    max_phases: int = 20
    decrease: float = 0.1
    gradient_progress: float = 0.25
    cg_progress: float = 0.25
    progress: Callable[[int, float], None] | None = None

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Minimise `problem` from the light `start` (view, row, col, primary)."""
        before = problem.ffts
        x = problem.begun(start, "GPCG")
        goal = self.tolerance * _norm(_projected_gradient(problem, x, problem.gradient(x)))
        status, iteration = Status.EXHAUSTED, 0
        while iteration < self.max_iterations:
            model = problem.frozen(x) if self.frozen else problem
            new, cost, gradient = self._iterate(model, x)
            iteration += 1
            if self.progress:
                self.progress(iteration, cost)
            change, x = _norm(new - x), new
            if self.frozen:
                finished = change <= self.tolerance * _norm(x)
            else:
                finished = _norm(_projected_gradient(problem, x, gradient)) <= goal
            if finished or change == 0:
                status = Status.CONVERGED if finished else Status.STALLED
                break
        cost, gradient = problem.quadratic(x)
        optimality = problem.kkt_residual(x, gradient)
        return Result(x, cost, optimality, status, iteration, problem.ffts - before)

    def _iterate(self, q: Problem, x: Light) -> tuple[Light, float, Light]:
        """One gradient projection phase and the conjugate gradients on the face it finds."""
        x, cost, gradient = self._gradient_projection(q, x)
        # Bounded, for where the cost is nearly 0 rounding lets steps go on for ever.
        for _ in range(self.max_phases):
            direction = self._conjugate_gradients(q, x, gradient)
            slope = dot(gradient, direction)
            if slope >= 0:
                break
            moved = self._search(q, x, cost, gradient, direction, 1.0)
            if moved is None:
                break
            x, cost, gradient = moved
            # Off the face's own optimum, or with bounds that pull inwards, it's not the last face.
            if not _binding(q, x, gradient) or _small_step(cost, slope):
                break
        return x, cost, gradient

    def _gradient_projection(self, q: Problem, x: Light) -> tuple[Light, float, Light]:
        cost, gradient = q.quadratic(x)
        best = 0.0
        for _ in range(self.max_gradient_steps):
            descent = -_projected_gradient(q, x, gradient)
            curvature, _product = q.curvature(descent)
            if curvature <= 0:
                break
            step = dot(descent, descent) / curvature
            moved = self._search(q, x, cost, gradient, -gradient, step)
            if moved is None:
                break
            settled = bool(namespace(x).all(_free(q, x) == _free(q, moved[0])))
            gained = cost - moved[1]
            x, cost, gradient = moved
            if settled or gained <= self.gradient_progress * best:
                break
            best = max(best, gained)
        return x, cost, gradient

    def _conjugate_gradients(self, q: Problem, x: Light, gradient: Light) -> Light:
        """A step d on the free variables that reduces q(x + d)."""
        xp, free = namespace(x), _free(q, x)
        d, none = xp.zeros_like(x), xp.zeros_like(x)
        r = xp.where(free, -gradient, none)
        p, squared, best = r, dot(r, r), 0.0
        for _ in range(self.max_cg_steps):
            if squared == 0:
                break
            curvature, product = q.curvature(p)
            step = squared / curvature
            d = d + step * p
            r = r - step * xp.where(free, product, none)
            gained = 0.5 * step * squared
            if gained <= self.cg_progress * best:
                break
            best = max(best, gained)
            previous, squared = squared, dot(r, r)
            p = r + (squared / previous) * p
        return d

    def _search(
        self, q: Problem, x: Light, cost: float, gradient: Light, direction: Light, step: float
    ) -> tuple[Light, float, Light] | None:
        """First of P[x + step direction], step halved each time, that decreases q sufficiently."""
        for _ in range(20):
            new = q.project(x + float(step) * direction)
            new_cost, new_gradient = q.quadratic(new)
            if new_cost <= cost + self.decrease * dot(gradient, new - x):
                return new, new_cost, new_gradient
            step /= 2
        return None


def _projected_gradient(q: Problem, x: Light, gradient: Light) -> Light:
    """The gradient without what the bounds hold back (Moré & Toraldo, eq. 2.3)."""
    at_lower, at_upper = x <= q.lower, x >= q.upper
    held = (at_lower & (gradient > 0)) | (at_upper & (gradient < 0)) | (at_lower & at_upper)
    xp = namespace(x)
    return xp.where(held, xp.zeros_like(gradient), gradient)


def _free(q: Problem, x: Light) -> Any:
    return (x > q.lower) & (x < q.upper)


def _binding(q: Problem, x: Light, gradient: Light) -> bool:
    """Whether every active bound also binds: B(x) = A(x)."""
    inward = ((x <= q.lower) & (gradient < 0)) | ((x >= q.upper) & (gradient > 0))
    return not bool(namespace(x).any(inward & (q.lower < q.upper)))


def _small_step(cost: float, slope: float) -> bool:
    """Whether the predicted decrease drowns in the cost's rounding."""
    return -slope <= 1e-7 * abs(cost)


def _norm(light: Light) -> float:
    return math.sqrt(dot(light, light))
