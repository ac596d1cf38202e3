"""Where the pixels of a photograph look: a fisheye, a pinhole, or a picture of the screen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from domesim.errors import InputError
from domesim.room.lenses import axes_towards
from domesim.room.rays import FLOOR, NOTHING, SCREEN, WALL, Room
from domesim.room.theatre import Point, Theatre

Floats = NDArray[np.float64]

SURFACES = {"screen": SCREEN, "floor": FLOOR, "wall": WALL}
"""What photographs are taken of, as rays number it."""
_WIDEST = np.radians(150.0)
"""Field of a pinhole."""
_CORNER = 1.25
"""A corner's distance from the centre over half of the width, of 4 : 3."""
_NEWTON = 8


@final
@dataclass(frozen=True)
class Camera:
    """A camera in the theatre.

    In an equidistant fisheye's picture, a pixel's distance from the centre is proportional to its
    angle; in a pinhole's, to the angle's tangent t, or to t + distortion t³. Looking straight up,
    it sees the front at the bottom of the picture and the right on its right, as a domemaster has
    them.

    Parameters
    ----------
    position
        Where it is, m in the room's frame.
    look_at
        The point in the middle of the picture, m.
    field
        Field of view, radians: across the inscribed circle of a fisheye's picture, or across the
        width of a pinhole's (were there no distortion).
    turn
        Rotation vector (x, y, z) by which the camera is turned from that, radians.
    mapping
        Kind of the camera's picture.
    distortion
        Distortion k1 of a pinhole, negative if straight lines bulge (a barrel).
    """

    position: Point
    look_at: Point
    field: float = np.pi
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mapping: Literal["fisheye", "perspective"] = "fisheye"
    distortion: float = 0.0

    def __post_init__(self) -> None:
        widest = 2 * np.pi if self.mapping == "fisheye" else _WIDEST
        if not 0 < self.field <= widest:
            raise InputError(
                f"camera field must be above 0 and at most {np.degrees(widest):g} degrees, got "
                f"{np.degrees(self.field):g}"
            )
        if self.mapping == "perspective" and not self.distortion > folding(self.field):
            raise InputError(
                f"camera distortion k1 must leave the picture unfolded to its corners, got "
                f"{self.distortion:g} at a field of {np.degrees(self.field):g} degrees"
            )

    def rays(self, u: Floats, v: Floats) -> Floats:
        """(..., xyz): unit vectors of places in the picture, -1..1 to the right, v downwards."""
        right, up, forward = self._frame()
        if self.mapping == "fisheye":
            angle = np.hypot(u, v) * (self.field / 2)
            scale, ahead = np.sinc(angle / np.pi) * (self.field / 2), np.cos(angle)
        else:
            wide = float(np.tan(self.field / 2))
            scale = wide * self._undistorted(np.hypot(u, v) * wide)
            ahead = np.ones_like(scale)
        rays = (
            (u * scale)[..., None] * right
            - (v * scale)[..., None] * up
            + ahead[..., None] * forward
        )
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    def places(self, points: Floats) -> tuple[Floats, Floats]:
        """Where in the picture points (..., xyz) of the room are: u, v as of `rays`.

        NaN behind a pinhole.
        """
        away = points - np.asarray(self.position)
        x, y, z = (away @ axis for axis in self._frame())
        across = np.hypot(x, y)
        if self.mapping == "fisheye":
            out = np.arctan2(across, z) / (self.field / 2)
        else:
            tangent = np.where(z > 0, across / np.where(z > 0, z, 1), np.nan)
            out = tangent * (1 + self.distortion * tangent**2) / np.tan(self.field / 2)
        scale = out / np.maximum(across, 1e-300)
        return x * scale, -y * scale

    def sees(self, u: Floats, v: Floats) -> NDArray[np.bool_]:
        """(...): whether places are in the picture."""
        if self.mapping == "fisheye":
            return np.asarray(np.hypot(u, v) <= 1)
        return np.asarray(np.abs(u) <= 1)

    def pixels_in(self, angle: float, cols: int) -> float:
        """How many pixels of a picture, `cols` wide, an angle (radians) has at most."""
        if self.mapping == "fisheye":
            return angle * cols / self.field
        wide = np.tan(self.field / 2)
        return float(angle * cols / 2 * (1 + wide**2) / wide)

    def _frame(self) -> tuple[Floats, Floats, Floats]:
        axes = np.stack(axes_towards(self.position, self.look_at, "a camera"))
        axes = Rotation.from_rotvec(self.turn).apply(axes)
        return axes[0], axes[1], axes[2]

    def _undistorted(self, distorted: Floats) -> Floats:
        """Ratio of t to t + k1 t³, of the latter, by Newton's method."""
        tangent = distorted
        for _ in range(_NEWTON):
            excess = tangent * (1 + self.distortion * tangent**2) - distorted
            tangent = tangent - excess / (1 + 3 * self.distortion * tangent**2)
        return np.divide(tangent, distorted, out=np.ones_like(tangent), where=distorted > 0)


def folding(field: float) -> float:
    """Distortion (< 0) with which a pinhole's corners fold back; its field is in radians."""
    return float(-1 / (3 * (_CORNER * np.tan(field / 2)) ** 2))


def domemaster_camera(theatre: Theatre) -> Camera:
    """The camera in the sphere's centre whose picture of the screen is a domemaster."""
    x, y, z = (float(part) for part in theatre.dome.to_room[:, 2])
    return Camera((0.0, 0.0, 0.0), (x, y, z), 2 * theatre.dome.half_angle)


def places_in(rows: int, cols: int | None = None) -> tuple[Floats, Floats]:
    """(row, col) places of the pixels' centres of a picture, -1..1 to the right and as far down.

    Square unless `cols` says otherwise.
    """
    cols = rows if cols is None else cols
    u, v = np.meshgrid(
        (2 * np.arange(cols) + 1 - cols) / cols, (2 * np.arange(rows) + 1 - rows) / cols
    )
    return u, v


def looked_at(
    theatre: Theatre, camera: Camera, u: Floats, v: Floats
) -> tuple[NDArray[np.int64], Floats]:
    """What a camera sees at places of its picture, and where.

    Parameters
    ----------
    theatre, camera
        What is seen but for its solids, and from where.
    u, v
        Places in the picture, any shape; those outside a fisheye's circle see nothing.

    Returns
    -------
    surface, points
        (...) of `domesim.room.rays`, and (..., xyz) in m.
    """
    unit = theatre.dome.radius
    rays = camera.rays(u, v).reshape(-1, 3)
    x, y, z = (np.full(len(rays), part / unit) for part in camera.position)
    right, ahead, up = rays.T
    none = np.full(len(rays), NOTHING)
    with np.errstate(all="ignore"):  # of rays that meet nothing
        hit = Room(theatre).hit((x, y, z), (right, ahead, up), none, none == NOTHING)
    seen = np.where(camera.sees(u, v).ravel(), hit.surface, NOTHING)
    points = np.stack(hit.position, -1) * unit
    return seen.reshape(u.shape), points.reshape(*u.shape, 3)
