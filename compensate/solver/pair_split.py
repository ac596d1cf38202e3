"""A stereo pair's problem for ADMM: crosstalk mixes views, Fourier diagonalises the rest.

What an eye sees of one frequency is a small matrix times what is projected at that frequency: with
the views' primaries stacked, C is (seen views x primaries) by (2 x primaries), the same for all
pixels, and the Hessian of 1/2 ||A (C x - t)||² is for each frequency

    H_0(f) = C' A'A C = sum over seen views v and channels c of Omega_c(f)² u_vc u_vc',
    u_vc = C_v' t_c           t_c: row c of the opponent transform T

a matrix of 6 x 6 planes. Where both directions leak alike it falls apart into two of 3 x 3, in the
sum and the difference of the views.
"""

from __future__ import annotations

from typing import final

import numpy as np

from compensate.problem import Problem
from compensate.solver.hessian import PairHessian
from compensate.solver.level import Planes
from compensate.solver.split import BoxSplit, light_of, planes_of
from domesim.light import Light
from domesim.observation.stereo import StereoObservation


@final
class PairSplit(BoxSplit):
    """The problem of two views, both pictures' pixels alike.

    Parameters
    ----------
    problem
        One of a `StereoObservation`. Crosstalk counts as its central matrix at all pixels.
    """

    def __init__(self, problem: Problem) -> None:
        observation = problem.observation
        if not isinstance(observation, StereoObservation):
            raise ValueError(f"PairSplit takes a stereo pair, got {type(observation).__name__}")
        super().__init__(problem)
        self._observation = observation

    @property
    def uniform(self) -> bool:
        """See `BoxSplit`."""
        return self._observation.uniform

    def direction(self, planes: Planes) -> Light:
        """Light, as it is."""
        return light_of(planes, 2)

    def from_gradient(self, gradient: Light) -> Planes:
        """Planes, as they are."""
        return planes_of(gradient)

    def pinned_gradient(self, weighted: Light) -> Planes:
        """See `BoxSplit`: crosstalk is the central matrix there."""
        primaries = weighted.shape[3]
        central = self._observation.central
        result = []
        for view, p in np.ndindex(2, primaries):
            plane = 0 * weighted[0, :, :, 0]
            for seen, q in np.ndindex(weighted.shape[0], primaries):
                if central[seen, q, view, p]:
                    plane += weighted[seen, :, :, q] * float(central[seen, q, view, p])
            result.append(plane)
        return result

    def _hessian(self) -> PairHessian:
        squares = self.weighting.squares(self.base)
        return PairHessian(
            self._observation.central, self.weighting, squares, self.weighting.fourier
        )

    def _seen(self, light: Light) -> Light:
        return light
