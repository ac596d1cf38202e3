"""From a master to the frame to project: the paper's Fig. 3 as code.

    file -> frames -> projector.decode -> Light -> problem -> solver -> projector.encode -> file

`compensate` is the engine's one entry for Light. `solve_frame` adds the file's side: encoding, and
the figures that say what was done and how good it is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, final

import numpy as np

from compensate.aim import Aim
from compensate.figures import Appraisal, Figures, Glance
from compensate.methods import Solver, require_method
from compensate.own import own_problem
from compensate.pose import Eye, Posed, Stage, require_within_range
from compensate.prediction import Combination, Predicted, Prediction
from compensate.prediction import predict as predicted_of
from compensate.solve import solved
from compensate.solver.fitting import fitting
from compensate.solver.result import Result
from compensate.subtract import reflecting
from compensate.weighting import PerceptualWeighting, Weighting
from domesim.errors import InputError
from domesim.frames import Master
from domesim.light import Light, LightArray, as_sent, on_host, require_finite, require_light
from domesim.light.planes import gathered
from domesim.observation.base import AdjointObservation, Observation
from domesim.scene.grade import KEPT
from domesim.scene.loading import AnyScene, as_scene
from domesim.scene.screening import decoder, encoded

WEIGHTINGS: Mapping[str, Callable[[], Eye]] = {"aim": Aim, "paper": PerceptualWeighting}
"""What a picture is made for, by name."""


@final
@dataclass(frozen=True)
class Outcome:
    """A compensated master: the frame, its light, its figures, and what computes more of them."""

    frame: Master
    light: Light
    figures: Figures
    appraisal: Appraisal


def compensate(
    desired: LightArray,
    scene: AnyScene,
    *,
    method: str = "perceptual",
    solver: Solver | None = None,
    weighting: Eye | Weighting | Literal["aim", "paper"] | None = None,
    observation: Observation | None = None,
) -> Result:
    """Finds the light to project so that the audience sees as nearly as possible what is desired.

    Parameters
    ----------
    desired
        (view, row, col, primary) master light in 0..1: a domemaster, or left and right. It is
        wanted *without* pollution; of light without a picture it is wanted with what the scene
        keeps of that (`Scene.with_grade`): by default a flat screen's black, and nothing in a dome.
    scene
        The theatre, or stereo system; or its name or file.
    method
        One of `compensate.methods.METHODS`, as on the command line; the product's by default.
    solver
        Any of `compensate.solver`; the method's by default.
    weighting
        "aim", the default, or "paper"; settings of either; or how much a residual matters, by a
        weighting of one's own, such as `compensate.own.LinearWeighting`.
    observation
        What is seen, if not by the scene's own: such as
        `domesim.observation.linear.LinearObservation`. Of its light without a picture nothing is
        kept. What its class offers decides. The aim needs
        no more than ``observe`` and ``direct``: it is the default of a `LowRankObservation`, as of
        a scene's own, and of what has no adjoint. Of others the default is the paper's
        weighting, by a solver of `compensate.solver.fitting`; ``weighting="aim"`` fits them, too.

    Returns
    -------
    result
        The light, (view, row, col, primary), and why the method stopped. Off the screen it is the
        master's. It is of the master's library and device.

    Raises
    ------
    InputError
        If the master is no light of the scene's views, or leaves 0..1 on the screen (see
        `domesim.scene.screening.within_range`); if there is no such scene or method.
    """
    require_light(desired, who="compensate")
    scene = as_scene(scene)
    if isinstance(weighting, str):
        if weighting not in WEIGHTINGS:
            raise InputError(
                f"compensate takes {' or '.join(WEIGHTINGS)} as weighting, got {weighting!r}"
            )
        weighting = WEIGHTINGS[weighting]()
    if not isinstance(desired, np.ndarray):
        result = compensate(
            on_host(desired), scene, method=method, solver=solver, weighting=weighting,
            observation=observation,
        )  # fmt: skip
        return replace(result, light=as_sent(result.light, desired))
    if observation is not None and not isinstance(observation, Observation):
        raise InputError(
            f"compensate takes an Observation, got a {type(observation).__name__}; make one of "
            f"functions by domesim.observation.linear.LinearObservation"
        )
    if isinstance(weighting, Weighting) or _is_general(observation, weighting, method):
        screen = scene.screen(*desired.shape[1:3])
        require_within_range(desired, screen)
        assert not isinstance(weighting, Aim)
        problem = own_problem(desired, scene, observation, weighting)
        chosen = solver or fitting(problem).solver
        assert problem.anchor is not None
        result = chosen(problem, problem.anchor)
        return replace(result, light=np.where(screen[None, :, :, None], result.light, desired))
    if weighting is None and solver is not None:
        weighting = PerceptualWeighting()
    posed = Stage(scene, weighting, observation).pose(desired)
    require_method(method, scene)
    result = solved(posed, method, solver)
    if posed.desired is desired:
        return result
    on = posed.screen[None, :, :, None]
    return replace(result, light=np.where(on, result.light, desired))


def predict(
    desired: LightArray,
    scene: AnyScene,
    *,
    projected: LightArray | None = None,
    combination: Combination | str = Combination.WITH_VEILS,
    threshold: float | None = None,
) -> Predicted:
    """Predicts where light pollution will be seen.

    Parameters
    ----------
    desired
        (view, row, col, primary) master light in 0..1.
    scene
        The theatre, or stereo system; or its name or file.
    projected
        What is projected, of the same axes; the master itself by default.
    combination
        A `compensate.prediction.Combination`, or its name, as "paper".
    threshold
        As of `compensate.prediction.Prediction`, which has more settings.

    Returns
    -------
    predicted
        Maps, and the mask of where it will be seen.

    Raises
    ------
    InputError
        As for `compensate`, and if a setting is impossible.
    """
    require_light(desired, who="predict")
    require_finite(desired, who="predict")
    posed = Stage(as_scene(scene)).pose(on_host(desired))
    known = [each.value for each in Combination]
    if combination not in (*known, *Combination):
        raise InputError(f"predict takes {', '.join(known)} as combination, got {combination!r}")
    settings = Prediction(threshold, Combination(combination))
    if projected is None:
        return predicted_of(posed, settings=settings)
    require_light(projected, who="predict")
    require_finite(projected, who="predict")
    return predicted_of(posed, on_host(projected), settings)


def _is_general(observation: Observation | None, eye: Eye | None, method: str) -> bool:
    """Whether an observation of the user's own needs a solver that knows nothing of it."""
    if observation is None or isinstance(eye, Aim) or method != "perceptual":
        return False
    if eye is not None:
        return True
    return isinstance(observation, AdjointObservation) and reflecting(observation) is None


