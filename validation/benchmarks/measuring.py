"""What a solver costs on a problem: FFTs of planes, seconds as multiples, memory.

Counts are the same on every machine. Seconds depend on it; as multiples of one forward and inverse
transform of one plane, and of one subtraction of the other view with a clip, both timed right
before and after, they nearly do not. Memory is what Python allocates during a solution of a problem
on which nothing has been computed yet, in planes of the picture in float32.
"""

from __future__ import annotations

import gc
import hashlib
import json
import math
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
import scipy.fft

from compensate.solver.admm import ADMM
from domesim.frames import write_whole
from validation.benchmarks.problems import CROSSTALK, POLLUTION, PROBLEMS, Case, Task
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
_MEMORY_BUDGET = 60  # FFTs for each plane, after which no solver allocates anything new


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
    pairs, passes
        Seconds in FFT pairs of one plane, and in passes of subtract-and-clip.
    """

    tolerance: float
    ffts: int
    iterations: int
    seconds: float
    certified: float | None
    gap: float | None
    pairs: float
    passes: float

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
    seconds, pairs, passes
        Time to a true gap of 1e-3 (median), and in multiples as of `Stop`; None where it did not
        come there.
    memory
        Peak memory, planes of the picture in float32; None where it was not measured.
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
    passes: float | None = None
    memory: float | None = None
    seen: tuple[Seen, ...] = ()
    stops: tuple[Stop, ...] = ()

    def to(self, gap: float) -> Seen | None:
        """The first light with a true gap of at most `gap`."""
        return next((seen for seen in self.seen if seen.gap <= gap), None)

    @property
    def final_gap(self) -> float:
        """True relative gap in the end."""
        return self.seen[-1].gap


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
    memory
        Whether peak memory is measured.
    """

    goal: float = GAPS[-1]
    budget: float = BUDGET
    repeats: int = 3
    memory: bool = True


