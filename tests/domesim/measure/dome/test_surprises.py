"""What nobody told a survey: walls of another paint, heavy-tailed noise, a misplaced camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from domesim.measure.dome.run import survey_of
from testing.laboratory import patterns_for
from testing.surveys import (
    NARROW,
    STATED,
    computed,
    described,
    even,
    heavy,
    surveyed,
    surveyed_alone,
    theatre,
)


@pytest.mark.long
def test_noise_with_heavy_tails_does_not_darken_what_is_found():
    """Cells that are bright by chance are not to count less."""
    z = np.array([surveyed(seed, noise=heavy).z["gain"] for seed in (0, 1)])
    assert abs(z.mean()) < 1
    assert np.abs(z).max() < 3.5


def test_a_misplaced_camera_is_not_taken_for_a_turned_one():
    found = surveyed(0).z
    assert np.abs([found["camera"], found["turn about"]]).max() < 3.5


@pytest.mark.long
def test_a_turned_camera_is_found_where_it_is():
    """What a camera sees is not linear in where it looks: 2.3 errors off by effects about 0."""
    rng = np.random.default_rng(7)
    real, camera = theatre(rng)
    moved = replace(camera, turn=(np.radians(3.0 * STATED.pointing_deg), 0.0, 0.0))
    patterns = patterns_for(real.dome, 64)
    shots = computed(real, camera, patterns, rng, lambda rng, light: 0.1 * even(rng, light), moved)
    _, found = survey_of(
        described(real, rng), patterns, shots, {}, STATED, profile=False, resolution=6
    )
    turn, error = found.nuisances["turn about x"]
    assert abs(turn - 3.0) < 2 * error
    assert error < 0.05


@pytest.mark.long
def test_noise_with_heavy_tails_widens_what_is_found_without_geometry_once():
    """Twice, and errors are a tenth of what is stated."""
    z = np.abs(surveyed_alone(heavy, 0).z)
    assert 0.3 < np.sqrt(np.mean(z**2)) < 2.5


def test_a_wall_that_is_not_seen_is_not_said_to_be_known():
    rng = np.random.default_rng(3)
    real, camera = theatre(rng, NARROW)
    real = replace(real, wall=replace(real.wall, albedo=(0.4, 0.3, 0.5)))
    told = described(real, rng, NARROW)
    told = replace(told, wall=replace(told.wall, albedo=(0.1, 0.1, 0.1)))
    patterns = patterns_for(real.dome, 64)
    _, found = survey_of(
        told, patterns, computed(real, camera, patterns, rng), {}, STATED, profile=False,
        resolution=6,
    )  # fmt: skip
    off = np.abs(found.value[3] - real.wall.albedo)
    assert np.all(off < 3 * found.error[3])
    assert found.complete


@pytest.mark.long
def test_a_floor_that_photographs_do_not_tell_is_held_as_described():
    """The camera looks up, at black, white and the front half, with much noise."""
    rng = np.random.default_rng(3)
    real, camera = theatre(rng)
    up = replace(camera, look_at=(0.0, 0.5, 5.0), field=np.radians(120.0))
    patterns = patterns_for(real.dome, 64)[:3]
    shots = computed(real, up, patterns, rng, lambda rng, light: 25 * even(rng, light))
    _, found = survey_of(described(real, rng), patterns, shots, {}, STATED, resolution=6)
    assert found.complete
    assert "floor" in found.leaning
    assert (found.error[found.names.index("floor")] < 0.26).all()
