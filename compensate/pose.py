"""A master in a scene, as what is wanted, what is seen, and the paper's problem (Fig. 3).

    file -> frames -> projector.decode -> Light -> **problem** -> solver -> projector.encode -> file

`Stage` poses the frames of a show, `Setting` is what all of one size share, and `Posed` is one of
them. The methods of `compensate.solve` start from that, and `compensate.figures` says how good
their answers are.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeAlias, cast, final

import numpy as np
from numpy.typing import NDArray

from compensate.aim import Aim, Sight, aimed_light, lifted_light
from compensate.overlay import Overlay
from compensate.overview import Overview, Seen
from compensate.problem import Problem
from compensate.subtract import Floor, reflecting, subtracted
from compensate.weighting import REGULARISATION, CsfWeighting, PerceptualWeighting, Weighting
from domesim.errors import InputError
from domesim.frames import Master
from domesim.light import Array, Light, namespace, require_light
from domesim.light.planes import Columns, Index, Planes, gathered, planes_of
from domesim.light.rounding import ROUNDING, is_rounding
from domesim.light.strips import all_within, in_strips
from domesim.observation.base import AdjointObservation, Observation
from domesim.observation.grey_to_grey import GreyToGrey
from domesim.observation.lowrank import LowRankObservation
from domesim.observation.seats import SeveralSeats
from domesim.observation.uncertain import Uncertain
from domesim.scene import DomeScene, Scene, StereoScene
from domesim.scene.grade import TAKEN_OUT
from domesim.scene.screening import beyond, decoder, is_cheap, within_range

NEGLIGIBLE = 0.001
"""Visible error, JND rms, for which no solver need go on."""

Eye: TypeAlias = Aim | PerceptualWeighting
"""What a picture is made for: its contrasts by an aim, or the paper's least squares."""


