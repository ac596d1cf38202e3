"""ADMM with an exact Fourier step, from coarse to fine.

With w, what is seen of the change from the clipped subtraction (`level`), the problem splits into a
quadratic f that Fourier diagonalises and bounds that are separate for each pixel, with the
regulariser, g. The alternating direction method of multipliers (Boyd et al. 2011, *Foundations and
Trends in Machine Learning* 3, 1-122, scaled form, over-relaxed by alpha) is then a fixed-point
iteration of s = z + u

    z  = argmin_z 1/2 rho ||z - s||²_P + g(z)             the feasible iterate; u = s - z its dual
    w  = (H_0 + rho P)^-1 (b + rho P (z - u))             two FFTs a plane
    s <- s + alpha (w - z)

with a diagonal metric P over planes, about the root of diag(T'T). Four things make it fast:

*From coarse to fine* (`pyramid`). The eye's weights are largest at low frequencies, so that most is
won on planes of a half or a quarter of the rows and columns, where an FFT costs a quarter or a
sixteenth. As s is relative to the clipped subtraction, it is enlarged without blurring the picture.

*A falling penalty* rho: 0.1 on coarse planes, half of the root of the median of Omega² at first, a
quarter of it then, and 0.01 at least; u is rescaled with it. Where most is seen it is 0.1
throughout.

*Anderson acceleration* (`anderson`), begun anew when rho changes, and given up where nothing is won
any more: a run has stalled if the plain iteration wins nothing either.

*Few certificates* (`certificate`), of two FFTs a plane: the x-step's w has f's gradient
rho P (z - u - w) without any, and serves for the lower bound. One is due when the gap is likely to
be small enough: it goes with <w - z, rho P (w - z)>, which costs nothing to know.

See ``validation/notes/0006`` for what each bought.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from compensate.fourier import Fourier
from compensate.problem import Problem
from compensate.solver.admm.anderson import Anderson
from compensate.solver.admm.certificate import Certificate
from compensate.solver.admm.dome import split_dome, split_dome_pair
from compensate.solver.admm.hessian import Planes, Spectra, penalty_of
from compensate.solver.admm.level import Level
from compensate.solver.admm.pair import split_pair
from compensate.solver.admm.planes import Split, require_certifiable, residual_of
from compensate.solver.admm.pyramid import padded
from compensate.solver.kinds import Kind, kind_of, parts_of
from compensate.solver.result import Result, Status
from domesim.host.memory import give_back_memory
from domesim.light import Light, namespace
from domesim.light.strips import in_parts, is_large


@final
@dataclass(frozen=True)
class ADMM:
    """Settings of the solver; call it with a problem and a start.

    Parameters
    ----------
    tolerance
        Certified relative gap at which it stops.
    max_iterations
        Iterations, on full planes, after which it gives up.
    relaxation
        alpha.
    penalties
        rho on coarse planes, and at least on full ones. The more is seen, the larger it is, up to
        the first, and larger for the first `hold` iterations (`penalty_of`). In a theatre with
        strong pollution all are raised, with ||C||^1.5: found by trial, and tested from a cap of 60
        degrees and albedo 0.3 to 170 degrees and 0.95.
    hold
        Iterations with the first, larger penalty; see `penalties`.
    coarse
        Iterations on the coarsest planes, and on each of those between. The weighting decides how
        coarse they are (`Split.levels`).
    memory
        Number of old points that the acceleration combines.
    stop_when_invisible
        Also stop when what could still be gained is less than the problem's `negligible`.
    first_check, check_every
        When to compute the certificate: not earlier, and at most so many iterations after the last.
    progress
        Called after each check with (iteration, certified gap).
    watch
        Called after each iteration with its number and a function that gives the feasible light:
        for benchmarks.
    """

    tolerance: float = 1e-3
    max_iterations: int = 400
    relaxation: float = 1.9
    penalties: tuple[float, float] = (0.1, 0.01)
    hold: int = 5
    coarse: tuple[int, int] = (10, 5)
    memory: int = 2
    stop_when_invisible: bool = True
    first_check: int = 3
    check_every: int = 20
    progress: Callable[[int, float], None] | None = None
    watch: Callable[[int, Callable[[], Light]], None] | None = None

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Minimise `problem` from `start` (view, row, col, primary), a feasible light.

        Raises
        ------
        ValueError
            If the problem is neither a dome's nor a stereo pair's under a `CsfWeighting`, has no
            regulariser, infinite bounds or an anchor beyond them, or its pixels are not pinned
            where the weighting has no support.
        """
        weighting = require_certifiable(problem)
        fourier = weighting.fourier
        before = fourier.count
        residual = residual_of(problem, weighting)
        if _is_rounding(residual):
            return Result(problem.anchor, 0.0, 0.0, Status.EXACT, 0, 0, 0.0)
        observation = problem.observation
        kind = kind_of(observation)
        if kind is Kind.LOW_RANK:
            split = split_dome(problem, weighting)
        elif kind is Kind.PIXELWISE:
            split = split_pair(problem, weighting)
        elif (parts := parts_of(observation)) is not None:
            split = split_dome_pair(problem, weighting, parts)
        else:
            raise ValueError(f"ADMM takes domes of low rank and pairs, got {observation}")
        levels = split.levels(residual, coarser=max(self.coarse) > 0)
        del residual
        run = _Run(self, split, levels, weighting.typical)
        result = run.result(run.solve(start))
        del run, levels, split  # their planes: the optimality takes as many
        optimality = problem.optimality(result.light)
        return replace(result, optimality=optimality, ffts=math.ceil(fourier.count - before))


