"""The project's own picture: repeatable, in range, with bright and dark parts."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from domesim.room.dome import Dome
from scenes.artwork.night import sky
from scenes.artwork.night.picture import Night, directions, render, shoulder

SMALL = Night(size=64, samples=1, detail=0.02)
CIRCLE = Dome(radius=1.0, half_angle=np.pi / 2).inside(64, 64)


@pytest.fixture(scope="module")
def picture() -> NDArray[np.float32]:
    return render(SMALL)


def test_same_seed_same_picture(picture: NDArray[np.float32]) -> None:
    np.testing.assert_array_equal(render(SMALL), picture)


def test_black_outside_the_circle_and_in_range_inside(picture: NDArray[np.float32]) -> None:
    assert picture.shape == (64, 64, 3)
    assert not picture[~CIRCLE].any()
    assert picture.min() >= 0.0
    assert picture.max() <= 1.0


def test_bright_house_in_front_and_most_is_dark(picture: NDArray[np.float32]) -> None:
    luminance = picture @ np.array([0.2126, 0.7152, 0.0722])
    assert luminance[CIRCLE].max() > 0.8
    assert np.mean(luminance[CIRCLE] < 0.03) > 0.5
    front, rear = luminance[48:], luminance[:16]
    assert front.mean() > 10 * rear.mean()


def test_directions_agree_with_the_dome() -> None:
    centres = (np.arange(7) + 0.5) / 7 * 2 - 1
    across, down = np.meshgrid(centres, centres)
    dome = Dome(radius=1.0, half_angle=np.pi / 2)
    np.testing.assert_allclose(directions(across, down, 0.0), dome.directions(7, 7), atol=1e-12)


def test_the_front_rim_of_a_tilted_theatre_is_below_the_horizon() -> None:
    np.testing.assert_allclose(
        directions(np.array(0.0), np.array(1.0), 22.0), sky.direction(0.0, -22.0), atol=1e-12
    )


def test_shoulder_leaves_the_dark_alone_and_stays_below_white() -> None:
    light = np.array([0.0, 0.002, 0.6, 0.601, 3.0, 12.0])
    bent = shoulder(light)
    np.testing.assert_array_equal(bent[:3], light[:3])
    assert np.all(np.diff(bent) > 0)
    assert bent[-1] <= 1.0
    assert bent[3] == pytest.approx(0.601, abs=1e-5)


def test_stars_are_as_many_of_each_magnitude_as_in_the_sky() -> None:
    stars = sky.star_catalogue(3, count=50_000)
    strength = stars.flux.max(axis=1)
    seen = (stars.directions[:, 2] > 0.5) & (strength > 0)  # little air, and not behind the moon
    magnitude = np.sort(-2.5 * np.log10(strength[seen]))
    brighter_5, brighter_6 = np.searchsorted(magnitude, [5.0, 6.0])
    assert brighter_6 / brighter_5 == pytest.approx(10**0.5, rel=0.1)
