"""The Hessian of what is seen, and its inverse: exact in Fourier.

With w the change of what is seen in its own place (`pixels`) and A = lambda, the objective is
1/2 ||A (C w + t)||², where C = 1 without reflections. On the padded plane, W = A'A is a small
matrix for each frequency and view,

    W(f) = sum_c Omega_c(f)² t_c t_c'             t_c: row c of the opponent transform T

*A theatre that reflects* adds a few modes of light, C = 1 + U K V', with K between planes and
modes. With B = W + sigma, diagonal in Fourier,

    H + sigma = C' W C + sigma = B + Z M Z'       Z = [V, W U K],   M = [[K'U'W U K, 1], [1, 0]]

and the Sherman-Morrison-Woodbury formula inverts it with one small system, M^-1 + Z'B^-1 Z. In it
W B^-1 = 1 - sigma B^-1 leaves inner products of U and V with B^-1 between.

The paper uses the circulant structure for products [Vogel 2002]; here it gives the inverse.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias, final

import numpy as np
import scipy

from compensate.problem import Problem
from compensate.solver.kinds import DomePair, Kind, kind_of, parts_of
from compensate.weighting import CsfWeighting
from domesim.light import Array, namespace, on_host

Spectra: TypeAlias = Array
"""(plane, padded row, padded col // 2 + 1) complex; planes are all primaries of view after view."""

_LEAST_IMPORTANCE = 0.05  # of the largest one's
_LEAST_CURVATURE, _MOST_CURVATURE = 1e-3, 0.1  # to a certificate, with weights of peak 1


class Modes(NamedTuple):
    """Reflected light U K V', in w.

    Attributes
    ----------
    spread, collect
        (mode, padded row, padded col // 2 + 1) spectra of U and V.
    core
        (plane x mode, plane x mode) K.
    """

    spread: Array
    collect: Array
    core: Any


@final
class Hessian:
    """H = C'WC on padded planes.

    Parameters
    ----------
    weighting
        Weighting of what is seen.
    like
        Arrays are made like this one.
    modes
        Reflected light; None for none.

    Attributes
    ----------
    fourier
        The padded grid's transforms.
    metric
        (plane,) diagonal metric P: about the root of the diagonal of T'T.
    curvature
        Typical curvature h of the quadratic, as a certificate takes it.
    strength
        ||C||: how much reflections amplify light at most.
    """

    def __init__(self, weighting: CsfWeighting, like: Array, modes: Modes | None = None) -> None:
        self.fourier, self._squares = weighting.fourier, weighting.squares(like)
        self._opponent, self._importance = weighting.opponent, weighting.importance
        size = self._opponent.shape[1]
        self._views = [slice(p, p + size) for p in range(0, size * len(self._importance), size)]
        diagonal = np.sqrt(np.sum(self._opponent**2, axis=0))
        # A penalty goes with what it is added to, but a view that does not count needs one as well
        counts = np.maximum(self._importance, _LEAST_IMPORTANCE * self._importance.max())
        self.metric: list[float] = np.outer(counts, diagonal / diagonal.max()).ravel().tolist()
        median = float(np.median(on_host(self._squares[0])))
        self.curvature = min(max(median, _LEAST_CURVATURE), _MOST_CURVATURE)
        self._inverses: dict[tuple[float, ...], Array] = {}
        self._small: dict[tuple[float, ...], Any] = {}
        self._modes = modes
        self.strength = 1.0
        if modes is not None:
            uu, vv = (self._between(None, m, m) for m in (modes.spread, modes.collect))
            amplified = np.linalg.eigvals(modes.core.T @ uu @ modes.core @ vv)
            self.strength += float(np.sqrt(np.abs(amplified).max()))

    def solve(self, spectra: Spectra, sigma: Sequence[float]) -> Spectra:
        """Returns (H + diag(sigma))^-1 of spectra, for a (plane,) sigma > 0."""
        solved = self._blocks_solved(spectra, sigma)
        if self._modes is None:
            return solved
        known = [self._dots(self._modes.collect, solved), self._dots_of_second(solved)]
        c, e = np.split(self._small_inverse(tuple(sigma)) @ np.concatenate(known), 2)
        second = self._weighted(self._combined(self._modes.spread, self._modes.core @ e))
        return solved - self._blocks_solved(self._combined(self._modes.collect, c) + second, sigma)

    def energy(self, spectra: Spectra) -> float:
        """Returns <w, H w> of the planes w whose spectra these are."""
        if self._modes is not None:
            excited = self._modes.core @ self._dots(self._modes.collect, spectra)
            spectra = spectra + self._combined(self._modes.spread, excited)
        return self.fourier.dot(spectra, self._weighted(spectra))

    def seen(self, residual: Spectra) -> tuple[float, Spectra]:
        """Returns ||A r||² and half of its gradient, C'W r, of spectra of a seen residual r."""
        gradient = self._weighted(residual)
        energy = self.fourier.dot(residual, gradient)
        if self._modes is not None:
            back = self._modes.core.T @ self._dots(self._modes.spread, gradient)
            gradient = gradient + self._combined(self._modes.collect, back)
        return energy, gradient

    def _weighted(self, spectra: Spectra) -> Spectra:
        """W of spectra."""
        planes = []
        for view, importance in zip(self._views, self._importance, strict=True):
            channels = sums(self._opponent, planes_in(spectra[view, ...]))
            weighted = [a * square for a, square in zip(channels, self._squares, strict=True)]
            planes += sums(float(importance) * self._opponent.T, weighted)
        return namespace(spectra).stack(planes)

    def _blocks_solved(self, spectra: Spectra, sigma: Sequence[float]) -> Spectra:
        """(W + diag(sigma))^-1 of spectra."""
        planes: list[Array] = []
        for view, importance in zip(self._views, self._importance, strict=True):
            inverse = self._inverse(float(importance), tuple(sigma[view]))
            part = spectra[view, ...]
            size = range(part.shape[0])
            planes += (
                sum((inverse[p, q, ...] * part[q, ...] for q in size), start=0 * part[p, ...])
                for p in size
            )
        return namespace(spectra).stack(planes)

    def _inverse(self, importance: float, sigma: tuple[float, ...]) -> Array:
        """(primary, primary, row, col) inverse of a view's W + diag(sigma); kept."""
        key = (importance, *sigma)
        if key not in self._inverses:
            self._inverses[key] = self._inverted(importance, sigma)
        return self._inverses[key]

    def _inverted(self, importance: float, sigma: Sequence[float]) -> Array:
        xp, size = namespace(self._squares[0]), len(sigma)
        products = np.einsum("ci,cj->ijc", self._opponent, self._opponent).reshape(size**2, -1)
        entries = sums(importance * products, self._squares)
        matrix = xp.reshape(xp.stack(entries), (size, size, *entries[0].shape))
        for k in range(size):
            matrix[k, k, ...] += float(sigma[k])
        for k in range(size):  # sweeps: they turn it into minus its inverse
            column = xp.asarray(matrix[:, k, ...], copy=True)
            row = column / column[k, ...]
            matrix -= column[:, None, ...] * row[None, ...]
            matrix[k, ...], matrix[:, k, ...] = row, row
            matrix[k, k, ...] = -1 / column[k, ...]
        return -matrix

    def _dots(self, modes: Array, spectra: Spectra) -> Any:
        """(plane x mode,) inner products of spectra with modes."""
        planes, count = range(spectra.shape[0]), range(modes.shape[0])
        return np.array(
            [self.fourier.dot(modes[k, ...], spectra[p, ...]) for p in planes for k in count]
        )

    def _dots_of_second(self, spectra: Spectra) -> Any:
        """K'U'W of spectra."""
        assert self._modes is not None
        return self._modes.core.T @ self._dots(self._modes.spread, self._weighted(spectra))

    def _combined(self, modes: Array, coefficients: Any) -> Spectra:
        """Spectra of modes times (plane x mode,) coefficients."""
        xp = namespace(modes)
        return xp.stack(sums(coefficients.reshape(-1, modes.shape[0]), planes_in(modes)))

    def _small_inverse(self, sigma: tuple[float, ...]) -> Any:
        """Inverse of M^-1 + Z'B^-1 Z; M^-1 = [[0, 1], [1, -K'U'W U K]]."""
        if sigma not in self._small:
            assert self._modes is not None
            spread, collect, core = self._modes
            s = np.diag(np.repeat(sigma, spread.shape[0]))
            vv, vu, uu = (
                self._between(sigma, *modes)
                for modes in ((collect, collect), (collect, spread), (spread, spread))
            )
            upper = (self._between(None, collect, spread) - vu @ s) @ core
            # -K'U'W U K of M^-1 and K'U'W U K of Z'B^-1 Z cancel
            corner = core.T @ (s @ uu @ s - s @ self._between(None, spread, spread)) @ core
            one = np.eye(len(core))
            self._small[sigma] = np.linalg.inv(
                np.block([[vv, one + upper], [one + upper.T, corner]])
            )
        return self._small[sigma]

    def _between(self, sigma: tuple[float, ...] | None, left: Array, right: Array) -> Any:
        """(plane x mode, plane x mode) left' B^-1 right of modes; left' right without a sigma."""
        xp = namespace(left)
        count, size = left.shape[0], self._opponent.shape[1]
        flat = [xp.reshape(modes, (count, -1)) for modes in (left * self._counted(left), right)]
        turned = xp.conj(flat[1]).T

        def product(weights: Array | float) -> Any:
            weighted = flat[0] * (
                weights if isinstance(weights, float) else xp.reshape(weights, (1, -1))
            )
            return np.asarray(on_host(xp.real(xp.matmul(weighted, turned))), np.float64)

        blocks = []
        for view, importance in zip(self._views, self._importance, strict=True):
            if sigma is None:
                blocks.append(np.kron(np.eye(size), product(1.0)))
                continue
            inverse = self._inverse(float(importance), sigma[view])
            blocks.append(
                np.block([[product(inverse[p, q, ...]) for q in range(size)] for p in range(size)])
            )
        return scipy.linalg.block_diag(*blocks)

    def _counted(self, like: Array) -> Array:
        """(1, col) how often a column of half a spectrum counts, over the number of pixels."""
        cols = self.fourier.cols
        times = np.full(cols // 2 + 1, 2.0)
        times[[0, -1] if cols % 2 == 0 else [0]] = 1
        xp = namespace(like)
        dtype = xp.real(like[0, 0, :1]).dtype
        return xp.asarray(
            (times / (self.fourier.rows * cols))[None], dtype=dtype, device=like.device
        )


def planes_in(stack: Array) -> list[Array]:
    """The planes along the first axis."""
    return [stack[k, ...] for k in range(stack.shape[0])]


def sums(weights: Any, planes: Sequence[Array]) -> list[Array]:
    """Sums of planes, for each row of (sum, plane) weights."""
    return [
        sum((a * float(w) for w, a in zip(row, planes, strict=True)), start=0 * planes[0])
        for row in weights
    ]


def hessian_of(problem: Problem, weighting: CsfWeighting) -> Hessian:
    """The Hessian of a problem, which is kept for the next frame.

    Raises
    ------
    ValueError
        If its observation is neither a dome's of low rank nor a pair's, or the weighting has
        support where there is no screen.
    """
    observation: Any = problem.observation
    base: Any = problem.anchor
    kind = kind_of(observation)
    if kind not in (Kind.LOW_RANK, Kind.PIXELWISE, Kind.REFLECTED_PAIR):
        raise ValueError(f"ADMM takes domes of low rank and pairs, got {observation}")
    reflecting = None if kind is Kind.PIXELWISE else parts_of(observation) or observation
    return _hessian(reflecting, weighting, namespace(base), base.dtype, base.device)


@lru_cache(maxsize=2)
def _hessian(
    reflecting: Any, weighting: CsfWeighting, library: Any, dtype: Any, device: Any
) -> Hessian:
    like = library.zeros((1,), dtype=dtype, device=device)
    if reflecting is None:
        return Hessian(weighting, like)
    if isinstance(reflecting, DomePair):
        reflected, crosstalk = reflecting
        spread, collect, between = reflected.modes()
        mixed = np.kron(crosstalk.central.reshape(2 * between.shape[1], -1), np.eye(len(spread)))
        core = mixed @ between.reshape(len(mixed), -1) @ np.linalg.inv(mixed)
        screen, gain = reflected.screen, reflected.direct_gain
    else:
        factors = reflecting.factors
        spread, collect, gain = factors.spread, factors.collect, factors.direct_gain
        screen, core = reflecting.screen, scipy.linalg.block_diag(*factors.core)
    if bool(np.any(weighting.support & ~screen)):
        raise ValueError("the weighting's support reaches outside the observation's screen")
    rows, cols = weighting.support.shape
    planes = np.zeros((2, len(spread), *weighting.padded))
    # In w = D x, a pixel's light has passed D already
    planes[..., :rows, :cols] = spread, collect / np.where(gain == 0, 1, gain)
    planes[..., :rows, :cols] *= weighting.support
    spectra = weighting.fourier.forward(library.asarray(planes, dtype=dtype, device=device))
    return Hessian(weighting, like, Modes(spectra[0, ...], spectra[1, ...], core))