def costs(
    problems: Sequence[str],
    sizes: Sequence[int],
    solvers: Sequence[str],
    settings: Settings,
    references: Path,
) -> Iterator[Cost]:
    """Each solver's cost on each problem at each size, as they are measured; failures too.

    Parameters
    ----------
    problems, sizes, solvers
        Names in `PROBLEMS`, widths, names in `SOLVERS`.
    settings
        How much is measured.
    references
        JSON file of least costs, read and added to.
    """
    for problem in problems:
        for size in sizes:
            try:
                case = PROBLEMS[problem][1](size)
                too_large = case.single.start.size > LARGEST
                least = None if too_large else _remembered(case, references)
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
    units = _Units(case.single, settings.repeats)
    truth = None if least is None else Truth(case.double.problem, least)
    if name == OURS and case.name in PROBLEMS:
        small = PROBLEMS[case.name][1](_SMALL).single
        _product(TOLERANCES[0])(small.problem, small.start)  # its loops may have to be compiled
    seen = () if least is None else traced(case, name, least, settings.goal, settings.budget)
    enough = next((k for k, one in enumerate(seen, 1) if one.gap <= 1e-3), None)
    found = None if enough is None else units.times(lambda: seconds_to(task, name, enough))
    stops = (
        tuple(_stopped(case.single, t, truth, units) for t in TOLERANCES) if name == OURS else ()
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
        seconds=found and found.seconds,
        pairs=found and found.pairs,
        passes=found and found.passes,
        memory=_memory(case, name) if settings.memory else None,
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


def seconds_to(task: Task, name: str, lights: int) -> float:
    """Time until the solver of that name has found so many lights, undisturbed.

    Looking for a light's gap takes the caches, and memory that was kept for the next arrays: an RGB
    dome that is traced takes a quarter longer.
    """
    recorder = Recorder(task.problem, None, most=lights)
    _run(SOLVERS[name], recorder, task)
    return recorder.seconds


def _run(solver: Solver, recorder: Recorder, task: Task) -> None:
    with suppress(Enough):
        answer = solver.run(recorder, task.start)
        if answer is not None:
            recorder.see(lambda: answer)


def _stopped(task: Task, tolerance: float, truth: Truth | None, units: _Units) -> Stop:
    solver = _product(tolerance)
    result = solver(task.problem, task.start)

    def run() -> float:
        begin = time.perf_counter()
        solver(task.problem, task.start)
        return time.perf_counter() - begin

    found = units.times(run)
    return Stop(
        tolerance,
        math.ceil(result.ffts),
        result.iterations,
        found.seconds,
        result.gap,
        None if truth is None else truth.gap(result.light),
        found.pairs,
        found.passes,
    )


def _product(tolerance: float) -> ADMM:
    return ADMM(tolerance=tolerance, stop_when_invisible=False)


def _memory(case: Case, name: str) -> float:
    """Peak of one solution."""
    solver = SOLVERS[name]
    task = case.posed(np.float64 if solver.double else np.float32)
    recorder = Recorder(task.problem, None, budget=_MEMORY_BUDGET * task.planes)
    gc.collect()
    tracemalloc.start()
    try:
        with suppress(Enough):
            if name == OURS:
                _product(TOLERANCES[0])(task.problem, task.start)
            else:
                solver.run(recorder, task.start)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    _, rows, cols, _ = task.start.shape
    return float(peak / (rows * cols * np.dtype(np.float32).itemsize))


class _Units:
    """Times of runs, and in multiples of what they are compared with; medians.

    Parameters
    ----------
    task
        Whose planes are transformed, and subtracted and clipped.
    repeats
        Runs.
    """

    def __init__(self, task: Task, repeats: int) -> None:
        fourier = task.problem.weighting.fourier
        plane = np.zeros((fourier.rows, fourier.cols), np.float32)
        light = task.start
        out = np.empty_like(light)

        def pair() -> None:
            spectrum = scipy.fft.rfft2(plane, workers=_WORKERS)
            scipy.fft.irfft2(spectrum, s=plane.shape, workers=_WORKERS)

        def clip() -> None:
            if len(light) == 2:
                np.multiply(light[::-1], np.float32(CROSSTALK), out=out)
                np.subtract(light, out, out=out)
            else:
                np.subtract(light, np.float32(POLLUTION) * light.mean(axis=(1, 2)), out=out)
            np.clip(out, 0, 1, out=out)

        self._units, self._repeats = (pair, clip), repeats

    def times(self, run: Callable[[], float]) -> _Times:
        """Median of the times that `run` returns; units are measured before and after each.

        A machine that others use, too, is now faster and now slower.
        """
        found, around = [], [self._measured()]
        for _ in range(self._repeats):
            seconds = run()
            around.append(self._measured())
            pair, clip = ((one + other) / 2 for one, other in zip(*around[-2:], strict=True))
            found.append((seconds, seconds / pair, seconds / clip))
        return _Times(*map(float, np.median(found, axis=0)))

    def _measured(self) -> list[float]:
        return [_median_seconds(unit) for unit in self._units]


@final
@dataclass(frozen=True)
class _Times:
    """Seconds, and the same in FFT pairs and in passes of subtract-and-clip."""

    seconds: float
    pairs: float
    passes: float


def _median_seconds(work: Callable[[], None]) -> float:
    times = []
    for _ in range(9):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return float(np.median(times))


def _remembered(case: Case, path: Path) -> float:
    """The least cost, from the file if this very problem is in it."""
    known: dict[str, tuple[float, float | None]] = {}
    if path.exists():
        known = json.loads(path.read_text())
    key = f"{case.name} {case.size} {_digest(case.double)}"
    if key not in known:
        known[key] = least_cost(case)
        write_whole(path, json.dumps(known, indent=1).encode())
    return known[key][0]


def _digest(task: Task) -> str:
    """Digest of all that the least cost depends on."""
    problem = task.problem
    found = hashlib.sha256(np.ascontiguousarray(problem.desired).tobytes())
    # What is seen of noise and how it is weighted stand for observation and weighting
    light = np.random.default_rng(0).random(task.start.shape)
    for number in (problem.regularisation, problem.cost(light), problem.cost(task.start)):
        found.update(f"{number:.9e}".encode())
    return found.hexdigest()[:16]
