"""Paired comparisons: exact tests, the likeliest scale, and the counts behind a chi-square."""

from __future__ import annotations

import math
import sys
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.special import expit
from scipy.stats import norm
from statsmodels.stats.multitest import multipletests

from domesim.errors import InputError
from testing.statistics import FALSE_ALARM, assert_unbiased, calibration
from validation.experiment import Missing, Work
from validation.experiments import user_study
from validation.study import (
    NoScale,
    Scale,
    analyse,
    holm,
    totals_from_chi2,
    wins_from_totals,
)

NAMES = ("a", "b", "c", "d")
SCALE = np.array([0.0, 0.5, 1.2, -0.3])
TRIALS = np.array([[0, 900, 700, 0], [0, 0, 1100, 800], [0, 0, 0, 1000], [0, 0, 0, 0]])
"""Of pairs, unequal, and a and d never meet."""


def simulated(random, scale=SCALE, trials=TRIALS):
    upper = random.binomial(trials, expit(scale[:, None] - scale[None, :]))
    return upper + (trials - upper).T


def tables(size):
    return hnp.arrays(np.int64, (size, size), elements=st.integers(0, 40)).map(
        lambda wins: wins * (1 - np.eye(size, dtype=np.int64))
    )


def scale_of(wins) -> Scale:
    scale = analyse(wins, NAMES[: len(wins)]).scale
    assert isinstance(scale, Scale)
    return scale


def at_least(n, wins):
    """Probability of so many wins of n if there is no preference, by counting."""
    return Fraction(sum(math.comb(n, k) for k in range(wins, n + 1)), 2**n)


# Pairs


@pytest.mark.parametrize(("wins", "losses"), [(102, 18), (15, 5), (7, 4), (0, 6), (9, 9)])
def test_p_is_the_exact_sum(wins, losses):
    (pair,) = analyse([[0, wins], [losses, 0]], ["a", "b"]).pairs
    tail = at_least(wins + losses, max(wins, losses))
    assert pair.p == pytest.approx(float(min(2 * tail, Fraction(1))), rel=1e-9)
    assert (pair.trials, pair.wins, pair.adjusted) == (wins + losses, wins, pair.p)


def test_the_interval_leaves_a_fortieth_on_either_side():
    (pair,) = analyse([[0, 13], [4, 0]], ["a", "b"]).pairs
    tails = [
        sum(math.comb(17, k) * share**k * (1 - share) ** (17 - k) for k in wins)
        for share, wins in ((pair.low, range(13, 18)), (pair.high, range(14)))
    ]
    assert tails == pytest.approx([0.025, 0.025], rel=1e-9)


def test_holm_is_statsmodels():
    p = np.random.default_rng(2).random((5, 6)) ** 3
    for row, adjusted in zip(p, holm(p), strict=True):
        assert adjusted == pytest.approx(multipletests(row, method="holm")[1])


def test_significant_pairs_are_false_alarms_as_rarely_as_promised():
    random = np.random.default_rng(4)
    trials = np.triu(np.full((4, 4), 51), 1)
    alarms = sum(
        any(pair.significant for pair in analyse(simulated(random, 0 * SCALE, trials), NAMES).pairs)
        for _ in range(80)
    )
    assert alarms <= 80 * 0.05 + 4 * math.sqrt(80 * 0.05)


# Scale


def test_two_conditions_have_their_log_odds():
    scale = scale_of([[0, 18], [102, 0]])
    assert scale.values == pytest.approx((0, math.log(102 / 18)))
    assert scale.errors == pytest.approx((0, math.sqrt(1 / 102 + 1 / 18)))
    assert scale.misfit is None


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 4).flatmap(tables))
def test_wins_are_those_expected_or_there_is_no_scale(wins):
    """Zermelo's equations, which hold at the likeliest values only."""
    linked = np.linalg.matrix_power((wins + wins.T > 0) + np.eye(len(wins)), len(wins)) > 0
    assume(linked.all())
    reaches = np.linalg.matrix_power((wins > 0) + np.eye(len(wins)), len(wins)) > 0
    scale = analyse(wins, NAMES[: len(wins)]).scale
    assert isinstance(scale, Scale) == reaches.all()
    if isinstance(scale, Scale):
        values = np.array(scale.values)
        expected = (wins + wins.T) * expit(values[:, None] - values[None, :])
        assert expected.sum(1) == pytest.approx(wins.sum(1), abs=1e-7)
        assert values[0] == scale.errors[0] == 0


@pytest.mark.parametrize("many", [10, 10**4, 10**7])
def test_lopsided_choices_have_a_scale(many):
    scale = scale_of([[0, many, 0], [1, 0, many], [0, 1, 0]])
    assert scale.values == pytest.approx((0, -math.log(many), -2 * math.log(many)))


def test_the_scale_recovers_what_was_simulated():
    random = np.random.default_rng(7)
    scales = [scale_of(simulated(random)) for _ in range(80)]
    for i in (1, 2, 3):
        found, error = np.array([(scale.values[i], scale.errors[i]) for scale in scales]).T
        assert_unbiased(found, error, SCALE[i])
        assert calibration((found - SCALE[i]) / error) > FALSE_ALARM
    misfits = [scale.misfit for scale in scales]
    assert {misfit.freedom for misfit in misfits} == {2}
    assert calibration(norm.ppf([misfit.p for misfit in misfits])) > FALSE_ALARM


