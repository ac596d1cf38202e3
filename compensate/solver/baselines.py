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
from domesim.errors import InputError
from domesim.light import Array, Light, namespace
from domesim.observation.base import AdjointObservation, Observation


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
    """Raises the black level until subtraction needs no negative light.

    J. Konrad, B. Lacotte, E. Dubois, "Cancellation of image crosstalk in time-sequential displays
    of stereoscopic video", IEEE Trans. Image Processing 9, 897-908, 2000, do so for pairs.
    """

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Shows b + (1 - b) desired exactly, with the smallest b; the start is not used.

        Light above white that a matrix with negative entries may ask for is clipped, and what even
        white cannot outshine.

        Raises
        ------
        InputError
            If the observation is not affine.
        """
        observation, xp = problem.observation, namespace(problem.desired)
        if not isinstance(observation, AdjointObservation):
            raise InputError(
                f"a raised black takes an affine observation, got {type(observation).__name__}; "
                f"use its linearised()"
            )
        low, rounds = unclipped(observation, problem.desired)
        high, more = unclipped(observation, observation.direct(xp.ones_like(low)))
        # x(b) = (1 - b) low + b high must rise to the lower bound
        black = float(xp.max(share_of(problem.lower - low, high - low)))
        light = problem.project((1 - black) * low + black * high)
        return computed(problem, light, rounds + more)


def unclipped(observation: Observation, seen: Light) -> tuple[Light, int]:
    """Finds the light, of whatever sign, that shows `seen`.

    Parameters
    ----------
    observation
        What is seen of light, at one seat.
    seen
        (view, row, col, primary).

    Returns
    -------
    light, rounds
        As of `subtracted`.
    """
    infinity = namespace(seen).asarray(np.inf, dtype=seen.dtype, device=seen.device)
    return subtracted(observation, seen, (-infinity, infinity))


def share_of(short: Array, rise: Array) -> Array:
    """Divides what is lacking by what there is to make up for it.

    Parameters
    ----------
    short, rise
        Light, of one shape: what is lacking, and by how much it would rise.

    Returns
    -------
    share
        Of that shape: 0 where nothing is lacking, at most 1.
    """
    xp = namespace(short)
    some = short > 0
    enough = xp.where(some, xp.maximum(rise, short), xp.ones_like(short))
    return xp.where(some, short, xp.zeros_like(short)) / enough


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
