"""A master in, the frame to project out: the paper's Fig. 3 as code.

    file -> frames -> projector.decode -> Light -> problem -> solver -> projector.encode -> file

`compensate` is the engine's one entry for Light; `compensate_frame` adds the file's side: range,
encoding, and the figures that say what was done and how good it is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.baselines import RaisedBlack, Subtractive, Untouched, clipped_subtraction
from compensate.solver.result import Result
from compensate.weighting import PerceptualWeighting, Weighting
from domesim.errors import InputError
from domesim.frames import Frame
from domesim.light import Light, require_light
from domesim.scene import Scene
from domesim.screening import decoded, encoded, mean_luminance, within_range

Solver: TypeAlias = Callable[[Problem, Light], Result]

METHODS: Mapping[str, Callable[[], Solver]] = {
    "perceptual": ADMM,
    "subtractive": Subtractive,
    "raised-black": RaisedBlack,
    "none": Untouched,
}
"""What may be projected: name -> solver with its default settings."""

REGULARISATION = 1e-4
"""Default mu, of the peak squared: keeps invisible frequencies from filling with noise."""

NEGLIGIBLE = 0.001
"""Visible error, JND rms, for which no solver need go on."""

_INVISIBLE_LIGHT = 1e-5  # of white: far below a 16 bit code of any transfer function's shadows


@final
@dataclass(frozen=True)
class Figures:
    """What compensation did to a frame, and how good it is.

    Parameters
    ----------
    method
        Which of `METHODS`.
    clipped
        Share of the screen's pixels where exact subtraction needs less light than none.
    out_of_range
        Share of the screen's pixels that the projector cannot show even without pollution.
    pollution
        Mean luminance of the pollution of the untouched frame on the screen, cd/m².
    error_before, error_subtractive, error_after
        Root-mean-square of the weighted residual over the screen, in just-noticeable differences
        (multiples of Daly's threshold contrast at the adaptation luminance), before rounding to
        the file's code values.
    file_clipped
        Share of the screen's pixels whose colour the file's encoding cannot hold.
    status
        What the solver's outcome means.
    gap
        Certified upper bound of the relative distance from the least possible error, or None.
    iterations, ffts
        Work done by the solver.
    seconds
        Time of the solution, without reading and writing.
    """

    method: str
    clipped: float
    out_of_range: float
    pollution: float
    error_before: float
    error_subtractive: float
    error_after: float
    file_clipped: float
    status: str
    gap: float | None
    iterations: int
    ffts: int
    seconds: float


@final
@dataclass(frozen=True)
class Posed:
    """A master and a theatre as an optimisation problem.

    Parameters
    ----------
    scene
        The theatre.
    desired
        (1, row, col, primary) master light, in 0..1 on the screen.
    problem
        What to minimise.
    subtractive
        The light of exact clipped subtraction: where solvers start.
    screen
        (row, col) bool: pixels off the screen neither count nor change.
    """

    scene: Scene
    desired: Light
    problem: Problem
    subtractive: Light
    screen: NDArray[np.bool_]

    @property
    def clipped(self) -> float:
        """Share of the screen's pixels where subtraction needs less light than none."""
        too_bright = self.problem.residual(self.subtractive)[0][self.screen] > _INVISIBLE_LIGHT
        return float(np.mean(np.any(too_bright, axis=-1)))

    @property
    def pollution(self) -> float:
        """Mean luminance that pollution and ambient light add to the untouched master, cd/m²."""
        seen = self.problem.observation.observe(self.desired)
        return mean_luminance(seen - self.problem.desired, self.scene)

    def visible_error(self, light: Light) -> float:
        """Root-mean-square weighted residual over the screen, in just-noticeable differences.

        A weighted residual is in light (1.0 = white) at the eye's most sensitive frequency; over
        the adaptation luminance it is a contrast, times the CSF's peak a multiple of the threshold.
        """
        energy = self.problem.weighting.energy(self.problem.residual(light))
        mean_square = energy / np.count_nonzero(self.screen)
        return float(np.sqrt(mean_square)) * _differences(self.scene, self.problem.weighting)


@final
@dataclass(frozen=True)
class Outcome:
    """A compensated frame: to project, as Light, and the figures."""

    frame: Frame
    light: Light
    figures: Figures
    posed: Posed

    def stored_error(self, stored: Frame) -> float:
        """Visible error (JND rms) of `frame` as a file holds it, with its rounding."""
        return self.posed.visible_error(decoded(stored, self.posed.scene))


def compensate(
    desired: Light,
    scene: Scene,
    *,
    solver: Solver | None = None,
    weighting: PerceptualWeighting | None = None,
) -> Result:
    """The light to project so that what the audience sees is as close as can be to `desired`.

    Parameters
    ----------
    desired
        (1, row, col, primary) master light in 0..1, a domemaster. It is wanted *without* pollution
        and ambient light.
    scene
        The theatre.
    solver
        Any of `compensate.solver`; the product's by default.
    weighting
        Settings of the vision model.

    Raises
    ------
    InputError
        If the master leaves 0..1 on the screen (see `domesim.screening.within_range`).
    """
    posed = pose(desired, scene, weighting)
    return (solver or ADMM())(posed.problem, posed.subtractive)


def pose(desired: Light, scene: Scene, weighting: PerceptualWeighting | None = None) -> Posed:
    """The optimisation problem of a master in a theatre; parameters as for `compensate`."""
    require_light(desired, who="compensate")
    observation = scene.solvable(*desired.shape[1:3])
    require_light(desired, observation.shape, who="compensate")
    screen = observation.screen
    on = screen[None, :, :, None]
    outside = int(np.count_nonzero(on & ~((desired >= 0) & (desired <= 1))))
    if outside:
        raise InputError(
            f"desired light must lie in 0..1 on the screen, got {outside} values that do not; "
            f"bring it within range first (domesim.screening.within_range)"
        )
    lambda_ = (weighting or PerceptualWeighting())(
        scene.viewing, scene.projector.luminance_weights, screen
    )
    bounds = (np.where(on, 0, desired), np.where(on, 1, desired))
    seen = observation.direct(desired)
    subtractive, _ = clipped_subtraction(Problem(observation, lambda_, seen, bounds))
    negligible = np.count_nonzero(screen) * (NEGLIGIBLE / _differences(scene, lambda_)) ** 2 / 2
    problem = Problem(
        observation,
        lambda_,
        seen,
        bounds,
        anchor=subtractive,
        regularisation=REGULARISATION,
        negligible=float(negligible),
    )
    return Posed(scene, desired, problem, subtractive, screen)


def _differences(scene: Scene, weighting: Weighting) -> float:
    """Just-noticeable differences in a weighted residual of 1.0 (white)."""
    return scene.projector.white / scene.viewing.adaptation * weighting.peak


def compensate_frame(
    frame: Frame,
    scene: Scene,
    *,
    method: str = "perceptual",
    solver: Solver | None = None,
    weighting: PerceptualWeighting | None = None,
) -> Outcome:
    """The frame to project for a master, in the master's own encoding.

    Parameters
    ----------
    frame
        A domemaster.
    scene
        The theatre.
    method
        One of `METHODS`.
    solver
        The method's solver with other settings than its default ones.
    weighting
        Settings of the vision model.

    Raises
    ------
    InputError
        If the method is not known or the frame is no domemaster.
    """
    if method not in METHODS:
        raise InputError(f"method {method!r} is not known; use one of {', '.join(METHODS)}")
    posed, out_of_range = pose_frame(frame, scene, weighting)
    return solve_frame(frame, posed, out_of_range, method, solver)


def pose_frame(
    frame: Frame, scene: Scene, weighting: PerceptualWeighting | None = None
) -> tuple[Posed, float]:
    """`pose` for a frame, and the share of its screen that is out of the projector's range."""
    light = decoded(frame, scene)
    screen = scene.dome.inside(*light.shape[1:3])
    desired, out_of_range = within_range(light, screen)
    return pose(desired, scene, weighting), out_of_range


def solve_frame(
    frame: Frame, posed: Posed, out_of_range: float, method: str, solver: Solver | None = None
) -> Outcome:
    """One method's outcome for a frame that `pose_frame` has posed."""
    begin = time.perf_counter()
    start = posed.desired if method == "none" else posed.subtractive
    result = (solver or METHODS[method]())(posed.problem, start)
    stored, file_clipped = frame, 0.0
    if method != "none":
        stored, file_clipped = encoded(frame, result.light, posed.scene, posed.screen)
    figures = Figures(
        method=method,
        clipped=posed.clipped,
        out_of_range=out_of_range,
        pollution=posed.pollution,
        error_before=posed.visible_error(posed.desired),
        error_subtractive=posed.visible_error(posed.subtractive),
        error_after=posed.visible_error(result.light),
        file_clipped=file_clipped,
        status=result.status.value,
        gap=result.gap,
        iterations=result.iterations,
        ffts=result.ffts,
        seconds=time.perf_counter() - begin,
    )
    return Outcome(stored, result.light, figures, posed)
