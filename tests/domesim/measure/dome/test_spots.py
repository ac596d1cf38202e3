"""Readings of meters: data of the model itself, and what path tracing says of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
import survey_rooms
from survey_rooms import on_screen

from domesim.errors import InputError
from domesim.measure.dome import run
from domesim.measure.dome.fit import Known
from domesim.measure.dome.model import Interreflection, surfaces_of
from domesim.measure.dome.run import survey_of_spots
from domesim.measure.dome.spots import Reading, _surface, evidence_of
from domesim.observation.radiosity import radiosity
from domesim.room.theatre import Floor, Wall

WEIGHTS = np.array([0.2, 0.7, 0.1])
BLACK, WHITE, FRONT = 0, 1, 2
PATTERNS, THEATRE = survey_rooms.PATTERNS[:3], survey_rooms.THEATRE
GREY = replace(THEATRE, albedo=(0.5, 0.5, 0.5), floor=Floor(-1.2, 4.0, (0.2, 0.2, 0.2)))
PLAN = replace(THEATRE, albedo=(0.3, 0.3, 0.3), floor=Floor(-1.2, 4.0, (0.1, 0.1, 0.1)))
GAIN = 8.0


FRONT_PLACE, BACK_PLACE, ON_FLOOR = on_screen(40, 80), on_screen(50, 250), (0.5, 0.5, -1.2)
ALL = [
    (pattern, place, unit)
    for pattern in (BLACK, WHITE, FRONT)
    for place, unit in (
        (FRONT_PLACE, "cd/m2"),
        (BACK_PLACE, "cd/m2"),
        (BACK_PLACE, "lux"),
        (ON_FLOOR, "cd/m2"),
    )
]


coarse = partial(Interreflection, resolution=8)


@pytest.fixture(autouse=True)
def _coarse(monkeypatch):
    """Surveys by the radiosity that readings are of."""
    monkeypatch.setattr(run, "Interreflection", coarse)


@cache
def model() -> Interreflection:
    return coarse(GREY, PATTERNS)


def read(wanted: list, noise: float = 0.01, seed: int | None = None):
    """What meters show in GREY, with some stray light in lux and cd/m²."""
    blank = [Reading(pattern, place, unit, 0.0, 1.0) for pattern, place, unit in wanted]
    seen = evidence_of(GREY, PATTERNS, blank)
    albedos = np.array([GREY.albedo[1], GREY.floor.albedo[1]])
    shown, _ = model().shown(1, albedos, seen.places, model().seen_from(seen.places))
    rng = np.random.default_rng(seed)
    readings = []
    for number, one in enumerate(blank):
        spot = int(np.flatnonzero(np.isfinite(seen.variance[number, :, 0]))[0])
        value = GAIN * shown[one.pattern, spot] + 0.02
        error = noise * value
        value += 0 if seed is None else error * rng.standard_normal()
        readings.append(replace(one, value=float(value), error=float(error)))
    return readings


def test_readings_of_the_model_give_its_albedos_back():
    found = survey_of_spots(PLAN, PATTERNS, read(ALL), {}, WEIGHTS, profile=False)
    assert np.allclose(found.value[:, 0], (GAIN, 0.5, 0.2), rtol=1e-5)
    assert np.allclose(found.value, found.value[:, :1])
    assert found.ambient * GAIN == pytest.approx([0.02] * 3, rel=1e-4)
    assert found.degrees == 3 * (len(ALL) - 4 - 3)
    # One figure for all primaries is off by one error
    count = len(found.names)
    assert np.allclose(np.diag(found.correlations, count), 1)
    assert np.allclose(np.diag(found.correlations, 2 * count), 1)


def test_lux_and_luminance_of_one_lit_place_tell_its_albedo():
    pair = [(p, FRONT_PLACE, unit) for p in (BLACK, WHITE) for unit in ("cd/m2", "lux")]
    readings = read(pair, noise=0.005)
    known = {"floor": Known((0.2,) * 3)}
    found = survey_of_spots(PLAN, PATTERNS, readings, known, WEIGHTS)
    assert found.complete
    value = {(one.pattern, one.unit): one.value for one in readings}
    luminance = value[WHITE, "cd/m2"] - value[BLACK, "cd/m2"]
    illuminance = value[WHITE, "lux"] - value[BLACK, "lux"]
    assert found.value[1, 0] == pytest.approx(np.pi * luminance / illuminance, rel=1e-6)


def test_a_floor_that_readings_do_not_tell_is_held_as_described():
    """One place of the screen alone tells that of the screen."""
    readings = read([(p, FRONT_PLACE, unit) for p in (BLACK, WHITE) for unit in ("cd/m2", "lux")])
    found = survey_of_spots(PLAN, PATTERNS, readings, {}, WEIGHTS)
    assert found.complete
    assert found.leaning["floor"].value == pytest.approx((0.1,) * 3)
    assert found.error[2] == pytest.approx(0.25, rel=0.2)
    assert abs(found.value[1, 0] - 0.5) < 2 * found.error[1, 0]
    told = survey_of_spots(PLAN, PATTERNS, readings, {"floor": Known((0.2,) * 3)}, WEIGHTS)
    assert told.error[0, 0] < 0.5 * found.error[0, 0]


def test_luminance_of_white_and_black_is_not_enough():
    pair = [(p, FRONT_PLACE, "cd/m2") for p in (BLACK, WHITE)]
    found = survey_of_spots(PLAN, PATTERNS, read(pair), {}, WEIGHTS)
    assert not found.answered.any()


def test_lux_on_the_screen_is_what_radiosity_brings_there():
    (white,) = read([(WHITE, BACK_PLACE, "cd/m2"), (WHITE, BACK_PLACE, "lux")])[1:]
    transport = radiosity(GREY, resolution=8)
    light = np.ones((1, 41, 41, 3))
    seen = transport.observation(41, 41).observe(light)[0, ..., 1]
    away = np.linalg.norm(GREY.dome.points(41, 41) - np.array(BACK_PLACE), axis=-1)
    there = np.unravel_index(np.argmin(away), away.shape)
    assert white.value == pytest.approx(0.02 + np.pi * GAIN * seen[there] / 0.5, rel=2e-3)


def test_places_in_the_air():
    with pytest.raises(InputError, match=r"the place \[0.0, 0.0, 0.0\] is on no surface"):
        evidence_of(GREY, PATTERNS, [Reading(0, (0.0, 0.0, 0.0), "cd/m2", 1.0, 0.1)])


def test_readings_of_lux_only():
    with pytest.raises(InputError, match="wanted readings in cd/m2 of the screen"):
        survey_of_spots(GREY, PATTERNS, read([(0, FRONT_PLACE, "lux")]), {}, WEIGHTS)


def test_where_two_surfaces_meet_the_first_counts():
    """Rounding would choose: where floor and wall meet, a place is off one of them by 1e-16."""
    room = replace(GREY, wall=Wall(3.7, -1.2, 2.0, (0.2, 0.2, 0.2)))
    for height in (-1.2, np.nextafter(-1.2, 0)):
        assert surfaces_of(room)[_surface(room, (3.7, 0.0, height))[0]] == "floor"
