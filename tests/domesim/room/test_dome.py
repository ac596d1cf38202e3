"""The dome's geometry against integrals and laws that know nothing of our formulas."""

from __future__ import annotations

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.room.dome import Dome

HALF_ANGLES = [15, 60, 90, 105, 150, 180]


@pytest.mark.parametrize("size", [4, 7])
@pytest.mark.parametrize("half_angle", HALF_ANGLES)
def test_each_pixels_area_is_its_part_of_the_sphere(half_angle, size):
    """The areas telescope, so that their sum can't fail: each against a fine midpoint rule."""
    dome = Dome(2.0, np.radians(half_angle))
    fine = 400
    at = (np.arange(size * fine) + 0.5) * 2 / (size * fine) - 1
    distance = np.hypot(at[:, None], at[None, :])
    density = dome.half_angle * np.sin(distance * dome.half_angle) / distance * (distance <= 1)
    cell = (2 / (size * fine)) ** 2 * dome.radius**2
    expected = (density * cell).reshape(size, fine, size, fine).sum((1, 3))
    areas = dome.pixel_areas(size, size)
    assert areas == pytest.approx(expected, abs=3e-4 * areas.max())
    reached = expected > 0
    assert ((areas > 1e-9 * areas.max()) == reached).all()


def test_directions_are_those_of_a_domemaster():
    dome = Dome(1.0, np.radians(120))
    directions = dome.directions(101, 101)
    assert np.linalg.norm(directions, axis=-1) == pytest.approx(1)
    assert directions[50, 50] == pytest.approx([0, 0, 1])
    right, front = directions[50, 100], directions[100, 50]
    assert right[0] > 0.8
    assert front[1] > 0.8
    halfway = directions[75, 50]
    expected = 50 / 101 * 120  # equidistant: the angle is proportional to the distance
    assert np.degrees(np.arccos(halfway[2])) == pytest.approx(expected)


def test_a_lens_in_the_centre_lights_evenly_and_a_near_wall_more():
    dome = Dome(3.0, np.radians(100))
    assert dome.lens_gain(9, 9, (0, 0, 0)) == pytest.approx(1)
    # 1 m from the zenith of a sphere of 3 m: r² / d² = 9
    assert dome.lens_gain(9, 9, (0, 0, 2.0))[4, 4] == pytest.approx(9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Dome(0.0, 1.0), "radius must be above 0 m, got 0"),
        (lambda: Dome(np.nan, 1.0), "radius"),
        (lambda: Dome(1.0, 0.0), "half-angle"),
        (lambda: Dome(1.0, 3.2), "at most 180"),
        (lambda: Dome(1.0, 1.0).pixel_areas(4, 6), "square, got 6 x 4"),
        (lambda: Dome(1.0, 1.0).inside(1, 1), "at least 2 x 2"),
        (lambda: Dome(1.0, 1.0).lens_gain(4, 4, (1, 0, 0)), "inside the sphere"),
    ],
)
def test_impossible_domes_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
