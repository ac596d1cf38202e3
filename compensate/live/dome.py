"""Live pictures of a dome, by compiled loops: the aim of `compensate.aim` in a few passes.

The master is decoded anew in every pass, which is cheaper than to fetch its light from memory. What
the whole screen adds up to is a few numbers: the light in each mode of reflection of what
subtraction shows of the master, of the aim, and of the aim with its hues. Each is the root of a
piecewise linear equation (`compensate.solver.baselines`), found by Newton's method from where the
last frame had it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.live import dome_loops as loops
from compensate.live.coding import Coding, PixelFormat
from compensate.live.constants import DomeConstants
from compensate.live.noise import noise_of, shifts_of
from compensate.means import block_sums, box_sum

_SETTLED = 1e-3
"""Change of a floor, of white, after which Newton's step is exact to 1e-5: see `_settled`."""
_STEPS = 30
_HALVINGS = 24


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
        self._on = k.screen.astype(np.float32)
        self._spans = _spans(k.screen)
        self._code = (
            coding.table(pixels),
            coding.mixing.astype(np.float32),
            coding.mixes,
        )
        self._back = np.linalg.inv(coding.mixing).astype(np.float32)
        self._codes_of = loops.table_of(coding.curve.encode, pixels.largest or 1)
        self._weights, self._dark = k.weights.astype(np.float32), np.float32(k.dark)
        self._places, self._parts = along(cols, k.cell, k.gain.shape[1])
        self._counted = block_sums(self._on, k.block)
        self._around = box_sum(self._counted, k.radius)
        self._block_places, self._block_parts = along(cols, k.block, self._counted.shape[1])
        self._found = np.zeros((6, *self._counted.shape), np.float32)
        self._work = np.zeros((12, *self._counted.shape), np.float32)
        self._bases = np.empty((4, self._counted.shape[0], self._counted.shape[1] + 1), np.float32)
        self._lifts = np.empty((rows, cols), np.float32)
        self._sums = np.zeros((6, *k.gain.shape), np.float32)
        self._noise = noise_of(cols) * np.float32(dithers)
        self._out = np.empty(
            (rows, cols, pixels.channels), np.float32 if pixels.floating else pixels.dtype
        )
        ranks = range(len(k.spread))
        self._collect = k.collect.reshape(len(k.collect), -1)
        self._overlap = np.stack(
            [[(k.collect[j] * k.spread[i]).ravel() for i in ranks] for j in ranks]
        )
        self._excited = [np.zeros((3, len(k.spread))) for _ in range(3)]

    def __call__(self, codes: NDArray[Any], number: int) -> NDArray[Any]:
        """The frame (row, col, channel) to project; it is overwritten by the next.

        Parameters
        ----------
        codes
            (row, col, channel) the master.
        number
            Of the frame: noise depends on it.
        """
        k = self._k
        frame = codes.view("<u2") if self._pixels.floating else codes
        on, cell, places, parts, sums = self._on, k.cell, self._places, self._parts, self._sums
        code, spans = self._code, self._spans

        def of_master(floors: NDArray[np.float32]) -> None:
            loops.moments(
                frame, on, spans, *code, self._weights, self._dark, k.block, cell, floors, places,
                parts, self._found, sums,
            )  # fmt: skip

        first = self._settled(0, of_master)
        aim = np.array([self._missing(first), k.aim.fade, k.aim.edge], np.float32)
        self._find_base()

        def of_aim(floors: NDArray[np.float32]) -> None:
            loops.gains(
                frame, on, spans, *code, self._weights, self._dark, aim, k.block, cell, self._bases,
                floors, self._block_places, self._block_parts, places, parts, self._lifts, sums,
            )  # fmt: skip

        below = self._settled(1, of_aim)
        hue = np.float32(k.aim.hue)

        def with_hue(floors: NDArray[np.float32]) -> None:
            loops.shown(
                frame, on, spans, *code, self._lifts, hue, cell, below, floors, places, parts, sums
            )

        floors = self._settled(2, with_hue)
        loops.written(
            frame, on, spans, *code, self._lifts, hue, cell, below, floors, places, parts,
            self._back, self._codes_of, np.float32(self._pixels.largest), self._noise,
            shifts_of(number, on.shape[0]), self._out,
        )  # fmt: skip
        if not self._pixels.floating:
            return self._out
        out = self._out.astype("<f2")
        out[~k.screen] = codes[~k.screen]
        out[..., 3:] = codes[..., 3:]
        return out

    def _settled(
        self, which: int, show: Callable[[NDArray[np.float32]], None]
    ) -> NDArray[np.float32]:
        """Floors of the light that `show` adds up.

        The equation is linear but for pixels whose clipping changes on the way. A step of
        1e-3 passes some 5 % of a dark picture's pixels, and half of it: an error of 1e-5.
        """
        k, excited = self._k, self._excited[which]
        for _ in range(_STEPS):
            floors = self._floors(excited)
            show(floors)
            light, moving = self._sums.reshape(2, 3, -1).astype(np.float64)
            system = np.eye(len(k.spread)) + k.core @ (self._overlap @ moving.T).transpose(2, 0, 1)
            off = (k.core @ (light @ self._collect.T)[:, :, None])[:, :, 0] - excited
            step = np.linalg.solve(system, off[:, :, None])[:, :, 0]
            excited += step
            change = np.abs(np.tensordot(step, k.spread, 1)).max()
            if change < _SETTLED:
                break
        return self._floors(excited)

    def _floors(self, excited: NDArray[np.float64]) -> NDArray[np.float32]:
        """(4, cell row, cell col + 1): what there is of light, over the direct gain, and that."""
        k = self._k
        floors = k.ambient + np.tensordot(excited, k.spread, 1)
        planes = np.concatenate([floors, k.gain[None]]).astype(np.float32)
        return np.concatenate([planes, planes[:, :, -1:]], axis=2)

    def _find_base(self) -> None:
        """Fill `_bases` from what `moments` has found."""
        self._work[:3] = self._found[[0, 1, 3]]
        edge = np.float32(self._k.aim.edge)
        loops.bases(
            self._counted, self._around, self._found, self._k.radius, edge, self._work, self._bases
        )

    def _missing(self, floors: NDArray[np.float32]) -> float:
        """See `compensate.aim`: `lift` times the mean over the darkest share of the screen.

        The mean of the highest share a of values u is the least of t + E[max(u - t, 0)] / a over t,
        at their quantile (R. T. Rockafellar, S. Uryasev, "Optimization of conditional value-at-
        risk", J. Risk 2(3), 2000): near it t need not be known well.
        """
        k = self._k
        floor = np.tensordot(k.weights, floors[:3, :, :-1], 1) * floors[3, :, :-1]
        shape = self._counted.shape
        there = _at_blocks(floor, k.cell // k.block, shape)
        lacking = np.maximum(there - self._found[5] / np.maximum(self._counted, 1), 0)
        lacking = lacking.astype(np.float32)
        low, high = 0.0, float(lacking.max())
        for _ in range(_HALVINGS):
            level = (low + high) / 2
            above, more = loops.excess(self._counted, lacking, np.float32(level))
            low, high = (level, high) if above > k.aim.darkest else (low, level)
        return float(k.aim.lift * (level + more / k.aim.darkest))


def along(count: int, side: int, cells: int) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """For each column: the coarse one below it, and how far it is towards the next."""
    at = np.clip((np.arange(count) + 0.5) / side - 0.5, 0, cells - 1)
    low = np.floor(at).astype(np.uint32)
    return low, (at - low).astype(np.float32)


def _at_blocks(
    cells: NDArray[np.floating], side: int, shape: tuple[int, int]
) -> NDArray[np.floating]:
    """Cells at the middles of blocks, `side` of them along each."""
    for axis in (0, 1):
        low, part = along(shape[axis], side, cells.shape[axis])
        above = np.minimum(low + 1, cells.shape[axis] - 1).astype(np.intp)
        parts = part[:, None] if axis == 0 else part
        cells = cells.take(low, axis) * (1 - parts) + cells.take(above, axis) * parts
    return cells


def _spans(screen: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """(row, 2): columns between which there is any screen."""
    some = screen.any(axis=1)
    first, last = screen.argmax(axis=1), screen.shape[1] - screen[:, ::-1].argmax(axis=1)
    return np.stack([first * some, last * some], axis=1).astype(np.uint64)
