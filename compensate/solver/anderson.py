"""Anderson acceleration of a fixed-point iteration s <- s + r(s) on planes.

With the last residuals r_i and the points t_i = s_i + r_i that they led to, the next point is the
combination of the t_i whose residuals, combined alike, are least (Walker & Ni 2011, *SIAM Journal
on Numerical Analysis* 49, 1715-1735, eq. 2.2):

    s <- sum alpha_i t_i,     alpha = argmin ||sum alpha_i r_i||,  sum alpha_i = 1

Only the inner products of residuals are needed, and the combination is not delicate: they are taken
on every fourth pixel and row, so that old residuals cost little memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from compensate.solver.blocks import each_strip
from compensate.solver.fused import loops
from compensate.solver.level import Planes
from domesim.light import Array, namespace, total

_GROWN = 2.0  # times the last residual: the acceleration is given up and begins anew
_STRIDE = 4  # between the pixels that are looked at
_DAMPING = 1e-8  # of the inner products' trace


@final
class Anderson:
    """The history of an iteration.

    Parameters
    ----------
    memory
        How many old points it keeps; 0 for none.
    weights
        How much each plane counts in inner products.

    Attributes
    ----------
    energy
        ||r||² of the last residual, weighted, as far as the samples tell.
    """

    def __init__(self, memory: int, weights: Sequence[float]) -> None:
        self._memory, self._weights = memory, weights
        self.energy = 0.0
        self._points: list[Planes] = []
        self._residuals: list[Planes] = []
        self._products = np.zeros((0, 0))

    def clear(self) -> None:
        """Begin anew."""
        self._points, self._residuals = [], []
        self._products = np.zeros((0, 0))

    def reweigh(self, weights: Sequence[float]) -> None:
        """Begin anew with other weights, all by the same factor."""
        self.energy *= weights[0] / self._weights[0]
        self._weights = weights
        self.clear()

    def next(self, point: Planes, residual: Planes) -> Planes:
        """The next s, of t = s + r and r; t's planes are kept, r's may be used up."""
        sampled = [_sampled(plane) for plane in residual]
        products = np.array([self._dot(sampled, other) for other in [sampled, *self._residuals]])
        self.energy = _STRIDE**2 * float(products[0])
        if not self._memory:
            return point
        if len(products) > 1 and products[0] > _GROWN**2 * self._products[0, 0]:
            self.clear()
            products = products[:1]
        size = len(products)
        gram = np.zeros((size, size))
        gram[1:, 1:] = self._products
        gram[0], gram[:, 0] = products, products
        weights = _least(gram)
        following = self._combined(point, weights)
        keep = self._memory - 1
        self._points = [point, *self._points[:keep]]
        self._residuals = [sampled, *self._residuals[:keep]]
        self._products = gram[: keep + 1, : keep + 1]
        return following

    def _dot(self, left: Planes, right: Planes) -> float:
        def work(rows: slice) -> float:
            return sum(
                weight * float(total(a[rows, :] * b[rows, :]))
                for weight, a, b in zip(self._weights, left, right, strict=True)
            )

        return sum(each_strip(work, left[0]))

    def _combined(self, point: Planes, weights: Any) -> Planes:
        """The combination, in the place of the point that is dropped, if one is."""
        xp = namespace(point[0])
        full = len(self._points) == self._memory
        place = self._points[-1] if full else [xp.empty_like(plane) for plane in point]
        for p, plane in enumerate(place):
            points = [point[p], *(old[p] for old in self._points)]
            if len(points) <= 3 and (compiled := loops(plane)):
                given = np.zeros(3, plane.dtype)
                given[: len(points)] = weights
                compiled.combine(plane, *points, *[point[p]] * (3 - len(points)), given)
                continue

            def work(rows: slice, points: Planes = points, plane: Array = plane) -> None:
                result = points[0][rows, :] * float(weights[0])
                for weight, other in zip(weights[1:], points[1:], strict=True):
                    result += other[rows, :] * float(weight)
                plane[rows, :] = result

            each_strip(work, plane)
        return place


def _least(gram: Any) -> Any:
    """Weights, of sum 1, of the combination of vectors with that Gram matrix that is least."""
    size = len(gram)
    if size == 1:
        return np.ones(1)
    differences = gram[0, 0] - gram[0, 1:][None, :] - gram[1:, 0][:, None] + gram[1:, 1:]
    right = gram[0, 0] - gram[1:, 0]
    differences = differences + _DAMPING * np.trace(differences) * np.eye(size - 1)
    if not np.trace(differences) > 0:
        return np.eye(size)[0]
    old = np.linalg.solve(differences, right)
    return np.concatenate([[1 - old.sum()], old])


def _sampled(plane: Array) -> Array:
    return namespace(plane).asarray(plane[::_STRIDE, ::_STRIDE], copy=True)
