"""A master in, the frame to project out: the paper's Fig. 3 as code.

    file -> frames -> projector.decode -> Light -> problem -> solver -> projector.encode -> file

`compensate` is the engine's one entry for Light; `compensate_frame` adds the file's side: range,
encoding, and the figures that say what was done and how good it is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial, reduce
from typing import cast, final

import numpy as np
from numpy.typing import NDArray

from compensate.aim import Aim, Eye, Sight, lifted, veiled, with_hue
from compensate.foresight import Foreseen, foreseen
from compensate.ghosts import edge_energy, ghost_contour
from compensate.methods import Solver, require_method
from compensate.own import own_problem
from compensate.problem import Problem
from compensate.ruler import Ruler
from compensate.solver import baselines, deghosting
from compensate.solver.fitting import fitting
from compensate.solver.result import Result, Status
from compensate.solver.worst_seat import seat_importance
from compensate.weighting import REGULARISATION, CsfWeighting, PerceptualWeighting, Weighting
from domesim.errors import InputError
from domesim.frames import Master
from domesim.light import Light, require_light
from domesim.light.strips import all_within, in_strips
from domesim.observation.base import AdjointObservation, Observation
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.grey_to_grey import GreyToGrey
from domesim.observation.lowrank import LowRankObservation
from domesim.observation.seats import SeveralSeats
from domesim.observation.uncertain import Uncertain
from domesim.scene import Scene, StereoScene
from domesim.scene.screening import decoded, encoded, mean_luminance, within_range

NEGLIGIBLE = 0.001
"""Visible error, JND rms, for which no solver need go on."""

_ROUNDING = 8 * float(np.finfo(np.float32).eps)  # of white; as `ADMM` sees it

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
    loss_before, loss_subtractive, loss_after
        How much worse it looks than the master: the reference model's mean over the screen, in
        just-objectionable differences (`compensate.ruler`), untouched, subtracted, and as
        compensated, before rounding to the file's code values. No setting changes the model. Of
        several seats, their mean. `loss_before` may be left out (`Solution.outcome`).
    ghost_edges
        Of a stereo pair: ghost edge energy (`compensate.ghosts`) at the first seat, 1 for the
        untouched master; None without ghosts.
    loss_by_seat
        Of several seats: `loss_after` of each.
    file_clipped
        Share of the screen's pixels whose colour the file's encoding cannot hold.
    status
        What the solver's outcome means.
    gap
        Certified upper bound of the cost's relative distance from the least possible, or None.
    distance
        The same in just-noticeable differences: what is seen differs from what the optimum would
        show by at most so much, root-mean-square of the weighted difference over the screen.
    iterations, ffts
        Work done by the solver.
    seconds
        Time of the solution, without reading and writing.
    light_left, error_left
        Of a measured scene, what is left in fact: (low, likely, high) ends of the 95 % interval and
        median of the residual's root-mean-square over the screen, 1 = projector white; and of
        `Posed.visible_error`, by the whole room and not by the closed form. None if nothing was
        measured.
    """

    method: str
    clipped: float
    out_of_range: float
    pollution: float
    loss_before: float | None
    loss_subtractive: float
    loss_after: float
    ghost_edges: float | None
    loss_by_seat: dict[str, float]
    file_clipped: float
    status: str
    gap: float | None
    distance: float | None
    iterations: int
    ffts: int
    seconds: float
    light_left: tuple[float, float, float] | None = None
    error_left: tuple[float, float, float] | None = None


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
    wanted
        (seen view, row, col, primary) what all seats should see.
    observation
        What the audience sees, exactly: `problem` may know it linearised.
    problem
        The paper's least squares: what to minimise without an aim.
    aiming
        Gives the light that shows the aim; None without an aim.
    single
        The problem for methods that know one seat only: of several, the mean one.
    subtractive, shown
        The light of exact clipped subtraction, and what is seen of it, at all seats.
    screen
        (row, col) bool: pixels off the screen neither count nor change.
    areas
        (row, col) of its pixels, m².
    judge
        The problem's weighting for figures, with a count of transforms of its own: they may be
        computed while another frame is solved.
    exact
        Whether subtraction shows what is desired, to rounding.
    uncertain
        How sure the scene is of what is seen; None if nothing was measured.
    """

    scene: Scene
    desired: Light
    wanted: Light
    observation: Observation
    problem: Problem
    aiming: Callable[[], Light] | None
    single: Problem
    subtractive: Light
    shown: Light
    screen: NDArray[np.bool_]
    areas: NDArray[np.floating]
    judge: CsfWeighting
    exact: bool
    uncertain: Callable[[], Uncertain | None]

    @cached_property
    def clipped(self) -> float:
        """Share of the screen's pixels where subtraction needs less light than none."""
        if self.exact:
            return 0.0
        shown, wanted = self.shown, self.single.desired
        if isinstance(self.observation, SeveralSeats):
            shown = self.single.observation.observe(self.subtractive)

        def count(view: int, rows: slice) -> int:
            return self._too_bright(shown[view, rows] - wanted[view, rows], rows)

        return sum(in_strips(count, shown.shape)) / (len(shown) * np.count_nonzero(self.screen))

    @cached_property
    def loss_subtractive(self) -> float:
        """`loss` of exact clipped subtraction."""
        return self.loss(self.subtractive)

    @property
    def pollution(self) -> float:
        """Mean luminance that pollution and ambient light add to the untouched master, cd/m²."""
        return self._untouched[0]

    @cached_property
    def loss_before(self) -> float:
        """`loss` of the untouched master."""
        return self._untouched[2] if not self.exact else self.loss(self.desired)

    @cached_property
    def _untouched(self) -> tuple[float, NDArray[np.floating], float]:
        """`pollution`, (view, row, col) luminance that a pair sees too much, and `loss_before`.

        The last is NaN where subtraction is exact: it may never be asked for.
        """
        residual = self.observation.observe(self.desired)
        lost = math.nan if self.exact else _mean(self._losses(residual))
        residual -= self.wanted
        ghost = self._luminance(residual[: self.scene.views if self.scene.views > 1 else 0])
        return mean_luminance(residual, self.scene, self.areas), ghost, lost

    def _luminance(self, light: Light) -> NDArray[np.floating]:
        planes = np.empty(light.shape[:3], light.dtype)
        weights = self.scene.projector.luminance_weights.astype(light.dtype)
        in_strips(
            lambda view, rows: np.matmul(light[view, rows], weights, out=planes[view, rows]),
            light.shape,
        )
        return planes

    def _too_bright(self, part: Light, rows: slice) -> int:
        """How many pixels of the screen show more light than they should, in some primary."""
        if part.max() <= _INVISIBLE_LIGHT:
            return 0
        # Primary by primary: NumPy's `any` of three is ten times slower
        found = reduce(np.logical_or, np.moveaxis(part > _INVISIBLE_LIGHT, -1, 0))
        return int(np.count_nonzero(found & self.screen[rows]))

    def residual(self, light: Light) -> Light:
        """psi(x) - wanted, of all seats: (seen view, row, col, primary)."""
        residual = self.observation.observe(light)
        residual -= self.wanted
        return residual

    def seen(self, light: Light) -> Light:
        """(view, row, col, primary) what is seen of projected `light`, at the first seat."""
        return self.observation.observe(light)[: self.scene.views, ...]

    def visible_error(self, light: Light) -> float:
        """Root-mean-square weighted residual over the screen, in just-noticeable differences.

        It is the paper's: Daly's sensitivity at one adaptation luminance, with the default settings
        of `PerceptualWeighting`. A weighted residual is in light (1.0 = white) at the eye's most
        sensitive frequency; over the adaptation luminance it is a contrast, times the CSF's peak a
        multiple of the threshold. Several seats count by their weights.
        """
        residual = self.residual(light)
        if _is_rounding(residual):
            return 0.0
        return self._in_differences(self.judge.energy(residual))

    def loss(self, light: Light) -> float:
        """How much worse it looks than the master, JOD (`compensate.ruler`); of all seats."""
        return _mean(self._losses(self._seen(light)))

    def stored_loss(self, stored: Master) -> float:
        """`loss` of a frame as a file holds it, with its rounding."""
        return self.loss(decoded(stored, self.scene))

    def _in_differences(self, energy: float) -> float:
        """Just-noticeable differences, rms, of a weighted residual's energy."""
        mean_square = energy / (np.count_nonzero(self.screen) * self.scene.views)
        return float(np.sqrt(mean_square)) * _differences(self.scene, self.judge)

    def foreseen(self, light: Light) -> Foreseen | None:
        """What is left of the pollution in fact; None if nothing of the scene was measured.

        Its weighted residual is in just-noticeable differences, as `visible_error`.
        """
        uncertain = self.uncertain()
        if uncertain is None:
            return None
        residual = uncertain.best.observe(light)
        residual -= self.wanted
        found = foreseen(residual, uncertain.changes(light), self.judge.apply)
        pixels = np.count_nonzero(self.screen) * self.scene.views
        unit = _differences(self.scene, self.judge) / np.sqrt(pixels)
        return replace(found, weighted=found.weighted.times(unit))

    def distance(self, result: Result) -> float | None:
        """How far, at most, what is seen is from what the optimum x* shows, JND rms; see `Figures`.

        As x* is optimal, 1/2 ||lambda(psi(x) - psi(x*))||² <= cost(x) - cost(x*), of an affine psi:
        None for a table, and for several seats, of which the worst may count.
        """
        several = isinstance(self.observation, GreyToGrey | SeveralSeats)
        if result.gap is None or several:
            return None
        if not result.gap:
            return 0.0
        energy = 2 * result.cost * result.gap / (1 + result.gap)
        mean_square = energy / (np.count_nonzero(self.screen) * self.scene.views)
        return float(np.sqrt(mean_square)) * _differences(self.scene, self.problem.weighting)

    def ghost_edges(self, light: Light) -> float | None:
        """Ghost edge energy of a stereo pair at the first seat; None without ghosts that have any.

        What is left of a ghost that was rounding from the start is no figure.
        """
        if self.scene.views == 1:
            return None
        ghost = self._untouched[1]
        if np.ptp(ghost, axis=(1, 2)).max() < _INVISIBLE_LIGHT:
            return None
        if self.exact and light is self.subtractive:
            return 0.0
        error = self._luminance(self.residual(light)[: self.scene.views])
        if _is_rounding(error):
            return 0.0
        density = self.scene.viewing.pixels_per_degree(*self.screen.shape)
        energy = edge_energy(error, ghost, density)
        return energy if np.isfinite(energy) else None

    def ghost_contour(self, light: Light) -> float | None:
        """Ghost contour of a stereo pair at the first seat, where subtraction clips.

        None without ghosts that have edges there.
        """
        if self.scene.views == 1 or self.exact:
            return None
        first = slice(self.scene.views)
        too_bright = self.shown[first] - self.wanted[first] > _INVISIBLE_LIGHT
        where = np.any(too_bright, axis=-1) & self.screen
        error = self._luminance(self.residual(light)[: self.scene.views])
        density = self.scene.viewing.pixels_per_degree(*self.screen.shape)
        return ghost_contour(error, self._untouched[1], where, density)

    def lost_map(self, seen: Light) -> NDArray[np.floating]:
        """(view, row, col) JOD of what is seen at the first seat, as `Ruler.lost_map`."""
        ruler = next(iter(self._rulers.values()))
        if _is_rounding(seen, ruler.wanted):
            return np.zeros(seen.shape[:3], np.float32)
        return ruler.lost_map(seen)

    def loss_by_seat(self, light: Light) -> dict[str, float]:
        """`loss` at each of several seats; empty for one."""
        several = isinstance(self.observation, SeveralSeats)
        return self._losses(self._seen(light)) if several else {}

    def _seen(self, light: Light) -> Light:
        """What is seen of it at all seats."""
        return self.shown if light is self.subtractive else self.observation.observe(light)

    def _losses(self, seen: Light) -> dict[str, float]:
        """How much is lost at each seat, of what all see; that of a single one has no name."""
        losses = {}
        for number, (name, ruler) in enumerate(self._rulers.items()):
            shown = seen
            if isinstance(self.observation, SeveralSeats):
                shown = self.observation.of_seat(seen, number)
            losses[name] = 0.0 if _is_rounding(shown, ruler.wanted) else ruler.lost(shown)
        return losses

    @cached_property
    def _rulers(self) -> dict[str, Ruler]:
        """Of each seat."""
        seats = {"": self.wanted}
        if isinstance(self.observation, SeveralSeats):
            assert isinstance(self.scene, StereoScene)
            seats = {
                name: self.observation.of_seat(self.wanted, number)
                for number, name in enumerate(self.scene.chosen)
            }
        return {name: Ruler(wanted, self.scene, self.screen) for name, wanted in seats.items()}


