"""ADMM with an exact Fourier step, from coarse to fine: the product's solver.

With w = D (x - x_a) the problem splits into a quadratic f that Fourier diagonalises and bounds that
are separate for each pixel, with the regulariser, g (see `level`; `DomeSplit`, `PairSplit`). The
alternating direction method of multipliers (Boyd et al. 2011, *Foundations and Trends in Machine
Learning* 3, 1-122, scaled form, over-relaxed by alpha) is then a fixed-point iteration of s = z + u

    z  = clip((rho P s + M o) / (rho P + M))              the feasible iterate; u = s - z its dual
    w  = (H_0 + rho P)^-1 (b + rho P (z - u))             two FFTs a plane
    s <- s + alpha (w - z)

with a diagonal metric P over planes. Five things make it fast:

*Domes in opponent channels* (`OpponentLevel`), with a penalty for each. Planes of other problems
are of primaries, and P is about the root of diag(T'T).

*From coarse to fine.* The eye's weights are largest at low frequencies, so that most is won on
planes of a half or a quarter of the rows and columns, where an FFT costs a quarter or a sixteenth.
As s is relative to the clipped subtraction, it is enlarged without blurring the picture.

*A falling penalty* rho over primaries: 0.1 on coarse planes, half of the root of the median of
Omega² at first, a quarter of it then, and 0.01 at least; u is rescaled with it. Where most is seen
it is 0.1 throughout.

*Anderson acceleration* (`anderson`), begun anew when rho changes, and given up where nothing is won
any more: a run has stalled if the plain iteration wins nothing either.

*Few certificates*, of two FFTs a plane: the x-step's w has f's gradient rho P (z - u - w) without
any, and serves for the lower bound. One is due when the gap is likely to be small enough: it goes
with <w - z, rho P (w - z)>, which costs nothing to know.

Where the Hessian H is only near H_0 (a map of crosstalk, a spatial mask), the x-step is one step of
preconditioned iteration from z, which costs four FFTs a plane and gives the cost and gradient there

    w = z + (H_0 + rho P)^-1 (-f'(z) - rho P u)

See ``validation/notes/0006`` for what each bought.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

from compensate.fourier import Fourier
from compensate.problem import Problem
from compensate.solver.anderson import Anderson
from compensate.solver.blocks import Spectra
from compensate.solver.dome_split import DomeSplit
from compensate.solver.hessian import penalty_of
from compensate.solver.level import BoxLevel, Level, Planes, padded
from compensate.solver.pair_split import PairSplit
from compensate.solver.result import Result, Status
from compensate.solver.seen_split import SeenSplit
from compensate.solver.split import BoxSplit, Split
from compensate.solver.varying import Varying
from compensate.weighting import Masked
from domesim.light import Light, namespace
from domesim.memory import give_back_memory
from domesim.observation.stereo import StereoObservation
from domesim.strips import in_parts, is_large


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
        rho over primaries: on coarse planes, and at least on full ones. The more is seen, the
        larger it is, up to the first, and larger for the first `hold` iterations (`penalty_of`).
        (Over opponent channels it is 1, and P says the rest.) In a theatre with strong
        pollution all are raised, with ||C||^1.5: found by trial, and tested from a cap of 60
        degrees and albedo 0.3 to 170 degrees and 0.95.
    hold
        See there.
    coarse
        Iterations on the coarsest planes, and on each of those between. How coarse they are, is up
        to the weighting (`Split.prepare`).
    coarse_channels
        The same for a dome's opponent channels without a contrast, which need fewer where most
        frequencies are seen.
    memory
        Of the acceleration: how many old points it combines.
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
    coarse_channels: tuple[int, int] = (4, 2)
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
            If the problem is neither a dome's nor a stereo pair's under a `CsfWeighting` (`Masked`
            or not), has no regulariser or infinite bounds, or its pixels are not pinned where the
            weighting has no support.
        """
        fourier = problem.weighting.fourier
        before = fourier.count
        plain = problem
        if isinstance(problem.weighting, Masked):
            plain = problem.weighted_by(problem.weighting.inner)
        split = split_of(plain, by_primary=plain is not problem)
        if split.answered:
            return Result(split.base, 0.0, 0.0, Status.EXACT, 0, 0, 0.0)
        run = _Run(self, problem, split)
        status = run.solve(start)
        return run.result(status, math.ceil(fourier.count - before))


