"""Counted real 2-D Fourier transforms of planes, on any array library.

A *plane* is one picture-sized 2-D array. One transform of one plane, forward or inverse, counts as
one FFT; that of a plane a quarter the size counts as a quarter. NumPy planes go through the fastest
library that is installed (`transforms`), others through their own library's.
"""

from __future__ import annotations

import importlib
import math
import os
from functools import cache
from typing import Any, final

import numpy as np
import scipy

from domesim.light import Array, namespace, total
from domesim.light.strips import threads

LIBRARIES = ("mkl_fft.interfaces.scipy_fft", "pyfftw.interfaces.scipy_fft")
"""FFT libraries of the extra ``fast``, the one to prefer first. They have SciPy's functions and are
about twice as fast."""


@final
class Fourier:
    """Transforms of planes of one size (axes -2, -1).

    Parameters
    ----------
    rows, cols
        Size of the planes.
    within
        Transforms of larger planes, which count these as shares of theirs.

    Attributes
    ----------
    count
        FFTs of planes done so far.
    """

    def __init__(self, rows: int, cols: int, within: Fourier | None = None) -> None:
        self.rows = rows
        self.cols = cols
        self.count = 0.0
        self._within = within

    def coarser(self) -> Fourier:
        """Transforms of planes of half the rows and columns, counted here as quarters.

        Raises
        ------
        ValueError
            If they cannot be halved.
        """
        if self.rows % 2 or self.cols % 2:
            raise ValueError(f"a plane of {self.rows} x {self.cols} has no half")
        return Fourier(self.rows // 2, self.cols // 2, self)

    def forward(self, planes: Array) -> Array:
        """Transforms real (..., row, col) to complex (..., row, col // 2 + 1) planes."""
        self._note(math.prod(planes.shape[:-2]))
        if isinstance(planes, np.ndarray):
            return transforms().rfft2(planes, workers=threads())
        return namespace(planes).fft.rfftn(planes, axes=(-2, -1))

    def inverse(self, spectrum: Array, *, spent: bool = False) -> Array:
        """Inverse of `forward`; a `spent` spectrum may be overwritten, which saves its memory."""
        self._note(math.prod(spectrum.shape[:-2]))
        size = (self.rows, self.cols)
        if isinstance(spectrum, np.ndarray):
            if spent:
                options: dict[str, Any] = {"overwrite_x": True, "workers": threads()}
                columns = transforms().ifft(spectrum, axis=-2, **options)
                return transforms().irfft(columns, n=self.cols, axis=-1, **options)
            return transforms().irfft2(spectrum, s=size, workers=threads())
        return namespace(spectrum).fft.irfftn(spectrum, s=size, axes=(-2, -1))

    def dot(self, left: Array, right: Array) -> float:
        """Returns <l, r> of the real planes whose spectra these are (Parseval), in float64.

        If the spectra are some rows of whole ones, it is those rows' part of the sum.
        """
        xp = namespace(left, right)
        # rfft keeps half of the columns: all but the first (and Nyquist's) stand for two
        if isinstance(left, np.ndarray) and isinstance(right, np.ndarray):
            # NumPy's vecdot holds Python's lock: no other strip's thread would go on
            parts = (plane.view(plane.real.dtype) for plane in (left, right))
            result = 2 * total(np.einsum("...i,...i", *parts))
        else:
            result = 2 * total(xp.real(xp.vecdot(left, right)))
        for col in (0, -1) if self.cols % 2 == 0 else (0,):
            result -= total(xp.real(xp.conj(left[..., col]) * right[..., col]))
        return float(result) / (self.rows * self.cols)

    def frequencies(self, samples_per_unit: float) -> tuple[Any, Any]:
        """Returns row and column frequencies, (row, 1) and (1, col // 2 + 1), cycles per unit."""
        rows = np.fft.fftfreq(self.rows, 1 / samples_per_unit)
        cols = np.fft.rfftfreq(self.cols, 1 / samples_per_unit)
        return rows[:, None], cols[None, :]

    def _note(self, share: float) -> None:
        self.count += share
        if self._within is not None:
            whole = self._within
            whole._note(share * (self.rows * self.cols) / (whole.rows * whole.cols))


@cache
def transforms() -> Any:
    """The module that transforms NumPy planes: of `LIBRARIES` if it is there, else ``scipy.fft``.

    (``numpy.fft`` is 3-4 times slower in float32.) With ``DOMESIM_FAST=0`` in the environment it is
    always ``scipy.fft``.
    """
    if os.environ.get("DOMESIM_FAST", "1") != "0":
        for name in LIBRARIES:
            try:
                library = importlib.import_module(name)
            except (ImportError, OSError):
                continue
            if name.startswith("pyfftw"):
                importlib.import_module("pyfftw.interfaces.cache").enable()
            return library
    return scipy.fft


def padded_size(size: int, padding: int) -> int:
    """The next size with fast transforms that leaves at least `padding` pixels.

    It is four times a product of 2, 3 and 5: models of vision halve it. (`scipy.fft` knows such
    sizes too, and takes a fifth of a second to load.)
    """
    quarter = -(-(size + padding) // 4)
    while _without(2, _without(3, _without(5, quarter))) > 1:
        quarter += 1
    return 4 * quarter


def _without(factor: int, number: int) -> int:
    while number % factor == 0:
        number //= factor
    return number