@final
@dataclass(frozen=True)
class Outcome:
    """A compensated master: to project, as Light, and the figures."""

    frame: Master
    light: Light
    figures: Figures
    posed: Posed


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
        `domesim.observation.linear.LinearObservation`. The weighting is the paper's then; by
        default the solver is that of `compensate.solver.fitting`.

    Raises
    ------
    InputError
        If the master leaves 0..1 on the screen (see `domesim.scene.screening.within_range`), or an
        aim is asked for with an observation of one's own.
    """
    if observation is not None or isinstance(weighting, Weighting):
        if isinstance(weighting, Aim):
            raise InputError(
                "an aim needs exact subtraction, which an observation of your own has not; leave "
                "the weighting out, or give PerceptualWeighting()"
            )
        require_light(desired, who="compensate")
        screen = scene.screen(*desired.shape[1:3])
        _require_within_range(desired, screen)
        problem = own_problem(desired, scene, observation, weighting)
        chosen = solver or fitting(problem).solver
        assert problem.anchor is not None
        found = chosen(problem, problem.anchor)
        return replace(found, light=np.where(screen[None, :, :, None], found.light, desired))
    if weighting is None and solver is not None:
        weighting = PerceptualWeighting()
    posed = pose(desired, scene, weighting)
    found = solved(posed, "perceptual", solver)
    if posed.desired is desired:
        return found
    on = posed.screen[None, :, :, None]
    return replace(found, light=np.where(on, found.light, desired))


def pose(desired: Light, scene: Scene, weighting: Eye | None = None) -> Posed:
    """The optimisation problem of a master in a scene; parameters as for `compensate`."""
    return Stage(scene, weighting).pose(desired)


@final
class Stage:
    """Poses the frames of a show, which share all but their pictures.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    weighting
        Settings of the vision model.
    """

    def __init__(self, scene: Scene, weighting: Eye | None = None) -> None:
        self._scene = scene
        self._settings = weighting or preferred(scene)
        self._shared: _Shared | None = None

    def pose(self, desired: Light) -> Posed:
        """The optimisation problem of a master (view, row, col, primary); see `compensate`.

        Raises
        ------
        InputError
            If the master leaves 0..1 on the screen.
        """
        require_light(desired, who="compensate")
        shared = self._of_size(*desired.shape[1:3])
        require_light(desired, shared.observation.shape, who="compensate")
        _require_within_range(desired, shared.screen)
        desired = _on(shared.screen, desired)
        single, subtractive = shared.subtracted(desired)
        solvable = single.observation
        if isinstance(shared.observation, SeveralSeats):
            solvable = shared.observation
        wanted = single.desired if solvable is single.observation else solvable.direct(desired)
        seen = shared.observation.observe(subtractive)
        exact = _is_rounding(seen, wanted)

        problem = Problem(
            solvable,
            shared.weighting,
            wanted,
            (single.lower, single.upper),
            anchor=subtractive,
            regularisation=REGULARISATION * len(desired) / len(wanted),  # of seats as of one
            negligible=shared.negligible,
        )
        aiming = None
        if isinstance(self._settings, Aim):
            aiming = partial(shared.aimed, self._settings, desired, subtractive, seen)
        return Posed(
            scene=self._scene,
            desired=desired,
            wanted=wanted,
            observation=shared.observation,
            problem=problem,
            aiming=aiming,
            single=single,
            subtractive=subtractive,
            shown=seen,
            screen=shared.screen,
            areas=shared.areas,
            judge=shared.judge,
            exact=exact,
            uncertain=shared.uncertain,
        )

    def pose_frame(self, frame: Master) -> tuple[Posed, float]:
        """`pose` for a master, and the share of its screen out of the projector's range."""
        light = decoded(frame, self._scene)
        desired, out_of_range = within_range(light, self._of_size(*light.shape[1:3]).screen)
        return self.pose(desired), out_of_range

    def _of_size(self, rows: int, cols: int) -> _Shared:
        if self._shared is None or self._shared.screen.shape != (rows, cols):
            self._shared = _shared(self._scene, self._settings, rows, cols)
        return self._shared