@final
@dataclass(frozen=True)
class Posed:
    """A master in a scene.

    Parameters
    ----------
    setting
        What all frames of this size share.
    planes
        What tells the master's light, in 0..1 on the screen and 0 off it.
    whole
        (view, row, col, primary) of it, if it is there.
    look
        What is seen of it in a dome of one view, if that is known.
    overlay
        What the server composites over the frames; then `planes` are without it, `whole` with it.
    lift
        That of this frame's aim; None for the setting's.
    """

    setting: Setting
    planes: Planes
    whole: Light | None = None
    look: Seen | None = None
    overlay: Overlay | None = None
    lift: float | None = None

    @cached_property
    def desired(self) -> Light:
        """(view, row, col, primary) master light, in 0..1 on the screen."""
        if self.whole is not None:
            return self.whole
        return gathered(self.planes, self.setting.observation.shape)

    @cached_property
    def seen_untouched(self) -> Seen | None:
        """What is seen of the master as it is, in a dome of one view."""
        if self.floor is None:
            return None
        return self.look or self.setting.overview.of(self.planes)

    @property
    def scene(self) -> Scene:
        """The theatre, or stereo system."""
        return self.setting.scene

    @property
    def observation(self) -> Observation:
        """What the audience sees, exactly."""
        return self.setting.observation

    @property
    def screen(self) -> NDArray[np.bool_]:
        """(row, col) pixels that count."""
        return self.setting.screen

    @cached_property
    def floor(self) -> Floor | None:
        """What is seen beside own light over subtraction, of a dome of one view; else None.

        It tells most of what is to be known of subtraction, without pictures of it.
        """
        setting = self.setting
        if not isinstance(setting.single, LowRankObservation):
            return None
        return Floor(setting.single, self.own_planes, columns=setting.columns)

    @cached_property
    def own_planes(self) -> Planes:
        """What tells what should be seen in a dome of one view."""
        planes, dome, kept = self.planes, self.setting.single, self.setting.kept
        assert isinstance(dome, LowRankObservation)
        if dome.has_unit_gain and kept is None:
            return planes

        # It does not know this object, whose memory would stay until Python looks for cycles
        def gained(view: int, rows: Index, cols: Index) -> Sequence[Array]:
            found = planes(view, rows, cols)
            if not dome.has_unit_gain:
                gain = dome.on_screen_like(found[0]).direct_gain[rows, cols]
                found = [plane * gain for plane in found]
            if kept is None:
                return found
            on = dome.screen_like(found[0])[rows, cols]
            black = kept[view].astype(on.dtype)
            return [plane + each * on for plane, each in zip(found, black, strict=True)]

        return gained

    @cached_property
    def subtractive(self) -> Light:
        """The light of exact clipped subtraction."""
        if self.floor is not None:
            return self.floor.subtracted()
        return self.setting.subtracted(self.desired, self.bounds(self.desired))

    def bounds(self, like: Light) -> tuple[Array | float, Array | float]:
        """Returns the least and the most light that can be shown, which broadcast."""
        if self.overlay is not None:
            return self.overlay.bounds
        return 0.0, self.setting.upper_like(like)

    @cached_property
    def shown(self) -> Light:
        """What is seen of exact clipped subtraction, at all seats."""
        return self.observation.observe(self.subtractive)

    def subtracts(self, light: Light) -> bool:
        """Says whether light is `subtractive` itself."""
        return light is vars(self).get("subtractive")

    @cached_property
    def exact(self) -> bool:
        """Whether subtraction shows what is wanted, to rounding."""
        if self.floor is not None:
            return not self.floor.leaves(ROUNDING)
        return is_rounding(self.shown, self.wanted)

    @cached_property
    def wanted(self) -> Light:
        """(seen view, row, col, primary) what all seats should see."""
        return self.setting.wanted(self.desired, self.observation)

    @cached_property
    def single(self) -> Problem:
        """The paper's problem at the one seat, or at the mean one of several.

        A table from grey to grey is linearised about subtraction.
        """
        observation = self.setting.single
        wanted = self.setting.wanted(self.desired, observation)
        if isinstance(observation, GreyToGrey):
            observation = observation.linearised(self.subtractive)
        bounds = self.bounds(wanted)
        return Problem(cast("AdjointObservation", observation), self.setting.plain, wanted, bounds)

    @cached_property
    def problem(self) -> Problem:
        """The paper's problem of all seats: what to minimise without an aim."""
        single = self.single
        several = isinstance(self.observation, SeveralSeats)
        wanted = self.wanted if several else single.desired
        return Problem(
            cast("AdjointObservation", self.observation) if several else single.observation,
            self.setting.weighting,
            wanted,
            (single.lower, single.upper),
            anchor=self.subtractive,
            regularisation=REGULARISATION * len(self.desired) / len(wanted),  # of seats as of one
            negligible=self.setting.negligible,
        )

    def aimed(self) -> Light | None:
        """Returns the light that shows the aim; None if pictures are made for something else."""
        setting = self.setting
        if not isinstance(setting.eye, Aim):
            return None
        eye = setting.eye if self.lift is None else replace(setting.eye, lift=self.lift)
        sight = setting.sight
        if self.floor is not None:
            floor, columns = self.floor.planes, setting.columns
            return lifted_light(eye, sight, setting.single, self.own_planes, floor, columns=columns)
        wanted = setting.wanted(self.desired, setting.single)
        light, seen = self.subtractive, self.shown
        if setting.single is not self.observation:
            seen = setting.single.observe(light)
        bounds = self.bounds(wanted)
        return aimed_light(eye, sight, setting.single, wanted, light, seen, bounds)

    def residual(self, light: Light) -> Light:
        """Returns psi(x) - wanted, (seen view, row, col, primary), of all seats."""
        residual = self.observation.observe(light)
        residual -= self.wanted
        return residual

    def seen(self, light: Light) -> Light:
        """Returns what is seen of projected light at the first seat, (view, row, col, primary)."""
        return self.observation.observe(light)[: self.scene.views, ...]


def pose(desired: Light, scene: Scene, weighting: Eye | None = None) -> Posed:
    """Poses one master in a scene; of a show, `Stage` poses many.

    Parameters
    ----------
    desired, scene, weighting
        As for `compensate.master.compensate`.

    Returns
    -------
    posed
        The master, ready for a method.
    """
    return Stage(scene, weighting).pose(desired)


