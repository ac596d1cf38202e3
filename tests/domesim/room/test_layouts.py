"""Projectors that the program places: they light all of the screen, with blends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from domesim.errors import InputError
from domesim.inspection.coverage import coverage
from domesim.room.dome import Dome
from domesim.room.layouts import around
from domesim.room.lenses import field_weight, lens_gains
from domesim.scene import DomeScene
from domesim.scene.drafts import DomeWish, dome_draft
from domesim.scene.loading import scene_of_text

wishes = st.builds(
    DomeWish,
    radius=st.floats(2, 25),
    tilt=st.floats(0, 35),
    half_angle=st.floats(70, 100),
    projectors=st.integers(1, 9),
    layout=st.sampled_from(("cove", "ring")),
)


@settings(max_examples=5, deadline=None)
@given(wishes)
def test_any_theatre_is_lit_and_blended(wish):
    _require_lit_and_blended(wish)


def _require_lit_and_blended(wish):
    scene = scene_of_text(dome_draft(wish, "mine"), "mine.toml", Path())
    assert isinstance(scene, DomeScene)
    lit = coverage(scene.theatre, 128)
    assert lit.dark <= 1e-3
    # Within a field by half of a soft edge, where a smooth step is a half; less by pixels between
    assert lit.weakest > 0.49
    sums = lens_gains(scene.theatre, 128, 128).sum(0)[scene.screen(128, 128)]
    assert np.all(np.abs(sums - 1) < 1e-3)


def test_fields_are_no_wider_than_they_must_be():
    """With three degrees less the screen has places too near to the edges of all fields."""
    dome = Dome(7.5, np.pi / 2, np.radians(20))
    lenses = around(dome, 5, "cove")
    points = dome.points(256, 256)[dome.inside(256, 256)]

    def weakest(less: float) -> float:
        narrow = [_narrower(lens, np.radians(less)) for lens in lenses]
        return float(np.max([field_weight(lens, points) for lens in narrow], axis=0).min())

    assert weakest(0) > 0.5
    assert weakest(3) < 0.5


def _narrower(lens, angle):
    return type(lens)(**{**vars(lens), "field": lens.field - angle})


@pytest.mark.parametrize("layout", ["cove", "ring"])
@pytest.mark.parametrize("count", [2, 3, 6])
def test_left_is_as_right_and_none_at_the_front(layout, count):
    dome = Dome(8.0, np.pi / 2, np.radians(15))
    places = np.array([lens.position for lens in around(dome, count, layout)])
    mirrored = places * [-1, 1, 1]
    apart = np.linalg.norm(places[:, None] - mirrored, axis=-1)
    assert apart.min(axis=0) == pytest.approx(0, abs=0.02)
    angle = np.degrees(np.arctan2(places[:, 0], places[:, 1]))
    assert np.all(np.abs(angle) > 20)


def test_a_cove_leans_with_the_dome_and_a_ring_does_not():
    dome = Dome(8.0, np.pi / 2, np.radians(15))
    cove, ring = (
        np.array([lens.position for lens in around(dome, 4, layout)]) for layout in ("cove", "ring")
    )
    assert np.ptp((cove @ dome.to_room)[:, 2]) < 0.02
    assert np.ptp(cove[:, 2]) > 2
    assert np.ptp(ring[:, 2]) == 0
    assert ring[0, 2] < dome.lowest


def test_there_must_be_room():
    with pytest.raises(InputError, match="at least 1, got 0"):
        around(Dome(8.0, np.pi / 2), 0, "cove")
    with pytest.raises(InputError, match="no room"):
        around(Dome(8.0, np.radians(120), np.radians(50)), 3, "ring")
