"""A judge is asked again only if it would see, or be, something else."""

from __future__ import annotations

import numpy as np
import pytest

from testing.places import dome_at
from validation.experiment import Missing
from validation.hearing import heard
from validation.panel import Judge

LIGHT = np.full((1, 4, 4, 3), 0.5, np.float32)


@pytest.fixture
def asked():
    return []


@pytest.fixture
def judge(asked):
    def figure(reference, test, scene):
        asked.append(1)
        return float("inf") if np.array_equal(reference, test) else float(np.abs(test).sum())

    return Judge("PU21-PSNR", True, False, figure)


def test_the_same_light_is_judged_once(judge, asked, tmp_path):
    for _ in range(2):
        assert heard(judge, LIGHT, LIGHT, dome_at(0.5, 15.0), tmp_path) == float("inf")
    assert len(asked) == 1
    heard(judge, LIGHT, LIGHT, dome_at(0.5, 15.0), None)
    assert len(asked) == 2


def test_anything_else_is_judged(judge, asked, tmp_path):
    heard(judge, LIGHT, LIGHT, dome_at(0.5, 15.0), tmp_path)
    other = LIGHT * np.float32(1.0001)
    assert heard(judge, LIGHT, other, dome_at(0.5, 15.0), tmp_path) == pytest.approx(24.0024)
    heard(judge, other, LIGHT, dome_at(0.5, 15.0), tmp_path)
    heard(judge, LIGHT, LIGHT, dome_at(0.5, 48.0), tmp_path)
    heard(Judge("FLIP", True, False, judge.judge), LIGHT, LIGHT, dome_at(0.5, 15.0), tmp_path)
    assert len(asked) == 5


def test_a_judge_that_is_missing_leaves_nothing(tmp_path):
    def missing(reference, test, scene):
        raise Missing("needs it")

    with pytest.raises(Missing):
        heard(Judge("FLIP", False, False, missing), LIGHT, LIGHT, dome_at(0.5, 15.0), tmp_path)
    assert not any(tmp_path.iterdir())


def test_a_figure_that_was_cut_off_is_asked_for_again(judge, asked, tmp_path):
    for _ in range(2):
        heard(judge, LIGHT, LIGHT, dome_at(0.5, 15.0), tmp_path)
        for path in tmp_path.iterdir():
            path.write_bytes(path.read_bytes()[:3])
    assert len(asked) == 2