@final
class Stage:
    """Poses the frames of a show, which share all but their pictures.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    weighting
        What pictures are made for; the aim by default.
    observation
        What is seen, if not by the scene's own: none of its light without a picture is kept.
    """

    def __init__(
        self,
        scene: Scene,
        weighting: Eye | None = None,
        observation: Observation | None = None,
    ) -> None:
        self._scene = scene
        self._observation = observation
        self._eye = weighting or Aim()
        self._setting: Setting | None = None
        self._lock = threading.Lock()

    def ready(self, rows: int, cols: int) -> None:
        """Computes in advance what masters of one size share.

        Parameters
        ----------
        rows, cols
            Size of a view, pixels.
        """
        dome = self._of_size(rows, cols).dome
        if dome is not None:
            dome.on_screen_like(np.empty(0, np.float32))

    def pose(self, desired: Light, overlay: Overlay | None = None) -> Posed:
        """Poses a master.

        Parameters
        ----------
        desired
            (view, row, col, primary) its light.
        overlay
            As for `pose_frame`.

        Returns
        -------
        posed
            It, ready for a method.

        Raises
        ------
        InputError
            If the master leaves 0..1 on the screen.
        ValueError
            If it is no light, or not of the scene's views.
        """
        require_light(desired, who="compensate")
        setting = self._of_size(*desired.shape[1:3])
        require_light(desired, setting.observation.shape, who="compensate")
        require_within_range(desired, setting.screen)
        light = _on(setting.screen, desired)
        shown = light if overlay is None else overlay.over(light)
        return Posed(setting, planes_of(light), shown, overlay=overlay)

    def pose_frame(self, frame: Master, overlay: Overlay | None = None) -> tuple[Posed, float]:
        """Poses a master's file; the second value is the share of its screen out of range.

        Parameters
        ----------
        frame
            The master.
        overlay
            What the server composites over it, of a pair on a flat screen.

        Returns
        -------
        posed, out_of_range
            The master, ready for a method; and that share, 0..1.
        """
        setting = self._of_size(*frame.frames[0].pixels.shape[:2])
        shape = len(frame.frames), *frame.frames[0].pixels.shape
        light_of = decoder(frame, self._scene)
        require_light(
            np.broadcast_to(np.float32(0), shape), setting.observation.shape, who="compensate"
        )
        if isinstance(setting.single, LowRankObservation) and is_cheap(frame, self._scene):
            brightest = max(each.brightest_half or 0 for each in frame.frames)
            return self._told(setting, light_of, bright=brightest > 1)
        desired, out_of_range = within_range(gathered(light_of, shape), setting.screen)
        desired = _on(setting.screen, desired, desired)
        shown = desired if overlay is None else overlay.over(desired)
        return Posed(setting, planes_of(desired), shown, overlay=overlay), out_of_range

    def _told(self, setting: Setting, light_of: Planes, *, bright: bool) -> tuple[Posed, float]:
        """`pose_frame` of a dome's light, some above 1 if `bright`, decoded anew for each use."""
        screen, counts = setting.screen, [0]

        def planes(view: int, rows: Index, cols: Index, *, count: bool = False) -> Sequence[Array]:
            found, on = light_of(view, rows, cols), screen[rows, cols]
            if count and bright:
                counts.append(beyond(found, on, (0, 1), ROUNDING))
            for off in setting.columns.partly(rows, cols):
                for plane in found:
                    plane[..., off] *= on[..., off]
            for plane in found if bright else ():  # none is below 0
                np.minimum(plane, np.float32(1), out=plane)
            return found

        seen = setting.overview.of(partial(planes, count=True))
        return Posed(setting, planes, look=seen), sum(counts) / np.count_nonzero(screen)

    def _of_size(self, rows: int, cols: int) -> Setting:
        with self._lock:
            if self._setting is None or self._setting.screen.shape != (rows, cols):
                self._setting = _setting(self._scene, self._eye, self._observation, rows, cols)
            return self._setting


