"""The observatory: a classical front with a great dome, its lamps and its water basin.

The front looks along -y, towards the audience. Everything is sorted by what it is made of.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from domesim.pathtrace.solids import (
    Triangles,
    ball,
    box,
    extruded,
    join,
    lathe,
    moved,
    quad,
    ring,
    tube,
    turned,
)

GREAT_DOME = np.array([0.0, 36.0, 18.3])
GREAT_DOME_RADIUS = 8.8
SLIT_AZIMUTH = 24.0
LAMPS = [(side * 6.9, y) for y in (11.0, 18.5) for side in (-1, 1)]
LAMPS += [(-27.5, 2.0), (-27.5, 14.0), (17.0, 11.0), (23.0, 20.5), (-17.0, 20.5)]
LAMP_HEIGHT = 3.36

Parts = dict[str, list[Triangles]]


def observatory(rng: np.random.Generator) -> dict[str, Triangles]:
    """The building, by material."""
    parts: Parts = defaultdict(list)
    for side in (-1, 1):
        _wing(parts, rng, side)
        _pavilion(parts, rng, side)
    _portico(parts, rng)
    _great_dome(parts)
    return {material: join(solids) for material, solids in parts.items()}


def furniture() -> dict[str, Triangles]:
    """Basin, steps to it, lamps, balustrade of the quay and an armillary sphere, by material."""
    parts: Parts = defaultdict(list)
    for x0, x1, y0, y1 in [(-3.3, -2.9, 9.0, 18.6), (2.9, 3.3, 9.0, 18.6), (-3.3, 3.3, 8.8, 9.2),
                           (-3.3, 3.3, 18.4, 18.8)]:  # fmt: skip
        parts["trim"].append(box([x0, y0, 0.0], [x1, y1, 0.34]))
    for x, y in LAMPS:
        post = lathe([(0.17, 0), (0.17, 0.5), (0.07, 0.7), (0.055, 3.3)], 10)
        parts["iron"].append(moved(post, [x, y, 0]))
        parts["iron"].append(moved(lathe([(0.26, 3.98), (0.02, 4.2)], 12), [x, y, 0]))
        parts["globe"].append(ball([x, y, LAMP_HEIGHT + 0.29], 0.27, 16))
    parts["trim"].extend(_balustrade((-33.0, -14.0), (-33.0, 30.0), 0.0))
    parts["trim"].append(box([-33.4, -40.0, -2.0], [-32.8, 60.0, 0.06]))
    _armillary(parts, np.array([0.0, 13.8, 0.0]))
    return {material: join(solids) for material, solids in parts.items()}


@dataclass(frozen=True)
class Floodlight:
    """A lamp without extent: place and aim (xyz, m), `share` of its kind's light."""

    kind: str
    place: tuple[float, float, float]
    aim: tuple[float, float, float]
    share: float = 1.0


def floodlights() -> list[Floodlight]:
    """What washes the front from below and the great dome from the roofs."""
    x, y, z = GREAT_DOME
    lights = [
        Floodlight("dome", place, (x, y, z + 3.0), share)
        for place, share in [
            ((-20.5, 29.6, 11.4), 1.0),
            ((20.5, 29.6, 11.4), 0.6),
            ((0.0, 23.0, 14.3), 0.4),
        ]
    ]
    for side in (-1, 1):
        piers = [side * (8.3 + 3.05 * pier) for pier in range(6)]
        corners = [side * 24.7, side * 30.8]
        lights += [Floodlight("wall", (x, 26.5, 0.2), (x, 28.0, 4.6)) for x in piers]
        lights += [Floodlight("wall", (x, 25.2, 0.2), (x, 26.6, 4.8)) for x in corners]
        cupola = (side * 27.75, 32.0, 14.5)
        lights.append(Floodlight("cupola", (side * 22.0, 28.6, 10.8), cupola, 0.3))
    behind_columns = np.linspace(-5.52, 5.52, 5)
    lights += [Floodlight("wall", (x, 25.3, 1.25), (x, 27.0, 5.2), 1.15) for x in behind_columns]
    lights.append(Floodlight("wall", (0.0, 21.0, 1.0), (0.0, 23.9, 9.0), 1.1))
    tympanum = [(x, 23.55, 10.8) for x in (-3.4, 3.4)]
    lights += [Floodlight("wall", at, (0.4 * at[0], 24.1, 12.0), 0.10) for at in tympanum]
    return lights


