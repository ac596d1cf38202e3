"""Local means of planes, which vision models take luminance by."""

from __future__ import annotations

import math
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from compensate.fourier import Fourier, padded_size, transforms
from domesim.strips import threads

# Of a Gaussian: standard deviations at which it is cut off, and cycles a standard deviation at
# which its transform is. Both ends are 4e-6 of the middle.
_TAILS, _FINEST = 5, 5 / (2 * math.pi)

Planes: TypeAlias = NDArray[np.floating[Any]]
"""(view, row, col)."""


@final
class Averaging:
    """Gaussian means over the pixels of a screen, by FFT.

    Parameters
    ----------
    screen
        (row, col) bool.
    reach
        Standard deviation, pixels.
    """

    def __init__(self, screen: NDArray[np.bool_], reach: float) -> None:
        self.screen = screen
        radius = int(_TAILS * reach + 0.5)
        rows, cols = (padded_size(side, radius) for side in screen.shape)
        self._padded = rows, cols
        # Of the sampled Gaussian: the other's transform, cut off at Nyquist's frequency, rings
        steps = np.arange(1, radius + 1)
        weights = np.exp(-0.5 * (steps / max(reach, 1e-9)) ** 2)
        along, across = (
            (1 + 2 * np.cos(2 * np.pi * frequency[..., None] * steps) @ weights)
            / (1 + 2 * weights.sum())
            for frequency in Fourier(rows, cols).frequencies(1.0)
        )
        # Finer than these, nothing passes a Gaussian
        passed = 1 + math.ceil(cols * _FINEST / max(reach, 1e-9))
        self._along, self._across = along.astype(np.float32), across[:, :passed].astype(np.float32)
        self._around = np.float32(1)
        self._around = np.maximum(self(screen[None].astype(np.float32))[0], 1e-3)

    def __call__(self, planes: Planes) -> Planes:
        """(view, row, col) means; what is off the screen does not count."""
        (rows, cols), fourier = self.screen.shape, transforms()
        wide = np.zeros((len(planes), rows, self._padded[1]), planes.dtype)
        np.multiply(planes, self.screen, out=wide[..., :cols])
        of_rows = fourier.rfft(wide, workers=threads())
        of_rows = of_rows[..., : self._across.shape[1]] * self._across
        spectrum = fourier.fft(of_rows, self._padded[0], axis=1, workers=threads())
        spectrum *= self._along
        of_rows = fourier.ifft(spectrum, axis=1, workers=threads())[:, :rows]
        averaged: Planes = fourier.irfft(of_rows, self._padded[1], workers=threads())[..., :cols]
        averaged /= self._around
        return averaged
