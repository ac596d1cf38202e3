"""Theatres that are more than a bare dome."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from domesim.room.dome import Dome
from domesim.room.theatre import Floor, Lobe, Theatre, Wall

DOME = Dome(5.0, np.pi / 2)

THEATRES: Mapping[str, Theatre] = {
    "recessed floor": Theatre(
        DOME,
        (0.5, 0.5, 0.5),
        floor=Floor(-1.5, 5.0, (0.2, 0.2, 0.2)),
        wall=Wall(5.0, -1.5, 0.0, (0.1, 0.1, 0.1)),
    ),
    "floor at the spring line": Theatre(
        DOME, (0.5, 0.5, 0.5), floor=Floor(0.0, 5.0, (0.2, 0.2, 0.2))
    ),
    "gain lobe of share 0.3": Theatre(DOME, (0.5, 0.5, 0.5), lobe=Lobe(0.3, 0.3)),
}
