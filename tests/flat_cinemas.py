"""Small flat cinemas that can fail a test: uneven albedos, an off-centre screen, unequal eyes."""

from __future__ import annotations

import numpy as np
from pairs import COLOURED

from domesim.observation.base import AdjointObservation
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.glare import Scatter
from domesim.room.flat_room import FlatRoom
from domesim.scene.flat import LENS, PORT_GLASS, LightsWay

ROOM = FlatRoom(
    (10.0, 5.0),
    0.9,
    None,
    (14.0, 8.0, 20.0),
    1.0,
    (0.2, 0.1, 0.3),
    (0.5, 0.3, 0.2),
    (0.3, 0.2, 0.4),
    (0.2, 0.2, 0.1),
    (0.05, 0.1, 0.02),
    (0.15, 0.2, 0.3),
    5.0,
)
SCATTERS = {LENS: Scatter(0.02, 1.5, 0.05), PORT_GLASS: Scatter(0.01, 2.5, 0.08)}
WAY = LightsWay(ROOM.screen, 18.0, SCATTERS, ROOM)
SILVER = FlatRoom(**{**vars(ROOM), "gain": 1.8, "half_gain": 0.6})


def crosstalk(rows: int, cols: int) -> Crosstalk:
    """Colours leak into others, by a map, over a black of its own."""
    share = np.random.default_rng(1).random((2, rows, cols)) + 0.5
    return Crosstalk(rows, cols, COLOURED, share=share, black=[[0.001], [0.002]])


def cinema(rows: int, cols: int) -> AdjointObservation:
    return WAY.one_view(rows, cols, 0.003)


def lens_alone(rows: int, cols: int) -> AdjointObservation:
    return WAY.only(LENS, PORT_GLASS).one_view(rows, cols, 0.003)


def shutter(rows: int, cols: int) -> AdjointObservation:
    return WAY.two_views(crosstalk(rows, cols))


def polarised(rows: int, cols: int) -> AdjointObservation:
    way = LightsWay(SILVER.screen, 18.0, SCATTERS, SILVER, mixed=True)
    return way.two_views(crosstalk(rows, cols))


def room_and_pair(rows: int, cols: int) -> AdjointObservation:
    return WAY.only("room").two_views(crosstalk(rows, cols))


def room_and_flat_crosstalk(rows: int, cols: int) -> AdjointObservation:
    plain = Crosstalk(rows, cols, COLOURED, black=[[0.001, 0.002, 0.003], [0.002, 0.0, 0.001]])
    return WAY.only("room").two_views(plain)


COMPOSITIONS = {
    "cinema": cinema,
    "lens alone": lens_alone,
    "pair, shutter": shutter,
    "pair, polarised": polarised,
    "pair, room alone": room_and_pair,
    "pair, room, flat crosstalk": room_and_flat_crosstalk,
}
