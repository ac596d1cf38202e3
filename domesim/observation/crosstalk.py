"""Crosstalk: some of the light for one eye, or view, reaches others (eq. 8 of the paper).

    psi(x)_v = x_v + s_v sum_u M_vu x_u + black_v        v: the view that sees, u: the others

M_vu is a matrix over the primaries, for coloured filters leak some colours more than others, and
differently from left to right than from right to left. s_v, a map over the screen, says how it
varies from the sweet spot to the edge: 1.1 % to 2.0 % in the cinema of the paper's section 7. A
pair has two views, and M_v of the other one; a display without glasses has many, and what leaks
between any two of them.

An entry of M may be negative: a ghost more saturated than the seeing eye's own primaries has no
other description. What cannot be is a white picture that *takes* light from another view (a
negative row sum; the readings were taken with the filters exchanged, or without subtracting black),
nor a leak as bright as the picture itself, which no projector could undo. Of many views, neighbours
may together be as bright as the picture. Their light can be undone as long as the symmetric part of
1 + M is positive definite: then no two frames look the same (x' (1 + M) x > 0 for each change x).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.light import Array, Light, kind, namespace
from domesim.light.guarded import guarded
from domesim.light.strips import in_strips
from domesim.observation.stereo import StereoObservation, require_black, view_names

_Leaks: TypeAlias = list[list[tuple[int, Array]]]
"""Of each seeing view: the views that leak to it, with their matrices."""
_LEAST = 0.01
"""Least light by which the symmetric part of 1 + M tells a change of the frame."""


@final
class Crosstalk(StereoObservation):
    """Linear crosstalk of two or more views of a flat screen.

    Parameters
    ----------
    rows, cols
        Size of the views.
    matrices
        Of a pair: (view, primary, primary) M, light of the other view (last axis) that the eye of
        that view sees as its own primaries (see `leak_matrices`). Of many views: (view, primary,
        view, primary) M, seen by sent, whose entries from a view to itself are 0 (see
        `leaks_of_views`).
    share
        (view, row, col) s; 1 everywhere if None.
    black
        Light that each eye sees without any picture, in units of white: (view, primary), or (view,
        row, col, primary) where it has a place, such as the room behind a display that adds light.

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
        leaks = np.asarray(matrices, np.float64)
        if leaks.ndim == 3 and len(leaks) == 2 and leaks.shape[1] == leaks.shape[2]:
            leaks = _of_pair(leaks)
        if leaks.ndim != 4 or leaks.shape[:2] != leaks.shape[2:] or len(leaks) < 2:
            raise InputError(
                f"Crosstalk takes matrices (2, p, p), or (n, p, n, p) of n views, got {leaks.shape}"
            )
        views, primaries = leaks.shape[:2]
        if share is None:
            share = np.ones((views, 1, 1))
        elif share.shape != (views, rows, cols):
            raise InputError(f"Crosstalk takes a map {(views, rows, cols)}, got {share.shape}")
        self._shape = (views, rows, cols, primaries)
        self._leaks = leaks
        self._share = np.asarray(share, np.float64)
        placed = np.shape(black) == self._shape
        self._black = require_black(black, primaries, self._shape if placed else (views,))
        _require_possible(self._leaks, self._share)
        self._converted: dict[tuple[str, ...], tuple[_Leaks, list[Array], Array]] = {}

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(view, row, col, primary)."""
        return self._shape

    @property
    def leaks(self) -> NDArray[np.float64]:
        """(view, primary, view, primary) M, seen by sent."""
        return self._leaks

    @property
    def matrices(self) -> NDArray[np.float64]:
        """(view, primary, primary) M of a pair."""
        return np.stack([self._leaks[view, :, 1 - view] for view in range(2)])

    @property
    def share(self) -> NDArray[np.float64]:
        """(view, row, col) s, or (view, 1, 1)."""
        return self._share

    @property
    def black(self) -> NDArray[np.float64]:
        """Light without any picture: (view, primary), or (view, row, col, primary)."""
        return self._black

    @property
    def dark(self) -> NDArray[np.float64]:
        """The same as (view, 1 or row, col, primary): NumPy repeats three numbers slowly."""
        if self._black.ndim == len(self._shape):
            return self._black
        return np.repeat(self._black[:, None, None, :], self._shape[2], axis=2)

    @property
    def central(self) -> NDArray[Any]:
        """(view, primary, view, primary): the matrix by the mean of the map."""
        result = np.asarray(self._share.mean(axis=(1, 2))[:, None, None, None] * self._leaks)
        views, primaries = self._leaks.shape[:2]
        for view in range(views):
            result[view, :, view] = np.eye(primaries)
        return result

    @property
    def strength(self) -> float:
        """Largest share of the other views' light that a pixel sees: ||s_v M_v||."""
        norms = np.linalg.norm(self._leaks.reshape(*self._leaks.shape[:2], -1), 2, axis=(1, 2))
        return float(np.max(norms * self._share.max(axis=(1, 2))))

    def leaked(self, light: Light) -> Light:
        """phi(x): what each eye sees of other views' pictures, (view, row, col, primary)."""
        leaks, share, _ = self._like(light)
        found = [
            share[v] * _total([light[u, ...] @ matrix.T for u, matrix in each], light[v, ...])
            for v, each in enumerate(leaks)
        ]  # eq. 8
        return namespace(light).stack(found)

    def _observe(self, light: Light) -> Light:
        if not isinstance(light, np.ndarray):
            return light + self.leaked(light) + self._like(light)[2]
        leaks, share, black = self._like(light)
        seen = np.empty_like(light)
        mixing = [[(u, mixing_by(matrix, light)) for u, matrix in each] for each in leaks]

        def observe(view: int, rows: slice) -> None:
            parts = (mix(light[u, rows]) for u, mix in mixing[view])
            part = next(parts, None)
            part = np.zeros_like(light[view, rows]) if part is None else part
            for each in parts:
                part += each
            part *= share[view] if len(share[view]) == 1 else share[view][rows]
            part += light[view, rows]
            dark = black[view] if len(black[view]) == 1 else black[view][rows]
            np.add(part, dark, out=seen[view, rows])

        in_strips(observe, light.shape)
        return seen

    def _direct(self, light: Light) -> Light:
        return light

    def _linear(self, light: Light) -> Light:
        return light + self.leaked(light)

    def _adjoint(self, light: Light) -> Light:
        leaks, share, _ = self._like(light)
        back: list[list[Array]] = [[] for _ in leaks]
        for v, each in enumerate(leaks):
            seen = share[v] * light[v, ...]
            for u, matrix in each:
                back[u].append(seen @ matrix)
        found = [_total(each, light[u, ...]) for u, each in enumerate(back)]
        return light + namespace(light).stack(found)

    def _direct_adjoint(self, light: Light) -> Light:
        return light

    def _like(self, light: Light) -> tuple[_Leaks, list[Array], Array]:
        """Leaks and maps (row, col, 1) by view, and `dark`."""
        key = kind(light)
        if key not in self._converted:
            xp = namespace(light)

            def convert(array: NDArray[Any]) -> Array:
                return xp.asarray(array, dtype=light.dtype, device=light.device)

            self._converted[key] = (
                [
                    [(u, convert(each[:, u])) for u in range(len(self._leaks)) if each[:, u].any()]
                    for each in self._leaks
                ],
                [convert(plane[..., None]) for plane in self._share],
                convert(self.dark),
            )
        return self._converted[key]


