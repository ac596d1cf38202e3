"""A stereo system: its scene file -> projector, viewing, and what each eye sees at each seat."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.host.console import about
from domesim.light import transfer
from domesim.light.blocks import light_means
from domesim.observation.base import AdjointObservation
from domesim.observation.crosstalk import Crosstalk, leak_matrices, leaks_to_both, over_pixels
from domesim.observation.grey_to_grey import GreyToGrey
from domesim.observation.projector import Projector
from domesim.observation.seats import SeveralSeats
from domesim.observation.uncertain import UncertainMap, UncertainPair
from domesim.room import viewing
from domesim.room.viewing import Viewing
from domesim.scene.base import Scene
from domesim.scene.crosstalk_maps import CrosstalkMaps, load_maps
from domesim.scene.fields import response_of
from domesim.scene.flat import LightsWay, way_of
from domesim.scene.grade import SCREENS, Grade
from domesim.scene.stereo_file import (
    CrosstalkSection,
    MeasuredProjectorSection,
    PolarisationSection,
    StereoFile,
    grids,
)
from domesim.scene.stereo_measured import measured_system
from domesim.stereo.polarisation import crosstalk_estimate
from domesim.stereo.system import CircularFilter, PolarisedProjector, SilverScreen, StereoTheatre

_LARGEST = 2048
"""Most rows or columns that a background keeps."""
MAP_CELLS = (9, 15)
"""Rows and cols of a crosstalk map that is computed: it is smooth."""

_MUCH = 0.25
"""Mean crosstalk beyond that of any display that is sold."""
_UNKNOWN = "not computed, as it is known for crosstalk, but not for lens and room"

SWEET_SPOT = "sweet spot"
"""Name of the seat of a system that names none."""


@final
@dataclass(frozen=True)
class Seat:
    """Crosstalk at one seat.

    Parameters
    ----------
    matrices
        (view, primary, primary) share of the other view's light that each eye sees; of many views
        (view, primary, view, primary), as `Crosstalk` takes them.
    share
        (view, row, col) coarse map that multiplies it, means over cells of the screen; or None.
    weight
        How much this seat counts among several.
    sloping
        Whether the map goes on as it slopes beyond its outermost cells' middles, or is flat there,
        as one that a person wrote.
    uncertainty
        (change, view, primary, primary) of the matrices, one standard deviation each, the same at
        all seats; None if nobody says.
    map_uncertainty
        Likewise (change, view, row, col) of the map.
    """

    matrices: NDArray[np.float64]
    share: NDArray[np.float64] | None = None
    weight: float = 1.0
    sloping: bool = False
    uncertainty: NDArray[np.float64] | None = None
    map_uncertainty: NDArray[np.float64] | None = None

    def mean(self) -> float:
        """Mean share of other pictures' light, of grey pictures over the screen."""
        white = self.matrices.sum(axis=tuple(range(2, self.matrices.ndim))).mean(axis=1)
        factor = 1.0 if self.share is None else self.share.mean(axis=(1, 2))
        return float(np.mean(white * factor))


