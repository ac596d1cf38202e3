"""Judges against published figures and analytic cases, and the experiment that they judge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from domesim.scene import load_scene
from validation import judges
from validation.experiment import Work
from validation.experiments import wrong_model

SCENE = load_scene("dome_hemisphere")
SIZE = 96


def even(light, size=SIZE):
    return np.full((1, size, size, 3), light, np.float32)


def published(first, second):
    """FLIP of even greys (Andersson et al. 2020).

    Differences in L* to the power 0.7, over those of green and blue (41.2761); 0.4 of that is
    mapped to 0.95.
    """

    def lightness(light):
        return 116 * np.cbrt(light) - 16 if light > (6 / 29) ** 3 else light * (29 / 3) ** 3

    share = abs(lightness(first) - lightness(second)) ** 0.7 / 41.2761
    return 0.95 * share / 0.4 if share < 0.4 else 0.95 + 0.05 * (share - 0.4) / 0.6


@pytest.mark.parametrize(("first", "second"), [(1, 0), (0.02, 0.03), (0.2, 0.25), (0, 0.02)])
@pytest.mark.parametrize("size", [48, 400])
def test_flip_of_greys_is_the_published_one(first, second, size):
    """Even at 0.27 pixels a degree, where FLIP alone takes every difference for an edge."""
    pytest.importorskip("flip_evaluator")
    found = judges.flip(even(first, size), even(second, size), SCENE)
    assert found == pytest.approx(published(first, second), rel=5e-3)


def test_flip_counts_a_pixel_by_its_area():
    """Domemaster pixels near the rim are smaller, by sin(theta) / theta: 0.7 at 81 degrees."""
    pytest.importorskip("flip_evaluator")

    def patch(col):
        light = even(0.2)
        light[:, 44:52, col : col + 8] = 0.4
        return judges.flip(even(0.2), light, SCENE)

    assert patch(1) / patch(44) == pytest.approx(0.7, abs=0.03)


def test_the_noise_of_residuals_is_no_error():
    """In energy there is 25 times more noise than residual."""
    random = np.random.default_rng(3)
    residual = random.random((64, 64, 3))
    noisy = residual + 3 * random.standard_normal((8, *residual.shape))
    share = np.full((64, 64, 1), 1 / residual.size)
    truth = np.sqrt(np.mean(residual**2))
    assert wrong_model.common_rms(noisy, share) == pytest.approx(truth, rel=0.1)
    assert np.sqrt(np.mean(noisy.mean(0) ** 2)) > 1.5 * truth


THEATRE = "dome_imax"
TINY = wrong_model.Effort(size=128, walks=3, repeats=3, error=1e-2, most=1e5)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The experiment's finding and outcome, of pixels of 1.5°."""
    store, outcomes, measure = tmp_path_factory.mktemp("steps"), [], wrong_model.measure

    def noted(*args, **settings):
        outcomes.append(measure(*args, **settings))
        return outcomes[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wrong_model, "QUICK", {THEATRE: TINY})
        patch.setattr(wrong_model, "measure", noted)
        finding = wrong_model.run(Work(store=store))
        # Killed and resumed: nothing is measured again
        assert wrong_model.run(Work(store=store)) == finding
    assert len(outcomes) == 1
    return finding, outcomes[0]


def test_a_wrong_model_is_worth_having(found):
    finding, outcome = found
    assert [check.what for check in finding.checks if not check.passed] == []
    assert 0.03 < outcome.off_by["closed_form"] < 0.06
    assert outcome.off_by["tabulated"] < 0.01
    assert outcome.kept == pytest.approx(1, abs=0.05)


def test_compensation_for_nothing_would_be_noticed(found):
    """The checks can fail."""
    pytest.importorskip("flip_evaluator")
    _, outcome = found
    idle = dict.fromkeys(outcome.seen, outcome.seen["untouched"])
    wrong = replace(outcome, seen=idle, off_by=dict.fromkeys(outcome.off_by, 0.03))
    failed = {check.what for check in wrong_model._checks("x", wrong) if not check.passed}
    assert failed == {
        "x: quality that the closed form gains",
        "x: error of the tabulated prediction, over the mean added light",
        "x: FLIP, closed form over uncompensated",
    }


def test_a_tabulation_that_does_harm_would_be_noticed(found):
    _, outcome = found
    swapped = outcome.seen | {"tabulated": outcome.seen["untouched"]}
    failed = [
        check.what
        for check in wrong_model._checks("x", replace(outcome, seen=swapped))
        if not check.passed
    ]
    assert failed == ["x: quality lost, tabulated less closed form"]
