"""Methods without vision models: nothing, exact clipped subtraction, a raised black level.

*Subtraction* asks for the light whose observation is the master, clipped to what can be projected.
Shown once, with the pollution of the unclipped picture, it subtracts too little light where the
picture was clipped; the exact solution subtracts the pollution of the picture that is *shown*:

    x = clip(D^-1 (wanted - ambient - phi(x)))

phi depends on x through a few sums s = core collect'x only, so this is a small equation
F(s) = s - core collect' x(s) = 0 with piecewise linear F, solved exactly by Newton's method on its
pieces (semismooth Newton) in a few O(n) steps. For one mode F rises with s: the root is unique.

*A raised black level* compresses the master to [b, 1], with the smallest b for which subtraction
needs no negative light: nothing is clipped, and contrast is lost everywhere. (Where an uneven lens
leaves a corner so dim that even white cannot outshine the pollution, that corner still clips.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from compensate.problem import Problem
from compensate.solver.result import Result, Status
from domesim.light import Light, dot, namespace
from domesim.light.strips import in_strips
from domesim.observation.lowrank import LowRank, LowRankObservation, expand

Floats = NDArray[np.float64]

_ROUNDING, _LEAST = 8, 1e-9  # of the last digit, and of white
_EVERY = 8  # row and column of which a first estimate is made


@final
@dataclass(frozen=True)
class Untouched:
    """Project the start as it is."""

    def __call__(self, problem: Problem, start: Light) -> Result:
        """The start, clipped to the bounds."""
        return computed(problem, problem.project(start), 0)


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


def clipped_subtraction(problem: Problem, max_iterations: int = 50) -> tuple[Light, int]:
    """Light that solves x = clip(D^-1 (wanted - ambient - phi(x))), and the Newton steps taken.

    If those are `max_iterations`, it has not been reached. The first estimate is of some pixels.
    """
    observation, desired = _low_rank(problem), problem.desired
    f, shape = observation.factors_like(desired), desired.shape
    lower, upper = (np.broadcast_to(each, shape) for each in (problem.lower, problem.upper))
    s = np.zeros((shape[-1], len(f.spread)))
    some = slice(None), slice(None, None, _EVERY), slice(None, None, _EVERY)
    _settle(f.every(_EVERY), desired[some], (lower[some], upper[some]), s, max_iterations)
    return _settle(f, desired, (lower, upper), s, max_iterations)


def _settle(
    f: LowRank, desired: Light, bounds: tuple[Light, Light], s: Floats, max_iterations: int
) -> tuple[Light, int]:
    """`clipped_subtraction` from an estimate of s, which becomes the solution."""
    (lower, upper), (primaries, ranks) = bounds, s.shape
    light = np.empty_like(desired)
    unsettled = list(range(primaries))

    def show(_: int, rows: slice) -> tuple[Floats, Floats]:
        """The light of s in some rows: its sums, (primary, rank), and their slopes by s."""
        sums, slopes = np.zeros((primaries, ranks)), np.zeros((primaries, ranks, ranks))
        gain, collect = f.direct_gain[rows], f.collect[:, rows]
        modes = f.spread[:, rows] / gain
        overlaps = [[each * mode for mode in modes] for each in collect]
        for p in unsettled:
            free = desired[0, rows, :, p] - f.ambient[p, rows]
            free /= gain
            free -= expand(modes, s[p].astype(free.dtype))
            low, high = lower[0, rows, :, p], upper[0, rows, :, p]
            shown = np.minimum(np.maximum(free, low), high)
            moving = (free > low) & (free < high)
            light[0, rows, :, p] = shown
            sums[p] = [dot(each, shown) for each in collect]
            slopes[p] = [[np.sum(moving * each) for each in line] for line in overlaps]
        return sums, slopes

    steps = 0
    while unsettled and steps < max_iterations:
        steps += 1
        sums, slopes = (sum(parts) for parts in zip(*in_strips(show, desired.shape), strict=True))
        changes = newton_step(f.core, sums, slopes, s)
        for p in tuple(unsettled):
            s[p] += changes[p]
            if np.abs(changes[p]).max() <= 1e-7 * max(np.abs(s[p]).max(), 1e-7):
                unsettled.remove(p)
    return light, steps


def newton_step(core: Floats, sums: Floats, slopes: Floats, excited: Floats) -> Floats:
    """(primary, rank) Newton's step to the floor that its own light excites.

    Parameters
    ----------
    core
        (primary, rank, rank): how the modes excite each other.
    sums
        (primary, rank): what the light excites that is left over the floor.
    slopes
        (primary, rank, rank): how that falls as the floor rises.
    excited
        (primary, rank): the floor.
    """
    system = np.eye(excited.shape[1]) + core @ slopes
    off = (core @ sums[..., None])[..., 0] - excited
    return np.asarray(np.linalg.solve(system, off[..., None])[..., 0])


def _low_rank(problem: Problem) -> LowRankObservation:
    if not isinstance(problem.observation, LowRankObservation):
        raise ValueError(
            f"this baseline takes a low-rank observation, got {type(problem.observation).__name__}"
        )
    return problem.observation


def rounding(light: Light) -> float:
    """Change of light, of white, that is no more than its rounding: rounds end there."""
    return max(_ROUNDING * float(namespace(light).finfo(light.dtype).eps), _LEAST)


def computed(
    problem: Problem, light: Light, iterations: int, status: Status = Status.CLOSED_FORM
) -> Result:
    """The result of a baseline: its light, with the cost that it happens to have."""
    before = problem.ffts
    cost, gradient = problem.quadratic(light)
    optimality = problem.kkt_residual(light, gradient)
    return Result(light, cost, optimality, status, iterations, problem.ffts - before)