@final
@dataclass(frozen=True, eq=False)
class StereoScene(Scene):
    """A stereo system: what its projectors, screen, filters and audience are.

    Parameters
    ----------
    name, description
        What it is called and is.
    projector
        What an eye sees of its own projector.
    viewing
        Its audience.
    sources
        For each figure of the scene file where it is from.
    size
        (width, height) of the screen, m.
    ambient
        (view, primary) light of the unlit screen through the glasses, as the luminance of a white
        picture that has as much of this primary, cd/m².
    stray
        How much of that is not the projectors' black, cd/m².
    seats
        Crosstalk by the seats' names.
    chosen
        The seats that are looked from: one, or several at once.
    background
        (row, col, primary) light of what is seen through the display, in units of white; None if
        it has no place.
    table
        Levels and (view, own level, other level) grey-to-grey crosstalk, instead of the seats'.
    theatre
        The hardware, if that is described.
    way
        What lens, port glass and room do to light, if that is described.
    grade
        What belongs to the grade of masters.
    digest
        SHA-256 of what its crosstalk depends on.
    model
        How crosstalk is known, in one phrase.
    file
        What commands call it: its file's path, or the name of a bundled one; "" if it was made
        otherwise.
    content
        SHA-256 of what its file says, and of files that are named there; "" without a file.
    """

    name: str
    description: str
    projector: Projector
    viewing: Viewing
    sources: Mapping[str, str]
    size: tuple[float, float]
    ambient: NDArray[np.float64]
    stray: float
    seats: Mapping[str, Seat]
    chosen: tuple[str, ...]
    background: NDArray[np.float32] | None = None
    table: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    theatre: StereoTheatre | None = None
    way: LightsWay | None = None
    grade: Grade = SCREENS
    digest: str = ""
    model: str = ""
    file: str = field(default="", compare=False)
    content: str = field(default="", compare=False)

    @property
    def views(self) -> int:
        """Two: left, right; or as many as a display without glasses shows."""
        return len(self.seats[self.chosen[0]].matrices)

    @property
    def pollution(self) -> str:
        """See `Scene`."""
        if self.views > 2:
            return "the other views'"
        return "the other eye's" if self.way is None else "scattered, reflected, the other eye's"

    @property
    def masters(self) -> str:
        """See `Scene`."""
        return "left and right" if self.views == 2 else f"quilts of {self.views} views"

    @property
    def places(self) -> dict[str, NDArray[np.float64]]:
        """Seats that have a place, else the viewing distance: name -> (xyz), m from the screen."""
        if self.theatre is None:
            return {"viewing distance": np.array([0.0, -self.viewing.distance, 0.0])}
        return {name: np.asarray(place, float) for name, place in self.theatre.seats.items()}

    @property
    def lenses(self) -> list[tuple[float, ...]]:
        """Places of its projectors, if they are described: (xyz), m."""
        if self.theatre is not None:
            return [projector.position for projector in self.theatre.projectors]
        return [] if self.way is None else self.way.lenses

    def asked(self, transport: Path | None, seat: str | None) -> StereoScene:
        """See `Scene`."""
        scene = self
        if transport is not None:
            with about(transport):
                scene = scene.with_maps(load_maps(transport))
        if seat is None:
            return scene
        return scene.seen_from(*(scene.seats if seat == "all" else [seat]))

    @property
    def approximation(self) -> str | None:
        """See `Scene`."""
        return None if self.way is None else self.way.approximation

    @property
    def weights(self) -> NDArray[np.float64]:
        """(chosen seat,) how much each counts; they sum to 1."""
        weights = np.array([self.seats[name].weight for name in self.chosen])
        return np.asarray(weights / weights.sum())

    def seen_from(self, *names: str) -> StereoScene:
        """The same system, looked at from other seats.

        Raises
        ------
        InputError
            If there is no such seat, or several are named in a described room.
        """
        for name in names:
            if name not in self.seats:
                raise InputError(
                    f"{self.name} has no seat {name!r}; use one of {', '.join(self.seats)}"
                )
        if self.way is not None and len(names) > 1:
            raise InputError(
                f"{self.name}: its [lens] and [room] are known for one seat at a time; name one of "
                f"{', '.join(names)} (--seat)"
            )
        return replace(self, chosen=names)

    def with_maps(self, maps: CrosstalkMaps) -> StereoScene:
        """The same system with stored crosstalk maps.

        Raises
        ------
        InputError
            If they are of another system, or of this one before it was changed.
        """
        measured = maps.provenance.get("measured")
        if self.theatre is None and measured is None:
            raise InputError(
                f"{self.name} has no hardware to trace, its crosstalk is known as {self.model}: "
                f"leave --transport out"
            )
        known = maps.provenance.get("scene", "another system")
        if set(maps.seats) != set(self.seats) or maps.provenance.get("digest") != self.digest:
            way = "measure" if measured else f"run domesim tabulate {self.argument}"
            raise InputError(
                f"the stored crosstalk maps are of {known!r}, or of {self.name!r} before it was "
                f"changed; {way} again"
            )
        seats = dict(self.seats)
        for number, name in enumerate(maps.seats):
            seats[name] = replace(seats[name], share=maps.share[number], sloping=True)
            if maps.changes is not None and maps.matrix_changes is not None:
                seats[name] = replace(
                    seats[name],
                    uncertainty=maps.matrix_changes,
                    map_uncertainty=maps.changes[number],
                )
        model = f"measured: {measured}" if measured else "traced through the described hardware"
        return replace(self, seats=seats, model=model)

    def observation(self, rows: int, cols: int) -> AdjointObservation | GreyToGrey:
        """See `Scene`; of several seats, their views one after the other."""
        if self.table is not None:
            levels, entries = self.table
            by_primary = np.repeat(entries[:, None], 3, axis=1)
            return GreyToGrey(rows, cols, levels, by_primary, black=self._black)
        seats = self._crosstalks(rows, cols)
        if self.way is not None:
            return self.way.two_views(seats[0])
        return seats[0] if len(seats) == 1 else SeveralSeats(seats)

    @property
    def unlit(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See `Scene`."""
        ambient = np.reshape(self.ambient, (self.views, -1))
        return ambient - self.stray, np.full_like(ambient, self.stray)

    @property
    def crosstalk_alone(self) -> StereoScene:
        """The same system with neither lens nor room."""
        return replace(self, way=None)

    def _crosstalks(self, rows: int, cols: int) -> list[Crosstalk]:
        """What each chosen seat's eyes see."""
        return [
            Crosstalk(
                rows,
                cols,
                self.seats[name].matrices,
                share=self._share(name, rows, cols),
                black=self._dark(rows, cols),
            )
            for name in self.chosen
        ]

    def uncertain(self, rows: int, cols: int) -> UncertainPair | None:
        """See `Scene`; None also where lens and room are described, whose errors nobody knows."""
        seats = [self.seats[name] for name in self.chosen]
        if self.table is not None or self.way is not None or not self._measured:
            return None
        each = self._crosstalks(rows, cols)
        best = each[0] if len(each) == 1 else SeveralSeats(each)
        matrices = seats[0].uncertainty
        maps = []
        for seat in seats:
            share = np.ones((2, 1, 1)) if seat.share is None else seat.share
            changes = seat.map_uncertainty
            maps.append(
                UncertainMap(share, np.zeros((0, *share.shape)) if changes is None else changes)
            )
        return UncertainPair(
            best, each, np.zeros((0, 2, 3, 3)) if matrices is None else matrices, maps
        )

    def mean_seat(self, rows: int, cols: int) -> Crosstalk:
        """Mean crosstalk of the chosen seats: what methods for one seat subtract.

        Parameters
        ----------
        rows, cols
            Size of a view, pixels.

        Returns
        -------
        crosstalk
            Of one seat.

        Raises
        ------
        InputError
            If crosstalk is a table, which is the same at all seats.
        """
        if self.table is not None:
            raise InputError(f"{self.name}: a grey-to-grey table has no mean seat")
        chosen = [self.seats[name] for name in self.chosen]
        flat = np.ones((self.views, 1, 1))
        cells = [flat if seat.share is None else seat.share for seat in chosen]
        # Where matrices differ between seats, the maps are those of their whites.
        share = sum(
            weight * over_pixels(cell, rows, cols, sloping=seat.sloping)
            for weight, cell, seat in zip(self.weights, cells, chosen, strict=True)
        )
        matrices = sum(
            weight * seat.matrices for weight, seat in zip(self.weights, chosen, strict=True)
        )
        return Crosstalk(
            rows, cols, np.asarray(matrices), share=np.asarray(share), black=self._dark(rows, cols)
        )

    def screen(self, rows: int, cols: int) -> NDArray[np.bool_]:
        """See `Scene`: all of the picture."""
        return np.ones((rows, cols), np.bool_)

    def pixel_areas(self, rows: int, cols: int) -> NDArray[np.floating]:
        """See `Scene`."""
        return np.broadcast_to(self.size[0] * self.size[1] / (rows * cols), (rows, cols))

    def facts(self) -> dict[str, str]:
        """See `Scene`."""
        if self.table is None:
            means = {name: self.seats[name].mean() for name in self.chosen}
            shares = ", ".join(f"{name} {mean:.2%}" for name, mean in means.items())
            if self.views == 2 and max(means.values()) > _MUCH:
                shares += "; was it typed in percent? 0.5 is half of the light, 0.5 % is 0.005"
        else:
            shares = f"up to {np.abs(self.table[1]).max():.2%} of white, by grey levels"
        through = "through the glasses" if self.views == 2 else "of one view alone"
        return {
            "Stereo system": f"{self.name}, screen {self.size[0]:g} x {self.size[1]:g} m, seen "
            f"from {self.viewing.distance:g} m",
            "Crosstalk": f"{shares} ({self.model})",
            "Projector": f"white {self.projector.white:g} cd/m² {through}, black "
            f"{self.projector.black:g} cd/m², {self.projector.primaries} primaries",
            "Light without a picture": self.graded,
            **({} if self.way is None else self.way.facts(self.projector.luminance_weights)),
            **({} if self.way is None or not self._measured else {"Uncertainty": _UNKNOWN}),
        }

    @property
    def _measured(self) -> bool:
        """Whether crosstalk at a chosen seat has an uncertainty."""
        return any(
            seat.uncertainty is not None or seat.map_uncertainty is not None
            for seat in (self.seats[name] for name in self.chosen)
        )

    @property
    def _black(self) -> NDArray[np.float64]:
        """(view, primary) in units of white."""
        return np.reshape(self.ambient, (self.views, -1)) / self.projector.white

    def _dark(self, rows: int, cols: int) -> NDArray[np.float64]:
        """Light without any picture: (view, primary), or with a place."""
        if self.background is None:
            return self._black
        step = max(1, min(self.background.shape[0] // rows, self.background.shape[1] // cols))
        means = np.moveaxis(light_means(self.background[None], step)[0], -1, 0)
        behind = np.moveaxis(over_pixels(means, rows, cols, sloping=False), 0, -1)
        return np.asarray(self._black[:, None, None, :] + behind)

    def _share(self, name: str, rows: int, cols: int) -> NDArray[np.float64] | None:
        seat = self.seats[name]
        if seat.share is None:
            return None
        share = over_pixels(seat.share, rows, cols, sloping=seat.sloping)
        return np.asarray(np.maximum(share, 0))


def built(file: StereoFile, folder: Path) -> StereoScene:
    """Builds the stereo system that a scene file describes.

    Parameters
    ----------
    file
        Its content.
    folder
        Where the files lie that it names.

    Returns
    -------
    system
        With all seats that it names.

    Raises
    ------
    InputError
        If crosstalk is impossible; or it names readings, and these cannot be read or do not fit.
    """
    scene = _before(_described(file, folder), file, folder)
    _require_possible(scene)
    polarised = file.crosstalk.polarisation is not None
    return replace(scene, way=way_of(file, polarised=polarised))


def _described(file: StereoFile, folder: Path) -> StereoScene:
    if isinstance(file.projector, MeasuredProjectorSection):
        system = measured_system(file.crosstalk, file.projector, folder)
        digest = hashlib.sha256(f"{file.digest} {system.digest}".encode()).hexdigest()
        seats = _seats(file, system.matrices, system.uncertainty)
        return _scene(file, system.projector, system.black, seats, digest)
    lit = file.projector
    projector = Projector(
        lit.primaries, lit.white_cd_m2, lit.black_cd_m2, response=response_of(lit)
    )
    many = file.crosstalk.views
    black = np.full((2 if many is None else many.count, 3), lit.black_cd_m2)
    if file.crosstalk.polarisation is None:
        seats = _seats(file, _figures(file.crosstalk), _errors(file.crosstalk))
        return _scene(file, projector, black, seats, file.digest)
    theatre = _theatre(file, file.crosstalk.polarisation)
    seats = _estimated(file, theatre, projector.luminance_weights)
    scene = _scene(file, projector, black, seats, file.digest)
    return replace(scene, theatre=theatre)


def _before(scene: StereoScene, file: StereoFile, folder: Path) -> StereoScene:
    """The same display before the background that its file names."""
    if file.ambient.photograph is None:
        return scene
    luminance, projector = file.ambient.luminance_cd_m2, scene.projector
    if not luminance:
        raise InputError(
            "ambient.luminance_cd_m2: a photograph's white is 0; say how bright it is, in cd/m²"
        )
    photograph = read_frame(folder / file.ambient.photograph)
    curve = transfer.named(photograph.colour.transfer, white=luminance)
    light = projector.decode(photograph.pixels[None], curve, photograph.colour.primaries)
    step = -(-max(light.shape[1:3]) // _LARGEST)
    behind = np.maximum(light_means(light, step)[0], 0) * (luminance / projector.white)
    seen = hashlib.sha256(scene.digest.encode() + behind.astype(np.float32).tobytes())
    return replace(scene, background=behind.astype(np.float32), digest=seen.hexdigest())


def _require_possible(scene: StereoScene) -> None:
    """Before frames are read: crosstalk that no observation takes."""
    for name, seat in scene.seats.items():
        rows, cols = (1, 1) if seat.share is None else seat.share.shape[1:]
        try:
            scene.seen_from(name).observation(rows, cols)
        except InputError as error:
            where = "" if len(scene.seats) == 1 else f"seat {name!r}: "
            raise InputError(f"{where}{error}") from error


def _scene(
    file: StereoFile,
    projector: Projector,
    black: NDArray[np.float64],
    seats: Mapping[str, Seat],
    digest: str,
) -> StereoScene:
    screen = file.screen
    table = file.crosstalk.table
    stray = 0.0 if file.ambient.photograph else file.ambient.luminance_cd_m2
    models = {
        "figures": "figures of the scene file",
        "table": "grey-to-grey table of the scene file",
        "polarisation": "estimated from the described hardware; domesim tabulate traces it",
        "views": f"{len(black)} views, shares of the scene file",
        "readings": f"measured: {file.crosstalk.readings}",
    }
    return StereoScene(
        name=file.name,
        description=file.description,
        projector=projector,
        viewing=viewing.of_flat_screen(
            screen.width_m, screen.height_m, file.viewing.distance_m, file.viewing.adaptation_cd_m2
        ),
        sources=file.sources,
        size=(screen.width_m, screen.height_m),
        ambient=black + stray,
        stray=stray,
        grade=file.grade.over(SCREENS),
        seats=seats,
        chosen=(next(iter(seats)),),
        table=None
        if table is None
        else (np.array(table.levels), np.array([table.to_left, table.to_right])),
        digest=digest,
        model=models[file.crosstalk.told],
    )


def _estimated(
    file: StereoFile, theatre: StereoTheatre, weights: NDArray[np.float64]
) -> dict[str, Seat]:
    """Crosstalk by seat: a map of luminance, and how much more each primary has in the mean."""
    seats = {}
    for seat in file.seats:
        each = np.stack(
            [crosstalk_estimate(one, seat.name, *MAP_CELLS) for one in theatre.by_primary()]
        )
        if len(each) == 1:
            seats[seat.name] = Seat(leak_matrices(1.0), each[0], seat.weight)
            continue
        share = np.tensordot(weights, each, axes=1)
        matrices = np.zeros((2, 3, 3))
        for view, primary in np.ndindex(2, 3):
            matrices[view, primary, primary] = each[primary, view].mean() / share[view].mean()
        seats[seat.name] = Seat(matrices, share, seat.weight)
    return seats


def _figures(section: CrosstalkSection) -> NDArray[np.float64]:
    """Crosstalk as the file's figures tell it, as `Crosstalk` takes it; 0 for a table."""
    if section.views is not None:
        return section.views.leaks()
    if section.share is not None:
        return leaks_to_both(section.share, section.share)
    if section.to_left is not None and section.to_right is not None:
        return leaks_to_both(section.to_left, section.to_right)
    return leak_matrices(0.0)


def _errors(section: CrosstalkSection) -> NDArray[np.float64] | None:
    """(change, view, primary, primary) of what the file says of its figures' errors."""
    changes = []
    for view, errors in enumerate((section.to_left_error, section.to_right_error)):
        if errors is None:
            continue
        # One number for all primaries is one error, numbers are independent ones.
        for entries in np.ndindex(np.shape(errors)):
            single = np.zeros(np.shape(errors))
            single[entries] = np.asarray(errors)[entries]
            change = np.zeros((2, 3, 3))
            change[view] = leak_matrices(single)[0]
            changes.append(change)
    return np.stack(changes) if changes else None


def _seats(
    file: StereoFile, matrices: NDArray[np.float64], uncertainty: NDArray[np.float64] | None
) -> dict[str, Seat]:
    if not file.seats:
        return {SWEET_SPOT: Seat(matrices, uncertainty=uncertainty)}
    return {
        seat.name: Seat(matrices, grids(seat, len(matrices)), seat.weight, uncertainty=uncertainty)
        for seat in file.seats
    }


def _theatre(file: StereoFile, hardware: PolarisationSection) -> StereoTheatre:
    left, right = hardware.lenses_m
    lens, glass = hardware.projector_retardance_error_deg, hardware.glasses_retardance_error_deg
    positions = {seat.name: seat.position_m for seat in file.seats if seat.position_m is not None}
    return StereoTheatre(
        SilverScreen(
            file.screen.width_m,
            file.screen.height_m,
            hardware.depolarising_share,
            hardware.roughness,
            hardware.albedo,
        ),
        (
            PolarisedProjector(left, CircularFilter("left", hardware.projector_leak, lens[0])),
            PolarisedProjector(right, CircularFilter("right", hardware.projector_leak, lens[1])),
        ),
        # The screen turns the hand of what it reflects.
        (
            CircularFilter("right", hardware.glasses_leak, glass[0], hardware.glasses_axis_deg),
            CircularFilter("left", hardware.glasses_leak, glass[1], hardware.glasses_axis_deg),
        ),
        positions,
        hardware.wavelengths_nm,
        hardware.design_nm,
    )
