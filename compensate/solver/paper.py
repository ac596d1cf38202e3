"""The paper's own method for stereo pairs, kept faithful: what ours is compared with.

Section 3.4: x_L and x_R are stacked; each channel of YCbCr is a problem of its own (section 3.1),
weighted by Daly's sensitivity as it is, and solved by GPCG with the pollution frozen during each
iteration (eq. 9). Cb and Cr have no bounds of their own in the paper; here they keep to their
range, and the result is clipped into the projector's gamut at the end.

The paper measures crosstalk in XYZ, takes it to RGB, "gamma corrects" it and transforms it to
YCbCr. Our reading: to *linear* YCbCr, for crosstalk is linear in light only (the other reading is
worse than doing nothing: ``validation/experiments/table1.py``). Crosstalk that mixes channels
cannot be solved channel by channel: what mixes them is left out, as the paper's equations do.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.problem import Problem
from compensate.solver.gpcg import GPCG
from compensate.solver.result import Result, Status
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import (
    CsfWeighting,
    Masked,
    PerceptualWeighting,
    Weighting,
    linear_ycbcr,
)
from domesim.errors import InputError
from domesim.light import Light
from domesim.observation.crosstalk import Crosstalk
from domesim.room.viewing import Viewing

RANGES = ((0.0, 1.0), (-0.5, 0.5), (-0.5, 0.5))
"""Ranges of Y, Cb and Cr."""


@final
@dataclass(frozen=True)
class PaperMethod:
    """Settings of the method; call it with a problem of two views, and a start.

    Parameters
    ----------
    viewing
        How the pair is seen; the paper's: a screen of 2.5 m, 16:9, at 3.0 m, 5 cd/m².
    luminance_weights
        (primary,) share of each of the projector's primaries in the luminance of its white: Y.
    solver
        What solves each channel.
    """

    viewing: Viewing
    luminance_weights: NDArray[np.floating[Any]]
    solver: GPCG = field(default_factory=lambda: GPCG(frozen=True))

    def __call__(self, problem: Problem, start: Light) -> Result:
        """The three channels' solutions from `start`, clipped into the gamut.

        Raises
        ------
        InputError
            If the problem is not one of linear crosstalk of two views and three primaries.
        """
        observation, weighting = problem.observation, problem.weighting
        if not isinstance(observation, Crosstalk) or observation.shape[3] != 3:
            raise InputError(
                f"PaperMethod takes crosstalk of three primaries, got "
                f"{type(observation).__name__} {observation.shape}"
            )
        mask = weighting.picture if isinstance(weighting, Masked) else None
        if isinstance(weighting, Masked):
            weighting = weighting.inner
        if not isinstance(weighting, CsfWeighting):
            raise InputError(f"PaperMethod takes a CsfWeighting, got {type(weighting).__name__}")
        to_ycc = linear_ycbcr(self.luminance_weights)
        pure = LowFrequencyFloor(0.0)
        daly = PerceptualWeighting(pure, pure)(
            self.viewing, self.luminance_weights, weighting.support
        )
        black = observation.observe(np.zeros_like(problem.desired))
        wanted = (problem.desired - black) @ to_ycc.T.astype(start.dtype)
        channels = start @ to_ycc.T.astype(start.dtype)
        mixed = to_ycc @ observation.matrices @ np.linalg.inv(to_ycc)
        iterations = ffts = 0
        converged = True
        for c, (low, high) in enumerate(RANGES):
            one = (slice(None),) * 3 + (slice(c, c + 1),)
            leak = Crosstalk(
                *observation.shape[1:3], mixed[:, c : c + 1, c : c + 1], share=_map(observation)
            )
            alone: Weighting = CsfWeighting(
                daly.gains, np.eye(1), daly.support, daly.padded, daly.peak, 2
            )
            if mask is not None:
                alone = Masked(mask, alone)
            result = self.solver(
                Problem(leak, alone, wanted[one], (low, high)), np.clip(channels[one], low, high)
            )
            channels[one] = result.light
            iterations, ffts = max(iterations, result.iterations), ffts + result.ffts
            converged &= result.status is Status.CONVERGED
        light = problem.project((channels @ np.linalg.inv(to_ycc).T).astype(start.dtype))
        before = problem.ffts
        cost, gradient = problem.quadratic(light)
        return Result(
            light,
            cost,
            problem.kkt_residual(light, gradient),
            Status.CONVERGED if converged else Status.EXHAUSTED,
            iterations,
            ffts + problem.ffts - before,
        )


def _map(observation: Crosstalk) -> np.ndarray | None:
    return None if observation.share.shape[1:] == (1, 1) else observation.share
