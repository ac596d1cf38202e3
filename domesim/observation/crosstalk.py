"""Crosstalk: some of the light for one eye reaches the other (eq. 8 of the paper).

    psi(x)_v = x_v + s_v M_v x_u + black_v        v: the eye that sees, u: the other one's picture

M_v is a matrix over the primaries, for coloured filters leak some colours more than others, and
differently from left to right than from right to left. s_v, a map over the screen, says how it
varies from the sweet spot to the edge: 1.1 % to 2.0 % in the cinema of the paper's section 7.

An entry of M_v may be negative: a ghost more saturated than the seeing eye's own primaries has no
other description. What cannot be is a white picture that *takes* light from the other eye (a
negative row sum; the readings were taken with the filters exchanged, or without subtracting black),
nor a leak as bright as the picture itself, which no projector could undo.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.light import Array, Light, kind, namespace
from domesim.light.guarded import guarded
from domesim.light.strips import in_strips
from domesim.observation.stereo import VIEWS, StereoObservation, require_black


@final
class Crosstalk(StereoObservation):
    """Linear crosstalk of two views of a flat screen.

    Parameters
    ----------
    rows, cols
        Size of the views.
    matrices
        (view, primary, primary) M: light of the other view (last axis) that the eye of that view
        sees as its own primaries (see `leak_matrices`).
    share
        (view, row, col) s; 1 everywhere if None.
    black
        (view, primary) light that each eye sees without any picture, in units of white.

    Raises
    ------
    InputError
        If crosstalk is impossible (see the module's docstring), the map is negative, or a number
        is not finite.
    InputError
        If shapes disagree.
    """

    def __init__(
        self,
        rows: int,
        cols: int,
        matrices: NDArray[Any],
        *,
        share: NDArray[Any] | None = None,
        black: ArrayLike = 0.0,
    ) -> None:
        matrices = np.asarray(matrices, np.float64)
        if matrices.ndim != 3 or len(matrices) != 2 or matrices.shape[1] != matrices.shape[2]:
            raise InputError(f"Crosstalk takes matrices (2, p, p), got {matrices.shape}")
        if share is None:
            share = np.ones((2, 1, 1))
        elif share.shape != (2, rows, cols):
            raise InputError(f"Crosstalk takes a map {(2, rows, cols)}, got {share.shape}")
        primaries = matrices.shape[1]
        self._shape = (2, rows, cols, primaries)
        self._matrices = matrices
        self._share = np.asarray(share, np.float64)
        self._black = require_black(black, primaries)
        _require_possible(self._matrices, self._share)
        self._converted: dict[tuple[str, ...], tuple[Array, Array, Array]] = {}

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(2, row, col, primary)."""
        return self._shape

    @property
    def matrices(self) -> NDArray[np.float64]:
        """(view, primary, primary) M."""
        return self._matrices

    @property
    def share(self) -> NDArray[np.float64]:
        """(view, row, col) s, or (view, 1, 1)."""
        return self._share

    @property
    def black(self) -> NDArray[np.float64]:
        """(view, primary) light without any picture."""
        return self._black

    @property
    def central(self) -> NDArray[Any]:
        """(view, primary, view, primary): the matrix by the mean of the map."""
        leaks = self._share.mean(axis=(1, 2))[:, None, None] * self._matrices
        primaries = self._shape[3]
        result = np.zeros((2, primaries, 2, primaries))
        for view in range(2):
            result[view, :, view] = np.eye(primaries)
            result[view, :, 1 - view] = leaks[view]
        return result

    @property
    def strength(self) -> float:
        """Largest share of the other view's light that a pixel sees: ||s_v M_v||."""
        norms = np.linalg.norm(self._matrices, 2, axis=(1, 2))
        return float(np.max(norms * self._share.max(axis=(1, 2))))

    def leaked(self, light: Light) -> Light:
        """phi(x): what each eye sees of the other's picture, (view, row, col, primary)."""
        matrices, share, _ = self._like(light)
        xp = namespace(light)
        leaks = [share[v] * (light[1 - v, ...] @ matrices[v].T) for v in range(2)]  # eq. 8
        return xp.stack(leaks)

    def _observe(self, light: Light) -> Light:
        if not isinstance(light, np.ndarray):
            return light + self.leaked(light) + self._like(light)[2]
        _, share, black = self._like(light)
        seen = np.empty_like(light)
        mixing = [mixing_by(matrix, light) for matrix in self._matrices]

        def observe(view: int, rows: slice) -> None:
            part = mixing[view](light[1 - view, rows])
            part *= share[view] if len(share[view]) == 1 else share[view][rows]
            part += light[view, rows]
            np.add(part, black[view], out=seen[view, rows])

        in_strips(observe, light.shape)
        return seen

    def _direct(self, light: Light) -> Light:
        return light

    def _linear(self, light: Light) -> Light:
        return light + self.leaked(light)

    def _adjoint(self, light: Light) -> Light:
        matrices, share, _ = self._like(light)
        xp = namespace(light)
        back = [(share[1 - u] * light[1 - u, ...]) @ matrices[1 - u] for u in range(2)]
        return light + xp.stack(back)

    def _direct_adjoint(self, light: Light) -> Light:
        return light

    def _like(self, light: Light) -> tuple[list[Array], list[Array], Array]:
        """Matrices and maps (row, col, 1) by view, and black (view, 1, col, primary)."""
        key = kind(light)
        if key not in self._converted:
            xp = namespace(light)

            def convert(array: NDArray[Any]) -> Array:
                return xp.asarray(array, dtype=light.dtype, device=light.device)

            self._converted[key] = (
                [convert(matrix) for matrix in self._matrices],
                [convert(plane[..., None]) for plane in self._share],
                # Of a whole row: NumPy repeats three numbers slowly.
                convert(np.repeat(self._black[:, None, None, :], self._shape[2], axis=2)),
            )
        return self._converted[key]


def mixing_by(matrix: NDArray[Any], like: NDArray[Any]) -> Callable[[NDArray[Any]], NDArray[Any]]:
    """A function that multiplies each pixel's primaries by `matrix`.

    A diagonal matrix, as most are, only scales: in a seventh of the time.

    Parameters
    ----------
    matrix
        (primary, primary), seen by sent.
    like
        (..., col, primary) rows of a picture, whose width and type the function expects.

    Returns
    -------
    mix
        Takes and returns (..., col, primary).
    """
    diagonal = np.diag(matrix)
    if np.array_equal(matrix, np.diag(diagonal)):
        row = np.repeat(diagonal[None, :], like.shape[-2], 0).astype(like.dtype)
        return lambda light: light * row
    turned = np.ascontiguousarray(matrix.T, like.dtype)
    return lambda light: light @ turned


@guarded
def leak_matrices(crosstalk: ArrayLike, primaries: int = 3) -> NDArray[np.float64]:
    """Matrices of crosstalk that is described with fewer numbers.

    Parameters
    ----------
    crosstalk
        A share of light (0.02 is 2 %); or one for each seeing eye, (2, 1); or for each primary,
        (primary,), or both, (2, primary); or a matrix, (primary, primary), or one for each eye,
        (2, primary, primary).
    primaries
        Number of primaries.

    Returns
    -------
    matrices
        (view, primary, primary), seen by sent.

    Raises
    ------
    InputError
        If it has another shape, or is not finite.
    """
    stated = np.asarray(crosstalk, np.float64)
    shapes = {
        (): lambda: np.broadcast_to(stated, (2, primaries)),
        (2, 1): lambda: np.broadcast_to(stated, (2, primaries)),
        (primaries,): lambda: np.broadcast_to(stated, (2, primaries)),
        (2, primaries): lambda: stated,
        (primaries, primaries): lambda: np.broadcast_to(stated, (2, primaries, primaries)),
        (2, primaries, primaries): lambda: stated,
    }
    if stated.shape not in shapes:
        raise InputError(
            f"leak_matrices takes crosstalk of shape {', '.join(map(str, shapes))}, "
            f"got {stated.shape}"
        )
    if not np.isfinite(stated).all():
        raise InputError(f"crosstalk must be finite, got {stated.tolist()}")
    matrices = shapes[stated.shape]()
    if matrices.ndim == 2:
        matrices = matrices[:, :, None] * np.eye(primaries)
    return np.array(matrices)


def leaks_to_both(to_left: object, to_right: object) -> NDArray[np.float64]:
    """Matrices of two eyes' crosstalk.

    Parameters
    ----------
    to_left, to_right
        What leaks to that eye; each as for `leak_matrices`.

    Returns
    -------
    matrices
        (view, primary, primary), seen by sent.
    """
    return np.stack([leak_matrices(np.asarray(leak))[0] for leak in (to_left, to_right)])


@guarded
def over_pixels(
    coarse: NDArray[np.float64], rows: int, cols: int, *, sloping: bool = True
) -> NDArray[np.float64]:
    """A map of cells, interpolated linearly between their centres.

    Parameters
    ----------
    coarse
        (view, row, col) of cells.
    rows, cols
        Size of the picture, pixels.
    sloping
        Whether the map goes on with its slope beyond the last centre, or stays flat.

    Returns
    -------
    fine
        (view, row, col) of pixels.
    """
    result = np.asarray(coarse, np.float64)
    for axis, count in ((1, rows), (2, cols)):
        cells = result.shape[axis]
        at = (np.arange(count) + 0.5) / count * cells - 0.5
        at = at if sloping else np.clip(at, 0, cells - 1)
        low = np.clip(np.floor(at).astype(int), 0, max(cells - 2, 0))
        part = (at - low).reshape((1, -1, 1) if axis == 1 else (1, 1, -1))
        upper = np.minimum(low + 1, cells - 1)
        result = (1 - part) * result.take(low, axis) + part * result.take(upper, axis)
    return result


def _require_possible(matrices: NDArray[np.float64], share: NDArray[np.float64]) -> None:
    for name, values in (("crosstalk", matrices), ("crosstalk map", share)):
        if not np.isfinite(values).all():
            raise InputError(f"{name} must be finite, got NaN or infinity")
    if share.min() < 0:
        raise InputError(f"crosstalk map must be light >= 0, got {share.min():g}")
    largest = share.max(axis=(1, 2))
    for view, other in ((0, 1), (1, 0)):
        matrix = largest[view] * matrices[view]
        white = matrix.sum(axis=1)
        if white.min() < -1e-9:
            raise InputError(
                f"crosstalk to the {VIEWS[view]} eye: a white {VIEWS[other]} picture must add "
                f"light there, got {white.min():.3g} of white. Were the filters exchanged, or "
                f"black not subtracted?"
            )
        if not np.linalg.norm(matrix, 2) < 0.9:
            raise InputError(
                f"crosstalk to the {VIEWS[view]} eye must be well below the picture itself, got "
                f"{np.linalg.norm(matrix, 2):.0%}. Is it in percent, or are the eyes exchanged?"
            )
