"""Views at a glance: what is where, and light on other surfaces by laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from domesim.pathtrace.glance import glance
from domesim.room.dome import Dome
from domesim.room.furniture import box
from domesim.room.theatre import Floor, Theatre, Viewpoint, Wall

DOME = Dome(5.0, np.pi / 2)
BARE = Theatre(DOME, (0.5, 0.5, 0.5))
UP = Viewpoint((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def picture(size: int) -> np.ndarray:
    """Unlike left and right, and up and down."""
    return np.random.default_rng(3).random((size, size, 3))


def test_from_the_centre_upwards_it_is_the_domemaster():
    light = picture(33)
    found = glance(BARE, light, UP, 33)
    inside = DOME.inside(33, 33)
    assert np.array_equal(found.inside, inside)
    assert np.array_equal(found.picture[inside], light[inside])
    assert found.screen_share == 1


def test_ahead_of_the_centre_is_the_front_and_half_of_it_is_screen():
    light = np.zeros((64, 64, 3))
    light[48:] = 1  # the domemaster's bottom is the front
    found = glance(BARE, light, Viewpoint((0.0, 0.0, 0.0), (0.0, 9.0, 0.0)), 64)
    assert found.picture[28, 32] == pytest.approx(1)
    assert found.picture[2, 32] == pytest.approx(0)
    assert np.all(found.picture[32:] == 0)
    assert found.screen_share == pytest.approx(0.5, abs=0.01)


def test_under_an_even_sky_a_floor_is_as_bright_as_its_albedo():
    """E = pi L under a hemisphere of luminance L: a floor in its middle shows albedo L."""
    room = replace(BARE, floor=Floor(0.0, 5.0, (0.2, 0.4, 0.6)))
    eye = Viewpoint((0.0, 0.0, 0.5), (0.0, 0.0, 0.0))
    found = glance(room, np.full((64, 64, 3), 2.0), eye, 33)
    assert found.picture[16, 16] == pytest.approx([0.4, 0.8, 1.2], rel=0.02)


def test_what_stands_before_the_screen_hides_it():
    thing = box("thing", (-0.5, 1.0, -0.5), (0.5, 1.5, 0.5), (0.0, 0.0, 0.0))
    room = replace(BARE, solids=(thing,), floor=Floor(-1.0, 5.0, (0.1,) * 3),
                   wall=Wall(5.0, -1.0, 0.0, (0.1,) * 3))  # fmt: skip
    found = glance(room, np.ones((32, 32, 3)), Viewpoint((0.0, 0.0, 0.0), (0.0, 9.0, 0.0)), 65)
    assert np.all(found.picture[32, 32] == 0)
    assert np.all(found.picture[5, 32] == 1)
    assert 0 < found.picture[60, 32, 0] < 0.1
    assert found.screen_share < 0.47