@dataclass(frozen=True)
class _Shared:
    """What frames of one size have in common; names as in `Posed`."""

    observation: Observation
    single: Observation
    plain: CsfWeighting  # of one seat, for other methods than ours
    weighting: CsfWeighting
    judge: CsfWeighting
    screen: NDArray[np.bool_]
    areas: NDArray[np.floating]
    negligible: float
    sight: Sight
    uncertain: Callable[[], Uncertain | None]

    def subtracted(self, desired: Light) -> tuple[Problem, Light]:
        """The problem at the mean seat, and its exact clipped subtraction.

        A table is linearised there.
        """
        # Subtraction needs no adjoint, so that it knows a table as it is.
        observation = cast("AdjointObservation", self.single)
        if isinstance(observation, LowRankObservation):
            on = observation.screen_like(desired)[None, :, :, None]
            problem = Problem(observation, self.plain, observation.direct(desired), (0.0, on))
            return problem, baselines.clipped_subtraction(problem)[0]
        problem = Problem(observation, self.plain, desired)
        if isinstance(observation, Crosstalk):
            return problem, deghosting.subtracted_crosstalk(observation, desired)
        light, _ = deghosting.clipped_subtraction(problem)
        if isinstance(self.single, GreyToGrey):
            problem = problem.observed_by(self.single.linearised(light))
        return problem, light

    def aimed(self, aim: Aim, desired: Light, subtractive: Light, seen: Light) -> Light:
        """The light that shows the aim, by exact clipped subtraction.

        Parameters
        ----------
        aim
            Its settings.
        desired, subtractive, seen
            The master, exact clipped subtraction of it, and what that shows.
        """
        if len(desired) > 1:
            return self.subtracted(veiled(aim, self.sight, desired, np.maximum(seen - desired, 0)))[
                1
            ]
        direct = self.single.direct
        wanted = direct(desired)
        white = direct(np.broadcast_to(np.ones((), desired.dtype), desired.shape))
        raised = lifted(aim, self.sight, wanted, seen - direct(subtractive), white)
        light = self._showing(raised)
        floor = self.single.observe(light)
        floor -= direct(light)
        del light
        return self._showing(with_hue(aim, wanted, raised, floor))

    def _showing(self, seen: Light) -> Light:
        """The light of a dome that shows `seen`, by exact clipped subtraction."""
        observation = cast("LowRankObservation", self.single)
        on = observation.screen_like(seen)[None, :, :, None]
        return baselines.clipped_subtraction(Problem(observation, self.plain, seen, (0.0, on)))[0]


