"""An observation of one's own: any linear map from projected to seen light, and a constant.

    psi(x) = A x + ambient

A is given by a function and its adjoint, or by a matrix. What is desired is seen by D x = x.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Self, final

import numpy as np
from numpy.typing import ArrayLike

from domesim.errors import InputError
from domesim.light import Light, as_sent, dot, namespace, on_host
from domesim.light.guarded import require_numbers
from domesim.observation.base import AdjointObservation

_ROUNDING = 1e-4  # a map may compute in float32


@final
class LinearObservation(AdjointObservation):
    """A x + ambient.

    Parameters
    ----------
    shape
        (view, row, col, primary) of the light, projected and seen.
    apply
        x -> A x: direct light and all pollution.
    adjoint
        y -> A' y, with <A x, y> = <x, A' y>. It is tried on noise.
    ambient
        What is seen without a picture; broadcasts with light.

    Raises
    ------
    InputError
        If `apply` is not linear, or `adjoint` does not belong to it.
    """

    def __init__(
        self,
        shape: tuple[int, int, int, int],
        apply: Callable[[Light], Light],
        adjoint: Callable[[Light], Light],
        ambient: ArrayLike = 0.0,
    ) -> None:
        self._shape, self._apply, self._apply_adjoint = shape, apply, adjoint
        require_numbers("LinearObservation's ambient", ambient)
        self._ambient = np.asarray(ambient)
        try:
            np.broadcast_to(self._ambient, shape)
        except ValueError:
            raise InputError(
                f"LinearObservation's ambient must broadcast to {shape}, got {self._ambient.shape}"
            ) from None
        require_linear("LinearObservation", shape, apply, adjoint)

    @classmethod
    def of_matrix(
        cls, shape: tuple[int, int, int, int], matrix: ArrayLike, ambient: ArrayLike = 0.0
    ) -> Self:
        """The observation that a matrix makes.

        Parameters
        ----------
        shape
            Sizes of the light: (view, row, col, primary).
        matrix
            (seen, projected), over all values of the light in C order; SciPy's sparse ones will do.
        ambient
            Light without a picture, 1.0 = projector white; broadcasts to `shape`.

        Returns
        -------
        observation
            Its adjoint is the matrix transposed.

        Raises
        ------
        InputError
            If matrix or ambient are no finite real numbers of these sizes.
        """

        def product(by: ArrayLike, light: Light) -> Light:
            if not isinstance(by, np.ndarray):  # sparse ones are SciPy's, for NumPy's arrays
                return as_sent(np.reshape(by @ np.ravel(on_host(light)), shape), light)
            xp = namespace(light)
            return xp.reshape(as_sent(by, light) @ xp.reshape(light, (-1,)), shape)

        rows: Any = matrix if hasattr(matrix, "tocsr") else np.asarray(matrix)
        if isinstance(rows, np.ndarray):
            require_numbers("LinearObservation's matrix", rows)
        size = math.prod(shape)
        if rows.shape != (size, size):
            raise InputError(f"LinearObservation's matrix must be {(size, size)}, got {rows.shape}")
        return cls(
            shape, lambda light: product(rows, light), lambda light: product(rows.T, light), ambient
        )

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(view, row, col, primary)."""
        return self._shape

    def _observe(self, light: Light) -> Light:
        ambient = namespace(light).asarray(self._ambient, dtype=light.dtype, device=light.device)
        return self._apply(light) + ambient

    def _linear(self, light: Light) -> Light:
        return self._apply(light)

    def _adjoint(self, light: Light) -> Light:
        return self._apply_adjoint(light)

    def _direct(self, light: Light) -> Light:
        return light

    def _direct_adjoint(self, light: Light) -> Light:
        return light


def require_linear(
    who: str,
    shape: tuple[int, ...],
    apply: Callable[[Light], Light],
    adjoint: Callable[[Light], Light],
) -> None:
    """Refuse a map of light that is not linear, or has another adjoint, on noise.

    Parameters
    ----------
    who
        Name of the caller, for the message.
    shape
        Sizes of the light that `apply` takes: (view, row, col, primary).
    apply, adjoint
        The map, and its adjoint.

    Raises
    ------
    InputError
        If `apply` is not linear, or `adjoint` is not its adjoint.
    """
    random = np.random.default_rng(0)
    x = random.standard_normal(shape)
    seen = apply(x)
    # What is not a number is not at most anything
    if not np.linalg.norm(apply(-2 * x) + 2 * seen) <= _ROUNDING * np.linalg.norm(seen):
        raise InputError(
            f"{who} takes a linear apply, got one with apply(-2 x) other than -2 apply(x); a "
            f"constant is no part of it"
        )
    y = random.standard_normal(seen.shape)
    back = adjoint(y)
    if back.shape != shape:
        raise InputError(f"{who} takes an adjoint that returns {shape}, got {back.shape}")
    there, here = dot(seen, y), dot(x, back)
    if not abs(there - here) <= _ROUNDING * float(np.linalg.norm(seen) * np.linalg.norm(y)):
        raise InputError(
            f"{who} takes the adjoint of apply, got <A x, y> = {there:.6g} and <x, A' y> = "
            f"{here:.6g} for noise x and y"
        )
