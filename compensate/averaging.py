"""Local means of planes, which vision models take luminance by."""

from __future__ import annotations

from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from compensate.fourier import Fourier, padded_size

_TAILS = 4  # standard deviations at which a Gaussian is cut off, as SciPy does

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
        self._fourier = Fourier(rows, cols)
        # Of the sampled Gaussian: the other's transform, cut off at Nyquist's frequency, rings
        steps = np.arange(1, radius + 1)
        weights = np.exp(-0.5 * (steps / max(reach, 1e-9)) ** 2)
        along, across = (
            (1 + 2 * np.cos(2 * np.pi * frequency[..., None] * steps) @ weights)
            / (1 + 2 * weights.sum())
            for frequency in self._fourier.frequencies(1.0)
        )
        self._blur = along.astype(np.float32), across.astype(np.float32)
        self._around = np.float32(1)
        self._around = np.maximum(self(screen[None].astype(np.float32))[0], 1e-3)

    def __call__(self, planes: Planes) -> Planes:
        """(view, row, col) means; what is off the screen does not count."""
        rows, cols = self.screen.shape
        padded = np.zeros((len(planes), self._fourier.rows, self._fourier.cols), planes.dtype)
        np.multiply(planes, self.screen, out=padded[:, :rows, :cols])
        spectrum = self._fourier.forward(padded)
        for factor in self._blur:
            spectrum *= factor
        averaged: Planes = self._fourier.inverse(spectrum)[:, :rows, :cols]
        averaged /= self._around
        return averaged
