"""Solve only where it matters: rectangles, one after the other (section 5 of the paper).

Light outside of the rectangles stays as it starts, exact clipped subtraction. That is the problem
itself with more pixels pinned. Its solution costs a little more than the free one. Pinned pixels
need not be computed: each rectangle is solved as a problem of its own, with what is around it as
far as the eye's point spread reaches. Two things are left out, and both are small where subtraction
leaves little to be seen around: what is seen beyond that reach, and, in a dome, the little that a
rectangle's own light adds to all other places.

The weights of a window's frequencies are the whole picture's, between whose samples they lie.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeAlias, final

import numpy as np
import scipy
from numpy.typing import NDArray

from compensate.fourier import padded_size
from compensate.problem import Problem
from compensate.solver.admm import require_certifiable
from compensate.solver.kinds import Kind, kind_of
from compensate.solver.result import Result, Status
from compensate.weighting import CsfWeighting
from domesim.light import Light
from domesim.observation.base import AdjointObservation
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.lowrank import LowRank, LowRankObservation

_WORTH = 0.7  # of a picture

Box: TypeAlias = tuple[slice, slice]
"""Rows and columns."""


@final
@dataclass(frozen=True)
class Windows:
    """Solves a problem in rectangles only.

    If their windows take as long as more than `_WORTH` of the picture, all of it is solved instead.
    The whole picture's cost is not computed, for that would take longer than a small window.

    Parameters
    ----------
    boxes
        The rectangles.
    reach
        How far around each is looked, pixels.
    solver
        Solver of each rectangle.
    overhead
        Cost of a window that does not depend on its size, as the pixels that take as long. It is
        the least value tried that makes no picture slower than as a whole
        (``validation/notes/0009``).
    """

    boxes: tuple[Box, ...]
    reach: int
    solver: Callable[[Problem, Light], Result]
    overhead: int = 10_000

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Solve the problem from a NumPy `start`.

        Raises
        ------
        ValueError
            If the problem is not one of a dome or of linear crosstalk, or cannot be certified.
        """
        weighting = require_certifiable(problem)
        boxes = joined(self.boxes, self.reach, self.overhead)
        work = sum(_pixels(box, self.reach) + self.overhead for box in boxes)
        # What is reflected and leaks as well is always solved at once
        whole = kind_of(problem.observation) not in (Kind.LOW_RANK, Kind.PIXELWISE)
        if whole or work > _WORTH * start[0, ..., 0].size:
            return self.solver(problem, start)
        fourier = weighting.fourier
        light, before, iterations = start.copy(), fourier.count, 0
        for box in boxes:
            around = _around(box, self.reach, light.shape[1:3])
            part = _window(problem, weighting, light, box, around, self.reach)
            result = self.solver(part, light[:, around[0], around[1]])
            light[:, box[0], box[1]] = result.light[_within(box, around)]
            iterations = max(iterations, result.iterations)
        ffts = math.ceil(fourier.count - before)
        return Result(light, None, None, Status.WINDOWS, iterations, ffts)


def joined(boxes: Iterable[Box], reach: int, overhead: int) -> tuple[Box, ...]:
    """Joins rectangles to fewer, larger ones, where that is less to compute.

    Two are made one if their window is no larger than both of theirs and the `overhead` of one, or
    if they overlap.
    """
    kept: list[Box] = []
    waiting = list(boxes)
    while waiting:
        box = waiting.pop()
        for k, other in enumerate(kept):
            hull = _hull(box, other)
            apart = _pixels(box, reach) + _pixels(other, reach) + overhead
            if _overlap(box, other) or _pixels(hull, reach) <= apart:
                waiting.append(hull)
                del kept[k]
                break
        else:
            kept.append(box)
    return tuple(kept)


def _pixels(box: Box, reach: int) -> int:
    """Pixels of a window's padded plane."""
    rows, cols = (side.stop - side.start + 2 * reach for side in box)
    return int(rows * cols)


def _hull(a: Box, b: Box) -> Box:
    rows, cols = (
        slice(min(x.start, y.start), max(x.stop, y.stop)) for x, y in zip(a, b, strict=True)
    )
    return rows, cols


def _overlap(a: Box, b: Box) -> bool:
    return all(x.start < y.stop and y.start < x.stop for x, y in zip(a, b, strict=True))


