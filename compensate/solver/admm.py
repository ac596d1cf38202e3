"""ADMM with an exact Fourier step: the product's solver.

With w = D x the problem splits into a quadratic that Fourier diagonalises and bounds that are
separate for each pixel:

    min f(w) + g(z)   s.t. w = z
    f(w) = 1/2 ||A (C w - t)||²            (`PlaneModel`)
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
from typing import Any, final

import numpy as np

from compensate.problem import Problem
from compensate.solver.certificate import gap_bound
from compensate.solver.fourier_step import NormalInverse, PlaneModel
from compensate.solver.result import Result, Status
from compensate.weighting import CsfWeighting
from domesim.light import Light, dot
from domesim.observation.lowrank import LowRankObservation

Planes = Any


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
            If the problem is not one dome view under a `CsfWeighting`, has no regulariser, or its
            pixels are not pinned where the weighting has no support.
        """
        if not isinstance(start, np.ndarray):
            raise ValueError(f"ADMM takes NumPy light, got {type(start).__name__}")
        before = problem.ffts
        start = problem.project(start)
        if _nothing_to_do(problem, start):
            return Result(start, 0.0, 0.0, Status.EXACT, 0, 0, 0.0)
        split = _Split(problem, start)
        best = _Best(split, start, problem.negligible if self.stop_when_invisible else 0.0)
        state = split.planes(start)
        dual = np.zeros_like(state)
        floor = self.penalty_floor * split.model.strength**1.5
        rho = max(self.penalty, 2 * floor)
        inverse = NormalInverse(split.model, rho * split.metric)
        iteration, status = 0, best.verdict(self.tolerance)
        while status is None and iteration < self.max_iterations:
            iteration += 1
            state, dual = self._step(split, inverse, rho, state, dual)
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
                inverse = NormalInverse(split.model, rho * split.metric)
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

    def _step(
        self, split: _Split, inverse: NormalInverse, rho: float, z: Planes, y: Planes
    ) -> tuple[Planes, Planes]:
        weight = (rho * split.metric).astype(split.model.dtype)[:, None, None]
        right = split.model.fourier.forward(weight * (z - y))
        right += split.target
        w = split.model.fourier.inverse(inverse(right))
        w *= self.relaxation
        w += (1 - self.relaxation) * z
        w += y
        z = split.nearest(w, weight)
        return z, w - z


class _Split:
    """The problem in w = D x, on padded planes (primary, row, col)."""

    def __init__(self, problem: Problem, start: Light) -> None:
        observation, weighting = problem.observation, problem.weighting
        if not isinstance(observation, LowRankObservation):
            raise ValueError(f"ADMM takes a low-rank observation, got {type(observation).__name__}")
        if not isinstance(weighting, CsfWeighting):
            raise ValueError(f"ADMM takes a CsfWeighting, got {type(weighting).__name__}")
        if not problem.regularisation > 0:
            raise ValueError("ADMM certifies regularised problems only, got regularisation 0")
        off = ~weighting.support[None, :, :, None]
        pinned = np.broadcast_to(problem.lower == problem.upper, start.shape)
        if bool(np.any(off & ~pinned)):
            raise ValueError("ADMM takes a problem whose pixels off the support are pinned")
        self.model = PlaneModel(observation, weighting, problem.desired.dtype)
        self._gain = observation.factors.direct_gain.astype(self.model.dtype)
        self._off_light = np.where(off, start, 0)
        self.mu = problem.regularisation
        model = self.model
        self.gain = model.padded(
            np.broadcast_to(self._gain[None, :, :, None], (1, *self._gain.shape, model.primaries))
        )
        self.gain[self.gain == 0] = 1
        self.lower = self.planes(np.broadcast_to(problem.lower, start.shape))
        self.upper = self.planes(np.broadcast_to(problem.upper, start.shape))
        # What is seen of the pinned light off the support, and of ambient light, is given.
        given = observation.observe(self._off_light)
        target = model.fourier.forward(model.padded(problem.desired - given))
        self.constant = target
        self.target = model.polluted_adjoint(model.normal(target))
        self.anchor = self.planes(problem.anchor)
        diagonal = np.sqrt(np.sum(weighting.opponent**2, axis=0))
        self.metric = diagonal / diagonal.max()
        sigma = self.mu / float(self.gain.max()) ** 2
        self.certifying = NormalInverse(model, np.full(model.primaries, sigma))

    def planes(self, light: Light) -> Planes:
        """The planes w = D x of `light`."""
        return self.model.padded(light * self._gain[None, :, :, None])

    def light(self, planes: Planes) -> Light:
        """The light x = w / D on the support, the start's elsewhere."""
        rows, cols = self.model.support.shape
        inner = np.moveaxis(planes[:, :rows, :cols], 0, -1)[None] / self._gain[None, :, :, None]
        support = self.model.support[None, :, :, None]
        return np.where(support, inner, self._off_light).astype(self._off_light.dtype)

    def nearest(self, planes: Planes, weight: Planes) -> Planes:
        """The z-step: the regulariser's and the bounds' proximal map."""
        mu = self.mu / self.gain**2
        z = (weight * planes + mu * self.anchor) / (weight + mu)
        return np.clip(z, self.lower, self.upper)

    def quadratic(self, planes: Planes) -> tuple[float, Planes]:
        """Cost and gradient in w, with two FFTs a primary."""
        model = self.model
        residual = model.polluted(model.fourier.forward(planes)) - self.constant
        weighted = model.normal(residual)
        energy = sum(model.fourier.dot(r, s) for r, s in zip(residual, weighted, strict=True))
        change = (planes - self.anchor) / self.gain
        gradient = model.fourier.inverse(model.polluted_adjoint(weighted))
        gradient += self.mu * change / self.gain
        return 0.5 * (energy + self.mu * dot(change, change)), gradient


class _Best:
    """The best feasible planes so far, and the best lower bound of the minimum."""

    def __init__(self, split: _Split, start: Light, negligible: float) -> None:
        self._split = split
        self._negligible = negligible
        # Costs and bounds are sums of rounded numbers: a bound is only as good as they are.
        self._rounding = 64 * float(np.finfo(split.model.dtype).eps)
        self._lower_bound = 0.0
        self._last_progress, self._idle = np.inf, 0
        self.planes = split.planes(start)
        self.cost = np.inf
        self.offer(self.planes)

    def offer(self, planes: Planes) -> None:
        """Keep `planes` if they are better, and what they tell of the minimum."""
        split = self._split
        cost, gradient = split.quadratic(planes)
        bound = gap_bound(
            split.model, split.certifying, planes, gradient, (split.lower, split.upper)
        )
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
