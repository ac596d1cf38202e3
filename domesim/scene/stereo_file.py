"""The file of a stereo system, as it is written.

Crosstalk is told in one of five ways: as figures (``share``, or ``to_left`` and ``to_right``), as a
grey-to-grey ``table``, as the hardware that causes it (``polarisation``), as ``readings`` of a
colorimeter, or between the many ``views`` of a display without glasses. ``to_left`` is what the
left eye sees of the right eye's picture.

Readings tell the projector, too: its ``primaries`` are "measured" (the common gamut of both), and
white and black are left out, or are those of the readings.
"""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, StrictBool, Tag, model_validator

from domesim.observation.crosstalk import leaks_of_views
from domesim.observation.projector import MEASURED
from domesim.scene.fields import (
    TAGS,
    AmbientSection,
    Coordinate,
    GradeSection,
    Leak,
    LeakOfAView,
    Luminance,
    NoLuminance,
    Number,
    PerPrimary,
    Response,
    Section,
    Share,
    leak_form,
    three,
)
from domesim.scene.flat_file import FlatProjectorSection, FlatViewingSection, OnItsWay

_NUMBER, _ROW, _MATRIX, _NAMED, _MEASURED = TAGS[:5]

NoLeak = Annotated[Number, Field(ge=0, le=0.9)]
_Errors = tuple[NoLeak, NoLeak, NoLeak]
ErrorOfAView: TypeAlias = Annotated[
    Annotated[NoLeak, Tag(_NUMBER)]
    | Annotated[_Errors, Tag(_ROW)]
    | Annotated[tuple[_Errors, _Errors, _Errors], Tag(_MATRIX)],
    Discriminator(leak_form),
]
"""Standard errors of a `LeakOfAView`: one that all primaries share, or independent ones."""

Grid = tuple[tuple[Annotated[Number, Field(ge=0, le=100)], ...], ...]
"""Rows of numbers over the screen, the first row at the top; all rows are as long."""


class StereoProjectorSection(FlatProjectorSection):
    """What an eye sees of its own projector, through its filter."""

    also: ClassVar[str] = f", or {MEASURED} with [crosstalk] readings"


class MeasuredProjectorSection(Section):
    """Figures of readings; where the file states them, too, they must agree."""

    primaries: Literal["measured"] = "measured"
    white_cd_m2: Luminance | None = None
    black_cd_m2: NoLuminance | None = None
    response: Response | None = None


def _of_primaries(value: Any) -> str:
    named = not isinstance(value, dict) or value.get("primaries") != MEASURED
    return _NAMED if named else _MEASURED


ProjectorSection: TypeAlias = Annotated[
    Annotated[StereoProjectorSection, Tag(_NAMED)]
    | Annotated[MeasuredProjectorSection, Tag(_MEASURED)],
    Discriminator(_of_primaries),
]


class SeatSection(Section):
    """A place in the audience; how much crosstalk is there, over that of the figures."""

    name: Annotated[str, Field(min_length=1)]
    weight: Annotated[Number, Field(gt=0, le=1e6)] = 1.0
    position_m: tuple[Coordinate, Coordinate, Coordinate] | None = None
    factor: Annotated[Number, Field(ge=0, le=100)] = 1.0
    map: Grid | None = None
    map_left: Grid | None = None
    map_right: Grid | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.map_left is None) != (self.map_right is None):
            raise ValueError("needs both map_left and map_right, or map for both eyes")
        if self.map is not None and self.map_left is not None:
            raise ValueError("has a map for both eyes and one for each: give one of the two")
        grids = [grid for grid in (self.map, self.map_left, self.map_right) if grid is not None]
        for grid in grids:
            if not grid or len({len(row) for row in grid} | {len(grids[0][0])}) != 1 or not grid[0]:
                raise ValueError("map must be rows of numbers, all as long")
        if len({len(grid) for grid in grids}) > 1:
            raise ValueError("map_left and map_right must have as many rows")
        return self


