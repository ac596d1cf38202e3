"""The bounce loop: light that leaves a point of the theatre, by random walks.

Values are radiances in units of what projector white shows on the screen by direct light alone. The
value of a Lambertian point is its direct value plus its albedo times the mean of the values that it
sees in cosine-distributed directions, so a walk that multiplies by the albedo at each bounce and
adds up direct values is unbiased [1, section 14.4]. Directions are chosen by the surface alone
("BSDF sampling"), and analytic intersections make a step cheap. Where a picture is dark but for a
few bright places, walks aim at them as well (`Aim`). A lane that ends a walk starts the next in the
same step, which keeps all lanes of a vector busy.

[1] M. Pharr, W. Jakob, G. Humphreys, *Physically Based Rendering*, 3rd ed., Elsevier 2017.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.pathtrace.machine import DrJit
from domesim.room.rays import (
    BACK,
    BLACK,
    FLOOR,
    NOTHING,
    SCREEN,
    SHELL,
    SOLID,
    WALL,
    Hit,
    Lanes,
    Room,
    Vector,
    chosen,
    dot,
    scaled,
)

Colour = tuple[Lanes, Lanes, Lanes]
"""One number a primary."""

ROULETTE_AFTER = 4
"""Bounces before a walk may be ended at random (unbiased: survivors count for the others)."""

Start = Callable[[Any], tuple[Hit, Vector]]
"""randomness -> the first points of walks, and the unit directions from there to the eye."""


class Source(ABC):
    """Light that walks collect."""

    @abstractmethod
    def value(self, room: Room, hit: Hit, to_eye: Vector, active: Lanes, rng: Any) -> Colour:
        """Direct value of points in the direction `to_eye` (unit vectors)."""


class Aim(Source):
    """Light that can be aimed at: see `domesim.pathtrace.sources.Picture`."""

    @abstractmethod
    def aim(self, room: Room, here: Hit, active: Lanes, rng: Any) -> Colour:
        """One aimed estimate of the mean value that Lambertian points see, less what walks find."""

    @abstractmethod
    def weighed(
        self, room: Room, hit: Hit, to_eye: Vector, active: Lanes, found: Lanes | None
    ) -> Colour:
        """Direct value of points found with a density, less what aiming has brought already."""


class Scatter(ABC):
    """How the screen scatters light if it is not Lambertian."""

    @abstractmethod
    def sample(
        self, normal: Vector, to_eye: Vector, rng: Any, active: Lanes
    ) -> tuple[Vector, Lanes]:
        """A direction to continue in, and the weight of the walk without the albedo."""


@final
@dataclass(frozen=True)
class Tally:
    """Sums over walks, lane by lane.

    Attributes
    ----------
    total, square
        (primary) sums and sums of squares of the walks' values, one a lane.
    bounces
        (primary) tables of (bounce, lane) sums, flattened, if asked for.
    steps
        Segments traced, one a lane.
    """

    total: Colour
    square: Colour
    bounces: Colour | None
    steps: Lanes


@final
class Walks:
    """Walks that begin at some points, one after the other in each lane.

    A launch goes on where the last one ended. So sums do not depend on the number of launches.

    Parameters
    ----------
    room, source, scatter
        The theatre, the light in it, and its screen (Lambertian if absent).
    start
        Where walks begin.
    count
        Walks of each lane, in (lane,) whole numbers or one for all.
    lanes
        Number of lanes.
    seed
        Seed of the random numbers.
    bounces
        Number of bounces after which walks end.
    first
        The first bounce that counts: 1 leaves out the direct value of the start.
    aim
        The source again, if walks are to aim at its light and not only to find it.
    per_bounce
        Keep sums by bounce as well.
    """

    def __init__(
        self,
        room: Room,
        start: Start,
        source: Source,
        *,
        count: NDArray[np.int64] | int,
        lanes: int,
        seed: int,
        bounces: int,
        first: int,
        scatter: Scatter | None = None,
        aim: Aim | None = None,
        per_bounce: bool = False,
    ) -> None:
        m = room.machine
        self._room, self._start, self._source = room, start, source
        self._scatter, self._aim = scatter, aim
        self._lanes, self._bounces, self._first = lanes, bounces, first
        self._lane = m.lanes(np.arange(lanes))
        self._count = m.lanes(np.broadcast_to(count, lanes))
        self._none = (m.full(0.0, lanes),) * 3
        self._table = None
        if per_bounce:
            self._table = tuple(m.full(0.0, (bounces + 1) * lanes) for _ in range(3))
        rng = m.randomness(seed, lanes)
        hit, to_eye, value = self._begun(rng, self._count > 0)
        state = {
            "rng": rng,
            "surface": hit.surface,
            "position": hit.position,
            "normal": hit.normal,
            "to_eye": to_eye,
            "weight": (m.full(1.0, lanes),) * 3,
            "value": value,
            "total": self._none,
            "square": self._none,
            "bounce": m.whole(0, lanes),
            "done": m.whole(0, lanes),
            "steps": m.whole(0, lanes),
        }
        # Before the loop, which is then compiled but once for all launches
        self._state = m.computed(state)

    def follow(self, count: int) -> None:
        """Go on until each lane has followed `count` walks since the beginning, or all of its."""
        m = self._room.machine
        until = m.minimum(self._count, m.parameter(count))

        def goes_on(state: dict[str, Any]) -> Lanes:
            return state["done"] < until

        end = m.loop(self._state, goes_on, lambda state: self._step(state, goes_on(state)))
        self._state = m.computed(end)

    @property
    def tally(self) -> Tally:
        """Sums over the walks so far."""
        state = self._state
        return Tally(state["total"], state["square"], self._table, state["steps"])

    def _begun(self, rng: Any, active: Lanes) -> tuple[Hit, Vector, Colour]:
        m = self._room.machine
        hit, to_eye = self._start(rng)
        alive = active & (hit.surface != NOTHING)
        if self._first > 0:
            return hit, to_eye, self._none
        value = self._source.value(self._room, hit, to_eye, alive, rng)
        if self._table is not None:
            for column, part in zip(self._table, value, strict=True):
                m.add_at(column, self._lane, part, alive)
        return hit, to_eye, value

    def _step(self, state: dict[str, Any], active: Lanes) -> dict[str, Any]:
        room, m, aim = self._room, self._room.machine, self._aim
        rng, surface = state["rng"], state["surface"]
        here = Hit(surface, state["position"], state["normal"])
        direction, weight, leaving = scattered(
            room, here, state["to_eye"], state["weight"], rng, self._scatter, active
        )
        bounce = state["bounce"] + 1
        aimed = self._none
        if aim is not None:
            # Through a hole, and from behind the screen, no aim is taken.
            takes = active & (surface != NOTHING) & (leaving == surface)
            takes = takes & (surface != SHELL) & (surface != BACK)
            aimed = times(weight, aim.aim(room, here, takes, rng))
        hit = room.hit(here.position, direction, leaving, active)
        back = scaled(direction, -1)
        alive = active & (hit.surface != NOTHING) & (surface != NOTHING) & (surface != BLACK)
        bright = alive & (hit.surface != BLACK)
        if aim is None:
            light = self._source.value(room, hit, back, bright, rng)
        else:
            gap = difference(hit.position, here.position)
            cosines = dot(here.normal, direction) * -dot(hit.normal, direction)
            density = cosines / (np.pi * m.maximum(dot(gap, gap), 1e-12))
            light = aim.weighed(
                room, hit, back, bright, m.where(takes, m.maximum(density, 0.0), 0.0)
            )
        parts = times(weight, light)
        parts = (m.where(alive, parts[0], 0.0) + aimed[0], m.where(alive, parts[1], 0.0) + aimed[1],
                 m.where(alive, parts[2], 0.0) + aimed[2])  # fmt: skip
        value = tuple(v + part for v, part in zip(state["value"], parts, strict=True))
        if self._table is not None:
            for column, part in zip(self._table, parts, strict=True):
                m.add_at(column, bounce * self._lanes + self._lane, part, active)
        ends = ~alive | (bounce >= self._bounces) | (hit.surface == BLACK)
        ends, weight = roulette(m, rng, weight, bounce, ends)
        over = ends & active
        # The last walk of a lane is followed by none.
        fresh, towards, first = self._begun(rng, over & (state["done"] + 1 < self._count))
        return {
            "rng": rng,
            "surface": m.where(over, fresh.surface, hit.surface),
            "position": chosen(m, over, fresh.position, hit.position),
            "normal": chosen(m, over, fresh.normal, hit.normal),
            "to_eye": chosen(m, over, towards, back),
            "weight": tuple(m.where(over, 1.0, w) for w in weight),
            "value": tuple(m.where(over, f, v) for f, v in zip(first, value, strict=True)),
            "total": tuple(
                t + m.where(over, v, 0.0) for t, v in zip(state["total"], value, strict=True)
            ),
            "square": tuple(
                q + m.where(over, v * v, 0.0) for q, v in zip(state["square"], value, strict=True)
            ),
            "bounce": m.where(over, 0, bounce),
            "done": state["done"] + m.where(over, 1, 0),
            "steps": state["steps"] + m.where(active, 1, 0),
        }


def times(left: Colour, right: Colour) -> Colour:
    """Product of colours."""
    return left[0] * right[0], left[1] * right[1], left[2] * right[2]


def difference(left: Vector, right: Vector) -> Vector:
    """The vector from `right` to `left`."""
    return left[0] - right[0], left[1] - right[1], left[2] - right[2]


def cosine_direction(machine: DrJit, normal: Vector, rng: Any) -> Vector:
    """Directions with the density cos / pi about `normal`: a point of the sphere that touches."""
    z = 1 - 2 * machine.uniform(rng)
    ring = machine.sqrt(machine.maximum(1 - z * z, 0.0))
    azimuth = machine.uniform(rng) * (2 * np.pi)
    point = (ring * machine.cos(azimuth), ring * machine.sin(azimuth), z)
    total = (point[0] + normal[0], point[1] + normal[1], point[2] + normal[2])
    return scaled(total, 1 / machine.sqrt(machine.maximum(dot(total, total), 1e-12)))


def bounce_limit(room: Room, tolerance: float) -> int:
    """Bounces after which less than `tolerance` of the indirect light is left.

    For a bare dome the ratio of successive bounces is rho A_s / (4 pi r²) (design section 3); in a
    room it is at most the largest albedo. Light may pass two holes in a row unweakened, but then
    meets the shell behind the screen.
    """
    largest = max(max(albedo) for albedo in room.albedos.values())
    dome = room.theatre.dome
    ratio = largest
    if room.only_screen and dome.height_ratio == 1:
        ratio = largest * dome.screen_area / (4 * np.pi * dome.radius**2)
    if room.has_cavity:
        holes = room.theatre.perforation
        kept = holes + (1 - holes) * largest
        ratio = max(largest, float(np.cbrt(kept**2 * max(room.albedos[SHELL]))))
    if ratio >= 1:
        raise InputError("surfaces of albedo 1 never end a path; lower the albedo below 1")
    if ratio <= 0:
        return 1
    return max(2, int(np.ceil(np.log(tolerance) / np.log(ratio))) + 1)


def scattered(
    room: Room,
    here: Hit,
    to_eye: Vector,
    weight: Colour,
    rng: Any,
    scatter: Scatter | None,
    active: Lanes,
) -> tuple[Vector, Colour, Lanes]:
    """Where walks go on from `here`: direction, weight, and the surface that they leave."""
    m = room.machine
    direction = cosine_direction(m, here.normal, rng)
    result, leaving = _albedo_times(room, here, weight), here.surface
    if scatter is not None:
        on_screen = here.surface == SCREEN
        glossy, share = scatter.sample(here.normal, to_eye, rng, active & on_screen)
        direction = chosen(m, on_screen, glossy, direction)
        result = scaled(result, m.where(on_screen, share, 1.0))
    if room.has_cavity:
        # A hole: straight on, to the other side
        screen = (here.surface == SCREEN) | (here.surface == BACK)
        passes = screen & (m.uniform(rng) < room.theatre.perforation)
        direction = chosen(m, passes, scaled(to_eye, -1), direction)
        result = chosen(m, passes, weight, result)
        leaving = m.where(passes, m.where(here.surface == SCREEN, BACK, SCREEN), here.surface)
    return direction, result, leaving


def _albedo_times(room: Room, here: Hit, weight: Colour) -> Colour:
    m, albedos, surface = room.machine, room.albedos, here.surface
    result = []
    factor = painted(room, here.position, surface == SCREEN)
    for p in range(3):
        rho: Any = albedos[SCREEN][p] * factor[p]
        for kind in (FLOOR, WALL, BACK, SHELL):
            if kind in albedos:
                rho = m.where(surface == kind, albedos[kind][p], rho)
        for k, solid in enumerate(room.theatre.solids):
            rho = m.where(surface == SOLID + k, solid.albedo[p], rho)
        result.append(weight[p] * rho)
    return result[0], result[1], result[2]


def painted(room: Room, position: Vector, active: Lanes) -> Colour:
    """What multiplies the albedo of places on the screen, in the active lanes."""
    one: Any = position[0] * 0 + 1
    if room.theatre.paint is None:
        return one, one, one
    pixel = pixel_of(room, position, len(room.theatre.paint.factors))
    factors, _ = room.machine.colour_at(room.painted, pixel, active)
    x, y, z = (room.machine.where(active, factor, 1.0) for factor in factors)
    return x, y, z


def pixel_of(room: Room, position: Vector, size: int) -> Lanes:
    """Index (row-major) of the domemaster pixel that a point of the room lies behind."""
    m = room.machine
    u, v = room.disc(position)

    def number(place: Lanes) -> Lanes:
        return m.index(m.maximum(m.minimum((place + 1) * (size / 2), size - 0.5), 0.0))

    return number(v) * size + number(u)


def roulette(
    m: DrJit, rng: Any, weight: Colour, bounce: Lanes, ends: Lanes
) -> tuple[Lanes, Colour]:
    """End long walks of little weight at random; those that go on count for them."""
    largest = m.maximum(m.maximum(weight[0], weight[1]), weight[2])
    survival = m.where(bounce < ROULETTE_AFTER, 1.0, m.minimum(largest * 4, 0.98))
    survival = m.maximum(survival, 1e-3)
    ends = ends | (m.uniform(rng) >= survival)
    return ends, (weight[0] / survival, weight[1] / survival, weight[2] / survival)


def eye_directions(room: Room, position: Vector, eye: tuple[float, float, float]) -> Vector:
    """Unit vectors from points of the room to an eye (in units of the radius)."""
    away = tuple(e - p for e, p in zip(eye, position, strict=True))
    vector = (away[0], away[1], away[2])
    return scaled(vector, 1 / room.machine.sqrt(room.machine.maximum(dot(vector, vector), 1e-12)))
