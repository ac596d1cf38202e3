"""Every observation and weighting: linearity and <A x, y> = <x, A' y>, on every array library."""

from __future__ import annotations

import numpy as np
import pytest
from array_libraries import PRECISE
from dome_pairs import OBSERVATIONS as DOMES_IN_3D
from theatres import closed_form, picture, unequal_weighting, weighting

from compensate.weighting import Masked
from domesim.observation.frozen import Frozen
from domesim.observation.lowrank import LowRank, LowRankObservation


class RankTwo(LowRankObservation):
    """A theatre with two modes that excite each other, differently for each primary."""

    def __init__(self, size: int, primaries: int) -> None:
        random = np.random.default_rng(5)
        self._screen = closed_form(size, primaries).screen
        spread = random.random((2, size, size)) * self._screen
        self._factors = LowRank(
            0.5 + random.random((size, size)),
            spread,
            random.random((primaries, 2, 2)) / size**2,
            random.random((2, size, size)),
            random.random((primaries, size, size)) * self._screen,
        )
        self._kept = {}

    factors = property(lambda self: self._factors)
    screen = property(lambda self: self._screen)
    _cache = property(lambda self: self._kept)


OBSERVATIONS = {
    "closed form": closed_form,
    "closed form, corrected lens": lambda size, primaries: closed_form(
        size, primaries, falloff=False
    ),
    "rank two": RankTwo,
    **DOMES_IN_3D,
}
WEIGHTINGS = {
    "csf": weighting,
    "masked csf": lambda support, primaries: Masked(
        np.random.default_rng(3).random(support.shape), weighting(support, primaries)
    ),
}


def dot(left, right) -> float:
    return float((np.asarray(left, np.float64) * np.asarray(right, np.float64)).sum())


def scale(left, right) -> float:
    return float(np.linalg.norm(np.asarray(left)) * np.linalg.norm(np.asarray(right)))


def assert_affine(observation, x, z, y, tolerance) -> None:
    """Linear but for a constant, and its adjoints belong to it."""
    forward = observation.linear(x)
    assert forward.dtype == x.dtype
    gap = dot(forward, y) - dot(x, observation.adjoint(y))
    assert abs(gap) <= tolerance * scale(forward, y)
    gap = dot(observation.direct(x), y) - dot(x, observation.direct_adjoint(y))
    assert abs(gap) <= tolerance * scale(x, y)
    mixed = observation.linear(2 * x - 3 * z) - (2 * forward - 3 * observation.linear(z))
    assert np.abs(np.asarray(mixed)).max() <= 20 * tolerance
    affine = observation.observe(x) - observation.observe(0 * x) - forward
    assert np.abs(np.asarray(affine)).max() <= 20 * tolerance


@pytest.mark.parametrize(("dtype", "convert"), PRECISE)
@pytest.mark.parametrize("primaries", [1, 4])
@pytest.mark.parametrize("size", [5, 8])
@pytest.mark.parametrize("name", OBSERVATIONS)
def test_observations(name, size, primaries, dtype, convert):
    observation = OBSERVATIONS[name](size, primaries)
    random = np.random.default_rng(size)
    x, z, y = (convert(random.standard_normal(observation.shape).astype(dtype)) for _ in range(3))
    tolerance = 1e-6 if dtype == np.float32 else 1e-13
    assert_affine(observation, x, z, y, tolerance)


@pytest.mark.parametrize(("dtype", "convert"), PRECISE)
@pytest.mark.parametrize("primaries", [1, 4])
@pytest.mark.parametrize("shape", [(5, 7), (12, 9)])
@pytest.mark.parametrize("name", WEIGHTINGS)
def test_weightings(name, shape, primaries, dtype, convert):
    support = np.random.default_rng(1).random(shape) > 0.3
    lambda_ = WEIGHTINGS[name](support, primaries)
    random = np.random.default_rng(2)
    x, z = (convert(random.standard_normal((1, *shape, primaries)).astype(dtype)) for _ in range(2))
    weighted = lambda_.apply(x)
    assert weighted.dtype == x.dtype
    y = convert(random.standard_normal(weighted.shape).astype(dtype))
    tolerance = 2e-6 if dtype == np.float32 else 1e-13
    gap = dot(weighted, y) - dot(x, lambda_.adjoint(y))
    assert abs(gap) <= tolerance * scale(weighted, y)
    mixed = lambda_.apply(2 * x - 3 * z) - (2 * weighted - 3 * lambda_.apply(z))
    assert np.abs(np.asarray(mixed)).max() <= 20 * tolerance
    energy, normal = lambda_.quadratic(x)
    assert energy == pytest.approx(dot(weighted, weighted), rel=10 * tolerance)
    assert lambda_.energy(x) == pytest.approx(energy, rel=10 * tolerance)
    expected = np.asarray(lambda_.adjoint(weighted))
    assert np.abs(np.asarray(normal) - expected).max() <= 10 * tolerance
    off = np.asarray(x) * ~support[None, :, :, None]
    assert lambda_.energy(convert(off)) == 0


def test_unequal_channels_too():
    lambda_ = unequal_weighting(np.ones((6, 7), bool))
    random = np.random.default_rng(2)
    x = random.standard_normal((1, 6, 7, 3))
    weighted = lambda_.apply(x)
    y = random.standard_normal(weighted.shape)
    assert dot(weighted, y) == pytest.approx(dot(x, lambda_.adjoint(y)), rel=1e-12)


def test_frozen_pollution_has_the_adjoint_of_its_linear_part():
    observation = closed_form(7)
    frozen = Frozen(observation, picture(7, seed=1))
    at = picture(7, seed=1)
    assert np.abs(frozen.observe(at) - observation.observe(at)).max() < 1e-14
    x, y = picture(7, seed=2), picture(7, seed=3)
    assert dot(frozen.linear(x), y) == pytest.approx(dot(x, frozen.adjoint(y)), rel=1e-13)
    assert np.abs(frozen.observe(x) - frozen.observe(0 * x) - frozen.linear(x)).max() < 1e-14


def test_a_wrong_shape_is_refused_by_name():
    with pytest.raises(
        ValueError, match=r"ClosedFormDome observes.*\(1, 5, 5, 3\), got \(5, 5, 3\)"
    ):
        closed_form(5).observe(np.zeros((5, 5, 3)))
    with pytest.raises(ValueError, match="float32 or float64"):
        closed_form(5).observe(np.zeros((1, 5, 5, 3), int))