def solve_frame(
    frame: Master, posed: Posed, out_of_range: float, method: str, solver: Solver | None = None
) -> Solution:
    """Solves a master that `Stage.pose_frame` has posed, by one method.

    Parameters
    ----------
    frame
        The master as a file.
    posed, out_of_range
        What `Stage.pose_frame` made of it.
    method
        One of `compensate.methods.METHODS`.
    solver
        The method's solver with other settings than its own.

    Returns
    -------
    solution
        What the method projects, and the seconds it took.

    Raises
    ------
    InputError
        If the method cannot solve this problem.
    """
    begin = time.perf_counter()
    result = solved(posed, method, solver)
    return Solution(frame, posed, out_of_range, method, result, time.perf_counter() - begin)


@final
@dataclass
class Solution:
    """A solved frame.

    Parameters
    ----------
    frame, posed, out_of_range, method
        As for `solve_frame`.
    result
        What the method projects.
    seconds
        Time of the solution.
    """

    frame: Master
    posed: Posed
    out_of_range: float
    method: str
    result: Result
    seconds: float

    def outcome(self, appraisal: Appraisal | None = None) -> Outcome:
        """Encodes the frame as the master is, and computes its figures.

        Other methods' outcomes of the same posed master may share an `appraisal`.
        """
        appraisal = appraisal or Appraisal(self.posed)
        frame, clipped = self.encoded()
        return Outcome(frame, self.result.light, self.figures(appraisal, clipped), appraisal)

    def encoded(self, *, spent: bool = False) -> tuple[Master, float]:
        """Encodes the frame to project; the second value is `Figures.file_clipped`.

        Its light is lost if it is `spent`.
        """
        if self.method == "none" and self.frame.fits:
            return self.frame, 0.0
        posed, light = self.posed, self.result.light
        before = unclipped = None
        if posed.scene.grade.gamut == KEPT:
            before = posed.planes
            unclipped = decoder(self.frame, posed.scene) if self.out_of_range else None
        if (lift := posed.setting.lift) is not None:
            light = np.minimum(light + lift[None, :, :, None].astype(light.dtype), 1)
        if posed.overlay is not None:
            light = posed.overlay.under(light, gathered(posed.planes, light.shape))
        return encoded(
            self.frame,
            light,
            posed.scene,
            posed.screen,
            before=before,
            unclipped=unclipped,
            spent=spent,
        )

    def spent(self, appraisal: Appraisal) -> tuple[Master, float, Glance | None]:
        """Encodes as `encoded`, and forgets the light where figures need a glance alone: of domes.

        The glance is None where they need all of it, or none of it.
        """
        light, posed = self.result.light, self.posed
        kept = posed.floor is None or posed.setting.uncertain is not None
        if kept or posed.subtracts(light) or light is posed.whole:
            return *self.encoded(), None
        glance = appraisal.glance(light)
        frame, clipped = self.encoded(spent=True)
        self.result = replace(self.result, light=np.empty((len(light), 0, *light.shape[2:])))
        return frame, clipped, glance

    def figures(
        self,
        appraisal: Appraisal,
        file_clipped: float,
        *,
        brief: bool = False,
        glance: Glance | None = None,
    ) -> Figures:
        """Computes the figures of the frame.

        Parameters
        ----------
        appraisal
            What computes them.
        file_clipped
            Share of the screen's pixels that the file cannot hold, as of `encoded`.
        brief
            Leaves out `loss_before` and plain figures where subtraction is exact: in a sequence,
            they would take longer than all the rest.
        glance
            As of `spent`.

        Returns
        -------
        figures
            See `Figures`.
        """
        posed, result = self.posed, self.result
        brief = brief and posed.exact and posed.subtracts(result.light)
        look = appraisal.look(result.light if glance is None else glance, plain=not brief)
        left = appraisal.foreseen(result.light)
        return Figures(
            method=self.method,
            clipped=appraisal.clipped,
            out_of_range=self.out_of_range,
            pollution=appraisal.pollution,
            loss_before=None if brief else appraisal.loss_before,
            loss_subtractive=appraisal.loss_subtractive,
            loss_after=look.loss,
            **vars(look.plain),
            dark=appraisal.dark(look),
            ghost_edges=appraisal.ghost_edges(result.light),
            loss_by_seat=look.by_seat,
            file_clipped=file_clipped,
            status=result.status.value,
            gap=result.gap,
            distance=appraisal.distance(result),
            iterations=result.iterations,
            ffts=result.ffts,
            seconds=self.seconds,
            light_left=None if left is None else left.light.ends,
            error_left=None if left is None else left.weighted.ends,
        )
