"""The Hessian of a dome's problem and its inverse, exact in Fourier.

On the padded plane without bounds the objective in w = D x (the light that the projector puts on
the screen) is ``1/2 ||A (C w - t)||²``, where A = lambda is diagonal in Fourier but for the mixing
of primaries, W(f) = A'A = T' Omega(f)² T, and C = I + U V' holds the low-rank pollution. So

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
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.fourier import Fourier
from compensate.solver.blocks import Blocks, Spectra, each_strip
from compensate.solver.fused import loops, parts, parts_or_zero
from compensate.solver.hessian import Hessian, adapted_metric, halved, metric_of
from domesim.light import Array, namespace, on_host


@final
class DomeHessian(Hessian):
    """Of one view with low-rank pollution, on padded planes (primary).

    Parameters
    ----------
    spread, collect
        (mode, padded row, padded col) pollution's modes in w = D x, 0 off the picture.
    core
        (plane, plane, mode, mode) how the modes excite each other.
    opponent
        (channel, plane) T.
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
        self._opponent, self._squares = opponent, squares
        self._blocks = Blocks(squares, np.stack([np.outer(row, row) for row in opponent]))
        self.adapted = np.array_equal(opponent, np.eye(len(opponent)))
        self.metric = adapted_metric(squares) if self.adapted else metric_of(opponent)
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
        modes, compiled = self.core.shape[-1], self._fused(spectra)
        if compiled:
            added = parts_or_zero(plus, spectra)
            asked, found = self._compiled_sums(compiled, spectra, added, sigma)
        elif self.adapted:
            asked, found = self._channels_sums(spectra, sigma, plus)
        else:
            asked, found = self._solve_blocks(spectra, sigma, plus)
        damping = np.asarray(sigma)[:, None]
        v, u = found[:, :modes], asked - damping * found[:, modes:]
        known = np.stack([v, np.einsum("pqjk,pj->qk", self.core, u)])
        c, e = (self._small_inverse(tuple(sigma)) @ known.ravel()).reshape(known.shape)
        e = np.einsum("pqjk,qk->pj", self.core, e)
        if compiled:
            weights = np.stack([c, -damping * e, e])[:, :, 0].astype(
                self._blocks.coefficients.dtype
            )
            if self.adapted:
                given = *self._shapes_and_squares, self._given(sigma), weights
                compiled.channels3(*parts(spectra), added, *given)
            else:
                given = *self._shapes_and_squares, self._blocks.coefficients, self._given(sigma)
                compiled.correct3(*parts(spectra), *given, weights)
            return
        asks, shows = np.concatenate([c, -damping * e], 1), np.concatenate([0 * c, e], 1)
        if self.adapted:
            self._solve_channels(spectra, sigma, asks, shows)
            return

        def correct(rows: slice) -> None:
            correction = self._blocks.solved(rows, self._combined(rows, asks), sigma)
            shown = self._combined(rows, shows)
            for plane, one, other in zip(spectra, correction, shown, strict=True):
                plane[rows, :] -= one + other

        each_strip(correct, spectra[0])

    def _fused(self, spectra: Spectra, *, adapted: bool = False) -> Any:
        """The compiled loops, where there are any for such a problem; if planes are channels."""
        plain = len(spectra) == 3 and self.core.shape[-1] == 1 and len(self._blocks.squares) <= 3
        return loops(*spectra) if plain and (self.adapted or not adapted) else None

    @property
    def _shapes_and_squares(self) -> tuple[Any, ...]:
        """What the compiled loops take, of one mode."""
        squares = self._blocks.three_squares
        if self.adapted:
            squares = tuple(self._squares)
        return *parts([self._shapes[0], self._shapes[1]]), squares

    def _given(self, sigma: Sequence[float]) -> Any:
        return np.asarray(sigma, self._blocks.coefficients.dtype)

    def _shares(self, columns: int) -> Any:
        """(row, column) for the compiled loops' sums: how much the first and last column count."""
        fourier = self.fourier
        sums = np.zeros((fourier.rows, columns))
        sums[:, 0], sums[:, 1] = 1, 1 if fourier.cols % 2 == 0 else 2
        return sums

    def _summed(self, sums: Any) -> Any:
        """Inner products of planes, of the rows' sums over spectra."""
        return sums.sum(axis=0) / (self.fourier.rows * self.fourier.cols)

    def _compiled_weights(
        self, compiled: Any, spectra: Spectra, polluted: Any, *, keep: bool = False
    ) -> float:
        """`multiply` of channels where `polluted` (channel, mode) is excited, and their energy."""
        v, u, squares = self._shapes_and_squares
        number, sums = squares[0].dtype.type, self._shares(4)
        excited = tuple(number(weight) for weight in polluted[:, 0])
        compiled.weigh3(*parts(spectra), u, squares, excited, keep, sums)
        found = self._summed(sums)
        if not keep:
            collected = np.einsum("pqjk,pj->qk", self.core, found[:3, None])
            compiled.add3(*parts(spectra), v, tuple(number(weight) for weight in collected[:, 0]))
        return float(found[3])

    def _compiled_sums(
        self, compiled: Any, spectra: Spectra, added: Any, sigma: Sequence[float]
    ) -> tuple[Any, Any]:
        """`_solve_blocks`, but that planes that are channels are left as they are."""
        sums = self._shares(9)
        given = *parts(spectra), added, *self._shapes_and_squares
        if self.adapted:
            compiled.channels3_sums(*given, self._given(sigma), sums)
        else:
            compiled.dome3(*given, self._blocks.coefficients, self._given(sigma), sums)
        found = self._summed(sums).reshape(3, 3)
        return found[0][:, None], found[1:].T

    def _solve_blocks(
        self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None
    ) -> tuple[Any, Any]:
        """B^-1 of `spectra`, in place, and their inner products with the modes.

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

    def _channels_sums(
        self, spectra: Spectra, sigma: Sequence[float], plus: Spectra | None
    ) -> tuple[Any, Any]:
        """`_solve_blocks` of planes that are channels, but that nothing is solved in place yet."""
        modes = self.core.shape[-1]

        def work(rows: slice) -> Any:
            sums = []
            for p, plane in enumerate(spectra):
                if plus is not None:
                    plane[rows, :] += plus[p][rows, :]
                part = plane[rows, :]
                asked = self._dots(rows, [part], slice(modes, None))
                found = self._dots(rows, [part * self._inverse(p, rows, sigma)])
                sums.append([*asked[0], *found[0]])
            return np.asarray(sums)

        found = sum(each_strip(work, spectra[0]))
        return found[:, :modes], found[:, modes:]

    def _solve_channels(
        self, spectra: Spectra, sigma: Sequence[float], asks: Any, shows: Any
    ) -> None:
        """B^-1 of (`spectra` less the modes' `asks`) less their `shows`, in place."""

        def work(rows: slice) -> None:
            for p, plane in enumerate(spectra):
                (asked,) = self._combined(rows, asks[p : p + 1])
                plane[rows, :] -= asked
                plane[rows, :] *= self._inverse(p, rows, sigma)
                (shown,) = self._combined(rows, shows[p : p + 1])
                plane[rows, :] -= shown

        each_strip(work, spectra[0])

    def multiply(self, spectra: Spectra) -> None:
        """C'WC of `spectra`, in place."""
        modes = self.core.shape[-1]
        polluted = self._excited(spectra)
        if compiled := self._fused(spectra, adapted=True):
            self._compiled_weights(compiled, spectra, polluted)
            return

        def weighted(rows: slice) -> Any:
            strip = [plane[rows, :] for plane in spectra]
            added = self._combined(rows, np.concatenate([0 * polluted, polluted], 1))
            seen = [a + b for a, b in zip(strip, added, strict=True)]
            back = self._blocks.times(rows, seen)
            for plane, value in zip(spectra, back, strict=True):
                plane[rows, :] = value
            return self._dots(rows, back)[:, modes:]

        shown = sum(each_strip(weighted, spectra[0]))
        self._add_collected(spectra, np.einsum("pqjk,pj->qk", self.core, shown))

    def energy(self, spectra: Spectra) -> float:
        """<w, C'WC w>."""
        polluted = self._excited(spectra)
        if compiled := self._fused(spectra, adapted=True):
            return self._compiled_weights(compiled, spectra, polluted, keep=True)

        def work(rows: slice) -> float:
            seen = self._combined(rows, np.concatenate([0 * polluted, polluted], 1))
            for p, plane in enumerate(spectra):
                seen[p] += plane[rows, :]
            images = self._blocks.each_times(rows, seen)
            return sum(self.fourier.dot(a, b) for a, b in zip(seen, images, strict=True))

        return sum(each_strip(work, spectra[0]))

    @property
    def squares(self) -> Sequence[Array]:
        """See `Hessian`."""
        return self._squares

    def seen(self, residual: Spectra) -> tuple[float, Spectra]:
        """||A r||² and C'W r of a residual r."""
        modes = self.core.shape[-1]
        if compiled := self._fused(residual, adapted=True):
            nothing = np.zeros((len(residual), 1))
            return self._compiled_weights(compiled, residual, nothing), residual

        def weighted(rows: slice) -> tuple[float, Any]:
            strip = [plane[rows, :] for plane in residual]
            back = self._blocks.times(rows, strip)
            energy = sum(self.fourier.dot(a, b) for a, b in zip(strip, back, strict=True))
            for plane, value in zip(residual, back, strict=True):
                plane[rows, :] = value
            return energy, self._dots(rows, back)[:, modes:]

        found = each_strip(weighted, residual[0])
        energy, shown = (sum(part[k] for part in found) for k in range(2))
        self._add_collected(residual, np.einsum("pqjk,pj->qk", self.core, shown))
        return float(energy), residual

    def _excited(self, spectra: Spectra) -> Any:
        """(primary, mode) core V'w: how much each shape of U is seen."""
        modes = self.core.shape[-1]
        if compiled := self._fused(spectra, adapted=True):
            sums = self._shares(3)
            compiled.dots3(*parts(spectra), self._shapes_and_squares[0], sums)
            found = self._summed(sums)[:, None]
        else:
            found = self._sums(spectra)[:, :modes]
        return np.einsum("pqjk,qk->pj", self.core, found)

    def _inverse(self, p: int, rows: slice, sigma: Sequence[float]) -> Array:
        """B^-1 of a strip of a channel."""
        return 1 / (self._squares[p][rows, :] + sigma[p])

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
        """Of M^-1 + Z' B^-1 Z, M^-1 = [[0, I], [I, -U'WU]]; rows and columns (primary, mode)."""
        if sigma not in self._small:
            count, modes = len(self.metric), self.core.shape[-1]

            def between(rows: slice) -> Any:
                if self.adapted:
                    diagonal = np.zeros((count, count, 2 * modes, 2 * modes))
                    for p, square in enumerate(self._squares):
                        diagonal[p, p] = self._products(rows, 1 / (square[rows, :] + sigma[p]))
                    return diagonal
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
        """(primary mode, primary mode) matrices of (primary, primary, V and U, V and U) ones."""
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
        """The core as (plane mode, plane mode)."""
        side = self.core.shape[0] * self.core.shape[-1]
        return self.core.transpose(0, 2, 1, 3).reshape(side, side)
