"""A master in, the frame to project out: the paper's Fig. 3 as code.

    file -> frames -> projector.decode -> Light -> problem -> solver -> projector.encode -> file

`compensate` is the engine's one entry for Light; `compensate_frame` adds the file's side: range,
encoding, and the figures that say what was done and how good it is.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from typing import cast, final

import numpy as np
from numpy.typing import NDArray

from compensate.ghosts import edge_energy
from compensate.methods import Solver, methods_of, require_method
from compensate.problem import Problem
from compensate.solver import baselines, deghosting
from compensate.solver.result import Result
from compensate.solver.worst_seat import seat_importance
from compensate.weighting import CsfWeighting, PerceptualWeighting, Weighting
from domesim.errors import InputError
from domesim.frames import Master
from domesim.light import Light, require_light
from domesim.observation.base import AdjointObservation, Observation
from domesim.observation.grey_to_grey import GreyToGrey
from domesim.observation.seats import SeveralSeats
from domesim.scene import DomeScene, Scene, StereoScene
from domesim.screening import decoded, encoded, mean_luminance, within_range

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
        Which of `compensate.methods`.
    clipped
        Share of the screen's pixels, of all views, where exact subtraction needs less light than
        none.
    out_of_range
        Share of the screen's pixels that the projector cannot show even without pollution.
    pollution
        Mean luminance of the pollution of the untouched frame on the screen, cd/m².
    error_before, error_subtractive, error_after
        Root-mean-square of the weighted residual over the screen, in just-noticeable differences
        (multiples of Daly's threshold contrast at the adaptation luminance), before rounding to
        the file's code values.
    ghost_edges
        Of a stereo pair: ghost edge energy (`compensate.ghosts`) at the first seat, 1 for the
        untouched master; None without ghosts.
    error_by_seat
        Of several seats: `error_after` of each.
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
    ghost_edges: float | None
    error_by_seat: dict[str, float]
    file_clipped: float
    status: str
    gap: float | None
    iterations: int
    ffts: int
    seconds: float


@final
@dataclass(frozen=True)
class Posed:
    """A master and a scene as an optimisation problem.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    desired
        (view, row, col, primary) master light, in 0..1 on the screen.
    problem
        What to minimise.
    observation
        What the audience sees, exactly: `problem` may know it linearised.
    single
        The problem for methods that know one seat only: of several, the mean one.
    subtractive
        The light of exact clipped subtraction: where solvers start.
    screen
        (row, col) bool: pixels off the screen neither count nor change.
    """

    scene: Scene
    desired: Light
    problem: Problem
    observation: Observation
    single: Problem
    subtractive: Light
    screen: NDArray[np.bool_]

    @cached_property
    def clipped(self) -> float:
        """Share of the screen's pixels where subtraction needs less light than none."""
        error = self.single.observation.observe(self.subtractive) - self.single.desired
        too_bright = error[:, self.screen] > _INVISIBLE_LIGHT
        return float(np.mean(np.any(too_bright, axis=-1)))

    @cached_property
    def pollution(self) -> float:
        """Mean luminance that pollution and ambient light add to the untouched master, cd/m²."""
        return mean_luminance(self.residual(self.desired), self.scene)

    @cached_property
    def error_before(self) -> float:
        """`visible_error` of the untouched master."""
        return self.visible_error(self.desired)

    @cached_property
    def error_subtractive(self) -> float:
        """`visible_error` of exact clipped subtraction."""
        return self.visible_error(self.subtractive)

    def residual(self, light: Light) -> Light:
        """psi(x) - seen, of all seats: (seen view, row, col, primary)."""
        return self.observation.observe(light) - self.problem.desired

    def seen(self, light: Light) -> Light:
        """(view, row, col, primary) what is seen of projected `light`, at the first seat."""
        return self.observation.observe(light)[: self.scene.views, ...]

    def visible_error(self, light: Light) -> float:
        """Root-mean-square weighted residual over the screen, in just-noticeable differences.

        A weighted residual is in light (1.0 = white) at the eye's most sensitive frequency; over
        the adaptation luminance it is a contrast, times the CSF's peak a multiple of the threshold.
        Several seats count by their weights.
        """
        energy = self.problem.weighting.energy(self.residual(light))
        mean_square = energy / (np.count_nonzero(self.screen) * self.scene.views)
        return float(np.sqrt(mean_square)) * _differences(self.scene, self.problem.weighting)

    def ghost_edges(self, light: Light) -> float | None:
        """Ghost edge energy of a stereo pair at the first seat; None without ghosts that have any.

        What is left of a ghost that was rounding from the start is no figure.
        """
        if self.scene.views == 1:
            return None
        seen = self.problem.desired[:2]
        ghosts = self.seen(self.desired) - seen
        weights = self.scene.projector.luminance_weights
        density = self.scene.viewing.pixels_per_degree(*self.screen.shape)
        ghost = np.asarray(ghosts, np.float64) @ weights
        if np.ptp(ghost, axis=(1, 2)).max() < _INVISIBLE_LIGHT:
            return None
        energy = edge_energy(
            np.asarray(self.seen(light) - seen, np.float64) @ weights, ghost, density
        )
        return energy if np.isfinite(energy) else None

    def error_by_seat(self, light: Light) -> dict[str, float]:
        """`visible_error` at each of several seats; empty for one."""
        if not isinstance(self.observation, SeveralSeats):
            return {}
        assert isinstance(self.scene, StereoScene)
        residual, weighting = self.residual(light), self.single.weighting
        factor = _differences(self.scene, weighting)
        factor /= np.sqrt(np.count_nonzero(self.screen) * self.scene.views)
        return {
            name: float(np.sqrt(weighting.energy(self.observation.of_seat(residual, number))))
            * factor
            for number, name in enumerate(self.scene.chosen)
        }