@final
class _Run:
    """One run: s on one level after the other, and what is certified.

    Parameters
    ----------
    settings
        The solver.
    split, levels
        The problem, and its levels from fine to coarse.
    typical
        Median Omega².
    """

    def __init__(self, settings: ADMM, split: Split, levels: list[Level], typical: float) -> None:
        self._settings, self._split, self._levels = settings, split, levels
        self._level = level = levels[0]
        first, least = settings.penalties
        then, last = (min(max(least, penalty_of(typical, share)), first) for share in _OF_ROOT)
        raised = max(1.0, level.hessian.strength**1.5 / 6)
        self._penalties = [rho * raised for rho in (first, then, last)]
        negligible = split.problem.negligible if settings.stop_when_invisible else 0.0
        self._certificate = Certificate(split.base, level.cost, negligible, settings.tolerance)
        self._checked_at = 0
        self._plain = False
        self._found = split.base

    def solve(self, start: Light) -> Status | None:
        """Iterate until there is a reason to stop; None where there is none."""
        split, level = self._split, self._level
        if level.cost <= self._certificate.negligible:
            self._certificate.cost = level.cost
            return Status.INVISIBLE
        if start is split.base or _same(start, split.base):
            # Without a name for it here, which would keep its planes
            return self._fine(self._from_coarse() or level.start())
        del self._levels[1:]
        return self._fine(level.start(split.planes(split.problem.project(start))))

    def result(self, status: Status | None) -> Result:
        """The best light, which may be the base; its optimality and FFTs are yet to be set."""
        certificate = self._certificate
        light, cost = self._found, certificate.cost
        if self._level.cost < cost:
            light, cost = self._split.base, self._level.cost
        gap = certificate.gap_of(cost)
        return Result(
            light,
            cost,
            math.nan,
            status or Status.EXHAUSTED,
            certificate.iterations,
            0,
            gap if math.isfinite(gap) else None,
        )

    def _from_coarse(self) -> Planes | None:
        """The iterate s on full planes, after coarser ones; None if there are none."""
        s = None
        while len(self._levels) > 1:
            s = self._finer(self._coarse(s), self._penalties[len(self._levels) == 2])
        return s

    def _coarse(self, s: Planes | None) -> Planes:
        """The iterate s after some iterations on the coarsest planes that are left."""
        level, (first, other) = self._levels[-1], self._settings.coarse
        weights = level.weights(self._penalties[0])
        anderson = Anderson(self._settings.memory, weights)
        iterations = first if s is None else other
        if s is None:
            s = level.start()
        for _ in range(iterations):
            w = _inverse(level.hessian.fourier, _x_step(level, s, weights))
            s = self._moved(level, s, w, weights, anderson)
        return s

    def _finer(self, s: Planes, rho: float) -> Planes:
        """The iterate s on the next finer level, for a penalty rho; the coarse level is dropped."""
        coarse = self._levels.pop()
        were = coarse.weights(self._penalties[0])
        light, dual = coarse.state(s, were)
        s.clear()
        fine = self._levels[-1]
        return fine.of_coarser(light, dual, were, fine.weights(rho))

    def _fine(self, s: Planes) -> Status | None:
        settings, level = self._settings, self._level
        rho = self._penalties[1]
        if is_large(s[0]):
            give_back_memory()  # of coarse planes
        weights = level.weights(rho)
        anderson = Anderson(settings.memory, weights)
        for iteration in range(1, settings.max_iterations + 1):
            if iteration == settings.hold + 1 and rho != self._penalties[2]:
                ratio, rho = rho / self._penalties[2], self._penalties[2]
                level.reweigh(s, weights, ratio)
                weights = level.weights(rho)
                anderson.reweigh(weights)
            due = self._due(anderson.energy, iteration)
            if due:
                anderson.clear()  # a certificate needs as much memory
            if self._plain:
                anderson.give_up()
            w = self._step(s, weights, due=due, guess=iteration == settings.first_check)
            s = self._moved(level, s, w, weights, anderson)
            del w  # a certificate needs as much memory
            if due:
                status = self._checked(self._cost(s, weights), iteration)
                if status or iteration == settings.max_iterations:
                    self._found = self._split.light(level.light(s, weights))
                    return status
            if settings.watch:
                settings.watch(iteration, lambda: self._split.light(level.light(s, weights)))  # noqa: B023
        return None

    def _due(self, energy: float, iteration: int) -> bool:
        """Whether to compute a certificate."""
        settings = self._settings
        likely = self._certificate.likely(energy, iteration)
        late = iteration - self._checked_at >= settings.check_every
        return iteration == settings.max_iterations or (
            iteration >= settings.first_check and (likely or late)
        )

    def _step(self, s: Planes, weights: list[float], *, due: bool, guess: bool) -> Planes:
        """The x-step's w; where a certificate is due, the lower bound is known afterwards.

        With `guess`, the certificate also learns about how large the minimum will be.
        """
        level, hessian = self._level, self._level.hessian
        spectra = _x_step(level, s, weights)
        along = hessian.dot(spectra, level.target) if due or guess else 0.0
        if guess:
            self._certificate.expect(level.cost - 0.5 * along)
        w = _inverse(hessian.fourier, spectra)
        if due:
            known, free = level.cost - 0.5 * along, []
            for part, rest in level.lower_bound(s, w, weights):
                known += part
                free.append(hessian.fourier.forward(rest))
                del rest  # as large as a plane
            sigma = level.damping
            hessian.solve(free, [sigma] * len(free))
            dual = hessian.energy(free) + sigma * hessian.dot(free, free)
            self._certificate.raise_to(known - 0.5 * dual)
        return w

    def _cost(self, s: Planes, weights: list[float]) -> float:
        """Cost of the feasible planes that belong to s."""
        level, hessian = self._level, self._level.hessian
        planes = level.feasible(s, weights)
        regulariser, spectra = level.regulariser(planes), []
        while planes:
            spectra.append(hessian.fourier.forward(padded(planes.pop(0), hessian.fourier)))
        quadratic = 0.5 * hessian.energy(spectra) - hessian.dot(spectra, level.target)
        return level.cost + quadratic + regulariser

    def _moved(
        self, level: Level, s: Planes, w: Planes, weights: list[float], anderson: Anderson
    ) -> Planes:
        """The next s; the old one and w are used up."""
        level.move(s, w, weights, self._settings.relaxation)
        return anderson.next(s, w)

    def _checked(self, cost: float, iteration: int) -> Status | None:
        """Notes a feasible cost, and when; returns the status to stop with, or None to go on."""
        certificate, settings = self._certificate, self._settings
        status = certificate.verdict(cost, iteration)
        self._checked_at = iteration
        if status is Status.STALLED and not self._plain:
            # It may have been the acceleration, and not rounding.
            self._plain, status = True, None
            certificate.wait(iteration)
        if settings.progress:
            settings.progress(iteration, certificate.gap)
        return status


