"""The machine, as a function of time: planets and moons, and the metal that holds them.

The orrery has a frame of its own, with the sun in its origin and its axis along z; `FRAME` and
`CENTRE` place it in the hall, leaning towards the audience. All lengths are in metres; x is to the
right, y to the front and z up. After `Orrery.loop` seconds everything is where it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from domesim.errors import InputError
from domesim.pathtrace.solids import (
    Triangles,
    ball,
    box,
    join,
    lathe,
    moved,
    ring,
    tube,
    turned,
)
from scenes.artwork.night.noise import Floats

CENTRE = np.array([0.0, 3.2, 6.6])
"""Place of the sun in the hall, m."""

LEAN = np.radians(15.0)
FRAME = np.array(
    [[1, 0, 0], [0, np.cos(LEAN), -np.sin(LEAN)], [0, np.sin(LEAN), np.cos(LEAN)]]
)  # fmt: skip
"""(3, 3) rotation from the orrery's frame to the hall's."""

SUN_RADIUS = 0.72
_SPIDER = 1.55  # height of the wheel that carries the rails
_OUTER = 10.3  # radius of the graduated ring
_SHAFT = 9.2
_UP = np.array([0.0, 0.0, 1.0])


@final
@dataclass(frozen=True)
class Body:
    """A planet, or a moon.

    Parameters
    ----------
    name
        Which surface it has.
    radius
        Radius of the ball, m.
    orbit
        Radius of its orbit, m.
    turns
        Revolutions in a loop.
    phase
        Where it starts, turns.
    spins
        Turns about its own axis in a loop.
    tilt
        Tilt of that axis, degrees.
    moons
        Bodies that go round it.
    """

    name: str
    radius: float
    orbit: float
    turns: int
    phase: float
    spins: int = 12
    tilt: float = 0.0
    moons: tuple[Body, ...] = ()


PLANETS = (
    Body("ember", 0.17, 1.60, 7, 0.30, tilt=2.0),
    Body("pearl", 0.27, 2.35, -5, 0.62, spins=-6, tilt=12.0),
    Body("ocean", 0.32, 3.30, 4, 0.86, spins=16, tilt=23.0, moons=(
        Body("grey moon", 0.09, 0.52, 12, 0.1),)),
    Body("rust", 0.24, 4.45, 3, 0.17, tilt=25.0, moons=(
        Body("grey moon", 0.05, 0.36, 18, 0.6), Body("ice moon", 0.04, 0.46, 11, 0.2))),
    Body("giant", 0.66, 6.10, 2, 0.40, spins=20, tilt=3.0, moons=(
        Body("ice moon", 0.07, 0.88, 15, 0.9), Body("amber moon", 0.08, 1.08, 9, 0.35))),
    Body("ringed", 0.50, 8.75, 1, 0.70, spins=18, tilt=27.0, moons=(
        Body("amber moon", 0.09, 1.32, 7, 0.15),)),
)  # fmt: skip

RINGS = ((0.64, 0.76, 0.30), (0.78, 0.96, 0.85), (1.00, 1.13, 0.60), (1.15, 1.18, 0.35))
"""Rings of the ringed planet: inner and outer radius (m), and brightness."""


@final
@dataclass(frozen=True)
class Placed:
    """A body at one moment.

    Parameters
    ----------
    body
        Which.
    centre
        (xyz) in the hall, m.
    axes
        (3, 3): its own frame in the hall, spun and tilted.
    """

    body: Body
    centre: Floats
    axes: Floats


@final
@dataclass(frozen=True)
class Orrery:
    """What is filmed.

    Parameters
    ----------
    seed
        Seed of everything random: where the planets start, their surfaces, the stars.
    loop
        Seconds after which everything is where it was.
    """

    seed: int = 7
    loop: float = 60.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.loop) and self.loop > 0):
            raise InputError(f"the orrery's loop must be above 0 s, got {self.loop:g} s")
        if not 0 <= self.seed < 2**31:
            raise InputError(f"the orrery's seed must be 0 to {2**31 - 1}, got {self.seed}")

    def bodies(self, time: float) -> list[Placed]:
        """Planets and moons at `time` (s)."""
        part = time / self.loop
        placed = []
        for planet, turn in zip(PLANETS, self._turns(part), strict=True):
            # A planet leans away from the sun, whose light then falls on the rings from below.
            leaning = _turned(turn) @ _leaning(planet.tilt)
            centre = planet.orbit * _toward(turn)
            placed.append(_placed(planet, centre, leaning @ _turned(planet.spins * part)))
            for moon in planet.moons:
                around = moon.orbit * _toward(moon.phase + moon.turns * part)
                placed.append(_placed(moon, centre + leaning @ around, leaning))
        return placed

    def machine(self, time: float) -> Triangles:
        """The metal that moves: arms, struts, trolleys and gear wheels, in the hall."""
        part = time / self.loop
        solids = []
        for number, (planet, turn) in enumerate(zip(PLANETS, self._turns(part), strict=True)):
            rail = _rail_height(planet) * _UP
            out = planet.orbit * _toward(turn)
            gear = _gear(0.30 + 0.035 * number, 24 + 6 * number, rail[2] - 0.03, 0.06)
            solids += [
                tube(0.1 * _toward(turn) + rail, out + rail, (0.022, 0.016)),
                tube(out + 0.9 * planet.radius * _UP, out + rail, (0.014, 0.014)),
                ball(out + rail, 0.055, 12),
                turned(gear, -360.0 * turn),  # `turned` goes clockwise
            ]
            leaning = _turned(turn) @ _leaning(planet.tilt)
            for moon in planet.moons:
                toward = leaning @ _toward(moon.phase + moon.turns * part)
                ends = out + 0.97 * planet.radius * toward, out + moon.orbit * toward
                solids.append(tube(*ends, (0.008, 0.006)))
        return in_hall(join(solids))

    def _turns(self, part: float) -> list[float]:
        """Where each planet is on its orbit, turns; the default seed's places are composed."""
        starts = np.zeros(len(PLANETS))
        if self.seed != Orrery.seed:
            starts = np.random.default_rng(self.seed).uniform(size=len(PLANETS))
        return [float(start) + planet.phase + planet.turns * part
                for planet, start in zip(PLANETS, starts, strict=True)]  # fmt: skip


