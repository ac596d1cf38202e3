"""The tests of noisy figures: how often they cry wolf, and what they catch."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from testing.statistics import assert_unbiased, calibration, estimate, rms_difference

CELLS = 99
ERROR = 2.5e-4
"""As in the sweep of the closed form."""


def raises(found, truth=1.0, error=ERROR, **settings) -> bool:
    try:
        assert_unbiased(found, error, truth, **settings)
    except AssertionError:
        return True
    return False


def test_false_alarms_are_as_rare_as_promised():
    random = np.random.default_rng(5)
    trials, rate = 1000, 0.05
    alarms = sum(
        raises(1 + ERROR * random.standard_normal(CELLS), false_alarm=rate) for _ in range(trials)
    )
    # Two tests share the rate and are nearly independent; both bounds are one in a million.
    assert alarms <= stats.binom.ppf(1 - 1e-6, trials, rate)
    assert alarms >= stats.binom.ppf(1e-6, trials, rate * 0.7)


@pytest.mark.parametrize(("bias", "cells"), [(0.02, 1), (0.002, 1), (0.002, CELLS), (2e-4, CELLS)])
def test_biases_are_caught(bias, cells):
    random = np.random.default_rng(7)
    caught = [raises(1 + bias + ERROR * random.standard_normal(cells)) for _ in range(200)]
    assert np.mean(caught) > 0.99


def test_errors_of_either_sign_are_caught_too():
    random = np.random.default_rng(9)
    signs = np.where(np.arange(CELLS) % 2, 1, -1)
    assert raises(1 + 1e-3 * signs + ERROR * random.standard_normal(CELLS))


def test_the_message_names_the_worst():
    with pytest.raises(AssertionError, match=r"of 3 figures; the worst is 1\.5 "):
        assert_unbiased([1.0, 1.5, 1.0], 0.01, 1.0)


def test_errors_of_zero_are_no_errors():
    with pytest.raises(ValueError, match="above 0"):
        assert_unbiased([1.0], [0.0], [1.0])


def test_calibration_knows_boasting_and_modesty():
    z = np.random.default_rng(3).standard_normal(400)
    assert calibration(z) > 0.01
    assert calibration(1.4 * z) < 0.01
    assert calibration(z / 1.4) < 0.01
    assert calibration(z + 0.3) < 0.01


@pytest.mark.parametrize("error", [0.0, 0.003, 0.02])
def test_rms_difference_does_not_count_noise(error):
    random = np.random.default_rng(1)
    shape = (200, 200, 1)
    truth = random.random(shape)
    off = np.where(random.random(shape) > 0.5, error, -error)
    share = np.full(shape[:2], 1 / 40000)
    noisy = [truth + 0.02 * random.standard_normal(shape) for _ in range(2)]
    found = rms_difference(truth + off, *noisy, share)
    assert found**2 == pytest.approx(error**2, abs=4 * 0.02**2 / 200)


def test_students_interval():
    """By hand: sd 1, n 4, t 3.182."""
    values = np.array([-1.0, -0.2, 0.2, 1.0])
    values = 2 + values / values.std(ddof=1)
    found = estimate(values)
    assert (found.mean, found.inputs) == (pytest.approx(2), 4)
    assert (found.low, found.high) == pytest.approx((2 - 1.5912, 2 + 1.5912), abs=1e-4)
    assert np.isnan(estimate([1.0]).low)
    assert np.isnan(estimate([]).mean)
    assert [estimate(some).written for some in ([], [0.1])] == [
        "nothing (no input)",
        "+0.100 (1 input)",
    ]


def test_students_intervals_cover_what_they_should():
    random = np.random.default_rng(0)
    found = [estimate(random.normal(0.1, 1.0, 8)) for _ in range(2000)]
    assert np.mean([one.low <= 0.1 <= one.high for one in found]) == pytest.approx(0.95, abs=0.02)
