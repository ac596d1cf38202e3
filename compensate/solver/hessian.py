"""The Hessian of a problem in Fourier: what ADMM needs of it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.fourier import Fourier
from compensate.solver.blocks import Blocks, Spectra, each_strip
from compensate.solver.fused import loops, parts, parts_or_zero
from compensate.weighting import CsfWeighting
from domesim.light import Array, namespace, on_host, total


class Hessian(ABC):
    """H_0 = C' A'A C on padded planes, one for each primary of each view.

    Attributes
    ----------
    fourier
        The padded grid's transforms.
    metric
        (plane,) diagonal metric P.
    adapted
        Whether it is to each plane's spectrum: the penalty rho is 1 then.
    strength
        How much pollution amplifies light at most; 1 without any.
    """

    fourier: Fourier
    metric: tuple[float, ...]
    adapted: bool = False
    strength: float

    @abstractmethod
    def solve(self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None = None) -> None:
        """(H_0 + diag(sigma))^-1 of `spectra`, and of what is to be added, in place.

        Parameters
        ----------
        spectra
            Will be the solution.
        sigma
            (plane,) > 0; the same for all views.
        plus
            Added to `spectra` first.
        """

    @abstractmethod
    def multiply(self, spectra: Spectra) -> None:
        """H_0 of `spectra`, in place."""

    @abstractmethod
    def seen(self, residual: Spectra) -> tuple[float, Spectra]:
        """||A r||² and C'A'A r of the seen planes r whose spectra these are (they are used up)."""

    @abstractmethod
    def energy(self, spectra: Spectra) -> float:
        """<w, H_0 w> of the planes w whose spectra these are."""

    @property
    @abstractmethod
    def squares(self) -> Sequence[Array]:
        """Omega_c² of each channel."""

    @abstractmethod
    def _coarser(self, squares: Sequence[Array]) -> Hessian:
        """`coarser`, with its Omega_c²."""

    @cached_property
    def weights(self) -> float:
        """Sum of the first channel's Omega²."""
        return float(total(self.squares[0]))

    @cached_property
    def curvature(self) -> float:
        """What is typical of the quadratic's, to a certificate."""
        return min(max(_median(self.squares[0]), _LEAST_CURVATURE), _MOST_CURVATURE)

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


_LEAST_CURVATURE, _MOST_CURVATURE = 1e-3, 0.1  # to a certificate, with weights of peak 1
_LEAST_METRIC, _LOW_METRIC = 0.02, 0.1  # of an adapted metric, and of what is seen so far


