"""How near to the optimum a solver has come, after how much work.

A recorder stands for the problem that a solver minimises. The true gap of each light that it asks
about is computed on the float64 problem, outside of the solver's count of FFTs and of its time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast, final

import numpy as np

from compensate.problem import Problem
from domesim.light import Light


@final
@dataclass(frozen=True)
class Seen:
    """A feasible light that a solver had found.

    Attributes
    ----------
    ffts, iterations, seconds
        Work done by then: FFTs of planes (rounded up), the solver's iterations (SciPy's: what
        it asked for), time (s).
    gap
        Its true relative gap.
    """

    ffts: int
    iterations: int
    seconds: float
    gap: float


@final
@dataclass(frozen=True)
class Truth:
    """The problem in float64 and its least cost."""

    problem: Problem
    least: float

    def gap(self, light: Light) -> float:
        """True (cost - least) / least of a feasible light."""
        return self.problem.cost(np.asarray(light, np.float64)) / self.least - 1


class Enough(Exception):  # noqa: N818 (nothing went wrong)
    """The solver has come to the goal, or used up its budget."""


@final
class Recorder:
    """What a solver does on a problem.

    Parameters
    ----------
    problem
        What it minimises.
    truth
        By which gaps are known.
    goal
        True gap at which to stop the solver.
    budget
        FFTs of planes after which to stop it.

    Attributes
    ----------
    seen
        The lights that it has found.
    seconds
        Until the last light.
    iterations
        Iterations of the solver; counted up with each light unless it says.
    """

    def __init__(
        self,
        problem: Problem,
        truth: Truth,
        *,
        goal: float = 0.0,
        budget: float = math.inf,
    ) -> None:
        self.problem = problem
        self.seen: list[Seen] = []
        self.seconds = 0.0
        self.iterations: int | None = None
        self._truth, self._goal, self._budget = truth, goal, budget
        self.begin()

    def begin(self) -> None:
        """The solver begins now: count, and time, from here on."""
        self._first: float = self.problem.ffts
        self._begin = time.perf_counter()

    @property
    def ffts(self) -> float:
        """FFTs of planes done by the solver; of smaller planes, shares."""
        return self.problem.ffts - self._first

    @property
    def watched(self) -> Problem:
        """The problem, as one that notes each light whose cost is asked for."""
        return cast("Problem", _Watched(self.problem, self))

    def see(self, light: Callable[[], Light]) -> None:
        """Note a feasible light.

        Raises
        ------
        Enough
            If the solver is to stop.
        """
        ffts, self.seconds = self.ffts, time.perf_counter() - self._begin
        asked = self.problem.ffts
        gap = self._truth.gap(light())
        # Both problems may count together
        self._first += self.problem.ffts - asked
        iterations = len(self.seen) + 1 if self.iterations is None else self.iterations
        self.seen.append(Seen(math.ceil(ffts), iterations, self.seconds, gap))
        if gap <= self._goal:
            raise Enough
        self.pay()
        self._begin = time.perf_counter() - self.seconds

    def pay(self) -> None:
        """Stop the solver if it has used up its budget.

        Raises
        ------
        Enough
            If so.
        """
        if self.ffts >= self._budget:
            raise Enough


@final
class _Watched:
    """A problem, or a frozen copy of it, whose lights are noted as their costs are asked for."""

    def __init__(self, problem: Problem, recorder: Recorder) -> None:
        self._problem, self._recorder = problem, recorder

    def quadratic(self, light: Light) -> tuple[float, Light]:
        found = self._problem.quadratic(light)
        self._recorder.see(lambda: light)
        return found

    def curvature(self, direction: Light) -> tuple[float, Light]:
        self._recorder.pay()
        return self._problem.curvature(direction)

    def frozen(self, at: Light) -> Problem:
        return cast("Problem", _Watched(self._problem.frozen(at), self._recorder))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._problem, name)