@final
@dataclass(frozen=True)
class Outcome:
    """A compensated master: to project, as Light, and the figures."""

    frame: Master
    light: Light
    figures: Figures
    posed: Posed

    def stored_error(self, stored: Master) -> float:
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
        (view, row, col, primary) master light in 0..1: a domemaster, or left and right. It is
        wanted *without* pollution and ambient light.
    scene
        The theatre, or stereo system.
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
    chosen = solver or methods_of(scene)["perceptual"](scene, posed.problem)
    return chosen(posed.problem, posed.subtractive)


def pose(desired: Light, scene: Scene, weighting: PerceptualWeighting | None = None) -> Posed:
    """The optimisation problem of a master in a scene; parameters as for `compensate`."""
    require_light(desired, who="compensate")
    rows, cols = desired.shape[1:3]
    observation = scene.observation(rows, cols)
    require_light(desired, observation.shape, who="compensate")
    screen = scene.screen(rows, cols)
    on = screen[None, :, :, None]
    outside = int(np.count_nonzero(on & ~((desired >= 0) & (desired <= 1))))
    if outside:
        raise InputError(
            f"desired light must lie in 0..1 on the screen, got {outside} values that do not; "
            f"bring it within range first (domesim.screening.within_range)"
        )
    lambda_ = (weighting or PerceptualWeighting())(
        scene.viewing, scene.projector.luminance_weights, screen, scene.views
    )
    if isinstance(scene, StereoScene):
        single, subtractive = _subtracted_pair(desired, scene, lambda_)
    else:
        assert isinstance(scene, DomeScene)
        single, subtractive = _subtracted_dome(desired, scene, lambda_)
    solvable = single.observation
    if isinstance(observation, SeveralSeats):
        assert isinstance(scene, StereoScene)
        lambda_ = lambda_.with_importance(seat_importance(scene.weights))
        solvable = observation
    negligible = np.count_nonzero(screen) * scene.views / 2
    negligible *= (NEGLIGIBLE / _differences(scene, lambda_)) ** 2
    problem = Problem(
        solvable,
        lambda_,
        solvable.direct(desired),
        (single.lower, single.upper),
        anchor=subtractive,
        regularisation=REGULARISATION,
        negligible=float(negligible),
    )
    exact = observation if isinstance(observation, GreyToGrey) else solvable
    return Posed(scene, desired, problem, exact, single, subtractive, screen)