class TableSection(Section):
    """Grey-to-grey crosstalk: light that is added, by own level (rows) and other level (columns).

    Levels are light, 0..1 of white.
    """

    levels: tuple[Share, ...]
    to_left: tuple[tuple[Leak, ...], ...]
    to_right: tuple[tuple[Leak, ...], ...]

    @model_validator(mode="after")
    def _square(self) -> Self:
        count = len(self.levels)
        for name in ("to_left", "to_right"):
            table = getattr(self, name)
            if len(table) != count or any(len(row) != count for row in table):
                raise ValueError(f"{name}: must be {count} rows of {count} numbers")
        return self


Error = Annotated[Number, Field(gt=-45, lt=45)]
Wavelength = Annotated[Number, Field(ge=380, le=780)]


class PolarisationSection(Section):
    """Two projectors behind circular filters, a silver screen, and glasses.

    What comes in pairs is of the left eye, then of the right one. Retardance errors are what
    quarter-wave retarders have too much at ``design_nm``; with ``wavelengths_nm`` of the primaries
    they have it in proportion to the inverse wavelength, and crosstalk depends on the colour.
    ``glasses_axis_deg`` is the angle of the glasses' linear polarisers to those of the lenses: at 0
    errors of one sign add up, at 90 they cancel.
    """

    lenses_m: tuple[
        tuple[Coordinate, Coordinate, Coordinate], tuple[Coordinate, Coordinate, Coordinate]
    ]
    depolarising_share: Share
    roughness: Annotated[Number, Field(ge=0.05, le=1)]
    albedo: Annotated[Number, Field(gt=0, le=1)] = 1.0
    projector_leak: Annotated[Number, Field(ge=0, lt=1)] = 0.0
    glasses_leak: Annotated[Number, Field(ge=0, lt=1)] = 0.0
    projector_retardance_error_deg: tuple[Error, Error] = (0.0, 0.0)
    glasses_retardance_error_deg: tuple[Error, Error] = (0.0, 0.0)
    glasses_axis_deg: Annotated[Number, Field(ge=-180, le=180)] = 0.0
    wavelengths_nm: tuple[Wavelength, Wavelength, Wavelength] | None = None
    design_nm: Wavelength = 550.0


class ViewsSection(Section):
    """Many views: shares of a view's light that are seen in others, over own light there.

    ``neighbours`` are those in the next view, in the one after it, and so on, to both sides. With
    ``repeats`` the first view follows the last, as behind lenses and barriers. A ``matrix`` has a
    row for each seeing view, and a column for each view that is seen in it; what it has of a view
    in itself is not read.
    """

    count: Annotated[int, Field(strict=True, ge=2, le=1000)]
    neighbours: tuple[PerPrimary, ...] | None = None
    repeats: StrictBool = False
    matrix: tuple[tuple[PerPrimary, ...], ...] | None = None

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.neighbours is None) == (self.matrix is None):
            raise ValueError("needs neighbours, or a matrix")
        if self.matrix is not None:
            if any(len(line) != self.count for line in (self.matrix, *self.matrix)):
                raise ValueError(f"matrix: must be {self.count} rows of {self.count} shares")
            if self.repeats:
                raise ValueError("repeats is of neighbours: a matrix has all shares")
        most = self.count // 2 if self.repeats else self.count - 1
        if self.neighbours is not None and len(self.neighbours) > most:
            raise ValueError(
                f"neighbours: {self.count} views have {most} to a side at most, got "
                f"{len(self.neighbours)}"
            )
        return self

    def leaks(self) -> NDArray[np.float64]:
        """(view, primary, view, primary), seen by sent."""
        if self.matrix is not None:
            rows = [[three(share) for share in line] for line in self.matrix]
            return leaks_of_views(np.moveaxis(np.array(rows), -1, 0))
        apart = np.abs(np.subtract.outer(range(self.count), range(self.count)))
        if self.repeats:
            apart = np.minimum(apart, self.count - apart)
        shares = np.zeros((3, self.count, self.count))
        for distance, share in enumerate(self.neighbours or (), 1):
            shares[:, apart == distance] = np.reshape(three(share), (3, 1))
        return leaks_of_views(shares)


