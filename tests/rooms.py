"""Whole theatres: rooms round a screen, of every kind that tests need."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from domesim.room.dome import Dome
from domesim.room.furniture import box, seating
from domesim.room.theatre import Cavity, Floor, Lens, Theatre, Wall

HEMISPHERE = Dome(3.0, np.pi / 2)
SCREEN = (0.5, 0.3, 0.7)
ROOMS = {
    # The primaries: grey, white and black surroundings
    "recessed": Theatre(
        HEMISPHERE,
        SCREEN,
        floor=Floor(-1.0, 3.0, (0.2, 1.0, 0.0)),
        wall=Wall(3.0, -1.0, 0.0, (0.3, 1.0, 0.0)),
    ),
    "at the spring line": Theatre(HEMISPHERE, SCREEN, floor=Floor(0.0, 3.0, (0.2, 1.0, 0.0))),
    "below it": Theatre(
        Dome(3.0, np.radians(125), 0.2, truncated_below=-0.6),
        SCREEN,
        floor=Floor(-0.6, np.sqrt(9 - 0.36), (0.2, 1.0, 0.0)),
    ),
    "leaning": Theatre(
        Dome(3.0, np.radians(95), 0.25),
        SCREEN,
        floor=Floor(-1.5, 2.6, (0.4, 0.1, 0.8)),
        wall=Wall(3.1, -1.5, -0.9, (0.5, 0.6, 0.2)),
    ),
    # A stage with a parapet: both hide parts of the screen from each other, and their backs absorb.
    "hiding": Theatre(
        Dome(3.0, np.radians(120), 0.1),
        SCREEN,
        floor=Floor(0.2, 1.8, (0.6, 0.1, 0.8)),
        wall=Wall(2.4, -0.5, 0.9, (0.5, 0.2, 0.1)),
    ),
    "very flat": Theatre(
        Dome(3.0, np.pi / 2, height_ratio=0.5), SCREEN, floor=Floor(-1.5, 2.5, (0.6, 0.2, 0.9))
    ),
    "flat": Theatre(
        Dome(3.0, np.pi / 2, 0.1, 0.7), SCREEN, floor=Floor(-0.9, 2.0, (0.6, 0.2, 0.9))
    ),
}

ALBEDO = (0.7, 0.5, 0.2)
GREY = (0.4, 0.4, 0.4)


def room(**more: Any) -> Theatre:
    """Floor and wall, a box, and a lens off the centre whose falloff shows."""
    dome = Dome(5.0, np.pi / 2)
    return Theatre(
        dome,
        ALBEDO,
        floor=Floor(-1.5, 5.0, (0.3, 0.2, 0.1)),
        wall=Wall(5.0, -1.5, 0.0, (0.2, 0.2, 0.2)),
        solids=(box("booth", (-1, -3, -1.5), (1, -2, -0.5), (0.4, 0.4, 0.4)),),
        lenses=(Lens("lens", (0.0, 0.0, 0.6), (0.0, 0.0, 5.0), field=2 * np.pi),),
        **{"corrected": False, **more},
    )


def furnished() -> Theatre:
    solids, viewpoints = seating(
        floor_height=-2.3,
        rows=4,
        seats_per_row=8,
        first_row=2.5,
        row_spacing=1.1,
        seat_spacing=0.6,
        rise=0.1,
        within=6.8,
        albedo=GREY,
        occupied=0.5,
        audience_albedo=GREY,
        seed=1,
        look_at=(0.0, 6.0, 3.0),
    )
    booth = box("booth", (-1.6, -7.0, -2.3), (1.6, -6.0, -0.9), GREY)
    return Theatre(
        Dome(7.5, np.pi / 2, np.radians(15)),
        GREY,
        floor=Floor(-2.3, 7.8, GREY),
        wall=Wall(7.8, -2.3, 0.0, GREY),
        solids=(*solids, booth),
        lenses=(
            Lens("left", (-7.0, 0.0, -0.5), (5.0, 0.0, 4.0), kind="perspective", field=1.4),
            Lens("right", (7.0, 0.0, -0.5), (-5.0, 0.0, 4.0), 0.3, "perspective", field=1.4),
        ),
        viewpoints=viewpoints,
    )


BARE = Theatre(Dome(10.0, np.pi / 2), GREY)
THEATRES = {
    "bare hemisphere": BARE,
    "nearly a sphere": Theatre(Dome(8.0, np.radians(170)), GREY, floor=Floor(-4.0, 6.5, GREY)),
    "tilted and truncated": Theatre(
        Dome(8.0, np.radians(100), np.radians(20), truncated_below=-1.5), GREY
    ),
    "ellipsoid": Theatre(Dome(8.0, np.pi / 2, 0.2, height_ratio=0.7), GREY),
    "furnished": furnished(),
    "cavity": replace(BARE, perforation=0.2, cavity=Cavity(1.0, GREY, GREY)),
    "lens below the rim": replace(BARE, lenses=(Lens("p", (0.0, -2.0, -3.0), (0.0, 5.0, 5.0)),)),
    "lens outside": replace(BARE, lenses=(Lens("p", (0.0, -12.0, 1.0), (0.0, 0.0, 5.0)),)),
    "nothing to see": replace(
        BARE, wall=Wall(10.0, 0.0, 0.0, GREY), cavity=Cavity(0.0, GREY, GREY)
    ),
    "tiny": Theatre(Dome(1.5, np.pi / 2), GREY),
}


BEFORE = {
    # Things between a projector and its screen; the second lens sees past the first one's shadow.
    "box in the beam": Theatre(
        Dome(6.0, np.pi / 2),
        (0.5, 0.5, 0.5),
        solids=(box("box", (1, 1, 1), (2, 2, 2), (0.6, 0.6, 0.6)),),
    ),
    "floor in the beam": Theatre(
        Dome(6.0, np.radians(120)), (0.5, 0.4, 0.6), floor=Floor(-1.0, 6.0, (0.3, 0.5, 0.2))
    ),
    "two beams": Theatre(
        Dome(5.0, np.pi / 2, 0.2),
        ALBEDO,
        floor=Floor(-1.5, 5.0, (0.3, 0.2, 0.1)),
        wall=Wall(4.5, -1.5, 0.8, (0.6, 0.2, 0.4)),
        solids=(box("booth", (-1, 1, -1.5), (1, 2, 0.8), (0.7, 0.4, 0.2)),),
        lenses=(
            Lens("back", (0.2, -3.0, 0.3), (0.0, 0.0, 5.0), field=2 * np.pi),
            Lens("front", (-0.5, 2.9, -0.2), (0.0, 0.0, 5.0), field=np.pi, blend=0.5),
        ),
        corrected=False,
    ),
    "behind holes": Theatre(
        Dome(6.0, np.pi / 2),
        GREY,
        perforation=0.3,
        cavity=Cavity(0.5, (0.6, 0.3, 0.5), (0.3, 0.5, 0.2)),
        solids=(box("box", (1, 1, 1), (2, 2, 2), (0.6, 0.4, 0.7)),),
    ),
}