def _wing(parts: Parts, rng: np.random.Generator, side: int) -> None:
    inner, outer = sorted((side * 8.0, side * 24.0))
    front, top = 28.0, 9.6
    parts["stone"].append(box([inner, front, 0.0], [outer, 42.0, top]))
    parts["trim"].append(box([inner, front - 0.12, 0.0], [outer, front, 0.9]))
    parts["trim"].append(box([inner, front - 0.16, 5.35], [outer, front, 5.65]))
    parts["trim"].append(box([inner, front - 0.55, top], [outer, front, top + 0.55]))
    parts["trim"].append(box([inner, front - 0.3, top - 0.3], [outer, front, top]))
    parts["trim"].extend(_balustrade((inner, front), (outer, front), top + 0.55))
    for step in range(5):
        x = side * (9.75 + 3.1 * step)
        _window(parts, _glass(rng, 0.82), (x, front, 1.25), (1.65, 3.5), arched=True)
        _window(parts, _glass(rng, 0.55), (x, front, 6.3), (1.35, 2.1), arched=False)
        if step < 4:
            pilaster = x + side * 1.55
            parts["trim"].append(
                box([pilaster - 0.22, front - 0.14, 0.9], [pilaster + 0.22, front, top - 0.3])
            )


def _pavilion(parts: Parts, rng: np.random.Generator, side: int) -> None:
    inner, outer = sorted((side * 24.0, side * 31.5))
    middle, front, top = side * 27.75, 26.6, 11.2
    parts["stone"].append(box([inner, front, 0.0], [outer, 38.0, top]))
    parts["trim"].append(box([inner - 0.1, front - 0.14, 0.0], [outer + 0.1, 38.0, 0.9]))
    parts["trim"].append(box([inner - 0.5, front - 0.5, top], [outer + 0.5, 38.5, top + 0.6]))
    for x in (inner + 0.45, outer - 0.45):
        parts["trim"].append(box([x - 0.45, front - 0.18, 0.9], [x + 0.45, front, top]))
    _window(parts, _glass(rng, 1.0), (middle, front, 1.25), (2.3, 4.6), arched=True)
    for offset in (-1.3, 1.3):
        _window(parts, _glass(rng, 0.5), (middle + offset, front, 7.3), (1.2, 2.2), arched=False)

    at = [middle, 32.0, top + 0.6]
    parts["stone"].append(moved(lathe([(3.3, 0.0), (3.3, 1.7)], 32), at))
    parts["trim"].append(moved(lathe([(3.3, 1.7), (3.6, 1.75), (3.6, 2.1), (0.0, 2.1)], 32), at))
    parts["dome"].append(moved(_cupola(3.25, 32), np.add(at, [0, 0, 2.1])))
    parts["iron"].append(tube(np.add(at, [0, 0, 5.3]), np.add(at, [0, 0, 7.2]), (0.09, 0.03)))


def _portico(parts: Parts, rng: np.random.Generator) -> None:
    parts["stone"].append(box([-8.0, 27.0, 0.0], [8.0, 42.0, 13.0]))
    parts["trim"].append(box([-8.4, 26.6, 12.4], [8.4, 42.4, 13.1]))
    for step in range(6):
        y = 21.4 + 0.38 * step
        parts["trim"].append(box([-8.2, y, 0.2 * step], [8.2, 27.0, 0.2 * step + 0.2]))
    shaft = [(0.66, 0.0), (0.66, 0.22), (0.52, 0.4), (0.53, 2.8), (0.44, 7.3), (0.46, 7.4),
             (0.66, 7.7), (0.7, 7.9)]  # fmt: skip
    for x in np.linspace(-6.9, 6.9, 6):
        parts["trim"].append(moved(lathe(shaft, 20), [x, 24.6, 1.2]))
        parts["trim"].append(box([x - 0.72, 23.88, 9.0], [x + 0.72, 25.32, 9.25]))
    parts["trim"].append(box([-7.9, 23.9, 9.25], [7.9, 27.0, 10.35]))
    parts["trim"].append(box([-8.3, 23.5, 10.35], [8.3, 27.0, 10.65]))
    tympanum = [(-7.9, 10.65), (7.9, 10.65), (0.0, 13.55)]
    parts["stone"].append(extruded(tympanum, 24.1, 27.0))
    for side in (-1, 1):
        slope = [(0.0, 13.5), (side * 8.4, 10.6), (side * 8.4, 11.05), (0.0, 13.98)]
        parts["trim"].append(extruded(slope[::-side], 23.5, 27.0))
    parts["bright glass"].append(moved(_disc(0.72), [0.0, 24.08, 11.85]))
    parts["trim"].append(ring([0.0, 24.05, 11.85], 0.84, 0.11, [0, 1, 0]))

    _window(parts, "bright glass", (0.0, 27.0, 1.2), (2.4, 5.4), arched=True)
    for x in (-4.15, 4.15):
        _window(parts, "bright glass", (x, 27.0, 1.9), (1.7, 3.9), arched=True)
    for x in (-6.9, -4.15, 4.15, 6.9):
        _window(parts, _glass(rng, 0.6), (x, 27.0, 7.4), (1.1, 1.3), arched=False)