class BackgroundSection(AmbientSection):
    """Light without any picture, by luminance.

    A ``photograph`` of what is seen through a display that adds light gives it a place; its white
    is ``luminance_cd_m2``. It is as wide and as high as the display, beside the scene's file.
    """

    photograph: Annotated[str, Field(min_length=1)] | None = None


class CrosstalkSection(Section):
    """Crosstalk, in one of five ways.

    ``to_left_error`` and ``to_right_error`` are standard errors of ``to_left`` and ``to_right``.
    ``readings`` is a path from the scene file's folder; ``black`` and ``allow_negative`` say how to
    take them (see `domesim.readings.meter.read_readings` and
    `domesim.readings.crosstalk.measured_crosstalk`).
    """

    share: LeakOfAView | None = None
    to_left: LeakOfAView | None = None
    to_right: LeakOfAView | None = None
    to_left_error: ErrorOfAView | None = None
    to_right_error: ErrorOfAView | None = None
    table: TableSection | None = None
    polarisation: PolarisationSection | None = None
    views: ViewsSection | None = None
    readings: Annotated[str, Field(min_length=1)] | None = None
    black: Literal["included", "subtracted"] | None = None
    allow_negative: bool | None = None

    @property
    def told(self) -> Literal["figures", "table", "polarisation", "views", "readings"]:
        """The way in which crosstalk is described."""
        if self.views is not None:
            return "views"
        if self.table is not None:
            return "table"
        if self.polarisation is not None:
            return "polarisation"
        return "figures" if self.readings is None else "readings"

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        one_direction = self.to_left is not None or self.to_right is not None
        ways = {
            "share": self.share is not None,
            "to_left and to_right": one_direction,
            "table": self.table is not None,
            "polarisation": self.polarisation is not None,
            "views": self.views is not None,
            "readings": self.readings is not None,
        }
        named = [name for name, used in ways.items() if used]
        if len(named) != 1:
            raise ValueError(
                f"must be told in one way ({', '.join(ways)}), got {' and '.join(named) or 'none'}"
            )
        if one_direction and (self.to_left is None or self.to_right is None):
            raise ValueError("needs both to_left and to_right (or share, for both)")
        for name in ("to_left_error", "to_right_error"):
            if getattr(self, name) is not None and not one_direction:
                raise ValueError(f"{name} is of {name.removesuffix('_error')}, got none")
        for name in ("black", "allow_negative"):
            if getattr(self, name) is not None and self.readings is None:
                raise ValueError(f"{name} says how to take readings, got none: leave it out")
        return self


