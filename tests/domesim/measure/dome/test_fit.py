"""The inverse problem by itself: data of the model that is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from survey_rooms import GAIN, THEATRE, ambient, cells, evidence, model, only

from domesim.errors import InputError
from domesim.measure.dome.fit import Known, _doubts, _weakest, survey
from domesim.measure.dome.model import nominal_albedos
from testing.statistics import assert_unbiased

TRUTH = np.concatenate([[GAIN], nominal_albedos(THEATRE)])
START = np.array([[0.4] * 3, [0.3] * 3])
BLACK, WHITE = 0, 1
SURFACES = ("screen", "floor")


def test_slopes_are_those_of_the_light():
    albedos, places, step = np.array([0.6, 0.2]), cells().places, 1e-6
    seen = model().seen_from(places)
    _, slopes = model().shown(0, albedos, places, seen)
    for surface, change in enumerate(np.eye(2) * step):
        above = model().shown(0, albedos + change, places, seen)[0]
        below = model().shown(0, albedos - change, places, seen)[0]
        assert np.allclose((above - below) / (2 * step), slopes[surface], atol=1e-7)


def test_light_without_noise_is_explained_exactly():
    found = survey(model(), evidence(), START, SURFACES, profile=False)
    assert np.allclose(found.value, TRUTH, rtol=1e-6)
    mean = (cells().area @ ambient()) / GAIN
    assert np.allclose(found.ambient, mean, rtol=1e-5)
    assert found.complete
    assert found.model_error == 0


def test_standard_errors_are_the_spread():
    runs = [
        survey(model(), evidence(seed=seed), START, SURFACES, profile=False) for seed in range(12)
    ]
    assert all(run.plausible for run in runs)
    values, errors = np.array([run.value for run in runs]), np.array([run.error for run in runs])
    assert_unbiased(values, errors, TRUTH)
    z = (values - TRUTH) / errors
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.25
    shown = np.array([run.ambient for run in runs]), np.array([run.ambient_error for run in runs])
    assert_unbiased(*shown, (cells().area @ ambient()) / GAIN)


def test_white_and_black_of_the_screen_do_not_tell_gain_from_albedo():
    seen = only(evidence(seed=1), [BLACK, WHITE], surface=0)
    found = survey(model(), seen, START, SURFACES)
    assert not found.answered[:2].any()
    assert len(found.confusions) == 3
    assert found.confusions[0].startswith("R: gain, screen, floor cannot be told")
    held = {
        "gain": Known((3.0, 4.0, 5.0)),
        "floor": Known(THEATRE.floor.albedo),
    }
    told = survey(model(), seen, START, SURFACES, held)
    assert told.complete
    assert_unbiased(told.value[1], told.error[1], TRUTH[1])


def test_what_is_too_uncertain_is_not_answered():
    seen = only(evidence(seed=1), [BLACK, WHITE], surface=0)
    x, y, z = THEATRE.floor.albedo
    for spread, answered in ((0.02, True), (0.06, False)):
        held = {"gain": Known((3.0, 4.0, 5.0)), "floor": Known((x, y, z), (spread,) * 3)}
        found = survey(model(), seen, START, SURFACES, held, profile=False)
        assert np.all(found.answered[2] == answered)


def test_one_pattern_tells_nothing():
    with pytest.raises(InputError, match=r"primary R: no place .* lit and unlit; add photographs"):
        survey(model(), only(evidence(), [WHITE]), START, SURFACES)


def test_what_the_theatre_has_not_cannot_be_held():
    with pytest.raises(InputError, match="wall cannot be held: the theatre has gain, screen"):
        survey(model(), evidence(), START, SURFACES, {"wall": Known((0.1,) * 3)})


def test_what_is_known_within_an_error_is_weighed():
    wrong = Known((0.3, 0.3, 0.3), (0.2, 0.2, 0.2))
    found = survey(model(), evidence(), START, SURFACES, {"floor": wrong}, profile=False)
    assert np.allclose(found.value, TRUTH, rtol=2e-3)
    sure = Known((0.3, 0.3, 0.3), (1e-5, 1e-5, 1e-5))
    found = survey(model(), evidence(), START, SURFACES, {"floor": sure}, profile=False)
    assert np.allclose(found.value[2], 0.3, atol=1e-3)


def test_a_wrong_model_is_noticed_and_widens_intervals():
    seen = evidence(seed=2)
    bent = 1 + 0.02 * np.random.default_rng(5).standard_normal(seen.value.shape)
    wrong = replace(seen, value=seen.value * bent)
    found = survey(model(), wrong, START, SURFACES, profile=False)
    sound = survey(model(), seen, START, SURFACES, profile=False)
    assert not found.plausible
    assert 0.016 < found.model_error < 0.025
    assert np.all(found.error > 3 * sound.error)
    assert_unbiased(found.value, found.error, TRUTH)


def test_a_nuisance_is_found_and_costs_certainty():
    seen = evidence(seed=4)
    count = len(seen.value), *seen.value.shape[1:]
    effects = 0.05 * np.random.default_rng(6).standard_normal(count)[None]
    shifted = replace(
        seen,
        names=("a lens",),
        effects=effects,
        value=seen.value + (seen.value - ambient()) * effects[0] * 1.5,
    )
    found = survey(model(), shifted, START, SURFACES, profile=False)
    value, error = found.nuisances["a lens"]
    assert error < 0.1
    assert found.plausible
    assert_unbiased(value, error, 1.5)
    assert_unbiased(found.value, found.error, TRUTH)


def test_photographs_that_were_mixed_up_are_not_answered():
    seen = evidence(seed=3)
    mixed = replace(seen, pattern=seen.pattern[[0, 1, 3, 2, 4, 5, 6]])
    found = survey(model(), mixed, START, SURFACES, profile=False)
    assert not found.answered.any()
    assert found.confusions[0].startswith("the description does not explain the photographs")


@pytest.mark.parametrize("seed", range(6))
def test_rounding_decides_nothing_of_what_is_not_told(seed):
    """Two surfaces that nobody sees have one variance, and two nuisances one value."""
    noise = 1e-13 * np.random.default_rng(seed).standard_normal((4, 4))
    unseen = np.diag([1.0, 2.0, 1e12, 1e12]) * (1 + noise)
    assert _weakest(unseen) == pytest.approx([0, 0, 1, 0], abs=1e-6)
    one = np.array([-0.5, 0.5, -0.5, 0.5])
    assert _weakest(np.outer(one, one) * (1 + noise + noise.T)) == pytest.approx(one / 2, abs=1e-6)
    alone = np.array([1.0, 0.0, 0.0, 0.0])
    assert _weakest(-np.outer(alone, -alone) * (1 + noise)) == pytest.approx(alone, abs=1e-6)
    found = _doubts(("a", "b", "c"), np.array([4.0, 5.0, 5.0]) + noise[0, :3], 0.1 * np.eye(3))
    assert [line[0] for line in found] == ["b", "c", "a"]


def test_what_photographs_do_not_tell_apart_is_doubted_together():
    spread, alike = np.array([0.6, 0.5, 0.2]), np.eye(3)
    alike[0, 1] = alike[1, 0] = -0.95
    covariance = alike * np.outer(spread, spread)
    names = ("camera z", "turn about x", "floor height")
    lines = _doubts(names, np.array([3.0, 2.9, 0.4]), covariance)
    assert lines == (
        "camera z is +3.0 ± 0.6 and turn about x is +2.9 ± 0.5 of its stated error, or one of "
        "both more: the photographs do not tell them apart",
    )
    alone = _doubts(names, np.array([0.2, 3.4, 3.1]), np.diag(spread**2))
    assert alone == (
        "turn about x is +3.4 ± 0.5 of its stated error",
        "floor height is +3.1 ± 0.2 of its stated error",
    )
    assert _doubts(names, np.array([0.2, 1.0, 2.5]), covariance) == ()
