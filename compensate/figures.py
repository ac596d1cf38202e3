"""How good the light of a method is: figures that people compare.

Quality is `compensate.ruler`'s, which no setting of a method changes. Beside it stand plain figures
of what that cannot see (`compensate.plain`), the paper's visible error, what is left of ghosts, and
how sure a measured scene is of all that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.foresight import Foreseen, foreseen
from compensate.ghosts import edge_energy, ghost_contour
from compensate.overview import Overview, Seen
from compensate.plain import Around, PlainFigures, PlainRuler
from compensate.pose import Posed, differences
from compensate.ruler import Ruler, averaged
from compensate.solver.result import Result
from compensate.weighting import Weighting
from domesim.light import Light
from domesim.light.planes import Index, Planes
from domesim.light.rounding import is_rounding
from domesim.light.strips import in_strips
from domesim.observation.grey_to_grey import GreyToGrey
from domesim.observation.seats import SeveralSeats
from domesim.scene import Scene, StereoScene
from domesim.scene.screening import mean_luminance

_INVISIBLE_LIGHT = 1e-5  # of white: far below a 16 bit code of any transfer function's shadows


@final
@dataclass(frozen=True)
class Dark:
    """The darker half of a picture (`compensate.plain`): of the master, untouched, and as seen.

    Parameters
    ----------
    master, untouched, seen
        Its luminance, cd/m².
    star_master, star_untouched, star_seen
        Magnitude of the faintest star by Crumey's typical observer; None without a sky, and where
        plain figures are left out.
    """

    master: float
    untouched: float
    seen: float
    star_master: float | None
    star_untouched: float | None
    star_seen: float | None


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
        How much worse it looks than the master, by ColorVideoVDP, in just-objectionable differences
        (`compensate.ruler`): untouched, subtracted, and as compensated, before rounding to the
        file's code values. No setting changes the model. Of several seats, their mean.
        `loss_before` may be left out (`Solution.outcome`). Below `ruler.NO_DIFFERENCE` there is no
        difference.
    black, contrast_fine, contrast_coarse, stars, stars_in_order, hue_shift, sky, faintest_star,
    faintest_star_schaefer, projected_star, projected_star_schaefer
        `compensate.plain.PlainFigures` as compensated, at the first seat. They are left out where
        `loss_before` is.
    dark
        Luminance of the darker half at the first seat, and the faintest star: see `Dark`.
    ghost_edges
        Ghost edge energy of a stereo pair (`compensate.ghosts`) at the first seat, 1 for the
        untouched master; None without ghosts.
    loss_by_seat
        `loss_after` of each of several seats.
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
        What is left in fact in a measured scene: (low, likely, high) ends of the 95 % interval and
        median. The first is the residual's root-mean-square over the screen, 1 = projector white,
        the second `Appraisal.visible_error`; both by the whole room and not by the closed form.
        None if nothing was measured.
    """

    method: str
    clipped: float
    out_of_range: float
    pollution: float
    loss_before: float | None
    loss_subtractive: float
    loss_after: float
    black: float | None
    contrast_fine: float | None
    contrast_coarse: float | None
    stars: float | None
    stars_in_order: float | None
    hue_shift: float | None
    sky: float | None
    faintest_star: float | None
    faintest_star_schaefer: float | None
    projected_star: float | None
    projected_star_schaefer: float | None
    dark: Dark
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
class Look:
    """What the figures say of one light.

    Parameters
    ----------
    loss
        Quality lost, JOD; the mean of all seats.
    by_seat
        The same at each of several seats; empty for one.
    plain
        Plain figures at the first seat.
    """

    loss: float
    by_seat: dict[str, float]
    plain: PlainFigures


@final
@dataclass(frozen=True)
class Glance:
    """What figures of one light need of it.

    Parameters
    ----------
    seen
        What is seen of it at all seats.
    around
        What is seen at the first seat around the master's stars.
    subtracted
        Whether it is exact clipped subtraction.
    """

    seen: Seen
    around: Around
    subtracted: bool


