"""The canvas of a domemaster: where its samples look, and how they become a picture."""

from __future__ import annotations

from itertools import pairwise
from typing import Protocol

import numpy as np

from domesim.light import Light
from testing.content.texture import TWICE, Floats, smoothstep, star_colours, stars, tinted
from testing.pairs import averaged


class Placed(Protocol):
    """A square on a plane that touches the sky."""

    @property
    def azimuth(self) -> float:
        """Azimuth of its middle, radians from the front to the right."""

    @property
    def altitude(self) -> float:
        """Altitude of its middle, radians."""

    @property
    def turn(self) -> float:
        """How far it is turned clockwise, radians."""

    @property
    def wide(self) -> float:
        """Its width, in distances."""


class Dome:
    """Samples of a domemaster, `fine` to a pixel and axis.

    Attributes
    ----------
    x, y
        To the right and down, 1 at the rim.
    angle, azimuth
        Radians from the zenith, and from the front to the right.
    """

    def __init__(self, size: int, fine: int = TWICE) -> None:
        self.fine = fine
        self.samples = size * fine
        across = ((np.arange(self.samples) + 0.5) * (2 / self.samples) - 1).astype(np.float32)
        self.x, self.y = (np.ascontiguousarray(grid) for grid in np.meshgrid(across, across))
        self.angle: Floats = np.hypot(self.x, self.y) * np.float32(np.pi / 2)
        self.azimuth: Floats = np.arctan2(self.x, self.y)

    def turned(self, azimuth: float, altitude: float) -> tuple[Floats, Floats, Floats]:
        """Directions in a frame that looks to (azimuth, altitude): right, up, ahead."""
        sine = np.sin(self.angle)
        right, front, up = (
            sine * np.sin(self.azimuth),
            sine * np.cos(self.azimuth),
            np.cos(self.angle),
        )
        axes = _frame(azimuth, altitude)
        first, second, third = (a * right + b * front + c * up for a, b, c in axes)
        return first, second, third

    def scattered(self, random: np.random.Generator, count: int) -> Floats:
        """Places all over the hemisphere, equally dense in solid angle; (n, 2) in widths."""
        angle = np.arccos(random.uniform(0, 1, count))
        turn = random.uniform(0, 2 * np.pi, count)
        return _places(angle, np.sin(turn), np.cos(turn))

    def placed_turned(
        self,
        longitude: Floats,
        latitude: Floats,
        azimuth: float,
        altitude: float,
    ) -> Floats:
        """Places on the dome of points in the frame of `turned`, without those below the rim."""
        axes = np.array(_frame(azimuth, altitude))
        local = np.stack(
            [
                np.cos(latitude) * np.sin(longitude),
                np.sin(latitude),
                np.cos(latitude) * np.cos(longitude),
            ]
        )
        return _seen(local[[0, 2, 1]].T @ axes[[0, 1, 2]])

    def on_plane(self, points: Floats, plane: Placed) -> Floats:
        """Places on the dome of points of a plane, in its widths from its middle, y down."""
        cos, sin = np.cos(plane.turn), np.sin(plane.turn)
        x, y = plane.wide * points.T
        local = np.stack([cos * x - sin * y, -(sin * x + cos * y), np.ones_like(x)])
        local /= np.linalg.norm(local, axis=0)
        return _seen(local.T @ np.array(_frame(plane.azimuth, plane.altitude)))

    def line(self, points: Floats, plane: Placed, wide: float = 0.0013) -> Floats:
        """Coverage of a line through points of a plane, as wide as `wide` widths of the dome."""
        places = self.on_plane(points, plane)
        result = np.zeros_like(self.x)
        for (x0, y0), (x1, y1) in pairwise(places):
            low = np.floor((np.minimum([x0, y0], [x1, y1]) - 2 * wide) * self.samples).astype(int)
            high = np.ceil((np.maximum([x0, y0], [x1, y1]) + 2 * wide) * self.samples).astype(int)
            box = slice(max(low[1], 0), high[1] + 1), slice(max(low[0], 0), high[0] + 1)
            x, y = self.x[box] / 2 + 0.5 - x0, self.y[box] / 2 + 0.5 - y0
            along = np.array([x1 - x0, y1 - y0])
            part = np.clip((x * along[0] + y * along[1]) / max(along @ along, 1e-12), 0, 1)
            away = np.hypot(x - part * along[0], y - part * along[1])
            result[box] = np.maximum(result[box], smoothstep(wide, 0.3 * wide, away))
        return result

    def stars(self, places: Floats, peaks: Floats, random: np.random.Generator) -> Floats:
        """Stars at places, in the colours of random temperatures."""
        kelvin = np.exp(random.normal(np.log(6500), 0.35, len(places))).clip(2800, 25000)
        spread = 0.00075
        return stars(self.x.shape, places, tinted(peaks, (1, 1, 1)) * star_colours(kelvin), spread)

    def light(self, samples: Floats) -> Light:
        """(1, size, size, 3) light in 0..1, float32, black outside the circle."""
        inside = Dome(self.samples // self.fine, 1).angle <= np.pi / 2
        picture = averaged(samples.clip(0, 1)[None], self.fine)
        return np.asarray(picture * inside[..., None], np.float32)


def _frame(azimuth: float, altitude: float) -> list[tuple[float, float, float]]:
    """Axes to the right, up and ahead in the dome's: right, front, zenith."""
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    level, steep = np.cos(altitude), np.sin(altitude)
    return [
        (cos, -sin, 0.0),
        (-steep * sin, -steep * cos, level),
        (level * sin, level * cos, steep),
    ]


def _seen(directions: Floats) -> Floats:
    """Places of those directions (right, front, zenith) that are above the rim."""
    right, front, up = directions[directions[:, 2] > 0].T
    level = np.maximum(np.hypot(right, front), 1e-12)
    return _places(np.arccos(np.clip(up, -1, 1)), right / level, front / level)


def _places(angle: Floats, right: Floats, front: Floats) -> Floats:
    """(n, 2) x and y in widths of the domemaster."""
    radius = angle / np.pi
    return np.stack([0.5 + radius * right, 0.5 + radius * front], axis=-1)
