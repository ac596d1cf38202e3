"""What keys of a scene file may hold: numbers with their ranges, places, sections.

Every key carries its unit; unknown keys are mistakes.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag

from domesim.errors import InputError
from domesim.frames.colour import ProjectorResponse
from domesim.light.transfer import Table
from domesim.scene.grade import Grade

# Strict: neither true nor "0.5" is a number.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Share = Annotated[Number, Field(ge=0, le=1)]
# Beyond these, figures are in another unit, or arithmetic overflows.
Luminance = Annotated[Number, Field(ge=1e-6, le=1e6)]
NoLuminance = Annotated[Number, Field(ge=0, le=1e6)]

TAGS = (
    "one number",
    "a number a primary",
    "a matrix",
    "named primaries",
    "measured primaries",
    "a file",
    "three files",
    "an array",
    "a name",
    "a table",
)
"""Alternatives of what a key may hold; they are no keys themselves."""
_EITHER = Discriminator(lambda value: TAGS[isinstance(value, list)])
PerPrimary = Annotated[
    Annotated[Share, Tag(TAGS[0])] | Annotated[tuple[Share, Share, Share], Tag(TAGS[1])],
    _EITHER,
]
"""One number for all primaries, or one for each."""
LuminancePerPrimary = Annotated[
    Annotated[NoLuminance, Tag(TAGS[0])]
    | Annotated[tuple[NoLuminance, NoLuminance, NoLuminance], Tag(TAGS[1])],
    _EITHER,
]

Leak = Annotated[Number, Field(ge=-0.9, le=0.9)]
Row = tuple[Leak, Leak, Leak]


def leak_form(value: object) -> str:
    """Which form a leak has: a number, a number a primary, or a matrix."""
    if not isinstance(value, list):
        return TAGS[0]
    return TAGS[2] if value and isinstance(value[0], list) else TAGS[1]


LeakOfAView: TypeAlias = Annotated[
    Annotated[Leak, Tag(TAGS[0])]
    | Annotated[Row, Tag(TAGS[1])]
    | Annotated[tuple[Row, Row, Row], Tag(TAGS[2])],
    Discriminator(leak_form),
]
"""One number for all primaries, one for each, or three rows: what R, G, B of the eye see."""


def _curve(response: str | float | tuple[tuple[float, float], ...]) -> str:
    """Name of a transfer function."""
    if isinstance(response, tuple):
        try:
            return Table(response).name
        except InputError as error:
            raise ValueError(str(error)) from None
    if response in ("bt1886", "srgb"):
        return response
    with suppress(ValueError):
        if 1 <= float(response) <= 4:
            return f"gamma{float(response):g}"
    raise ValueError(
        f'is not known: wanted "bt1886", "srgb", an exponent from 1 to 4 such as "2.2", or a table '
        f"[[0, 0], [0.5, 0.2], [1, 1]] of codes and light, got {response!r}"
    )


def _response_form(value: object) -> str:
    """Which form a response has."""
    return TAGS[0 if isinstance(value, float | int) else 9 if isinstance(value, list) else 8]


Response: TypeAlias = Annotated[
    Annotated[
        Annotated[Number, Tag(TAGS[0])]
        | Annotated[str, Tag(TAGS[8])]
        | Annotated[tuple[tuple[Share, Share], ...], Tag(TAGS[9])],
        Discriminator(_response_form),
    ],
    AfterValidator(_curve),
]
"""How a projector answers to levels: a name, an exponent, or pairs of code and light; it becomes
the name of a transfer function."""


def response_of(section: Any) -> ProjectorResponse | None:
    """The response that a section of a projector states."""
    return None if section.response is None else ProjectorResponse(section.response)


class Section(BaseModel):
    """A section of a scene file: every key is known."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False, defer_build=True)


Length = Annotated[Number, Field(gt=0, le=1000)]
Coordinate = Annotated[Number, Field(ge=-1000, le=1000)]
Place = tuple[Coordinate, Coordinate, Coordinate]
"""(x, y, z) in the room's frame: x right, y front, z up from the centre of the dome's sphere."""


class AmbientSection(Section):
    """Light on the screen without any projector, by luminance."""

    luminance_cd_m2: NoLuminance = 0.0


class GradeSection(Section):
    """What is part of the grade: of light without a picture, and of colours beyond the projector.

    ``black`` is the projector's, ``ambient`` that of [ambient]: ``kept`` as part of what masters
    were graded on, or ``taken-out`` as pollution. ``gamut`` is of colours and highlights that the
    projector cannot show: ``kept`` in what is written, or ``clipped``. By default all three are
    kept on flat screens, and none in domes. The command line may choose otherwise.
    """

    black: Literal["kept", "taken-out"] | None = None
    ambient: Literal["kept", "taken-out"] | None = None
    gamut: Literal["kept", "clipped"] | None = None

    def over(self, usual: Grade) -> Grade:
        """Returns the scene's choice, where it says nothing the usual one."""
        return usual.but(self.black, self.ambient, self.gamut)


class ViewingSection(Section):
    """The audience."""

    adaptation_cd_m2: Luminance


def three(value: ArrayLike) -> tuple[float, float, float]:
    """One number for all, or three."""
    x, y, z = np.broadcast_to(np.asarray(value, np.float64), 3)
    return float(x), float(y), float(z)