def _total(parts: list[Array], like: Array) -> Array:
    """The sum of arrays, of which there may be none."""
    return sum(parts[1:], start=parts[0]) if parts else namespace(like).zeros_like(like)


def _of_pair(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """(view, primary, view, primary) of a pair's (view, primary, primary)."""
    leaks = np.zeros((2, matrices.shape[1], 2, matrices.shape[1]))
    for view in range(2):
        leaks[view, :, 1 - view] = matrices[view]
    return leaks


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


@guarded(coarse="view row col")
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


@guarded
def leaks_of_views(shares: ArrayLike, primaries: int = 3) -> NDArray[np.float64]:
    """Leaks between many views, of what is told as shares of light.

    Parameters
    ----------
    shares
        (view, view) share of a view's light (last axis) that is seen in another one; or
        (primary, view, view). From a view to itself they are not read.
    primaries
        Number of primaries.

    Returns
    -------
    leaks
        (view, primary, view, primary), as `Crosstalk` takes them.

    Raises
    ------
    InputError
        If they have another shape.
    """
    stated = np.asarray(shares, np.float64)
    if stated.ndim not in (2, 3) or stated.shape[-1] != stated.shape[-2]:
        raise InputError(f"leaks_of_views takes shares (view, view), got {stated.shape}")
    if stated.ndim == 3 and len(stated) != primaries:
        raise InputError(f"leaks_of_views takes shares of {primaries} primaries, got {len(stated)}")
    each = np.array(np.broadcast_to(stated, (primaries, *stated.shape[-2:])))
    each[:, range(stated.shape[-1]), range(stated.shape[-1])] = 0
    return np.asarray(np.einsum("pvu,pq->vpuq", each, np.eye(primaries)))


def _require_possible(leaks: NDArray[np.float64], share: NDArray[np.float64]) -> None:
    for name, values in (("crosstalk", leaks), ("crosstalk map", share)):
        if not np.isfinite(values).all():
            raise InputError(f"{name} must be finite, got NaN or infinity")
    if share.min() < 0:
        raise InputError(f"crosstalk map must be light >= 0, got {share.min():g}")
    largest = share.max(axis=(1, 2))
    views, primaries = leaks.shape[:2]
    names = view_names(views)
    for view, name in enumerate(names):
        matrix = largest[view] * leaks[view]
        least = matrix.sum(axis=2).min(axis=0)
        if matrix[:, view].any():
            raise InputError(f"crosstalk from the {name} to itself must be 0: it is own light")
        if least.min() < -1e-9:
            raise InputError(
                f"crosstalk to the {name}: a white picture of the {names[int(least.argmin())]} "
                f"must add light there, got {least.min():.3g} of white. Were the filters "
                f"exchanged, or black not subtracted?"
            )
        norm = float(np.linalg.norm(matrix.reshape(primaries, -1), 2))
        if not norm < 0.9:
            raise InputError(
                f"crosstalk to the {name} must be well below the picture itself, got "
                f"{norm:.0%}. Is it in percent, or are the eyes exchanged?"
            )
    whole = (largest[:, None, None, None] * leaks).reshape(views * primaries, -1)
    least_told = 1 + float(np.linalg.eigvalsh((whole + whole.T) / 2)[0])
    if least_told < _LEAST:
        raise InputError(
            f"crosstalk of {views} views cannot be undone: of some frames that differ, "
            f"{least_told:.2g} of the difference is seen, wanted {_LEAST:g} at least. Are the "
            f"shares those of own light, and the views in order?"
        )
