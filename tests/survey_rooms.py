"""A leaning theatre, patterns for it, and what a camera would see by the model itself."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from domesim.measure.dome.camera import Camera
from domesim.measure.dome.fit import Evidence
from domesim.measure.dome.model import Interreflection, nominal_albedos
from domesim.measure.dome.photographs import Cells, Photographs, cells_of
from domesim.room.dome import Dome
from domesim.room.theatre import Floor, Theatre
from testing.laboratory import patterns_for

THEATRE = Theatre(
    Dome(4.0, np.radians(85), tilt=0.1), (0.6, 0.45, 0.3), floor=Floor(-1.2, 4.0, (0.2, 0.15, 0.08))
)
CAMERA = Camera((0.2, -0.4, -0.3), (0.1, 1.5, 1.2), np.radians(220))
GAIN = np.array([3.0, 4.0, 5.0])
PATTERNS = patterns_for(THEATRE.dome, 50)


def on_screen(theta_deg: float, azimuth_deg: float) -> tuple[float, float, float]:
    """A place of the screen, m, by its angles from the zenith and about it."""
    angles = np.radians(theta_deg), np.radians(azimuth_deg)
    point = THEATRE.dome.surface(*map(np.array, angles)) @ THEATRE.dome.to_room.T
    return tuple(float(x) for x in point)


@cache
def model() -> Interreflection:
    return Interreflection(THEATRE, PATTERNS, resolution=6)


@cache
def cells(size: int = 64) -> Cells:
    blank = np.ones((len(PATTERNS), size, size, 3))
    shots = Photographs(CAMERA, blank, np.arange(len(PATTERNS)), np.ones(len(PATTERNS)))
    return cells_of(THEATRE, PATTERNS, shots)


@cache
def shown() -> np.ndarray:
    """(pattern, place, primary) without ambient."""
    albedos, places = nominal_albedos(THEATRE), cells().places
    seen = model().seen_from(places)
    light = [model().shown(p, albedos[:, p], places, seen)[0] for p in range(3)]
    return np.stack(light, -1) * GAIN


def ambient() -> np.ndarray:
    return 0.01 + 0.01 * np.random.default_rng(3).random(shown().shape[1:])


def evidence(noise: float = 0.003, seed: int | None = None) -> Evidence:
    """Photographs of all patterns; noise is stated, and there if there is a seed."""
    value = shown() + ambient()
    spread = noise * value
    found = cells()
    if seed is not None:
        value = value + spread * np.random.default_rng(seed).standard_normal(value.shape)
    pattern = np.arange(len(PATTERNS))
    return Evidence(found.places, pattern, value, spread**2, found.area)


def only(whole: Evidence, photographs: list[int], surface: int | None = None) -> Evidence:
    """Of some photographs, and of one surface."""
    places = whole.places
    kept = slice(None) if surface is None else places.surface == surface
    fewer = replace(
        places,
        surface=places.surface[kept],
        points=places.points[kept],
        direct=places.direct[:, kept],
    )
    return replace(
        whole,
        places=fewer,
        pattern=whole.pattern[photographs],
        value=whole.value[photographs][:, kept],
        variance=whole.variance[photographs][:, kept],
        area=whole.area[kept],
    )
