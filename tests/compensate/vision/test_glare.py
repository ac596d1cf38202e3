"""The eye's stray light: other published equations, light that is only moved, and a sphere."""

from __future__ import annotations

import numpy as np
import pytest

from compensate.vision.glare import NEAREST, StrayLight, disability_glare
from domesim.errors import InputError

AGES = (25, 40, 55, 70)


def stiles_holladay(angle, age):
    """CIE 146:2002, age-adjusted, for 1 to 30 degrees."""
    return 10 * (1 + (age / 70) ** 4) / angle**2


def total_glare(angle, age, p):
    """Vos, J. J., van den Berg, T. J. T. P., CIE 135/1 (1999): the whole point spread, 1/sr."""
    old = (age / 70) ** 4
    core = 9.2e6 / (1 + (angle / 0.0046) ** 2) ** 1.5 + 1.5e5 / (1 + (angle / 0.045) ** 2) ** 1.5
    wide = 1 + (angle / 0.1) ** 2
    skirt = 400 / wide + 3e-8 * angle**2 + p * (1300 / wide**1.5 + 0.8 / wide**0.5)
    return (1 - 0.08 * old) * core + (1 + 1.6 * old) * skirt + 2.5e-3 * p


@pytest.mark.parametrize("age", AGES)
def test_the_cies_equations_agree_as_the_cie_has_it(age):
    angle = np.geomspace(1, 30, 50)
    ratio = disability_glare(angle, age) / stiles_holladay(angle, age)
    assert 0.5 < ratio.min() < ratio.max() < 2
    angle = np.geomspace(0.1, 60, 50)
    for p in (0.0, 0.5, 1.2):
        ratio = disability_glare(angle, age, p) / total_glare(angle, age, p)
        assert 0.65 < ratio.min() < ratio.max() < 1.25


@pytest.mark.parametrize("age", AGES)
@pytest.mark.parametrize("p", [0.0, 0.5, 1.2])
def test_the_scattered_share_is_that_of_the_whole_point_spread(age, p):
    angle = np.geomspace(1e-5, 90, 20001)
    ring = 2 * np.pi * np.sin(np.radians(angle)) * np.radians(1)
    spread = total_glare(angle, age, p) * ring
    whole = np.trapezoid(spread, angle)
    assert whole == pytest.approx(1, abs=0.15)  # it was made to be a point spread function
    far = angle >= NEAREST
    assert StrayLight(age, p).share == pytest.approx(
        np.trapezoid(spread[far], angle[far]) / whole, rel=0.2
    )


def test_a_small_source_has_the_veil_of_the_equation():
    per_degree, eye = 5.0, StrayLight(60, 1.0)
    light = np.zeros((1, 301, 401))
    light[0, 150, 120] = 700.0
    found = eye.seen(light, per_degree)[0]
    illuminance = 700.0 * np.radians(1 / per_degree) ** 2  # lx
    for right in (10, 30, 100, 250):
        angle = right / per_degree
        # the angle from another gaze: sin(theta)/theta of the solid angle
        expected = illuminance * np.sinc(angle / 180) * disability_glare(angle, 60, 1.0)
        assert found[150, 120 + right] == pytest.approx(expected, rel=2e-3)
    assert found[150, 120] == pytest.approx(700 * (1 - eye.share), rel=1e-3)
    assert found[150, 121] == 0  # nearer than half a degree, it is not stray light


@pytest.mark.parametrize("per_degree", [0.7, 1.42, 3.0])
def test_a_plain_field_stays_as_it_is(per_degree):
    side = int(2 * 90 * per_degree) | 1
    down, across = np.mgrid[:side, :side] - side // 2
    field = 3.0 * (np.hypot(down, across) / per_degree <= 90)
    eye = StrayLight(70)
    assert eye.seen(field, per_degree)[side // 2, side // 2] == pytest.approx(3.0, rel=2e-3)
    assert eye.veil(field, per_degree).max() == pytest.approx(3.0 * eye.share, rel=0.01)


def test_fine_pictures_are_summed_on_a_coarser_grid():
    per_degree, rows, cols = 16.0, 130, 171
    light = np.random.default_rng(1).uniform(0, 1, (2, rows, cols)) ** 8
    eye = StrayLight(45)
    fine = eye._scattered(light.astype(np.float32), per_degree)
    found = eye.veil(light, per_degree)
    assert np.abs(found - fine).max() < 0.15 * fine.mean()
    assert found.mean() == pytest.approx(fine.mean(), rel=0.02)


def direction(theta, phi):
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


def test_a_domemaster_is_taken_as_a_plane():
    """What that costs, by sums over the sphere around each gaze; `vision.glare` has the figures."""
    random, side, age = np.random.default_rng(0), 256, 45
    down, across = (np.mgrid[:side, :side] + 0.5) / side * 2 - 1
    theta, phi = np.hypot(down, across) * np.pi / 2, np.arctan2(down, across)
    ways = direction(theta, phi)
    angle, bearing = np.geomspace(NEAREST, 90, 120), np.linspace(0, 2 * np.pi, 64, endpoint=False)
    ring = 2 * np.pi * np.sin(np.radians(angle)) * disability_glare(angle, age)
    ratios = []
    for _ in range(6):
        lamps = direction(np.arccos(random.uniform(0, 1, 6)), random.uniform(0, 2 * np.pi, 6))
        narrow = 10 ** random.uniform(0, 2.5, 6)

        def light(way, lamps=lamps, narrow=narrow):
            return np.where(way[..., 2] >= 0, np.exp(narrow * (way @ lamps.T - 1)).sum(-1), 0)

        found = StrayLight(age).veil(light(ways)[None], side / 180)[0]
        for row, col in random.permutation(np.argwhere(theta <= np.pi / 2))[:40]:
            gaze = ways[row, col]
            right = np.cross(gaze, [0.3, 0.5, 0.8])
            right /= np.linalg.norm(right)
            aside = np.multiply.outer(np.cos(bearing), right)
            aside += np.multiply.outer(np.sin(bearing), np.cross(gaze, right))
            turn = np.radians(angle)[:, None, None]
            mean = light(np.cos(turn) * gaze + np.sin(turn) * aside).mean(axis=1)
            ratios.append(found[row, col] / np.trapezoid(mean * ring, np.radians(angle)))
    assert np.mean(ratios) == pytest.approx(0.96, abs=0.02)
    assert 0.5 < min(ratios) < max(ratios) < 1.05


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: StrayLight(12), "20 to 80 years, got 12"),
        (lambda: StrayLight(float("nan")), "got nan"),
        (lambda: StrayLight(40, 2.0), "pigmentation .* got 2"),
        (lambda: StrayLight(40).seen(np.zeros((2, 3)), 0.0), "above 0, got 0"),
        (lambda: StrayLight(40).seen(np.zeros(3), 1.0), r"\(3,\)"),
    ],
)
def test_what_cannot_be_is_refused(wrong, words):
    with pytest.raises(InputError, match=words):
        wrong()
