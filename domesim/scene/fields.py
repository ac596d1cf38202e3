"""What keys of a scene file may hold: numbers with their ranges, places, sections.

Every key carries its unit; unknown keys are mistakes.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

# Strict: neither true nor "0.5" is a number.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Share = Annotated[Number, Field(ge=0, le=1)]
# Beyond these, figures are in another unit, or arithmetic overflows.
Luminance = Annotated[Number, Field(ge=1e-6, le=1e6)]
NoLuminance = Annotated[Number, Field(ge=0, le=1e6)]

TAGS = ("one number", "a number a primary", "a matrix", "named primaries", "measured primaries")
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


class Section(BaseModel):
    """A section of a scene file: every key is known."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


Length = Annotated[Number, Field(gt=0, le=1000)]
Coordinate = Annotated[Number, Field(ge=-1000, le=1000)]
Place = tuple[Coordinate, Coordinate, Coordinate]
"""(x, y, z) in the room's frame: x right, y front, z up from the centre of the dome's sphere."""


class AmbientSection(Section):
    """Light on the screen without any projector, by luminance."""

    luminance_cd_m2: NoLuminance = 0.0


class ViewingSection(Section):
    """The audience."""

    adaptation_cd_m2: Luminance


def three(value: ArrayLike) -> tuple[float, float, float]:
    """One number for all, or three."""
    x, y, z = np.broadcast_to(np.asarray(value, np.float64), 3)
    return float(x), float(y), float(z)