@final
class PairHessian(Hessian):
    """Of two views: 6 x 6 matrices, or two of 3 x 3 where both directions leak alike.

    Parameters
    ----------
    central
        (seen view, primary, view, primary) C of every pixel.
    weighting
        Of the seen views.
    squares
        Omega_c² as arrays of the planes' library.
    fourier
        The padded grid's transforms.
    """

    def __init__(
        self,
        central: NDArray[np.floating[Any]],
        weighting: CsfWeighting,
        squares: Sequence[Array],
        fourier: Fourier,
    ) -> None:
        self.fourier = fourier
        self._arguments = central, weighting, squares
        seen, primaries = central.shape[:2]
        leak = central.reshape(-1, 2, primaries, 2, primaries).copy()
        for view in range(2):
            leak[:, view, :, view] -= np.eye(primaries)
        self.strength = 1 + float(
            max(np.linalg.norm(part.reshape(2 * primaries, -1), 2) for part in leak)
        )
        self.metric = 2 * metric_of(weighting.opponent)
        matrices = np.zeros((len(squares), 2 * primaries, 2 * primaries))
        for view in range(seen):
            mixing = central[view].reshape(primaries, 2 * primaries)
            for c, row in enumerate(weighting.opponent):
                matrices[c] += weighting.importance[view] * np.outer(row @ mixing, row @ mixing)
        turn = np.kron(np.array([[1, 1], [1, -1]]) / np.sqrt(2), np.eye(primaries))
        turned = turn @ matrices @ turn.T
        self._summed = bool(
            np.abs(turned[:, :primaries, primaries:]).max() <= 1e-9 * np.abs(turned).max()
        )
        self._parts = [slice(0, 2 * primaries)]
        if self._summed:
            matrices = turned
            self._parts = [slice(0, primaries), slice(primaries, 2 * primaries)]
        self._blocks = [Blocks(squares, matrices[:, part, part]) for part in self._parts]

    def solve(self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None = None) -> None:
        """See `Hessian`."""
        channels = len(self._blocks[0].squares)
        fits = (len(sigma), channels) == (2, 1) or (len(sigma) == 6 and channels <= 3)
        if self._summed and fits and (compiled := loops(*spectra)):
            real, added = parts(spectra), parts_or_zero(plus, spectra)
            sums, differences = (blocks.coefficients for blocks in self._blocks)
            given = np.asarray(sigma[: len(sigma) // 2], sums.dtype)
            if len(sigma) == 2:
                matrices = sums[0, 0, 0], differences[0, 0, 0], given[0]
                compiled.pair1(*real, added, self._blocks[0].squares[0], *matrices)
            else:
                squares = self._blocks[0].three_squares
                compiled.pair3(*real, added, squares, sums, differences, given)
            return

        def work(rows: slice) -> None:
            turned = self._turned(strip_of(spectra, rows, plus))
            done = [
                plane
                for part, blocks in zip(self._parts, self._blocks, strict=True)
                for plane in blocks.solved(rows, turned[part], sigma[part])
            ]
            self._put(spectra, rows, done)

        each_strip(work, spectra[0])

    def multiply(self, spectra: Spectra) -> None:
        """H_0 of `spectra`."""

        def work(rows: slice) -> None:
            turned = self._turned([plane[rows, :] for plane in spectra])
            done = [
                plane
                for part, blocks in zip(self._parts, self._blocks, strict=True)
                for plane in blocks.times(rows, turned[part])
            ]
            self._put(spectra, rows, done)

        each_strip(work, spectra[0])

    @property
    def squares(self) -> Sequence[Array]:
        """See `Hessian`."""
        return self._arguments[2]

    def seen(self, residual: Spectra) -> tuple[float, Spectra]:
        """||A r||² and C'A'A r of residuals r, all primaries of one seen view after the other."""
        central, weighting, squares = self._arguments
        seen, primaries = central.shape[:2]
        planes = 2 * primaries
        xp = namespace(residual[0])
        result = residual[:planes] if seen == 2 else [xp.empty_like(r) for r in residual[:planes]]
        mixing = central.reshape(seen * primaries, planes)
        importance = np.repeat(weighting.importance, primaries)

        def work(rows: slice) -> float:
            energy, back = 0.0, []
            for view in range(seen):
                part = slice(view * primaries, (view + 1) * primaries)
                strip = [plane[rows, :] for plane in residual[part]]
                weighted = weighed(strip, weighting.opponent, squares, rows)
                energy += float(weighting.importance[view]) * sum(
                    self.fourier.dot(a, b) for a, b in zip(strip, weighted, strict=True)
                )
                back += weighted
            for plane, weights in zip(result, (importance[:, None] * mixing).T, strict=True):
                plane[rows, :] = combined(back, weights)
            return energy

        return sum(each_strip(work, residual[0])), result

    def energy(self, spectra: Spectra) -> float:
        """<w, H_0 w>."""
        share = 0.5 if self._summed else 1.0

        def work(rows: slice) -> float:
            turned = self._turned([plane[rows, :] for plane in spectra])
            return share * sum(
                self.fourier.dot(plane, image)
                for part, blocks in zip(self._parts, self._blocks, strict=True)
                for plane, image in zip(turned[part], blocks.times(rows, turned[part]), strict=True)
            )

        return sum(each_strip(work, spectra[0]))

    def _coarser(self, squares: Sequence[Array]) -> PairHessian:
        central, weighting, _ = self._arguments
        return PairHessian(central, weighting, squares, self.fourier.coarser())

    def _turned(self, planes: list[Array]) -> list[Array]:
        if not self._summed:
            return planes
        half = len(planes) // 2
        left, right = planes[:half], planes[half:]
        pairs = list(zip(left, right, strict=True))
        return [a + b for a, b in pairs] + [a - b for a, b in pairs]

    def _put(self, spectra: Spectra, rows: slice, planes: list[Array]) -> None:
        if self._summed:
            planes = [0.5 * plane for plane in self._turned(planes)]
        for spectrum, plane in zip(spectra, planes, strict=True):
            spectrum[rows, :] = plane


def strip_of(spectra: Spectra, rows: slice, plus: Spectra | None) -> list[Array]:
    """Rows of spectra, with others added if there are any."""
    if plus is None:
        return [plane[rows, :] for plane in spectra]
    return [a[rows, :] + b[rows, :] for a, b in zip(spectra, plus, strict=True)]


def weighed(
    strip: Sequence[Array],
    opponent: NDArray[np.floating[Any]],
    squares: Sequence[Array],
    rows: slice,
) -> list[Array]:
    """A'A = T' Omega² T of a strip of the primaries' spectra."""
    channels = [
        combined(strip, weights) * square[rows, :]
        for weights, square in zip(opponent, squares, strict=True)
    ]
    return mixed(opponent.T, channels)


def combined(planes: Sequence[Array], weights: Any) -> Array:
    """The sum of planes times weights."""
    result = planes[0] * float(weights[0])
    for plane, weight in zip(planes[1:], weights[1:], strict=True):
        if weight:
            result += plane * float(weight)
    return result


def mixed(matrix: NDArray[np.floating[Any]], planes: Sequence[Array]) -> list[Array]:
    """A matrix times planes."""
    return [combined(planes, weights) for weights in matrix]


def metric_of(opponent: NDArray[np.floating[Any]]) -> tuple[float, ...]:
    """(primary,) P: the root of the diagonal of T'T, 1 at most."""
    diagonal = np.sqrt(np.sum(opponent**2, axis=0))
    return tuple(float(value) for value in diagonal / diagonal.max())


def adapted_metric(squares: Sequence[Array]) -> tuple[float, ...]:
    """(channel,) P of planes that are channels: the root of the least Omega_c² that matters.

    Alternating directions go best with the geometric mean of the least and the largest curvature,
    and that is about 1. The least is the lowest frequency's; where most frequencies are hardly
    seen, the median's is better, as with one penalty for all.
    """

    def one(square: Array) -> float:
        lowest = math.sqrt(float(square[0, 0]))
        usual = penalty_of(_median(square), 0.5)
        return min(max(usual, _LEAST_METRIC), max(lowest, _LOW_METRIC))

    return tuple(one(square) for square in squares)


def _median(square: Array) -> float:
    return float(np.median(on_host(square[::8, ::8])))


def penalty_of(typical: float, share: float) -> float:
    """The penalty that goes with a spectrum whose median Omega² is `typical`.

    The geometric mean of that and the largest, 1, times a `share`; where most frequencies are
    seen, 3/2 of it.
    """
    return max(1.5 * typical, share * math.sqrt(typical))


def halved_spectrum(plane: Array) -> Array:
    """The low frequencies of (row, col // 2 + 1): those that planes of half the size have."""
    rows, cols = plane.shape
    keep, quarter = (cols - 1) // 2 + 1, rows // 4
    xp = namespace(plane)
    return xp.concat([plane[:quarter, :keep], plane[rows - quarter :, :keep]])


def halved(plane: Array) -> Array:
    """(row, col) to half as many rows and columns: means of 2 x 2."""
    xp = namespace(plane)
    rows, cols = plane.shape
    result = xp.empty((rows // 2, cols // 2), dtype=plane.dtype, device=plane.device)

    def work(strip: slice) -> None:
        across = plane[2 * strip.start : 2 * strip.stop, :]
        across = across[::2, :] + across[1::2, :]
        result[strip, :] = 0.25 * (across[:, ::2] + across[:, 1::2])

    each_strip(work, result)
    return result
