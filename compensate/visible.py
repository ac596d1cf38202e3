"""Solve only where what subtraction leaves is predicted to be seen (section 5 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from compensate.master import Posed
from compensate.methods import Solver
from compensate.prediction import Combination, Prediction, regions, remaining
from compensate.problem import Problem
from compensate.solver.result import Result
from compensate.solver.windows import Windows
from domesim.light import Light

SEEN = Prediction(combination=Combination.LOCAL_CONTRAST)
"""Of the masks that were tried the nearest to what ColorVideoVDP marks (``validate --only
only_visible``, note 0009)."""

PAIR_MARGIN, DOME_MARGIN = 0.5, 3.0
"""Around what is seen, degrees: there the solver has room to hide it. The mask itself reaches some
tenths of a degree beyond a ghost. With 1 degree, a dome lost 0.07 JOD against the whole solution
(note 0009)."""

REACH = 0.5
"""How far around that a window looks, degrees: what lies further off changes costs by less than
1e-3 (``tests/compensate/test_windows.py``)."""


@final
@dataclass(frozen=True)
class OnlyVisible:
    """A solver of a posed frame, of rectangles that hold all that is predicted to be seen.

    Parameters
    ----------
    posed
        The frame.
    solver
        Of each rectangle; of the whole if that is less work.
    prediction
        What is seen.
    """

    posed: Posed
    solver: Solver
    prediction: Prediction = SEEN

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Solve it from exact subtraction; elsewhere that stays."""
        mask = remaining(self.posed, self.prediction).mask
        margin = DOME_MARGIN if self.posed.scene.views == 1 else PAIR_MARGIN
        boxes = regions(mask, _pixels(margin, self.posed))
        return Windows(tuple(boxes), reach_of(self.posed), self.solver)(problem, start)


def reach_of(posed: Posed) -> int:
    """`REACH` in pixels."""
    return _pixels(REACH, posed)


def _pixels(degrees: float, posed: Posed) -> int:
    return round(degrees * posed.scene.viewing.pixels_per_degree(*posed.screen.shape))
