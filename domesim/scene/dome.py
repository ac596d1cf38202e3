"""A dome theatre: its scene file -> dome, projector, viewing, observation."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.host.console import about
from domesim.host.numbers import decimal
from domesim.observation.base import AdjointObservation
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.dome_pair import ReflectedViews, dome_pair
from domesim.observation.followed import Followed
from domesim.observation.lowrank import LowRankObservation
from domesim.observation.projector import Projector
from domesim.observation.radiosity import quick_radiosity
from domesim.observation.spherical import ClosedFormDome, bare_gain, bare_transport
from domesim.observation.transport import PHOTOGRAPHS, TabulatedDome, Transport, load_transport
from domesim.observation.uncertain import SIGMAS, UncertainDome
from domesim.room import furniture, viewing
from domesim.room.dome import Dome
from domesim.room.lenses import lens_gains, seen_gain
from domesim.room.masks import UPLIFT_GAMMA, read_mask
from domesim.room.paint import paint_of
from domesim.room.theatre import (
    Cavity,
    Floor,
    Lamp,
    Lens,
    Lobe,
    Mask,
    Paint,
    Solid,
    Theatre,
    Viewpoint,
    Wall,
)
from domesim.room.unlit import lamp_light, projectors_black
from domesim.room.viewing import Viewing, large_threshold
from domesim.scene.base import Scene
from domesim.scene.dome_file import (
    DomeFile,
    DomeStereoSection,
    LampSection,
    MeasuredSection,
    ProjectorSection,
    SkySection,
    UnitSection,
)
from domesim.scene.fields import response_of, three
from domesim.scene.grade import DOMES, Grade
from domesim.scene.measured_dome import albedo_steps, whole_transport
from domesim.scene.mistakes import Mistakes


@final
@dataclass(frozen=True, eq=False)
class DomeScene(Scene):
    """A dome theatre: what its projector, screen and audience are.

    Parameters
    ----------
    name, description
        What the theatre is called and is.
    theatre
        Its screen, and all that light meets in it.
    projector
        Its projector.
    ambient
        Luminance of the unlit screen (projector black and stray light), cd/m².
    viewing
        Its audience.
    sources
        For each figure of the scene file where it is from.
    digest
        SHA-256 of all that light transport depends on.
    transport
        Its light transport, tabulated or measured; None for the closed form.
    measured
        What of it was measured, and how sure that is; None if nothing was.
    stereo
        How it keeps the eyes apart, if it shows 3D.
    sky
        Which light is which magnitude.
    frames_lift_black
        Whether frames hide the overlaps in black (`Theatre.black_contrast`), and not projectors.
    grade
        What belongs to the grade of masters.
    file
        What commands call it: its file's path, or the name of a bundled one; "" if it was made
        otherwise.
    content
        SHA-256 of what its file says, and of files that are named there; "" without a file.
    chosen
        None: a dome has one viewing.
    """

    name: str
    description: str
    theatre: Theatre
    projector: Projector
    ambient: float
    viewing: Viewing
    sources: Mapping[str, str]
    digest: str
    transport: Transport | None = None
    measured: MeasuredSection | None = None
    stereo: DomeStereoSection | None = None
    sky: SkySection = field(default_factory=SkySection)
    frames_lift_black: bool = False
    grade: Grade = DOMES
    file: str = field(default="", compare=False)
    content: str = field(default="", compare=False)
    chosen: tuple[str, ...] = field(default=(), init=False)

    @property
    def views(self) -> int:
        """One, a domemaster, or left and right."""
        return 1 if self.stereo is None else 2

    @property
    def pollution(self) -> str:
        """See `Scene`."""
        return "reflected" if self.stereo is None else "reflected, the other eye's"

    @property
    def one_eye(self) -> DomeScene:
        """The same theatre with one view's light alone, seen without glasses."""
        return self if self.stereo is None else replace(self, stereo=None)

    @property
    def masters(self) -> str:
        """See `Scene`."""
        return "left and right" if self.views == 2 else "a domemaster"

    def asked(self, transport: Path | None, seat: str | None) -> DomeScene:
        """See `Scene`."""
        scene = self
        if transport is not None:
            with about(transport):
                scene = scene.with_transport(load_transport(transport))
        return scene if seat is None else scene.seen_from(seat)

    @property
    def dome(self) -> Dome:
        """The screen's shape."""
        return self.theatre.dome

    @property
    def albedo(self) -> tuple[float, float, float]:
        """Albedo of the screen for each primary, holes counted in."""
        return self.theatre.screen_albedo

    @property
    def unlit(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See `Scene`: means over the screen; a theatre's lamps are none of it."""
        black, shape = self.projector.black, (self.views, 3)
        return np.full(shape, black), np.full(shape, self.ambient - black)

    def observation(self, rows: int, cols: int) -> AdjointObservation:
        """See `Scene`: what is seen of any frames; of a pair it is `solvable` of them."""
        if self.frames_lift_black:
            return self.as_projected.observation(rows, cols)
        if self.stereo is not None:
            return self.solvable(rows, cols)
        return self.one_view(rows, cols)

    @property
    def as_projected(self) -> DomeScene:
        """The theatre as it shows frames: what they lift black by is in them."""
        if not self.frames_lift_black:
            return self
        theatre = replace(self.theatre, black_contrast=None)
        return _blackened(replace(self, theatre=theatre, frames_lift_black=False))

    def lift(self, rows: int, cols: int) -> NDArray[np.float64] | None:
        """What frames lift black by, of projector white; None if they do not.

        Parameters
        ----------
        rows, cols
            Size of the domemaster, pixels.

        Returns
        -------
        lift
            (row, col) light that is added to a frame's; 0 off the screen.
        """
        if not self.frames_lift_black:
            return None
        even, bare = (
            projectors_black(each.theatre, rows, cols) for each in (self, self.as_projected)
        )
        gain = lens_gains(self.theatre, rows, cols).sum(0)
        return np.asarray((even - bare) / np.where(gain > 0, gain, 1.0))

    @cached_property
    def known(self) -> Transport | None:
        """The stored transport; radiosity's, of a dome that is no sphere; else None.

        The closed form of an ellipsoid is several times as far off as of a sphere with a floor.
        """
        turned = self.stereo is not None and self.stereo.kept not in (0, 1)
        if self.transport is not None or self.dome.height_ratio == 1 or turned:
            return self.transport
        return quick_radiosity(self.theatre)

    def one_view(self, rows: int, cols: int) -> LowRankObservation | TabulatedDome:
        """What the audience sees of one view.

        It is that of `known` if there is one, else the closed form of the bare screen, which is an
        approximation if `approximation` says so.

        Parameters
        ----------
        rows, cols
            Size of the domemaster, pixels.

        Returns
        -------
        observation
            It takes light (1, row, col, primary).

        Raises
        ------
        InputError
            If it is not square, or smaller than 2 x 2.
        """
        found, gain = self._evenly_dark(rows, cols)
        unlit = self._black(rows, cols)
        stored = self.known is not None and self.known.ambient.any()
        if self.theatre.lamps and not stored:
            unlit = lamp_light(self.theatre, rows, cols) + (0.0 if unlit is None else unlit)
        return found if unlit is None else found.lit(_as_seen(unlit, found, gain))

    def black_frame(self, rows: int, cols: int) -> NDArray[np.float64]:
        """What is seen of a black picture, over white, but for lamps.

        Parameters
        ----------
        rows, cols
            Size of the domemaster, pixels.

        Returns
        -------
        black
            (row, col, primary); 0 off the screen.
        """
        paint = self.theatre.paint
        even = 1.0 if paint is None else paint.on(rows, cols)
        black = self._even / self.projector.white * even * self.screen(rows, cols)[..., None]
        if (unlit := self._black(rows, cols)) is not None:
            black = black + _as_seen(unlit, *self._evenly_dark(rows, cols))
        return np.broadcast_to(black, (rows, cols, 3))

    @property
    def black_differs(self) -> bool:
        """Whether projectors have a black each, or lift it: then it differs from place to place."""
        return any(lens.black or lens.uplift is not None for lens in self.theatre.lenses)

    def with_even_black(self) -> DomeScene:
        """The same theatre with projectors that hide their overlaps' edges in black.

        What they lift black by is the least that does it (`domesim.room.unlit`).
        """
        brightest = projectors_black(self.theatre, _COARSE, _COARSE).max() * self.projector.white
        contrast = float(large_threshold(brightest))
        return _blackened(replace(self, theatre=replace(self.theatre, black_contrast=contrast)))

    @property
    def _even(self) -> float:
        """Luminance that the unlit screen has all over, cd/m²."""
        by_place = any(lens.black for lens in self.theatre.lenses)
        return self.ambient - by_place * self.projector.black

    def _black(self, rows: int, cols: int) -> NDArray[np.float64] | None:
        """(row, col, primary) direct light of projectors' black; None if it has no places."""
        if not self.black_differs:
            return None
        black = projectors_black(self.theatre, rows, cols)
        return np.repeat(black[..., None], 3, axis=2)

    def _evenly_dark(
        self, rows: int, cols: int
    ) -> tuple[LowRankObservation | TabulatedDome, NDArray[np.float64] | None]:
        """`one_view` without light that has places, and the irradiance by projectors."""
        gains, seen, theatre = None, None, self.theatre
        if theatre.lenses or not theatre.lambertian:
            gains = lens_gains(theatre, rows, cols)
        gain = None if gains is None else gains.sum(0)
        black = self._even / self.projector.white
        if self.known is None and theatre.paint is None:
            closed = ClosedFormDome(
                self.dome, rows, cols, albedo=self.albedo, lens_gain=gain, ambient=black
            )
            return closed, gain
        if self.known is not None and gains is not None:
            seen = seen_gain(theatre, gains)
        stored = (self.known or bare_transport(theatre)).observation(
            rows,
            cols,
            lens_gain=gain,
            seen_gain=seen,
            ambient=black,
            paint=None if theatre.paint is None else theatre.paint.on(rows, cols),
        )
        return stored, gain

    def solvable(self, rows: int, cols: int) -> AdjointObservation:
        """See `Scene`; of a stored transport, the strong modes, unless paint is coloured.

        Light by which frames hide overlaps in black is there without a picture.
        """
        exact = self.one_view(rows, cols)
        if isinstance(exact, TabulatedDome) and exact.coloured:
            return exact  # no pair: a scene of two views has no coloured paint
        seen = exact.low_rank() if isinstance(exact, TabulatedDome) else exact
        if self.stereo is None:
            return seen
        return dome_pair(
            seen,
            self._difference(seen, self.stereo.kept),
            Crosstalk(rows, cols, self.stereo.leaks),
        )

    def reflected_by_views(self, size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Reflected light of white views over their own: of their sum, and of their difference.

        Each is (primary,) reflected light over direct light, mean over the screen.

        Raises
        ------
        InputError
            If it is no 3D dome.
        """
        pair = self.solvable(size, size)
        if not isinstance(pair, Followed) or not isinstance(pair.first, ReflectedViews):
            raise InputError(f"{self.name} has one view, so no light of another")
        white = self.screen(size, size)[None, :, :, None] * np.ones(3)
        areas = self.pixel_areas(size, size)
        found = []
        for observation in (pair.first.summed, pair.first.differing):
            direct = observation.direct(white)
            reflected = observation.linear(white) - direct
            found.append(
                np.einsum("rc,vrcp->p", areas, reflected) / np.einsum("rc,vrcp->p", areas, direct)
            )
        return found[0], found[1]

    def _difference(self, summed: LowRankObservation, kept: float) -> LowRankObservation:
        """How the difference of the views is seen; what surfaces but the screen keep is 0."""
        factors, screen = summed.factors, summed.screen
        if kept == 1:
            return summed
        if kept == 0:
            return LowRankObservation(replace(factors, core=0 * factors.core), screen)
        gain, paint = factors.direct_gain, self.theatre.paint
        if paint is None:
            return ClosedFormDome(
                self.dome, *screen.shape, albedo=self.albedo, lens_gain=gain, kept=kept
            )
        painted = paint.on(*screen.shape)
        bare = bare_transport(self.theatre, kept)
        found = bare.observation(*screen.shape, lens_gain=gain / painted[..., 0], paint=painted)
        return LowRankObservation(replace(found.low_rank().factors, direct_gain=gain), screen)

    def uncertain(self, rows: int, cols: int) -> UncertainDome | None:
        """See `Scene`; None of a 3D dome, of which only one view was measured.

        A transport that was measured knows all of its errors. Else the albedos of all surfaces
        were measured: without a stored transport, which they were traced to, radiosity takes the
        place of the closed form.
        """
        if self.stereo is not None:
            return None
        stored, alone = self.transport, self._transport_measured
        if not self.albedo_measured:
            return None
        if stored is None:
            stored = whole_transport(self.theatre)
        best = replace(self, transport=stored).one_view(rows, cols)
        assert isinstance(best, TabulatedDome)
        if alone or self.measured is None:
            return UncertainDome(best, [], np.zeros((0, 3, 0)))
        return UncertainDome(best, *albedo_steps(self.theatre, self.measured, stored))

    def screen(self, rows: int, cols: int) -> NDArray[np.bool_]:
        """See `Scene`: the domemaster's circle."""
        return self.dome.inside(rows, cols)

    def pixel_areas(self, rows: int, cols: int) -> NDArray[np.floating]:
        """See `Scene`."""
        return self.dome.kept_areas(rows, cols)

    def facts(self) -> dict[str, str]:
        """See `Scene`."""
        closed = "closed form of a bare matte dome, all bounces; computed, not measured"
        by = "tabulated by path tracing"
        if self.transport is not None and self.transport.provenance.get("method") == PHOTOGRAPHS:
            by = "measured from photographs of patterns"
        stored = f"the whole theatre's light transport as {by}"
        if self.transport is None:
            stored = "radiosity of screen, floor and wall, all bounces; computed, not measured"
        model = closed if self.known is None else stored
        facts = {
            "Theatre": f"{self.name}, radius {self.dome.radius:g} m, half-angle "
            f"{np.degrees(self.dome.half_angle):g}°, screen albedo "
            f"{_by_primary(self.albedo)} (holes counted in){self._painted}",
            "Projector": f"white {self.projector.white:g} cd/m², black "
            f"{decimal(self.projector.black)} cd/m²{' on average' * self.black_differs}, "
            f"{self.projector.primaries} primaries",
            "Light without a picture": self.graded,
            "Model": model,
        }
        if self.approximation is not None:
            facts["Left out"] = "; ".join(self.left_out)
        if self.stereo is not None:
            white = self.stereo.leaks.sum(axis=2) @ self.projector.luminance_weights
            facts["3D"] = (
                f"{self.stereo.system}; the left eye sees {white[0]:.2%} of the right one's direct "
                f"light, the right eye {white[1]:.2%} of the left one's; of what makes the views "
                f"differ, each reflection keeps {self.stereo.kept:.0%}"
            )
        if self.measured is not None:
            spread = ", ".join(f"{100 * part:.2g}" for part in self.reflected_error)
            facts["Measured"] = (
                f"{self.measured.date} ({self.measured.survey}); by the screen albedo's "
                f"uncertainty, a white frame's reflected light is known within ±{spread} % (95 %)"
            )
        return facts

    @property
    def _painted(self) -> str:
        """What multiplies the screen's albedo, in words."""
        paint = self.theatre.paint
        if paint is None:
            return ""
        return (
            f", times an albedo map of {decimal(float(paint.factors.min()), 2)} to "
            f"{decimal(float(paint.factors.max()), 2)}, mean {_by_primary(self.theatre.mean_paint)}"
        )

    @property
    def reflected_error(self) -> tuple[float, float, float]:
        """Half of the 95 % interval of white's reflected light, relative, one a primary.

        On the bare screen phi = rho s / (1 - rho s), with s its share of the sphere. So d phi / phi
        is d rho / (rho (1 - rho s)). A residual that is left for want of a better albedo is this
        share of the reflected light. It is 0 if nothing was measured.
        """
        if self.measured is None or "screen" not in self.measured.standard_errors:
            return 0.0, 0.0, 0.0
        errors = np.asarray(self.measured.standard_errors["screen"])
        albedo = np.asarray(self.albedo)
        gains = np.array([bare_gain(rho, self.dome) for rho in albedo])
        return three(SIGMAS * errors / albedo * (1 + gains))

    @property
    def approximation(self) -> str | None:
        """See `Scene`."""
        if not self.left_out:
            return None
        if self.transport is not None:
            return (
                f"approximate: {'; '.join(self.left_out)}. 'domesim render' shows it; a stored "
                f"transport, which is smooth, leaves it out"
            )
        way_out = f"domesim tabulate {self.argument} --out FILE.npz, then --transport FILE.npz"
        if self.known is not None:
            return (
                f"approximate: radiosity knows screen, floor and wall only. For the whole theatre: "
                f"{way_out}"
            )
        return (
            f"approximate: the closed form knows the bare screen only. For the whole theatre: "
            f"{way_out}"
        )

    @property
    def left_out(self) -> tuple[str, ...]:
        """What of this theatre `observation` does not know."""
        if self.known is None:
            return self.theatre.departures()
        if self.transport is None:
            return self.theatre.beyond_enclosure
        shadowed = self.transport.provenance.get("shadowed", 0.0)
        left_out = {
            f"{shadowed:.1%} of the screen lies in shadows of what is before a projector": (
                shadowed >= _SHADOWED
            ),
            "a ghost of the picture shines back through the screen's holes": (
                self.theatre.shines_back
            ),
            "light from behind the holes is dimmed as that of the paint beside them": (
                self.theatre.shines_back and self.theatre.paint is not None
            ),
        }
        return tuple(reason for reason, holds in left_out.items() if holds)

    @property
    def albedo_measured(self) -> bool:
        """Whether the screen's albedo, or the light that it reflects, was measured."""
        return self.measured is not None or self._transport_measured

    @property
    def _transport_measured(self) -> bool:
        return self.transport is not None and bool(self.transport.provenance.get("measured"))

    def with_albedo(self, times: float) -> DomeScene:
        """The same theatre with a screen of another albedo; white is as bright as it was.

        A stored transport is scaled as a bare screen's reflected light is.

        Parameters
        ----------
        times
            Of today's albedo; a lighter screen has `WHITEST` at most.

        Returns
        -------
        scene
            That is in no file.
        """
        old = np.asarray(self.theatre.albedo)
        albedo = np.minimum(times * old, np.maximum(old, WHITEST))
        scene = replace(self, theatre=replace(self.theatre, albedo=three(albedo)))
        if self.transport is None:
            return scene
        factor = bare_transport(scene.theatre).core / bare_transport(self.theatre).core
        return replace(scene, transport=replace(self.transport, core=self.transport.core * factor))

    def seen_from(self, name: str) -> DomeScene:
        """The same theatre, with figures and predictions for one of its seats or viewpoints.

        Raises
        ------
        InputError
            If there is no such seat, or it is outside the dome's sphere.
        """
        known = self.theatre.viewpoints
        if name not in known:
            way_out = f"use one of {', '.join(known)}" if known else "its scene file names none"
            raise InputError(f"{self.name} has no seat {name!r}; {way_out}")
        seat = viewing.DomeSeat(self.dome, known[name].position)
        return replace(self, viewing=replace(self.viewing, seat=seat))

    def with_transport(self, transport: Transport) -> DomeScene:
        """The same scene with a stored transport.

        Raises
        ------
        InputError
            If it is another theatre's.
        """
        made_for = transport.provenance.get("digest", self.digest)
        if transport.dome != self.dome or made_for != self.digest:
            known = transport.provenance.get("scene", "another theatre")
            raise InputError(
                f"the stored transport is of {known!r}, or of {self.name!r} before it was changed; "
                f"run domesim tabulate {self.argument} again"
            )
        return replace(self, transport=transport)


_COARSE = 256
"""Pixels a side of the domemaster by which means of black are taken."""
WHITEST = 0.95
"""Albedo of the whitest paint."""
_SHADOWED = 2e-3
"""Share of the screen that may lie in shadow without a word: what rim pixels amount to."""


def _as_seen(
    unlit: NDArray[np.float64],
    observation: LowRankObservation | TabulatedDome,
    gain: NDArray[np.float64] | None,
) -> NDArray[np.float64]:
    """(row, col, primary): what is seen of direct light, (row, col, primary) before paint.

    It is what would be seen of the picture that gives this light.
    """
    picture = unlit if gain is None else unlit / np.where(gain > 0, gain, 1.0)[..., None]
    return np.asarray(observation.linear(picture[None])[0])


def _by_primary(values: tuple[float, float, float]) -> str:
    """One number, or three that differ."""
    numbers = [decimal(value) for value in values]
    return numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers)


def built(file: DomeFile, folder: Path) -> DomeScene:
    """Builds the theatre that a scene file describes.

    Parameters
    ----------
    file
        Its content.
    folder
        Where the files lie that it names.

    Returns
    -------
    theatre
        With no stored transport.
    """
    mistakes = Mistakes()
    theatre = _theatre(file, folder, mistakes)
    with mistakes.noted():
        for rho in theatre.screen_albedo:
            # Refuses what no frame can change: a sphere that keeps all its light.
            bare_gain(rho, theatre.dome)
    mistakes.refuse()
    lit = file.projector
    white = lit.white_cd_m2
    if white is None:
        weights = Projector(lit.primaries, 1.0).luminance_weights
        irradiance = (lit.lumens or 0.0) / theatre.dome.screen_area / _mean_gain(theatre)
        white = float(weights @ theatre.screen_albedo) * irradiance / np.pi
    # Lamps are known in cd/m², light in units of white.
    lamps = tuple(
        replace(lamp, luminance=three(np.asarray(lamp.luminance) / white)) for lamp in theatre.lamps
    )
    blacks = [(unit.black_cd_m2 or 0.0) / white for unit in lit.units]
    lenses = tuple(map(_darkened, theatre.lenses, blacks)) if lit.units else theatre.lenses
    scene = DomeScene(
        name=file.name,
        description=file.description,
        theatre=replace(theatre, lamps=lamps, lenses=lenses),
        projector=Projector(lit.primaries, white, lit.black_cd_m2, response=response_of(lit)),
        ambient=lit.black_cd_m2 + file.ambient.luminance_cd_m2,
        grade=file.grade.over(DOMES),
        viewing=viewing.from_dome_centre(theatre.dome, file.viewing.adaptation_cd_m2),
        sources=file.sources,
        digest=_with_files(file, theatre),
        measured=file.measured,
        stereo=file.stereo,
        sky=file.sky,
    )
    if not any(blacks):
        return scene
    if lit.even_black is None:
        return _blackened(scene)
    return replace(scene.with_even_black(), frames_lift_black=lit.even_black == "frames")


def _darkened(lens: Lens, black: float) -> Lens:
    return replace(lens, black=black)


def _blackened(scene: DomeScene) -> DomeScene:
    """The scene with the mean of its projectors' blacks, as it is seen on a bare screen."""
    theatre, white = scene.theatre, scene.projector.white
    areas = theatre.dome.screen_areas(_COARSE, _COARSE)
    mean = np.sum(areas * projectors_black(theatre, _COARSE, _COARSE)) / areas.sum()
    reflected = [bare_gain(rho, theatre.dome) for rho in theatre.screen_albedo]
    black = float(mean * (1 + scene.projector.luminance_weights @ reflected)) * white
    return replace(
        scene,
        projector=replace(scene.projector, black=black),
        ambient=scene.ambient - scene.projector.black + black,
    )


def _mean_gain(theatre: Theatre, size: int = 128) -> float:
    """Mean irradiance of the screen by its projectors, over that of the ideal one's."""
    if theatre.corrected:
        return 1.0
    areas = theatre.dome.screen_areas(size, size)
    # A file with holes loads, so that they can be shown (`domesim.inspection.coverage`)
    gains = lens_gains(theatre, size, size, holes=True)
    return float(np.sum(areas * gains.sum(0)) / areas.sum())


def _with_files(file: DomeFile, theatre: Theatre) -> str:
    """The file's digest, with what is in the files that it names."""
    paint = theatre.paint
    masks = [lens.mask for lens in theatre.lenses if lens.mask is not None]
    if not (file.meshes or masks or paint is not None):
        return file.digest
    digest = hashlib.sha256(file.digest.encode())
    for solid in theatre.solids if file.meshes else ():
        digest.update(solid.vertices.tobytes() + solid.faces.tobytes())
    if paint is not None:
        digest.update(paint.factors.tobytes())
    for mask in masks:
        digest.update(np.ascontiguousarray(mask.weights).tobytes())
    return digest.hexdigest()


def _theatre(file: DomeFile, folder: Path, mistakes: Mistakes) -> Theatre:
    dome, screen = file.dome.shape(), file.screen
    cavity, lobe = screen.cavity, screen.lobe
    floor, wall = _floor_and_wall(file, dome)
    solids, viewpoints = _furniture(file, floor, dome, folder, mistakes)
    return Theatre(
        dome=dome,
        albedo=three(screen.albedo),
        perforation=screen.perforation,
        cavity=None
        if cavity is None
        else Cavity(cavity.depth_m, three(cavity.albedo), three(cavity.back_albedo)),
        lobe=None if lobe is None else Lobe(lobe.share, lobe.roughness),
        floor=floor,
        wall=wall,
        solids=solids,
        lamps=tuple(_lamp(lamp) for lamp in file.lamps),
        lenses=_lenses(file.projector, dome, folder, mistakes),
        corrected=file.projector.lens.corrected,
        viewpoints=viewpoints,
        paint=_paint(file, dome, folder, mistakes),
    )


def _paint(file: DomeFile, dome: Dome, folder: Path, mistakes: Mistakes) -> Paint | None:
    given = file.screen.albedo_map
    if given is None:
        return None
    with mistakes.noted():
        paint = paint_of(given, dome, folder)
        if paint.coloured and file.stereo is not None:
            raise InputError("screen.albedo_map must be grey in a scene with [stereo], got colours")
        return paint
    return None


def _floor_and_wall(file: DomeFile, dome: Dome) -> tuple[Floor | None, Wall | None]:
    if file.floor is None:
        return None, None
    wall = None
    radius = dome.widest
    if file.wall is not None:
        radius = file.wall.radius_m or radius
        top = dome.lowest if file.wall.top_m is None else file.wall.top_m
        if top > file.floor.height_m:
            wall = Wall(radius, file.floor.height_m, top, three(file.wall.albedo))
    floor = Floor(file.floor.height_m, file.floor.radius_m or radius, three(file.floor.albedo))
    return floor, wall


def _furniture(
    file: DomeFile, floor: Floor | None, dome: Dome, folder: Path, mistakes: Mistakes
) -> tuple[tuple[Solid, ...], dict[str, Viewpoint]]:
    solids: list[Solid] = []
    viewpoints: dict[str, Viewpoint] = {}
    front = dome.surface(np.array(dome.half_angle / 2), np.array(np.pi / 2)) @ dome.to_room.T
    if file.seating is not None and floor is not None:
        seats = file.seating
        with mistakes.noted():
            rows, viewpoints = furniture.seating(
                floor_height=floor.height,
                rows=seats.rows,
                seats_per_row=seats.seats_per_row,
                first_row=seats.first_row_m,
                row_spacing=seats.row_spacing_m,
                seat_spacing=seats.seat_spacing_m,
                rise=seats.rise_m,
                within=floor.radius,
                albedo=three(seats.albedo),
                occupied=seats.occupied,
                audience_albedo=three(seats.audience_albedo),
                seed=seats.seed,
                look_at=(float(front[0]), float(front[1]), float(front[2])),
            )
            solids += rows
    solids += [
        furniture.box(box.name, box.low_m, box.high_m, three(box.albedo)) for box in file.boxes
    ]
    for mesh in file.meshes:
        with mistakes.noted():
            solid = furniture.from_file(folder / mesh.file, mesh.name, three(mesh.albedo))
            furniture.require_near(solid, dome.radius)
            solids.append(solid)
    for name, view in file.viewpoints.items():
        viewpoints[name] = Viewpoint(view.position_m, view.look_at_m, np.radians(view.field_deg))
    return tuple(solids), viewpoints


def _lenses(
    projector: ProjectorSection, dome: Dome, folder: Path, mistakes: Mistakes
) -> tuple[Lens, ...]:
    if projector.units:
        return tuple(_unit(unit, folder, mistakes) for unit in projector.units)
    lens = projector.lens
    if lens.corrected and not any(lens.position_m):
        return ()
    # A single lens is given in the dome's frame.
    place = dome.to_room @ np.asarray(lens.position_m)
    x, y, z = (float(value) for value in place)
    zenith = dome.to_room[:, 2] * dome.radius
    ahead = (x + float(zenith[0]), y + float(zenith[1]), z + float(zenith[2]))
    return (Lens("lens", (x, y, z), ahead, field=2 * np.pi),)


def _unit(unit: UnitSection, folder: Path, mistakes: Mistakes) -> Lens:
    mask = uplift = None
    with mistakes.noted():
        if unit.mask is not None:
            mask = read_mask(folder / unit.mask)
        if unit.uplift is not None:
            uplift = Mask(read_mask(folder / unit.uplift).weights ** UPLIFT_GAMMA)
    return Lens(
        unit.name,
        unit.position_m,
        unit.look_at_m,
        np.radians(unit.roll_deg),
        unit.kind,
        np.radians(unit.field_deg),
        unit.aspect,
        np.radians(unit.blend_deg),
        unit.shift,
        mask,
        blends_black=unit.blends_black,
        uplift=uplift,
    )


def _lamp(lamp: LampSection) -> Lamp:
    normal = np.asarray(lamp.normal, np.float64)
    normal /= np.linalg.norm(normal)
    reference = np.array([0.0, 0, 1]) if abs(normal[2]) < 0.999 else np.array([0.0, 1, 0])
    across = np.cross(reference, normal)
    across *= lamp.width_m / 2 / np.linalg.norm(across)
    up = np.cross(normal, across)
    up *= lamp.height_m / 2 / np.linalg.norm(up)
    return Lamp(lamp.name, lamp.position_m, three(across), three(up), three(lamp.luminance_cd_m2))
