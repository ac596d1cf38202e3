"""Published cases of light by diffuse surfaces, CIE 171:2006 [1], by walks and by form factors.

They are built of our solids and lamps: an area source (5.3), reflection by a surface (5.6, scenario
2), by one behind an obstruction (5.7), and all bounces in a cube (5.8). Two of its daylight terms
are other things: a surface that is lit evenly, and a point source, are written here as sources of
walks. Figures of 5.7 are the corrected ones: the printed table is wrong, as a validation of another
program found [2]. The report itself is not public. Its tables are taken from a public transcription
[3], and each figure is computed here once more, by form factors, and by Radiance.

[1] CIE 171:2006, *Test cases to assess the accuracy of lighting computer programs*, tables 12, 17,
19 and 20. [2] Dau Design and Consulting, *Validation of NVIDIA Iray against CIE 171:2006* (2016),
table 14. [3] J. Thompson, CyclesCIEtest, `engine/cie171`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.pathtrace.loop import Colour, Source, Walks, bounce_limit, cosine_direction
from domesim.pathtrace.tracer import Tracer
from domesim.room.dome import Dome
from domesim.room.furniture import box
from domesim.room.rays import NOTHING, SOLID, Hit, Lanes, Room, Vector, dot, scaled
from domesim.room.theatre import Lamp, Solid, Theatre
from testing.statistics import bias_p
from validation import radiance
from validation.experiment import Check, Column, Table, at_least, at_most

Floats = NDArray[np.float64]

LANES = 1 << 14
SIDE, FLUX = 4.0, 10_000.0
"""Side of the cube of case 5.8, m, and flux of the source in its middle, lm."""

AREA_SOURCE = (
    32.68, 75.09, 81.38, 69.12, 53.41, 39.90,
    61.27, 79.18, 95.52, 105.89, 105.89, 95.52, 79.18, 61.27,
)  # fmt: skip
"""Table 12, lux: A to F down a wall, G to N across the floor."""
REFLECTED = (
    35.901, 27.992, 21.639, 16.716, 12.967,
    26.80, 30.94, 33.98, 35.57, 35.57, 33.98, 30.94, 26.80,
)  # fmt: skip
"""Table 17, % of what is reflected: B to F up the wall, G to N across the ceiling."""
OBSTRUCTED = (16.07, 16.33, 15.40, 13.32, 10.32, 7.08, 3.38, 3.63, 3.01, 0.0, 0.0)
"""Table 19 as corrected, % likewise: A to F down the wall, G to K across the floor."""
BOUNCED = {
    0.05: 5.48, 0.1: 11.6, 0.2: 26.0, 0.3: 44.6, 0.4: 69.4, 0.5: 104.0, 0.6: 156.0, 0.7: 243.0,
    0.8: 417.0, 0.9: 937.0, 0.95: 1979.0,
}  # fmt: skip
"""Table 20: albedo -> mean illuminance by reflected light, lux."""


@final
@dataclass(frozen=True)
class Found:
    """One figure, by everyone who has it.

    Attributes
    ----------
    published
        By CIE 171.
    analytic
        By form factors.
    ours, error
        By walks, and its standard error.
    other, other_error
        By Radiance, likewise; None if it was not asked.
    """

    published: float
    analytic: float
    ours: float
    error: float
    other: float | None = None
    other_error: float | None = None


@final
@dataclass(frozen=True)
class Rectangle:
    """A part of a plane: one corner and two edges, m."""

    corner: tuple[float, float, float]
    along: tuple[float, float, float]
    up: tuple[float, float, float]

    def solid(self, name: str, albedo: float) -> Solid:
        """The same as a thing that reflects."""
        a, b, c = (np.array(part) for part in (self.corner, self.along, self.up))
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        return Solid(name, np.stack([a, a + b, a + b + c, a + c]), faces, (albedo,) * 3)

    def seen_from(self, place: Floats, normal: Floats) -> float:
        """Form factor from a point: the share of what it sees, by 64 x 64 Gauss points."""
        nodes, weights = np.polynomial.legendre.leggauss(64)
        s, t = np.meshgrid((nodes + 1) / 2, (nodes + 1) / 2)
        points = np.array(self.corner) + s[..., None] * self.along + t[..., None] * self.up
        apart = points - place
        square = np.sum(apart**2, -1)
        across = np.cross(self.along, self.up)
        cosines = np.maximum(apart @ normal, 0) * np.abs(apart @ across)
        return float(np.outer(weights, weights).ravel() @ (cosines / square**2).ravel()) / 4 / np.pi


GROUND = Rectangle((0, 0, 0), (4, 0, 0), (0, 4, 0))
FACING = Rectangle((0, 4, 0), (4, 0, 0), (0, 0, 3))
CEILING_LIGHT = Rectangle((1.5, 1.5, 3), (1, 0, 0), (0, 1, 0))
LOW, HIGH = (0.0, 2.5, 0.0), (4.0, 2.7, 1.0)
"""Lowest and highest corner of the black box before the lit wall, m."""
WALL_AT = Rectangle((0, 0, 0), (4, 0, 0), (0, 0, 3))


@final
class Even(Source):
    """The first solid sends 1 everywhere."""

    def value(self, room: Room, hit: Hit, to_eye: Vector, active: Lanes, rng: Any) -> Colour:
        """Direct value of points."""
        one = room.machine.where(active & (hit.surface == SOLID), 1.0, 0.0)
        return one, one, one


@final
@dataclass(frozen=True)
class Bulb(Source):
    """A point source in the middle of a cube of one albedo; values are exitances, lm/m²."""

    albedo: float

    def value(self, room: Room, hit: Hit, to_eye: Vector, active: Lanes, rng: Any) -> Colour:
        """Direct value of points."""
        m = room.machine
        square = m.maximum(dot(hit.position, hit.position), 1e-12)
        cosine = m.maximum(-dot(hit.position, hit.normal), 0.0) / m.sqrt(square)
        over = self.albedo * FLUX / (4 * np.pi * room.theatre.dome.radius**2)
        light = m.where(active & (hit.surface == SOLID), over * cosine / square, 0.0)
        return light, light, light


def stage(*solids: Solid, lamps: tuple[Lamp, ...] = ()) -> Theatre:
    """Things in the dark: a theatre whose screen is small, black and far above."""
    return Theatre(Dome(10.0, 0.01), (0.0, 0.0, 0.0), solids=solids, lamps=lamps)


def arriving(
    theatre: Theatre, source: Source, places: Floats, normals: Floats, count: int, seed: int
) -> tuple[Floats, Floats]:
    """(point,) mean value of what points see, weighed by cosines, and its standard error."""
    tracer = Tracer(theatre)
    m, room = tracer.machine, tracer.room
    each = -(-LANES // len(places))
    position, upright = (
        vector(tracer, np.repeat(part, each, 0)) for part in (places / theatre.dome.radius, normals)
    )
    air = m.whole(NOTHING, each * len(places))

    def start(rng: Any) -> tuple[Hit, Vector]:
        ray = cosine_direction(m, upright, rng)
        return room.hit(position, ray, air, air == NOTHING), scaled(ray, -1)

    walks = Walks(
        room, start, source, count=count, lanes=each * len(places), seed=seed,
        bounces=bounce_limit(room, 1e-6), first=0,
    )  # fmt: skip
    walks.follow(count)
    total, square = (
        m.array(part[0]).reshape(len(places), each).astype(np.float64).sum(1) / (each * count)
        for part in (walks.tally.total, walks.tally.square)
    )
    return total, np.sqrt(np.maximum(square - total**2, 0) / (each * count))


def vector(tracer: Tracer, points: Floats) -> Vector:
    """Points (point, xyz) as lanes."""
    x, y, z = (tracer.machine.lanes(np.ascontiguousarray(points[:, k])) for k in range(3))
    return x, y, z


def row_of(where: str, heights: Floats, normal: tuple[float, float, float]) -> tuple[Floats, ...]:
    """Points in the middle of a wall, floor or ceiling, and their normals."""
    middle = np.full_like(heights, 2.0)
    still = np.full_like(heights, 3.0 if where == "ceiling" else 0.0)
    order = (middle, still, heights) if where == "wall" else (middle, heights, still)
    return np.stack(order, -1), np.tile(np.array(normal, float), (len(heights), 1))


def points_of(*rows: tuple[Floats, ...]) -> tuple[Floats, Floats]:
    """Rows of points, one after the other."""
    places, normals = (np.concatenate(part) for part in zip(*rows, strict=True))
    return places, normals


INTO, UP, DOWN = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
ACROSS = np.arange(8) / 2 + 0.25


def area_source(count: int, seed: int) -> list[Found]:
    """Case 5.3: illuminance by a lamp of 1 m², of 1000 cd/m²."""
    places, normals = points_of(row_of("wall", np.arange(5, -1, -1) / 2 + 0.25, INTO),
                                row_of("floor", ACROSS, UP))  # fmt: skip
    lamp = Lamp("light", (2, 2, 3), (0.5, 0, 0), (0, -0.5, 0), (1000.0,) * 3)
    theatre = stage(GROUND.solid("ground", 0.5), WALL_AT.solid("wall", 0.5), lamps=(lamp,))
    tracer = Tracer(theatre)
    m = tracer.machine
    each = count * LANES // len(places)
    position = vector(tracer, np.repeat(places / theatre.dome.radius, each, 0))
    upright = vector(tracer, np.repeat(normals, each, 0))
    surface = m.whole(SOLID, each * len(places))
    rng = m.randomness(seed, each * len(places))
    shown = tracer.lamps().value(
        tracer.room, Hit(surface, position, upright), upright, surface == SOLID, rng
    )
    lux = np.pi / 0.5 * m.array(shown[0]).astype(np.float64).reshape(len(places), each)
    analytic = [
        1000 * np.pi * CEILING_LIGHT.seen_from(*one) for one in zip(places, normals, strict=True)
    ]
    error = lux.std(1, ddof=1) / np.sqrt(each)
    return _founds(AREA_SOURCE, analytic, lux.mean(1), error, None)


def reflected_factors() -> tuple[Floats, Floats, list[float]]:
    """Points of case 5.6, their normals, and the form factor of the ground from each."""
    places, normals = points_of(row_of("wall", np.arange(1, 6) / 2 + 0.25, INTO),
                                row_of("ceiling", ACROSS, DOWN))  # fmt: skip
    found = [GROUND.seen_from(*one) for one in zip(places, normals, strict=True)]
    return places, normals, found


def reflection(count: int, seed: int, *, asked: bool) -> list[Found]:
    """Case 5.6, scenario 2: what a lit ground of 4 m x 4 m sends to wall and ceiling, %."""
    places, normals, factors = reflected_factors()
    found = arriving(stage(GROUND.solid("ground", 0.3)), Even(), places, normals, count, seed)
    other = _by_radiance(_glowing(GROUND), places, normals, count) if asked else None
    return _founds(REFLECTED, factors, *found, other, scale=100)


def obstructed_factors() -> tuple[Floats, Floats, list[float]]:
    """Points of case 5.7, their normals, and the form factor of the wall past the box."""
    places, normals = points_of(row_of("wall", np.arange(5, -1, -1) / 2 + 0.25, INTO),
                                row_of("floor", ACROSS[:5], UP))  # fmt: skip
    found = []
    for place, normal in zip(places, normals, strict=True):
        # As wide as the wall, it hides all that is lower than its upper edges, seen from there.
        _, y, z = place
        edges = [z + (HIGH[2] - z) * (4 - y) / (at - y) for at in (LOW[1], HIGH[1])]
        edge = min(max(*edges, 0.0), 3.0)
        seen = replace(FACING, corner=(0, 4, edge), up=(0, 0, 3 - edge))
        found.append(seen.seen_from(place, normal) if edge < 3 else 0.0)
    return places, normals, found


def obstruction(count: int, seed: int, *, asked: bool) -> list[Found]:
    """Case 5.7: what a lit wall sends past a black box, %."""
    places, normals, factors = obstructed_factors()
    before = box("box", LOW, HIGH, (0.0, 0.0, 0.0))
    theatre = stage(FACING.solid("wall", 0.6), before)
    found = arriving(theatre, Even(), places, normals, count, seed)
    text = _glowing(FACING) + radiance.paint("black", (0, 0, 0)) + "\n"
    for number, corners in enumerate(before.vertices[before.faces]):
        text += f"black polygon face{number}\n0\n0\n9 {' '.join(map(str, corners.ravel()))}\n"
    other = _by_radiance(text, places, normals, count) if asked else None
    return _founds(OBSTRUCTED, factors, *found, other, scale=100)


def cube(albedo: float, count: int, seed: int, *, asked: bool) -> Found:
    """Case 5.8: mean illuminance by light that has bounced, in a cube of 4 m, lux."""
    half, rng = SIDE / 2, np.random.default_rng(seed)
    room = box("cube", (-half,) * 3, (half,) * 3, (albedo,) * 3)
    places = rng.uniform(-half, half, (LANES, 3))
    side, face = rng.choice([-1.0, 1.0], LANES), rng.integers(0, 3, LANES)
    normals = np.zeros((LANES, 3))
    normals[np.arange(LANES), face] = -side
    places[np.arange(LANES), face] = side * (half - 1e-4)
    light, _ = arriving(stage(room), Bulb(albedo), places, normals, count, seed)
    analytic = FLUX / (6 * SIDE**2) * albedo / (1 - albedo)
    error = float(light.std(ddof=1) / np.sqrt(LANES))
    other = None
    if asked:
        small = 1e-3
        shining = FLUX / (4 * np.pi) / (np.pi * small**2)
        text = radiance.paint("paint", (albedo,) * 3)
        for number, corners in enumerate(room.vertices[room.faces]):
            text += f"\npaint polygon f{number}\n0\n0\n9 {' '.join(map(str, corners.ravel()))}"
        text += f"\nvoid light lamp\n0\n0\n3 {shining} {shining} {shining}\n"
        text += f"lamp sphere bulb\n0\n0\n4 0 0 0 {small}\n"
        rays = np.concatenate([places, normals], 1)
        both = [radiance.traced(text, rays, bounces=n, irradiance=True)[:, 0] for n in (400, 0)]
        lux = both[0] - both[1]
        other = np.array([lux.mean()]), np.array([lux.std(ddof=1) / np.sqrt(LANES)])
    ours = np.array([light.mean()]), np.array([error])
    return _founds((BOUNCED[albedo],), [analytic], *ours, other)[0]


def cases(count: int, seed: int, *, asked: bool) -> dict[str, Callable[[], list[Found]]]:
    """The cases, by name.

    Parameters
    ----------
    count, seed
        How many walks, in units of `LANES`, and the seed of their random numbers.
    asked
        Whether Radiance is asked, too.
    """

    def cubes() -> list[Found]:
        return [cube(rho, max(1, count // 8), seed, asked=asked) for rho in BOUNCED]

    return {
        "5.3 area source": partial(area_source, count, seed),
        "5.6 diffuse reflection": partial(reflection, 4 * count, seed, asked=asked),
        "5.7 with an obstruction": partial(obstruction, 8 * count, seed, asked=asked),
        "5.8 all bounces": cubes,
    }


LETTERS: Mapping[str, Sequence[str]] = {
    "5.3 area source": "ABCDEFGHIJKLMN",
    "5.6 diffuse reflection": "BCDEFGHIJKLMN",
    "5.7 with an obstruction": "ABCDEFGHIJK",
    "5.8 all bounces": [f"albedo {rho:g}" for rho in BOUNCED],
}
"""Case -> its points."""


def checks(name: str, found: Sequence[Found]) -> Iterator[Check]:
    """Whether a case came out as it was published."""
    beyond = max(off(one, allowed=3 * one.error) for one in found)
    yield at_most(f"{name}: difference beyond three standard errors", beyond, 5e-3)
    lit = [one for one in found if one.analytic]
    p = bias_p(*zip(*[(one.ours, one.error, one.analytic) for one in lit], strict=True))
    yield at_least(f"{name}: p-value of no bias", min(p), 5e-4)
    if found[0].other is not None:
        far = max(abs(_apart(one)) for one in lit)
        yield at_most(f"{name}: standard errors from Radiance", far, 4.0)


def table(cases: Mapping[str, Sequence[Found]]) -> Table:
    """All figures, by everyone who has them."""
    return Table(
        caption="CIE 171:2006: illuminance, lux (5.3, 5.8), or % of what is reflected (5.6, 5.7).",
        columns=(
            Column(name="case"), Column(name="point"), Column(name="published", digits=".5g"),
            Column(name="form factors", digits=".5g"), Column(name="ours", digits=".5g"),
            Column(name="standard error", digits=".1g"), Column(name="Radiance", digits=".4g"),
            Column(name="its error", digits=".1g"),
            Column(name="ours - published", unit="%", digits="+.2f"),
        ),
        rows=tuple(
            (
                name, letter, one.published, one.analytic, one.ours, one.error, one.other,
                one.other_error,
                100 * (one.ours / one.published - 1) if one.published else None,
            )
            for name, found in cases.items()
            for letter, one in zip(LETTERS[name], found, strict=True)
        ),
    )  # fmt: skip


def _founds(
    published: tuple[float, ...],
    analytic: list[float],
    mean: Floats,
    error: Floats,
    other: tuple[Floats, Floats] | None,
    scale: float = 1.0,
) -> list[Found]:
    found = [
        Found(known, scale * form, float(scale * light), float(scale * spread))
        for known, form, light, spread in zip(published, analytic, mean, error, strict=True)
    ]
    if other is None:
        return found
    return [
        replace(one, other=float(scale * light), other_error=float(scale * spread))
        for one, light, spread in zip(found, *other, strict=True)
    ]


def _glowing(shape: Rectangle) -> str:
    """For Radiance: a surface that sends 1 everywhere, and is found by chance alone."""
    corners = shape.solid("", 0.0).vertices
    return (
        "void glow even\n0\n0\n4 1 1 1 0\n"
        f"even polygon lit\n0\n0\n12 {' '.join(map(str, corners.ravel()))}\n"
    )


def _by_radiance(text: str, places: Floats, normals: Floats, count: int) -> tuple[Floats, Floats]:
    each = 64 * count
    rays = np.repeat(np.concatenate([places + 1e-4 * normals, normals], 1), each, 0)
    light = radiance.traced(text, rays, bounces=1, irradiance=True)[:, 0] / np.pi
    light = light.reshape(len(places), each)
    return light.mean(1), light.std(1, ddof=1) / np.sqrt(each)


def off(one: Found, allowed: float = 0.0) -> float:
    """Relative difference from the published value, but for what is allowed; of nothing, all."""
    return max(abs(one.ours - one.published) - allowed, 0.0) / (one.published or 1.0)


def _apart(one: Found) -> float:
    """Standard errors between ours and Radiance's."""
    assert one.other is not None
    assert one.other_error is not None
    return (one.ours - one.other) / float(np.hypot(one.error, one.other_error))
