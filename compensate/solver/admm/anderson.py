"""Anderson acceleration of a fixed-point iteration s <- s + r(s) on planes.

With the last residuals r_i and the points t_i = s_i + r_i that they led to, the next point is the
combination of the t_i whose residuals, combined alike, are least (Walker & Ni 2011, *SIAM Journal
on Numerical Analysis* 49, 1715-1735, eq. 2.2):

    s <- sum alpha_i t_i,     alpha = argmin ||sum alpha_i r_i||,  sum alpha_i = 1

Only the inner products of residuals are needed. On large planes they take every fourth pixel and
row, so that old residuals cost little memory. On small planes they take all: a few pixels of a
small pattern may all be alike, and what is least on them may be large elsewhere. Old points are
kept as their differences d_i from the newest, in 16 bits a pixel instead of 32, which costs no
iteration (``validation/notes/0006``). With s = t + sum alpha_i d_i and the next residual r, they
become

    d_1 <- -(r + sum alpha_i d_i),     d_i <- d_(i - 1) + d_1
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.solver.admm.fused import loops
from compensate.solver.admm.hessian import Planes, each_strip
from domesim.light import Array, namespace, total

_GROWN = 2.0  # times the last residual: the acceleration is given up and begins anew
_STRIDE = 4  # between the pixels of large planes that are looked at
_SMALL = 1 << 16  # pixels of a plane that is looked at as a whole
_DAMPING = 1e-8  # of the inner products' trace
LARGEST, TINY = np.float32(32767), np.float32(1e-37)
"""Largest code of 16 bits, and the least value that counts as light."""


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
        ||r||² of the last residual, as far as the samples tell, by the weights that it was found
        with.
    """

    def __init__(self, memory: int, weights: Sequence[float]) -> None:
        self._memory, self._weights = memory, weights
        self.energy = 0.0
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self._differences: list[list[Any]] = []  # of each plane, from its newest point
        self._applied = np.zeros(self._memory)
        self._residuals: list[Planes] = []
        self._products = np.zeros((0, 0))

    def give_up(self) -> None:
        """Accelerate no more: the plain iteration always gets nearer."""
        self._memory = 0
        self.clear()

    def reweigh(self, weights: Sequence[float]) -> None:
        """Begin anew with other weights, all by the same factor."""
        self._weights = weights
        self.clear()

    def next(self, point: Planes, residual: Planes) -> Planes:
        """The next s from t = s + r and r, in t's place; r's planes are left as they are."""
        sampled = [_sampled(plane) for plane in residual]
        products = np.array([self._dot(sampled, other) for other in [sampled, *self._residuals]])
        self.energy = _stride(residual[0]) ** 2 * float(products[0])
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
        if size > 1:
            applied = np.zeros(self._memory)
            applied[: size - 1] = weights[1:]
            if not self._differences:
                self._differences = [[_nothing(p) for _ in range(self._memory)] for p in point]
            for plane, r, kept in zip(point, residual, self._differences, strict=True):
                _advance(plane, r, kept, self._applied, applied)
            self._applied = applied
        keep = self._memory - 1
        self._residuals = [sampled, *self._residuals[:keep]]
        self._products = gram[: keep + 1, : keep + 1]
        return point

    def _dot(self, left: Planes, right: Planes) -> float:
        def work(rows: slice) -> float:
            return sum(
                weight * float(total(a[rows, :] * b[rows, :]))
                for weight, a, b in zip(self._weights, left, right, strict=True)
            )

        return sum(each_strip(work, left[0]))


@final
class Short:
    """A plane in 16 bits a pixel, as shares of each row's largest value; rows can be set.

    Parameters
    ----------
    shape
        (row, col) of the plane, which begins as 0.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.codes = np.zeros(shape, np.int16)
        self.units = np.zeros((shape[0], 1), np.float32)

    def rows(self, rows: slice, weight: float = 1.0) -> NDArray[np.float32]:
        """Some rows of the plane, times a weight, as float32."""
        part = self.codes[rows].astype(np.float32)  # faster than in the product
        part *= self.units[rows] * np.float32(weight)
        return part

    def __setitem__(self, rows: tuple[slice, slice], part: NDArray[np.float32]) -> None:
        largest = np.maximum(part.max(axis=1, keepdims=True), -part.min(axis=1, keepdims=True))
        units = np.maximum(largest, TINY) / LARGEST
        self.units[rows[0]] = units
        codes = part / units
        self.codes[rows] = np.rint(codes, out=codes)


def _nothing(like: Array) -> Any:
    if isinstance(like, np.ndarray) and like.dtype == np.float32:
        return Short(like.shape)
    return namespace(like).zeros_like(like)


def _advance(plane: Array, residual: Array, kept: list[Any], was: Any, weights: Any) -> None:
    """Moves a plane to the next s, and its differences to those from the new point, in place."""
    short = len(kept) == 2 and isinstance(kept[0], Short)
    if short and (compiled := loops(plane)):
        numbers = (tuple(map(plane.dtype.type, each)) for each in (was, weights))
        codes = (part for each in kept for part in (each.codes, each.units))
        compiled.advance(plane, residual, *codes, *numbers, LARGEST, TINY)
        return

    def work(rows: slice) -> None:
        old = [_rows_of(difference, rows) for difference in kept[:-1]]
        back = _rows_of(kept[-1], rows, float(was[-1]))
        back += residual[rows, :]
        for weight, part in zip(was[:-1], old, strict=True):
            back += part * float(weight)
        parts = [-1 * back, *(part - back for part in old)]
        for difference, part, weight in zip(kept, parts, weights, strict=True):
            difference[rows, :] = part
            plane[rows, :] += _rows_of(difference, rows, float(weight))

    each_strip(work, plane)


def _rows_of(difference: Any, rows: slice, weight: float = 1.0) -> Array:
    """Some rows of a difference, times a weight, as a new array."""
    if isinstance(difference, Short):
        return difference.rows(rows, weight)
    return difference[rows, :] * weight


def _least(gram: Any) -> Any:
    """Weights, which sum to 1, of the shortest combination of vectors with that Gram matrix."""
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
    stride = _stride(plane)
    return namespace(plane).asarray(plane[::stride, ::stride], copy=True)


def _stride(plane: Array) -> int:
    return 1 if plane.shape[0] * plane.shape[1] <= _SMALL else _STRIDE
