"""Leeway: how far compensation may leave subtraction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from compensate.contrast import ContrastWeighting
from compensate.leeway import Leeway, brightest_nearby
from compensate.master import pose, solved
from domesim.errors import InputError
from domesim.light import Light
from domesim.scene import Scene, load_scene

RANDOM = np.random.default_rng(11)


def stereo() -> Scene:
    return load_scene("stereo_polarised_paper")


def ghosts() -> Light:
    """A pair: something bright on black in the left view, a lit wall beside it, black right."""
    light = np.zeros((2, 40, 120, 3), np.float32)
    light[0, 10:30, 20:30] = (0.9, 0.8, 0.5)
    light[0, :, 70:] = 0.3
    light[1, :, 70:] = 0.3
    return light


def test_brightest_nearby_is_between_maxima_of_smaller_and_larger_squares() -> None:
    picture = RANDOM.random((61, 83, 2)).astype(np.float32) - 0.2
    near = brightest_nearby(np.stack([0 * picture, picture]), 12.0)
    smaller, larger = (
        maximum_filter(np.maximum(picture, 0), size=(2 * k + 1, 2 * k + 1, 1), mode="nearest")
        for k in (12 - 6, 12 + 6)
    )
    assert np.all(near >= smaller - 1e-6)
    assert np.all(near <= larger + 1e-6)


@pytest.mark.parametrize("reach", [0.2, 1.0, 3.0])
def test_brightest_nearby_is_never_below_the_pixel_itself(reach: float) -> None:
    picture = RANDOM.random((17, 23, 3)).astype(np.float32)
    assert np.all(brightest_nearby(picture[None], reach) >= picture - 1e-6)


def test_nothing_changes_by_more_than_the_ghosts_that_subtraction_leaves() -> None:
    posed = pose(ghosts(), stereo(), ContrastWeighting())
    change = solved(posed, "perceptual").light - posed.subtractive
    most = posed.residual(posed.subtractive).max(axis=(0, 1, 2))
    assert most.min() > 0
    most = Leeway().times * most
    assert np.all(np.abs(change).max(axis=(0, 1, 2)) <= most * (1 + 1e-5))
    assert np.abs(change).max() > 0.1 * most.max()


def test_nothing_changes_where_no_ghost_is_near() -> None:
    posed = pose(ghosts(), stereo(), ContrastWeighting(leeway=Leeway(reach=0.1)))
    change = solved(posed, "perceptual").light - posed.subtractive
    far = np.s_[:, :, 110:]
    assert np.all(posed.residual(posed.subtractive)[far] <= 1e-6)
    np.testing.assert_allclose(change[far], 0, atol=1e-6)


def test_nothing_lit_loses_more_than_a_share_of_its_light() -> None:
    losses = []
    for share in (1.0, 0.005):
        leeway = Leeway(share=share)
        posed = pose(ghosts(), stereo(), ContrastWeighting(leeway=leeway))
        lit = posed.subtractive > 0.01
        kept = (solved(posed, "perceptual").light / np.where(lit, posed.subtractive, 1))[lit]
        losses.append(1 - kept.min())
    assert losses[0] > 0.01
    assert losses[1] <= 0.005 + 1e-5


def test_the_projector_bounds_stay() -> None:
    problem = pose(ghosts(), stereo(), ContrastWeighting(leeway=Leeway(times=1000.0))).problem
    assert problem.lower.min() == 0
    assert problem.upper.max() == 1


def test_leeway_raises_the_least_visible_error_and_stays_below_subtractions() -> None:
    errors = []
    for leeway in (None, Leeway(2.0), Leeway(1.0), Leeway(0.5)):
        posed = pose(ghosts(), stereo(), ContrastWeighting(leeway=leeway))
        errors.append(posed.visible_error(solved(posed, "perceptual").light))
    assert errors == sorted(errors)
    assert errors[0] < errors[-1] < posed.error_subtractive


def test_a_dome_and_the_papers_weighting_have_the_projectors_bounds() -> None:
    room, picture = load_scene("dome_hemisphere"), ghosts()[:1, :, :40]
    for posed in (pose(ghosts(), stereo()), pose(picture, room, ContrastWeighting())):
        assert posed.problem.lower.ndim == 0


@pytest.mark.parametrize(
    "settings", [{"times": 0.0}, {"reach": -1.0}, {"times": np.inf}, {"share": 0.0}]
)
def test_leeway_refuses_what_is_not_above_0(settings: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(settings))):
        Leeway(**settings)
