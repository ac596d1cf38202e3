"""What a camera's codes leave out: rounding that the noise does not blur.

A code is light rounded to the next step. Noise of half a step or more blurs that: the mean of many
pixels is right, and their scatter says how well. With less noise, places of the same light have one
code, or flip between two, and their mean is off. Light being anywhere between two codes, pixels
whose noise is s steps have, in steps² [1],

    scatter about their mean        v(s) = s² + 1/12 - b(s)
    squared error of their mean     b(s) = sum_k exp(-4 pi² k² s²) / (2 pi² k²)

b is 1/12 without noise, and 3e-6 for half a step. So the scatter that is seen at many places tells
b. At one place it does not: there, v and b depend on where between two codes the light is.

[1] B. Widrow, I. Kollár, "Quantization Noise", Cambridge University Press, 2008: moments of a
rounded Gaussian by its characteristic function.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SAMPLES = 1 << 18
_ORDERS = np.arange(1, 200)
_SPREAD = np.linspace(0, 1, 101)
_SHARED: Floats = np.sum(
    np.exp(-(4 * np.pi**2) * np.outer(_SPREAD, _ORDERS) ** 2) / (2 * np.pi**2 * _ORDERS**2), -1
)
_SEEN: Floats = _SPREAD**2 + _SHARED[0] - _SHARED


def step_of(photographs: Iterable[NDArray[np.floating]]) -> float:
    """Smallest difference between two values that a camera's channel had in any photograph.

    Parameters
    ----------
    photographs
        (row, col, channel) each. Of several channels the one with the largest step counts: means
        of two greens have half steps.

    Returns
    -------
    step
        0 if no two values differ. Of photographs with noise that are not rounded, next to 0.
    """
    least = np.full(3, np.inf)
    for photograph in photographs:
        values = photograph.reshape(-1, photograph.shape[-1])
        some = values[:: max(1, len(values) // _SAMPLES)]
        for channel, one in enumerate(some.T):
            apart = np.diff(np.unique(one))
            least[channel] = min(least[channel], apart.min(initial=np.inf))
    known = least[np.isfinite(least)]
    return float(known.max(initial=0.0))


def scatter_of(photograph: NDArray[np.floating]) -> Floats:
    """Squared differences of neighbours, halved: their mean is a pixel's variance.

    Parameters
    ----------
    photograph
        (row, col, channel).

    Returns
    -------
    differences
        (pair,) some of them; edges of the picture are among them.
    """
    pairs = photograph[:, : photograph.shape[1] // 2 * 2].reshape(-1, 2, photograph.shape[-1])
    some = pairs[:: max(1, len(pairs) // _SAMPLES)].astype(np.float64)
    return np.asarray((some[:, 1] - some[:, 0]).ravel() ** 2 / 2)


def shared_rounding(scatter: Floats) -> Floats:
    """Squared error, in steps², that rounding leaves in means over pixels of the same light.

    Parameters
    ----------
    scatter
        Variance of pixels of the same light about their mean, in steps², any shape; of many places.
    """
    return np.interp(scatter, _SEEN, _SHARED, right=0.0)
