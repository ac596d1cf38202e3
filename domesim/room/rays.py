"""Where a ray meets the theatre: the screen, its back, the shell behind it, floor, wall and solids.

All lengths are in units of the dome's radius, in the room's frame. Screen, shell, floor and wall
are met exactly (quadrics). A ray that starts on one is told so: it then leaves out the root at its
own start instead of keeping a distance from it, which would bias small caps.

It is written once for NumPy and for path tracing, on tuples (x, y, z) of arrays with one entry a
ray. A *machine* is NumPy, or has NumPy's functions for arrays of its own (`sqrt`, `where` ...).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias, final

import numpy as np

from domesim.room.theatre import Albedo, Theatre

Lanes: TypeAlias = Any
"""One number for each ray: an array of the machine."""

Vector: TypeAlias = tuple[Lanes, Lanes, Lanes]
"""(x, y, z), each of them lanes."""

NOTHING, SCREEN, BACK, SHELL, FLOOR, WALL, BLACK, SOLID = range(8)
"""What a ray meets; `SOLID` + k is the solid of index k. `BLACK` absorbs."""

_NEAR = 1e-6


def dot(left: Vector, right: Vector) -> Lanes:
    """Inner product."""
    return left[0] * right[0] + left[1] * right[1] + left[2] * right[2]


def along(origin: Vector, direction: Vector, distance: Lanes) -> Vector:
    """The point at a distance: origin + distance direction."""
    return (
        origin[0] + distance * direction[0],
        origin[1] + distance * direction[1],
        origin[2] + distance * direction[2],
    )


def scaled(vector: Vector, factor: Any) -> Vector:
    """A multiple of a vector."""
    return vector[0] * factor, vector[1] * factor, vector[2] * factor


def chosen(machine: Any, condition: Lanes, yes: Vector, no: Vector) -> Vector:
    """`yes` where `condition` holds, else `no`."""
    x, y, z = (machine.where(condition, a, b) for a, b in zip(yes, no, strict=True))
    return x, y, z


@dataclass(frozen=True)
class Hit:
    """What rays meet.

    Attributes
    ----------
    surface
        What it is: `NOTHING` .. `SOLID` + k.
    position
        Where; undefined if nothing.
    normal
        Unit normal on the side that the ray comes from.
    """

    surface: Lanes
    position: Vector
    normal: Vector


def quadric(machine: Any, a: Lanes, b: Lanes, c: Lanes, on: Lanes) -> tuple[Lanes, Lanes]:
    """Distances at which rays enter and leave a quadric: roots of a t² + 2 b t + c, in order.

    Infinite if they miss it; a ray that starts `on` it and goes inwards leaves where it should, one
    that goes outwards never meets it again.
    """
    m = machine
    c = m.where(on, 0.0, c)
    square = b * b - a * c
    root = m.sqrt(m.maximum(square, 0.0))
    met = (square >= 0) & ~(on & (b >= 0))
    # The larger in size first; the other by Vieta's formula, without cancellation
    far = m.where(b > 0, -c / (b + root), (root - b) / a)
    near = m.where(b > 0, -(b + root) / a, c / (root - b))
    return m.where(met, near, np.inf), m.where(met, far, np.inf)


class Mesh(Protocol):
    """Triangles that rays can hit."""

    def hit(self, origin: Vector, direction: Vector, active: Lanes) -> tuple[Lanes, Vector, Lanes]:
        """Distance (infinite without a hit), unit normal towards the ray, index of the solid."""


@final
class Room:
    """A theatre as rays meet it.

    Parameters
    ----------
    theatre
        The theatre.
    machine
        What to compute with: NumPy, or what has its functions.
    mesh
        The theatre's solids, if rays are to meet them.
    """

    def __init__(self, theatre: Theatre, machine: Any = np, mesh: Mesh | None = None) -> None:
        dome = theatre.dome
        self.theatre, self.machine = theatre, machine
        self._unit = dome.radius
        self._lean = float(np.cos(dome.tilt)), float(np.sin(dome.tilt))
        self._ratio = dome.height_ratio
        # Below -1 for a closed sphere: rounding must not open it.
        closed = dome.half_angle >= np.pi * (1 - 1e-9)
        self._cap = -2.0 if closed else float(np.cos(dome.half_angle))
        self._lowest = None if dome.truncated_below is None else dome.truncated_below / self._unit
        self._shell = None
        if theatre.perforation > 0 and theatre.cavity is not None:
            self._shell = 1 + theatre.cavity.depth / self._unit
        self._mesh = mesh
        self.painted: Any = None  # a machine's table of the paint's factors
        self.shadows = self._mesh is not None or theatre.hides_screen

    @property
    def only_screen(self) -> bool:
        """Whether the screen is all there is."""
        t = self.theatre
        return t.floor is None and t.wall is None and self._mesh is None and self._shell is None

    @property
    def has_cavity(self) -> bool:
        """Whether light passes through the screen and may come back."""
        return self._shell is not None

    @property
    def albedos(self) -> dict[int, Albedo]:
        """Albedo of each surface that reflects; of the screen, of the part between its holes."""
        t = self.theatre
        # Without a cavity the holes are as good as black paint.
        albedos = {SCREEN: t.albedo if self.has_cavity else t.screen_albedo}
        if t.floor is not None:
            albedos[FLOOR] = t.floor.albedo
        if t.wall is not None:
            albedos[WALL] = t.wall.albedo
        if self.has_cavity and t.cavity is not None:
            albedos[BACK], albedos[SHELL] = t.cavity.back_albedo, t.cavity.albedo
        albedos.update({SOLID + k: solid.albedo for k, solid in enumerate(t.solids)})
        return albedos

    def to_dome(self, vector: Vector) -> Vector:
        """A vector of the room in the dome's frame."""
        x, y, z = vector
        c, s = self._lean
        return (x, y, z) if s == 0 else (x, c * y - s * z, s * y + c * z)

    def to_room(self, vector: Vector) -> Vector:
        """A vector of the dome's frame in the room's."""
        x, y, z = vector
        c, s = self._lean
        return (x, y, z) if s == 0 else (x, c * y + s * z, c * z - s * y)

    def screen_at(self, u: Lanes, v: Lanes) -> tuple[Vector, Vector]:
        """Position and inward normal of the screen at a point of the domemaster's disc."""
        m = self.machine
        distance = m.sqrt(m.maximum(u * u + v * v, 1e-20))
        # Off the disc, at a rim pixel's corner, the rim stands in.
        theta = m.minimum(distance, 1.0) * self.theatre.dome.half_angle
        ring = m.sin(theta) / distance
        direction = (u * ring, v * ring, m.cos(theta))
        if self._ratio == 1:
            return self.to_room(direction), self.to_room(scaled(direction, -1))
        x, y, z = direction
        position = scaled(direction, 1 / m.sqrt(x * x + y * y + (z / self._ratio) ** 2))
        return self.to_room(position), self.to_room(self._inward(position))

    def disc(self, position: Vector) -> tuple[Lanes, Lanes]:
        """(u, v) of a point of the room in the domemaster's disc: by its direction."""
        m = self.machine
        x, y, z = self.to_dome(position)
        if self._ratio != 1:
            shrink = 1 / m.sqrt(x * x + y * y + z * z)
            x, y, z = x * shrink, y * shrink, z * shrink
        theta = m.acos(m.maximum(m.minimum(z, 1.0), -1.0))
        scale = theta / m.sqrt(m.maximum(x * x + y * y, 1e-20)) / self.theatre.dome.half_angle
        return x * scale, y * scale

    def hit(self, origin: Vector, direction: Vector, leaving: Lanes, active: Lanes) -> Hit:
        """The first thing that rays meet.

        Parameters
        ----------
        origin, direction
            The rays; directions are unit vectors.
        leaving
            What the origin lies on (`NOTHING` in the air).
        active
            Lanes that matter.
        """
        nearest, best = self._meet_screen(origin, direction, leaving)
        if self._shell is not None:
            nearest, best = self._meet_shell(origin, direction, leaving, nearest, best)
        if self.theatre.floor is not None:
            nearest, best = self._meet_floor(origin, direction, leaving, nearest, best)
        if self.theatre.wall is not None:
            nearest, best = self._meet_wall(origin, direction, leaving, nearest, best)
        if self._mesh is not None:
            distance, facing, number = self._mesh.hit(origin, direction, active)
            nearer = distance < nearest
            at = along(along(origin, direction, distance), facing, 1e-5)
            best = self._nearer(nearer, number + SOLID, at, facing, best)
        return best

    def shadowed(
        self,
        origin: Vector,
        target: Vector,
        leaving: Lanes,
        active: Lanes,
        *,
        screen_hides: bool = True,
    ) -> Lanes:
        """Whether something stands between two points of the room.

        Parameters
        ----------
        origin, target
            The points.
        leaving, active
            As of `hit`.
        screen_hides
            False for targets on the screen: its front, a convex one, never hides itself, but
            rounding could make it seem so.
        """
        m = self.machine
        away = tuple(t - o for t, o in zip(target, origin, strict=True))
        length = m.sqrt(dot(away, away))
        direction = scaled(away, 1 / length)
        hit = self.hit(origin, direction, leaving, active)
        reach = tuple(p - o for p, o in zip(hit.position, origin, strict=True))
        hidden = (hit.surface != NOTHING) & (dot(reach, reach) < (length * (1 - 1e-4)) ** 2)
        return hidden if screen_hides else hidden & (hit.surface != SCREEN)

    def screen_along(self, origin: Vector, direction: Vector, leaving: Lanes) -> Hit:
        """Where rays would meet the screen if there were nothing else."""
        return self._meet_screen(origin, direction, leaving)[1]

    def _meet_screen(self, origin: Vector, direction: Vector, leaving: Lanes) -> tuple[Lanes, Hit]:
        m = self.machine
        nearest, surface, back = self._screen(origin, direction, leaving)
        position = along(origin, direction, nearest)
        if self._ratio == 1:
            # On the sphere again, whatever float32 made of it
            length = m.sqrt(m.maximum(dot(position, position), 1e-20))
            position = scaled(position, 1 / length)
            normal = scaled(position, -1)
        else:
            normal = self._inward_room(position)
        if back is not None:
            normal = chosen(m, back, scaled(normal, -1), normal)
        return nearest, Hit(surface, position, normal)

    def _screen(
        self, origin: Vector, direction: Vector, leaving: Lanes
    ) -> tuple[Lanes, Lanes, Lanes | None]:
        """Distance to the screen, what it is, and where it is the screen's back that is met."""
        m = self.machine
        near, far, on = self._roots(origin, direction, 1.0, (leaving == SCREEN) | (leaving == BACK))
        # Infinitely far up is no screen, though it is above the rim.
        hits = (far > _NEAR) & (far < np.inf) & self.on_screen(along(origin, direction, far))
        nearest = m.where(hits, far, np.inf)
        surface = m.where(hits, SCREEN, NOTHING)
        if self.only_screen:
            return nearest, surface, None
        # From outside the sphere the back comes first. Inside, rounding may make `near` just > 0.
        back = (near > 1e-5) & (near < np.inf) & ~on
        back = back & self.on_screen(along(origin, direction, near))
        nearest = m.where(back, near, nearest)
        return nearest, m.where(back, BACK if self.has_cavity else BLACK, surface), back

    def _roots(
        self, origin: Vector, direction: Vector, size: float, on: Lanes
    ) -> tuple[Lanes, Lanes, Lanes]:
        """Distances at which rays enter and leave the dome's sphere (ellipsoid) times `size`."""
        if self._ratio == 1:
            a: Any = 1.0
            o, d = origin, direction
        else:
            o, d = self._rounded(origin), self._rounded(direction)
            a = dot(d, d)
        near, far = quadric(self.machine, a, dot(o, d), dot(o, o) - size * size, on)
        return near, far, on

    def _rounded(self, vector: Vector) -> Vector:
        """A vector in the dome's frame, stretched so that an ellipsoid becomes a sphere."""
        x, y, z = self.to_dome(vector)
        return x, y, z / self._ratio

    def _inward(self, position: Vector) -> Vector:
        """Inward unit normal of the ellipsoid at a point of the dome's frame."""
        x, y, z = position
        normal = (-x, -y, -z / self._ratio**2)
        return scaled(normal, 1 / self.machine.sqrt(dot(normal, normal)))

    def _inward_room(self, position: Vector) -> Vector:
        return self.to_room(self._inward(self.to_dome(position)))

    def on_screen(self, position: Vector) -> Lanes:
        """Whether points of the dome's surface are on its screen."""
        x, y, z = self.to_dome(position)
        if self._ratio == 1 and self._shell is None:
            on = z >= self._cap
        else:
            on = z >= self._cap * self.machine.sqrt(x * x + y * y + z * z)
        return on if self._lowest is None else on & (position[2] >= self._lowest)

    def _meet_shell(
        self, origin: Vector, direction: Vector, leaving: Lanes, nearest: Lanes, best: Hit
    ) -> tuple[Lanes, Hit]:
        near, far, _ = self._roots(origin, direction, float(self._shell or 0), leaving == SHELL)
        for distance, surface in ((near, BLACK), (far, SHELL)):
            position = along(origin, direction, distance)
            # A ray that enters comes from outside the theatre: the shell's other side is black.
            hits = (distance > _NEAR) & (distance < nearest) & self.on_screen(position)
            best = self._nearer(hits, surface, position, self._inward_room(position), best)
            nearest = self.machine.where(hits, distance, nearest)
        return nearest, best

    def _meet_floor(
        self, origin: Vector, direction: Vector, leaving: Lanes, nearest: Lanes, best: Hit
    ) -> tuple[Lanes, Hit]:
        m, floor = self.machine, self.theatre.floor
        assert floor is not None
        height, reach = floor.height / self._unit, (floor.radius / self._unit) ** 2
        fall = m.where(direction[2] == 0, 1e-20, direction[2])
        distance = (height - origin[2]) / fall
        x, y, _ = along(origin, direction, distance)
        met = (leaving != FLOOR) & (distance > 0) & (distance < nearest)
        met = met & (x * x + y * y <= reach)
        above = direction[2] < 0
        level = x * 0 + height
        zero, one = x * 0, x * 0 + 1
        best = self._nearer(
            met, m.where(above, FLOOR, BLACK), (x, y, level), (zero, zero, one), best
        )
        return m.where(met, distance, nearest), best

    def _meet_wall(
        self, origin: Vector, direction: Vector, leaving: Lanes, nearest: Lanes, best: Hit
    ) -> tuple[Lanes, Hit]:
        m, wall = self.machine, self.theatre.wall
        assert wall is not None
        radius, bottom, top = (v / self._unit for v in (wall.radius, wall.bottom, wall.top))
        a = m.maximum(direction[0] * direction[0] + direction[1] * direction[1], 1e-12)
        b = origin[0] * direction[0] + origin[1] * direction[1]
        c = origin[0] * origin[0] + origin[1] * origin[1] - radius * radius
        on = leaving == WALL
        near, far = quadric(m, a, b, c, on)
        for distance, surface, possible in (
            # Points of the floor at the wall's foot are outside by rounding only.
            (near, BLACK, (near > 1e-5) & ~on),
            (far, WALL, far > _NEAR),
        ):
            x, y, z = along(origin, direction, distance)
            met = possible & (distance < nearest) & (z >= bottom) & (z <= top)
            shrink = radius / m.sqrt(m.maximum(x * x + y * y, 1e-20))
            position = (x * shrink, y * shrink, z)
            normal = (-position[0] / radius, -position[1] / radius, z * 0)
            best = self._nearer(met, surface, position, normal, best)
            nearest = m.where(met, distance, nearest)
        return nearest, best

    def _nearer(
        self, nearer: Lanes, surface: Any, position: Vector, normal: Vector, best: Hit
    ) -> Hit:
        m = self.machine
        return Hit(
            m.where(nearer, surface, best.surface),
            chosen(m, nearer, position, best.position),
            chosen(m, nearer, normal, best.normal),
        )
