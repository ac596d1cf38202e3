"""Whether projectors emit as much light as surfaces absorb and as leaves the theatre.

Where projectors' light lands first is found by rays from the lenses. Light that has been reflected
is gathered by the product's walks: those that arrive at points of a surface, and those that leave
it and meet nothing more. Powers are in units of the light on 1 (radius of the dome)² of white.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.pathtrace.loop import Walks, bounce_limit, cosine_direction
from domesim.pathtrace.tracer import Tracer
from domesim.room.lenses import lens_gains
from domesim.room.rays import BACK, BLACK, FLOOR, NOTHING, SHELL, SOLID, WALL, Hit
from domesim.room.rays import SCREEN as FRONT
from domesim.room.theatre import Theatre

Floats = NDArray[np.float64]

LANES = 1 << 13
LEAST, MOST = 64, 1600
SIZE = 256


@final
@dataclass(frozen=True)
class Patch:
    """A kind of surface: its area, albedo, and points spread over it with weights of mean 1."""

    kind: int
    area: float
    albedo: Floats
    points: Callable[[np.random.Generator], tuple[Floats, Floats, Floats]]


def patches(tracer: Tracer) -> Iterator[Patch]:
    """All surfaces of a theatre; the screen's front is the first."""
    theatre, unit = tracer.theatre, tracer.theatre.dome.radius
    dome = theatre.dome

    def screen(rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
        theta = np.arccos(1 - rng.random(LANES) * (1 - np.cos(dome.half_angle)))
        start, extent = dome.kept_azimuth(theta)
        azimuth = start + extent * rng.random(LANES)
        cap = 2 * np.pi * (1 - np.cos(dome.half_angle))
        weight = dome.area_density(theta) * extent / (2 * np.pi) * cap / dome.screen_area
        radius = theta / dome.half_angle
        m = tracer.machine
        u, v = (m.lanes(radius * part) for part in (np.cos(azimuth), np.sin(azimuth)))
        place, normal = (
            np.stack([m.array(part) for part in vector], -1)
            for vector in tracer.room.screen_at(u, v)
        )
        return place, normal, weight

    def behind(rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
        place, normal, weight = screen(rng)
        return place, -normal, weight

    def shell(rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
        place, normal, weight = screen(rng)
        assert theatre.cavity is not None
        return place * (1 + theatre.cavity.depth / unit), normal, weight

    def floor(rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
        assert theatre.floor is not None
        ring = theatre.floor.radius / unit * np.sqrt(rng.random(LANES))
        turn = 2 * np.pi * rng.random(LANES)
        level = np.full(LANES, theatre.floor.height / unit)
        up = np.broadcast_to([0.0, 0.0, 1.0], (LANES, 3))
        return np.stack([ring * np.cos(turn), ring * np.sin(turn), level], -1), up, np.ones(LANES)

    def wall(rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
        assert theatre.wall is not None
        turn = 2 * np.pi * rng.random(LANES)
        inward = np.stack([-np.cos(turn), -np.sin(turn), 0 * turn], -1)
        height = rng.uniform(theatre.wall.bottom / unit, theatre.wall.top / unit, LANES)
        place = -inward * theatre.wall.radius / unit
        place[:, 2] = height
        return place, inward, np.ones(LANES)

    area = dome.screen_area / unit**2
    yield Patch(FRONT, area, np.array(theatre.screen_albedo), screen)
    if tracer.room.has_cavity:
        assert theatre.cavity is not None
        yield Patch(BACK, area, np.array(theatre.cavity.back_albedo), behind)
        outer = area * (1 + theatre.cavity.depth / unit) ** 2
        yield Patch(SHELL, outer, np.array(theatre.cavity.albedo), shell)
    if theatre.floor is not None:
        yield Patch(
            FLOOR, np.pi * (theatre.floor.radius / unit) ** 2, np.array(theatre.floor.albedo), floor
        )
    if theatre.wall is not None:
        height = (theatre.wall.top - theatre.wall.bottom) / unit
        around = 2 * np.pi * theatre.wall.radius / unit
        yield Patch(WALL, around * height, np.array(theatre.wall.albedo), wall)
    yield from things(tracer)


def things(tracer: Tracer) -> Iterator[Patch]:
    """Both sides of each solid."""
    theatre, unit = tracer.theatre, tracer.theatre.dome.radius
    for number, solid in enumerate(theatre.solids):
        corners = solid.vertices[solid.faces] / unit
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        sizes = np.linalg.norm(cross, axis=-1) / 2

        def both_sides(
            rng: np.random.Generator,
            corners: Floats = corners,
            cross: Floats = cross,
            sizes: Floats = sizes,
        ) -> tuple[Floats, Floats, Floats]:
            face = rng.choice(len(sizes), LANES, p=sizes / sizes.sum())
            a, b = np.sort(rng.random((2, LANES)), axis=0)
            share = np.stack([a, b - a, 1 - b], -1)
            place = np.einsum("nk,nkx->nx", share, corners[face])
            side = rng.choice([-1.0, 1.0], LANES)[:, None]
            normal = side * cross[face] / (2 * sizes[face][:, None])
            return place + 1e-5 * normal, normal, np.ones(LANES)

        yield Patch(SOLID + number, 2 * sizes.sum(), np.array(solid.albedo), both_sides)


def landing(tracer: Tracer, rng: np.random.Generator) -> tuple[Floats, dict[int, Floats]]:
    """Light that projectors emit, and where it is stopped: (batch,) powers, by kind of surface."""
    theatre, m, unit = tracer.theatre, tracer.machine, tracer.theatre.dome.radius
    front = next(iter(patches(tracer)))
    place, _, weight = front.points(rng)
    pixel = theatre.dome.pixel_of(theatre.dome.toward(place), SIZE)
    thrown = lens_gains(theatre, SIZE, SIZE)[:, *pixel] * weight * front.area
    where = [lens.position for lens in theatre.lenses] or [(0.0, 0.0, 0.0)]
    found: dict[int, Floats] = {}

    def add(kinds: NDArray[np.int64], power: Floats) -> None:
        for kind in np.unique(kinds):
            found[kind] = found.get(kind, np.zeros(LANES)) + np.where(kinds == kind, power, 0)

    for lens, power in zip(where, thrown, strict=True):
        ray = place - np.divide(lens, unit)
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        direction = vector(tracer, ray)
        origin = tuple(m.full(part / unit, LANES) for part in lens)
        air = m.whole(NOTHING, LANES)
        hit = tracer.room.hit(origin, direction, air, air == NOTHING)
        kinds = m.array(hit.surface).astype(int)
        if tracer.room.has_cavity:
            beyond = tracer.room.hit(hit.position, direction, m.whole(BACK, LANES), air == NOTHING)
            holes = np.where(kinds == FRONT, theatre.perforation * power, 0)
            add(m.array(beyond.surface).astype(int), holes)
        add(kinds, power)
    return thrown.sum(0), found


def vector(tracer: Tracer, points: Floats) -> Any:
    """Points (point, xyz) as lanes."""
    return tuple(tracer.machine.lanes(np.ascontiguousarray(points[:, k])) for k in range(3))


def gathered(
    tracer: Tracer, source: Any, surfaces: Sequence[Patch], seed: int, *, leaving: bool
) -> Floats:
    """(patch, primary) light that arrives at surfaces, or leaves them for nowhere."""
    m, limit = tracer.machine, bounce_limit(tracer.room, 1e-5)
    rng, count = np.random.default_rng(seed), len(surfaces) * LANES
    drawn = [patch.points(rng) for patch in surfaces]
    place, normal, weight = (np.concatenate(part) for part in zip(*drawn, strict=True))
    position, upright = vector(tracer, place), vector(tracer, normal)
    # All in one launch: each is compiled anew.
    surface = m.lanes(np.repeat([patch.kind for patch in surfaces], LANES))

    def start(rng: Any) -> tuple[Hit, Any]:
        ray = cosine_direction(m, upright, rng)
        met = tracer.room.hit(position, ray, surface, surface < SOLID + 64)
        if not leaving:
            return met, tuple(-part for part in ray)
        lost = (met.surface == NOTHING) | (met.surface == BLACK)
        return Hit(m.where(lost, surface, NOTHING), position, upright), ray

    walks = Walks(
        tracer.room, start, source, count=1, lanes=count, seed=seed, bounces=limit, first=0
    )
    walks.follow(1)
    light = np.stack([m.array(part) for part in walks.tally.total], -1) * weight[:, None]
    areas = np.array([patch.area for patch in surfaces])
    means = light.reshape(len(surfaces), LANES, 3).mean(1) * areas[:, None]
    return np.asarray(means * np.array(tracer.theatre.screen_albedo))


def once(tracer: Tracer, source: Any, seed: int) -> Floats:
    """(primary,) share of the emitted light that is neither absorbed nor lost, by one batch."""
    theatre, surfaces = tracer.theatre, list(patches(tracer))
    emitted, landed = landing(tracer, np.random.default_rng(seed))
    lost = sum(landed.get(kind, np.zeros(LANES)).mean() for kind in (NOTHING, BLACK))
    left = emitted.mean() - np.full(3, lost)
    arriving, gone = (
        gathered(tracer, source, surfaces, 2 * seed + k, leaving=bool(k)) for k in range(2)
    )
    for patch, arrived in zip(surfaces, arriving, strict=True):
        kept = 1 - patch.albedo
        if tracer.room.has_cavity and patch.kind in (FRONT, BACK):
            paint = theatre.albedo if patch.kind == FRONT else patch.albedo
            kept = (1 - theatre.perforation) * (1 - np.array(paint))
        left = left - kept * (arrived + landed.get(patch.kind, np.zeros(LANES)).mean())
    return np.asarray((left - gone.sum(0)) / emitted.mean())


def dimmed(theatre: Theatre) -> Theatre:
    """The theatre without lamps, without lobes (they lose energy), and with albedos up to 0.8."""

    def dim(albedo: Any) -> Any:
        return tuple(min(each, 0.8) for each in albedo)

    return replace(
        theatre,
        lamps=(),
        lobe=None,
        floor=theatre.floor and replace(theatre.floor, albedo=dim(theatre.floor.albedo)),
        wall=theatre.wall and replace(theatre.wall, albedo=dim(theatre.wall.albedo)),
    )


def imbalance(
    theatre: Theatre, error: float, least: int = LEAST, most: int = MOST
) -> tuple[Floats, Floats]:
    """How much of the light that is emitted is missing.

    Parameters
    ----------
    theatre
        The theatre. Its lamps are off, its screen Lambertian and no albedo above 0.8.
    error
        Standard error to reach, as a share of what is emitted.
    least, most
        Fewest and most batches of walks. Of a few, an error that happens to be small would end it.

    Returns
    -------
    off, error
        (primary,) share that is missing, and its standard error.
    """
    tracer = Tracer(dimmed(theatre))
    source = tracer.picture(np.ones((SIZE, SIZE, 3), np.float32))
    found: list[Floats] = []
    while len(found) < most:
        found.append(once(tracer, source, len(found)))
        spread = np.std(found, axis=0, ddof=1) if len(found) >= least else np.full(3, np.inf)
        if spread.max() / np.sqrt(len(found)) < error:
            break
    return np.mean(found, axis=0), spread / np.sqrt(len(found))