def preferred(scene: Scene) -> Eye:
    """What a picture is made for by default: contrasts, of one seat (``validation/notes/0007``)."""
    return PerceptualWeighting() if scene.several_seats else Aim()


def _shared(scene: Scene, settings: Eye, rows: int, cols: int) -> _Shared:
    single = observation = scene.solvable(rows, cols)
    if isinstance(scene, StereoScene) and isinstance(observation, SeveralSeats):
        single = scene.mean_seat(rows, cols)
    screen = scene.screen(rows, cols)
    if isinstance(settings, Aim) and isinstance(observation, SeveralSeats):
        raise InputError(
            "an aim is of one seat, got several; name one (--seat), or use the paper's weighting "
            "(--weighting paper)"
        )
    paper = PerceptualWeighting() if isinstance(settings, Aim) else settings
    plain = paper.of(scene.viewing, scene.projector, screen, scene.views)
    weighting = plain
    if isinstance(scene, StereoScene) and isinstance(observation, SeveralSeats):
        weighting = plain.with_importance(seat_importance(scene.weights))
    reference = plain
    if paper != PerceptualWeighting():
        reference = PerceptualWeighting().of(scene.viewing, scene.projector, screen, scene.views)
    judge = reference.with_importance(weighting.importance).counted_apart()
    negligible = np.count_nonzero(screen) * scene.views / 2
    negligible *= (NEGLIGIBLE / _differences(scene, plain)) ** 2
    return _Shared(
        observation,
        single,
        plain,
        weighting,
        judge,
        screen,
        scene.pixel_areas(rows, cols),
        float(negligible),
        Sight(
            screen,
            scene.projector.luminance_weights,
            scene.projector.white,
            scene.viewing.pixels_per_degree(rows, cols),
        ),
        cache(partial(scene.uncertain, rows, cols)),
    )


