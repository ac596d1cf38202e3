"""From a master to the frame to project: the paper's Fig. 3 as code.

    file -> frames -> projector.decode -> Light -> problem -> solver -> projector.encode -> file

`compensate` is the engine's one entry for Light. `solve_frame` adds the file's side: encoding, and
the figures that say what was done and how good it is.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from compensate.aim import Aim
from compensate.figures import Appraisal, Figures
from compensate.methods import Solver
from compensate.own import own_problem
from compensate.pose import Eye, Posed, Stage, require_within_range
from compensate.solve import solved
from compensate.solver.fitting import fitting
from compensate.solver.result import Result
from compensate.weighting import PerceptualWeighting, Weighting
from domesim.frames import Master
from domesim.light import Light, require_light
from domesim.observation.base import AdjointObservation
from domesim.scene import Scene
from domesim.scene.screening import encoded


@final
@dataclass(frozen=True)
class Outcome:
    """A compensated master: the frame, its light, its figures, and what computes more of them."""

    frame: Master
    light: Light
    figures: Figures
    appraisal: Appraisal


def compensate(
    desired: Light,
    scene: Scene,
    *,
    solver: Solver | None = None,
    weighting: Eye | Weighting | None = None,
    observation: AdjointObservation | None = None,
) -> Result:
    """The light to project so that what the audience sees is as close as can be to `desired`.

    Parameters
    ----------
    desired
        (view, row, col, primary) master light in 0..1: a domemaster, or left and right. It is
        wanted *without* pollution and ambient light.
    scene
        The theatre, or stereo system.
    solver
        Any of `compensate.solver`; the product's by default.
    weighting
        Settings of the vision model; or how much a residual matters, by a weighting of one's own,
        such as `compensate.own.LinearWeighting`.
    observation
        What is seen, if not by the scene's own: such as
        `domesim.observation.linear.LinearObservation`. The weighting is the paper's then, unless it
        is an `Aim`; by default the solver is that of `compensate.solver.fitting`.

    Raises
    ------
    InputError
        If the master leaves 0..1 on the screen (see `domesim.scene.screening.within_range`).
    """
    own = observation is not None and not isinstance(weighting, Aim)
    if own or isinstance(weighting, Weighting):
        require_light(desired, who="compensate")
        screen = scene.screen(*desired.shape[1:3])
        require_within_range(desired, screen)
        assert not isinstance(weighting, Aim)
        problem = own_problem(desired, scene, observation, weighting)
        chosen = solver or fitting(problem).solver
        assert problem.anchor is not None
        found = chosen(problem, problem.anchor)
        return replace(found, light=np.where(screen[None, :, :, None], found.light, desired))
    if weighting is None and solver is not None:
        weighting = PerceptualWeighting()
    posed = Stage(scene, weighting, observation).pose(desired)
    found = solved(posed, "perceptual", solver)
    if posed.desired is desired:
        return found
    on = posed.screen[None, :, :, None]
    return replace(found, light=np.where(on, found.light, desired))


def solve_frame(
    frame: Master, posed: Posed, out_of_range: float, method: str, solver: Solver | None = None
) -> Solution:
    """What one method projects for a master that `Stage.pose_frame` has posed."""
    begin = time.perf_counter()
    result = solved(posed, method, solver)
    return Solution(frame, posed, out_of_range, method, result, time.perf_counter() - begin)


@final
@dataclass(frozen=True)
class Solution:
    """A solved frame: parameters as of `solve_frame`, what it found, and the seconds it took."""

    frame: Master
    posed: Posed
    out_of_range: float
    method: str
    result: Result
    seconds: float

    def outcome(self, appraisal: Appraisal | None = None) -> Outcome:
        """The frame to project, in the master's own encoding, and the figures.

        Other methods' outcomes of the same posed master may share an `appraisal`.
        """
        found = appraisal or Appraisal(self.posed)
        frame, clipped = self.encoded()
        return Outcome(frame, self.result.light, self.figures(found, clipped), found)

    def encoded(self) -> tuple[Master, float]:
        """The frame to project, and `Figures.file_clipped`."""
        if self.method == "none" and self.frame.fits:
            return self.frame, 0.0
        return encoded(self.frame, self.result.light, self.posed.scene, self.posed.screen)

    def figures(self, found: Appraisal, file_clipped: float, *, brief: bool = False) -> Figures:
        """The figures of what `encoded` gives.

        If `brief`, `loss_before` and plain figures are left out where subtraction shows what is
        desired: in a sequence, their transforms would take longer than all the rest.
        """
        posed, result = self.posed, self.result
        brief = brief and posed.exact and result.light is posed.subtractive
        look = found.look(result.light, plain=not brief)
        left = found.foreseen(result.light)
        return Figures(
            method=self.method,
            clipped=found.clipped,
            out_of_range=self.out_of_range,
            pollution=found.pollution,
            loss_before=None if brief else found.loss_before,
            loss_subtractive=found.loss_subtractive,
            loss_after=look.loss,
            **vars(look.plain),
            ghost_edges=found.ghost_edges(result.light),
            loss_by_seat=look.by_seat,
            file_clipped=file_clipped,
            status=result.status.value,
            gap=result.gap,
            distance=found.distance(result),
            iterations=result.iterations,
            ffts=result.ffts,
            seconds=self.seconds,
            light_left=None if left is None else left.light.told,
            error_left=None if left is None else left.weighted.told,
        )
