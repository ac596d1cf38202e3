"""Exact clipped subtraction in a 3D dome: of the reflected light, and of the other eye's.

With y = D x + S s, S the modes of reflected light and s = K V'x their strengths, what is seen is
C y (`domesim.observation.dome_pair`). Whatever s is, exact subtraction is that of crosstalk alone
(`deghosting`):

    x(s) = clip(D^-1 (wanted - C S s - (C - 1) D x))

So F(s) = s - K V' x(s) = 0 is left, a small equation as of a flat dome (`baselines`). Newton's
slopes take x to follow S s as if nothing leaked; what that leaves out is crosstalk times the
reflected light, so that each round gains a factor of some fifty.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, cast, final

import numpy as np
from numpy.typing import NDArray

from compensate.problem import Problem
from compensate.solver.baselines import computed
from compensate.solver.deghosting import subtracted_crosstalk
from compensate.solver.result import Result, Status
from domesim.light import Light, dot
from domesim.light.strips import in_strips
from domesim.observation.base import Observation
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.dome_pair import ReflectedViews
from domesim.observation.followed import Followed
from domesim.observation.lowrank import expand

Floats = NDArray[Any]

_SETTLED = 1e-7  # of the reflected light


class DomePair(NamedTuple):
    """The parts of a 3D dome's observation."""

    reflected: ReflectedViews
    crosstalk: Crosstalk


@final
@dataclass(frozen=True)
class PairSubtractive:
    """`clipped_subtraction` as a method.

    Parameters
    ----------
    max_rounds
        Newton rounds; four to six are usual.
    """

    max_rounds: int = 50

    def __call__(self, problem: Problem, start: Light) -> Result:
        """The fixed point; the start is not used.

        Raises
        ------
        ValueError
            If the observation is not a 3D dome's.
        """
        light, rounds = clipped_subtraction(problem, self.max_rounds)
        status = Status.CLOSED_FORM if rounds < self.max_rounds else Status.EXHAUSTED
        return computed(problem, light, rounds, status)


def parts_of(observation: Observation) -> DomePair | None:
    """Its parts if an observation is a 3D dome's, else None."""
    if not isinstance(observation, Followed):
        return None
    first, then = observation.first, observation.then
    uniform = isinstance(then, Crosstalk) and then.share.shape[1:] == (1, 1)
    if not (isinstance(first, ReflectedViews) and uniform):
        return None
    return DomePair(first, cast("Crosstalk", then))


def clipped_subtraction(problem: Problem, max_rounds: int = 50) -> tuple[Light, int]:
    """Light within 0..1 on the screen that shows what is wanted where any can, and rounds taken.

    If those are `max_rounds`, it has not been reached.

    Raises
    ------
    ValueError
        If the observation is not a 3D dome's.
    """
    found = parts_of(problem.observation)
    if found is None:
        raise ValueError(
            f"this takes a 3D dome's observation, got {type(problem.observation).__name__}"
        )
    reflected, crosstalk = found
    wanted = problem.desired
    spread, collect, core = reflected.modes()
    views, primaries, rank = core.shape[:3]
    core = core.reshape(views * primaries * rank, -1)
    gain = np.where(reflected.screen, reflected.direct_gain, 1).astype(wanted.dtype)
    modes, collect = (np.asarray(each, wanted.dtype) for each in (spread, collect))
    dark = problem.observation.observe(np.zeros_like(wanted))
    s = np.zeros((views, primaries, rank))
    light = wanted
    for rounds in range(1, max_rounds + 1):
        leaked = _seen(crosstalk, s)
        shown = np.empty_like(wanted)

        def show(view: int, rows: slice, leaked: Floats = leaked, shown: Light = shown) -> None:
            for p in range(primaries):
                part = wanted[view, rows, :, p] - dark[view, rows, :, p]
                part -= expand(modes[:, rows], leaked[view, p].astype(part.dtype))
                shown[view, rows, :, p] = part / gain[rows]

        in_strips(show, wanted.shape)
        light = subtracted_crosstalk(crosstalk, shown)
        sums, slopes = _collected(light, collect, modes / gain)
        system = np.eye(s.size) + core @ slopes
        change = np.linalg.solve(system, core @ sums.ravel() - s.ravel())
        s += change.reshape(s.shape)
        if np.abs(change).max() <= _SETTLED * max(np.abs(s).max(), _SETTLED):
            return light, rounds
    return light, max_rounds


def _seen(crosstalk: Crosstalk, s: Floats) -> Floats:
    """C of (view, primary, rank) strengths."""
    leaks = crosstalk.share[:, :, 0, None] * crosstalk.matrices
    return np.stack([s[v] + leaks[v] @ s[1 - v] for v in range(2)])


def _collected(light: Light, collect: Floats, modes: Floats) -> tuple[Floats, Floats]:
    """V'x, (view, primary, rank), and its slopes by s, a block matrix, at light x."""
    views, _, _, primaries = light.shape
    rank = len(modes)

    def work(view: int, rows: slice) -> tuple[int, Floats, Floats]:
        sums, slopes = np.empty((primaries, rank)), np.empty((primaries, rank, rank))
        overlaps = [[each * mode for mode in modes[:, rows]] for each in collect[:, rows]]
        for p in range(primaries):
            part = light[view, rows, :, p]
            moving = (part > 0) & (part < 1)
            sums[p] = [dot(each, part) for each in collect[:, rows]]
            slopes[p] = [[np.sum(moving * each) for each in line] for line in overlaps]
        return view, sums, slopes

    sums, slopes = np.zeros((views, primaries, rank)), np.zeros((views, primaries, rank, rank))
    for view, some, steep in in_strips(work, light.shape):
        sums[view] += some
        slopes[view] += steep
    count = views * primaries
    blocks = np.zeros((count, rank, count, rank))
    blocks[np.arange(count), :, np.arange(count)] = slopes.reshape(count, rank, rank)
    return sums, blocks.reshape(count * rank, -1)
