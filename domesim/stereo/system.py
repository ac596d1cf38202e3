"""A 3D cinema that keeps the eyes apart by polarisation, as light meets it.

The **room frame** has its origin in the centre of the flat screen, x to the audience's right, y to
their front and z up; all lengths are in metres. The screen lies in y = 0 and faces the audience,
who sit, like the projectors, at y < 0. Pictures (row, col) on it have row 0 at the top and col 0 at
the audience's left.

What comes in pairs is named left and right by the eye that it is meant for; in arrays the left eye
is 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, final

import numpy as np

from domesim.errors import InputError

Point = tuple[float, float, float]
"""(x, y, z) in the room frame, m."""

QUARTER = 90.0
"""Retardance of a quarter of a wave, degrees."""

Hand = Literal["left", "right"]
"""Sense of circularly polarised light; a reflection near the normal turns one into the other."""


@final
@dataclass(frozen=True)
class SilverScreen:
    """A flat screen of aluminium flakes, with some paint or dust that scatters.

    Parameters
    ----------
    width, height
        Size of the lit rectangle, m.
    depolarising_share
        Share of the surface, 0..1, that is Lambertian and forgets the polarisation; the rest are
        rough aluminium facets that reflect once and keep it.
    roughness
        GGX roughness alpha of the facets (Walter 2007), which sets the width of the gain lobe.
    albedo
        Albedo of the Lambertian share, and what the facets keep besides aluminium's own loss.

    Raises
    ------
    InputError
        If one of them is out of range.
    """

    width: float
    height: float
    depolarising_share: float
    roughness: float
    albedo: float = 1.0

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"silver screen {name} must be above 0 m, got {value:g} m")
        if not 0 <= self.depolarising_share <= 1:
            raise InputError(
                f"silver screen depolarising share must be 0..1, got {self.depolarising_share:g}"
            )
        for name in ("roughness", "albedo"):
            value = getattr(self, name)
            if not 0 < value <= 1:
                raise InputError(
                    f"silver screen {name} must be above 0 and at most 1, got {value:g}"
                )


@final
@dataclass(frozen=True)
class CircularFilter:
    """A circular polariser: a linear one, and a retarder at 45 degrees to it.

    Before a lens it makes unpolarised light circular, before an eye it is the analyser: the
    retarder is always on the screen's side.

    Parameters
    ----------
    hand
        The light that it passes. Light is right-handed whose field turns clockwise for whom it
        comes to.
    leak
        How much light of the other state the linear polariser passes: 0 (ideal) and below 1. A
        contrast of 300:1 is a leak of 1/300.
    retardance_error
        How much more than a quarter of a wave the retarder is, degrees of phase.
    axis
        Where the linear polariser's axis points, degrees from the horizontal, counted
        anticlockwise by an audience that faces the screen.

    Raises
    ------
    InputError
        If one of them cannot be.
    """

    hand: Hand
    leak: float = 0.0
    retardance_error: float = 0.0
    axis: float = 0.0

    def __post_init__(self) -> None:
        if self.hand not in {"left", "right"}:
            raise InputError(f"circular filter hand must be left or right, got {self.hand!r}")
        if not 0 <= self.leak < 1:
            raise InputError(
                f"circular filter leak must be at least 0 and below 1, got {self.leak:g}"
            )
        if not abs(self.retardance_error) < QUARTER:
            raise InputError(
                f"circular filter retardance error must lie between -90 and 90 degrees, got "
                f"{self.retardance_error:g}"
            )
        if not np.isfinite(self.axis):
            raise InputError(f"circular filter axis must be an angle, got {self.axis:g}")

    def at(self, wavelength: float, design: float) -> CircularFilter:
        """The same filter for another wavelength than that of its design, both in one unit.

        A film of one birefringence has a retardance in proportion to the inverse wavelength. The
        birefringence of most films rises towards the blue besides, by some per cent. That is left
        out: no measurement of such a filter was found.

        Raises
        ------
        InputError
            If its retardance is nothing like a quarter of a wave there.
        """
        retardance = (QUARTER + self.retardance_error) * design / wavelength
        return replace(self, retardance_error=retardance - QUARTER)


@final
@dataclass(frozen=True)
class PolarisedProjector:
    """A small lens that sends unpolarised light through a filter to all of the screen.

    Parameters
    ----------
    position
        Place of the lens, m.
    filter
        What is before it.

    Raises
    ------
    InputError
        If it is not before the screen.
    """

    position: Point
    filter: CircularFilter

    def __post_init__(self) -> None:
        _require_before_screen("projector", self.position)


@final
@dataclass(frozen=True)
class StereoTheatre:
    """A room with a silver screen, two projectors, and people with glasses. Its walls are black.

    Parameters
    ----------
    screen
        The screen.
    projectors
        Projectors of the left eye's picture, and of the right eye's.
    eyewear
        What is before the left eye, and before the right one.
    seats
        Where heads are, by the seats' names, m. Both eyes are taken to be there.
    wavelengths
        Wavelengths of the three primaries, nm; None if filters are the same for all light.
    design
        Wavelength of the filters' retardance errors, nm.

    Raises
    ------
    InputError
        If a seat is not before the screen, or glasses do not fit the projectors.
    """

    screen: SilverScreen
    projectors: tuple[PolarisedProjector, PolarisedProjector]
    eyewear: tuple[CircularFilter, CircularFilter]
    seats: Mapping[str, Point]
    wavelengths: tuple[float, float, float] | None = None
    design: float = 550.0

    def __post_init__(self) -> None:
        if not self.seats:
            raise InputError("stereo theatre has no seats; name at least one")
        for name, position in self.seats.items():
            _require_before_screen(f"seat {name!r}", position)
        left, right = (projector.filter.hand for projector in self.projectors)
        if left == right:
            raise InputError(
                f"both projectors send {left}-handed light; give them filters of opposite hands"
            )
        for eye, sent, glass in zip(("left", "right"), (left, right), self.eyewear, strict=True):
            if glass.hand == sent:
                raise InputError(
                    f"the {eye} eye's filter passes {glass.hand}-handed light, but its projector's "
                    f"{sent}-handed light turns its hand on the screen; swap the glasses"
                )

    def by_primary(self) -> tuple[StereoTheatre, ...]:
        """The theatre as each primary's light finds it; one for all, if all find the same.

        Raises
        ------
        InputError
            If a filter's retardance is nothing like a quarter of a wave for some primary.
        """
        if self.wavelengths is None:
            return (self,)
        return tuple(self._at(wavelength) for wavelength in self.wavelengths)

    def _at(self, wavelength: float) -> StereoTheatre:
        left, right = (
            replace(each, filter=each.filter.at(wavelength, self.design))
            for each in self.projectors
        )
        first, second = (glass.at(wavelength, self.design) for glass in self.eyewear)
        return replace(self, projectors=(left, right), eyewear=(first, second), wavelengths=None)

    def seat(self, name: str) -> Point:
        """Where a seat is, m.

        Raises
        ------
        InputError
            If there is no such seat.
        """
        if name not in self.seats:
            raise InputError(f"no seat {name!r}; there are {', '.join(self.seats)}")
        return self.seats[name]


def _require_before_screen(who: str, position: Point) -> None:
    if len(position) != 3 or not np.isfinite(position).all():
        raise InputError(f"{who} position must be three numbers (x, y, z) in m, got {position}")
    if not position[1] < 0:
        raise InputError(
            f"{who} must be before the screen, at y below 0 m, got y = {position[1]:g} m"
        )
