"""Exact clipped subtraction in a 3D dome: of the reflected light, and of the other eye's.

With s = K V'x, the strengths of the modes S of reflected light, what is seen is C (D x + S s)
(`domesim.observation.dome_pair`). Exact subtraction of both is

    x = clip(D^-1 (wanted - C S s) - M x_u)        x_u: the other view's light, M: crosstalk

in each view, with the light and the s that are shown. Rounds take both at once: of s by Newton's
slopes, which have x follow S s as if nothing leaked (as `baselines`), and of x_u as it was last.
What they leave out is crosstalk: each round gains its inverse, a factor of fifty for 2 %.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from compensate.problem import Problem
from compensate.solver.baselines import rounding
from compensate.solver.kinds import DomePair, parts_of
from domesim.light import Light, dot
from domesim.light.strips import in_strips
from domesim.observation.crosstalk import mixing_by
from domesim.observation.lowrank import expand

Floats = NDArray[Any]

_SETTLED = 1e-7  # of the reflected light
MAX_ROUNDS = 400
"""Most rounds: crosstalk of 90 %, the largest possible, takes 200."""


def clipped_subtraction(
    problem: Problem, max_rounds: int = MAX_ROUNDS, start: Light | None = None
) -> tuple[Light, int]:
    """Light within the bounds that shows what is wanted where any can, and rounds taken.

    If those are `max_rounds`, it has not been reached. A `start` that is near saves some.

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
    wanted = problem.desired
    k = _constants(found, wanted.dtype)
    tiny = rounding(wanted)
    lower, upper = (np.broadcast_to(each, wanted.shape) for each in (problem.lower, problem.upper))
    views, primaries, rank = 2, wanted.shape[3], len(k.modes)
    light = np.clip(wanted, lower, upper) if start is None else np.array(start)

    def collected(view: int, rows: slice) -> Floats:
        found = np.zeros((views, primaries, rank))
        for p, mode in np.ndindex(primaries, rank):
            found[view, p, mode] = dot(k.collect[mode, rows], light[view, rows, :, p])
        return found

    def show(_: int, rows: slice) -> tuple[float, Floats, Floats]:
        """The light of s in some rows: its largest change, its sums, and their slopes by s."""
        sums = np.empty((views, primaries, rank))
        slopes = np.empty((views, primaries, rank, rank))
        modes, collect = k.modes[:, rows], k.collect[:, rows]
        overlaps = [[each * mode for mode in modes] for each in collect]
        change = 0.0
        for v in range(views):
            leak = k.mixing[v](light[1 - v, rows])
            for p in range(primaries):
                part = wanted[v, rows, :, p] - (0 if k.dark is None else k.dark[v, rows, :, p])
                part /= k.gain[rows]
                part -= expand(modes, leaked[v, p].astype(part.dtype))
                part -= leak[..., p]
                low, high = lower[v, rows, :, p], upper[v, rows, :, p]
                shown = np.minimum(np.maximum(part, low), high)
                moving = (part > low) & (part < high)
                change = max(change, float(np.abs(shown - light[v, rows, :, p]).max()))
                light[v, rows, :, p] = shown
                sums[v, p] = [dot(each, shown) for each in collect]
                slopes[v, p] = [[np.sum(moving * each) for each in line] for line in overlaps]
        return change, sums, slopes

    s = k.core @ np.sum(in_strips(collected, wanted.shape), axis=0).ravel()
    s = s.reshape(views, primaries, rank)
    for rounds in range(1, max_rounds + 1):
        leaked = (k.leaks @ s.reshape(views * primaries, rank)).reshape(s.shape)
        # Both views of a strip at once
        changes, *parts = zip(*in_strips(show, (1, *wanted.shape[1:3], 2 * primaries)), strict=True)
        sums, slopes = (sum(part) for part in parts)
        system = np.eye(s.size) + k.core @ scipy.linalg.block_diag(*slopes.reshape(-1, rank, rank))
        change = np.linalg.solve(system, k.core @ sums.ravel() - s.ravel())
        s += change.reshape(s.shape)
        settled = np.abs(change).max() <= _SETTLED * max(np.abs(s).max(), _SETTLED)
        if settled and max(changes) <= tiny:
            return light, rounds
    return light, max_rounds


class _Constants(NamedTuple):
    """What all frames of a size share.

    Attributes
    ----------
    modes, collect
        (rank, row, col) S / D and V.
    core
        (view primary rank, view primary rank) K.
    leaks
        (view primary, view primary) C.
    gain
        (row, col) D; 1 off the screen.
    dark
        What is seen without a picture; None if nothing is.
    mixing
        Of each view: what it gets of the other's light.
    """

    modes: Floats
    collect: Floats
    core: Floats
    leaks: Floats
    gain: Floats
    dark: Light | None
    mixing: Sequence[Callable[[Floats], Floats]]


@lru_cache(maxsize=1)
def _constants(parts: DomePair, dtype: Any) -> _Constants:
    reflected, crosstalk = parts
    spread, collect, core = reflected.modes()
    size = core.shape[0] * core.shape[1]
    gain = np.where(reflected.screen, reflected.direct_gain, 1).astype(dtype)
    like = np.zeros(reflected.shape, dtype)
    dark = reflected.ambient(like)
    return _Constants(
        modes=np.asarray(spread / gain, dtype),
        collect=np.asarray(collect, dtype),
        core=core.reshape(size * core.shape[2], -1),
        leaks=crosstalk.central.reshape(size, size),
        gain=gain,
        dark=None if dark is None else crosstalk.linear(dark),
        mixing=[
            mixing_by(share * matrix, like)
            for share, matrix in zip(crosstalk.share, crosstalk.matrices, strict=True)
        ],
    )
