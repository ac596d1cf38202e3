"""Theatres for the table of ways to the light: chosen ones, of which each shows something, and
ones drawn at random, for a fault may be just where nobody thought of one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.room.dome import Dome
from domesim.room.furniture import box, seating
from domesim.room.theatre import Albedo, Cavity, Floor, Lens, Lobe, Paint, Solid, Theatre, Wall

RADIUS = 5.0
BARE = Theatre(Dome(RADIUS, np.pi / 2), (0.5, 0.5, 0.5))
RECESSED = replace(
    BARE,
    floor=Floor(-0.3 * RADIUS, RADIUS, (0.2, 0.2, 0.2)),
    wall=Wall(RADIUS, -0.3 * RADIUS, 0.0, (0.1, 0.1, 0.1)),
)
EXACT, DARK, BRIGHT = (-3e-3, 3e-3), (-1.0, -0.01), (0.02, 2.0)
"""Where the closed form's error for white is expected."""


@final
@dataclass(frozen=True)
class Case:
    """A theatre, and what is asked of it besides paths and the closed form.

    Attributes
    ----------
    family, value
        What is varied, and how strong it is, in the family's unit.
    theatre
        The whole theatre.
    closed
        Bounds of the closed form's error for white.
    pictures
        Which of `validation.reflection.PICTURES`.
    eye
        Where the audience sits, m.
    error
        Relative standard error of a traced pixel, in a full run.
    tabulated
        Relative standard error of the tabulated transport; 0 if it is not asked.
    even
        Whether only the mean is tabulated, by walks alone.
    others
        Other programs that are asked: Mitsuba, Radiance; or energy, the balance of all light.
    """

    family: str
    theatre: Theatre
    value: float = 0.0
    closed: tuple[float, float] = (-1.0, 2.0)
    pictures: tuple[str, ...] = ("white", "patch")
    eye: tuple[float, float, float] = (0.0, 0.0, 0.0)
    error: float = 0.06
    tabulated: float = 0.0
    even: bool = False
    others: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.family} {self.value:g}" if self.value else self.family


def chosen() -> Iterator[Case]:
    """A hemisphere of albedo 0.5 with one thing added, and rooms that others know as well."""
    yield Case("bare hemisphere", BARE, closed=EXACT, others=("Radiance",))
    yield from _floors()
    for tilt in (15.0, 30.0):
        tilted = Dome(RADIUS, np.pi / 2, np.radians(tilt))
        yield Case("tilted alone, degrees", replace(BARE, dome=tilted), tilt, EXACT)
    cut = Dome(RADIUS, np.pi / 2, np.radians(20.0), truncated_below=-0.15 * RADIUS)
    yield Case("tilted 20°, cut off 0.15 r below the centre", replace(BARE, dome=cut), closed=EXACT)
    holes = replace(BARE, perforation=0.25)
    yield Case("perforated over black, open share", holes, 0.25, EXACT)
    for albedo in (0.2, 0.6):
        cavity = Cavity(0.6, _grey(albedo), _grey(albedo))
        behind = replace(holes, cavity=cavity)
        yield Case("cavity behind 25 % holes, albedo", behind, albedo, DARK)
    for share in (0.05, 0.1, 0.3, 0.5):
        glossy = replace(BARE, lobe=Lobe(share, 0.3))
        known: dict[str, Any] = {"error": 0.03, "tabulated": 2e-3} if share == 0.3 else {}
        yield Case("gain lobe, share", glossy, share, BRIGHT, **known)
    seat = (0.0, -0.6 * RADIUS, -0.1 * RADIUS)
    glossy = replace(BARE, lobe=Lobe(0.3, 0.3))
    yield Case("gain lobe of share 0.3 seen from the back", glossy, closed=BRIGHT, eye=seat)
    for flatter in (-0.2, 0.05, 0.1, 0.2, 0.3):
        dome = Dome(RADIUS, np.pi / 2, height_ratio=1 - flatter)
        yield Case("ellipsoid, flatter by", replace(BARE, dome=dome), flatter)
    lens = Lens("fisheye", (0.0, -0.5 * RADIUS, 0.0), (0.0, 0.0, RADIUS), field=2 * np.pi)
    aside = replace(BARE, lenses=(lens,), corrected=False)
    yield Case("projector 0.5 r off centre, falloff known", aside, closed=EXACT)
    yield from _in_the_beam()
    yield from _furnished()
    yield from _painted()


