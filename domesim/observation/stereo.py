"""What systems of several views share: each eye sees its own view and some of the others'."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.light import Light
from domesim.light.guarded import guarded
from domesim.observation.base import AdjointObservation

VIEWS = ("left", "right")
"""Names of a pair's views, in `Light`'s order."""


def view_names(views: int) -> tuple[str, ...]:
    """Names of views, as messages have them: ``left eye``, or ``view 3``, from 1."""
    if views == len(VIEWS):
        return tuple(f"{name} eye" for name in VIEWS)
    return tuple(f"view {number}" for number in range(1, views + 1))


class StereoObservation(AdjointObservation):
    """An affine observation of views that mixes no pixels, but views and primaries.

    Direct light D is the identity (for each seat): a frame is what an eye sees of its own
    projector.
    """

    def local(self, light: Light) -> Light:
        """Returns A x: no pixel's light is seen in another place."""
        return self.linear(light)

    def local_adjoint(self, light: Light) -> Light:
        """Returns A' y."""
        return self.adjoint(light)

    @property
    @abstractmethod
    def central(self) -> NDArray[Any]:
        """(seen view, primary, view, primary): the one matrix nearest to all pixels' own."""


@guarded
def require_black(
    black: ArrayLike, primaries: int, shape: tuple[int, ...] = (2,)
) -> NDArray[np.float64]:
    """Light without any picture, in full.

    Parameters
    ----------
    black
        Light, 1.0 = projector white: one number, (view, 1), (primary,) or (view, primary); or of
        `shape`.
    primaries
        Number of primaries.
    shape
        (view,), or (view, row, col, primary) of light that has a place.

    Returns
    -------
    black
        (view, primary), or of `shape`.

    Raises
    ------
    InputError
        If it is negative or not finite.
    InputError
        If it has another shape.
    """
    stated = np.asarray(black, np.float64)
    full = shape if len(shape) > 1 else (*shape, primaries)
    if stated.shape not in {(), (shape[0], 1), (primaries,), full}:
        raise InputError(f"black takes shape {full}, got {stated.shape}")
    if not np.isfinite(stated).all():
        raise InputError("black must be finite, got NaN or infinity")
    if stated.min() < 0:
        raise InputError(f"black must be light >= 0, got {stated.min():g}")
    return np.array(np.broadcast_to(stated, full))
