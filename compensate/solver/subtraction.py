"""Exact clipped subtraction of any pollution: the way that fits what is observed.

For an observation that nobody knows (`Kind.OTHER`) it is a fixed point: with the light x that is
shown, and D what is seen in its own place,

    x = clip(x + D^-1 (wanted - psi(x)))

A round gains the pollution's share of light: a factor of a hundred in a cinema. Where it does not
settle, the pollution is as strong as the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from compensate.problem import Problem
from compensate.solver import baselines, deghosting, dome_pairs
from compensate.solver.kinds import Kind, kind_of
from compensate.solver.result import Result, Status
from domesim.light import Light, namespace
from domesim.observation.crosstalk import Crosstalk

MAX_ROUNDS = 400
"""Most rounds: pollution of 90 % takes 200."""


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
        """The fixed point; the start is not used."""
        light, rounds = subtracted(problem, self.max_rounds)
        status = Status.CLOSED_FORM if rounds < self.max_rounds else Status.EXHAUSTED
        return baselines.computed(problem, light, rounds, status)


def subtracted(
    problem: Problem, max_rounds: int = MAX_ROUNDS, start: Light | None = None
) -> tuple[Light, int]:
    """Light within the bounds that shows what is wanted where any can, and rounds taken.

    If those are `max_rounds`, it has not been reached. A `start` that is near saves some.
    """
    kind = kind_of(problem.observation)
    if kind is Kind.LOW_RANK:
        return baselines.clipped_subtraction(problem, max_rounds)
    if kind is Kind.REFLECTED_PAIR:
        return dome_pairs.clipped_subtraction(problem, max_rounds, start)
    if kind in (Kind.PIXELWISE, Kind.TABLE):
        return deghosting.clipped_subtraction(problem, max_rounds)
    return in_rounds(problem, max_rounds, start)


def shown_within(problem: Problem, start: Light | None = None) -> Light:
    """`subtracted` of a frame, which lies within 0..1: of plain crosstalk, strip by strip."""
    if isinstance(problem.observation, Crosstalk):
        return deghosting.subtracted_crosstalk(problem.observation, problem.desired)
    return subtracted(problem, deghosting.MAX_ROUNDS, start)[0]


def in_rounds(
    problem: Problem, max_rounds: int = MAX_ROUNDS, start: Light | None = None
) -> tuple[Light, int]:
    """`subtracted` by the fixed point of any observation.

    Raises
    ------
    ValueError
        If light is not seen where it is shown: D has a 0, or mixes views.
    """
    observation, wanted = problem.observation, problem.desired
    xp = namespace(wanted)
    if observation.shape != observation.seen_shape:
        raise ValueError(f"subtraction is of one seat, got {observation.seen_shape} seen")
    gain = observation.direct(xp.ones_like(wanted))
    if not float(xp.min(gain)) > 0:
        raise ValueError("subtraction takes a direct gain above 0 everywhere")
    light = problem.project(wanted / gain if start is None else start)
    tiny = baselines.rounding(wanted)
    for rounds in range(1, max_rounds + 1):
        new = problem.project(light + (wanted - observation.observe(light)) / gain)
        change = float(xp.max(xp.abs(new - light)))
        light = new
        if change <= tiny:
            return light, rounds
        if not np.isfinite(change):
            break
    return light, max_rounds
