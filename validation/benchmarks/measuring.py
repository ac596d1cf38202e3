"""What a solver costs on a problem: FFTs of planes, and seconds as multiples.

Counts are the same on every machine. Seconds depend on it; as multiples of one forward and inverse
transform of one plane, timed right before and after, they nearly do not.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import final

import numpy as np
import scipy.fft

from compensate.solver.admm import ADMM
from validation.benchmarks.problems import PROBLEMS, Case, Task
from validation.benchmarks.recording import Enough, Recorder, Seen, Truth
from validation.benchmarks.solvers import OURS, SOLVERS, Solver
from validation.experiment import Missing

GAPS = (1e-2, 1e-3, 1e-4)
TOLERANCES = (1e-3, 1e-4)
"""At which the product's solver stops: default and ``--quality``."""
BUDGET = 600
"""FFTs for each plane of light after which a solver that is traced is stopped."""
LARGEST = 30_000_000
"""Values of a problem whose truth is looked for: more takes hours in float64."""
_WORKERS = 2
_SMALL = 128  # columns of a problem that is not timed


@final
@dataclass(frozen=True)
class Stop:
    """The product's solver as it really runs, with its certificates, to its own stop.

    Attributes
    ----------
    tolerance
        Certified relative gap that it was asked for.
    ffts, iterations, seconds
        Work done; seconds are the median of the runs.
    certified, gap
        Certified and true relative gap; None where they are not known.
    pairs
        Seconds in FFT pairs of one plane.
    """

    tolerance: float
    ffts: int
    iterations: int
    seconds: float
    certified: float | None
    gap: float | None
    pairs: float

    @property
    def excess(self) -> float | None:
        """Certified over true gap; None where one is unknown, or lost in rounding."""
        if self.certified is None or self.gap is None or self.gap <= 0:
            return None
        return self.certified / self.gap


@final
@dataclass(frozen=True)
class Cost:
    """What one solver needed on one problem.

    Attributes
    ----------
    problem, size
        In `PROBLEMS`, and its columns.
    solver
        Its title.
    failure
        Why it did not run; empty if it did.
    planes, pixels
        Planes of light, and values on the padded grid.
    clipped
        Share of pixels that subtraction clips.
    ffts
        FFTs of planes until the true gap fell below each of `GAPS`; None where it never did.
    seconds, pairs
        Time to a true gap of 1e-3, and in FFT pairs; None where it did not come there. Looking for
        gaps, which is not counted, takes the caches: it is up to a quarter longer than undisturbed.
    seen
        The lights on the way.
    stops
        Stops of the product's solver.
    """

    problem: str
    size: int
    solver: str
    failure: str = ""
    planes: int = 0
    pixels: int = 0
    clipped: float = 0.0
    ffts: tuple[int | None, ...] = (None,) * len(GAPS)
    seconds: float | None = None
    pairs: float | None = None
    seen: tuple[Seen, ...] = ()
    stops: tuple[Stop, ...] = ()

    def to(self, gap: float) -> Seen | None:
        """The first light with a true gap of at most `gap`."""
        return next((seen for seen in self.seen if seen.gap <= gap), None)


@final
@dataclass(frozen=True)
class Settings:
    """How much is measured.

    Parameters
    ----------
    goal
        True gap at which solvers are stopped.
    budget
        FFTs for each plane of light after which they are.
    repeats
        Timed runs, of which the median counts, after a first one.
    """

    goal: float = GAPS[-1]
    budget: float = BUDGET
    repeats: int = 3


def costs(
    problems: Sequence[str],
    sizes: Sequence[int],
    solvers: Sequence[str],
    settings: Settings,
) -> Iterator[Cost]:
    """Each solver's cost on each problem at each size, as they are measured; failures too.

    Parameters
    ----------
    problems, sizes, solvers
        Names in `PROBLEMS`, widths, names in `SOLVERS`.
    settings
        How much is measured.
    """
    for problem in problems:
        for size in sizes:
            try:
                case = PROBLEMS[problem][1](size)
                too_large = case.single.start.size > LARGEST
                least = None if too_large else least_cost(case)[0]
            except (Missing, ValueError, MemoryError) as error:
                for name in solvers:
                    yield Cost(problem, size, SOLVERS[name].title, f"not run: {error}")
                continue
            for name in solvers:
                yield _tried(case, name, least, settings)


def _tried(case: Case, name: str, least: float | None, settings: Settings) -> Cost:
    if least is None and name != OURS:
        why = "not run: too large for the truth in float64"
        return Cost(case.name, case.size, SOLVERS[name].title, why)
    try:
        return measure(case, name, least, settings)
    except Missing as error:
        why = f"not run: {error}"
    except ValueError as error:
        why = f"not for this problem: {error}"
    except (RuntimeError, MemoryError) as error:
        why = f"failed: {error}"
    return Cost(case.name, case.size, SOLVERS[name].title, why)