def in_hall(points: Floats) -> Floats:
    """Points (..., xyz) of the orrery's frame in the hall's."""
    return np.asarray(points @ FRAME.T + CENTRE)


def rails() -> Triangles:
    """The metal that stands still: shaft, spider, rails and their hangers, in the hall."""
    solids = [
        lathe([(0.07, SUN_RADIUS * 0.98), (0.07, _SHAFT)], 16),
        lathe([(0.0, 0.66), (0.2, 0.70), (0.2, 0.78), (0.1, 0.84), (0.1, 0.95)], 24),
        lathe([(0.1, 1.40), (0.24, 1.46), (0.24, 1.64), (0.1, 1.70)], 24),
        lathe([(0.08, 2.3), (0.16, 2.35), (0.16, 2.45), (0.08, 2.5)], 24),
    ]
    spokes = 12
    for number in range(spokes):
        out, top = _toward((number + 0.5) / spokes), _SPIDER * _UP
        solids.append(tube(0.2 * out + top, _OUTER * out + top, (0.035, 0.025)))
        solids.append(tube(2.4 * _UP, 6.0 * out + top, (0.012, 0.012)))  # a stay
        for planet in PLANETS:
            foot = _rail_height(planet) * _UP
            solids.append(tube(planet.orbit * out + foot, planet.orbit * out + top, (0.012, 0.012)))
        solids.append(tube(_OUTER * out + 0.25 * _UP, _OUTER * out + top, (0.018, 0.018)))
    solids += [_hoop(planet.orbit, _rail_height(planet), 0.024) for planet in PLANETS]
    solids += [_hoop(_OUTER, height, 0.03) for height in (_SPIDER, 0.25, -0.25)]
    # Two rings of an armillary sphere.
    for axis in ([0.35, 0.25, 1.0], [-1.0, 0.5, 0.45]):
        solids.append(ring([0, 0, 0], 1.12, 0.014, axis))
    return in_hall(join(solids))


def graduations() -> tuple[Triangles, Triangles]:
    """The graduated ring: its dark band, and the bright strokes on it, in the hall."""
    band = lathe([(_OUTER, -0.23), (_OUTER, 0.23)], 180)
    strokes = []
    for degree in range(360):
        height = 0.19 if degree % 30 == 0 else 0.13 if degree % 10 == 0 else 0.07
        width = 0.022 if degree % 10 == 0 else 0.010
        for inside in (_OUTER - 0.014, _OUTER + 0.006):
            stroke = box([inside, -width, -height], [inside + 0.008, width, height])
            strokes.append(turned(stroke, float(degree)))
    return in_hall(band), in_hall(join(strokes))


def planet_rings(placed: Placed) -> list[tuple[Triangles, float]]:
    """Flat annuli round the ringed planet, with their brightness."""
    return [
        (lathe([(inner, 0.0), (outer, 0.0)], 96) @ placed.axes.T + placed.centre, bright)
        for inner, outer, bright in RINGS
    ]


def _rail_height(planet: Body) -> float:
    return planet.radius + 0.30


def _hoop(radius: float, height: float, thickness: float) -> Triangles:
    a = np.linspace(0, 2 * np.pi, 9)
    profile = np.stack([radius + thickness * np.cos(a), height + thickness * np.sin(a)], -1)
    return lathe(profile, 240)


def _gear(radius: float, teeth: int, height: float, thickness: float) -> Triangles:
    disc = [(0.08, 0.0), (radius, 0.0), (radius, thickness), (0.08, thickness)]
    half = np.pi * radius / teeth / 2
    tooth = box([radius - 0.01, -half, 0.0], [radius + 0.035, half, thickness])
    solids = [lathe(disc, 64), *(turned(tooth, 360.0 * n / teeth) for n in range(teeth))]
    return moved(join(solids), [0, 0, height])


def _toward(turns: float) -> Floats:
    """Unit vector in the plane of the orbits."""
    return np.array([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns), 0.0])


def _turned(turns: float) -> Floats:
    c, s = np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def _leaning(degrees: float) -> Floats:
    """(3, 3): the axis leans towards x."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _placed(body: Body, centre: Floats, axes: Floats) -> Placed:
    return Placed(body, in_hall(centre), FRAME @ axes)
