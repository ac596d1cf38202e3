"""Soft edges for the ghosts that subtraction leaves."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from compensate.contrast import ContrastWeighting
from compensate.ghosts import edge_sigma, slope_magnitudes
from compensate.master import Posed, pose, solved
from compensate.softening import Softener, Softening, SoftGhosts
from compensate.solver.admm import ADMM
from domesim.errors import InputError
from domesim.light import Light
from domesim.scene import Scene, StereoScene, load_scene

DENSITY, FLOOR, WHITE = 30.0, 0.005, 48.0
SCREEN = np.ones((90, 180), bool)
COLOUR = np.array([1.0, 0.6, 0.3])


def stereo() -> Scene:
    return load_scene("stereo_polarised_paper")


def fine(scene: Scene) -> Scene:
    """So that 96 columns are 30 to a degree."""
    assert isinstance(scene, StereoScene)
    return replace(scene, viewing=replace(scene.viewing, extent=96 / 30))


def left_by(height: float) -> Light:
    """A coloured ghost in the right half of the second view."""
    left = np.zeros((2, *SCREEN.shape, 3))
    left[1, :, 90:] = height * COLOUR
    return left


def ghosts(left: Light, around: float, settings: Softening) -> SoftGhosts:
    softener = Softener(settings, SCREEN, DENSITY, FLOOR, WHITE)
    return softener.ghosts(left, left.mean(axis=-1), np.full(left.shape[:3], around))


def rims(height: float, around: float, settings: Softening) -> Light:
    return ghosts(left_by(height), around, settings).rims()


def bars() -> Light:
    """A lit bar on black in the left view, and something grey that its ghost partly falls on."""
    light = np.zeros((2, 48, 96, 3), np.float32)
    light[0, 8:40, 30:50] = (0.9, 0.8, 0.5)
    light[1, 24:, :] = 0.3
    light[0, 24:, :30] = light[0, 24:, 50:] = 0.3
    return light


def test_a_rim_is_half_as_high_as_the_ghost_and_falls_off_outside_it() -> None:
    settings = Softening(height=1.0, contrast=1e6, crowding=0)
    found = rims(0.02, 0.0, settings)
    assert np.all(found[0] <= 1e-7)
    assert np.all(found[1, :, 90:] <= 1e-7)
    outside = found[1, 45, :90]
    assert outside[-1] / (0.02 * COLOUR) == pytest.approx(0.5, abs=0.06)
    assert np.all(np.diff(outside, axis=0) >= -1e-9)
    # As high as a Gaussian's integral, and none at four standard deviations
    deviation = round(settings.reach * DENSITY)
    beyond = (outside[-1 - deviation] + outside[-deviation]) / 2
    assert beyond / (0.02 * COLOUR) == pytest.approx(0.159, abs=0.01)
    assert np.all(outside[: 90 - 4 * deviation - 1] <= 1e-6)


def test_gaps_between_many_ghosts_are_not_filled() -> None:
    """Beside one narrow ghost the wider mean is little, between many it is theirs."""
    settings = Softening(height=1.0, contrast=1e6, reach=0.1, crowding=0.5, crowd=0.4)
    one, many = np.zeros((2, 2, *SCREEN.shape, 3))
    one[:, :, 90:93] = 0.02
    many[:, :, ::10] = many[:, :, 1::10] = many[:, :, 2::10] = 0.02
    beside, between = (ghosts(left, 0.0, settings).rims()[0, 45] for left in (one, many))
    without = ghosts(many, 0.0, replace(settings, crowding=0)).rims()[0, 45]
    mean = many[0, 45].mean()
    np.testing.assert_allclose(between[95], without[95] - 0.5 * mean, rtol=0.02)
    assert np.all(between[95] > 0)
    assert np.all(beside[95] > 1.2 * between[95])


def test_changes_are_held_back_around_ghosts_that_stand_out() -> None:
    height, firm, firmness = 0.02, 4.0, 9.0
    settings = Softening(firm=firm, firmness=firmness)
    luminance = height * COLOUR.mean()
    around = luminance / firm - settings.dark / WHITE
    half = ghosts(left_by(height), around, settings).stiffness()
    assert half.shape == (1, *SCREEN.shape, 1)
    assert half[0, 45, 90:, 0] == pytest.approx(1 + firmness / 2, rel=1e-6)
    assert half[0, 45, 0, 0] == pytest.approx(1)  # too far away
    lit = ghosts(left_by(height), 0.9, settings).stiffness()
    assert lit == pytest.approx(np.ones_like(half), abs=1e-3)
    assert ghosts(left_by(height), around, replace(settings, firmness=0)).stiffness() is None


def test_changes_are_held_back_where_one_eye_sees_black() -> None:
    """They show in both."""
    left, settings = left_by(0.02), Softening()
    found = []
    for black in ((), (0,), (1,), (0, 1)):
        around = np.full(left.shape[:3], 0.9)
        around[list(black)] = 0
        softener = Softener(settings, SCREEN, DENSITY, FLOOR, WHITE)
        found.append(softener.ghosts(left, left.mean(axis=-1), around).stiffness())
    lit, *others = (each[0, 45, 150, 0] for each in found if each is not None)
    assert lit == pytest.approx(1, abs=1e-3)
    assert min(others) > 5
    assert max(others) == pytest.approx(min(others))


def test_what_a_problem_holds_back() -> None:
    """Around ghosts of a pair that stand out, and nowhere in a dome."""
    posed, _ = softened(Softening())
    assert posed.problem.stiffness is not None
    assert posed.problem.stiffness.max() > 1.5
    dome = pose(bars()[:1, :, :48], load_scene("dome_hemisphere"), ContrastWeighting())
    assert dome.problem.stiffness is None


def test_a_step_counts_by_its_share_of_the_brightest_ghost() -> None:
    left = left_by(0.02)
    share = 0.1
    left[0, :, 90:] = share * 0.02 * COLOUR  # a faint step in the other view, beside a bright one
    luminance, local = left.mean(axis=-1), 0.4
    half, whole = (
        ghosts(left, local, Softening(step=step, near=0.01)).factor(np.full(luminance.shape, local))
        for step in (share, 1e-6)
    )
    exponents = [np.log(each[0, 45, 89:91]) for each in (half, whole)]
    # A step as high as t of the ghost, which c is small beside, has half of the effect
    assert exponents[0] / exponents[1] == pytest.approx(0.5, abs=0.12)


def test_a_rim_keeps_the_colour_of_its_ghost_and_goes_with_its_height() -> None:
    faint, bright = (rims(each, 0.1, Softening(contrast=1e6)) for each in (0.01, 0.02))
    np.testing.assert_allclose(bright, 2 * faint, rtol=1e-6)
    lit = bright[1, 45, 80:90]
    np.testing.assert_allclose(lit / lit[:, :1], np.broadcast_to(COLOUR, lit.shape), rtol=1e-6)


def test_half_a_rim_is_left_where_the_ghost_stands_out_as_many_times_as_set() -> None:
    height, contrast = 0.02, 2.0
    luminance = height * COLOUR.mean()
    around = luminance / contrast - Softening().dark / WHITE
    full, half = (rims(height, around, Softening(contrast=each)) for each in (1e6, contrast))
    np.testing.assert_allclose(half[1, :, 80:90], full[1, :, 80:90] / 2, rtol=1e-5)


def test_beside_a_ghost_what_is_brighter_counts_as_the_ghost_and_far_away_as_itself() -> None:
    """And what is darker than the ghost, as itself everywhere."""
    left = left_by(0.02)
    height = left.mean(axis=-1).max()
    softened = ghosts(left, 0.4, Softening(near=0.1))
    bright = softened.factor(np.full(left.shape[:3], 0.4))
    assert bright[1, 45, 88:92] == pytest.approx((0.4 + FLOOR) / (height + FLOOR), rel=0.35)
    assert np.all(bright >= 1)
    assert np.all(bright[0] == 1)
    np.testing.assert_allclose(bright[1][:, [0, 30, 150, 179]], 1, rtol=1e-3)
    dark = softened.factor(np.full(left.shape[:3], height / 3))
    np.testing.assert_allclose(dark, 1, rtol=1e-7)


def test_ghosts_far_fainter_than_the_eye_sees_have_no_edges() -> None:
    """Rounding must not make a lit thing count a hundred times."""
    left = left_by(1e-6)
    factor = ghosts(left, 0.5, Softening()).factor(np.full(left.shape[:3], 0.5))
    np.testing.assert_allclose(factor, 1, atol=0.02)


def softened(softening: Softening | None, tolerance: float = 1e-3) -> tuple[Posed, Light]:
    posed = pose(bars(), fine(stereo()), ContrastWeighting(softening=softening))
    return posed, ADMM(tolerance=tolerance)(posed.problem, posed.subtractive).light


def steepest(posed: Posed, light: Light) -> float:
    """Root of the mean squared slope of what is seen too much, where subtraction leaves any."""
    ghosts = posed.residual(posed.subtractive).max(axis=-1) > 1e-5
    error = posed.residual(light) @ posed.scene.projector.luminance_weights
    slopes = slope_magnitudes(np.ascontiguousarray(error), edge_sigma(DENSITY))
    return float(np.sqrt(np.mean(slopes[ghosts] ** 2)))


def test_edges_of_ghosts_are_softer_than_the_least_visible_error_leaves_them() -> None:
    posed, plain = softened(None)
    _, soft = softened(Softening(contrast=1e3))
    assert steepest(posed, soft) < 0.85 * steepest(posed, plain)


def test_only_what_is_aimed_at_is_softened_not_what_is_wanted() -> None:
    posed, light = softened(Softening())
    problem = posed.problem
    np.testing.assert_array_equal(problem.desired, posed.wanted)
    assert np.all(problem.aim >= posed.wanted)
    assert np.any(problem.aim > posed.wanted)
    seen = problem.observation.observe(light)
    by_hand = problem.weighting.energy((seen - problem.aim) * problem.contrast)
    assert problem.cost(light) == pytest.approx(0.5 * by_hand + problem.penalty(light), rel=1e-5)


def test_the_aim_is_no_brighter_than_the_ghost_that_is_softened() -> None:
    posed, _ = softened(Softening())
    left = np.maximum(posed.residual(posed.subtractive), 0)
    above = (posed.problem.aim - posed.wanted).max(axis=(0, 1, 2))
    assert np.all(above <= left.max(axis=(0, 1, 2)))


def test_changes_are_counted_from_exact_subtraction_of_the_aim() -> None:
    """So that rims are not damped."""
    posed, _ = softened(Softening(contrast=1e3))
    problem, start = posed.problem, posed.start
    seen = problem.observation.observe(start)
    free = np.all((start > problem.lower) & (start < problem.upper), axis=(0, 3))
    assert np.any(np.abs(start - posed.subtractive)[:, free] > 1e-4)
    np.testing.assert_allclose(seen[:, free], problem.aim[:, free], atol=1e-6)
    assert problem.penalty(start) == 0


def test_what_subtraction_shows_exactly_is_aimed_at_as_it_is() -> None:
    light = np.full((2, 24, 40, 3), 0.4, np.float32)
    posed = pose(light, stereo(), ContrastWeighting())
    assert posed.exact
    np.testing.assert_allclose(posed.problem.aim, posed.wanted, atol=1e-6)


def test_a_dome_has_no_ghosts_to_soften() -> None:
    posed = pose(bars()[:1, :, :48], load_scene("dome_hemisphere"), ContrastWeighting())
    assert posed.problem.aim is posed.problem.desired


@pytest.mark.parametrize("name", [each.name for each in fields(Softening)])
@pytest.mark.parametrize("value", [0.0, -1.0, np.inf, np.nan])
def test_settings_without_sense_are_refused(name: str, value: float) -> None:
    maybe = name in ("crowding", "firmness")
    if maybe and value == 0:
        assert getattr(Softening(**{name: value}), name) == 0
        return
    least = "at least" if maybe else "above"
    with pytest.raises(InputError, match=f"the {name} of softening must be {least} 0"):
        Softening(**{name: value})


def test_the_products_method_solves_it() -> None:
    posed = pose(bars(), fine(stereo()), ContrastWeighting())
    result = solved(posed, "perceptual")
    assert result.gap is not None
    assert result.gap <= 1e-3
