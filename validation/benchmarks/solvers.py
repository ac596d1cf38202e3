"""The solvers under test, each noting what it finds on a `Recorder`.

*Ours* is watched after each iteration, without certificates: these count where it is measured as it
really runs (`measuring.Stop`). The others find a light by asking for its cost, and it counts from
then on, whether their line searches take it or not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from scipy.optimize import minimize

from compensate.solver.accelerated import Accelerated
from compensate.solver.admm import ADMM
from compensate.solver.gpcg import GPCG
from domesim.light import Light
from validation.benchmarks.recording import Recorder

OURS = "admm"


@final
@dataclass(frozen=True)
class Solver:
    """A solver under test.

    Attributes
    ----------
    title
        For people.
    run
        Minimises from a start; returns its answer if that's not the last light seen.
    double
        Whether it needs float64: line searches of SciPy give up on float32's rounding.
    """

    title: str
    run: Callable[[Recorder, Light], Light | None]
    double: bool = False


def _ours(recorder: Recorder, start: Light) -> None:
    def watch(iteration: int, light: Callable[[], Light]) -> None:
        recorder.iterations = iteration
        recorder.see(light)

    longest = ADMM().max_iterations
    solver = ADMM(tolerance=1e-12, check_every=longest + 1, stop_when_invisible=False, watch=watch)
    solver(recorder.problem, start)


def _gpcg(frozen: bool) -> Callable[[Recorder, Light], Light]:
    def run(recorder: Recorder, start: Light) -> Light:
        recorder.iterations = 1

        def progress(iteration: int, cost: float) -> None:
            recorder.iterations = iteration + 1

        solver = GPCG(frozen=frozen, tolerance=1e-5, max_iterations=400, progress=progress)
        result = solver(recorder.watched, start)
        recorder.iterations = result.iterations
        return result.light

    return run


def _accelerated(recorder: Recorder, start: Light) -> Light:
    return Accelerated(tolerance=1e-6, max_iterations=4000)(recorder.watched, start).light


def _scipy(method: str, options: Mapping[str, float]) -> Callable[[Recorder, Light], Light]:
    """A method of `scipy.optimize.minimize`, for the values that are not pinned."""

    def run(recorder: Recorder, start: Light) -> Light:
        problem = recorder.problem
        lower, upper = (np.broadcast_to(b, start.shape) for b in (problem.lower, problem.upper))
        free = lower < upper

        def light(values: Any) -> Light:
            result = start.copy()
            result[free] = values
            return result

        def both(values: Any) -> tuple[float, Any]:
            cost, gradient = problem.quadratic(light(values))
            recorder.see(lambda: light(values))
            return cost, gradient[free]

        found: Any = minimize(  # type: ignore[call-overload]
            both,
            start[free],
            jac=True,
            method=method,
            bounds=np.stack([lower[free], upper[free]], 1),
            options=dict(options),
        )
        return light(found.x)

    return run


SOLVERS: Mapping[str, Solver] = {
    OURS: Solver("ADMM (the product's)", _ours),
    "gpcg": Solver("GPCG, exact pollution", _gpcg(frozen=False)),
    "frozen": Solver("GPCG, frozen pollution (the paper's)", _gpcg(frozen=True)),
    "accelerated": Solver("accelerated projected gradient", _accelerated),
    "lbfgsb": Solver(
        "L-BFGS-B (SciPy), float64",
        _scipy("L-BFGS-B", {"maxiter": 2000, "maxfun": 4000, "ftol": 1e-12, "gtol": 1e-12}),
        double=True,
    ),
}