@final
@dataclass(frozen=True)
class Setting:
    """What all frames of one size have in common in a scene.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    eye
        The aim or weighting that pictures are made for.
    observation
        What the audience sees, at all seats.
    single
        What it sees at the one seat, or at the mean one of several.
    screen
        (row, col) bool: pixels off the screen neither count nor change.
    areas
        (row, col) of the pixels, m².
    """

    scene: Scene
    eye: Eye
    observation: Observation
    single: Observation
    screen: NDArray[np.bool_]
    areas: NDArray[np.floating]

    @cached_property
    def kept(self) -> NDArray[np.float64] | None:
        """(view, primary) light without a picture that belongs to the grade; None for none."""
        kept = self.scene.kept
        return kept if kept.any() else None

    @cached_property
    def sight(self) -> Sight:
        """How a picture is seen."""
        projector = self.scene.projector
        density = self.scene.viewing.pixels_per_degree(*self.screen.shape)
        return Sight(self.screen, projector.luminance_weights, projector.white, density)

    @cached_property
    def overview(self) -> Overview:
        """What is seen at all seats, as figures take it."""
        return Overview(self.observation, self.screen, self.areas, self.kept)

    @cached_property
    def uncertain(self) -> Uncertain | None:
        """How sure the scene is of what is seen; None if nothing of it was measured."""
        return self.scene.uncertain(*self.screen.shape)

    @cached_property
    def negligible(self) -> float:
        """Cost of a visible error of `NEGLIGIBLE`."""
        samples = np.count_nonzero(self.screen) * self.scene.views / 2
        return float(samples * (NEGLIGIBLE / differences(self.scene, self.plain)) ** 2)

    @cached_property
    def plain(self) -> CsfWeighting:
        """The paper's weighting of one seat."""
        return self._weighting(PerceptualWeighting() if isinstance(self.eye, Aim) else self.eye)

    @cached_property
    def weighting(self) -> CsfWeighting:
        """The paper's weighting of all seats."""
        if not isinstance(self.observation, SeveralSeats):
            return self.plain
        assert isinstance(self.scene, StereoScene)
        return self.plain.with_importance(
            np.repeat(self.scene.weights, 2) / np.sum(self.scene.weights)
        )

    @cached_property
    def judge(self) -> CsfWeighting:
        """The paper's weighting with its default settings, for figures.

        It counts transforms of its own: figures may be computed while another frame is solved.
        """
        default = self._weighting(PerceptualWeighting())
        return default.with_importance(self.weighting.importance).counted_apart()

    def _weighting(self, settings: PerceptualWeighting) -> CsfWeighting:
        weights = self.scene.projector.luminance_weights
        return settings(self.scene.viewing, weights, self.screen, self.scene.views)

    def upper_like(self, light: Light) -> Array | float:
        """The largest light: 0 off the screen, for there nothing is projected."""
        if self.screen.all():
            return 1.0
        upper = self.on
        if not isinstance(light, np.ndarray) or light.dtype != upper.dtype:
            upper = namespace(light).asarray(self.screen, dtype=light.dtype, device=light.device)
        return upper[None, :, :, None]

    @cached_property
    def lift(self) -> NDArray[np.float64] | None:
        """(row, col) light that frames carry besides the picture's own; None if they do not."""
        scene = self.scene
        return scene.lift(*self.screen.shape) if isinstance(scene, DomeScene) else None

    @cached_property
    def columns(self) -> Columns:
        """What the screen takes of strips."""
        return Columns(self.screen)

    @cached_property
    def on(self) -> NDArray[np.float32]:
        """(row, col) 1 on the screen; a dome has it already."""
        dome = self.single
        if isinstance(dome, LowRankObservation):
            return np.asarray(dome.screen_like(np.empty(0, np.float32)))
        return self.screen.astype(np.float32)

    def subtracted(self, desired: Light, bounds: tuple[Array | float, Array | float]) -> Light:
        """Subtracts exactly from a master, at the one seat or the mean one.

        Parameters
        ----------
        desired
            (view, row, col, primary) master light.
        bounds
            The least and the most light, which broadcast.

        Returns
        -------
        light
            (view, row, col, primary) within bounds.
        """
        return subtracted(self.single, self.wanted(desired, self.single), bounds)[0]

    def wanted(self, desired: Light, observation: Observation) -> Light:
        """Computes what should be seen: direct light, and what is kept of light without a picture.

        Parameters
        ----------
        desired
            (view, row, col, primary) master light, 0 off the screen.
        observation
            What is seen, at one seat or at all.

        Returns
        -------
        wanted
            (seen view, row, col, primary).
        """
        return graded(observation.direct(desired), self.kept, self.screen)

    @cached_property
    def dome(self) -> LowRankObservation | None:
        """How a dome or room reflects light (of two views, their sum); None where none does."""
        return reflecting(self.single)


