"""Where projectors stand and how wide they must see, for a dome that has none yet.

*Cove*: around the rim, just under it, each looking across; the ring leans with the dome. *Ring*:
the same on a level ring at the wall, under the lowest point of the screen. Both are aimed so that
the fields are as narrow as they can be with all of the screen lit and every seam blended.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.room.dome import Dome
from domesim.room.lenses import lens_frame
from domesim.room.theatre import Lens

Floats = NDArray[np.float64]

Layout: TypeAlias = Literal["cove", "ring", "centre"]
LAYOUTS: tuple[Layout, ...] = ("cove", "ring", "centre")

ASPECT = 1.6
"""Longer to shorter side of a rectangular field: 2560 x 1600 pixels, lying or upright."""
BLEND = 10.0
"""Width of a soft edge, degrees."""
WIDEST = 120.0
"""Longer side of a rectangular field, degrees; a wider one is a fisheye's."""
INWARDS = 0.9
"""Distance of projectors from the dome's axis, over that of the rim."""
BELOW = 0.03
"""How far projectors are under the rim, over the dome's radius."""

_SPARE = 0.5  # degrees that a field is wider than it must be
_CENTIMETRE = 2  # decimals of positions


def around(dome: Dome, count: int, layout: Literal["cove", "ring"]) -> tuple[Lens, ...]:
    """Projectors that light all of a dome from its rim.

    All have the same field. They stand symmetrically to the audience's left and right, none at the
    very front, and are numbered from the back over the right. Every place of the screen is within
    a field by half of the soft edge at least, so that each seam is blended over its whole width.

    Parameters
    ----------
    dome
        The screen, a spherical cap.
    count
        How many projectors.
    layout
        ``cove`` or ``ring``.

    Raises
    ------
    InputError
        If there are none, or there is no room inside the sphere for them.
    """
    if count < 1:
        raise InputError(f"projectors must be at least 1, got {count}")
    step = 2 * np.pi / count
    back = -np.pi / 2 + (0 if count % 2 else step / 2)
    azimuths = back + step * np.arange(count, dtype=np.float64)
    places = np.asarray(np.round(_places(dome, azimuths, layout), _CENTIMETRE))
    points = _screen_points(dome)
    found = [
        _aimed(dome, places, float(np.radians(angle)), points, layout, aspect)
        for angle in np.arange(-20.0, 0.95 * np.degrees(dome.half_angle), 2.5)
        for aspect in (ASPECT, 1 / ASPECT)
    ]
    # Fields are whole degrees: those that tie are equal to the last bit, and the first counts
    return min(found, key=lambda lenses: _solid_angle(lenses[0]))


def _places(dome: Dome, azimuths: Floats, layout: str) -> Floats:
    """(lens, xyz) in the room, m."""
    across = np.stack([np.cos(azimuths), np.sin(azimuths)], -1)
    if layout == "cove":
        height = dome.radius * (np.cos(dome.half_angle) - BELOW)
        away = INWARDS * dome.radius * np.sin(dome.half_angle)
        local = np.concatenate([away * across, np.full((len(across), 1), height)], -1)
        return np.asarray(local @ dome.to_room.T)
    height = dome.lowest - BELOW * dome.radius
    room = dome.radius**2 - height**2
    if room < (0.2 * dome.radius) ** 2:
        raise InputError(
            "a level ring under the lowest point of the screen has no room inside the dome's "
            "sphere; use the layout cove, or a smaller tilt"
        )
    away = INWARDS * float(np.sqrt(room))
    return np.concatenate([away * across, np.full((len(across), 1), height)], -1)


def _screen_points(dome: Dome, size: int = 32) -> Floats:
    """(point, xyz) of the room, all over the screen and along its rim."""
    inside = dome.points(size, size)[dome.inside(size, size)]
    rim = dome.surface(np.full(120, dome.half_angle), np.arange(120) * np.pi / 60)
    return np.concatenate([inside, rim @ dome.to_room.T])


def _aimed(
    dome: Dome, places: Floats, angle: float, points: Floats, layout: str, aspect: float
) -> tuple[Lens, ...]:
    """Projectors that look at what is `angle` beyond the zenith, just wide enough."""
    lenses = []
    for number, place in enumerate(places, 1):
        x, y, _ = place @ dome.to_room
        beyond = dome.surface(np.array(angle), np.array(np.arctan2(-y, -x)))
        target = np.round(beyond @ dome.to_room.T, _CENTIMETRE)
        lens = Lens(f"{layout} {number}", _point(place), _point(target))
        # Upright to the dome, which may lean
        right, up, forth = lens_frame(lens)
        level = np.cross(forth, dome.to_room[:, 2])
        roll = round(float(np.degrees(np.arctan2(level @ up, level @ right))), 1)
        lenses.append(replace(lens, roll=float(np.radians(roll))))
    kind: Literal["perspective", "equidistant"] = "perspective"
    field = _field(_needed(lenses, points, aspect))
    longer = 2 * np.arctan2(np.sin(field / 2), np.cos(field / 2) * min(1.0, aspect))
    if longer > np.radians(WIDEST):
        kind, aspect, field = "equidistant", 1.0, _field(_needed(lenses, points, None))
    return tuple(
        replace(lens, kind=kind, field=field, aspect=aspect, blend=np.radians(BLEND))
        for lens in lenses
    )


def _field(needed: Floats) -> float:
    """The whole field of view in whole degrees, radians."""
    return float(np.radians(np.ceil(min(2 * np.degrees(needed.max()) + 2 * _SPARE, 360.0))))


def _needed(lenses: list[Lens], points: Floats, aspect: float | None) -> Floats:
    """(point,): half of the field that reaches it from one of the lenses, radians.

    The fields are rectangles of an `aspect`, or circles if it is None.
    """
    least = np.full(len(points), np.inf)
    margin = np.radians(BLEND / 2)
    for lens in lenses:
        right, up, forth = lens_frame(lens)
        rays = points - np.asarray(lens.position)
        ahead = rays @ forth
        if aspect is None:
            half = np.arccos(np.clip(ahead / np.linalg.norm(rays, axis=-1), -1, 1)) + margin
        else:
            across = np.arctan2(np.abs(rays @ right), ahead) + margin
            high = np.arctan2(np.abs(rays @ up), ahead) + margin
            seen = np.maximum(across, high) < np.radians(89)
            wide = np.arctan(np.tan(np.where(seen, high, 0)) * aspect)
            half = np.where(seen, np.maximum(across, wide), np.pi / 2)
        least = np.minimum(least, half)
    return least


def _solid_angle(lens: Lens) -> float:
    if lens.kind == "equidistant":
        return float(2 * np.pi * (1 - np.cos(lens.field / 2)))
    a = np.tan(lens.field / 2)
    b = a / lens.aspect
    return float(4 * np.arcsin(a * b / np.sqrt((1 + a * a) * (1 + b * b))))


def _point(place: Floats) -> tuple[float, float, float]:
    x, y, z = (float(part) + 0.0 for part in place)
    return x, y, z
