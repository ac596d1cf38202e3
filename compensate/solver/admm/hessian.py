"""The Hessian of what is seen: exact in Fourier, a small matrix for each frequency and view.

With w the change of what is seen and A = lambda, f(w) = 1/2 ||A (w + t)||² has the Hessian

    H_0(f) = A'A = sum_c Omega_c(f)² t_c t_c'         t_c: row c of the opponent transform T

for the primaries of each view. Nothing of it is stored: it costs less to build and solve these
systems, strip by strip in the cache, than to fetch them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any, TypeAlias, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from compensate.fourier import Fourier
from compensate.solver.admm.fused import loops, parts, parts_or_zero
from compensate.weighting import CsfWeighting
from domesim.light import Array, namespace, on_host, total
from domesim.light.strips import in_parts

Planes: TypeAlias = list[Array]
"""One (padded row, padded col) array for each primary of each view."""

Spectra: TypeAlias = list[Array]
"""One (padded row, padded col // 2 + 1) complex array a plane."""

T = TypeVar("T")

_LEAST_IMPORTANCE = 0.05  # of the largest one's
_LEAST_CURVATURE, _MOST_CURVATURE = 1e-3, 0.1  # to a certificate, with weights of peak 1


def each_strip(work: Callable[[slice], T], plane: Array) -> list[T]:
    """`work(rows)` for strips of a plane's rows; for all rows at once but in NumPy."""
    return in_parts(lambda _, strip: work(strip), (1, *plane.shape), plane)


class Hessian(ABC):
    """H_0 on padded planes, one for each primary of each view.

    Attributes
    ----------
    fourier
        The padded grid's transforms.
    metric
        (plane,) diagonal metric P: about the root of diag(T'T).
    squares
        Omega_c² of each channel.
    strength
        How much pollution amplifies light at most; 1 without any.
    """

    fourier: Fourier
    metric: tuple[float, ...]
    squares: Sequence[Array]
    strength: float

    @abstractmethod
    def solve(self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None = None) -> None:
        """Turn `spectra` into (H_0 + diag(sigma))^-1 (spectra + plus), in place.

        Parameters
        ----------
        spectra
            Will be the solution.
        sigma
            (plane,) > 0.
        plus
            Added to `spectra` first.
        """

    @abstractmethod
    def seen(self, residual: Spectra) -> tuple[float, Spectra]:
        """||A r||², and f's gradient there, of the seen residual r whose spectra are used up."""

    @abstractmethod
    def energy(self, spectra: Spectra) -> float:
        """<w, H_0 w> of the planes w whose spectra these are."""

    @abstractmethod
    def _coarser(self, squares: Sequence[Array]) -> Hessian:
        """Builds `coarser` from its Omega_c²."""

    @cached_property
    def weights(self) -> float:
        """Sum of the first channel's Omega²."""
        return float(total(self.squares[0]))

    @cached_property
    def curvature(self) -> float:
        """Typical curvature h of the quadratic, as a certificate takes it."""
        median = float(np.median(on_host(self.squares[0][::8, ::8])))
        return min(max(median, _LEAST_CURVATURE), _MOST_CURVATURE)

    @cached_property
    def coarser(self) -> Hessian:
        """The same on planes of half the rows and columns."""
        # Channels of one sensitivity stay one
        halves = {id(square): halved_spectrum(square) for square in self.squares}
        return self._coarser([halves[id(square)] for square in self.squares])

    def dot(self, left: Spectra, right: Spectra) -> float:
        """<l, r> of the planes whose spectra these are."""

        def work(rows: slice) -> float:
            pairs = zip(left, right, strict=True)
            return sum(self.fourier.dot(a[rows, :], b[rows, :]) for a, b in pairs)

        return sum(each_strip(work, left[0]))


@final
class ViewsHessian(Hessian):
    """Hessian of views that are seen by themselves: whatever is not in w mixes no frequencies.

    Parameters
    ----------
    weighting
        Weighting of the seen views.
    squares
        Omega_c² as arrays of the planes' library.
    fourier
        The padded grid's transforms.
    """

    strength = 1.0

    def __init__(self, weighting: CsfWeighting, squares: Sequence[Array], fourier: Fourier) -> None:
        self.fourier, self.squares, self._weighting = fourier, squares, weighting
        opponent = weighting.opponent
        self._blocks = [
            Blocks(squares, float(each) * outer_products(opponent)) for each in weighting.importance
        ]
        # A penalty goes with what it is added to, but a view that does not count needs one as well
        counts = np.maximum(weighting.importance, _LEAST_IMPORTANCE * max(weighting.importance))
        self.metric = tuple(
            float(count) * value for count in counts for value in metric_of(opponent)
        )

    def solve(self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None = None) -> None:
        """See `Hessian`."""
        for part, blocks in self._views():
            blocks.solve(spectra[part], sigma[part], None if plus is None else plus[part])

    def seen(self, residual: Spectra) -> tuple[float, Spectra]:
        """See `Hessian`."""
        return self._product(residual, keep=False), residual

    def energy(self, spectra: Spectra) -> float:
        """See `Hessian`."""
        return self._product(spectra, keep=True)

    def _product(self, spectra: Spectra, *, keep: bool) -> float:
        """<w, H_0 w>; H_0 w takes w's place unless `keep` is set."""
        energy = 0.0
        for part, blocks in self._views():
            planes = spectra[part]

            def work(rows: slice, planes: Spectra = planes, blocks: Blocks = blocks) -> float:
                strip = [plane[rows, :] for plane in planes]
                images = blocks.times(rows, strip)
                found = sum(self.fourier.dot(a, b) for a, b in zip(strip, images, strict=True))
                if not keep:
                    for plane, image in zip(planes, images, strict=True):
                        plane[rows, :] = image
                return found

            energy += sum(each_strip(work, planes[0]))
        return energy

    def _views(self) -> Iterator[tuple[slice, Blocks]]:
        for view, blocks in enumerate(self._blocks):
            yield slice(view * blocks.size, (view + 1) * blocks.size), blocks

    def _coarser(self, squares: Sequence[Array]) -> ViewsHessian:
        return ViewsHessian(self._weighting, squares, self.fourier.coarser())


@final
class Blocks:
    """The matrices sum_c Omega_c² K_c, one for each frequency.

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
    def compiles(self) -> bool:
        """Whether the compiled loops take them: three planes, and at most as many channels."""
        return self.size == 3 and len(self.squares) <= 3

    @property
    def three_squares(self) -> tuple[Array, ...]:
        """`squares`, repeated to three for the compiled loops; see `coefficients`."""
        return tuple((self.squares * 3)[:3])

    @cached_property
    def coefficients(self) -> Any:
        """(3, plane, plane) matrices of `three_squares`; those of repeated squares are 0."""
        result = np.zeros((3, self.size, self.size), self.squares[0].dtype)
        result[: len(self.matrices)] = self.matrices
        return result

    def solve(self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None = None) -> None:
        """See `Hessian.solve`."""
        if self.compiles and (compiled := loops(*spectra)):
            added = parts_or_zero(plus, spectra)
            numbers = self.coefficients, np.asarray(sigma, self.coefficients.dtype)
            compiled.blocks3(*parts(spectra), added, self.three_squares, *numbers)
            return

        def work(rows: slice) -> None:
            strip = [plane[rows, :] for plane in spectra]
            if plus is not None:
                strip = [a + b[rows, :] for a, b in zip(strip, plus, strict=True)]
            for plane, value in zip(spectra, self.solved(rows, strip, sigma), strict=True):
                plane[rows, :] = value

        each_strip(work, spectra[0])

    def solved(self, strip: slice, spectra: Sequence[Array], sigma: Sequence[float]) -> list[Array]:
        """(H_0 + diag(sigma))^-1 of a strip of rows, by its LDL' factors."""
        return _substituted(self._factors(strip, sigma), spectra)

    def times(self, strip: slice, spectra: Sequence[Array]) -> list[Array]:
        """H_0 of a strip of rows."""
        squares = [square[strip, :] for square in self.squares]
        return [
            _sum(
                self._entry(squares, i, j, 0.0) * spectra[j]
                for j in range(self.size)
                if np.any(self.matrices[:, i, j] != 0)
            )
            for i in range(self.size)
        ]

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
    """Solves L D L' y = spectra for y."""
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


def _sum(terms: Any) -> Any:
    result = None
    for term in terms:
        result = term if result is None else result + term
    return result


def outer_products(opponent: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """(channel, primary, primary) t_c t_c'."""
    return np.stack([np.outer(row, row) for row in opponent])


def metric_of(opponent: NDArray[np.floating[Any]]) -> tuple[float, ...]:
    """(primary,) P: the root of the diagonal of T'T, 1 at most."""
    diagonal = np.sqrt(np.sum(opponent**2, axis=0))
    return tuple(float(value) for value in diagonal / diagonal.max())


def penalty_of(typical: float, share: float) -> float:
    """The penalty that goes with a spectrum whose median Omega² is `typical`.

    It is `share` times the geometric mean of `typical` and the largest Omega², 1; where most
    frequencies are seen, it is 3/2 of `typical`.
    """
    return max(1.5 * typical, share * math.sqrt(typical))


def halved_spectrum(plane: Array) -> Array:
    """Low frequencies of a (row, col // 2 + 1) spectrum: those of planes of half the size."""
    rows, cols = plane.shape
    keep, quarter = (cols - 1) // 2 + 1, rows // 4
    xp = namespace(plane)
    return xp.concat([plane[:quarter, :keep], plane[rows - quarter :, :keep]])