def _is_rounding(residual: Light) -> bool:
    """Whether the base shows what is desired, to rounding."""
    limit = 8 * float(np.finfo(np.float32).eps)
    xp = namespace(residual)

    def work(view: int, rows: slice) -> bool:
        return bool(xp.all(xp.abs(residual[view, rows, ...]) <= limit))

    return all(in_parts(work, residual.shape, residual))


def _same(light: Light, other: Light) -> bool:
    """Whether two lights are the same, pixel by pixel."""
    xp = namespace(light, other)
    return all(
        in_parts(
            lambda view, rows: bool(xp.all(light[view, rows, ...] == other[view, rows, ...])),
            light.shape,
            light,
        )
    )


def _x_step(level: Level, s: Planes, weights: list[float]) -> Spectra:
    """Spectra of w = (H_0 + rho P)^-1 (b + rho P (z - u))."""
    fourier = level.hessian.fourier
    spectra = [fourier.forward(plane) for plane in level.towards(s, weights)]
    level.hessian.solve(spectra, weights, level.target)
    return spectra


def _inverse(fourier: Fourier, spectra: Spectra) -> Planes:
    """Planes of spectra, which are used up one by one."""
    planes = []
    while spectra:
        planes.append(fourier.inverse(spectra.pop(0), spent=True))
    return planes


_OF_ROOT = 0.5, 0.25  # of the root of the median Omega²: rho's at first, and then
