"""A cinema as a box: a flat screen on its front wall, and what its surfaces reflect.

Places are in the room's frame: x right, y from the screen to the back, z up, from the middle of
the screen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError

Floats = NDArray[np.float64]
Albedo = tuple[float, float, float]

_MOST = 0.98  # of light that surfaces may reflect in the mean: what remains must be spent


class Face(NamedTuple):
    """A rectangle that looks into the room.

    Attributes
    ----------
    name
        Which surface it is.
    corner, first, second
        (xyz,) a corner, and its two sides, m.
    normal
        (xyz,) into the room.
    albedo
        One a primary.
    """

    name: str
    corner: Floats
    first: Floats
    second: Floats
    normal: Floats
    albedo: Albedo


@final
@dataclass(frozen=True)
class FlatRoom:
    """A box with a screen.

    Parameters
    ----------
    screen
        (width, height) of the screen, m.
    gain
        Luminance of the screen along its normal over that of a perfect diffuser. A matt screen's
        is its albedo.
    half_gain
        Angle from the normal at which its gain is half, radians; None for a matt screen. Between
        them the gain is 2^-(angle / half_gain)².
    size
        (width, height, length) of the room, m; the screen is in the middle of its width.
    bottom
        Height of the screen's lower edge above the floor, m.
    floor, ceiling, walls, back, front
        Albedos, one a primary: walls are those at the sides, front is around the screen.
    audience, audience_from
        Albedo of the seats and those who sit there, and how far from the screen they begin, m. They
        lie on the floor.

    Raises
    ------
    InputError
        If the screen does not fit or reflects more than it gets, seats begin beyond the room, or
        the room absorbs next to nothing.
    """

    screen: tuple[float, float]
    gain: float
    half_gain: float | None
    size: tuple[float, float, float]
    bottom: float
    floor: Albedo
    ceiling: Albedo
    walls: Albedo
    back: Albedo
    front: Albedo
    audience: Albedo
    audience_from: float

    def __post_init__(self) -> None:
        width, height, length = self.size
        if self.screen[0] > width or self.bottom + self.screen[1] > height:
            raise InputError(
                f"the screen of {self.screen[0]:g} x {self.screen[1]:g} m, {self.bottom:g} m above "
                f"the floor, must fit the room's front of {width:g} x {height:g} m"
            )
        if not 0 < self.audience_from < length:
            raise InputError(
                f"the audience must begin within the room's {length:g} m, got "
                f"{self.audience_from:g} m"
            )
        if self.screen_albedo > 1:
            if self.half_gain is None:
                kind, way = "matt screen", "say at which angle it is half (half_gain_deg)"
            else:
                half = np.degrees(self.half_gain)
                kind, way = f"screen with half of it at {half:.3g} degrees", "lower one of the two"
            raise InputError(
                f"gain {self.gain:g}: a {kind} would reflect {self.screen_albedo:.0%} of its "
                f"light; {way}"
            )
        if self.mean_albedo > _MOST:
            raise InputError(
                f"the room and its screen must absorb at least {1 - _MOST:.0%} of light, got "
                f"{max(0, 1 - self.mean_albedo):.1%}; lower its albedos"
            )

    def relative_gain(self, angle: ArrayLike) -> Floats:
        """Gain at an angle from the normal, radians, over that along it."""
        away = np.asarray(angle, np.float64)
        if self.half_gain is None:
            return np.ones_like(away)
        return np.asarray(2.0 ** -((away / self.half_gain) ** 2))

    @property
    def screen_albedo(self) -> float:
        """Share of light along the normal that the screen reflects, in all directions."""
        angle = np.linspace(0, np.pi / 2, 2049)
        sent = self.relative_gain(angle) * np.sin(2 * angle)
        return float(self.gain * np.trapezoid(sent, angle))

    @property
    def mean_albedo(self) -> float:
        """Mean over all surfaces, the screen among them, for the primary that has most."""
        faces = self.faces()
        areas = [float(np.linalg.norm(np.cross(face.first, face.second))) for face in faces]
        screen = self.screen[0] * self.screen[1]
        reflected = np.array(areas) @ np.array([face.albedo for face in faces])
        return float(np.max(reflected + screen * self.screen_albedo) / (sum(areas) + screen))

    @property
    def gap(self) -> float:
        """Distance from the screen's edges to the nearest surface beside it, m."""
        (width, height), (wide, high, _) = self.screen, self.size
        return min((wide - width) / 2, self.bottom, high - height - self.bottom)

    def faces(self) -> list[Face]:
        """All surfaces but the screen; the front wall is what is around it."""
        width, height, length = self.size
        w, h = self.screen
        x, low, high = width / 2, -h / 2 - self.bottom, height - h / 2 - self.bottom
        right, up, away = np.eye(3)[[0, 2, 1]]

        def face(name: str, corner: ArrayLike, sides: ArrayLike, normal: Floats) -> Face:
            first, second = np.asarray(sides, float)
            albedo: Albedo = getattr(self, name)
            return Face(name, np.asarray(corner, float), first, second, normal, albedo)

        begin = self.audience_from
        faces = [
            face("floor", (-x, 0, low), (width * right, begin * away), up),
            face("audience", (-x, begin, low), (width * right, (length - begin) * away), up),
            face("ceiling", (-x, 0, high), (width * right, length * away), -up),
            face("walls", (-x, 0, low), (length * away, height * up), right),
            face("walls", (x, 0, low), (length * away, height * up), -right),
            face("back", (-x, length, low), (width * right, height * up), -away),
        ]
        side, above = (width - w) / 2, high - h / 2
        for corner, across, upward in (
            ((-x, 0, low), width, self.bottom),
            ((-x, 0, h / 2), width, above),
            ((-x, 0, -h / 2), side, h),
            ((w / 2, 0, -h / 2), side, h),
        ):
            if across > 0 and upward > 0:
                faces.append(face("front", corner, (across * right, upward * up), away))
        return faces