def _subtracted_dome(
    desired: Light, scene: DomeScene, lambda_: CsfWeighting
) -> tuple[Problem, Light]:
    """The plain problem of a domemaster, and its exact clipped subtraction."""
    observation = scene.solvable(*desired.shape[1:3])
    on = observation.screen[None, :, :, None]
    bounds = (np.where(on, 0, desired), np.where(on, 1, desired))
    problem = Problem(observation, lambda_, observation.direct(desired), bounds)
    return problem, baselines.clipped_subtraction(problem)[0]


def _subtracted_pair(
    desired: Light, scene: StereoScene, lambda_: CsfWeighting
) -> tuple[Problem, Light]:
    """The plain problem of a pair at the mean seat, and its exact clipped subtraction.

    A table is linearised there.
    """
    rows, cols = desired.shape[1:3]
    observation = scene.observation(rows, cols)
    if isinstance(observation, SeveralSeats):
        observation = scene.mean_seat(rows, cols)
    # Subtraction needs no adjoint, so that it knows a table as it is.
    plain = Problem(cast("AdjointObservation", observation), lambda_, desired)
    light, _ = deghosting.clipped_subtraction(plain)
    if isinstance(observation, GreyToGrey):
        plain = plain.observed_by(observation.linearised(light))
    return plain, light


def _differences(scene: Scene, weighting: Weighting) -> float:
    """Just-noticeable differences in a weighted residual of 1.0 (white)."""
    return scene.projector.white / scene.viewing.adaptation * weighting.peak


def compensate_frame(
    frame: Master,
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
        A domemaster, or left and right.
    scene
        The theatre, or stereo system.
    method
        One of the scene's methods (`compensate.methods`).
    solver
        The method's solver with other settings than its default ones.
    weighting
        Settings of the vision model.

    Raises
    ------
    InputError
        If the scene has no such method, or the frame is no master for it.
    """
    require_method(method, scene)
    posed, out_of_range = pose_frame(frame, scene, weighting)
    return solve_frame(frame, posed, out_of_range, method, solver)


def pose_frame(
    frame: Master, scene: Scene, weighting: PerceptualWeighting | None = None
) -> tuple[Posed, float]:
    """`pose` for a master, and the share of its screen that is out of the projector's range."""
    light = decoded(frame, scene)
    screen = scene.screen(*light.shape[1:3])
    desired, out_of_range = within_range(light, screen)
    return pose(desired, scene, weighting), out_of_range


def solve_frame(
    frame: Master, posed: Posed, out_of_range: float, method: str, solver: Solver | None = None
) -> Outcome:
    """One method's outcome for a master that `pose_frame` has posed."""
    begin = time.perf_counter()
    result = solved(posed, method, solver)
    seconds = time.perf_counter() - begin
    stored, file_clipped = frame, 0.0
    if method != "none":
        stored, file_clipped = encoded(frame, result.light, posed.scene, posed.screen)
    figures = Figures(
        method=method,
        clipped=posed.clipped,
        out_of_range=out_of_range,
        pollution=posed.pollution,
        error_before=posed.error_before,
        error_subtractive=posed.error_subtractive,
        error_after=posed.visible_error(result.light),
        ghost_edges=posed.ghost_edges(result.light),
        error_by_seat=posed.error_by_seat(result.light),
        file_clipped=file_clipped,
        status=result.status.value,
        gap=result.gap,
        iterations=result.iterations,
        ffts=result.ffts,
        seconds=seconds,
    )
    return Outcome(stored, result.light, figures, posed)


def solved(posed: Posed, method: str, solver: Solver | None = None) -> Result:
    """What one method projects; `solver` is the method's with other settings.

    Raises
    ------
    InputError
        If the method cannot solve this problem.
    """
    problem = posed.problem if method == "perceptual" else posed.single
    start = posed.desired if method == "none" else posed.subtractive
    chosen = solver or require_method(method, posed.scene)(posed.scene, problem)
    try:
        return chosen(problem, start)
    except ValueError as error:
        if method == "perceptual":
            raise
        raise InputError(f"method {method!r} does not fit {posed.scene.name}: {error}") from None