def _floors() -> Iterator[Case]:
    for albedo in (0.05, 0.1, 0.2, 0.3):
        level = replace(BARE, floor=Floor(0.0, RADIUS, _grey(albedo)))
        known: dict[str, Any] = {"error": 5e-3, "tabulated": 1e-3} if albedo == 0.2 else {}
        yield Case("floor at the spring line, albedo", level, albedo, DARK, **known)
    for albedo in (0.05, 0.1, 0.2, 0.3):
        below = replace(BARE, floor=Floor(-0.3 * RADIUS, RADIUS, _grey(albedo)))
        yield Case("floor 0.3 r below, albedo", below, albedo, DARK)
    for depth in (0.1, 0.6):
        below = replace(BARE, floor=Floor(-depth * RADIUS, RADIUS, _grey(0.2)))
        yield Case(f"floor of albedo 0.2, {depth} r below", below, closed=DARK)
    black = Floor(-0.3 * RADIUS, RADIUS, _grey(0.0))
    for albedo in (0.1, 0.3):
        wall = Wall(RADIUS, -0.3 * RADIUS, 0.0, _grey(albedo))
        walled = replace(BARE, floor=black, wall=wall)
        yield Case("wall 0.3 r high, albedo", walled, albedo, DARK)
    yield Case(
        "recessed floor", RECESSED, closed=DARK, error=3e-3, tabulated=2.5e-4, others=("Radiance",)
    )
    for albedo in (0.1, 0.3):
        solids, _ = seating(
            floor_height=-0.3 * RADIUS, rows=6, seats_per_row=9, first_row=2.5, row_spacing=0.95,
            seat_spacing=0.6, rise=0.15, within=0.95 * RADIUS, albedo=_grey(albedo), occupied=0.8,
            audience_albedo=_grey(albedo), seed=1, look_at=(0.0, 4.0, 3.0),
        )  # fmt: skip
        seats = replace(BARE, floor=black, solids=tuple(solids))
        yield Case("seats and audience, black floor, albedo", seats, albedo)


def _in_the_beam() -> Iterator[Case]:
    """What stands between lens and screen."""
    things = (box("box", (1, 1, 1), (2, 2, 2), (0.6,) * 3),)
    wide = Theatre(Dome(6.0, np.radians(120)), _grey(0.5), floor=Floor(-1.0, 6.0, (0.3,) * 3))
    for name, theatre in (
        ("box in the beam", replace(BARE, solids=things)),
        ("floor in the beam", wide),
    ):
        yield Case(name, theatre, pictures=("white",), others=("Radiance",))


def _furnished() -> Iterator[Case]:
    """A tilted dome with a lens off its centre, from bare to one with everything."""
    dome, floor = Dome(RADIUS, np.pi / 2, np.radians(15)), Floor(-2.5, 5.0, (0.2, 0.25, 0.3))
    lens = Lens("lens", (0.6, -0.8, 0.5), (0.0, 1.0, 4.0), field=2 * np.pi)
    seats, _ = seating(
        floor_height=-2.5, rows=4, seats_per_row=6, first_row=2.0, row_spacing=1.1,
        seat_spacing=0.7, rise=0.1, within=5.0, albedo=(0.3, 0.3, 0.3), occupied=0.5,
        audience_albedo=(0.4, 0.3, 0.2), seed=1, look_at=(0.0, 4.0, 3.0),
    )  # fmt: skip
    empty = Theatre(dome, (0.5, 0.4, 0.6), lenses=(lens,), corrected=False)
    room = replace(empty, floor=floor, wall=Wall(5.0, -2.5, -1.3, (0.1, 0.1, 0.1)))
    full = replace(room, solids=tuple(seats))
    for name, theatre, closed in (
        ("tilted, lens aside", empty, EXACT),
        ("tilted, lens aside, floor and wall", room, DARK),
        ("tilted, lens aside, floor, wall and seats", full, DARK),
        ("furnished, with a gain lobe", replace(full, lobe=Lobe(0.3, 0.3)), (-1.0, 2.0)),
    ):
        yield Case(
            name, theatre, closed=closed, pictures=("coloured",), error=0.02, others=("Mitsuba",)
        )


