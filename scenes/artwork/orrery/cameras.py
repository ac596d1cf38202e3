"""Who looks at it: a dome's audience, or that of a flat screen, with one eye or two.

A `View` is one eye's picture. It knows its Mitsuba sensor, and the same mapping in NumPy for what
is infinitely far away.

Stereo converges on the screen: what is `convergence` metres away has no parallax. On a flat screen
the cameras stay parallel and their pictures shift (off-axis frusta, without the keystone of cameras
turned in); on a dome see `domesim.pathtrace.plugins`. With an infinite convergence nothing shifts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.room.dome import Dome
from scenes.artwork.night.noise import Floats

KINDS = ("dome", "dome-stereo", "stereo")


class View(ABC):
    """One eye's picture. `size` is its width, pixels."""

    description: str

    @abstractmethod
    def shape(self, size: int) -> tuple[int, int]:
        """Rows and columns of a picture `size` pixels wide."""

    @abstractmethod
    def inside(self, size: int) -> NDArray[np.bool_]:
        """(row, col): which pixels show something."""

    @abstractmethod
    def sensor(self, mi: Any, size: int) -> Any:
        """The Mitsuba sensor."""

    @abstractmethod
    def directions(self, size: int) -> Floats:
        """(row, col, xyz): where the pixels' centres look, in the hall."""

    @abstractmethod
    def places(self, directions: Floats, size: int) -> tuple[Floats, Floats]:
        """Row and column, in pixels, of what is infinitely far in `directions`; NaN if unseen."""


@final
@dataclass(frozen=True)
class DomeView(View):
    """A domemaster of 180 degrees, from the middle of the hall's floor.

    Parameters
    ----------
    eye_offset
        Half the distance of the eyes, m: negative for the left eye.
    convergence
        Radius of the dome where both eyes' pictures agree, m.
    """

    eye_offset: float = 0.0
    convergence: float = np.inf

    description = "Equidistant domemaster, 180 degrees"
    eye = np.array([0.0, 0.0, 1.6])
    _dome = Dome(radius=1.0, half_angle=np.pi / 2)

    def shape(self, size: int) -> tuple[int, int]:
        """Rows and columns."""
        return size, size

    def inside(self, size: int) -> NDArray[np.bool_]:
        """(row, col): which pixels show something."""
        return self._dome.inside(size, size)

    def sensor(self, mi: Any, size: int) -> Any:
        """The Mitsuba sensor."""
        settings = {"eye_offset": self.eye_offset, "convergence": float(self.convergence)}
        to_world = mi.ScalarTransform4f().translate(self.eye.tolist())
        return mi.load_dict(
            {"type": "domemaster", "to_world": to_world, "film": _film(self, size), **settings}
        )

    def directions(self, size: int) -> Floats:
        """(row, col, xyz): where the pixels' centres look, in the hall."""
        toward = self._dome.directions(size, size)
        if not np.isfinite(self.convergence):
            return toward
        toward = self.convergence * toward - self._eye_of(toward)
        return np.asarray(toward / np.linalg.norm(toward, axis=-1, keepdims=True))

    def places(self, directions: Floats, size: int) -> tuple[Floats, Floats]:
        """Row and column of what is infinitely far in `directions`; NaN if unseen."""
        on_screen = directions
        if np.isfinite(self.convergence):
            # The eye's place depends on the place looked at: c d = t w + o(d), solved by iteration.
            for _ in range(5):
                on_screen = directions + self._eye_of(on_screen) / self.convergence
                on_screen = on_screen / np.linalg.norm(on_screen, axis=-1, keepdims=True)
        theta = np.arccos(np.clip(on_screen[..., 2], -1, 1))
        ring = np.maximum(np.hypot(on_screen[..., 0], on_screen[..., 1]), 1e-12)
        radius = np.where(theta < np.pi / 2, theta / (np.pi / 2), np.nan)
        col, row = (on_screen[..., k] / ring * radius for k in (0, 1))
        return (row + 1) * (size / 2), (col + 1) * (size / 2)

    def _eye_of(self, toward: Floats) -> Floats:
        return self.eye_offset * np.cross(toward, [0.0, 0.0, 1.0])


