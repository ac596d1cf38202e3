"""Live pictures of a pair, by compiled loops: veils of `compensate.aim`, and exact subtraction.

One pass finds what subtraction leaves, by blocks; local means of these blocks make the veils; and a
second pass shows the master with them.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.blocks import block_sums
from compensate.live import pair_loops as loops
from compensate.live.coding import Coding, PixelFormat, room_for
from compensate.live.constants import PairConstants, turns_of
from compensate.live.noise import shifts_of
from compensate.live.smoothing import weights_of
from compensate.live.tile_loops import code_of, places_along, widened


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
        self._code = code_of(coding, pixels, k.cols, dithers=dithers)
        self._fine = k.blocks[-1]
        cell = k.cell or max(k.rows, k.cols)
        self._pair = loops.Pair(
            rows=k.rows,
            cols=np.uint64(k.cols),
            down=np.uint64(0 if beside else k.rows),
            across=np.uint64(k.cols if beside else 0),
            block=np.uint64(self._fine),
            cell=cell,
            rounds=-(-turns_of(k) // 2),
            weights=k.weights.astype(np.float32),
            matrices=k.matrices.astype(np.float32),
            black=k.black.astype(np.float32),
        )
        self._shares = np.empty((*k.share.shape[:2], k.cols), np.float32)
        places = places_along(k.cols, cell, k.share.shape[2])
        widened(k.share.astype(np.float32), *places, self._shares)
        self._counts = 1 / block_sums(np.ones((k.rows, k.cols), np.float32), self._fine)
        size = self._counts.shape
        self._places = places_along(k.cols, self._fine, size[1])
        self._found = np.empty((14, *size), np.float32)
        self._work = np.empty((14, *size), np.float32)
        self._veils = np.empty((8, *size), np.float32)
        self._nearby = _weights(size, k.nearby / self._fine)
        self._octaves = [
            _Octave(size, block // self._fine, sigma / block)
            for sigma, block in zip(k.sigmas, k.blocks, strict=True)
        ]
        down, across = (1, 2) if beside else (2, 1)
        self._room = room_for(down * k.rows, across * k.cols, pixels)

    def __call__(self, codes: NDArray[Any], number: int) -> NDArray[Any]:
        """The frame (row, col, channel) to project; see `CompiledDome`."""
        frame = (codes.view("<u2") if self._pixels.floating else codes).reshape(len(codes), -1)
        out, noise = next(self._room), shifts_of(number, self._k.rows)
        for writes in (False, True):
            if writes:
                self._find_veils()
            loops.sweep(
                writes, self._code, self._pair, frame, self._shares, self._counts, self._found,
                self._veils, *self._places, noise, out.reshape(frame.shape),
            )  # fmt: skip
        if not self._pixels.floating:
            return out
        out = out.astype("<f2")
        out[..., 3:] = codes[..., 3:]
        return out

    def _find_veils(self) -> None:
        """Fill `_veils` from what the first sweep has found."""
        aim, dark = self._k.aim, np.float32(self._k.dark)
        ghosts, near = self._found[:12], self._found[12:]
        loops.smoothed(near, *self._nearby, self._work[12:])
        sums = self._octaves[-1].sums = ghosts
        for octave in reversed(self._octaves[:-1]):
            if octave.sums.shape == sums.shape:
                np.copyto(octave.sums, sums)
            else:
                loops.halved(sums, octave.sums)
            sums = octave.sums
        for octave in self._octaves:
            means = octave.sums
            if octave.block > 1:
                means *= octave.counts
            loops.smoothed(means, *octave.weights, octave.work)
            loops.peaks(means, np.float32(aim.lift), self._pair.weights, octave.peaks)
            if octave.block > 1:
                widened(octave.peaks, *octave.places, octave.wide)
            loops.raised(
                octave.wide, octave.block, octave is self._octaves[0], near, dark,
                np.float32(aim.faint), self._veils,
            )  # fmt: skip


def _weights(size: tuple[int, ...], sigma: float) -> tuple[NDArray[np.float32], ...]:
    """Weights of means across, and down, of (row, col) `size`."""
    across, down = (weights_of(count, sigma).astype(np.float32) for count in reversed(size))
    return across, down


class _Octave:
    """Room for an octave of veils.

    Parameters
    ----------
    size
        (row, col) of the finest blocks.
    block
        How many of them along a side of the octave's blocks.
    sigma
        Of its means, in its blocks.
    """

    def __init__(self, size: tuple[int, ...], block: int, sigma: float) -> None:
        rows, cols = (-(-count // block) for count in size)
        self.block, self.weights = block, _weights((rows, cols), sigma)
        self.counts = 1 / block_sums(np.ones(size, np.float32), block)
        self.sums, self.work = np.empty((2, 12, rows, cols), np.float32)
        self.peaks = np.empty((8, rows, cols), np.float32)
        self.places = places_along(size[1], block, cols)
        self.wide = np.empty((8, rows, size[1]), np.float32) if block > 1 else self.peaks