@pytest.mark.parametrize(
    ("wins", "reason"),
    [
        ([[0, 0, 3], [7, 0, 5], [4, 0, 0]], "nobody preferred a or c to b,"),
        ([[0, 4, 6], [3, 0, 5], [0, 0, 0]], "nobody preferred c to a or b,"),
    ],
)
def test_undefeated_conditions_have_no_scale(wins, reason):
    study = analyse(wins, "abc"[: len(wins)])
    assert isinstance(study.scale, NoScale)
    assert study.scale.reason.startswith(reason)
    assert "pairs' intervals" in study.scale.reason
    assert len(study.pairs) == len(wins) * (len(wins) - 1) // 2


# Equal preference


def test_two_conditions_are_tested_as_in_the_paper():
    study = analyse([[0, 102], [18, 0]], "ab")
    assert study.equality.statistic == pytest.approx(58.8) == study.pearson
    assert study.equality.p == pytest.approx(math.erfc(math.sqrt(58.8 / 2)), rel=1e-9)


@pytest.mark.parametrize("size", [3, 4])
def test_balanced_studies_have_davids_statistic(size):
    wins = simulated(np.random.default_rng(6), SCALE[:size], np.triu(np.full((size, size), 30), 1))
    study = analyse(wins, NAMES[:size])
    off = wins.sum(1) - 15 * (size - 1)
    assert study.equality.statistic == pytest.approx(4 * np.sum(off**2) / (30 * size))
    assert study.pearson / study.equality.statistic == pytest.approx(size / (2 * size - 2))
    assert study.equality.freedom == size - 1


def test_equality_is_calibrated_and_pearsons_statistic_is_not():
    random = np.random.default_rng(8)
    studies = [analyse(simulated(random, 0 * SCALE), NAMES) for _ in range(80)]
    assert calibration(norm.ppf([study.equality.p for study in studies])) > FALSE_ALARM
    assert np.mean([study.equality.statistic for study in studies]) == pytest.approx(3, abs=0.6)
    assert np.mean([study.pearson for study in studies]) < 2.4


# Bad input


@pytest.mark.parametrize(
    ("wins", "names", "words"),
    [
        ([[0, 3], [-1, 0]], "ab", "counts: 0, 1, 2, ..., got -1"),
        ([[0, math.nan], [1, 0]], "ab", "got nan"),
        ([[0, 3, 1], [2, 0, 1]], "ab", r"shape \(2, 3\)"),
        ([[4, 3], [1, 0]], "ab", "diagonal"),
        ([[0, 3], [1, 0]], "aa", "own name"),
        ([[0, 0], [0, 0]], "ab", "no trial compares a with b"),
        ([[0, 3, 0, 0], [1, 0, 0, 0], [0, 0, 0, 5], [0, 0, 2, 0]], "abcd", "a or b with c or d"),
    ],
)
def test_bad_counts_are_refused(wins, names, words):
    with pytest.raises(InputError, match=words):
        analyse(wins, names)


def test_what_is_missing_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "statsmodels.genmod.families", None)
    with pytest.raises(Missing, match=r"pip install 'domesim\[study\]'"):
        analyse([[0, 3], [1, 0]], "ab")


# Counts behind a chi-square


def test_the_videos_count_is_the_only_one():
    assert totals_from_chi2(2, 120, 58.8, digits=1).tolist() == [[18, 102], [102, 18]]


def test_the_stills_counts_are_all_of_many():
    found = {tuple(wins) for wins in totals_from_chi2(3, 960, 283.0, digits=1).tolist()}
    brute = {
        (a, b, 960 - a - b)
        for a in range(641)
        for b in range(320 - min(a, 320), 641)
        if 960 - a - b >= 0
        and 282.95 <= sum((x - 320) ** 2 for x in (a, b, 960 - a - b)) / 320 <= 283.05
    }
    assert found == brute
    assert len(found) == 84
    assert len({tuple(sorted(wins)) for wins in found}) == 14


@pytest.mark.parametrize("each", [1, 4, 5])
def test_three_pairs_add_up(each):
    """Every table of counts is found by way of its chi-square, once."""
    tables = {
        ((0, p, q), (each - p, 0, r), (each - q, each - r, 0))
        for p in range(each + 1)
        for q in range(each + 1)
        for r in range(each + 1)
    }
    found = []
    for chi2 in {sum((sum(row) - each) ** 2 for row in wins) / each for wins in tables}:
        for totals in totals_from_chi2(3, 3 * each, chi2, digits=9).tolist():
            ways = wins_from_totals(totals)
            assert (ways.sum(2) == totals).all()
            found += [tuple(map(tuple, wins)) for wins in ways.tolist()]
    assert len(found) == len(tables)
    assert set(found) == tables


# The paper's study


@pytest.fixture(scope="module")
def finding():
    return user_study.run(Work())


def test_the_papers_study_is_as_expected(finding):
    assert [check.what for check in finding.checks if not check.passed] == []
    assert finding.figures["user_study.video_wins"] == 102
    assert finding.figures["user_study.stills_sets"] == 84


@pytest.fixture(scope="module")
def stills():
    return user_study.stills()


def test_the_reconstructed_studies_have_the_papers_chi2(stills):
    for study in stills.cases.values():
        assert round(study.pearson, 1) == 283.0
        assert study.equality.statistic == pytest.approx(study.pearson * 4 / 3)
        assert all(pair.trials == 320 for pair in study.pairs)


def test_holm_by_hand():
    # 4 x 0.005; 3 x 0.01; 2 x 0.03; and 0.04, no less than the one before
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.6]) == pytest.approx([1, 1])