def _great_dome(parts: Parts) -> None:
    x, y, z = GREAT_DOME
    radius = GREAT_DOME_RADIUS
    at = [x, y, 0.0]
    parts["stone"].append(moved(lathe([(radius, 13.0), (radius, z - 0.8)], 72), at))
    cornice = [(radius, z - 0.8), (radius + 0.5, z - 0.7), (radius + 0.5, z), (radius - 0.5, z)]
    parts["trim"].append(moved(lathe(cornice, 72), at))
    for azimuth in range(-80, 81, 20):
        pane = moved(_disc(0.68), [0.0, -radius - 0.06, 15.3])
        parts["bright glass"].append(moved(turned(pane, -azimuth), at))
        frame = ring([0.0, -radius - 0.05, 15.3], 0.8, 0.1, [0, 1, 0])
        parts["trim"].append(moved(turned(frame, -azimuth), at))
        pilaster = box([-0.2, -radius - 0.12, 13.0], [0.2, -radius + 0.2, z - 0.8])
        parts["trim"].append(moved(turned(pilaster, -azimuth - 10), at))

    # The slit looks out over the audience's right shoulder; the dome is closed behind it.
    half = 10.0
    open_at = -90.0 + SLIT_AZIMUTH
    sweep = (open_at + half, open_at + 360.0 - half)
    parts["dome"].append(moved(_cupola(radius, 90, sweep), GREAT_DOME))
    for azimuth in np.linspace(*sweep, 25):
        rib = moved(turned(_arc(radius + 0.04, 0.09), 90 - azimuth), GREAT_DOME)
        parts["dome"].append(rib)
    parts["lit inside"].append(moved(_cupola(radius - 0.6, 60, sweep), GREAT_DOME)[:, ::-1])
    for edge in sweep:
        parts["trim"].append(moved(turned(_arc(radius + 0.12, 0.22), 90 - edge), GREAT_DOME))
    aim = np.array([np.sin(np.radians(SLIT_AZIMUTH)), -np.cos(np.radians(SLIT_AZIMUTH)), 0.72])
    aim /= np.linalg.norm(aim)
    foot = GREAT_DOME + np.array([0.0, 0.0, 0.6])
    parts["iron"].append(tube(foot, foot + 8.7 * aim, (0.62, 0.62), 20))
    parts["iron"].append(tube(foot + 8.0 * aim, foot + 9.5 * aim, (0.8, 0.8), 20))


def _armillary(parts: Parts, at: Triangles) -> None:
    pedestal = [(0.75, 0.0), (0.75, 0.25), (0.45, 0.4), (0.36, 1.1), (0.5, 1.3), (0.5, 1.4)]
    parts["trim"].append(moved(lathe(pedestal, 8), at))
    centre = at + np.array([0.0, 0.0, 2.35])
    parts["iron"].append(tube(at + np.array([0.0, 0.0, 1.4]), centre, (0.09, 0.03)))
    pole = np.array([0.35, 0.5, 0.79])
    for axis, radius in [((1, 0.2, 0), 0.9), ((0.1, 1, 0), 0.9), (pole, 0.86), ((0, 0, 1), 0.94)]:
        parts["iron"].append(ring(centre, radius, 0.028, np.array(axis, dtype=float)))
    parts["iron"].append(tube(centre - 1.25 * pole, centre + 1.25 * pole, (0.02, 0.02)))
    parts["iron"].append(ball(centre, 0.13, 16))