@final
@dataclass(frozen=True)
class Appraisal:
    """How good light is for a posed master; what is computed once serves all methods."""

    posed: Posed

    @property
    def _scene(self) -> Scene:
        return self.posed.scene

    @property
    def _screen(self) -> NDArray[np.bool_]:
        return self.posed.screen

    @property
    def clipped(self) -> float:
        """Share of the screen's pixels where subtraction needs less light than none."""
        return self._subtraction[0]

    @property
    def loss_subtractive(self) -> float:
        """`loss` of exact clipped subtraction."""
        return _mean(self._subtraction[1])

    @cached_property
    def _subtraction(self) -> tuple[float, dict[str, float]]:
        """`clipped`, and the losses of exact clipped subtraction."""
        posed, pixels = self.posed, self._scene.views * np.count_nonzero(self._screen)
        floor = posed.floor
        if posed.exact:
            return 0.0, dict.fromkeys(self._rulers, 0.0)
        if floor is None:
            return self._clipped_of_pictures() / pixels, self._losses(self._averaged(posed.shown))
        counts = []

        def projected(_: int, rows: Index, cols: Index) -> list[NDArray[Any]]:
            light, left = floor.projected(rows, cols)
            counts.append(self._too_bright(left, (rows, cols)))
            return light

        losses = self._losses(self._overview.of(projected).small)
        return float(sum(counts) / pixels), losses

    def _clipped_of_pictures(self) -> int:
        """How many pixels show too much over subtraction, by what is seen of it."""
        posed = self.posed
        shown, wanted = posed.shown, posed.single.desired
        if isinstance(posed.observation, SeveralSeats):
            shown = posed.single.observation.observe(posed.subtractive)

        def count(view: int, rows: slice) -> int:
            part = shown[view, rows] - wanted[view, rows]
            return self._too_bright(
                [part[..., p] for p in range(part.shape[-1])], (rows, slice(None))
            )

        return sum(in_strips(count, shown.shape))

    def _averaged(self, light: Light) -> Light:
        return averaged(light, self._screen)

    @property
    def pollution(self) -> float:
        """Mean luminance that pollution and ambient light add to the untouched master, cd/m²."""
        return self._untouched[0]

    @cached_property
    def loss_before(self) -> float:
        """`loss` of the untouched master."""
        if not self.posed.exact:
            return self._untouched[2]
        seen = self._desired or self._overview.of(self.posed.desired)
        return _mean(self._losses(seen.small))

    @cached_property
    def _untouched(self) -> tuple[float, NDArray[np.floating], float, float]:
        """`pollution`, a pair's ghosts, `loss_before` and the black that is seen, cd/m².

        Ghosts are (view, row, col) luminance that is seen too much, cd/m². `loss_before` is NaN
        where subtraction is exact: it may never be asked for.
        """
        posed, projector = self.posed, self._scene.projector
        if self._desired is not None:
            small, _, excited = self._desired
            assert excited is not None  # of a dome of one view
            weights = projector.luminance_weights
            pollution = self._overview.pollution(excited, weights) * projector.white
            ghost = np.zeros((0, *self._screen.shape), np.float32)
        else:
            residual = posed.observation.observe(posed.desired)
            small = self._averaged(residual)
            residual -= posed.wanted
            ghosts = residual[: self._scene.views if self.of_ghosts else 0]
            ghost = projector.luminance(ghosts)
            pollution = mean_luminance(residual, self._scene, posed.setting.areas)
        lost = math.nan if posed.exact else _mean(self._losses(small))
        return pollution, ghost, lost, self._plain.black(self._of_first_seat(small))

    @property
    def _overview(self) -> Overview:
        return self.posed.setting.overview

    @property
    def _desired(self) -> Seen | None:
        """What is seen of the untouched master in a dome of one view."""
        return self.posed.seen_untouched

    @cached_property
    def _wanted(self) -> Light:
        """What all seats should see, `averaged`."""
        if self._desired is not None and self._desired.own is not None:
            return self._desired.own
        return self._averaged(self.posed.wanted)

    def _too_bright(self, planes: Sequence[NDArray[np.floating]], at: tuple[Index, Index]) -> int:
        """How many pixels of the screen show more light than they should, in some primary."""
        too_bright = reduce(np.logical_or, (plane > _INVISIBLE_LIGHT for plane in planes))
        return int(np.count_nonzero(too_bright & self._screen[at]))

    def visible_error(self, light: Light) -> float:
        """Computes the weighted residual over the screen, JND rms.

        It is the paper's: Daly's sensitivity at one adaptation luminance, with the default settings
        of `PerceptualWeighting`. A weighted residual is in light (1.0 = white) at the eye's most
        sensitive frequency; over the adaptation luminance it is a contrast, times the CSF's peak a
        multiple of the threshold. Several seats count by their weights.
        """
        residual = self.posed.residual(light)
        if is_rounding(residual):
            return 0.0
        judge = self.posed.setting.judge
        return self._in_differences(judge.energy(residual), judge)

    def loss(self, light: Light | Planes) -> float:
        """Returns how much worse light looks than the master, JOD; the mean of all seats.

        Light is as for `Overview.of`.
        """
        return _mean(self._losses(self._overview.of(light).small))

    def dark(self, look: Look) -> Dark:
        """Tells of the darker half.

        Parameters
        ----------
        look
            What the figures say of the light that is projected. Without plain figures the master
            is seen, and stars are left out: they are looked for in all pixels.
        """
        ruler, plain = self._plain, look.plain
        master, untouched = ruler.black(self._of_first_seat(self._wanted)), self._black_before
        seen = master if plain.black is None else plain.black * untouched
        dark = Dark(master, untouched, seen, None, None, plain.faintest_star)
        if plain.faintest_star is None:
            return dark
        own, polluted = ruler.faintest(master), ruler.faintest(untouched)
        return replace(
            dark,
            star_master=own and own.crumey,
            star_untouched=polluted and polluted.crumey,
        )

    def glance(self, light: Light) -> Glance:
        """Takes from (view, row, col, primary) projected light all that `look` needs of it."""
        seen = self._overview.of(light)
        around = self._plain.at_stars(self._overview.around(light, seen))
        return Glance(seen, around, self.posed.subtracts(light))

    def look(self, light: Light | Glance, *, plain: bool = True) -> Look:
        """Computes what changes from method to method.

        Parameters
        ----------
        light
            (view, row, col, primary) that is projected, or a glance at it.
        plain
            Whether to compute plain figures, too.

        Returns
        -------
        look
            Quality lost, in the mean and by seat, and plain figures.
        """
        if not isinstance(light, Glance) and not plain and self.posed.subtracts(light):
            losses, figures = self._subtraction[1], PlainFigures()
        else:
            glance = light if isinstance(light, Glance) else self.glance(light)
            small = glance.seen.small
            losses = self._subtraction[1] if glance.subtracted else self._losses(small)
            figures = PlainFigures()
            if plain:
                first = self._of_first_seat(small)
                figures = self._plain.figures(first, self._black_before, glance.around)
        several = isinstance(self.posed.observation, SeveralSeats)
        return Look(_mean(losses), losses if several else {}, figures)

    @cached_property
    def of_master(self) -> PlainFigures:
        """Plain figures of the master, as the first seat should see it."""
        return self._plain.of_master(self._black_before)

    @cached_property
    def _black_before(self) -> float:
        """Black of the untouched master, cd/m²."""
        return self._untouched[3]

    @cached_property
    def _plain(self) -> PlainRuler:
        posed, small = self.posed, self._of_first_seat(self._wanted)
        wanted = posed.own_planes if posed.floor else self._of_first_seat(posed.wanted)
        return PlainRuler(wanted, self._scene, self._screen, small)

    def _of_first_seat(self, light: Light) -> Light:
        if isinstance(self.posed.observation, SeveralSeats):
            return self.posed.observation.of_seat(light, 0)
        return light[: self._scene.views]

    def _in_differences(self, energy: float, weighting: Weighting) -> float:
        """Just-noticeable differences, rms, of a weighted residual's energy."""
        mean_square = energy / (np.count_nonzero(self._screen) * self._scene.views)
        return float(np.sqrt(mean_square)) * differences(self._scene, weighting)

    def foreseen(self, light: Light) -> Foreseen | None:
        """Foresees what is left of the pollution in fact; None if nothing was measured.

        Its weighted residual is in just-noticeable differences, as `visible_error`.
        """
        uncertain = self.posed.setting.uncertain
        if uncertain is None:
            return None
        residual = uncertain.best.observe(light)
        residual -= self.posed.wanted
        forecast = foreseen(residual, uncertain.changes(light), self.posed.setting.judge.apply)
        pixels = np.count_nonzero(self._screen) * self._scene.views
        unit = differences(self._scene, self.posed.setting.judge) / np.sqrt(pixels)
        return replace(forecast, weighted=forecast.weighted.times(unit))

    def distance(self, result: Result) -> float | None:
        """Bounds how far what is seen is from what the optimum x* shows, JND rms.

        As x* is optimal, 1/2 ||lambda(psi(x) - psi(x*))||² <= cost(x) - cost(x*), of an affine psi:
        None for a table, and for several seats, which count by their weights.
        """
        several = isinstance(self.posed.observation, GreyToGrey | SeveralSeats)
        if result.gap is None or result.cost is None or several:
            return None
        if not result.gap:
            return 0.0
        energy = 2 * result.cost * result.gap / (1 + result.gap)
        return self._in_differences(energy, self.posed.problem.weighting)

    @property
    def of_ghosts(self) -> bool:
        """Whether all pollution is ghosts: of flat pairs."""
        return self._scene.views > 1 and self.posed.setting.dome is None

    def ghost_edges(self, light: Light) -> float | None:
        """Computes a pair's ghost edge energy at the first seat; None without ghosts' edges.

        A ghost that was rounding from the start gives no figure. Nor does a 3D dome: what is lifted
        there has edges of its own.
        """
        if not self.of_ghosts:
            return None
        ghost = self._untouched[1]
        if np.ptp(ghost, axis=(1, 2)).max() < _INVISIBLE_LIGHT * self._scene.projector.white:
            return None
        if self.posed.exact and self.posed.subtracts(light):
            return 0.0
        error = self._error(light)
        if is_rounding(error / self._scene.projector.white):
            return 0.0
        density = self._scene.viewing.pixels_per_degree(*self._screen.shape)
        energy = edge_energy(error, ghost, density)
        return energy if np.isfinite(energy) else None

    def ghost_contour(self, light: Light) -> float | None:
        """Computes a pair's ghost contour at the first seat, where subtraction clips.

        None without ghosts that have edges there, and for a 3D dome, as of `ghost_edges`.
        """
        if not self.of_ghosts or self.posed.exact:
            return None
        first = slice(self._scene.views)
        too_bright = self.posed.shown[first] - self.posed.wanted[first] > _INVISIBLE_LIGHT
        where = np.any(too_bright, axis=-1) & self._screen
        density = self._scene.viewing.pixels_per_degree(*self._screen.shape)
        return ghost_contour(self._error(light), self._untouched[1], where, density)

    def _error(self, light: Light) -> NDArray[np.floating]:
        """(view, row, col) luminance that is seen too much at the first seat, cd/m²."""
        residual = self.posed.residual(light)[: self._scene.views]
        return self._scene.projector.luminance(residual)

    def lost_map(self, seen: Light) -> NDArray[np.floating]:
        """Maps the quality that is lost at the first seat, (view, row, col), JOD."""
        ruler = next(iter(self._rulers.values()))
        if is_rounding(self._averaged(seen), ruler.wanted):
            return np.zeros(seen.shape[:3], np.float32)
        return ruler.lost_map(seen)

    def _losses(self, seen: Light) -> dict[str, float]:
        """Loss by the seat's name, from the averaged light of all seats; one has no name."""
        losses = {}
        for number, (name, ruler) in enumerate(self._rulers.items()):
            of_seat = seen
            if isinstance(self.posed.observation, SeveralSeats):
                of_seat = self.posed.observation.of_seat(seen, number)
            losses[name] = 0.0 if is_rounding(of_seat, ruler.wanted) else ruler.lost(of_seat)
        return losses

    @cached_property
    def _rulers(self) -> dict[str, Ruler]:
        """Ruler by the seat's name; a single seat has no name."""
        seats = {"": self._wanted}
        if isinstance(self.posed.observation, SeveralSeats):
            assert isinstance(self._scene, StereoScene)
            seats = {
                name: self.posed.observation.of_seat(self._wanted, number)
                for number, name in enumerate(self._scene.chosen)
            }
        return {name: Ruler(wanted, self._scene, self._screen) for name, wanted in seats.items()}


def _mean(losses: dict[str, float]) -> float:
    return float(np.mean(list(losses.values())))