def _painted() -> Iterator[Case]:
    """Screens whose albedo differs from place to place, and in each primary."""
    centre = Lens("lens", (0.0, 0.0, 0.0), (0.0, 0.0, RADIUS), field=2 * np.pi)
    lit: dict[str, Any] = {"lenses": (centre,), "corrected": False, "paint": _patchwork()}
    asked: dict[str, Any] = {"error": 0.03, "others": ("Mitsuba",)}
    yield Case("albedo map alone", replace(BARE, **lit), closed=EXACT, **asked)
    room = replace(RECESSED, **lit)
    flat = replace(BARE, dome=Dome(RADIUS, np.pi / 2, height_ratio=0.7), paint=_patchwork())
    yield Case("albedo map, ellipsoid flatter by 0.3", flat, error=0.03)
    yield Case("albedo map, recessed floor", room, closed=DARK, tabulated=2e-3, **asked)


def _patchwork(size: int = 128) -> Paint:
    """Half of it darker, dirty below, and its primaries' own waves."""
    v, u = (np.mgrid[:size, :size] + 0.5) * (2 / size) - 1
    shared = np.where(u < 0.1, 1.0, 0.5) * np.where(v > 0.6, 0.7, 1.0)
    waves = [1 - 0.3 * np.sin(5 * (k + 1) * v) ** 2 for k in range(3)]
    return Paint(shared[..., None] * np.stack(waves, -1))


def drawn(number: int, seed: int) -> Case:
    """A random theatre; half of them have their only lens in the centre."""
    rng = np.random.default_rng([seed, number])
    radius = float(rng.uniform(3, 12))
    tilt = float(np.radians(rng.uniform(0, 20))) if rng.random() < 0.5 else 0.0
    dome = Dome(radius, float(np.radians(rng.uniform(70, 125))), tilt)
    height = -radius * float(rng.uniform(0.1, 0.5))
    floor = wall = None
    if rng.random() < 0.75:
        floor = Floor(height, radius * float(rng.uniform(0.3, 0.95)), _paint(rng, 0.0, 0.6))
    if rng.random() < 0.3:
        top = height + radius * float(rng.uniform(0.1, 0.6))
        wall = Wall(radius * float(rng.uniform(0.75, 1.0)), height, top, _paint(rng, 0.0, 0.6))
    lenses: tuple[Lens, ...] = ()
    if number % 2:
        lenses = tuple(
            Lens(
                f"lens {each}",
                _point(rng.uniform(-0.15, 0.15, 3) * radius),
                (0.0, 0.0, radius),
                field=2 * np.pi,
            )
            for each in range(rng.integers(1, 3))
        )
    places = [lens.position for lens in lenses] or [(0.0, 0.0, 0.0)]
    solids: list[Solid] = []
    wanted = int(rng.integers(0 if floor else 1, 3))
    while len(solids) < wanted:
        middle = rng.uniform([-0.6, -0.6, -0.3], 0.6, 3) * radius
        half = rng.uniform(0.03, 0.15, 3) * radius
        # No lens is in a box, or touches one.
        if not any(np.all(np.abs(middle - place) < half * 1.2) for place in places):
            corners = _point(middle - half), _point(middle + half)
            solids.append(box(f"box {len(solids)}", *corners, _paint(rng, 0.05, 0.8)))
    theatre = Theatre(
        dome, _paint(rng, 0.2, 0.75), floor=floor, wall=wall, solids=tuple(solids), lenses=lenses
    )
    return Case(
        f"drawn {number}",
        theatre,
        pictures=("white",),
        tabulated=2e-3,
        even=True,
        others=("energy",) if lenses else ("energy", "Radiance"),
    )


def _grey(albedo: float) -> Albedo:
    return (albedo, albedo, albedo)


def _paint(rng: np.random.Generator, low: float, high: float) -> Albedo:
    return _point(rng.uniform(low, high, 3))


def _point(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
