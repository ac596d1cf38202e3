"""Methods without vision models: nothing, exact clipped subtraction, a raised black level.

*Subtraction* asks for the light whose observation is the master, clipped to what can be projected
(`compensate.subtract`).

*A raised black level* compresses the master to [b, 1], with the smallest b for which subtraction
needs no negative light: nothing is clipped, and contrast is lost everywhere. (Where an uneven lens
leaves a corner so dim that even white cannot outshine the pollution, that corner still clips.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from compensate.problem import Problem
from compensate.solver.result import Result, Status
from compensate.subtract import MAX_ROUNDS, subtracted
from domesim.light import Light


@final
@dataclass(frozen=True)
class Untouched:
    """Project the start as it is."""

    def __call__(self, problem: Problem, start: Light) -> Result:
        """The start, clipped to the bounds."""
        return computed(problem, problem.project(start), 0)


@final
@dataclass(frozen=True)
class Subtractive:
    """Clipped subtraction with the pollution of the clipped picture.

    Parameters
    ----------
    max_rounds
        Rounds, or Newton steps; three to twelve are usual.
    """

    max_rounds: int = MAX_ROUNDS

    def __call__(self, problem: Problem, start: Light) -> Result:
        """The light of `clipped_subtraction`; the start is not used."""
        light, rounds = clipped_subtraction(problem, self.max_rounds)
        status = Status.CLOSED_FORM if rounds < self.max_rounds else Status.EXHAUSTED
        return computed(problem, light, rounds, status)


@final
@dataclass(frozen=True)
class RaisedBlack:
    """Raise the black level until subtraction needs no negative light."""

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Light that shows b + (1 - b) desired exactly; the start's off the screen.

        Raises
        ------
        ValueError
            If the observation has no inverse.
        """
        observation = problem.observation
        screen = np.broadcast_to(problem.lower < problem.upper, start.shape)
        # Off the screen the start stays, and its light is part of what must be subtracted.
        stays = observation.direct(start)
        white = observation.direct(np.ones_like(start))
        try:
            low = observation.invert(np.where(screen, problem.desired, stays))
        except NotImplementedError as error:
            raise ValueError(f"a raised black takes an inverse: {error}") from None
        high = observation.invert(np.where(screen, white, stays))
        short = np.where(screen & (low < problem.lower), problem.lower - low, 0)
        # x(b) = (1 - b) low + b high is linear: each pixel needs b >= short / (high - low)
        rise = np.maximum(high - low, short)  # where even white falls short: b = 1
        needed = np.divide(short, rise, out=np.zeros_like(short), where=short > 0)
        black = float(needed.max())
        light = (1 - black) * low + black * high
        return computed(problem, problem.project(light.astype(start.dtype)), 1)


def clipped_subtraction(
    problem: Problem, max_rounds: int = MAX_ROUNDS, start: Light | None = None
) -> tuple[Light, int]:
    """Subtracts within a problem's bounds; see `compensate.subtract.subtracted`.

    Parameters
    ----------
    problem
        What is observed and desired.
    max_rounds, start
        As for `subtracted`.

    Returns
    -------
    light, rounds
        (view, row, col, primary), and the rounds taken.
    """
    bounds = problem.lower, problem.upper
    return subtracted(
        problem.observation, problem.desired, bounds, start=start, max_rounds=max_rounds
    )


def computed(
    problem: Problem, light: Light, iterations: int, status: Status = Status.CLOSED_FORM
) -> Result:
    """Makes the result of a baseline: its light, with the cost that it happens to have.

    Parameters
    ----------
    problem
        Whose cost it is.
    light
        (view, row, col, primary).
    iterations, status
        As of `Result`.

    Returns
    -------
    result
        With cost and KKT residual.
    """
    before = problem.ffts
    cost, gradient = problem.quadratic(light)
    optimality = problem.kkt_residual(light, gradient)
    return Result(light, cost, optimality, status, iterations, problem.ffts - before)