def split_of(problem: Problem, *, by_primary: bool = False) -> Split:
    """How a problem splits: by what is observed.

    A dome's may be split `by_primary`, where it could be by opponent channel.

    Raises
    ------
    ValueError
        If ADMM cannot solve it.
    """
    observation = problem.observation
    if not isinstance(observation, StereoObservation):
        return DomeSplit(problem, by_primary=by_primary)
    return PairSplit(problem) if problem.contrast is None else SeenSplit(problem)


@final
class _Run:
    """One run: s on one level after the other, and what is certified.

    Parameters
    ----------
    settings
        The solver.
    problem
        What to minimise.
    split
        It, or the plain problem near it.
    """

    def __init__(self, settings: ADMM, problem: Problem, split: Split) -> None:
        self._settings, self._problem, self._split = settings, problem, split
        masked = isinstance(problem.weighting, Masked)
        if masked and not isinstance(split, BoxSplit):
            raise ValueError("ADMM takes a pair's mask without a contrast; use Accelerated")
        # A coarse picture without the mask would be another's
        split.prepare(coarser=not masked and max(settings.coarse) > 0)
        self._level = split.levels[0]
        raised = max(1.0, self._level.hessian.strength**1.5 / 6)
        first, least = settings.penalties
        typical = split.typical
        then, last = (min(max(least, penalty_of(typical, share)), first) for share in _OF_ROOT)
        self._iterations = settings.coarse
        if self._level.hessian.adapted:
            first = then = last = 1.0
            several = problem.contrast is None and len(self._level.hessian.metric) > 1
            if several and typical > _HARDLY_SEEN:
                self._iterations = settings.coarse_channels
        self._penalties = [rho * raised for rho in (first, then, last)]
        self._varying: Varying | None = None
        if isinstance(split, BoxSplit) and (masked or not split.uniform):
            self._varying = Varying(problem, split, min(self._penalties))
        level = self._level
        self._base_cost = level.cost + level.regulariser_at_base()
        self._bounds = _Bounds(
            split.base,
            self._base_cost,
            problem.negligible if settings.stop_when_invisible else 0.0,
            settings.tolerance,
            _SHARE if self._varying is None else _SHARE_VARYING,
        )
        self._checked_at = 0
        self._plain = False
        self._found = split.base
        self._optimality = math.nan

    def solve(self, start: Light) -> Status | None:
        """Iterate until there is a reason to stop; None where there is none."""
        split, level, problem = self._split, self._level, self._problem
        if self._varying is None and self._base_cost <= self._bounds.negligible:
            self._bounds.cost = self._base_cost
            self._optimality = problem.optimality(split.base)
            return Status.INVISIBLE
        if start is problem.anchor or _same(start, split.base):
            # Without a name for it here, which would keep its planes
            return self._fine(self._from_coarse() or level.start())
        del split.levels[1:]
        return self._fine(level.start(split.planes(problem.project(start))))

    def result(self, status: Status | None, ffts: int) -> Result:
        """What was found; the base where that is better."""
        light = self._found
        cost, gap, optimality = self._bounds.cost, self._bounds.gap, self._optimality
        if self._varying is None and self._base_cost < cost:
            light, cost = self._split.base, self._base_cost
            gap, optimality = self._bounds.gap_of(cost), self._problem.optimality(light)
        return Result(
            light,
            cost,
            optimality,
            status or Status.EXHAUSTED,
            self._bounds.iterations,
            ffts,
            gap if math.isfinite(gap) else None,
        )

    def _from_coarse(self) -> Planes | None:
        """S on full planes, after iterations on coarser ones; None without any."""
        levels, s = self._split.levels, None
        while len(levels) > 1:
            s = self._finer(self._coarse(s), self._penalties[len(levels) == 2])
        return s

    def _coarse(self, s: Planes | None) -> Planes:
        """S after some iterations on the coarsest planes that are left."""
        level, (first, other) = self._split.levels[-1], self._iterations
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
        """S of the next finer level, where the penalty is rho; the coarse one is given up."""
        coarse = self._split.levels.pop()
        were = coarse.weights(self._penalties[0])
        light, dual = coarse.state(s, were)
        fine = self._split.levels[-1]
        fine.follow(coarse)
        del coarse
        s.clear()
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
            likely = self._bounds.likely(anderson.energy, iteration)
            due = iteration >= settings.first_check and (
                likely or iteration - self._checked_at >= settings.check_every
            )
            due |= iteration == settings.max_iterations
            if due:
                anderson.clear()  # a certificate needs as much memory
            if self._plain:
                anderson.give_up()
            if self._varying:
                w, status = self._varying_step(s, weights, iteration, due=due)
                if status:
                    return status
            else:
                w = self._exact_step(s, weights, due=due, guess=iteration == settings.first_check)
            s = self._moved(level, s, w, weights, anderson)
            del w  # a certificate needs as much memory
            if due and not self._varying:
                spectra, regulariser = self._feasible_spectra(s, weights)
                status = self._offered(spectra, regulariser, iteration)
                if status or iteration == settings.max_iterations:
                    anderson.clear()
                    self._settle_at(s, weights, spectra)
                    return status
                del spectra
            if settings.watch:
                settings.watch(iteration, lambda: self._split.light(level.answer(s, weights)))  # noqa: B023
        return None

    def _exact_step(self, s: Planes, weights: list[float], *, due: bool, guess: bool) -> Planes:
        """The x-step's w; where a certificate is due, the lower bound is known afterwards.

        With a `guess`, about what the minimum will be.
        """
        level, hessian = self._level, self._level.hessian
        spectra = _x_step(level, s, weights)
        along = hessian.dot(spectra, level.target) if due or guess else 0.0
        if guess:
            self._bounds.expect(level.cost - 0.5 * along)
        w = _inverse(hessian.fourier, spectra)
        if due:
            known, free = level.cost - 0.5 * along, []
            for part, rest in level.lower_bound(s, w, weights):
                known += part
                free.append(hessian.fourier.forward(rest))
                del rest  # as large as a plane
            sigma = level.least_damping
            hessian.solve(free, [sigma] * len(free))
            dual = hessian.energy(free) + sigma * hessian.dot(free, free)
            self._bounds.raise_to(known - 0.5 * dual)
        return w

    def _offered(self, spectra: Spectra, regulariser: float, iteration: int) -> Status | None:
        """Note a feasible iterate's cost; why to stop there, if there is a reason."""
        level, hessian = self._level, self._level.hessian
        cost = level.cost - hessian.dot(spectra, level.target) + 0.5 * hessian.energy(spectra)
        return self._checked(cost + regulariser, iteration)

    def _feasible_spectra(self, s: Planes, weights: list[float]) -> tuple[Spectra, float]:
        """Spectra of s's feasible planes, and their regulariser."""
        level, fourier = self._level, self._level.hessian.fourier
        planes = level.feasible(s, weights)
        regulariser = level.regulariser(planes)
        spectra = []
        while planes:
            spectra.append(fourier.forward(padded(planes.pop(0), fourier)))
        return spectra, regulariser

    def _settle_at(self, s: Planes, weights: list[float], spectra: Spectra) -> None:
        """Keep the feasible light of s, whose spectra these are, for an FFT a plane more.

        Both are used up, and the level's target.
        """
        level, hessian = self._level, self._level.hessian
        picture = level.answer(s, weights)
        s.clear()
        if self._problem.contrast is not None:
            spectra.clear()
            level.target.clear()
            self._found = self._split.light(picture)
            picture.clear()
            self._optimality = self._problem.optimality(self._found)
            return
        hessian.multiply(spectra)
        for p in range(len(spectra)):
            spectra[p] -= level.target.pop(0)
        rows, cols = picture[0].shape
        gradient = [plane[:rows, :cols] for plane in _inverse(hessian.fourier, spectra)]
        gradient = level.gradient_in_light(gradient)
        for p in range(len(gradient)):
            gradient[p] += level.slope(p, picture[p])
        self._settle(picture, gradient)

    def _varying_step(
        self, s: Planes, weights: list[float], iteration: int, *, due: bool
    ) -> tuple[Planes, Status | None]:
        """One preconditioned step from z, whose cost and gradient are known on the way."""
        level, varying = self._level, self._varying
        assert varying is not None
        picture = level.feasible(s, weights)
        cost, gradient, around = varying.quadratic(picture)
        if due:
            self._bounds.raise_to(cost - varying.gap(picture, gradient))
            status = self._checked(cost, iteration)
            self._settle(picture, gradient)
            if status:
                return s, status
        rows, cols = picture[0].shape
        fourier, spectra = level.hessian.fourier, []
        for p, weight in enumerate(weights):
            # -f'(z) - rho P (s - z)
            right = around.pop(0)
            right *= -1
            right -= s[p] * weight
            right[:rows, :cols] += picture[p] * weight
            right[:rows, :cols] += level.slope(p, picture[p]) - gradient[p]
            spectra.append(fourier.forward(right))
        varying.solve(spectra, weights)
        w = _inverse(fourier, spectra)
        for p, z in enumerate(picture):
            w[p][:rows, :cols] += z
        return w, None

    def _moved(
        self, level: Level, s: Planes, w: Planes, weights: list[float], anderson: Anderson
    ) -> Planes:
        """The next s; the old one and w are used up."""
        level.move(s, w, weights, self._settings.relaxation)
        return anderson.next(s, w)

    def _checked(self, cost: float, iteration: int) -> Status | None:
        """Note a feasible cost; why to stop, if there is a reason, or when to look again."""
        bounds, settings = self._bounds, self._settings
        status = bounds.verdict(cost, iteration)
        self._checked_at = iteration
        if status is Status.STALLED and not self._plain:
            # It may have been the acceleration, and not rounding.
            self._plain, status = True, None
            bounds.wait(iteration)
        if settings.progress:
            settings.progress(iteration, bounds.gap)
        return status

    def _settle(self, picture: Planes, gradient: Planes) -> None:
        """Keep what would be returned."""
        level, mu = self._level, self._problem.regularisation
        assert isinstance(level, BoxLevel)
        self._found = self._split.light(picture)
        self._optimality = level.kkt_residual(picture, gradient, mu)


