"""What every solver returns: the light, how good it is, and why the solver stopped."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import final

from domesim.light import Light


@final
class Status(Enum):
    """Why a solver stopped; the value tells a person what it means and what to do."""

    EXACT = "Nothing had to be clipped: the audience sees the master exactly."
    INVISIBLE = "What a better solution could still gain is far below what the eye can see."
    CONVERGED = "The requested accuracy was reached."
    WINDOWS = "Solved where pollution would be seen; elsewhere it was subtracted."
    AIMED = "Computed directly: the master, lifted where light is missing, is shown by subtraction."
    CLOSED_FORM = "Computed directly; nothing is minimised."
    STALLED = (
        "Rounding errors stopped further progress before the requested accuracy. "
        "Allow a larger tolerance, or solve in float64."
    )
    EXHAUSTED = (
        "The maximum number of iterations was reached before the requested accuracy. "
        "Allow more iterations or a larger tolerance."
    )


@final
@dataclass(frozen=True)
class Result:
    """The outcome of a solver.

    Parameters
    ----------
    light
        (view, row, col, primary) light to project, within the bounds.
    cost
        Objective at `light`; None where nothing was minimised.
    optimality
        Largest KKT residual at `light`; None likewise.
    status
        Why the solver stopped.
    iterations
        Iterations done.
    ffts
        FFTs of planes done.
    gap
        Certified upper bound of (cost - minimum) / minimum; None where nothing is certified. It is
        proven for exact sums. For their rounding, 16 eps of the start's cost and 32 of the minimum
        are added. In single precision, costs of 24 random domes were off by at most 1.3e-6; an
        independent check found up to 4e-6 missing from the first 16 eps (3.8e-6 are 32).
    """

    light: Light
    cost: float | None
    optimality: float | None
    status: Status
    iterations: int
    ffts: int
    gap: float | None = None
