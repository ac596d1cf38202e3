"""ADMM with an exact Fourier step.

With w, what is seen in its own place of the change from the clipped subtraction (`pixels`), the
problem splits into a quadratic f that Fourier diagonalises (`hessian`) and bounds that are separate
for each pixel, with the regulariser, g:

    f(w) = c - <b, w> + 1/2 <w, H w>          b = - gradient at the base, c its cost
    g(w) = 1/2 mu ||w||²                      where w = M d, lower <= d <= upper

The alternating direction method of multipliers (Boyd et al. 2011, *Foundations and Trends in
Machine Learning* 3, 1-122, scaled form, over-relaxed by alpha) is then a fixed-point iteration of
s = z + u

    z  = argmin_z 1/2 rho ||z - s||²_P + g(z)             the feasible iterate; u = s - z its dual
    w  = (H + rho P)^-1 (b + rho P (z - u))               two FFTs a plane
    s <- s + alpha (w - z)

with a diagonal metric P over planes, about the root of diag(T'T), sped up by Anderson's
acceleration (`anderson`), which is given up where nothing is won any more. rho is half of the root
of the median of Omega², within limits: the more is seen, the larger it is. Where a theatre
reflects much, it rises with ||C||^1.5: found by trial, and tested from a cap of 60 degrees and
albedo 0.3 to 170 degrees and 0.95.

A certificate (`certificate`) costs two FFTs a plane: the x-step's w has f's gradient
rho P (z - u - w) without any.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from compensate.problem import Problem
from compensate.solver.admm.anderson import Anderson
from compensate.solver.admm.certificate import Certificate, split
from compensate.solver.admm.hessian import Hessian, hessian_of
from compensate.solver.admm.pixels import Pixels, Planes, planes_of
from compensate.solver.result import Result, Status
from compensate.weighting import CsfWeighting
from domesim.light import Array, Light, namespace, total
from domesim.light.rounding import is_rounding


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
    stop_when_invisible
        Also stop when what could still be gained is less than the problem's `negligible`.
    check_every
        Iterations from one certificate to the next.
    progress
        Called after each certificate with (iteration, certified gap).
    watch
        Called after each iteration with its number and a function that gives the feasible light:
        for benchmarks.
    """

    tolerance: float = 1e-3
    max_iterations: int = 400
    stop_when_invisible: bool = True
    check_every: int = 5
    progress: Callable[[int, float], None] | None = None
    watch: Callable[[int, Callable[[], Light]], None] | None = None

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Minimise `problem` from `start` (view, row, col, primary).

        Raises
        ------
        ValueError
            If the problem is neither a dome's nor a stereo pair's under a `CsfWeighting`, has no
            regulariser, infinite bounds or an anchor beyond them, or its pixels are not pinned
            where the weighting has no support.
        """
        weighting = require_certifiable(problem)
        start, before = problem.begun(start, "ADMM"), weighting.fourier.count
        residual = problem.residual(problem.anchor)
        xp = namespace(residual)
        support = xp.asarray(weighting.support, device=residual.device)[None, :, :, None]
        residual = xp.where(support, residual, 0 * residual)
        if is_rounding(residual):
            return Result(problem.anchor, 0.0, 0.0, Status.EXACT, 0, 0, 0.0)
        run = _Run(self, problem, hessian_of(problem, weighting), residual, weighting.typical)
        light, cost, gap, status = run.solve(start)
        optimality = problem.optimality(light)
        ffts = math.ceil(weighting.fourier.count - before)
        return Result(light, cost, optimality, status, run.iterations, ffts, gap)


@final
class _Run:
    """One run of the solver.

    Parameters
    ----------
    settings
        The solver.
    problem, hessian
        The problem, and its Hessian.
    residual
        Of the base; 0 where it does not count.
    typical
        Median Omega².
    """

    def __init__(
        self, settings: ADMM, problem: Problem, hessian: Hessian, residual: Light, typical: float
    ) -> None:
        self._settings, self._problem, self._hessian = settings, problem, hessian
        self._pixels, self._fourier = Pixels(problem), hessian.fourier
        energy, gradient = hessian.seen(self._forward(planes_of(residual)))
        self._cost, self._target = 0.5 * energy, -gradient
        xp = namespace(residual)
        rho = min(max(_SHARE * math.sqrt(typical), _LEAST_PENALTY), _MOST_PENALTY)
        rho *= max(1.0, hessian.strength**1.5 / 6)
        self._weights = [rho * value for value in hessian.metric]
        negligible = problem.negligible if settings.stop_when_invisible else 0.0
        eps = float(xp.finfo(residual.dtype).eps)
        self._certificate = Certificate(self._cost, eps, settings.tolerance, negligible)
        self.iterations = 0

    def solve(self, start: Light) -> tuple[Light, float, float | None, Status]:
        """Returns light, cost, gap and status."""
        certificate, settings, problem = self._certificate, self._settings, self._problem
        if self._cost <= certificate.negligible:
            return self._best(problem.anchor, self._cost, Status.INVISIBLE)
        light = self._pixels.change(start)
        z = self._pixels.seen(light)
        s = self._padded(z)
        anderson = Anderson(_MEMORY)
        cost, status = self._cost, Status.EXHAUSTED
        for iteration in range(1, settings.max_iterations + 1):
            due = iteration % settings.check_every == 0 or iteration == settings.max_iterations
            w = self._step(s, z, light, due=due)
            r = _RELAXATION * (w - self._padded(z))
            s = anderson.next(s + r, r * self._column(np.sqrt(self._weights)))
            light = self._light(s, light)
            z = self._pixels.seen(light)
            if settings.watch:
                settings.watch(iteration, lambda: self._pixels.light(light))  # noqa: B023
            if not due:
                continue
            cost, self.iterations = self._cost_of(z), iteration
            verdict = certificate.verdict(cost, iteration)
            if settings.progress:
                settings.progress(iteration, certificate.gap(cost))
            if verdict is Status.STALLED and anderson.memory:
                # It may have been the acceleration, and not rounding
                anderson = Anderson(0)
                certificate.wait(iteration)
            elif verdict is not None:
                status = verdict
                break
        if self._cost < cost:
            return self._best(problem.anchor, self._cost, status)
        return self._best(self._pixels.light(light), cost, status)

    def _best(
        self, light: Light, cost: float, status: Status
    ) -> tuple[Light, float, float | None, Status]:
        gap = self._certificate.gap(cost)
        return light, cost, gap if math.isfinite(gap) else None, status

    def _light(self, s: Planes, before: Planes) -> Planes:
        """The d of s: the proximal map of g."""
        _, rows, cols = before.shape
        damped = [weight + self._problem.regularisation for weight in self._weights]
        shrunk = self._column(np.divide(self._weights, damped))
        return self._pixels.nearest(s[:, :rows, :cols] * shrunk, damped, before)

    def _step(self, s: Planes, z: Planes, light: Planes, *, due: bool) -> Planes:
        """The x-step's w; where a certificate is due, the lower bound is known afterwards."""
        weights = self._column(self._weights)
        towards = (2 * self._padded(z) - s) * weights
        spectra = self._hessian.solve(self._fourier.forward(towards) + self._target, self._weights)
        along = self._fourier.dot(spectra, self._target) if due else 0.0
        w = self._fourier.inverse(spectra, spent=True)
        if due:
            self._certificate.raise_to(self._bound(towards - w * weights, w, light, along))
        return w

    def _bound(self, gradient: Planes, w: Planes, light: Planes, along: float) -> float:
        """A lower bound of the minimum, by f's gradient at w; `along` is <b, w>."""
        mu = self._problem.regularisation
        bound = self._cost - 0.5 * along + 0.5 * float(total(w * (gradient + mu * w)))
        gradient = gradient + mu * w
        _, rows, cols = light.shape
        inside = slice(None), slice(rows), slice(cols)
        # The padding is pinned
        bound -= float(total(gradient * w)) - float(total(gradient[inside] * w[inside]))
        least, free = split(
            self._pixels, self._hessian.curvature, gradient[inside], w[inside], light
        )
        spectra = self._fourier.forward(self._padded(free))
        damping = [mu] * spectra.shape[0]
        solved = self._hessian.solve(spectra, damping)
        dual = self._hessian.energy(solved) + mu * self._fourier.dot(solved, solved)
        return bound + least - 0.5 * dual

    def _cost_of(self, z: Planes) -> float:
        """Cost of what is seen of a feasible light."""
        spectra = self._forward(z)
        quadratic = 0.5 * self._hessian.energy(spectra) - self._fourier.dot(spectra, self._target)
        return self._cost + quadratic + 0.5 * self._problem.regularisation * float(total(z * z))

    def _padded(self, planes: Planes) -> Planes:
        """Planes on the padded grid, 0 around."""
        count, rows, cols = planes.shape
        shape = (count, self._fourier.rows, self._fourier.cols)
        result = namespace(planes).zeros(shape, dtype=planes.dtype, device=planes.device)
        result[:, :rows, :cols] = planes
        return result

    def _forward(self, planes: Planes) -> Array:
        return self._fourier.forward(self._padded(planes))

    def _column(self, values: Any) -> Array:
        """(plane, 1, 1) numbers, as the planes are."""
        like = self._pixels.lower
        array = namespace(like).asarray(values, dtype=like.dtype, device=like.device)
        return array[:, None, None]


