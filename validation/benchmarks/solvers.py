"""How much work each solver needs to come how near to the optimum.

A dome master with dark surroundings and bright patches, generated here, at several resolutions.
Work is counted in FFTs of planes (one real 2-D FFT or inverse of one plane) until the true relative
gap, against a long run of the product's solver, has fallen below a level. Seconds are given in
multiples of one forward and inverse transform of one plane of that size, timed in the same run:
the counts are the same on every machine, the multiples nearly.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import numpy as np
from scipy.optimize import minimize

from compensate.master import Posed, pose
from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.gpcg import GPCG
from compensate.solver.result import Status
from domesim.light import Light
from domesim.scene import load_dome
from validation.masters import night

GAPS = (1e-2, 1e-3, 1e-4)


@final
@dataclass(frozen=True)
class Seen:
    """A feasible light that a solver had found.

    Attributes
    ----------
    ffts, iterations, seconds
        Work done by then: FFTs of planes, the solver's iterations (SciPy's: evaluations), time (s).
    gap
        Its true relative gap.
    """

    ffts: int
    iterations: int
    seconds: float
    gap: float


@final
@dataclass(frozen=True)
class Cost:
    """What one solver needed on one problem.

    Parameters
    ----------
    size
        Rows of the domemaster.
    solver
        Its title.
    ffts
        FFTs of planes until the true gap fell below each of `GAPS`; None where it never did.
    final_gap
        True relative gap in the end.
    certified_gap
        What the solver certified in the end, if it does.
    transforms
        Time of the whole solution in multiples of one FFT pair of one plane.
    seen
        The lights on the way.
    """

    size: int
    solver: str
    ffts: tuple[int | None, ...]
    final_gap: float
    certified_gap: float | None
    transforms: float
    seen: tuple[Seen, ...]

    def to(self, gap: float) -> Seen | None:
        """The first light with a true gap of at most `gap`."""
        return next((seen for seen in self.seen if seen.gap <= gap), None)


def costs(sizes: tuple[int, ...], scene: str) -> Iterator[Cost]:
    """The costs of every solver at every size, as they are measured."""
    for size in sizes:
        case = Case(size, scene)
        least = case.least()
        for name in SOLVERS:
            yield case.cost(name, least)


@final
class Case:
    """A generated night in a theatre.

    Parameters
    ----------
    size
        Rows of the domemaster.
    scene
        The theatre's name.
    seed
        Of the night.
    """

    def __init__(self, size: int, scene: str, seed: int = 0) -> None:
        self.size, self._scene, self._seed = size, scene, seed

    @cached_property
    def single(self) -> Posed:
        """The problem in float32."""
        return pose(night(self.size, self._seed), load_dome(self._scene))

    @cached_property
    def double(self) -> Posed:
        """The problem in float64."""
        return pose(night(self.size, self._seed).astype(np.float64), load_dome(self._scene))

    def least(self, tolerance: float = 1e-7) -> float:
        """The least cost, certified to `tolerance`, in float64."""
        reference = ADMM(tolerance=tolerance, max_iterations=600, stop_when_invisible=False)
        return reference(self.double.problem, self.double.subtractive).cost

    def cost(self, name: str, least: float, *, goal: float = 0.0) -> Cost:
        """What the solver of that name in `SOLVERS` needs.

        Parameters
        ----------
        name
            Of the solver.
        least
            The least cost.
        goal
            True gap at which to stop; by default it goes on to its own end. (SciPy's always do.)
        """
        solver = SOLVERS[name]
        posed = self.double if solver.double else self.single
        trace = _Trace(posed.problem, least, goal)
        certified = solver.run(trace, posed.subtractive)
        reached = [next((s.ffts for s in trace.seen if s.gap <= gap), None) for gap in GAPS]
        last = trace.seen[-1]
        return Cost(
            self.size,
            solver.title,
            tuple(reached),
            last.gap,
            certified,
            last.seconds / _transform_pair(self.single.problem),
            tuple(trace.seen),
        )


@final
class _Trace:
    """Lights seen on the way to the optimum of `problem`."""

    def __init__(self, problem: Problem, least: float, goal: float) -> None:
        self.problem = problem
        self.seen: list[Seen] = []
        self._least, self._goal = least, goal

    def note(self, cost: float, ffts: int, iterations: int, seconds: float) -> None:
        """A feasible light with that cost has been found after so much work."""
        self.seen.append(Seen(ffts, iterations, seconds, cost / self._least - 1))

    @property
    def enough(self) -> bool:
        """Whether the last light is near enough to the optimum."""
        return self.seen[-1].gap <= self._goal


def _admm(trace: _Trace, start: Light) -> float | None:
    """Runs of so many iterations with one certificate at the end each."""
    certified = None
    for iterations in (4, 6, 8, 10, 12, 14, 16, 20, 24, 32):
        solver = ADMM(
            tolerance=1e-12,
            max_iterations=iterations,
            first_check=iterations,
            stop_when_invisible=False,
        )
        begin = time.perf_counter()
        result = solver(trace.problem, start)
        trace.note(result.cost, result.ffts, iterations, time.perf_counter() - begin)
        certified = result.gap
        if trace.enough:
            break
    return certified


def _gpcg(frozen: bool) -> Callable[[_Trace, Light], None]:
    """One iteration after the other: nothing is carried from one to the next.

    Each call also computes the gradient at its start and its end, which a run in one piece does
    once. (In one piece it would tell the cost with frozen pollution, not the true one.)
    """
    solver = GPCG(frozen=frozen, tolerance=1e-5, max_iterations=1)

    def run(trace: _Trace, start: Light) -> None:
        gradient = 2 * trace.problem.desired.shape[-1]
        light, cost, ffts, seconds = start, math.inf, gradient, 0.0
        for iteration in range(1, 41):
            begin = time.perf_counter()
            result = solver(trace.problem, light)
            passed = time.perf_counter() - begin
            own = result.ffts - 2 * gradient
            ffts += own
            seconds += passed * own / result.ffts
            trace.note(result.cost, ffts, iteration, seconds)
            settled = abs(result.cost - cost) <= 1e-7 * result.cost
            light, cost = result.light, result.cost
            if trace.enough or settled or result.status is not Status.EXHAUSTED:
                break

    return run


def _scipy(method: str, options: Mapping[str, float]) -> Callable[[_Trace, Light], None]:
    """A method of `scipy.optimize.minimize`, for the values that are not pinned."""

    def run(trace: _Trace, start: Light) -> None:
        problem = trace.problem
        lower, upper = (np.broadcast_to(b, start.shape) for b in (problem.lower, problem.upper))
        free = lower < upper
        light = start.astype(np.float64)
        before, begin, evaluations = problem.ffts, time.perf_counter(), 0

        def both(values: Any) -> tuple[float, Any]:
            nonlocal evaluations
            light[free] = values
            cost, gradient = problem.quadratic(light)
            evaluations += 1
            passed = time.perf_counter() - begin
            trace.note(cost, problem.ffts - before, evaluations, passed)
            return cost, gradient[free]

        found: Any = minimize(  # type: ignore[call-overload]
            both,
            light[free],
            jac=True,
            method=method,
            bounds=np.stack([lower[free], upper[free]], 1),
            options=dict(options),
        )
        # Its answer: the last evaluation may have been a trial
        trace.note(
            float(found.fun), problem.ffts - before, evaluations, time.perf_counter() - begin
        )

    return run


@final
@dataclass(frozen=True)
class Solver:
    """A solver under test.

    Attributes
    ----------
    title
        For people.
    run
        Notes the lights that it finds; returns the gap that it certifies, if it does.
    double
        Whether it needs float64: SciPy's line searches give up on float32's rounding.
    """

    title: str
    run: Callable[[_Trace, Light], float | None]
    double: bool = False


SOLVERS: Mapping[str, Solver] = {
    "admm": Solver("ADMM (the product's)", _admm),
    "gpcg": Solver("GPCG, exact pollution", _gpcg(frozen=False)),
    "frozen": Solver("GPCG, frozen pollution (the paper's)", _gpcg(frozen=True)),
    "lbfgsb": Solver(
        "L-BFGS-B (SciPy), float64",
        _scipy("L-BFGS-B", {"maxiter": 400, "maxfun": 800, "ftol": 1e-12, "gtol": 1e-12}),
        double=True,
    ),
    "tnc": Solver(
        "TNC (SciPy), float64",
        _scipy("TNC", {"maxfun": 300, "rescale": 0, "ftol": 1e-12, "gtol": 1e-12}),
        double=True,
    ),
}


def _transform_pair(problem: Problem) -> float:
    """Seconds of one forward and one inverse transform of one plane: the median of seven."""
    fourier = problem.weighting.fourier
    plane = np.zeros((1, fourier.rows, fourier.cols), np.float32)
    times = []
    for _ in range(7):
        begin = time.perf_counter()
        fourier.inverse(fourier.forward(plane))
        times.append(time.perf_counter() - begin)
    return float(np.median(times))
