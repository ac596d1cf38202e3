"""Visible steps of an even light against Kelly's points, and what they must do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compensate.vision.flicker import LONGEST, sensitivity, steps, trolands

RATE = 24
LIGHTS = st.floats(1e-3, 1e2)


@pytest.mark.parametrize(
    ("retinal", "hertz", "expected"),
    [
        (0.65, 4.0, 22.7),
        (7.1, 6.8, 55.5),
        (77.0, 12.7, 101.5),
        (850.0, 1.6, 15.4),
        (9300.0, 19.8, 114),
    ],
)
def test_kellys_points(retinal: float, hertz: float, expected: float) -> None:
    assert sensitivity(hertz, retinal) == pytest.approx(expected)


def test_below_his_light_the_root_of_it_counts() -> None:
    assert sensitivity(4.0, 0.65 / 16) == pytest.approx(22.7 / 4)
    assert sensitivity(4.0, 1e6) == sensitivity(4.0, 9300.0)


def test_pupils_of_moon_and_spencer() -> None:
    assert trolands(1.0) == pytest.approx(np.pi * 4.9**2 / 4)
    assert trolands(1e-9) > 0


def test_a_jump_is_one_step_where_flicker_is_just_seen() -> None:
    """One frame apart, and held: Kelly's best frequency of the half waves that fit counts."""
    light, share = 0.3, 0.02
    best = max(float(sensitivity(RATE / (2 * n), trolands(light))) for n in range(1, 8))
    after = [light * (1 - share), *[light * (1 + share)] * 12]
    moved = steps(np.arange(13) / RATE, after)
    assert max(moved) == pytest.approx(share * best)
    assert moved[0] == 0
    assert moved[-1] == 0  # it stands


@given(LIGHTS)
def test_what_stands_does_not_move(light: float) -> None:
    assert steps(np.arange(9) / RATE, [light] * 9) == [0.0] * 9
    assert steps([0.0], [light]) == [0.0]


@given(LIGHTS, st.floats(0.001, 0.5), st.floats(1.1, 3))
def test_more_is_seen_more(light: float, share: float, more: float) -> None:
    jump = [steps([0, 1 / RATE], [light, light * (1 + s)])[1] for s in (share, share * more)]
    assert jump[1] > jump[0] > 0


@given(LIGHTS, st.floats(0.001, 0.5))
def test_rises_and_falls_are_alike(light: float, share: float) -> None:
    ends = [light, light * (1 + share)]
    assert steps([0, 0.1], ends)[1] == steps([0, 0.1], ends[::-1])[1]


def test_what_lies_too_far_apart_is_not_compared() -> None:
    assert steps([0, 1.1 * LONGEST], [1.0, 2.0]) == [0.0, 0.0]
    assert steps([0, LONGEST], [1.0, 2.0])[1] > 1
    assert steps([0, 0.1], [0.0, 0.0]) == [0.0, 0.0]
