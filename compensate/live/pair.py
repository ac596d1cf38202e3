"""Live pictures of a pair, by compiled loops: veils of `compensate.aim`, and exact subtraction.

One pass finds what subtraction leaves, by blocks; local means of these blocks make the veils; and a
second pass shows the master with them.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.aim import pair
from compensate.live import pair_loops as loops
from compensate.live.coding import Coding, PixelFormat, room_for
from compensate.live.constants import PairConstants, turns_of
from compensate.live.noise import shifts_of
from compensate.live.tile_loops import code_of, places_along, widened
from domesim.light.blocks import block_sums


@final
class CompiledPair:
    """Compensates frames of two views.

    Parameters
    ----------
    constants
        Of the scene.
    coding
        What code values mean.
    pixels
        Layout of frames.
    beside
        Whether the views lie side by side, and not one above the other.
    dithers
        Whether codes are rounded with noise.
    """

    def __init__(
        self,
        constants: PairConstants,
        coding: Coding,
        pixels: PixelFormat,
        *,
        beside: bool,
        dithers: bool,
    ) -> None:
        k = self._k = constants
        self._pixels = pixels
        self._code = code_of(coding, pixels, k.cols, k.kept, dithers=dithers)
        cell = k.cell or max(k.rows, k.cols)
        self._pair = loops.Pair(
            rows=k.rows,
            cols=np.uint64(k.cols),
            down=np.uint64(0 if beside else k.rows),
            across=np.uint64(k.cols if beside else 0),
            block=np.uint64(k.block),
            cell=cell,
            rounds=-(-turns_of(k) // 2),
            weights=k.weights.astype(np.float32),
            matrices=k.matrices.astype(np.float32),
            black=k.black.astype(np.float32),
        )
        self._shares = np.empty((*k.share.shape[:2], k.cols), np.float32)
        places = places_along(k.cols, cell, k.share.shape[2])
        widened(k.share.astype(np.float32), *places, self._shares)
        self._counts = 1 / block_sums(np.ones((k.rows, k.cols), np.float32), k.block)
        size = self._counts.shape
        self._places = places_along(k.cols, k.block, size[1])
        self._found, self._veils = np.zeros((2, 6, *size), np.float32)
        self._down = np.asarray(pair.SHARE * k.down, np.float32)
        self._across = np.asarray(k.across.T, np.float32)
        down, across = (1, 2) if beside else (2, 1)
        self._room = room_for(down * k.rows, across * k.cols, pixels)

    def __call__(self, codes: NDArray[Any], number: int, lift: float) -> NDArray[Any]:
        """The frame (row, col, channel) to project; see `CompiledDome`."""
        frame = (codes.view("<u2") if self._pixels.floating else codes).reshape(len(codes), -1)
        out, noise = next(self._room), shifts_of(number, self._k.rows)
        for writes in (False, True):
            if writes:
                down = np.float32(lift) * self._down
                np.matmul(down @ self._found, self._across, out=self._veils)
            loops.sweep(
                writes, self._code, self._pair, frame, self._shares, self._counts, self._found,
                self._veils, *self._places, noise, out.reshape(frame.shape),
            )  # fmt: skip
        if not self._pixels.floating:
            return out
        out = out.astype("<f2")
        out[..., 3:] = codes[..., 3:]
        return out
