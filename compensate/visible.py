"""Solve where pollution is predicted to be seen: only there, or by how visible it is there.

Section 5 of the paper solves only there. Its eq. 7 counts errors by the maps Lambda_n.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from compensate.methods import Solver
from compensate.pose import Posed
from compensate.prediction import Combination, Prediction, predict, regions, remaining
from compensate.problem import Problem
from compensate.solver.fitting import fitting
from compensate.solver.result import Result
from compensate.solver.windows import Windows
from compensate.weighting import Masked
from domesim.light import Light

SEEN = Prediction(combination=Combination.LOCAL_CONTRAST)
"""The prediction whose mask, of all that were tried, is nearest to what ColorVideoVDP marks
(note 0009)."""

PAPERS = Prediction(combination=Combination.PAPER)
"""The prediction of eqs. 12 to 14."""

PAIR_MARGIN, DOME_MARGIN = 0.5, 3.0
"""Margins around what is seen, degrees, in which the solver has room to hide it. The mask itself
reaches some tenths of a degree beyond a ghost. With 1 degree, a dome lost 0.07 JOD against the
whole solution (note 0009)."""

REACH = 0.5
"""Distance beyond that margin up to which a window looks, degrees: what lies further off changes
costs by less than 1e-3 (``tests/compensate/solver/test_windows.py``)."""


@final
@dataclass(frozen=True)
class OnlyVisible:
    """A solver of a posed frame, of rectangles that hold all that is predicted to be seen.

    Parameters
    ----------
    posed
        The frame.
    solver
        Solver of each rectangle, or of the whole picture if that is less work.
    prediction
        Settings of the prediction of what is seen.
    """

    posed: Posed
    solver: Solver
    prediction: Prediction = SEEN

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Solve the problem in the rectangles; elsewhere exact subtraction stays."""
        mask = remaining(self.posed, self.prediction).mask
        margin = DOME_MARGIN if self.posed.scene.views == 1 else PAIR_MARGIN
        boxes = regions(mask, _pixels(margin, self.posed))
        return Windows(tuple(boxes), reach_of(self.posed), self.solver)(problem, start)


@final
@dataclass(frozen=True)
class SpatiallyWeighted:
    """A solver of a posed frame whose errors count by how visible pollution is there (eq. 7).

    A_n is the map Lambda_n of the untouched master. Where it is 0, only the regulariser counts.

    Parameters
    ----------
    posed
        The frame.
    solver
        One that takes masked weightings; None for the one that `fitting` finds.
    prediction
        Settings of the prediction of what is seen; by default `PAPERS`.
    """

    posed: Posed
    solver: Solver | None = None
    prediction: Prediction = PAPERS

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Solve the problem with its weighting masked by A_n."""
        maps = predict(self.posed, settings=self.prediction).prediction
        masked = problem.weighted_by(Masked(maps, problem.weighting))
        return (self.solver or fitting(masked).solver)(masked, start)


def reach_of(posed: Posed) -> int:
    """Returns `REACH` in pixels."""
    return _pixels(REACH, posed)


def _pixels(degrees: float, posed: Posed) -> int:
    return round(degrees * posed.scene.viewing.pixels_per_degree(*posed.screen.shape))
