"""The room round the screen, as light meets it: what a path tracer needs and a closed form omits.

The **room frame** has its origin in the centre of the dome's sphere, x to the audience's right, y
to their front and z up; all lengths are in metres. The dome's frame is the room's, leaning by the
dome's tilt (`domesim.room.dome`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from domesim.host.values import ByValue
from domesim.room.dome import Dome

Point = tuple[float, float, float]
"""(x, y, z) in the room frame, m."""

Albedo = tuple[float, float, float]
"""Diffuse albedo for each primary."""


_SEAT = re.compile(r"row[0-9]+-seat[0-9]+")
_NEAR = 0.1
"""A floor so near to the screen, in units of its radius, is taken to meet it."""
_FINE = 256
"""Pixels a side, at least, of a picture whose mean is taken."""


@final
@dataclass(frozen=True)
class Lobe:
    """A screen that sends more light in the mirror direction: high "gain" paint.

    Microfacets that reflect once: a rough lobe loses what would have to be reflected twice.

    Parameters
    ----------
    share
        Share of the reflected light in the lobe, 0..1; the rest is Lambertian.
    roughness
        GGX roughness alpha of the lobe (Walter 2007).
    """

    share: float
    roughness: float


@final
@dataclass(frozen=True)
class Cavity:
    """What lies behind a perforated screen: a concentric shell of the dome's own half-angle.

    Parameters
    ----------
    depth
        Distance from the screen to the shell, m.
    albedo
        Albedo of the shell.
    back_albedo
        Albedo of the screen's back, between the holes.
    """

    depth: float
    albedo: Albedo
    back_albedo: Albedo


@final
@dataclass(frozen=True)
class Floor:
    """A horizontal disc, centred below (or above) the sphere's centre.

    Parameters
    ----------
    height
        z of the floor, m; negative below the centre of the sphere.
    radius
        Radius of the disc, m.
    albedo
        Its albedo; light from below is absorbed.
    """

    height: float
    radius: float
    albedo: Albedo


@final
@dataclass(frozen=True)
class Wall:
    """A vertical cylinder round the z axis.

    Parameters
    ----------
    radius
        Its radius, m.
    bottom, top
        z of its ends, m.
    albedo
        Its albedo inside; light from outside is absorbed.
    """

    radius: float
    bottom: float
    top: float
    albedo: Albedo


@final
@dataclass(frozen=True)
class Solid:
    """A thing of triangles in the room: seats, audience, a projection booth.

    Parameters
    ----------
    name
        What it is.
    vertices
        (vertex, xyz) float64, m.
    faces
        (face, 3) int64 indices of vertices; both sides reflect.
    albedo
        Its albedo.
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    albedo: Albedo


@final
@dataclass(frozen=True)
class Lamp:
    """A small Lambertian light that is always on: an exit sign, an aisle light.

    Parameters
    ----------
    name
        What it is.
    centre
        Centre of its rectangle, m.
    across, up
        Half-edges of the rectangle (xyz, m); it shines towards ``across x up``.
    luminance
        Luminance in units of projector white, one a primary.
    """

    name: str
    centre: Point
    across: Point
    up: Point
    luminance: Albedo


@final
@dataclass(frozen=True, eq=False)
class Mask:
    """The share of its light that a projector sends through each part of its field.

    Parameters
    ----------
    weights
        (row, col) 0..1, of light; the first row is at the top of a rectangular field.
    """

    weights: NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Paint(ByValue):
    """Paint of unequal albedo: what multiplies the screen's, place by place.

    Parameters
    ----------
    factors
        (row, col, primary) of a domemaster, above 0 and at most 1; one primary stands for all.
    """

    factors: NDArray[np.float64]

    @property
    def coloured(self) -> bool:
        """Whether primaries have factors of their own."""
        return bool(self.factors.shape[2] > 1)

    def on(self, rows: int, cols: int) -> NDArray[np.float64]:
        """Means over a domemaster's pixels, (row, col, primary)."""
        return np.moveaxis(_means(np.moveaxis(_means(self.factors, rows), 1, 0), cols), 0, 1)

    def mean(self, dome: Dome) -> NDArray[np.float64]:
        """(3,) means over a screen's area, one a primary."""
        size = max(_FINE, len(self.factors))
        areas = dome.screen_areas(size, size)
        return np.broadcast_to(np.tensordot(areas, self.on(size, size), 2) / areas.sum(), 3)


