"""Live pictures of a dome, by compiled loops: the aim of `compensate.aim` in a few passes.

The master is decoded anew in every pass, which is cheaper than to fetch its light from memory. What
the whole screen adds up to is a few numbers: the light in each mode of reflection of what
subtraction shows of the master, and of the aim. Each is the root of a piecewise linear equation
(`compensate.subtract`), found by Newton's method from where the last frame had it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.aim.dome import DARKEST, EDGE
from compensate.blocks import falling, near_sum
from compensate.live import dome_loops as loops
from compensate.live.coding import Coding, PixelFormat, room_for
from compensate.live.constants import SETTLED, STEPS, DomeConstants
from compensate.live.noise import shifts_of
from compensate.live.tile_loops import code_of, places_along, widened
from compensate.subtract import newton_step
from domesim.light.blocks import block_sums

_TANGENTS, _EXACT = 24, 1e-6
"""How often the darkest share is looked for, and to which part of what is missing most."""


@final
class CompiledDome:
    """Compensates frames of a dome.

    Parameters
    ----------
    constants
        Of the scene.
    coding
        What code values mean.
    pixels
        Layout of frames.
    dithers
        Whether codes are rounded with noise.
    """

    def __init__(
        self, constants: DomeConstants, coding: Coding, pixels: PixelFormat, *, dithers: bool
    ) -> None:
        k = self._k = constants
        rows, cols = k.screen.shape
        self._pixels = pixels
        self._code = code_of(coding, pixels, cols, k.kept, dithers=dithers)
        on = k.screen.astype(np.float32)
        self._counted = block_sums(on, k.block)
        self._around = near_sum(self._counted, k.radius)
        self._near = np.array(falling(k.radius), np.float32)
        shape = self._counted.shape
        self._dome = loops.Dome(
            cols=np.uint64(cols),
            spans=_spans(k.screen),
            cell=np.uint64(k.cell),
            block=np.uint64(k.block),
            weights=k.weights.astype(np.float32),
            dark=np.float32(k.dark),
        )
        self._cells = places_along(cols, k.cell, k.gain.shape[1])
        self._blocks = places_along(cols, k.block, shape[1])
        self._blocks_cells = places_along(shape[1], k.cell // k.block, k.gain.shape[1])
        self._heap = np.zeros((4, *shape), np.float32)
        self._work = np.zeros((5, *shape), np.float32)
        self._coarse = np.empty((2, *shape), np.float32)
        self._base = np.empty((2, shape[0], cols), np.float32)
        self._lifts = np.empty((rows, cols), np.float32)
        self._sums = np.zeros((6, *k.gain.shape), np.float32)
        self._room = room_for(rows, cols, pixels)
        ranks = range(len(k.spread))
        self._collect = k.collect.reshape(len(k.collect), -1)
        self._overlap = np.stack(
            [[(k.collect[j] * k.spread[i]).ravel() for i in ranks] for j in ranks]
        )
        self._excited = [np.zeros((3, len(k.spread))) for _ in range(2)]

    def __call__(self, codes: NDArray[Any], number: int, lift: float) -> NDArray[Any]:
        """The frame (row, col, channel) to project; it is kept until `HELD` - 1 more are made.

        Parameters
        ----------
        codes
            (row, col, channel) the master.
        number
            Of the frame: noise depends on it.
        lift
            See `compensate.aim.Aim`.
        """
        k = self._k
        frame = (codes.view("<u2") if self._pixels.floating else codes).reshape(len(codes), -1)
        out, v = next(self._room), np.float32(0)
        noise, below = shifts_of(number, len(codes)), self._base[:, :0]

        def sweep(stage: int, floors: NDArray[np.float32]) -> None:
            loops.sweep(
                stage, self._code, self._dome, frame, floors, below, self._base, v, self._lifts,
                self._heap, self._sums, noise, out.reshape(frame.shape),
            )  # fmt: skip

        floors = self._settled(loops.MASTER, sweep)
        v, below = np.float32(lift * self._missing(floors)), self._wide(floors)
        loops.guided(
            self._counted, self._around, self._heap, self._near, np.float32(EDGE**2), self._work,
            self._coarse,
        )  # fmt: skip
        widened(self._coarse, *self._blocks, self._base)
        sweep(loops.WRITTEN, self._wide(self._settled(loops.AIMED, sweep)))
        if not self._pixels.floating:
            return out
        out = out.astype("<f2")
        out[~k.screen] = codes[~k.screen]
        out[..., 3:] = codes[..., 3:]
        return out

    def _settled(
        self, stage: int, sweep: Callable[[int, NDArray[np.float32]], None]
    ) -> NDArray[np.float32]:
        """Floors of the light that `sweep` adds up.

        The equation is linear but for pixels whose clipping changes on the way. A step of
        1e-3 passes some 5 % of a dark picture's pixels, and half of it: an error of 1e-5.
        """
        k, excited = self._k, self._excited[stage]
        for _ in range(STEPS):
            sweep(stage, self._wide(self._floors(excited)))
            light, moving = self._sums.reshape(2, 3, -1).astype(np.float64)
            slopes = (self._overlap @ moving.T).transpose(2, 0, 1)
            step = newton_step(k.core, light @ self._collect.T, slopes, excited)
            excited += step
            change = np.abs(np.tensordot(step, k.spread, 1)).max()
            if change < SETTLED:
                break
        return self._floors(excited)

    def _floors(self, excited: NDArray[np.float64]) -> NDArray[np.float32]:
        """(4, cell row, cell col): what there is of light, over the direct gain, and that."""
        k = self._k
        floors = k.ambient + np.tensordot(excited, k.spread, 1)
        return np.concatenate([floors, k.gain[None]]).astype(np.float32)

    def _wide(self, floors: NDArray[np.float32]) -> NDArray[np.float32]:
        """(4, cell row, col)."""
        wide = np.empty((*floors.shape[:2], self._k.screen.shape[1]), np.float32)
        widened(floors, *self._cells, wide)
        return wide

    def _missing(self, floors: NDArray[np.float32]) -> float:
        """Light that is missing in the darkest places; see `compensate.aim.dome`.

        The mean of the highest share a of values u is the least of t + E[max(u - t, 0)] / a over t,
        at their quantile (R. T. Rockafellar, S. Uryasev, "Optimization of conditional value-at-
        risk", J. Risk 2(3), 2000). It is convex, so that it lies below tangents that cross.
        """
        k = self._k
        floor = np.tensordot(k.weights, floors[:3], 1) * floors[3]
        wide = np.empty((1, len(floor), self._counted.shape[1]), np.float32)
        widened(floor[None].astype(np.float32), *self._blocks_cells, wide)
        lacking = np.empty_like(self._counted)
        loops.lacking(wide, k.cell // k.block, self._heap[3], self._counted, lacking)

        def tangent(level: float) -> tuple[float, float, float]:
            above, more = loops.excess(self._counted, lacking, np.float32(level))
            return level, level + more / DARKEST, 1 - above / DARKEST

        low, high = tangent(0.0), tangent(float(lacking.max()))
        least = low[1]
        for _ in range(_TANGENTS):
            if low[2] >= 0 or high[1] <= 0:
                break
            apart = (high[1] - low[1]) - high[2] * (high[0] - low[0])
            level = low[0] + apart / (low[2] - high[2])
            new = tangent(level)
            least = min(least, new[1])
            if new[1] - (low[1] + low[2] * (level - low[0])) < _EXACT * high[0]:
                break
            low, high = (new, high) if new[2] < 0 else (low, new)
        return least


def _spans(screen: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """(row, piece, 2): columns between which each row has screen; of no piece, none."""
    edges = np.diff(screen.astype(np.int8), axis=1, prepend=0, append=0)
    (row, begin), end = np.nonzero(edges > 0), np.nonzero(edges < 0)[1]
    piece = np.arange(len(row)) - np.searchsorted(row, row)
    spans = np.zeros((len(screen), piece.max(initial=0) + 1, 2), np.uint64)
    spans[row, piece] = np.stack([begin, end], axis=1)
    return spans
