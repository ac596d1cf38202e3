"""ADMM with an exact Fourier step: the product's solver.

With w = D x the problem splits into a quadratic that Fourier diagonalises and bounds that are
separate for each pixel:

    min f(w) + g(z)   s.t. w = z
    f(w) = 1/2 ||A (C w - t)||²            (`DomeSplit`, `PairSplit`)
    g(z) = 1/2 mu ||z / D - x_0||² + [D lower <= z <= D upper]

The alternating direction method of multipliers (Boyd et al. 2011, *Foundations and Trends in
Machine Learning* 3, 1-122, scaled form, over-relaxed by alpha) then repeats

    w   = (C'A'A C + rho P)^-1 (C'A'A t + rho P (z - y))      two FFTs a plane
    w'  = alpha w + (1 - alpha) z
    z   = clip((rho P (w' + y) + mu x_0 / D) / (rho P + mu / D²))
    y   = y + w' - z

with a diagonal metric P over the primaries, ~ the root of diag(T'T), and a penalty rho that starts
at 0.1 and falls: the scaled dual y is rescaled with it. z is feasible at any time; the best z seen
is returned, with a certified gap (`certificate`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np

from compensate.problem import Problem
from compensate.solver.dome_split import DomeSplit
from compensate.solver.pair_split import PairSplit
from compensate.solver.result import Result, Status
from compensate.solver.split import Planes, Split
from compensate.weighting import CsfWeighting
from domesim.light import Light
from domesim.observation.stereo import StereoObservation


@final
@dataclass(frozen=True)
class ADMM:
    """Settings of the solver; call it with a problem and a start.

    Parameters
    ----------
    tolerance
        Certified relative gap at which it stops.
    max_iterations
        Iterations after which it gives up.
    relaxation
        alpha.
    penalty, penalty_floor, penalty_decay, penalty_hold
        rho at the start and at the end; its factor an iteration after `penalty_hold` iterations.
        In a theatre with strong pollution both are raised, by ||C||^1.5: found by trial, and tested
        from a cap of 60 degrees and albedo 0.3 to 170 degrees and 0.95.
    stop_when_invisible
        Also stop when what could still be gained is less than the problem's `negligible`.
    first_check, check_every
        When to compute the certificate (three FFTs a plane).
    progress
        Called after each check with (iteration, certified gap).
    """

    tolerance: float = 1e-3
    max_iterations: int = 400
    relaxation: float = 1.8
    penalty: float = 0.1
    penalty_floor: float = 0.005
    penalty_decay: float = 0.8
    penalty_hold: int = 6
    stop_when_invisible: bool = True
    first_check: int = 10
    check_every: int = 3
    progress: Callable[[int, float], None] | None = None

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Minimise `problem` from `start` (view, row, col, primary), a feasible light.

        Raises
        ------
        ValueError
            If the problem is neither a dome's nor a stereo pair's under a `CsfWeighting`, has no
            regulariser, or its pixels are not pinned where the weighting has no support.
        """
        if not isinstance(start, np.ndarray):
            raise ValueError(f"ADMM takes NumPy light, got {type(start).__name__}")
        before = problem.ffts
        start = problem.project(start)
        if _nothing_to_do(problem, start):
            return Result(start, 0.0, 0.0, Status.EXACT, 0, 0, 0.0)
        split = split_of(problem, start)
        best = _Best(split, start, problem.negligible if self.stop_when_invisible else 0.0)
        primal = state = split.planes(start)
        dual = np.zeros_like(state)
        floor = self.penalty_floor * split.strength**1.5
        rho = max(self.penalty, 2 * floor)
        split.prepare(floor)
        inverse = split.inverse(rho)
        iteration, status = 0, best.verdict(self.tolerance)
        while status is None and iteration < self.max_iterations:
            iteration += 1
            weight = (rho * split.metric).astype(split.dtype)[:, None, None]
            primal = split.step(inverse, weight, state - dual, primal)
            relaxed = self.relaxation * primal
            relaxed += (1 - self.relaxation) * state
            relaxed += dual
            state = split.nearest(relaxed, weight)
            dual = relaxed
            dual -= state
            if (
                iteration >= self.first_check
                and (iteration - self.first_check) % self.check_every == 0
            ):
                best.offer(state)
                status = best.verdict(self.tolerance)
                if self.progress:
                    self.progress(iteration, best.gap)
            if iteration >= self.penalty_hold and rho > floor:
                lowered = max(floor, rho * self.penalty_decay)
                dual *= rho / lowered
                rho = lowered
                inverse = split.inverse(rho)
        light = split.light(best.planes)
        cost, gradient = problem.quadratic(light)
        optimality = problem.kkt_residual(light, gradient)
        gap = best.gap if np.isfinite(best.gap) else None
        return Result(
            light,
            cost,
            optimality,
            status or Status.EXHAUSTED,
            iteration,
            problem.ffts - before,
            gap,
        )


def split_of(problem: Problem, start: Light) -> Split:
    """How the problem splits: by what is observed.

    Raises
    ------
    ValueError
        If ADMM cannot solve it.
    """
    if isinstance(problem.observation, StereoObservation):
        return PairSplit(problem, start)
    return DomeSplit(problem, start)


class _Best:
    """The best feasible planes so far, and the best lower bound of the minimum."""

    def __init__(self, split: Split, start: Light, negligible: float) -> None:
        self._split = split
        self._negligible = negligible
        # Costs and bounds are sums of rounded numbers: a bound is only as good as they are.
        self._rounding = 64 * float(np.finfo(split.dtype).eps)
        self._lower_bound = 0.0
        self._last_progress, self._idle = np.inf, 0
        self.planes = split.planes(start)
        self.cost = np.inf
        self.offer(self.planes)

    def offer(self, planes: Planes) -> None:
        """Keep `planes` if they are better, and what they tell of the minimum."""
        split = self._split
        cost, gradient = split.quadratic(planes)
        bound = split.gap(planes, gradient)
        self._lower_bound = max(self._lower_bound, cost * (1 - self._rounding) - bound)
        if cost < self.cost:
            self.cost, self.planes = cost, planes.copy()
        if self.gap < 0.9 * self._last_progress:
            self._last_progress, self._idle = self.gap, 0
        else:
            self._idle += 1

    @property
    def gap(self) -> float:
        """Certified (cost - minimum) / minimum; infinite as long as nothing is certified."""
        if self._lower_bound <= 0:
            return np.inf
        return (self.cost - self._lower_bound) / self._lower_bound

    def verdict(self, tolerance: float) -> Status | None:
        """Why to stop now, if there is a reason."""
        if self.gap <= tolerance:
            return Status.CONVERGED
        if self.cost - self._lower_bound <= self._negligible:
            return Status.INVISIBLE
        if self._idle >= _PATIENCE and np.isfinite(self.gap):
            return Status.STALLED
        return None


_PATIENCE = 12  # checks in which the certified gap does not fall by a tenth


def _nothing_to_do(problem: Problem, start: Light) -> bool:
    """Whether the start shows the desired light to rounding, and is what the regulariser wants."""
    if problem.penalty(start) > 0:
        return False
    weighting = problem.weighting
    if not isinstance(weighting, CsfWeighting):
        return False
    residual = problem.residual(start) * weighting.support[None, :, :, None]
    return float(np.abs(residual).max()) <= 8 * float(np.finfo(np.float32).eps)