def _setting(
    scene: Scene, eye: Eye, observation: Observation | None, rows: int, cols: int
) -> Setting:
    single = observation
    if observation is None:
        observation = single = scene.solvable(rows, cols)
        if isinstance(observation, SeveralSeats):
            # One picture serves all seats: it is made for what the mean one is shown
            assert isinstance(scene, StereoScene)
            single = scene.mean_seat(rows, cols)
    else:  # of whose light without a picture nobody says that it was graded on
        scene = scene.with_grade(TAKEN_OUT, TAKEN_OUT)
    assert single is not None
    return Setting(
        scene, eye, observation, single, scene.screen(rows, cols), scene.pixel_areas(rows, cols)
    )


def graded(direct: Light, kept: NDArray[np.floating] | None, screen: NDArray[np.bool_]) -> Light:
    """Adds light without a picture that belongs to the grade.

    Parameters
    ----------
    direct
        (seen view, row, col, primary) direct light of the master.
    kept
        (view, primary) of one seat; None for none.
    screen
        (row, col) bool: where it is seen.

    Returns
    -------
    wanted
        As `direct`.
    """
    if kept is None:
        return direct
    xp = namespace(direct)
    black = np.tile(kept, (direct.shape[0] // len(kept), 1))[:, None, None, :]
    added = xp.asarray(black, dtype=direct.dtype, device=direct.device)
    if screen.all():
        return direct + added
    on = xp.asarray(screen, dtype=direct.dtype, device=direct.device)
    return direct + added * on[None, :, :, None]


def require_within_range(desired: Light, screen: NDArray[np.bool_]) -> None:
    """Checks that light is within 0..1 on the screen.

    Parameters
    ----------
    desired
        (view, row, col, primary).
    screen
        (row, col) bool.

    Raises
    ------
    InputError
        If it is not.
    """
    if all_within(desired, 0, 1):
        return
    outside = int(np.count_nonzero(screen[None, :, :, None] & ~((desired >= 0) & (desired <= 1))))
    if outside:
        raise InputError(
            f"desired light must lie in 0..1 on the screen, got {outside} values that do not; "
            f"bring it within range first (domesim.scene.screening.within_range)"
        )


def _on(screen: NDArray[np.bool_], light: Light, out: Light | None = None) -> Light:
    """Light without what lies off the screen, which nobody sees: files keep it (`encoded`).

    Primary by primary: NumPy is slow along an axis of three.
    """
    primaries = range(light.shape[-1])

    def lit(view: int, rows: slice) -> bool:
        off = ~screen[rows]
        return any(np.logical_and(light[view, rows, :, p], off).any() for p in primaries)

    if screen.all() or (out is None and not any(in_strips(lit, light.shape))):
        return light
    kept = np.empty_like(light) if out is None else out

    def keep(view: int, rows: slice) -> None:
        for p in primaries:
            np.multiply(light[view, rows, :, p], screen[rows], out=kept[view, rows, :, p])

    in_strips(keep, light.shape)
    return kept


def differences(scene: Scene, weighting: Weighting) -> float:
    """Converts weighted residuals to just-noticeable differences.

    Parameters
    ----------
    scene
        Where: projector white and adaptation luminance, cd/m².
    weighting
        What weighted the residual.

    Returns
    -------
    factor
        Just-noticeable differences in a weighted residual of 1.0 (white).
    """
    return scene.projector.white / scene.viewing.adaptation * weighting.peak
