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

*A 3D dome* (`domesim.observation.dome_pair`) shows psi = C (D x + S K V'x), where C is one matrix
over views and primaries. With w = C D x, as of a flat pair (`pair.Eyes`), this is
w + S (C K C^-1) V'D^-1 w: the same modes, excited by all planes. So U V' above has one more matrix
in the middle, W is one block a view, and nothing else is new.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, final

import numpy as np
import scipy
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
from compensate.solver.admm.level import Apart, Level, Mixing
from compensate.solver.admm.pair import Eyes
from compensate.solver.admm.planes import Split, planes_of, widths_of
from compensate.solver.admm.pyramid import halved
from compensate.solver.kinds import DomePair
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
    _require_inside(weighting, observation.screen)
    hessian = hessian_of(observation, weighting, problem.anchor)
    return _split(problem, hessian, Apart(), observation.factors.direct_gain)


def split_dome_pair(problem: Problem, weighting: CsfWeighting, parts: DomePair) -> Split:
    """A 3D dome's problem in w = C D (x - x_a).

    Raises
    ------
    ValueError
        If the weighting has support where there is no screen.
    """
    base: Any = problem.anchor
    _require_inside(weighting, parts.reflected.screen)
    hessian = _pair_hessian(parts, weighting, namespace(base), base.dtype, base.device)
    eyes = Eyes.of(parts.crosstalk, base)
    return _split(problem, hessian, eyes, parts.reflected.direct_gain)


def _require_inside(weighting: CsfWeighting, screen: Any) -> None:
    if bool(np.any(weighting.support & ~screen)):
        raise ValueError("the weighting's support reaches outside the observation's screen")


def _split(problem: Problem, hessian: DomeHessian, mixing: Mixing, direct: Any) -> Split:
    """A problem in what is seen of D (x - x_a), in its own place."""
    base: Any = problem.anchor
    gain = _gain(direct, base)
    below = namespace(base).broadcast_to(problem.lower, base.shape) - base
    level = Level(
        hessian,
        mixing,
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
    f, primaries = observation.factors, observation.shape[3]
    core = np.zeros((primaries, f.core.shape[1], primaries, f.core.shape[1]))
    core[np.arange(primaries), :, np.arange(primaries)] = f.core
    modes = f.spread, f.collect, f.direct_gain
    return _of_modes(*modes, core, weighting, library.zeros((1,), dtype=dtype, device=device))


@lru_cache(maxsize=2)
def _pair_hessian(
    parts: DomePair, weighting: CsfWeighting, library: Any, dtype: Any, device: Any
) -> DomeHessian:
    reflected, crosstalk = parts
    spread, collect, core = reflected.modes()
    rank, primaries = core.shape[2], core.shape[1]
    mixed = np.kron(crosstalk.central.reshape(2 * primaries, -1), np.eye(rank))
    core = mixed @ core.reshape(len(mixed), -1) @ np.linalg.inv(mixed)
    core = core.reshape(2 * primaries, rank, 2 * primaries, rank)
    like = library.zeros((1,), dtype=dtype, device=device)
    return _of_modes(spread, collect, reflected.direct_gain, core, weighting, like)


def _of_modes(
    spread: Any, collect: Any, gain: Any, core: Any, weighting: CsfWeighting, like: Array
) -> DomeHessian:
    support, fourier = weighting.support, weighting.fourier

    def modes(planes: Any) -> Array:
        large = np.zeros((len(planes), fourier.rows, fourier.cols))
        large[:, : support.shape[0], : support.shape[1]] = planes * support
        return namespace(like).asarray(large, dtype=like.dtype, device=like.device)

    # In w = D x, a pixel's light has passed D already
    return DomeHessian(
        modes(spread),
        modes(collect / np.where(gain == 0, 1, gain)),
        core,
        weighting.opponent,
        weighting.squares(like),
        fourier,
    )


def _gain(direct: Any, like: Light) -> Array | None:
    """(1, row, col, 1) direct gain as an array like `like`; None for 1."""
    if bool(np.all(direct == 1)):
        return None
    kept = np.where(direct == 0, 1, direct)[None, :, :, None]
    return namespace(like).asarray(kept, dtype=like.dtype, device=like.device)


@final
class DomeHessian(Hessian):
    """Hessian of one or two views with low-rank pollution, on padded planes (view, primary).

    Parameters
    ----------
    spread, collect
        (mode, padded row, padded col) pollution's modes in w = D x, 0 off the picture.
    core
        (plane, mode, plane, mode) how the modes excite each other.
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
        self._modes = core.shape[1]
        self._core = core.reshape(core.shape[0] * self._modes, -1)
        self._opponent, self.squares = opponent, squares
        self._blocks = Blocks(squares, outer_products(opponent))
        size = self._blocks.size
        self._views = [slice(p, p + size) for p in range(0, len(core), size)]
        self.metric = metric_of(opponent) * len(self._views)
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
        overlap = self._plain
        uu = self._core.T @ overlap["uu"] @ self._core
        return 1 + float(np.sqrt(np.abs(np.linalg.eigvals(uu @ overlap["vv"])).max()))

    def solve(self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None = None) -> None:
        """See `Hessian`."""
        compiled, modes = self._compiled(spectra), self._modes
        sums = self._compiled_sums if compiled else self._solve_blocks
        each = [
            sums(spectra[view], sigma[view], None if plus is None else plus[view])
            for view in self._views
        ]
        asked, found = (np.concatenate(some) for some in zip(*each, strict=True))
        damping = np.asarray(sigma)[:, None]
        v, u = found[:, :modes], asked - damping * found[:, modes:]
        known = np.stack([v, self._excited(self._core.T, u)])
        c, e = (self._small_inverse(tuple(sigma)) @ known.ravel()).reshape(known.shape)
        e = self._excited(self._core, e)
        if compiled:
            weights = np.stack([c, -damping * e, e])[:, :, 0].astype(
                self._blocks.coefficients.dtype
            )
            for view in self._views:
                numbers = self._numbers(sigma[view])
                given = *self._shapes_and_squares, *numbers, weights[:, view]
                compiled.correct3(*parts(spectra[view]), *given)
            return
        asks, shows = np.concatenate([c, -damping * e], 1), np.concatenate([0 * c, e], 1)

        def correct(rows: slice) -> None:
            asking, shown = self._combined(rows, asks), self._combined(rows, shows)
            for view in self._views:
                found = self._blocks.solved(rows, asking[view], sigma[view])
                for plane, one, other in zip(spectra[view], found, shown[view], strict=True):
                    plane[rows, :] -= one + other

        each_strip(correct, spectra[0])

    def _excited(self, core: Any, sums: Any) -> Any:
        """A matrix over (plane, mode) times (plane, mode) numbers."""
        return (core @ sums.ravel()).reshape(sums.shape)

    def _compiled(self, spectra: Spectra) -> Any:
        """The compiled loops, or None if there are none for this problem."""
        fits = self._blocks.compiles and self._modes == 1
        return loops(*spectra) if fits else None

    @property
    def _shapes_and_squares(self) -> tuple[Any, ...]:
        """Arguments of the compiled loops: V and U of the only mode, and the squares."""
        return *parts([self._shapes[0], self._shapes[1]]), self._blocks.three_squares

    def _numbers(self, sigma: Sequence[float]) -> tuple[Any, Any]:
        coefficients = self._blocks.coefficients
        return coefficients, np.asarray(sigma, coefficients.dtype)

    def _compiled_sums(
        self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None
    ) -> tuple[Any, Any]:
        """Does what `_solve_blocks` does, by compiled loops."""
        fourier = self.fourier
        # How much the first and the last column count
        sums = np.zeros((fourier.rows, 9))
        sums[:, 0], sums[:, 1] = 1, 1 if fourier.cols % 2 == 0 else 2
        added = parts_or_zero(plus, spectra)
        given = *self._shapes_and_squares, *self._numbers(sigma)
        loops(*spectra).dome3(*parts(spectra), added, *given, sums)
        found = (sums.sum(axis=0) / (fourier.rows * fourier.cols)).reshape(3, 3)
        return found[0][:, None], found[1:].T

    def _solve_blocks(
        self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None
    ) -> tuple[Any, Any]:
        """Turns a view's `spectra` into B^-1 of them, in place, with the modes' inner products.

        Returns
        -------
        (primary, mode) with U before, and (primary, V and U mode) after.
        """
        modes = self._modes
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
        polluted = self._excited(self._core, self._sums(spectra)[:, : self._modes])

        def work(rows: slice) -> float:
            seen = self._combined(rows, np.concatenate([0 * polluted, polluted], 1))
            for p, plane in enumerate(spectra):
                seen[p] += plane[rows, :]
            images = self._images(rows, seen)
            return sum(self.fourier.dot(a, b) for a, b in zip(seen, images, strict=True))

        return sum(each_strip(work, spectra[0]))

    def seen(self, residual: Spectra) -> tuple[float, Spectra]:
        """||A r||² and C'W r of a residual r."""

        def weighted(rows: slice) -> tuple[float, Any]:
            strip = [plane[rows, :] for plane in residual]
            back = self._images(rows, strip)
            energy = sum(self.fourier.dot(a, b) for a, b in zip(strip, back, strict=True))
            for plane, value in zip(residual, back, strict=True):
                plane[rows, :] = value
            return energy, self._dots(rows, back)[:, self._modes :]

        found = each_strip(weighted, residual[0])
        energy, shown = (sum(part[k] for part in found) for k in range(2))
        self._add_collected(residual, self._excited(self._core.T, shown))
        return float(energy), residual

    def _images(self, rows: slice, strip: Sequence[Array]) -> list[Array]:
        """W of a strip of all planes."""
        return [image for view in self._views for image in self._blocks.times(rows, strip[view])]

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
            self._core.reshape(len(self.metric), self._modes, len(self.metric), -1),
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
        """Inner products of the modes, the same for each plane: (plane mode, plane mode)."""
        one = sum(each_strip(lambda rows: self._products(rows, None), self._shapes[0, :, :]))
        return self._arranged([np.einsum("pq,jk->pqjk", np.eye(self._blocks.size), one)])

    def _small_inverse(self, sigma: tuple[float, ...]) -> Any:
        """Inverse of M^-1 + Z' B^-1 Z by (plane, mode); M^-1 = [[0, I], [I, -U'WU]]."""
        if sigma not in self._small:
            each: dict[tuple[float, ...], Any] = {}
            for view in self._views:
                if sigma[view] not in each:
                    each[sigma[view]] = self._between(sigma[view])
            plain = self._plain
            b = self._arranged([each[sigma[view]] for view in self._views])
            core = self._core
            s = np.diag(np.repeat(sigma, self._modes))
            upper = (plain["vu"] - b["vu"] @ s) @ core
            # -U'WU of M^-1 and U'WU of Z'B^-1Z cancel
            corner = core.T @ (s @ b["uu"] @ s - s @ plain["uu"]) @ core
            one = np.eye(len(core))
            self._small[sigma] = np.linalg.inv(
                np.block([[b["vv"], one + upper], [one + upper.T, corner]])
            )
        return self._small[sigma]

    def _between(self, sigma: tuple[float, ...]) -> Any:
        """(primary, primary, V and U, V and U) inner products of a view's modes with B^-1."""
        count = self._blocks.size

        def between(rows: slice) -> Any:
            zero = 0 * self._blocks.squares[0][rows, :]
            result = []
            for q in range(count):
                unit = [zero + float(p == q) for p in range(count)]
                column = self._blocks.solved(rows, unit, sigma)
                result.append([self._products(rows, entry) for entry in column])
            return np.asarray(result)

        return np.swapaxes(sum(each_strip(between, self._shapes[0, :, :])), 0, 1)

    def _products(self, rows: slice, entry: Array | None) -> Any:
        """(V and U mode, V and U mode) inner products over a strip, with a plane in between."""
        xp = namespace(self._half)
        shapes = self._shapes[:, rows, :]
        weight = self._half if entry is None else self._half * entry
        flat = (shapes.shape[0], -1)
        product = xp.matmul(xp.reshape(shapes * weight, flat), xp.conj(xp.reshape(shapes, flat)).T)
        return on_host(xp.real(product)).astype(np.float64)

    def _arranged(self, products: Sequence[Any]) -> dict[str, Any]:
        """Turns (primary, primary, V and U, V and U) into (plane mode, plane mode) matrices.

        `products` are of each view, or of all alike.
        """
        first, second = slice(0, self._modes), slice(self._modes, 2 * self._modes)
        size = self._blocks.size * self._modes
        each = list(products) * (len(self._views) // len(products))
        return {
            name: scipy.linalg.block_diag(
                *(
                    np.swapaxes(of_view[:, :, left, right], 1, 2).reshape(size, -1)
                    for of_view in each
                )
            )
            for name, left, right in (
                ("vv", first, first),
                ("vu", first, second),
                ("uu", second, second),
            )
        }
