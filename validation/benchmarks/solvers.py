"""How much work each solver needs to come how near to the optimum.

A dome master with dark surroundings and bright patches, generated here, at several resolutions.
Work is counted in FFTs of planes (one real 2-D FFT or inverse of one plane) until the true relative
gap, against a long run of the product's solver, has fallen below a level. Seconds are given in
multiples of one forward and inverse transform of one plane of that size, timed in the same run:
the counts are the same on every machine, the multiples nearly.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from scipy.optimize import minimize

from compensate.master import pose
from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.gpcg import GPCG
from domesim.light import Light
from domesim.scene import load_scene
from validation.masters import night

GAPS = (1e-2, 1e-3, 1e-4)


@final
@dataclass(frozen=True)
class Cost:
    """What one solver needed on one problem.

    Parameters
    ----------
    size
        Rows of the domemaster.
    solver
        Its name.
    ffts
        FFTs of planes until the true gap fell below each of `GAPS`; None where it never did.
    final_gap
        True relative gap in the end.
    certified_gap
        What the solver certified in the end, if it does.
    transforms
        Time of the whole solution in multiples of one FFT pair of one plane.
    """

    size: int
    solver: str
    ffts: tuple[int | None, ...]
    final_gap: float
    certified_gap: float | None
    transforms: float


def costs(sizes: tuple[int, ...], scene: str) -> Iterator[Cost]:
    """The costs of every solver at every size, as they are measured."""
    for size in sizes:
        theatre = load_scene(scene)
        exact = pose(night(size).astype(np.float64), theatre)
        reference = ADMM(tolerance=1e-7, max_iterations=600, stop_when_invisible=False)
        least = reference(exact.problem, exact.subtractive).cost
        posed = pose(night(size), theatre)
        problem = posed.problem
        pair = _transform_pair(problem)
        for name, solve in _SOLVERS.items():
            if name == _NEEDS_FLOAT64:
                posed = exact
            trace = _Trace(posed.problem)
            begin = time.perf_counter()
            cost, certified = solve(trace, posed.subtractive)
            seconds = time.perf_counter() - begin - trace.overhead
            yield Cost(
                size,
                name,
                tuple(trace.ffts_to(least * (1 + gap)) for gap in GAPS),
                cost / least - 1,
                certified,
                seconds / pair,
            )


class _Trace:
    """Costs seen on the way, with the FFTs that the solver had done by then."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._start = problem.ffts
        self._seen: list[tuple[int, float]] = []
        self.overhead = 0.0

    def note(self, cost: float, since: int | None = None) -> None:
        """A feasible light with that cost has been found (FFTs counted since the start)."""
        begin = self._start if since is None else since
        self._seen.append((self.problem.ffts - begin, cost))

    def ffts_to(self, cost: float) -> int | None:
        """FFTs until a cost of at most `cost` was seen."""
        return next((ffts for ffts, seen in self._seen if seen <= cost), None)


def _admm(trace: _Trace, start: Light) -> tuple[float, float | None]:
    """Runs of so many iterations with one certificate at the end each; the last one is timed."""
    lengths = (4, 6, 8, 10, 12, 14, 16, 20, 24, 32)
    for iterations in lengths:
        before, begin = trace.problem.ffts, time.perf_counter()
        solver = ADMM(
            tolerance=1e-12,
            max_iterations=iterations,
            first_check=iterations,
            stop_when_invisible=False,
        )
        result = solver(trace.problem, start)
        trace.note(result.cost, since=before)
        if iterations < lengths[-1]:
            trace.overhead += time.perf_counter() - begin
    return result.cost, result.gap


def _gpcg(frozen: bool) -> Callable[[_Trace, Light], tuple[float, float | None]]:
    def solve(trace: _Trace, start: Light) -> tuple[float, float | None]:
        solver = GPCG(
            frozen=frozen,
            tolerance=1e-5,
            max_iterations=40,
            progress=lambda _, cost: trace.note(cost),
        )
        result = solver(trace.problem, start)
        trace.note(result.cost)
        return result.cost, None

    return solve


def _lbfgsb(trace: _Trace, start: Light) -> tuple[float, float | None]:
    problem, shape = trace.problem, start.shape
    bounds = [
        np.broadcast_to(b, shape).ravel().astype(float) for b in (problem.lower, problem.upper)
    ]

    def both(values: Any) -> tuple[float, Any]:
        cost, gradient = problem.quadratic(values.reshape(shape))
        trace.note(cost)
        return cost, gradient.ravel()

    found: Any = minimize(  # type: ignore[call-overload]
        both,
        start.ravel().astype(float),
        jac=True,
        method="L-BFGS-B",
        bounds=np.stack(bounds, 1),
        options={"maxiter": 400, "ftol": 1e-12, "gtol": 1e-12},
    )
    return float(found.fun), None


_NEEDS_FLOAT64 = "L-BFGS-B (SciPy), float64"
"""Its line search gives up on float32's rounding."""

_SOLVERS: dict[str, Callable[[_Trace, Light], tuple[float, float | None]]] = {
    "ADMM (the product's)": _admm,
    "GPCG, exact pollution": _gpcg(frozen=False),
    "GPCG, frozen pollution (the paper's)": _gpcg(frozen=True),
    _NEEDS_FLOAT64: _lbfgsb,
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