def _same(light: Light, other: Light) -> bool:
    """Whether two lights are the same, pixel by pixel."""
    if light is other:
        return True
    xp = namespace(light, other)
    return all(
        in_parts(
            lambda view, rows: bool(xp.all(light[view, rows, ...] == other[view, rows, ...])),
            light.shape,
            light,
        )
    )


def _x_step(level: Level, s: Planes, weights: list[float]) -> Spectra:
    """W's spectra: (H_0 + rho P)^-1 (b + rho P (z - u))."""
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


@final
class _Bounds:
    """The last feasible cost, the best lower bound of the minimum, and what they tell."""

    def __init__(
        self, base: Light, start: float, negligible: float, tolerance: float, share: float
    ) -> None:
        self.negligible = negligible
        self._usual = share
        self._tolerance = tolerance
        # Costs and bounds are differences from the base's: a bound is only as good as those are.
        self._rounding = 16 * float(namespace(base).finfo(base.dtype).eps)
        self._lower = 0.0
        self._least, self._progress_at = math.inf, 0
        self._share, self._sign = share, 0.0
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
        """A new lower bound of the minimum."""
        self._lower = max(self._lower, bound - self._rounding * max(abs(bound), self._start))

    def expect(self, cost: float) -> None:
        """About what the minimum will be."""
        self._expected = min(max(cost, 0.01 * self._start), self._start)

    def verdict(self, cost: float, iteration: int) -> Status | None:
        """Why to stop at a feasible cost after `iteration` iterations, if there is a reason."""
        before, since = self.gap, iteration - self.iterations
        self.cost, self.iterations = cost, iteration
        gap = self.gap
        if gap < before < math.inf:
            wanted = max(self._tolerance, self.negligible / self._lower)
            left = since * math.log(gap / wanted) / math.log(before / gap)
            self._due = iteration + int(left / 2)  # at half of the way, as it may fall faster
        if math.isfinite(gap) and gap > 0 and self._sign > 0:
            # It tends to fall
            found, usual = self._sign / (cost * gap), self._usual
            self._share = 0.85 * min(max(found, usual / 4), 4 * usual)
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

        By a `sign` that goes with it, and by how fast it fell between the last two certificates.
        """
        self._sign = sign
        if iteration < self._due:
            return False
        cost = self.cost if math.isfinite(self.cost) else self._expected
        return sign <= self._share * max(self._tolerance * cost, self.negligible)


_OF_ROOT = 0.5, 0.25  # of the root of the median Omega²: rho's at first, and then
_HARDLY_SEEN = 0.02  # a median Omega²
# rho P ||alpha (w - z)||² in shares of the certified gap, as is usual; and where a certificate
# takes conjugate gradients: later, for it costs as much as five iterations
_SHARE, _SHARE_VARYING = 1.6, 0.15
_PATIENCE = 40  # iterations in which the certified gap does not fall by a tenth