def _around(box: Box, reach: int, size: tuple[int, ...]) -> Box:
    rows, cols = (
        slice(max(0, side.start - reach), min(count, side.stop + reach))
        for side, count in zip(box, size, strict=True)
    )
    return rows, cols


def _within(box: Box, around: Box) -> tuple[slice, slice, slice]:
    """A box's place in what is around it, for light."""
    rows, cols = (
        slice(side.start - outer.start, side.stop - outer.start)
        for side, outer in zip(box, around, strict=True)
    )
    return slice(None), rows, cols


def _window(
    problem: Problem, weighting: CsfWeighting, light: Light, box: Box, around: Box, reach: int
) -> Problem:
    """The problem of what is `around` a box, all but the box pinned to `light`."""
    place = (slice(None), *around)
    inner = _within(box, around)
    bounds = []
    for bound in (problem.lower, problem.upper):
        pinned = light[place].copy()
        pinned[inner] = np.broadcast_to(bound, light.shape)[place][inner]
        bounds.append(pinned)
    return Problem(
        _observation(problem.observation, light, around),
        _weighting(weighting, box, around, reach),
        problem.desired[place],
        (bounds[0], bounds[1]),
        anchor=None if problem.anchor is None else problem.anchor[place],
        regularisation=problem.regularisation,
        negligible=problem.negligible,
    )


def _observation(observation: Any, light: Light, around: Box) -> AdjointObservation:
    """What is seen of a window's light; a dome's other light pollutes it as it does now."""
    if isinstance(observation, Crosstalk):
        share = observation.share
        if share.shape[1:] != (1, 1):
            share = share[:, around[0], around[1]]
        rows, cols = (side.stop - side.start for side in around)
        flat = np.broadcast_to(share, (len(share), rows, cols))
        black = observation.black
        black = black[:, around[0], around[1]] if black.ndim > 2 else black
        return Crosstalk(rows, cols, observation.leaks, share=flat, black=black)
    if isinstance(observation, LowRankObservation):
        factors = observation.factors
        place = (slice(None), *around)
        others = light[0].astype(np.float64)
        others[around] = 0
        sums = np.einsum("lij,ijp->pl", factors.collect, others)
        spread = factors.spread[place]
        pollution = np.einsum("kij,pkl,pl->pij", spread, factors.core, sums)
        part = LowRank(
            factors.direct_gain[around],
            spread,
            factors.core,
            factors.collect[place],
            factors.ambient[place] + pollution,
        )
        return LowRankObservation(part, observation.screen[around])
    raise ValueError(f"Windows takes a dome or linear crosstalk, got {type(observation).__name__}")


def _weighting(weighting: CsfWeighting, box: Box, around: Box, reach: int) -> CsfWeighting:
    support = weighting.support[around]
    padded = _padded(box[0], around[0], reach), _padded(box[1], around[1], reach)
    rows = np.fft.fftfreq(padded[0]) * weighting.padded[0]
    cols = np.fft.rfftfreq(padded[1]) * weighting.padded[1]
    places = np.meshgrid(np.abs(rows), cols, indexing="ij")
    gains = np.stack([_sampled(gain, places) for gain in weighting.gains])
    part = CsfWeighting(
        gains,
        weighting.opponent,
        support,
        padded,
        weighting.peak,
        importance=weighting.importance,
    )
    return part.counted_apart(within=weighting.fourier)


def _padded(side: slice, outer: slice, reach: int) -> int:
    """Pixels of a padded side: no pixel of the box comes within reach of one across its ends.

    What is around the box is padding enough, but at an edge of the picture. (Opposite ends of that
    do come within reach. All of it is pinned, so that a pair's residual is constant there; a dome's
    is not quite, as the box pollutes it.)
    """
    margin = min(side.start - outer.start, outer.stop - side.stop)
    return padded_size(outer.stop - outer.start, reach - margin)


def _sampled(gain: NDArray[Any], places: Any) -> NDArray[np.floating[Any]]:
    """Interpolates the gain of one channel at (row, column) frequencies; it is even in both."""
    half = gain[: gain.shape[0] // 2 + 1]
    return np.asarray(scipy.ndimage.map_coordinates(half, places, order=1, mode="nearest"))
