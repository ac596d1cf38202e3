"""Counted real 2-D Fourier transforms of planes, on any array library.

A *plane* is one picture-sized 2-D array; one transform of one plane, forward or inverse, counts as
one FFT. NumPy planes go through ``scipy.fft`` (``numpy.fft`` is 3-4 times slower in float32),
others through their own library's.
"""

from __future__ import annotations

import math
import os
from typing import Any, final

import numpy as np
import scipy.fft

from domesim.light import Array, namespace, total


@final
class Fourier:
    """Transforms of planes of one size (axes -2, -1).

    Parameters
    ----------
    rows, cols
        Size of the planes.

    Attributes
    ----------
    count
        FFTs of planes done so far.
    """

    def __init__(self, rows: int, cols: int) -> None:
        self.rows = rows
        self.cols = cols
        self.count = 0
        self._workers = len(os.sched_getaffinity(0))

    def forward(self, planes: Array) -> Array:
        """(..., row, col) real -> (..., row, col // 2 + 1) complex, of the same precision."""
        self.count += math.prod(planes.shape[:-2])
        if isinstance(planes, np.ndarray):
            return scipy.fft.rfft2(planes, workers=self._workers)
        return namespace(planes).fft.rfftn(planes, axes=(-2, -1))

    def inverse(self, spectrum: Array) -> Array:
        """Inverse of `forward`."""
        self.count += math.prod(spectrum.shape[:-2])
        size = (self.rows, self.cols)
        if isinstance(spectrum, np.ndarray):
            return scipy.fft.irfft2(spectrum, s=size, workers=self._workers)
        return namespace(spectrum).fft.irfftn(spectrum, s=size, axes=(-2, -1))

    def dot(self, left: Array, right: Array) -> float:
        """<l, r> of the real planes whose spectra these are (Parseval), summed in float64."""
        xp = namespace(left, right)
        # rfft keeps half of the columns: all but the first (and Nyquist's) stand for two
        result = 2 * total(xp.real(xp.vecdot(left, right)))
        for col in (0, -1) if self.cols % 2 == 0 else (0,):
            result -= total(xp.real(xp.conj(left[..., col]) * right[..., col]))
        return float(result) / (self.rows * self.cols)

    def frequencies(self, samples_per_unit: float) -> tuple[Any, Any]:
        """Row and column frequencies (row, 1) and (1, col // 2 + 1), cycles per unit."""
        rows = np.fft.fftfreq(self.rows, 1 / samples_per_unit)
        cols = np.fft.rfftfreq(self.cols, 1 / samples_per_unit)
        return rows[:, None], cols[None, :]


def padded_size(size: int, padding: int) -> int:
    """The next size with fast transforms that leaves at least `padding` pixels."""
    return int(scipy.fft.next_fast_len(size + padding, real=True))
