"""A dome's problem for ADMM: its Hessian and that one's inverse, exact in Fourier.

The variable is w = D x, the light that the projector puts on the screen: a `Level` of planes that
are seen as they are. On the padded plane without bounds the objective is ``1/2 ||A (C w - t)||²``,
where A = lambda is diagonal in Fourier but for the mixing of primaries, W(f) = A'A =
T' Omega(f)² T, and C = I + U V' holds the low-rank pollution. So

    H = C' W C + sigma  =  B + Z M Z',     B(f) = W(f) + sigma,   sigma = diag(one a primary)
    Z = [V, W U],     M = [[U' W U, I], [I, 0]]

and the Sherman-Morrison-Woodbury formula inverts it with one small system. As W = B - sigma, all
products with Z need only U, V and B^-1:

    Z' B^-1 q       = [V' h,  U' (q - sigma h)],     h = B^-1 q
    B^-1 Z [c, e]   = B^-1 (V c - sigma U e) + U e

and so does the small system itself:

    V' B^-1 W U     = V' U - V' B^-1 sigma U
    U' W B^-1 W U   = U' W U - U' sigma U + U' sigma B^-1 sigma U

The paper uses the circulant structure for products [Vogel 2002]; here it gives the inverse.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.fourier import Fourier
from compensate.problem import Problem
from compensate.solver.admm.fused import loops, parts, parts_or_zero
from compensate.solver.admm.hessian import (
    Blocks,
    Hessian,
    Spectra,
    each_strip,
    metric_of,
    outer_products,
)
from compensate.solver.admm.level import Apart, Level
from compensate.solver.admm.planes import Split, planes_of, widths_of
from compensate.solver.admm.pyramid import halved
from compensate.weighting import CsfWeighting
from domesim.light import Array, Light, namespace, on_host
from domesim.observation.lowrank import LowRankObservation


def split_dome(problem: Problem, weighting: CsfWeighting) -> Split:
    """A dome's problem in w = D (x - x_a).

    Raises
    ------
    ValueError
        If the weighting has support where there is no screen.
    """
    observation: Any = problem.observation
    if bool(np.any(weighting.support & ~observation.screen)):
        raise ValueError("the weighting's support reaches outside the observation's screen")
    base: Any = problem.anchor
    direct, gain = observation.factors.direct_gain, None
    if not bool(np.all(direct == 1)):
        kept = np.where(direct == 0, 1, direct)[None, :, :, None]
        gain = namespace(base).asarray(kept, dtype=base.dtype, device=base.device)
    below = namespace(base).broadcast_to(problem.lower, base.shape) - base
    level = Level(
        hessian_of(observation, weighting, base),
        Apart(),
        problem.regularisation,
        planes_of(below if gain is None else below * gain),
        widths_of(problem, gain),
    )
    return Split(problem, level, gain)


def hessian_of(
    observation: LowRankObservation, weighting: CsfWeighting, like: Light
) -> DomeHessian:
    """The Hessian of w = D x of a theatre, in arrays like `like`; kept for the next frame."""
    return _hessian(observation, weighting, namespace(like), like.dtype, like.device)


@lru_cache(maxsize=2)
def _hessian(
    observation: LowRankObservation, weighting: CsfWeighting, library: Any, dtype: Any, device: Any
) -> DomeHessian:
    like = library.zeros((1, 1, 1, 1), dtype=dtype, device=device)
    factors, support, fourier = observation.factors, weighting.support, weighting.fourier

    def modes(planes: Any) -> Array:
        large = np.zeros((len(planes), fourier.rows, fourier.cols))
        large[:, : support.shape[0], : support.shape[1]] = planes * support
        return library.asarray(large, dtype=dtype, device=device)

    # In w = D x, a pixel's light has passed D already
    gain = np.where(factors.direct_gain == 0, 1, factors.direct_gain)
    return DomeHessian(
        modes(factors.spread),
        modes(factors.collect / gain),
        factors.core,
        weighting.opponent,
        weighting.squares(like),
        fourier,
    )


@final
class DomeHessian(Hessian):
    """Hessian of one view with low-rank pollution, on padded planes (primary).

    Parameters
    ----------
    spread, collect
        (mode, padded row, padded col) pollution's modes in w = D x, 0 off the picture.
    core
        (primary, mode, mode) how the modes excite each other.
    opponent
        (channel, primary) T.
    squares
        Omega_c² as arrays of the planes' library.
    fourier
        The padded grid's transforms.
    """

    def __init__(
        self,
        spread: Array,
        collect: Array,
        core: NDArray[np.floating[Any]],
        opponent: NDArray[np.floating[Any]],
        squares: Sequence[Array],
        fourier: Fourier,
    ) -> None:
        self.fourier = fourier
        self.core = core
        self._opponent, self.squares = opponent, squares
        self._blocks = Blocks(squares, outer_products(opponent))
        self.metric = metric_of(opponent)
        xp = namespace(spread)
        # V first, then the shapes of U
        self._shapes = fourier.forward(xp.concat([collect, spread]))
        half = np.full(fourier.cols // 2 + 1, 2.0)
        half[0] = 1
        if fourier.cols % 2 == 0:
            half[-1] = 1
        half /= fourier.rows * fourier.cols
        self._half = xp.asarray(half[None, :], dtype=spread.dtype, device=spread.device)
        self._pixels: tuple[Array, ...] = (spread, collect)
        self._small: dict[tuple[float, ...], Any] = {}

    @cached_property
    def strength(self) -> float:  # type: ignore[override]
        """1 + ||U V'||, the root of the largest eigenvalue of U'U V'V."""
        core = self._core_matrix()
        overlap = self._plain
        uu = core.T @ overlap["uu"] @ core
        return 1 + float(np.sqrt(np.abs(np.linalg.eigvals(uu @ overlap["vv"])).max()))

    def solve(self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None = None) -> None:
        """See `Hessian`."""
        modes = self.core.shape[-1]
        if compiled := self._compiled(spectra):
            asked, found = self._compiled_sums(compiled, spectra, plus, sigma)
        else:
            asked, found = self._solve_blocks(spectra, sigma, plus)
        damping = np.asarray(sigma)[:, None]
        v, u = found[:, :modes], asked - damping * found[:, modes:]
        known = np.stack([v, np.einsum("pjk,pj->pk", self.core, u)])
        c, e = (self._small_inverse(tuple(sigma)) @ known.ravel()).reshape(known.shape)
        e = np.einsum("pjk,pk->pj", self.core, e)
        if compiled:
            weights = np.stack([c, -damping * e, e])[:, :, 0].astype(self._numbers(sigma)[0].dtype)
            compiled.correct3(
                *parts(spectra), *self._shapes_and_squares, *self._numbers(sigma), weights
            )
            return
        asks, shows = np.concatenate([c, -damping * e], 1), np.concatenate([0 * c, e], 1)

        def correct(rows: slice) -> None:
            correction = self._blocks.solved(rows, self._combined(rows, asks), sigma)
            shown = self._combined(rows, shows)
            for plane, one, other in zip(spectra, correction, shown, strict=True):
                plane[rows, :] -= one + other

        each_strip(correct, spectra[0])

    def _compiled(self, spectra: Spectra) -> Any:
        """The compiled loops, or None if there are none for this problem."""
        fits = self._blocks.compiles and self.core.shape[-1] == 1
        return loops(*spectra) if fits else None

    @property
    def _shapes_and_squares(self) -> tuple[Any, ...]:
        """Arguments of the compiled loops: V and U of the only mode, and the squares."""
        return *parts([self._shapes[0], self._shapes[1]]), self._blocks.three_squares

    def _numbers(self, sigma: Sequence[float]) -> tuple[Any, Any]:
        coefficients = self._blocks.coefficients
        return coefficients, np.asarray(sigma, coefficients.dtype)

    def _compiled_sums(
        self, compiled: Any, spectra: Spectra, plus: Spectra | None, sigma: Sequence[float]
    ) -> tuple[Any, Any]:
        """Does what `_solve_blocks` does, by compiled loops."""
        fourier = self.fourier
        # How much the first and the last column count
        sums = np.zeros((fourier.rows, 9))
        sums[:, 0], sums[:, 1] = 1, 1 if fourier.cols % 2 == 0 else 2
        added = parts_or_zero(plus, spectra)
        given = *self._shapes_and_squares, *self._numbers(sigma)
        compiled.dome3(*parts(spectra), added, *given, sums)
        found = (sums.sum(axis=0) / (fourier.rows * fourier.cols)).reshape(3, 3)
        return found[0][:, None], found[1:].T

    def _solve_blocks(
        self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None
    ) -> tuple[Any, Any]:
        """Turns `spectra` into B^-1 of them, in place; takes inner products with the modes.

        Returns
        -------
        (primary, mode) with U before, and (primary, V and U mode) after.
        """
        modes = self.core.shape[-1]
        if plus is not None:
            for p, plane in enumerate(plus):
                spectra[p] += plane
        asked = self._sums(spectra)[:, modes:]

        def work(rows: slice) -> None:
            found = self._blocks.solved(rows, [plane[rows, :] for plane in spectra], sigma)
            for plane, value in zip(spectra, found, strict=True):
                plane[rows, :] = value

        each_strip(work, spectra[0])
        return asked, self._sums(spectra)

    def energy(self, spectra: Spectra) -> float:
        """<w, C'WC w>."""
        modes = self.core.shape[-1]
        polluted = np.einsum("pjk,pk->pj", self.core, self._sums(spectra)[:, :modes])

        def work(rows: slice) -> float:
            seen = self._combined(rows, np.concatenate([0 * polluted, polluted], 1))
            for p, plane in enumerate(spectra):
                seen[p] += plane[rows, :]
            images = self._blocks.times(rows, seen)
            return sum(self.fourier.dot(a, b) for a, b in zip(seen, images, strict=True))

        return sum(each_strip(work, spectra[0]))

    def seen(self, residual: Spectra) -> tuple[float, Spectra]:
        """||A r||² and C'W r of a residual r."""
        modes = self.core.shape[-1]

        def weighted(rows: slice) -> tuple[float, Any]:
            strip = [plane[rows, :] for plane in residual]
            back = self._blocks.times(rows, strip)
            energy = sum(self.fourier.dot(a, b) for a, b in zip(strip, back, strict=True))
            for plane, value in zip(residual, back, strict=True):
                plane[rows, :] = value
            return energy, self._dots(rows, back)[:, modes:]

        found = each_strip(weighted, residual[0])
        energy, shown = (sum(part[k] for part in found) for k in range(2))
        self._add_collected(residual, np.einsum("pjk,pj->pk", self.core, shown))
        return float(energy), residual

    def _sums(self, spectra: Spectra) -> Any:
        """(primary, V and U mode) inner products with the modes."""
        return sum(
            each_strip(
                lambda rows: self._dots(rows, [plane[rows, :] for plane in spectra]), spectra[0]
            )
        )

    def _add_collected(self, spectra: Spectra, coefficients: Any) -> None:
        """Add V of (primary, mode) `coefficients` to `spectra`, in place."""

        def add(rows: slice) -> None:
            added = self._combined(rows, np.concatenate([coefficients, 0 * coefficients], 1))
            for plane, value in zip(spectra, added, strict=True):
                plane[rows, :] += value

        each_strip(add, spectra[0])

    def _coarser(self, squares: Sequence[Array]) -> DomeHessian:
        spread, collect = (
            namespace(planes).stack([halved(planes[k, :, :]) for k in range(planes.shape[0])])
            for planes in self._pixels
        )
        self._pixels = ()  # a large part of what is kept
        return DomeHessian(
            spread,
            4 * collect,
            self.core,
            self._opponent,
            squares,
            self.fourier.coarser(),
        )

    def _dots(self, rows: slice, strip: Sequence[Array], which: slice = slice(None)) -> Any:
        """(primary, V and U mode) inner products with a strip's part of `which` of the modes."""
        shapes = self._shapes
        chosen = range(shapes.shape[0])[which]
        # Row by row: a product of matrices would start threads of its own, in each strip's thread
        found = [[self.fourier.dot(shapes[k, rows, :], plane) for k in chosen] for plane in strip]
        return np.asarray(found)

    def _combined(self, rows: slice, coefficients: Any) -> list[Array]:
        """Sums of the modes' strips times (primary, V and U mode) coefficients."""
        result = []
        for weights in coefficients:
            plane = None
            for k, weight in enumerate(weights):
                if weight:
                    term = self._shapes[k, rows, :] * float(weight)
                    if plane is None:
                        plane = term
                    else:
                        plane += term
            result.append(0 * self._shapes[0, rows, :] if plane is None else plane)
        return result

    @cached_property
    def _plain(self) -> dict[str, Any]:
        """Inner products of the modes, the same for each primary: (primary mode, primary mode)."""
        count = len(self.metric)
        one = sum(each_strip(lambda rows: self._products(rows, None), self._shapes[0, :, :]))
        return self._arranged(np.einsum("pq,jk->pqjk", np.eye(count), one))

    def _small_inverse(self, sigma: tuple[float, ...]) -> Any:
        """Inverse of M^-1 + Z' B^-1 Z by (primary, mode); M^-1 = [[0, I], [I, -U'WU]]."""
        if sigma not in self._small:
            count, modes = len(self.metric), self.core.shape[-1]

            def between(rows: slice) -> Any:
                zero = 0 * self._blocks.squares[0][rows, :]
                result = []
                for q in range(count):
                    unit = [zero + float(p == q) for p in range(count)]
                    column = self._blocks.solved(rows, unit, sigma)
                    result.append([self._products(rows, entry) for entry in column])
                return np.asarray(result)

            found = sum(each_strip(between, self._shapes[0, :, :]))
            plain, b = self._plain, self._arranged(np.swapaxes(found, 0, 1))
            core = self._core_matrix()
            s = np.diag(np.repeat(sigma, modes))
            upper = (plain["vu"] - b["vu"] @ s) @ core
            # -U'WU of M^-1 and U'WU of Z'B^-1Z cancel
            corner = core.T @ (s @ b["uu"] @ s - s @ plain["uu"]) @ core
            one = np.eye(len(core))
            self._small[sigma] = np.linalg.inv(
                np.block([[b["vv"], one + upper], [one + upper.T, corner]])
            )
        return self._small[sigma]

    def _products(self, rows: slice, entry: Array | None) -> Any:
        """(V and U mode, V and U mode) inner products over a strip, with a plane in between."""
        xp = namespace(self._half)
        shapes = self._shapes[:, rows, :]
        weight = self._half if entry is None else self._half * entry
        flat = (shapes.shape[0], -1)
        product = xp.matmul(xp.reshape(shapes * weight, flat), xp.conj(xp.reshape(shapes, flat)).T)
        return on_host(xp.real(product)).astype(np.float64)

    def _arranged(self, products: Any) -> dict[str, Any]:
        """Turns (primary, primary, V and U, V and U) into (primary mode, primary mode) matrices."""
        modes, count = self.core.shape[-1], len(self.metric)
        first, second = slice(0, modes), slice(modes, 2 * modes)
        return {
            name: np.swapaxes(products[:, :, left, right], 1, 2).reshape(count * modes, -1)
            for name, left, right in (
                ("vv", first, first),
                ("vu", first, second),
                ("uu", second, second),
            )
        }

    def _core_matrix(self) -> Any:
        """The core as (primary mode, primary mode)."""
        count, modes, _ = self.core.shape
        result = np.zeros((count, modes, count, modes), self.core.dtype)
        result[np.arange(count), :, np.arange(count)] = self.core
        return result.reshape(count * modes, -1)