def _window(
    parts: Parts,
    glass: str,
    foot: tuple[float, float, float],
    size: tuple[float, float],
    *,
    arched: bool,
) -> None:
    """A framed window; `foot` is the middle of its sill on the wall, `size` (width, height)."""
    (x, wall, z), (width, height) = foot, size
    w, spring = width / 2, z + height - (width / 2 if arched else 0.0)
    a = np.linspace(0.0, np.pi, 13)
    arch = np.column_stack([x + w * np.cos(a), spring + w * np.sin(a)])
    top = arch if arched else np.array([(x + w, spring), (x - w, spring)])
    outline = np.vstack([[(x - w, z), (x + w, z)], top])
    parts[glass].append(extruded(outline, wall - 0.02, wall))

    frame = 0.22
    for side in (-1, 1):
        low, high = sorted((x + side * w, x + side * (w + frame)))
        parts["trim"].append(box([low, wall - 0.18, z], [high, wall, spring]))
    if arched:
        outer = np.column_stack([x + (w + frame) * np.cos(a), spring + (w + frame) * np.sin(a)])
        for i in range(len(a) - 1):
            stone = np.array([arch[i], outer[i], outer[i + 1], arch[i + 1]])
            parts["trim"].append(extruded(stone, wall - 0.18, wall))
        keystone = [x - 0.17, wall - 0.26, spring + w - 0.05], [x + 0.17, wall, spring + w + 0.4]
        parts["trim"].append(box(*keystone))
    else:
        lintel = [x - w - 0.35, wall - 0.24, spring], [x + w + 0.35, wall, spring + 0.28]
        parts["trim"].append(box(*lintel))
    parts["trim"].append(box([x - w - 0.3, wall - 0.26, z - 0.2], [x + w + 0.3, wall, z]))

    levels = np.arange(z + 0.9, z + height - 0.3, 0.9)
    parts["iron"].append(box([x - 0.05, wall - 0.08, z], [x + 0.05, wall - 0.02, z + height]))
    parts["iron"].extend(
        box([x - w, wall - 0.08, level - 0.03], [x + w, wall - 0.02, level + 0.03])
        for level in levels
    )


def _balustrade(
    start: tuple[float, float], end: tuple[float, float], bottom: float
) -> list[Triangles]:
    """Balusters and rail between two points of the ground plan."""
    p, q = np.array(start), np.array(end)
    length = float(np.linalg.norm(q - p))
    across = 0.11 * np.array([q[1] - p[1], p[0] - q[0]]) / length
    baluster = lathe([(0.09, 0.0), (0.13, 0.25), (0.05, 0.6), (0.09, 0.75)], 6)
    count = int(length / 0.42)
    solids = [
        moved(baluster, [*(p + (q - p) * (i + 0.5) / count), bottom + 0.1]) for i in range(count)
    ]
    for low, high in [(0.0, 0.1), (0.85, 1.02)]:
        plan = np.array([p - across, q - across, q + across, p + across])
        low_ring, high_ring = (
            np.column_stack([plan, np.full(4, bottom + level)]) for level in (low, high)
        )
        solids.append(quad(*high_ring))
        for i in range(4):
            j = (i + 1) % 4
            solids.append(quad(low_ring[i], low_ring[j], high_ring[j], high_ring[i]))
    return solids


def _disc(radius: float) -> Triangles:
    """An upright round pane that looks along -y."""
    a = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    return extruded(np.column_stack([radius * np.cos(a), radius * np.sin(a)]), 0.0, 0.02)


def _cupola(radius: float, sides: int, sweep: tuple[float, float] = (0, 360)) -> Triangles:
    a = np.linspace(0.0, np.pi / 2, 19)
    return lathe(np.column_stack([radius * np.cos(a), radius * np.sin(a)]), sides, sweep)


def _arc(radius: float, thickness: float) -> Triangles:
    """A quarter hoop from +y at the spring line to the top."""
    a = np.linspace(0.0, np.pi / 2, 25)[:, None]
    path = radius * (np.cos(a) * [0.0, 1.0, 0.0] + np.sin(a) * [0.0, 0.0, 1.0])
    return join([tube(p, q, (thickness, thickness), 5) for p, q in pairwise(path)])


def _glass(rng: np.random.Generator, share_lit: float) -> str:
    """Which glass a window has: most are lit, some dimly."""
    draw = rng.random()
    if draw > share_lit:
        return "dark glass"
    return "bright glass" if draw < 0.6 * share_lit else "dim glass"
