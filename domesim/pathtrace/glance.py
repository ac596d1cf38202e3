"""What an eye in the theatre sees, at a glance: one ray a pixel, and no noise.

A fisheye view of 180 degrees, equidistant. The screen shows the light that it is given, which is
what an observation says; floor, wall, seats and people get the screen's light once, and without
shadows. The path tracer knows better, and takes minutes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from domesim.pathtrace.llvm import load_mitsuba
from domesim.pathtrace.machine import DrJit
from domesim.room.lenses import axes_towards
from domesim.room.rays import NOTHING, SCREEN
from domesim.room.theatre import Theatre, Viewpoint

Floats = NDArray[np.float64]

_PATCHES = 18  # across the screen, as sources of light
_AT_ONCE = 2048  # points that are lit at a time


class Glance(NamedTuple):
    """A view.

    Attributes
    ----------
    picture
        (row, col, primary) in the units of the light that was given; 0 outside the circle.
    inside
        (row, col): pixels of the circle.
    screen_share
        Share of the view's solid angle that is screen.
    """

    picture: Floats
    inside: NDArray[np.bool_]
    screen_share: float


def glance(theatre: Theatre, light: NDArray[np.floating], eye: Viewpoint, size: int) -> Glance:
    """Look towards a point from a place in the theatre.

    Parameters
    ----------
    theatre
        The theatre.
    light
        (row, col, primary) a domemaster, as it is seen on the screen.
    eye
        Where from, and the middle of the view; its own field does not count.
    size
        Pixels a side.
    """
    rays, angle, inside = _rays(eye, size)
    machine, dome, lanes = DrJit(load_mitsuba()), theatre.dome, len(rays)
    room = machine.room(theatre)
    x, y, z = (machine.full(part / dome.radius, lanes) for part in eye.position)
    right, ahead, up = (machine.lanes(part) for part in rays.T)
    leaving = machine.whole(NOTHING, lanes)
    hit = room.hit((x, y, z), (right, ahead, up), leaving, leaving == NOTHING)
    surface = machine.array(hit.surface)
    places = np.stack([machine.array(part) for part in hit.position], -1) * dome.radius
    normals = np.stack([machine.array(part) for part in hit.normal], -1)
    seen = np.zeros((lanes, light.shape[-1]))
    on = surface == SCREEN
    seen[on] = light[dome.pixel_of(dome.toward(places[on]), len(light))]
    lit = np.zeros(lanes, np.bool_)
    albedo = np.zeros_like(seen)
    for number, reflects in room.albedos.items():
        if number != SCREEN:
            albedo[surface == number], lit[surface == number] = reflects, max(reflects) > 0
    seen[lit] = albedo[lit] / np.pi * _irradiance(theatre, light, places[lit], normals[lit])
    picture = np.zeros((size, size, light.shape[-1]))
    picture[inside] = seen
    weights = np.sinc(angle / np.pi)  # solid angle of a pixel, relative
    return Glance(picture, inside, float(weights[on].sum() / weights.sum()))


def _rays(eye: Viewpoint, size: int) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """(ray, xyz) unit vectors and (ray,) angles from the axis, and (row, col) which pixels."""
    centres = (np.arange(size) + 0.5) * (2 / size) - 1
    across, down = np.meshgrid(centres, centres)
    away = np.hypot(across, down)
    inside = away <= 1
    angle = away[inside] * np.pi / 2
    ring = np.sin(angle) / np.maximum(away[inside], 1e-9)
    right, up, forward = axes_towards(eye.position, eye.look_at, "a viewpoint")
    rays = (
        np.cos(angle)[:, None] * forward
        + (ring * across[inside])[:, None] * right
        - (ring * down[inside])[:, None] * up
    )
    return rays, angle, inside


def _irradiance(
    theatre: Theatre, light: NDArray[np.floating], places: Floats, normals: Floats
) -> Floats:
    """(point, primary) irradiance of places in the room by the screen, without shadows."""
    dome = theatre.dome
    inside = dome.inside(_PATCHES, _PATCHES)
    directions = dome.directions(_PATCHES, _PATCHES)[inside]
    sources = dome.points(_PATCHES, _PATCHES)[inside]
    facing = -dome.normals(directions) @ dome.to_room.T
    areas = dome.screen_areas(_PATCHES, _PATCHES)[inside]
    shown = _means(light, dome.inside(*light.shape[:2]))[inside] * areas[:, None]
    length, outwards = np.sum(sources**2, -1), np.sum(sources * facing, -1)
    irradiance = np.empty((len(places), light.shape[-1]))
    for start in range(0, len(places), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        here, normal = places[part], normals[part]
        # Of the way from a place to a source: its square, and its parts along both normals
        square = np.sum(here**2, -1)[:, None] + length - 2 * here @ sources.T
        square = np.maximum(square, (0.02 * dome.radius) ** 2)
        arriving = np.maximum(normal @ sources.T - np.sum(here * normal, -1)[:, None], 0)
        leaving = np.maximum(here @ facing.T - outwards, 0)
        irradiance[part] = (arriving * leaving / square**2) @ shown
    return irradiance


def _means(light: NDArray[np.floating], on: NDArray[np.bool_]) -> Floats:
    """(patch row, patch col, primary): means of what is on the screen."""
    size = len(light)
    number = np.arange(size) * _PATCHES // size
    which = number[:, None] * _PATCHES + number
    count = np.maximum(np.bincount(which[on], minlength=_PATCHES**2), 1)
    sums = [np.bincount(which[on], light[..., p][on], _PATCHES**2) for p in range(light.shape[-1])]
    return (np.stack(sums, -1) / count[:, None]).reshape(_PATCHES, _PATCHES, -1)