class StereoFile(OnItsWay):
    """A whole scene file; ``sources`` says for each figure where it is from."""

    name: str
    description: str = ""
    projector: ProjectorSection
    ambient: BackgroundSection = BackgroundSection()
    grade: GradeSection = GradeSection()
    crosstalk: CrosstalkSection
    seats: tuple[SeatSection, ...] = ()
    viewing: FlatViewingSection
    sources: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _told_by_readings(cls, content: Any) -> Any:
        """With readings, the projector may be left out, and what is left out of it is measured."""
        crosstalk, lit = content.get("crosstalk"), content.get("projector", {})
        if not isinstance(crosstalk, dict) or "readings" not in crosstalk:
            return content
        if not isinstance(lit, dict):
            return content
        if lit.get("primaries", MEASURED) != MEASURED:
            raise ValueError(
                f"projector.primaries: [crosstalk] readings tell them: leave primaries out, got "
                f"{lit['primaries']!r}"
            )
        return {**content, "projector": {**lit, "primaries": MEASURED}}

    @model_validator(mode="after")
    def _measured_by_something(self) -> Self:
        if self.projector.primaries == MEASURED and self.crosstalk.told != "readings":
            raise ValueError(
                "projector.primaries: measured ones need [crosstalk] readings, got none; name the "
                "primaries, such as P3-D65"
            )
        return self

    @model_validator(mode="after")
    def _way_fits(self) -> Self:
        if self.crosstalk.table is not None and (self.lens is not None or self.room is not None):
            raise ValueError(
                "crosstalk.table: knows light as it is seen, with all that happens to it; leave "
                "[lens] and [room] out"
            )
        return self

    @model_validator(mode="after")
    def _background_fits(self) -> Self:
        if self.ambient.photograph is None:
            return self
        if self.lens is not None or self.room is not None or self.crosstalk.table is not None:
            raise ValueError(
                "ambient.photograph: goes with neither [lens], [room] nor [crosstalk.table]: leave "
                "them out"
            )
        return self

    @model_validator(mode="after")
    def _views_fit(self) -> Self:
        if self.crosstalk.views is None:
            return self
        if self.lens is not None or self.room is not None:
            raise ValueError("crosstalk.views: have neither [lens] nor [room]: leave them out")
        for number, seat in enumerate(self.seats):
            if seat.map_left is not None:
                raise ValueError(f"seats[{number}]: many views have one map, not map_left")
        return self

    @model_validator(mode="after")
    def _room_fits_filters(self) -> Self:
        if self.room is None or self.crosstalk.polarisation is None:
            return self
        if self.room.polarised is False:
            raise ValueError(
                "room.polarised: [crosstalk.polarisation] says that it is; leave it out"
            )
        if self.screen.gain is None:
            raise ValueError(
                "screen.gain: is missing; a silver screen has one, and sends its [room] less light"
            )
        return self

    @model_validator(mode="after")
    def _seats_fit(self) -> Self:
        names = [seat.name for seat in self.seats]
        if "all" in names:
            raise ValueError("seats: a seat cannot be called 'all': that means several of them")
        if len(set(names)) < len(names):
            raise ValueError(f"seats: names must differ, got {names}")
        placed = self.crosstalk.told == "polarisation"
        if placed and not self.seats:
            raise ValueError("seats: polarisation depends on the seat: name at least one")
        for number, seat in enumerate(self.seats):
            if placed and seat.position_m is None:
                raise ValueError(f"seats[{number}].position_m: is missing")
            mapped = seat.map is not None or seat.map_left is not None or seat.factor != 1
            if placed and mapped:
                raise ValueError(
                    f"seats[{number}]: polarisation gives the map: leave map and factor out"
                )
            if self.crosstalk.told == "table" and mapped:
                raise ValueError(f"seats[{number}]: a table is the same for all of the screen")
        return self

    @property
    def digest(self) -> str:
        """SHA-256 of all that crosstalk depends on, but the readings themselves."""
        parts = {"screen", "crosstalk", "seats"}
        content = self.model_dump(mode="json", include=parts, warnings=False)
        for name in ("gain", "half_gain_deg"):
            content["screen"].pop(name)
        for seat in content["seats"]:
            seat.pop("weight")
        for view in ("left", "right"):
            content["crosstalk"].pop(f"to_{view}_error")
        if self.crosstalk.views is None:  # transports of pairs are older than many views
            content["crosstalk"].pop("views")
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def grids(seat: SeatSection, views: int = 2) -> np.ndarray | None:
    """(view, row, col) coarse map of a seat, or None if it is flat and 1."""
    if seat.map is not None:
        shares = np.stack([np.array(seat.map)] * views)
    elif seat.map_left is not None and seat.map_right is not None:
        shares = np.stack([np.array(seat.map_left), np.array(seat.map_right)])
    elif seat.factor != 1:
        shares = np.ones((views, 1, 1))
    else:
        return None
    return np.asarray(shares * seat.factor, np.float64)
