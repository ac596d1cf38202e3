"""Where the pixels of a photograph look: a fisheye in the theatre, or a picture of the screen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.pathtrace.machine import NumPy
from domesim.pathtrace.room import FLOOR, NOTHING, SCREEN, WALL, Room
from domesim.pathtrace.tracer import camera_frame
from domesim.theatre import Point, Theatre, Viewpoint

Floats = NDArray[np.float64]

SURFACES = {"screen": SCREEN, "floor": FLOOR, "wall": WALL}
"""What photographs are taken of, as the path tracer numbers it."""


@final
@dataclass(frozen=True)
class Camera:
    """An equidistant fisheye: a pixel's distance from the centre is proportional to its angle.

    Looking straight up, it sees the front at the bottom of the picture and the right on its right,
    as a domemaster has them.

    Parameters
    ----------
    position
        Where it is, m in the room's frame.
    look_at
        The point in the middle of the picture, m.
    field
        Field of view across the picture's inscribed circle, radians.
    turn
        (x, y, z) of a small rotation of the camera about the room's axes, radians.
    """

    position: Point
    look_at: Point
    field: float = np.pi
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not 0 < self.field <= 2 * np.pi:
            raise InputError(
                f"camera field must be above 0 and at most 360 degrees, got "
                f"{np.degrees(self.field):g}"
            )

    def rays(self, u: Floats, v: Floats) -> Floats:
        """(..., xyz): unit vectors of places in the picture, -1..1 to the right and down."""
        right, up, forward = camera_frame(Viewpoint(self.position, self.look_at))
        angle = np.hypot(u, v) * (self.field / 2)
        scale = np.sinc(angle / np.pi) * (self.field / 2)
        rays = (
            (u * scale)[..., None] * right
            - (v * scale)[..., None] * up
            + np.cos(angle)[..., None] * forward
        )
        rays = rays + np.cross(np.asarray(self.turn), rays)
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def domemaster_camera(theatre: Theatre) -> Camera:
    """The camera in the sphere's centre whose picture of the screen is a domemaster."""
    x, y, z = (float(part) for part in theatre.dome.to_room[:, 2])
    return Camera((0.0, 0.0, 0.0), (x, y, z), 2 * theatre.dome.half_angle)


def places_in(size: int) -> tuple[Floats, Floats]:
    """(row, col) places of the pixels' centres of a square picture, -1..1 to the right and down."""
    axis = (2 * np.arange(size) + 1 - size) / size
    u, v = np.meshgrid(axis, axis)
    return u, v


def looked_at(
    theatre: Theatre, camera: Camera, u: Floats, v: Floats
) -> tuple[NDArray[np.int64], Floats]:
    """What a camera sees at places of its picture, and where.

    Parameters
    ----------
    theatre, camera
        What is seen, and from where.
    u, v
        Places in the picture, any shape; those outside the circle see nothing.

    Returns
    -------
    surface, points
        (...) of `domesim.pathtrace.room`, and (..., xyz) in m.
    """
    machine, unit = NumPy(), theatre.dome.radius
    room = Room(theatre, machine)
    rays = camera.rays(u, v).reshape(-1, 3)
    origin = tuple(np.full(len(rays), part / unit) for part in camera.position)
    none = machine.whole(NOTHING, len(rays))
    with np.errstate(all="ignore"):  # of rays that meet nothing
        hit = room.hit(
            (origin[0], origin[1], origin[2]),
            (rays[:, 0], rays[:, 1], rays[:, 2]),
            none,
            none == NOTHING,
        )
    seen = np.where(np.hypot(u, v).ravel() <= 1, hit.surface, NOTHING)
    points = np.stack(hit.position, -1) * unit
    return seen.reshape(u.shape), points.reshape(*u.shape, 3)
