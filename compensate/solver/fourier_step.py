"""The inverse of the problem's Hessian over the whole padded plane, exact in Fourier.

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

from typing import Any, final

import numpy as np

from compensate.fourier import Fourier
from compensate.solver.blocks import Spectrum, blocks_times, inverted
from compensate.weighting import CsfWeighting
from domesim.light import Array
from domesim.observation.lowrank import LowRankObservation


@final
class PlaneModel:
    """A dome problem on its padded plane: planes (primary, padded row, padded col).

    Parameters
    ----------
    observation
        A low-rank dome, whose pollution does not mix primaries.
    weighting
        Its support must lie on the observation's screen.
    dtype
        Precision of the planes: float32 or float64.

    Raises
    ------
    ValueError
        If it does not.
    """

    def __init__(
        self, observation: LowRankObservation, weighting: CsfWeighting, dtype: Any = np.float32
    ) -> None:
        if bool(np.any(weighting.support & ~observation.screen)):
            raise ValueError("the weighting's support reaches outside the observation's screen")
        self.fourier: Fourier = weighting.fourier
        self.dtype = np.dtype(dtype)
        self.support = weighting.support
        self.primaries = weighting.opponent.shape[1]
        self.core = observation.factors.core
        self.modes = observation.factors.spread.shape[0]
        factors = observation.factors
        self._spread = self.fourier.forward(self._padded(factors.spread * self.support))
        # In w = D x, a pixel's light has passed D already.
        direct = factors.collect / factors.direct_gain
        self._collect = self.fourier.forward(self._padded(direct * self.support))
        self.normal_blocks = _normal_blocks(weighting, self.dtype)
        self.overlap = _Overlaps(self, self._spread, self._collect)

    @property
    def strength(self) -> float:
        """Bound 1 + ||U V'|| of how much C amplifies; 1 without pollution."""
        return 1 + self.overlap.pollution_norm

    def padded(self, light: Array) -> Array:
        """Planes of Light (1, row, col, primary), 0 off the support."""
        return self._padded(np.moveaxis(light[0] * self.support[..., None], -1, 0))

    def normal(self, spectrum: Spectrum) -> Spectrum:
        """W of a spectrum."""
        return blocks_times(self.normal_blocks, spectrum)

    def polluted(self, spectrum: Spectrum) -> Spectrum:
        """C w = w + U V' w."""
        return spectrum + self.spread(self.collected(spectrum))

    def polluted_adjoint(self, spectrum: Spectrum) -> Spectrum:
        """C' r = r + V U' r."""
        return spectrum + self.gathered(self.shown(spectrum))

    def collected(self, spectrum: Spectrum) -> Any:
        """V' w, (primary, mode)."""
        return self._dots(self._collect, spectrum)

    def shown(self, spectrum: Spectrum) -> Any:
        """U' r, (primary, mode)."""
        return np.einsum("pjk,pj->pk", self.core, self._dots(self._spread, spectrum))

    def spread(self, coefficients: Any) -> Spectrum:
        """U c."""
        return _combined(self._spread, np.einsum("pjk,pk->pj", self.core, coefficients))

    def gathered(self, coefficients: Any) -> Spectrum:
        """V c."""
        return _combined(self._collect, coefficients)

    def _dots(self, modes: Spectrum, spectrum: Spectrum) -> Any:
        return np.array([[self.fourier.dot(mode, plane) for mode in modes] for plane in spectrum])

    def _padded(self, planes: Array) -> Array:
        result = np.zeros((len(planes), self.fourier.rows, self.fourier.cols), self.dtype)
        rows, cols = self.support.shape
        result[:, :rows, :cols] = planes
        return result


@final
class NormalInverse:
    """H^-1 of a `PlaneModel`.

    Parameters
    ----------
    model
        The problem.
    sigma
        (primary,) the diagonal that is added to C' W C, > 0.
    """

    def __init__(self, model: PlaneModel, sigma: Any) -> None:
        self._model = model
        self._sigma = np.asarray(sigma, np.float64)
        damped = [list(row) for row in model.normal_blocks]
        for p, value in enumerate(self._sigma):
            damped[p][p] = damped[p][p] + model.dtype.type(value)
        self._inverse = inverted(damped)
        self._small = np.linalg.inv(model.overlap.small_system(self._inverse, self._sigma))

    def __call__(self, spectrum: Spectrum) -> Spectrum:
        """H^-1 of a spectrum."""
        model, sigma = self._model, self._sigma[:, None]
        h = blocks_times(self._inverse, spectrum)
        known = np.stack([model.collected(h), model.shown(spectrum) - sigma * model.shown(h)])
        c, e = (self._small @ known.ravel()).reshape(known.shape)
        correction = blocks_times(self._inverse, model.gathered(c) - model.spread(sigma * e))
        h -= correction
        h -= model.spread(e)
        return h


