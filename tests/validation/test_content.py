"""Generated content: light that a projector can show, and the same picture at every size."""

from __future__ import annotations

import numpy as np
import pytest

from testing.content import DOMES, PAIRS

SIZE = 96

PICTURES = {**{f"dome: {name}": draw for name, draw in DOMES.items()}, **PAIRS}
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@pytest.fixture(scope="module", params=PICTURES)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def light(name):
    return PICTURES[name](SIZE)


def test_a_projector_can_show_it(name, light):
    shape = (1, SIZE, SIZE, 3) if name.startswith("dome") else (2, 54, SIZE, 3)
    assert (light.shape, light.dtype) == (shape, np.float32)
    assert light.min() >= 0
    assert 0.1 < light.max() <= 1


def test_it_is_the_same_again(name, light):
    assert np.array_equal(light, PICTURES[name](SIZE))


def test_a_larger_one_is_the_same_picture(name, light):
    larger = PICTURES[name](2 * SIZE)
    views, rows, cols, _ = light.shape
    smaller = larger.reshape(views, rows, 2, cols, 2, 3).mean(axis=(2, 4)) @ LUMINANCE
    wanted = light @ LUMINANCE
    assert smaller.mean() == pytest.approx(wanted.mean(), rel=0.1)
    assert np.corrcoef(smaller.ravel(), wanted.ravel())[0, 1] > 0.9


@pytest.mark.parametrize("name", DOMES)
@pytest.mark.parametrize("size", [SIZE, 65])
def test_a_dome_is_black_outside_its_circle(name, size):
    light = DOMES[name](size)
    across = (np.arange(size) + 0.5) * 2 / size - 1
    outside = np.hypot(*np.meshgrid(across, across)) > 1
    assert light[0, outside].max() == 0
    assert light[0, ~outside].max() > 0


@pytest.mark.parametrize("name", PAIRS)
def test_the_eyes_see_different_pictures(name):
    left, right = PAIRS[name](SIZE)
    assert np.abs(left - right).mean() > 0.02 * max(left.mean(), right.mean())
    assert left.mean() == pytest.approx(right.mean(), rel=0.15)


def test_what_is_before_the_screen_is_further_right_for_the_left_eye():
    left, right = PAIRS["credits"](480)[:, :90].max(axis=3)  # the title, 3.5 % before the screen
    shifts = range(-24, 25)
    alike = [np.sum(left * np.roll(right, shift, axis=1)) for shift in shifts]
    assert shifts[int(np.argmax(alike))] == pytest.approx(0.035 * 480, abs=1)


def test_credits_are_on_pure_black():
    light = DOMES["text and credits"](SIZE)[0].max(axis=2)
    assert np.mean(light == 0) > 0.7
