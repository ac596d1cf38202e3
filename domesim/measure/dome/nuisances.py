"""What is known of the theatre and the camera only within an error, as effects on the light.

Each is one number, such as the floor's height; a second model with that number changed by its
standard deviation tells what it does to the light that places show. Effects are relative. What a
camera sees is not linear in where it is: they are taken anew about where it was found.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.measure.dome.camera import Camera, looked_at
from domesim.measure.dome.model import Interreflection, Places, surfaces_of
from domesim.measure.dome.photographs import Cells
from domesim.room.rays import NOTHING
from domesim.room.theatre import Theatre
from domesim.scene.fields import three

Floats = NDArray[np.float64]

CAMERA = ("camera", "turn about")
"""How names of the camera's nuisances begin."""


@final
@dataclass(frozen=True)
class Errors:
    """Standard deviations of what is stated; 0 for what is exact.

    Parameters
    ----------
    camera_m
        Standard deviation of each coordinate of the camera's place, m.
    pointing_deg
        Standard deviation of the camera's direction about each axis, degrees.
    vignetting
        Standard deviation of the light at the rim of the camera's view, relative to the middle: one
        part that grows with the square of the distance from the middle, one with its fourth power.
    floor_m
        Standard deviation of the floor's height, m.
    model_screen, model_others
        Standard deviation of reflected light as the model has it, relative: on the screen; on floor
        and wall. What path tracing says of it is in `validation.experiments.surveys`.
    """

    camera_m: float = 0.02
    pointing_deg: float = 0.3
    vignetting: float = 0.02
    floor_m: float = 0.02
    model_screen: float = 0.0004
    model_others: float = 0.0012


def effects_of(
    theatre: Theatre,
    camera: Camera,
    cells: Cells,
    patterns: Floats,
    light: Interreflection,
    errors: Errors,
    albedos: Floats,
) -> tuple[tuple[str, ...], Floats]:
    """Names, and (nuisance, pattern, place, primary) relative effects of a standard deviation.

    `albedos` (surface, primary) are those at which effects are computed: at wrong ones, what one
    nuisance does looks like another.
    """
    nominal = _shown(light, albedos, cells.places)
    names, effects = [], []
    for name, other, moved in _changed(theatre, camera, errors):
        model = light if other is theatre else Interreflection(other, patterns, light.resolution)
        places = _again(cells, other, moved)
        shown = _shown(model, albedos, places)
        change = np.divide(shown - nominal, nominal, out=np.zeros_like(nominal), where=nominal > 0)
        names.append(name)
        effects.append(change)
    if errors.vignetting > 0:
        for power in (1, 2):
            names.append(f"vignetting, radius^{2 * power}")
            fall = errors.vignetting * ((cells.u**2 + cells.v**2) ** power).mean(1)
            effects.append(np.broadcast_to(fall[None, :, None], nominal.shape))
    reflected = nominal - cells.places.direct
    share = np.divide(reflected, nominal, out=np.zeros_like(nominal), where=nominal > 0)
    for number, surface in enumerate(surfaces_of(theatre)):
        size = errors.model_screen if number == 0 else errors.model_others
        if size > 0:
            names.append(f"model, {surface}")
            mine = (cells.places.surface == number)[None, :, None]
            effects.append(size * share * mine)
    return tuple(names), np.array(effects).reshape(len(names), *nominal.shape)


def seen_again(
    theatre: Theatre, camera: Camera, cells: Cells, errors: Errors, found: Mapping[str, float]
) -> tuple[Camera, Cells]:
    """The camera where it was found, by nuisances' names, and what its pixels see from there."""
    step, turn = (
        size * np.array([found.get(f"{kind} {axis}", 0.0) for axis in "xyz"])
        for kind, size in zip(
            CAMERA, (errors.camera_m, np.radians(errors.pointing_deg)), strict=True
        )
    )
    moved = replace(
        camera,
        position=three(camera.position + step),
        look_at=three(camera.look_at + step),
        turn=three(camera.turn + turn),
    )
    return moved, replace(cells, places=_again(cells, theatre, moved))


def _changed(
    theatre: Theatre, camera: Camera, errors: Errors
) -> Iterator[tuple[str, Theatre, Camera]]:
    for axis, name in enumerate("xyz"):
        if errors.camera_m > 0:
            step = errors.camera_m * np.eye(3)[axis]
            # It goes on looking in the same direction.
            place, ahead = three(camera.position + step), three(camera.look_at + step)
            moved = replace(camera, position=place, look_at=ahead)
            yield f"camera {name}", theatre, moved
        if errors.pointing_deg > 0:
            turn = three(camera.turn + np.radians(errors.pointing_deg) * np.eye(3)[axis])
            yield f"turn about {name}", theatre, replace(camera, turn=turn)
    floor, wall = theatre.floor, theatre.wall
    if floor is not None and errors.floor_m > 0:
        # Down, where there is room
        sunk = replace(floor, height=floor.height - errors.floor_m)
        if wall is not None and wall.bottom == floor.height:
            wall = replace(wall, bottom=sunk.height)
        yield "floor height", replace(theatre, floor=sunk, wall=wall), camera


def _again(cells: Cells, theatre: Theatre, camera: Camera) -> Places:
    """The same pixels' places in a theatre that is a little different."""
    surface, points = looked_at(theatre, camera, cells.u, cells.v)
    if np.any(surface == NOTHING):
        raise InputError(
            "the photographs are explained best by a camera that cannot see what they show: check "
            "exposures, which pattern each photograph shows, and the camera's place and direction"
        )
    return replace(cells.places, points=points)


def _shown(light: Interreflection, albedos: Floats, places: Places) -> Floats:
    """(pattern, place, primary)."""
    seen = light.seen_from(places)
    return np.stack([light.shown(p, albedos[:, p], places, seen)[0] for p in range(3)], -1)