@final
@dataclass(frozen=True)
class FlatView(View):
    """A 16:9 picture, 70 degrees wide, from the back of the hall.

    Parameters
    ----------
    eye_offset
        Half the distance of the cameras, m: negative for the left eye.
    convergence
        Distance of the plane where both eyes' pictures agree, m.
    """

    eye_offset: float = 0.0
    convergence: float = np.inf

    description = "Perspective, 70 degrees wide"
    eye = np.array([0.0, -5.0, 1.7])
    aim = np.array([0.0, 3.2, 5.7])
    _half_width = float(np.tan(np.radians(35.0)))

    def shape(self, size: int) -> tuple[int, int]:
        """Rows and columns."""
        return max(1, round(size * 9 / 16)), size

    def inside(self, size: int) -> NDArray[np.bool_]:
        """(row, col): which pixels show something."""
        return np.ones(self.shape(size), dtype=bool)

    def sensor(self, mi: Any, size: int) -> Any:
        """The Mitsuba sensor."""
        right, _, forward = self._axes
        origin = self.eye + self.eye_offset * right
        to_world = mi.ScalarTransform4f().look_at(
            origin.tolist(), (origin + forward).tolist(), [0, 0, 1]
        )
        return mi.load_dict(
            {
                "type": "perspective",
                "fov": 70.0,
                "fov_axis": "x",
                "near_clip": 0.05,
                "far_clip": 1000.0,
                "principal_point_offset_x": -self._shift / 2,
                "to_world": to_world,
                "film": _film(self, size),
            }
        )

    def directions(self, size: int) -> Floats:
        """(row, col, xyz): where the pixels' centres look, in the hall."""
        rows, cols = self.shape(size)
        across = (np.arange(cols) + 0.5) * (2 / cols) - 1
        up = (rows - 2 * (np.arange(rows) + 0.5)) / cols
        right, above, forward = self._axes
        toward = (
            forward
            + ((across - self._shift) * self._half_width)[None, :, None] * right
            + (up * self._half_width)[:, None, None] * above
        )
        return np.asarray(toward / np.linalg.norm(toward, axis=-1, keepdims=True))

    def places(self, directions: Floats, size: int) -> tuple[Floats, Floats]:
        """Row and column of what is infinitely far in `directions`; NaN if unseen."""
        rows, cols = self.shape(size)
        x, y, z = np.moveaxis(directions @ self._axes.T, -1, 0)
        depth = np.where(z > 1e-3, z, np.nan) * self._half_width
        return rows / 2 - y / depth * cols / 2, (x / depth + self._shift + 1) * cols / 2

    @property
    def _axes(self) -> Floats:
        """(3, 3): right, above and forward."""
        forward = (self.aim - self.eye) / np.linalg.norm(self.aim - self.eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])

    @property
    def _shift(self) -> float:
        """To the right, of what is infinitely far; 1 is half the picture's width."""
        return self.eye_offset / self.convergence / self._half_width


def views(kind: str, interaxial: float = 0.065, convergence: float = 8.0) -> dict[str, View]:
    """The pictures of one frame, by what their files' names add to ``orrery``.

    Parameters
    ----------
    kind
        ``dome``; or ``dome-stereo`` or ``stereo``, which have a left (``_L``) and right (``_R``).
    interaxial
        Distance of the two eyes, m.
    convergence
        Distance without parallax, m; may be infinite.
    """
    if kind not in KINDS:
        raise InputError(f"--kind {kind!r} is not known; use one of {', '.join(KINDS)}")
    if not (np.isfinite(interaxial) and interaxial > 0):
        raise InputError(f"--interaxial must be above 0 m, got {interaxial:g}")
    if not convergence > interaxial:
        raise InputError(
            f"--convergence must be more than the interaxial distance of {interaxial:g} m, "
            f"got {convergence:g}"
        )
    if kind == "dome":
        return {"": DomeView()}
    eye = DomeView if kind == "dome-stereo" else FlatView
    return {
        "_L": eye(-interaxial / 2, convergence),
        "_R": eye(interaxial / 2, convergence),
    }


def _film(view: View, size: int) -> dict[str, Any]:
    rows, cols = view.shape(size)
    return {"type": "hdrfilm", "width": cols, "height": rows, "rfilter": {"type": "box"}}