def least_cost(case: Case, tolerance: float = 1e-7) -> tuple[float, float | None]:
    """The least cost in float64, and to what relative gap it is certified."""
    task = case.double
    solver = ADMM(tolerance=tolerance, max_iterations=2000, stop_when_invisible=False)
    result = solver(task.problem, task.start)
    return task.problem.cost(result.light), result.gap


def measure(case: Case, name: str, least: float | None, settings: Settings) -> Cost:
    """What the solver of that name in `SOLVERS` needs.

    Parameters
    ----------
    case
        The problem.
    name
        Name of the solver.
    least
        The least cost; None to measure only how the product's solver runs.
    settings
        How much is measured.

    Raises
    ------
    ValueError
        If the solver does not take the problem.
    Missing
        If the solver is not installed.
    """
    solver = SOLVERS[name]
    task = case.double if solver.double else case.single
    truth = None if least is None else Truth(case.double.problem, least)
    if name == OURS and case.name in PROBLEMS:
        small = PROBLEMS[case.name][1](_SMALL).single
        _product(TOLERANCES[0])(small.problem, small.start)  # its loops may have to be compiled
    seen = () if least is None else traced(case, name, least, settings.goal, settings.budget)
    reached = next((one for one in seen if one.gap <= 1e-3), None)
    stops = (
        tuple(_stopped(case.single, t, truth, settings.repeats) for t in TOLERANCES)
        if name == OURS
        else ()
    )
    fourier = task.problem.weighting.fourier
    return Cost(
        problem=case.name,
        size=case.size,
        solver=solver.title,
        planes=task.planes,
        pixels=task.planes * fourier.rows * fourier.cols,
        clipped=case.single.clipped,
        ffts=tuple(next((s.ffts for s in seen if s.gap <= gap), None) for gap in GAPS),
        seconds=reached and reached.seconds,
        pairs=reached and reached.seconds / _pair_seconds(case.single),
        seen=seen,
        stops=stops,
    )


def traced(
    case: Case, name: str, least: float, goal: float, budget: float = BUDGET
) -> tuple[Seen, ...]:
    """The lights that a solver finds, the last one its answer or the one that it is stopped at.

    Parameters
    ----------
    case
        The problem.
    name
        Name of the solver, in `SOLVERS`.
    least
        The least cost.
    goal, budget
        As of `Settings`.
    """
    solver = SOLVERS[name]
    task = case.double if solver.double else case.single
    truth = Truth(case.double.problem, least)
    recorder = Recorder(task.problem, truth, goal=goal, budget=budget * task.planes)
    _run(solver, recorder, task)
    return tuple(recorder.seen)


def _run(solver: Solver, recorder: Recorder, task: Task) -> None:
    with suppress(Enough):
        answer = solver.run(recorder, task.start)
        if answer is not None:
            recorder.see(lambda: answer)


def _stopped(task: Task, tolerance: float, truth: Truth | None, repeats: int) -> Stop:
    solver = _product(tolerance)
    result = solver(task.problem, task.start)

    def run() -> float:
        begin = time.perf_counter()
        solver(task.problem, task.start)
        return time.perf_counter() - begin

    seconds, pairs = _timed(task, repeats, run)
    return Stop(
        tolerance,
        math.ceil(result.ffts),
        result.iterations,
        seconds,
        result.gap,
        None if truth is None else truth.gap(result.light),
        pairs,
    )


def _product(tolerance: float) -> ADMM:
    return ADMM(tolerance=tolerance, stop_when_invisible=False)


def _timed(task: Task, repeats: int, run: Callable[[], float]) -> tuple[float, float]:
    """Median of the times that `run` returns, in seconds and in FFT pairs of one plane.

    A machine that others use, too, is now faster and now slower: pairs are timed before and after
    each run.
    """
    found, around = [], [_pair_seconds(task)]
    for _ in range(repeats):
        seconds = run()
        around.append(_pair_seconds(task))
        found.append((seconds, seconds / ((around[-2] + around[-1]) / 2)))
    seconds, pairs = map(float, np.median(found, axis=0))
    return seconds, pairs


def _pair_seconds(task: Task) -> float:
    """Seconds of a forward and an inverse FFT of one plane, median."""
    fourier = task.problem.weighting.fourier
    plane, times = np.zeros((fourier.rows, fourier.cols), np.float32), []
    for _ in range(9):
        begin = time.perf_counter()
        spectrum = scipy.fft.rfft2(plane, workers=_WORKERS)
        scipy.fft.irfft2(spectrum, s=plane.shape, workers=_WORKERS)
        times.append(time.perf_counter() - begin)
    return float(np.median(times))
