"""A stereo pair's problem for ADMM in what is seen: see `seen_level`."""

from __future__ import annotations

import math
from typing import final

import numpy as np

from compensate.problem import Problem
from compensate.solver.hessian import PairHessian
from compensate.solver.level import Level, Planes, Value, padded
from compensate.solver.seen_level import SeenLevel
from compensate.solver.split import Split, light_of, planes_of, widths_of
from compensate.solver.two_eyes import TwoEyes
from domesim.light import Light, namespace, total
from domesim.observation.stereo import StereoObservation


@final
class SeenSplit(Split):
    """The problem of two eyes in w = K M (x - x_a).

    Parameters
    ----------
    problem
        One of a `StereoObservation` of one seat, with a contrast K.

    Raises
    ------
    ValueError
        If it is another.
    """

    def __init__(self, problem: Problem) -> None:
        observation = problem.observation
        if not isinstance(observation, StereoObservation) or problem.desired.shape[0] != 2:
            raise ValueError(
                f"contrast is weighted for one seat's two eyes, got {type(observation).__name__}"
            )
        if problem.contrast is None:
            raise ValueError("SeenSplit takes a problem with a contrast, got none")
        super().__init__(problem)
        self._observation = observation
        base, weighting = self.base, self.weighting
        identity = np.zeros((2, base.shape[3]) * 2)
        for view in range(2):
            identity[view, :, view] = np.eye(base.shape[3])
        lower = namespace(base).broadcast_to(problem.lower, base.shape)
        self._level = SeenLevel(
            PairHessian(identity, weighting, weighting.squares(base), weighting.fourier),
            [],
            problem.regularisation,
            [*problem.damping] * 2,
            TwoEyes.of(observation, base),
            [problem.contrast[view, :, :, 0] for view in range(2)],
            planes_of(lower - base),
            widths_of(problem),
            None if self._offset is None else planes_of(self._seen(self._offset)),
            stiffness=self._stiffness(),
        )

    @property
    def typical(self) -> float:
        """See `Split`: a pair's damping may be far above the median Omega²."""
        stiffness = self.problem.stiffness
        raised = 1.0 if stiffness is None else float(total(stiffness)) / math.prod(stiffness.shape)
        return self.weighting.typical + raised * float(np.mean(self._level.damping))

    def light(self, planes: Planes) -> Light:
        """See `Split`."""
        xp, problem = namespace(self.base), self.problem
        x = self.base + light_of(self._level.change(planes), 2)
        return xp.minimum(xp.maximum(x, problem.lower), problem.upper)

    def _finest(self) -> Level:
        return self._level

    def _stiffness(self) -> Value:
        stiffness = self.problem.stiffness
        if stiffness is None:
            return 1.0
        return padded(stiffness[0, :, :, 0] - 1, self.weighting.fourier) + 1

    def _seen(self, light: Light) -> Light:
        return self._observation.linear(light) * self.problem.contrast
