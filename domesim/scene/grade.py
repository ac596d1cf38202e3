"""What a scene leaves as it was graded: light without a picture, and colours beyond its projector.

A projector's black and light in the room are seen without any picture. Masters of cinemas and 3D
screens are graded on such a screen: what is graded there is the master *and* its black. To take
that black out would make shadows darker than they were graded. Masters of domes are graded on
monitors: there all of the dome's own light is pollution.

A master of cinemas and 3D screens goes to many of them. Colours that one of their projectors cannot
show are kept, for those that can. A dome's master is made for the dome.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.host.numbers import decimal

KEPT, TAKEN_OUT, CLIPPED = "kept", "taken-out", "clipped"
CHOICES = {"black": (KEPT, TAKEN_OUT), "ambient": (KEPT, TAKEN_OUT), "gamut": (KEPT, CLIPPED)}
"""What there is to choose from: kept as part of the grade, taken out as pollution, or clipped to
what the projector shows."""

Floats: TypeAlias = NDArray[np.floating[Any]]


@final
@dataclass(frozen=True)
class Grade:
    """What is part of the grade.

    Parameters
    ----------
    black
        The projector's black: kept, or taken-out.
    ambient
        Other light in the room, [ambient] of a scene file: kept, or taken-out.
    gamut
        Colours and highlights that the projector cannot show: kept, or clipped to what it shows.

    Raises
    ------
    InputError
        If there is no such choice.
    """

    black: str = KEPT
    ambient: str = KEPT
    gamut: str = KEPT

    def __post_init__(self) -> None:
        for name, choice in vars(self).items():
            if choice not in CHOICES[name]:
                raise InputError(f"{name} is {' or '.join(CHOICES[name])}, got {choice!r}")

    def but(self, black: str | None, ambient: str | None, gamut: str | None) -> Grade:
        """Returns the choice that is given, and this one where None is."""
        return Grade(black or self.black, ambient or self.ambient, gamut or self.gamut)

    def kept(self, black: Floats, ambient: Floats) -> Floats:
        """Returns the light that belongs to the grade; both kinds are of one unit and shape."""
        return (self.black == KEPT) * black + (self.ambient == KEPT) * ambient

    def told(self, black: float, ambient: float) -> str:
        """Says in one sentence what becomes of light without a picture.

        Parameters
        ----------
        black, ambient
            Luminance of the projector's black and of other light in the room, cd/m².
        """
        kinds = (("black", self.black, black), ("ambient light", self.ambient, ambient))
        there = [(name, choice, light) for name, choice, light in kinds if light > 0]
        if not there:
            return "the screen has no light without a picture"
        parts = [
            f"{name} of {decimal(light)} cd/m² {_MEANS[choice]} "
            f"(--{name.partition(' ')[0]} {choice})"
            for name, choice, light in there
        ]
        return ", ".join(parts)


_MEANS = {KEPT: "is part of the grade and stays", TAKEN_OUT: "is pollution and is taken out"}

SCREENS = Grade()
"""Of cinemas and 3D screens, whose masters are graded on such a screen."""
DOMES = Grade(TAKEN_OUT, TAKEN_OUT, CLIPPED)
"""Of domes, whose masters are graded on monitors."""