class _Overlaps:
    """Inner products of the modes, with and without planes B^-1 in between.

    All primaries share the modes' shapes: a product over pixels is a sum over frequencies of a real
    plane, Re(conj(a) b), times an entry of B^-1.
    """

    def __init__(self, model: PlaneModel, spread: Spectrum, collect: Spectrum) -> None:
        self._core = model.core
        half = np.full(model.fourier.cols // 2 + 1, 2.0, model.dtype)
        half[0] = 1
        if model.fourier.cols % 2 == 0:
            half[-1] = 1
        half /= model.fourier.rows * model.fourier.cols

        def products(left: Spectrum, right: Spectrum) -> list[list[Array]]:
            return [[(a.real * b.real + a.imag * b.imag) * half for b in right] for a in left]

        self._uu = products(spread, spread)
        self._vu = products(collect, spread)
        self._vv = products(collect, collect)
        one = np.ones_like(self._uu[0][0])
        identity = [
            [one if p == q else None for q in range(model.primaries)]
            for p in range(model.primaries)
        ]
        self._vu_plain = self._between(identity, self._vu) @ self._core_matrix()
        self._vv_plain = self._between(identity, self._vv)
        uu = self._core_matrix().T @ self._between(identity, self._uu) @ self._core_matrix()
        self._uu_plain = uu
        self._uwu = (
            self._core_matrix().T
            @ self._between(model.normal_blocks, self._uu)
            @ self._core_matrix()
        )

    @property
    def pollution_norm(self) -> float:
        """||U V'||: the root of the largest eigenvalue of U'U V'V."""
        return float(np.sqrt(np.abs(np.linalg.eigvals(self._uu_plain @ self._vv_plain)).max()))

    def small_system(self, inverse: list[list[Array]], sigma: Any) -> Any:
        """M^-1 + Z' B^-1 Z, with M^-1 = [[0, I], [I, -U'WU]]; rows and columns (primary, mode)."""
        core = self._core_matrix()
        s = np.diag(np.repeat(sigma, len(self._uu)))
        vbv = self._between(inverse, self._vv)
        vbu = self._between(inverse, self._vu) @ core
        ubu = core.T @ self._between(inverse, self._uu) @ core
        one = np.eye(len(core))
        upper = self._vu_plain - vbu @ s
        # -U'WU of M^-1 and U'WU of Z'B^-1Z cancel
        corner = s @ ubu @ s - s @ self._uu_plain
        return np.block([[vbv, one + upper], [one + upper.T, corner]])

    def _between(self, blocks: Any, products: list[list[Array]]) -> Any:
        """(primary mode, primary mode) sums of products[j][k] blocks[p][q] over frequencies."""
        primaries, modes = len(blocks), len(products)
        result = np.zeros((primaries, modes, primaries, modes))
        for p in range(primaries):
            for q in range(primaries):
                if blocks[p][q] is not None:
                    for j in range(modes):
                        for k in range(modes):
                            rows = np.vecdot(products[j][k], blocks[p][q])
                            result[p, j, q, k] = np.sum(rows, dtype=np.float64)
        return result.reshape(primaries * modes, primaries * modes)

    def _core_matrix(self) -> Any:
        """Block diagonal core: (primary mode, primary mode)."""
        primaries, modes = self._core.shape[:2]
        result = np.zeros((primaries, modes, primaries, modes))
        for p in range(primaries):
            result[p, :, p, :] = self._core[p]
        return result.reshape(primaries * modes, primaries * modes)


def _normal_blocks(weighting: CsfWeighting, dtype: Any) -> list[list[Array]]:
    """W_pq(f) planes, (padded row, padded col // 2 + 1); symmetric ones are shared."""
    squares = [gain.astype(dtype) ** 2 for gain in weighting.gains]
    opponent = weighting.opponent.astype(dtype)
    primaries = opponent.shape[1]
    blocks: list[list[Array]] = [[None] * primaries for _ in range(primaries)]
    for p in range(primaries):
        for q in range(p, primaries):
            weights = opponent[:, p] * opponent[:, q]
            if len(squares) == 1:
                block = np.sum(weights) * squares[0]
            else:
                block = sum(w * square for w, square in zip(weights, squares, strict=True))
            blocks[p][q] = blocks[q][p] = block
    return blocks


def _combined(modes: Spectrum, coefficients: Any) -> Spectrum:
    weights = np.asarray(coefficients, modes.real.dtype)
    result = np.multiply.outer(weights[:, 0], modes[0])
    for k in range(1, len(modes)):
        result += np.multiply.outer(weights[:, k], modes[k])
    return result
