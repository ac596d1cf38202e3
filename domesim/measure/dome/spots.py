"""Readings of a luminance meter (cd/m²) or a lux meter, at places of a theatre.

A meter sees all primaries at once. Patterns are taken by their luminance, and the theatre as grey:
exact if its albedos are the same in all primaries, and what a meter can tell in any case. A lux
meter on the lit screen beside a luminance meter's reading of it tells the albedo without any model.

Beside photographs, which tell the primaries apart, a reading is what it is: the sum of what the
primaries show, each by its share in the luminance of white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light.ties import ROUNDING, ascending
from domesim.measure.dome.fit import Evidence, Meter
from domesim.measure.dome.model import Places, surfaces_of
from domesim.measure.dome.photographs import direct_light
from domesim.room.theatre import Point, Theatre

Floats = NDArray[np.float64]

_ASTRAY = 0.05
"""Largest distance of a place from a surface, in units of the dome's radius."""


@final
@dataclass(frozen=True)
class Reading:
    """One reading.

    Parameters
    ----------
    pattern
        Index of the pattern that was shown.
    place
        Where on screen, floor or wall, m in the room's frame.
    unit
        ``cd/m2``: what the place sends to the meter; ``lux``: what arrives there.
    value, error
        In that unit; its standard error.
    """

    pattern: int
    place: Point
    unit: Literal["cd/m2", "lux"]
    value: float
    error: float


@final
@dataclass(frozen=True, eq=False)
class Metered:
    """Readings beside photographs.

    Parameters
    ----------
    readings
        Readings of a luminance or lux meter.
    weights
        (primary,) shares of the primaries in the luminance of white.
    white
        As for `Meter`.
    """

    readings: Sequence[Reading]
    weights: Floats
    white: bool


def grey(patterns: Floats, weights: Floats) -> Floats:
    """Patterns (pattern, row, col, primary) by their luminance, the same in all primaries."""
    return np.repeat((patterns @ weights)[..., None], 3, -1)


def evidence_of(theatre: Theatre, patterns: Floats, readings: Sequence[Reading]) -> Evidence:
    """Readings as evidence, the same in all primaries.

    Raises
    ------
    InputError
        If a place is on no surface.
    """
    spots = list(dict.fromkeys((reading.place, reading.unit) for reading in readings))
    on, points = zip(*(_surface(theatre, place) for place, _ in spots), strict=True)
    surface = np.array(on)
    lux = np.array([unit == "lux" for _, unit in spots])
    seen_screen = (surface == 0) & ~lux
    lit = direct_light(theatre, patterns)
    direct = np.zeros((len(patterns), len(spots), 3))
    for spot in np.flatnonzero(surface == 0):
        ray = theatre.dome.toward(np.asarray(points[spot]))
        row, col = theatre.dome.pixel_of(ray, lit.shape[1])
        direct[:, spot] = lit[:, row, col]
    shape = len(readings), len(spots), 3
    value, variance = np.zeros(shape), np.full(shape, np.inf)
    for number, reading in enumerate(readings):
        mine = number, spots.index((reading.place, reading.unit))
        value[mine], variance[mine] = reading.value, reading.error**2
    return Evidence(
        Places(surface, np.array(points)[:, None], direct, lux),
        np.array([reading.pattern for reading in readings]),
        value,
        variance,
        seen_screen / max(1, seen_screen.sum()),
    )


def with_readings(
    photographed: Evidence, theatre: Theatre, patterns: Floats, metered: Metered
) -> Evidence:
    """Evidence of photographs and of readings; photographs and their places come first.

    Nuisances are taken not to change readings: most are the camera's, and the others are small
    beside a meter's errors.

    Raises
    ------
    InputError
        If a place is on no surface.
    """
    read = evidence_of(theatre, patterns, metered.readings)
    first, then = photographed.places, read.places
    assert then.lux is not None
    cells, spots = len(first.surface), len(then.surface)
    points = np.repeat(then.points, first.points.shape[1], 1)
    shape = len(photographed.pattern) + len(read.pattern), cells + spots, 3
    value, variance = np.zeros(shape), np.full(shape, np.inf)
    value[: len(photographed.pattern), :cells] = photographed.value
    variance[: len(photographed.pattern), :cells] = photographed.variance
    value[len(photographed.pattern) :, cells:, 0] = read.value[..., 0]
    variance[len(photographed.pattern) :, cells:, 0] = read.variance[..., 0]
    effects = photographed.effects
    if effects is not None:
        effects = np.pad(effects, ((0, 0), (0, 0), (0, spots), (0, 0)))
    return replace(
        photographed,
        places=Places(
            np.concatenate([first.surface, then.surface]),
            np.concatenate([first.points, points]),
            np.concatenate([first.direct, then.direct], 1),
            np.concatenate([np.zeros(cells, bool), then.lux]),
        ),
        pattern=np.concatenate([photographed.pattern, read.pattern]),
        value=value,
        variance=variance,
        area=np.concatenate([photographed.area, np.zeros(spots)]),
        effects=effects,
        meter=Meter(np.arange(cells + spots) >= cells, metered.weights, metered.white),
    )


def _surface(theatre: Theatre, place: Point) -> tuple[int, Point]:
    """Index of the surface that a place is on, and the nearest point of it.

    Where two meet, the screen comes before the floor, and the floor before the wall.
    """
    dome, point = theatre.dome, np.asarray(place)
    near: list[tuple[float, str, Floats]] = []
    length = float(np.linalg.norm(point))
    if length > 0:
        local = dome.toward(point)
        away = float(dome.distance(local))
        if np.arccos(np.clip(local[2], -1, 1)) < dome.half_angle + 1e-9:
            near.append((abs(away - length), "screen", point * (away / length)))
    if theatre.floor is not None:
        down = np.array([point[0], point[1], theatre.floor.height])
        near.append((abs(float(point[2]) - theatre.floor.height), "floor", down))
    if theatre.wall is not None:
        across = max(float(np.hypot(*point[:2])), 1e-9)
        out = np.append(point[:2] * theatre.wall.radius / across, point[2])
        near.append((abs(across - theatre.wall.radius), "wall", out))
    nearest = ascending([away for away, _, _ in near], ROUNDING * dome.radius)
    if not near or near[nearest[0]][0] > _ASTRAY * dome.radius:
        raise InputError(f"the place {list(place)} is on no surface of the theatre")
    _, name, (x, y, z) = near[nearest[0]]
    return surfaces_of(theatre).index(name), (float(x), float(y), float(z))
