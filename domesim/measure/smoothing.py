"""A smooth map from noisy cells: Gaussian-process regression (kriging).

Cells q = f + noise of known variance; f is a constant that nothing is known of, plus a Gaussian
process of covariance s² exp(-d²/2 l²). Deviation s and length l are on a grid; s = 0, a flat map,
is one of them. Posteriors of all are averaged by their marginal likelihoods: one alone would be too
sure of itself. The mean is the map, and the covariance holds what smoothing may have taken away.

C. E. Rasmussen and C. K. I. Williams, *Gaussian Processes for Machine Learning*, MIT Press 2006,
eqs. 2.42 (explicit basis, here one constant) and 2.45.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Floats = NDArray[np.float64]

LENGTHS = (0.15, 0.25, 0.4, 0.6, 1.0, 1.6, 2.5)
"""Correlation lengths that are tried, in widths of the map."""
DEVIATIONS = (0.0, 0.1, 0.2, 0.35, 0.6, 1.0, 1.7)
"""Standard deviations of the map that are tried, in units of that of the cells."""


def smoothed(cells: Floats, error: Floats, aspect: float) -> tuple[Floats, Floats]:
    """The map (row, col), and the covariance (cell, cell) of its errors, row by row.

    Parameters
    ----------
    cells, error
        (row, col) noisy figures and their standard errors, above 0.
    aspect
        Width of the map over its height.
    """
    rows, cols = cells.shape
    x, y = np.meshgrid((np.arange(cols) + 0.5) / cols, (np.arange(rows) + 0.5) / rows / aspect)
    places = np.stack([x.ravel(), y.ravel()], -1)
    squares = np.sum((places[:, None] - places[None]) ** 2, axis=-1)
    q, variance = cells.ravel(), error.ravel() ** 2
    spread = float(q.std())
    fits = [
        _posterior(q, variance, (deviation * spread) ** 2, np.exp(-squares / (2 * length**2)))
        for length in LENGTHS
        for deviation in DEVIATIONS
        if deviation > 0 or length == LENGTHS[0]
    ]
    likelihoods, means, covariances = (np.array(part) for part in zip(*fits, strict=True))
    weights = np.exp(likelihoods - likelihoods.max())
    weights /= weights.sum()
    mean = weights @ means
    apart = means - mean
    covariance = np.tensordot(weights, covariances, 1) + (weights * apart.T) @ apart
    return mean.reshape(cells.shape), covariance


def _posterior(
    q: Floats, variance: Floats, signal: float, shape: Floats
) -> tuple[float, Floats, Floats]:
    """Log marginal likelihood, and the posterior's mean and covariance."""
    prior = signal * shape
    factor = cho_factor(prior + np.diag(variance), lower=True)
    ones = np.ones_like(q)
    solved = cho_solve(factor, np.stack([ones, q], -1))
    weight = float(ones @ solved[:, 0])
    level = float(ones @ solved[:, 1]) / weight
    residual = solved[:, 1] - level * solved[:, 0]
    likelihood = -0.5 * float((q - level) @ residual)
    likelihood -= float(np.log(np.diag(factor[0])).sum()) + 0.5 * float(np.log(weight))
    mean = level + prior @ residual
    # What the constant's own uncertainty adds
    known = cho_solve(factor, prior)
    missing = 1 - prior @ solved[:, 0]
    return likelihood, mean, prior - prior @ known + np.outer(missing, missing) / weight
