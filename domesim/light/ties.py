"""Answers that rounding does not decide, so that every processor gives the same.

Libraries of linear algebra round differently on different processors. The values that they find
agree but for rounding; which of two equal values is the larger does not, nor do signs and order of
eigenvectors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

ROUNDING = 1e-9
"""Values count as equal within this share of the largest: rounding leaves 1e-12 or less."""


def ascending(values: ArrayLike, within: float | None = None) -> NDArray[np.intp]:
    """Sorts values stably: returns their order, the least first.

    Parameters
    ----------
    values
        (value,).
    within
        Neighbours that differ by so much at most count as equal; `ROUNDING` of the largest finite
        magnitude if it is None.

    Returns
    -------
    (value,) indices.
    """
    numbers = np.asarray(values, np.float64)
    if within is None:
        within = ROUNDING * float(np.abs(numbers[np.isfinite(numbers)]).max(initial=0.0))
    order = np.argsort(numbers, kind="stable")
    ordered = numbers[order]
    with np.errstate(invalid="ignore"):  # infinities less each other
        ranks = np.cumsum(np.diff(ordered, prepend=ordered[:1]) > within)
    return np.asarray(order[np.lexsort((order, ranks))])


def upright(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Flips (n, vector) vectors so that the largest number of each is positive."""
    largest = [ascending(-np.abs(each))[0] for each in vectors.T]
    return np.asarray(vectors * np.sign(vectors[largest, np.arange(vectors.shape[1])]))


def root_of(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the symmetric square root L of `covariance`, (n, n): L L' = covariance.

    A root by eigenvectors would have their signs and their order. Rounding decides both.
    """
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)