def _require_within_range(desired: Light, screen: NDArray[np.bool_]) -> None:
    if all_within(desired, 0, 1):
        return
    outside = int(np.count_nonzero(screen[None, :, :, None] & ~((desired >= 0) & (desired <= 1))))
    if outside:
        raise InputError(
            f"desired light must lie in 0..1 on the screen, got {outside} values that do not; "
            f"bring it within range first (domesim.scene.screening.within_range)"
        )


def _on(screen: NDArray[np.bool_], light: Light) -> Light:
    """Light without what lies off the screen, which nobody sees: files keep it (`encoded`)."""

    def lit(view: int, rows: slice) -> bool:
        return bool(np.any(light[view, rows][~screen[rows]]))

    if screen.all() or not any(in_strips(lit, light.shape)):
        return light
    kept = np.empty_like(light)

    def keep(view: int, rows: slice) -> None:
        np.multiply(light[view, rows], screen[rows, :, None], out=kept[view, rows])

    in_strips(keep, light.shape)
    return kept


def _mean(losses: dict[str, float]) -> float:
    return float(np.mean(list(losses.values())))


def _is_rounding(residual: Light, expected: Light | None = None) -> bool:
    """Whether it is no more than rounding away from what is expected, or from 0."""

    def work(view: int, rows: slice) -> bool:
        part = residual[view, rows]
        if expected is not None:
            part = part - expected[view, rows]
        return max(float(part.max()), -float(part.min())) <= _ROUNDING

    return all(in_strips(work, residual.shape))


