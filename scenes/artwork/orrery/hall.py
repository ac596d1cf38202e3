"""The hall: a rotunda of stone under a roof of iron and glass, by night.

Solids by material, in metres; the audience is in the middle of the floor. The glass is not there:
nothing would be seen of it but reflections.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np

from domesim.pathtrace.solids import Triangles, ball, box, join, lathe, moved, tube, turned
from scenes.artwork.night.noise import Floats

RADIUS = 15.0
SPRING = 6.4
"""Height where the roof begins."""
CROWN = 9.6
"""Height of the roof above the spring, to where its ribs would meet, m."""
BAYS = 24


@cache
def hall() -> dict[str, Triangles]:
    """All solids, by material."""
    bays = [_bay(number * 360.0 / BAYS) for number in range(BAYS)]
    solids = {material: join([bay[material] for bay in bays]) for material in bays[0]}
    solids["stone"] = join([solids["stone"], _walls()])
    solids["gilt"] = join([solids["gilt"], _mouldings()])
    solids["iron"] = join([_roof(), _gallery()])
    solids["floor"] = lathe([(0.0, 0.0), (RADIUS, 0.0)], 96)
    return solids


def _walls() -> Triangles:
    profile = [(RADIUS, 0.0), (RADIUS, 5.2), (RADIUS - 0.25, 5.25), (RADIUS - 0.25, 5.7)]
    cornice = [(RADIUS - 0.7, 5.95), (RADIUS - 0.7, 6.1), (RADIUS - 0.2, SPRING)]
    return lathe(profile + cornice, 192)


def _mouldings() -> Triangles:
    solids = []
    for radius, height in ((RADIUS - 0.28, 5.22), (RADIUS - 0.28, 5.72), (RADIUS - 0.74, 6.02)):
        a = np.linspace(0, 2 * np.pi, 7)
        profile = np.stack([radius + 0.045 * np.cos(a), height + 0.045 * np.sin(a)], -1)
        solids.append(lathe(profile, 192))
    return join(solids)


def _bay(azimuth: float) -> dict[str, Triangles]:
    """A column with its lamp, and the arch beside it."""
    at = np.array([RADIUS - 0.75, 0.0, 0.0])
    shaft = [(0.30, 0.7), (0.34, 0.75), (0.28, 0.9), (0.25, 4.55), (0.24, 4.6)]
    capital = [(0.24, 4.6), (0.34, 4.9), (0.36, 5.05)]
    column = [
        moved(lathe(shaft + capital, 18), at),
        moved(box([-0.40, -0.40, 0.0], [0.40, 0.40, 0.7]), at),
        moved(box([-0.42, -0.42, 5.05], [0.42, 0.42, 5.25]), at),
        # A bracket over the column, under the cornice.
        moved(box([-0.20, -0.14, 5.25], [0.6, 0.14, 5.95]), at),
    ]
    collars = [lathe([(r, z), (r + 0.02, z + 0.03), (r, z + 0.06)], 18)
               for r, z in ((0.285, 0.86), (0.25, 4.5), (0.345, 4.96))]  # fmt: skip
    lamp = moved(ball([-0.62, 0.0, 3.1], 0.105, 14), at)
    below_lamp = np.array([-0.62, 0.0, 2.8])
    arm = [
        moved(tube(np.array([-0.25, 0.0, 2.8]), below_lamp, (0.022, 0.022)), at),
        moved(tube(below_lamp, np.array([-0.62, 0.0, 3.0]), (0.03, 0.05)), at),
    ]
    arch = turned(_arch(), 180.0 / BAYS)
    solids = {
        "stone": join([*column, arch]),
        "gilt": join([moved(join(collars), at), *arm]),
        "lamp": lamp,
        "recess": turned(_recess(), 180.0 / BAYS),
    }
    return {material: turned(solid, azimuth) for material, solid in solids.items()}


def _arch_line(half_width: float, foot: float, spring: float) -> Floats:
    """(point, (across, up)): a round arch from its left foot to its right one."""
    a = np.linspace(np.pi, 0.0, 15)
    crown = np.stack([half_width * np.cos(a), spring + half_width * np.sin(a)], -1)
    return np.concatenate([[[-half_width, foot]], crown, [[half_width, foot]]])


def _arch() -> Triangles:
    """A raised frame round the recess."""
    line = _arch_line(1.12, 0.0, 3.4)
    points = np.stack([np.full(len(line), RADIUS - 0.12), line[:, 0], line[:, 1]], -1)
    return join([tube(p, q, (0.10, 0.10), 6) for p, q in pairwise(points)])


def _recess() -> Triangles:
    """What is seen in the arch: a darker wall."""
    line = _arch_line(1.12, 0.0, 3.4)
    points = np.stack([np.full(len(line), RADIUS - 0.13), line[:, 0], line[:, 1]], -1)
    middle = np.array([RADIUS - 0.13, 0.0, 1.5])
    return np.stack([np.stack([middle, q, p]) for p, q in pairwise(points)])


def _roof_point(elevation: Floats, azimuth: float) -> Floats:
    a = np.radians(azimuth)
    across = (RADIUS - 0.3) * np.cos(elevation)
    return np.stack(
        [across * np.cos(a), across * np.sin(a), SPRING + CROWN * np.sin(elevation)], -1
    )


def _roof() -> Triangles:
    solids = []
    top = np.radians(81.0)
    for number in range(BAYS):
        path = _roof_point(np.linspace(0.0, top, 20), number * 360.0 / BAYS)
        solids += [tube(p, q, (0.085, 0.085), 6) for p, q in pairwise(path)]
        for between in (1, 2):  # glazing bars, which end where they come too close
            bar = _roof_point(np.linspace(0.0, np.radians(58), 14), (number + between / 3) * 15.0)
            solids += [tube(p, q, (0.022, 0.022), 4) for p, q in pairwise(bar)]
    for degrees, thickness in ((12, 0.05), (24, 0.05), (35, 0.05), (46, 0.05), (58, 0.07),
                               (70, 0.05), (81, 0.16)):  # fmt: skip
        elevation = np.radians(float(degrees))
        radius = (RADIUS - 0.3) * np.cos(elevation)
        height = SPRING + CROWN * np.sin(elevation)
        a = np.linspace(0, 2 * np.pi, 7)
        profile = np.stack([radius + thickness * np.cos(a), height + thickness * np.sin(a)], -1)
        solids.append(lathe(profile, 120))
    # The beam that carries the orrery.
    height = SPRING + CROWN * np.sin(top) - 0.1
    for y in (0.45, 1.05):
        solids.append(box([-2.3, y, height - 0.12], [2.3, y + 0.14, height + 0.12]))
    return join(solids)


def _gallery() -> Triangles:
    """A railing before the columns."""
    radius = RADIUS - 1.9
    solids = []
    for height, thickness in ((0.95, 0.035), (0.15, 0.02)):
        a = np.linspace(0, 2 * np.pi, 7)
        profile = np.stack([radius + thickness * np.cos(a), height + thickness * np.sin(a)], -1)
        solids.append(lathe(profile, 192))
    for number in range(240):
        bar = tube(np.array([radius, 0, 0.0]), np.array([radius, 0, 0.95]), (0.014, 0.014), 4)
        solids.append(turned(bar, number * 1.5))
    return join(solids)