def _means(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Means over `count` equal parts of the first axis."""
    ends = np.linspace(0, len(values), count + 1)
    sums = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    whole = np.minimum(ends.astype(np.intp), len(values) - 1)
    part = (ends - whole).reshape(-1, *[1] * (values.ndim - 1))
    return np.diff(sums[whole] + part * values[whole], axis=0) * (count / len(values))


@final
@dataclass(frozen=True)
class Lens:
    """One projector of the theatre.

    Parameters
    ----------
    name
        What it is called.
    position
        Its nodal point, m.
    look_at
        The point that it is aimed at, m.
    roll
        Turn about its axis, radians.
    kind
        ``equidistant`` (fisheye, a circular field) or ``perspective`` (a rectangular field).
    field
        Full field of view, radians: across the circle, or horizontally.
    aspect
        Width to height of a rectangular field.
    blend
        Width of the soft edge inside the field, radians.
    shift
        How far the middle of a rectangular field lies right of and above its axis, in halves of its
        width and height: lens shift.
    mask
        A blend of its own, over a rectangular field; besides `blend`.
    black
        Direct light of its black where it lights the screen alone, 1.0 = projector white.
    blends_black
        Whether what blends its picture dims its black, too: glass or metal in the beam does.
    uplift
        What it adds to its black, over a rectangular field, 1.0 = projector white.
    """

    name: str
    position: Point
    look_at: Point
    roll: float = 0.0
    kind: Literal["equidistant", "perspective"] = "equidistant"
    field: float = np.pi
    aspect: float = 16 / 9
    blend: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    mask: Mask | None = None
    black: float = 0.0
    blends_black: bool = False
    uplift: Mask | None = None


@final
@dataclass(frozen=True)
class Viewpoint:
    """A place to look from.

    Parameters
    ----------
    position
        The eye, m.
    look_at
        The point in the middle of the view, m.
    field
        Horizontal field of view, radians.
    """

    position: Point
    look_at: Point
    field: float = np.radians(100.0)


@final
@dataclass(frozen=True, eq=False)
class Theatre(ByValue):
    """A dome theatre: its screen, and whatever else light meets.

    Parameters
    ----------
    dome
        The shape of the screen.
    albedo
        Diffuse albedo of the screen between its holes.
    perforation
        Share of the screen that is holes.
    cavity
        What is behind the holes; they are black without it.
    lobe
        The screen's gain lobe; Lambertian without it.
    floor, wall
        Floor and wall of the room; without them light that misses the screen is lost.
    solids
        Seats, audience, booth.
    lamps
        Lights that are always on.
    lenses
        The projectors; one in the sphere's centre if empty.
    corrected
        Whether the projection system evens out falloff and blending, as most do.
    viewpoints
        Named places to look from.
    paint
        What multiplies the screen's albedo; the same everywhere without it.
    black_contrast
        How much black may change within a degree, relative: projectors lift what lies outside their
        overlaps until it does no more (`domesim.room.unlit`). None if they lift nothing.
    """

    dome: Dome
    albedo: Albedo
    perforation: float = 0.0
    cavity: Cavity | None = None
    lobe: Lobe | None = None
    floor: Floor | None = None
    wall: Wall | None = None
    solids: tuple[Solid, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    lenses: tuple[Lens, ...] = ()
    corrected: bool = True
    viewpoints: Mapping[str, Viewpoint] = field(default_factory=dict)
    paint: Paint | None = None
    black_contrast: float | None = None

    @property
    def screen_albedo(self) -> Albedo:
        """Albedo of the screen with its holes, rho (1 - t), one a primary."""
        kept = 1 - self.perforation
        return self.albedo[0] * kept, self.albedo[1] * kept, self.albedo[2] * kept

    @property
    def mean_paint(self) -> Albedo:
        """Mean of what multiplies the screen's albedo, over its area, one a primary."""
        if self.paint is None:
            return 1.0, 1.0, 1.0
        red, green, blue = self.paint.mean(self.dome)
        return float(red), float(green), float(blue)

    @property
    def seats(self) -> dict[str, Viewpoint]:
        """The seats among the viewpoints."""
        return {name: view for name, view in self.viewpoints.items() if _SEAT.fullmatch(name)}

    @property
    def lambertian(self) -> bool:
        """Whether every surface is Lambertian."""
        return self.lobe is None or self.lobe.share == 0

    @property
    def shines_back(self) -> bool:
        """Whether light comes back through the screen's holes from a cavity behind it."""
        return self.perforation > 0 and self.cavity is not None and max(self.cavity.albedo) > 0

    @property
    def hides_screen(self) -> bool:
        """Whether floor or wall stands before a part of the screen."""
        return self._floor_hides or self._wall_hides

    @property
    def _floor_hides(self) -> bool:
        return self.floor is not None and self.floor.height > self.dome.lowest + 1e-9

    @property
    def _wall_hides(self) -> bool:
        return self.wall is not None and self.wall.radius < self.dome.widest - 1e-9

    @property
    def floor_meets_screen(self) -> bool:
        """Whether a reflecting floor comes so near to the screen that light changes fast there."""
        floor, dome = self.floor, self.dome
        if floor is None or max(floor.albedo) == 0:
            return False
        sunk = dome.lowest / (dome.radius * dome.height_ratio)
        rim = dome.radius * np.sqrt(max(0.0, 1 - sunk**2))
        near = _NEAR * dome.radius
        return bool(floor.height > dome.lowest - near and floor.radius > rim - near)

    @property
    def enclosure(self) -> Theatre:
        """The theatre with nothing but a Lambertian screen, floor and wall."""
        return replace(self, lobe=None, cavity=None, solids=(), lamps=(), viewpoints={})

    @property
    def beyond_enclosure(self) -> tuple[str, ...]:
        """What is in the theatre besides a Lambertian screen, floor and wall."""
        beyond = []
        if not self.lambertian:
            beyond.append("a screen with a gain lobe")
        if self.cavity is not None and self.perforation > 0:
            beyond.append("a cavity behind the screen")
        if self.solids:
            beyond.append(f"solids ({_names(self.solids)})")
        if self.lamps:
            beyond.append(f"lamps ({_names(self.lamps)})")
        return tuple(beyond)

    def departures(self) -> tuple[str, ...]:
        """Why the closed form of a bare Lambertian spherical cap is only an approximation here.

        Empty if it is exact. (Design section 3; experiments measure what each is worth.)
        """
        reasons = []
        if self.dome.height_ratio != 1:
            reasons.append(
                f"the dome is an ellipsoid of height ratio {self.dome.height_ratio:g}, not a sphere"
            )
        if self.lobe is not None and self.lobe.share > 0:
            reasons.append(f"{self.lobe.share:.0%} of the screen's light is in a gain lobe")
        if self.shines_back:
            reasons.append("light comes back from the cavity behind the perforated screen")
        for name, surface in (("floor", self.floor), ("wall", self.wall)):
            if surface is not None and max(surface.albedo) > 0:
                reasons.append(f"the {name} reflects (albedo {max(surface.albedo):g})")
        for name, hides in (("floor", self._floor_hides), ("wall", self._wall_hides)):
            if hides:
                reasons.append(f"the {name} hides a part of the screen")
        if self.solids:
            reasons.append(f"things stand in the room ({_names(self.solids)})")
        if self.lamps and self.solids:
            reasons.append(f"things stand in the light of lamps ({_names(self.lamps)})")
        return tuple(reasons)


def _names(things: Iterable[Solid | Lamp]) -> str:
    return ", ".join(dict.fromkeys(thing.name for thing in things))
