"""Observations and weightings of one's own: the problem that they pose in a scene.

The scene still says where the screen is, how it is looked at and how bright it is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from compensate.fourier import Fourier
from compensate.pose import graded
from compensate.problem import Problem
from compensate.solver.accelerated import Accelerated
from compensate.weighting import REGULARISATION, PerceptualWeighting, Weighting
from domesim.errors import InputError
from domesim.light import Array, Light
from domesim.light.guarded import guarded
from domesim.observation.base import AdjointObservation, Observation
from domesim.observation.linear import require_linear
from domesim.scene import Scene


@final
class LinearWeighting(Weighting):
    """A weighting of one's own: any linear map of the residual.

    Parameters
    ----------
    shape
        (view, row, col, primary) of residuals.
    apply
        r -> lambda(r), an array of any shape.
    adjoint
        w -> lambda'(w), of `shape`. It is tried on noise.

    Raises
    ------
    ValueError
        If `apply` is not linear, or `adjoint` does not belong to it.
    """

    def __init__(
        self,
        shape: tuple[int, int, int, int],
        apply: Callable[[Light], Array],
        adjoint: Callable[[Array], Light],
    ) -> None:
        require_linear("LinearWeighting", shape, apply, adjoint)
        self._shape, self._weight, self._weight_adjoint = shape, apply, adjoint
        self._fourier = Fourier(shape[1], shape[2])

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(view, row, col, primary)."""
        return self._shape

    @property
    def fourier(self) -> Fourier:
        """No transform is counted: nobody knows what the map does."""
        return self._fourier

    @property
    def peak(self) -> float:
        """1: what is weighted has no unit."""
        return 1.0

    def _apply(self, residual: Light) -> Array:
        return self._weight(residual)

    def _adjoint(self, weighted: Array) -> Light:
        return self._weight_adjoint(weighted)


@guarded
def own_problem(
    desired: Light,
    scene: Scene,
    observation: Observation | None = None,
    weighting: Weighting | PerceptualWeighting | None = None,
) -> Problem:
    """Poses a master with another observation or weighting than the scene's own.

    Where the weighting sees nothing, the light is the nearest to what is desired by plain least
    squares, as exact subtraction.

    Parameters
    ----------
    desired
        (view, row, col, primary) master light in 0..1.
    scene
        The theatre, or stereo system of one seat.
    observation
        What is seen, none of whose light without a picture is kept; None for the scene's.
    weighting
        How much a residual matters; None for the paper's.

    Returns
    -------
    problem
        Its anchor is the nearest light.

    Raises
    ------
    InputError
        If the observation has no adjoint (a grey-to-grey table).
    ValueError
        If shapes do not fit.
    """
    rows, cols = desired.shape[1:3]
    screen, kept = scene.screen(rows, cols), None
    if observation is None:
        kept = scene.kept
        observation = scene.solvable(rows, cols)
    if not isinstance(observation, AdjointObservation):
        raise InputError(
            f"{scene.name}: a weighting's least squares need an observation with an adjoint, got "
            f"{type(observation).__name__}; give a LinearObservation that is near it, or "
            f"weighting='aim', which needs none"
        )
    if not isinstance(weighting, Weighting):
        settings = weighting or PerceptualWeighting()
        views = observation.seen_shape[0]
        weighting = settings(scene.viewing, scene.projector.luminance_weights, screen, views)
    on = screen[None, :, :, None].astype(desired.dtype)
    desired = desired * on
    wanted = graded(observation.direct(desired), kept, screen)
    bounds = (0.0, on)
    plain = LinearWeighting(observation.seen_shape, lambda light: light, lambda light: light)
    nearest = Accelerated(1e-3)(Problem(observation, plain, wanted, bounds), desired)
    return Problem(
        observation, weighting, wanted, bounds, anchor=nearest.light, regularisation=REGULARISATION
    )
