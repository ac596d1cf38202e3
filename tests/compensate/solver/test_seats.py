"""A seat of a dome: its pixels per degree, and models that take them place by place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compensate.figures import Appraisal
from compensate.pose import pose
from compensate.prediction import Combination, Prediction, predict, remaining
from compensate.vision.differences import visible_difference
from compensate.vision.resolution import by_resolution
from domesim.errors import InputError
from domesim.room.dome import Dome
from domesim.room.viewing import DomeSeat, from_dome_centre
from domesim.scene import load_dome


def test_the_scale_is_that_of_the_solid_angle_from_the_seat():
    """By the directions to points of the screen a little apart, of a dome that is no sphere."""
    dome = Dome(8.0, np.radians(95.0), np.radians(20.0), 0.8)
    seat = (1.5, -3.0, -0.7)
    size, finer = 24, 10_000
    scale = DomeSeat(dome, seat).scale(size, size)
    per_degree = from_dome_centre(dome, 1.0).pixels_per_degree(size, size)
    for row, col in [(3, 12), (12, 12), (11, 20), (18, 6)]:
        place = np.array([row, col]) + 0.5
        ways = []
        for down, right in ((0, 0), (1, 0), (0, 1)):
            v, u = (place + np.array([down, right]) / finer) * 2 / size - 1
            point = dome.surface(np.hypot(u, v) * dome.half_angle, np.arctan2(v, u))
            way = dome.to_room @ point - seat
            ways.append(way / np.linalg.norm(way))
        solid = np.linalg.norm(np.cross(ways[1] - ways[0], ways[2] - ways[0])) * finer**2
        found = 1 / np.degrees(np.sqrt(solid)) / per_degree
        assert scale[row, col] == pytest.approx(found, rel=1e-3)


def test_the_centre_sees_what_is_assumed_but_for_rings():
    dome = Dome(5.0, np.pi / 2)
    scale = DomeSeat(dome, (0.0, 0.0, 0.0)).scale(64, 64)
    theta = np.arccos(np.clip(dome.directions(64, 64)[..., 2], -1, 1))
    inside = dome.inside(64, 64)
    np.testing.assert_allclose(scale[inside], np.sqrt(theta / np.sin(theta))[inside], rtol=1e-5)
    with pytest.raises(InputError, match="inside the sphere"):
        DomeSeat(dome, (0.0, 5.1, 0.0))


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.7])
def test_one_resolution_is_the_models(factor):
    screen = np.ones((4, 5), bool)
    plane = np.arange(20.0).reshape(1, 4, 5)
    (found,) = by_resolution(np.full((4, 5), factor), screen, lambda f: (plane * f,))
    np.testing.assert_allclose(found, plane * factor, rtol=1e-4)


def test_each_place_has_its_own_resolution():
    """A model that is linear in the logarithm is exact between steps."""
    scale = np.geomspace(0.4, 2.3, 60).reshape(6, 10)
    screen = np.ones((6, 10), bool)
    screen[0] = False
    (found,) = by_resolution(scale, screen, lambda f: (np.full((2, 6, 10), 3 + np.log2(f)),))
    expected = np.broadcast_to(np.where(screen, 3 + np.log2(scale), 0), found.shape)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_steps_of_half_an_octave_are_fine_enough():
    random = np.random.default_rng(0)
    wanted = np.exp(random.normal(0, 1, (1, 64, 64, 1))).repeat(3, axis=-1)
    seen = wanted + random.uniform(0, 0.1, wanted.shape)
    scale = np.geomspace(0.5, 2.2, 64)[None].repeat(64, 0)
    screen = np.ones((64, 64), bool)

    def model(factor):
        return (visible_difference(wanted, seen, 8.0 * factor),)

    (coarse,), (fine,) = (by_resolution(scale, screen, model, step) for step in (0.5, 1 / 16))
    assert np.sqrt(np.mean((coarse - fine) ** 2)) < 0.015 * fine.mean()


@pytest.fixture(scope="module")
def night():
    down, across = np.mgrid[:64, :64] / 32 - 1
    light = 0.02 + 0.8 * (np.hypot(down, across - 0.4) < 0.25) + 0.1 * (np.sin(40 * across) > 0.9)
    return np.repeat(light[None, ..., None], 3, axis=-1).astype(np.float32)


def small(name):
    """A dome that is small to the eye, so that mechanisms have pixels."""
    scene = load_dome(name)
    return replace(scene, viewing=replace(scene.viewing, extent=16.0, image_area=200.0))


@pytest.mark.parametrize("combination", [Combination.WITH_VEILS, Combination.LOCAL_CONTRAST])
def test_predictions_are_made_for_the_seat(night, combination):
    settings = Prediction(combination=combination)
    scene = small("dome_planetarium")
    posed = pose(night, scene.seen_from("front"))
    found = predict(posed, settings=settings)
    assumed = predict(pose(night, scene), settings=settings)
    name = "masking" if combination is Combination.WITH_VEILS else "prediction"
    here, there = (getattr(each, name)[0, posed.screen] for each in (found, assumed))
    assert np.abs(here - there).max() > 0.01 * there.max()
    assert here.mean() == pytest.approx(there.mean(), rel=0.5)
    assert found.mask.any()
    assert not found.mask[:, ~posed.screen].any()
    left = predict(posed, posed.subtractive, settings)
    np.testing.assert_array_equal(remaining(posed, settings).mask, left.mask)


def test_quality_is_that_of_the_seat(night):
    scene = small("dome_planetarium")
    assumed, seated = (pose(night, each) for each in (scene, scene.seen_from("front")))
    np.testing.assert_array_equal(assumed.subtractive, seated.subtractive)
    # as far as the coarsest and finest of its resolutions
    scale = seated.scene.viewing.seat.scale(64, 64)[seated.screen]
    ends = [
        replace(scene, viewing=replace(scene.viewing, extent=scene.viewing.extent / float(factor)))
        for factor in (scale.min(), scale.max())
    ]
    least, most = sorted(Appraisal(pose(night, end)).loss(assumed.desired) for end in ends)
    assert 0.9 * least < Appraisal(seated).loss(seated.desired) < 1.1 * most
    assert Appraisal(seated).loss(seated.desired) != Appraisal(assumed).loss(assumed.desired)