def require_certifiable(problem: Problem) -> CsfWeighting:
    """The problem's weighting.

    Raises
    ------
    ValueError
        If it is not one that Fourier diagonalises, the problem has no regulariser, its bounds are
        not finite, its anchor is not within them, or its pixels are not pinned where the weighting
        has no support.
    """
    weighting: Any = problem.weighting
    if not isinstance(weighting, CsfWeighting):
        raise ValueError(f"ADMM takes a CsfWeighting, got {type(weighting).__name__}")
    xp, anchor = namespace(problem.desired), problem.anchor
    if not bool(xp.all(xp.isfinite(problem.lower)) & xp.all(xp.isfinite(problem.upper))):
        raise ValueError("ADMM takes finite bounds")
    if not problem.regularisation > 0:
        raise ValueError("ADMM certifies regularised problems only, got regularisation 0")
    if not bool(xp.all((anchor >= problem.lower) & (anchor <= problem.upper))):
        raise ValueError("ADMM takes an anchor within the bounds")
    off = xp.asarray(~weighting.support, device=problem.desired.device)
    if bool(xp.any((problem.lower != problem.upper) & off[None, :, :, None])):
        raise ValueError("ADMM takes a problem whose pixels off the support are pinned")
    return weighting


_RELAXATION = 1.9  # alpha
_MEMORY = 5  # old points that the acceleration combines
_SHARE = 0.5
_LEAST_PENALTY, _MOST_PENALTY = 0.02, 0.1
