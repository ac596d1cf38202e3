"""Live pictures of a pair, by compiled loops: veils of `compensate.aim`, and exact subtraction.

One pass finds what subtraction leaves, by blocks; local means of these blocks make the veils; and a
second pass shows the master with them.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.live import pair_loops as loops
from compensate.live.coding import Coding, PixelFormat
from compensate.live.constants import PairConstants, turns_of
from compensate.live.dome import along
from compensate.live.dome_loops import table_of
from compensate.live.noise import noise_of, shifts_of
from compensate.live.smoothing import weights_of
from compensate.means import block_sums


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
        self._pixels, self._axis = pixels, 1 if beside else 0
        self._code = (coding.table(pixels), coding.mixing.astype(np.float32), coding.mixes)
        self._back = np.linalg.inv(coding.mixing).astype(np.float32)
        self._codes_of = table_of(coding.curve.encode, pixels.largest or 1)
        self._on = np.broadcast_to(np.ones((1, k.cols), np.float32), (k.rows, k.cols))
        self._weights = k.weights.astype(np.float32)
        share = k.share.astype(np.float32)
        cell = k.cell or max(k.rows, k.cols)
        self._shares = np.concatenate([share, share[:, :, -1:]], axis=2)
        self._linear = (
            self._shares,
            cell,
            *along(k.cols, cell, share.shape[2]),
            k.matrices.astype(np.float32),
            k.black.astype(np.float32),
            turns_of(k),
        )
        self._fine = k.blocks[-1]
        counts = block_sums(np.ones((k.rows, k.cols), np.float32), self._fine)
        self._counts = 1 / counts
        rows, cols = counts.shape
        self._found, self._work = np.empty((2, 12, rows, cols), np.float32)
        self._near, self._near_work = np.empty((2, 2, rows, cols), np.float32)
        self._nearby = tuple(
            weights_of(count, k.nearby / self._fine).astype(np.float32) for count in (cols, rows)
        )
        self._octaves: list[tuple[Any, ...]] = []
        for sigma, block in zip(k.sigmas, k.blocks, strict=True):
            within = block // self._fine
            size = (-(-rows // within), -(-cols // within))
            weights = (
                weights_of(count, sigma / block).astype(np.float32) for count in reversed(size)
            )
            self._octaves.append(
                (within, np.empty((2, 12, *size), np.float32), *weights,
                 along(cols, within, size[1]))
            )  # fmt: skip
        self._veil = np.empty((6, rows, cols), np.float32)
        self._own = np.empty((2, rows, cols), np.float32)
        self._veils = np.empty((8, rows, cols + 1), np.float32)
        self._places = along(k.cols, self._fine, cols)
        self._noise = noise_of(k.cols) * np.float32(dithers)
        whole = [k.rows, k.cols, pixels.channels]
        whole[self._axis] *= 2
        self._out = np.empty(whole, np.float32 if pixels.floating else pixels.dtype)

    def __call__(self, codes: NDArray[Any], number: int) -> NDArray[Any]:
        """The frame (row, col, channel) to project; see `CompiledDome`."""
        k = self._k
        frame = codes.view("<u2") if self._pixels.floating else codes
        views = np.split(frame, 2, self._axis)
        loops.ghosts(
            *views, self._on, *self._code, self._weights, *self._linear, self._fine,
            self._counts, self._found, self._near,
        )  # fmt: skip
        self._find_veils()
        loops.written(
            *views, self._on, *self._code, *self._linear, self._fine, self._veils, *self._places,
            self._back, self._codes_of, np.float32(self._pixels.largest), self._noise,
            shifts_of(number, k.rows), *np.split(self._out, 2, self._axis),
        )  # fmt: skip
        if not self._pixels.floating:
            return self._out
        out = self._out.astype("<f2")
        out[..., 3:] = codes[..., 3:]
        return out

    def _find_veils(self) -> None:
        """Fill `_veils` from what `ghosts` has found."""
        k = self._k
        lift = np.float32(k.aim.lift)
        for number, (within, (means, work), across, down, places) in enumerate(self._octaves):
            if within == 1:
                np.copyto(means, self._found)
            else:
                loops.halved(self._found, within, means)
            loops.smoothed(means, across, down, work)
            loops.raised(
                means, lift, self._weights, within, *places, number == 0, self._veil, self._own
            )
        loops.smoothed(self._near, *self._nearby, self._near_work)
        self._veils[:6, :, :-1] = self._veil
        stands_out = np.maximum(self._own, 0) / (self._near + np.float32(k.dark))
        self._veils[6:, :, :-1] = 1 / (1 + stands_out / np.float32(k.aim.faint))
        self._veils[:, :, -1] = self._veils[:, :, -2]