def _differences(scene: Scene, weighting: Weighting) -> float:
    """Just-noticeable differences in a weighted residual of 1.0 (white)."""
    return scene.projector.white / scene.viewing.adaptation * weighting.peak


def compensate_frame(
    frame: Master,
    scene: Scene,
    *,
    method: str = "perceptual",
    solver: Solver | None = None,
    weighting: Eye | None = None,
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
    return solve_frame(frame, posed, out_of_range, method, solver).outcome()


def pose_frame(frame: Master, scene: Scene, weighting: Eye | None = None) -> tuple[Posed, float]:
    """`pose` for a master, and the share of its screen that is out of the projector's range."""
    return Stage(scene, weighting).pose_frame(frame)


def solve_frame(
    frame: Master, posed: Posed, out_of_range: float, method: str, solver: Solver | None = None
) -> Solution:
    """What one method projects for a master that `pose_frame` has posed."""
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

    def outcome(self, *, brief: bool = False) -> Outcome:
        """The frame to project, in the master's own encoding, and the figures.

        If `brief`, without `loss_before` where subtraction shows what is desired: in a sequence,
        its transforms would take longer than all the rest.
        """
        posed, result = self.posed, self.result
        stored, file_clipped = self.frame, 0.0
        if self.method != "none" or not self.frame.fits:
            stored, file_clipped = encoded(self.frame, result.light, posed.scene, posed.screen)
        loss_after = posed.loss_subtractive
        if result.light is not posed.subtractive:
            brief, loss_after = False, posed.loss(result.light)
        left = posed.foreseen(result.light)
        figures = Figures(
            method=self.method,
            clipped=posed.clipped,
            out_of_range=self.out_of_range,
            pollution=posed.pollution,
            loss_before=None if brief and posed.exact else posed.loss_before,
            loss_subtractive=posed.loss_subtractive,
            loss_after=loss_after,
            ghost_edges=posed.ghost_edges(result.light),
            loss_by_seat=posed.loss_by_seat(result.light),
            file_clipped=file_clipped,
            status=result.status.value,
            gap=result.gap,
            distance=posed.distance(result),
            iterations=result.iterations,
            ffts=result.ffts,
            seconds=self.seconds,
            light_left=None if left is None else left.light.told,
            error_left=None if left is None else left.weighted.told,
        )
        return Outcome(stored, result.light, figures, posed)


def solved(posed: Posed, method: str, solver: Solver | None = None) -> Result:
    """What one method projects; `solver` is the method's with other settings.

    Raises
    ------
    InputError
        If the method cannot solve this problem.
    """
    if method == "perceptual" and posed.exact:
        return Result(posed.subtractive, 0.0, 0.0, Status.EXACT, 0, 0, 0.0)
    if method == "perceptual" and posed.aiming is not None and solver is None:
        return Result(posed.aiming(), math.nan, math.nan, Status.AIMED, 0, 0)
    problem = posed.problem if method == "perceptual" else posed.single
    start = posed.desired if method == "none" else posed.subtractive
    chosen = solver or require_method(method, posed.scene)(posed.scene, problem)
    try:
        return chosen(problem, start)
    except ValueError as error:
        if method == "perceptual":
            raise
        raise InputError(f"method {method!r} does not fit {posed.scene.name}: {error}") from None
