"""Cameras, and the cells that photographs are averaged over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from survey_rooms import CAMERA, PATTERNS, THEATRE

from domesim.errors import InputError
from domesim.measure.dome.camera import Camera, domemaster_camera, looked_at, places_in
from domesim.measure.dome.model import Interreflection
from domesim.measure.dome.photographs import Photographs, cells_of
from domesim.room.rays import FLOOR, NOTHING, SCREEN
from domesim.room.theatre import Lobe


def shots(light: np.ndarray) -> Photographs:
    count = len(light)
    return Photographs(CAMERA, light, np.arange(count), np.ones(count))


def test_a_domemaster_is_seen_from_the_centre():
    size = 9
    surface, points = looked_at(THEATRE, domemaster_camera(THEATRE), *places_in(size))
    inside = THEATRE.dome.inside(size, size)
    assert np.all(surface[inside] == SCREEN)
    assert np.all(surface[~inside] == NOTHING)
    assert np.allclose(points[inside], THEATRE.dome.points(size, size)[inside], atol=1e-6)


def test_a_camera_that_looks_down_sees_the_floor_where_it_is():
    camera = Camera((0.3, 0.2, 0.5), (0.3, 0.2, -1.0), np.radians(90))
    surface, points = looked_at(THEATRE, camera, np.array([0.0, 0.5]), np.array([0.0, 0.0]))
    assert np.all(surface == FLOOR)
    assert np.allclose(points[0], (0.3, 0.2, -1.2), atol=1e-6)
    # Half of 45 degrees off the axis
    assert np.linalg.norm(points[1] - points[0]) == pytest.approx(1.7 * np.tan(np.radians(22.5)))


def test_a_turn_moves_what_is_seen():
    camera = Camera((0.0, 0, 0), (0.0, 1, 0), np.pi)
    turned = replace(camera, turn=(0.0, 0.0, 0.01))
    here, there = (each.rays(np.zeros(1), np.zeros(1))[0] for each in (camera, turned))
    assert np.allclose(there - here, (-0.01, 0, 0), atol=1e-4)


def test_cells_hold_means_of_one_surface_away_from_edges():
    rng = np.random.default_rng(0)
    size = 72
    light = 5 + 0.1 * rng.standard_normal((len(PATTERNS), size, size, 3))
    found = cells_of(THEATRE, PATTERNS, shots(light))
    assert set(found.places.surface) == {0, 1}
    assert found.area.sum() == pytest.approx(1)
    assert np.all(found.area[found.places.surface == 1] == 0)
    z = (found.value - 5) / np.sqrt(found.variance)
    assert 0.9 < np.sqrt(np.mean(z**2)) < 1.1
    assert np.allclose(found.variance * found.pixels[:, None], 0.01, rtol=0.3)


def test_a_camera_that_is_turned_a_little_sees_the_same_cells():
    size = 192
    turned = replace(CAMERA, turn=(0.02, -0.02, 0.03))
    surface, points = looked_at(THEATRE, turned, *places_in(size))
    on_screen = surface == SCREEN
    row, col = THEATRE.dome.pixel_of(THEATRE.dome.toward(points[on_screen]), PATTERNS.shape[1])
    light = np.zeros((len(PATTERNS), size, size, 3))
    light[:, on_screen] = PATTERNS[:, row, col]
    found = cells_of(THEATRE, PATTERNS, shots(light))
    assert np.allclose(found.value, found.places.direct)
    assert found.places.direct.max() == 1
    without = cells_of(THEATRE, PATTERNS, shots(light), margin=1e-6)
    assert not np.allclose(without.value, without.places.direct)


def test_a_pinhole_sees_the_same_cells():
    camera = Camera(
        (0.2, -2.0, 0.2), (0.2, 3.0, 0.4), np.radians(110), mapping="perspective", distortion=-0.05
    )
    size = 120, 160
    surface, points = looked_at(THEATRE, camera, *places_in(*size))
    assert {SCREEN, FLOOR} <= set(np.unique(surface))
    on_screen = surface == SCREEN
    row, col = THEATRE.dome.pixel_of(THEATRE.dome.toward(points[on_screen]), PATTERNS.shape[1])
    light = np.zeros((len(PATTERNS), *size, 3))
    light[:, on_screen] = PATTERNS[:, row, col]
    count = len(PATTERNS)
    taken = Photographs(camera, light, np.arange(count), np.ones(count))
    found = cells_of(THEATRE, PATTERNS, taken)
    assert np.allclose(found.value, found.places.direct)
    assert found.label.shape == size


def test_a_picture_ends_in_an_edge():
    # Beyond its border there may be the edge of a pattern
    size = 96
    border = np.ones((size, size), bool)
    border[2:-2, 2:-2] = False
    surface, _ = looked_at(THEATRE, CAMERA, *places_in(size))
    assert np.any(border & (surface == SCREEN))
    found = cells_of(THEATRE, PATTERNS, shots(np.ones((len(PATTERNS), size, size, 3))))
    assert not np.any(found.label[border] >= 0)


def test_exposures_are_divided_out():
    light = np.ones((len(PATTERNS), 48, 48, 3))
    exposure = np.arange(1.0, len(PATTERNS) + 1)
    given = replace(shots(light * exposure[:, None, None, None]), exposure=exposure)
    assert np.allclose(cells_of(THEATRE, PATTERNS, given).value, 1)


def test_patterns_of_fine_detail_leave_nothing():
    busy = np.random.default_rng(1).random((2, 50, 50, 3))
    with pytest.raises(InputError, match="few, large, even parts"):
        cells_of(THEATRE, busy, shots(np.ones((2, 48, 48, 3))))


def test_a_camera_below_the_floor_sees_no_screen():
    below = replace(CAMERA, position=(0.0, 0.0, -1.5), look_at=(0.0, 0.0, 0.0))
    taken = replace(shots(np.ones((len(PATTERNS), 48, 48, 3))), camera=below)
    with pytest.raises(InputError, match="sees nothing of the screen; is it below the floor"):
        cells_of(THEATRE, PATTERNS, taken)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"light": np.ones((2, 4, 5, 3))}, "must be square, of three primaries, got 5 x 4 x 3"),
        ({"exposure": np.array([1.0, 0.0])}, "exposures must be above 0"),
        ({"pattern": np.array([0])}, "need a pattern and an exposure each"),
    ],
)
def test_photographs_that_do_not_fit_together(change, message):
    with pytest.raises(InputError, match=message):
        replace(shots(np.ones((2, 4, 4, 3))), **change)


def test_a_theatre_that_radiosity_does_not_know():
    with pytest.raises(InputError, match="got a screen with a gain lobe"):
        Interreflection(replace(THEATRE, lobe=Lobe(0.3, 0.3)), PATTERNS)


def test_light_that_is_stopped_before_the_screen():
    floor = replace(THEATRE.floor, height=THEATRE.dome.lowest + 0.3 * THEATRE.dome.radius)
    with pytest.raises(InputError, match=r"got floor or wall before .* --without-geometry"):
        Interreflection(replace(THEATRE, floor=floor, wall=None), PATTERNS)
