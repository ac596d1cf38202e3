"""Small symmetric matrices, one for each frequency: what is left of the problem in Fourier.

With the planes of a problem stacked, its Hessian at the frequency f is

    H_0(f) = sum_c Omega_c(f)² K_c

with a small symmetric matrix K_c for each opponent channel. Nothing of it is stored: it costs less
to build and solve the few by few systems, strip by strip in the cache, than to fetch them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any, TypeAlias, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from domesim.light import Array
from domesim.strips import in_parts

Spectra: TypeAlias = list[Array]
"""One (padded row, padded col // 2 + 1) complex array a plane."""

T = TypeVar("T")


@final
class Blocks:
    """sum_c Omega_c² K_c.

    Parameters
    ----------
    squares
        (padded row, padded col // 2 + 1) Omega_c², one a channel.
    matrices
        (channel, plane, plane) K_c, symmetric.
    """

    def __init__(self, squares: Sequence[Array], matrices: NDArray[np.floating[Any]]) -> None:
        # Channels of one sensitivity are one
        self.squares: list[Array] = []
        kept: list[Any] = []
        for square, matrix in zip(squares, matrices, strict=True):
            for k, other in enumerate(self.squares):
                if other is square:
                    kept[k] = kept[k] + matrix
                    break
            else:
                self.squares.append(square)
                kept.append(matrix)
        self.matrices = np.stack(kept)
        self.size = self.matrices.shape[1]

    @property
    def three_squares(self) -> tuple[Array, ...]:
        """`squares`, three of them, for the compiled loops; see `coefficients`."""
        return tuple((self.squares * 3)[:3])

    @cached_property
    def coefficients(self) -> Any:
        """(3, plane, plane) matrices of `three_squares`: 0 for those that are there again."""
        result = np.zeros((3, self.size, self.size), self.squares[0].dtype)
        result[: len(self.matrices)] = self.matrices
        return result

    def solved(self, strip: slice, spectra: Sequence[Array], sigma: Sequence[float]) -> list[Array]:
        """(H_0 + diag(sigma))^-1 of a strip of rows, by its LDL' factors."""
        return _substituted(self._factors(strip, sigma), spectra)

    def times(self, strip: slice, spectra: Sequence[Array]) -> list[Array]:
        """H_0 of a strip of rows."""
        return list(self.each_times(strip, spectra))

    def each_times(self, strip: slice, spectra: Sequence[Array]) -> Iterator[Array]:
        """`times`, plane by plane."""
        squares = [square[strip, :] for square in self.squares]
        for i in range(self.size):
            yield _sum(
                self._entry(squares, i, j, 0.0) * spectra[j]
                for j in range(self.size)
                if np.any(self.matrices[:, i, j] != 0)
            )

    def _factors(self, strip: slice, sigma: Sequence[float]) -> tuple[list[list[Any]], list[Any]]:
        """L (below the diagonal; None for 0) and 1 / D of H_0 + diag(sigma), for a strip."""
        squares = [square[strip, :] for square in self.squares]
        lower: list[list[Any]] = [[None] * self.size for _ in range(self.size)]
        inverse: list[Any] = []
        scaled: list[list[Any]] = [[None] * self.size for _ in range(self.size)]  # L D
        for j in range(self.size):
            pivot = self._entry(squares, j, j, float(sigma[j]))
            for m in range(j):
                if lower[j][m] is not None:
                    pivot = pivot - lower[j][m] * scaled[j][m]
            inverse.append(1 / pivot)
            for i in range(j + 1, self.size):
                entry = None
                if np.any(self.matrices[:, i, j] != 0):
                    entry = self._entry(squares, i, j, 0.0)
                for m in range(j):
                    if lower[i][m] is not None and scaled[j][m] is not None:
                        term = lower[i][m] * scaled[j][m]
                        entry = -term if entry is None else entry - term
                scaled[i][j] = entry
                lower[i][j] = None if entry is None else entry * inverse[j]
        return lower, inverse

    def _entry(self, squares: Sequence[Array], i: int, j: int, plus: float) -> Array:
        """One entry of H_0, with `plus` added."""
        terms = [
            (float(weight), square)
            for weight, square in zip(self.matrices[:, i, j], squares, strict=True)
            if weight != 0
        ]
        if not terms:
            return squares[0] * 0 + plus
        result = terms[0][1] * terms[0][0]
        for weight, square in terms[1:]:
            result += square * weight
        if plus:
            result += plus
        return result


def _substituted(
    factors: tuple[list[list[Any]], list[Any]], spectra: Sequence[Array]
) -> list[Array]:
    """What solves L D L' y = spectra."""
    lower, inverse = factors
    size = len(inverse)
    y = list(spectra)
    for i in range(size):
        for j in range(i):
            if lower[i][j] is not None:
                y[i] = y[i] - lower[i][j] * y[j]
    y = [plane * pivot for plane, pivot in zip(y, inverse, strict=True)]
    for j in reversed(range(size)):
        for i in range(j):
            if lower[j][i] is not None:
                y[i] -= lower[j][i] * y[j]
    return y


def each_strip(work: Callable[[slice], T], plane: Array) -> list[T]:
    """`work(rows)` for strips of a plane's rows; for all rows at once but in NumPy."""
    return in_parts(lambda _, strip: work(strip), (1, *plane.shape), plane)


def _sum(terms: Any) -> Any:
    result = None
    for term in terms:
        result = term if result is None else result + term
    return result
