"""Sections of a flat cinema's file: its screen, what scatters on light's way, and its room."""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, StrictBool, model_validator

from domesim.errors import InputError
from domesim.frames.colour import chromaticities_of
from domesim.observation.glare import Scatter
from domesim.observation.projector import NAMES
from domesim.room.flat_room import FlatRoom
from domesim.scene.fields import (
    AmbientSection,
    GradeSection,
    Length,
    Luminance,
    NoLuminance,
    Number,
    PerPrimary,
    Response,
    Section,
    ViewingSection,
    three,
)


class FlatScreenSection(Section):
    """A flat screen.

    ``gain`` and ``half_gain_deg`` count with a [room] only: luminance along the normal over a
    perfect diffuser's, and the angle at which it is half. A matt screen has no such angle; its gain
    is its albedo.
    """

    width_m: Length
    height_m: Length
    gain: Annotated[Number, Field(gt=0, le=10)] | None = None
    half_gain_deg: Annotated[Number, Field(ge=5, le=80)] | None = None


class FlatViewingSection(ViewingSection):
    """The audience before a flat screen."""

    distance_m: Length


class ScatterSection(Section):
    """Light that a surface scatters: ABg, with the shoulder B^(1/g) as an angle."""

    scattered: Annotated[Number, Field(ge=0, le=0.2)]
    slope: Annotated[Number, Field(ge=0.5, le=4)] = 2.0
    shoulder_deg: Annotated[Number, Field(ge=0.1, le=45)] = 0.5

    @property
    def scatter(self) -> Scatter:
        """What it describes."""
        return Scatter(self.scattered, self.slope, float(np.sin(np.radians(self.shoulder_deg))))


class FlatLensSection(ScatterSection):
    """The projector's lens, and how far it is from the screen."""

    throw_m: Length


class RoomSection(Section):
    """The auditorium as a box, by its albedos; the screen is in the middle of its front.

    ``audience`` covers the floor from ``audience_from_m`` on, with seats and people. A
    ``polarised`` 3D system's filters pass half of what the room reflects to either eye; others keep
    the views apart. [crosstalk.polarisation] says that by itself.
    """

    width_m: Length
    height_m: Length
    length_m: Length
    screen_bottom_m: Annotated[Number, Field(ge=0, le=100)]
    floor: PerPrimary
    ceiling: PerPrimary
    walls: PerPrimary
    back: PerPrimary
    front: PerPrimary
    audience: PerPrimary
    audience_from_m: Length
    polarised: StrictBool | None = None

    def box(self, screen: FlatScreenSection) -> FlatRoom:
        """The room that this describes, with that screen."""
        angle = screen.half_gain_deg
        return FlatRoom(
            (screen.width_m, screen.height_m),
            1.0 if screen.gain is None else screen.gain,
            None if angle is None else float(np.radians(angle)),
            (self.width_m, self.height_m, self.length_m),
            self.screen_bottom_m,
            three(self.floor),
            three(self.ceiling),
            three(self.walls),
            three(self.back),
            three(self.front),
            three(self.audience),
            self.audience_from_m,
        )


class OnItsWay(Section):
    """What a flat cinema's file says of light's way."""

    screen: FlatScreenSection
    lens: FlatLensSection | None = None
    port_glass: ScatterSection | None = None
    room: RoomSection | None = None

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.port_glass is not None and self.lens is None:
            raise ValueError("port_glass: needs a [lens], whose throw_m says how far it is")
        for name in ("gain", "half_gain_deg"):
            if getattr(self.screen, name) is not None and self.room is None:
                raise ValueError(f"screen.{name}: counts with a [room] only; leave it out")
        if self.room is not None:
            try:
                self.room.box(self.screen)
            except InputError as error:
                raise ValueError(f"room: {error}") from None
        return self


class FlatProjectorSection(Section):
    """The projector, on the screen.

    White is all light that is sent, what lens and port glass scatter with it, without the room's.
    Black is a full black frame, as it is seen. Primaries, and the response to levels, are named as
    those of domes.
    """

    also: ClassVar[str] = ""
    """What else `primaries` may be, for whoever names none that are known."""

    primaries: str = "P3-D65"
    white_cd_m2: Luminance
    black_cd_m2: NoLuminance = 0.0
    response: Response | None = None

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.primaries == "XYZ" or chromaticities_of(self.primaries) is None:
            raise ValueError(f"primaries {self.primaries!r} are not known; use {NAMES}{self.also}")
        return self


class CinemaFile(OnItsWay):
    """A whole scene file of a 2-D cinema; ``sources`` says for each figure where it is from."""

    name: str
    description: str = ""
    projector: FlatProjectorSection
    ambient: AmbientSection = AmbientSection()
    grade: GradeSection = GradeSection()
    viewing: FlatViewingSection
    sources: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _of_one_view(self) -> Self:
        if self.room is not None and self.room.polarised is not None:
            raise ValueError("room.polarised: only 3D systems have it; leave it out")
        return self
