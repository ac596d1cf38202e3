"""Tabulated theatres: linearity and <A x, y> = <x, A' y>, with cores that are not symmetric."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from array_libraries import PRECISE
from laws.test_linear_maps import dot

from domesim.observation.basis import ScreenBasis
from domesim.observation.transport import Transport, node_places
from domesim.room.dome import Dome

DOMES = {
    "cap": Dome(3.0, np.radians(105), 0.2),
    "ellipsoid": Dome(3.0, np.radians(80), 0.0, 0.6),
    "truncated": Dome(3.0, np.radians(120), 0.35, truncated_below=-0.4),
}


@cache
def transport(dome: Dome, degree: int = 3, nodes: int = 23) -> Transport:
    """Strong, smooth, and different each way: an adjoint of another order would show."""
    random = np.random.default_rng(7)
    places = node_places(nodes)
    modes = ScreenBasis(dome, degree).at(*np.meshgrid(places, places))
    core = 0.3 * random.standard_normal((3, len(modes), len(modes)))
    core[:, 0, 0] = 0.9, 0.5, -0.6
    ambient = 0.02 * random.random((3, nodes, nodes))
    return Transport(dome, modes, core, np.zeros_like(core), ambient)


def uneven(size: int, seed: int) -> Any:
    return 0.5 + np.random.default_rng(seed).random((size, size))


def tabulated(dome: Dome, size: int) -> Any:
    return transport(dome).observation(size, size, ambient=0.01)


def with_lens(dome: Dome, size: int) -> Any:
    return transport(dome).observation(size, size, lens_gain=uneven(size, 1))


@cache
def glossy(dome: Dome, size: int) -> Any:
    gains = {"lens_gain": uneven(size, 1), "seen_gain": uneven(size, 2)}
    return transport(dome).observation(size, size, **gains)


@cache
def few_modes(dome: Dome, size: int) -> Any:
    return glossy(dome, size).low_rank(1e-3, 4)


OBSERVATIONS: dict[str, Callable[[Dome, int], Any]] = {
    "tabulated": tabulated,
    "with a lens": with_lens,
    "seen at a slant": glossy,
    "few modes": few_modes,
}
every_observation = pytest.mark.parametrize("make", OBSERVATIONS.values(), ids=OBSERVATIONS)
every_dome = pytest.mark.parametrize("dome", DOMES.values(), ids=DOMES)


def lights(shape: tuple[int, ...], dtype: Any, convert: Any = np.asarray) -> list[Any]:
    """Positive, as pictures are: all of it bounces, and nothing cancels."""
    random = np.random.default_rng(shape[1])
    return [convert(random.random(shape).astype(dtype)) for _ in range(3)]


def gap(found: Any, expected: Any) -> float:
    return float(np.abs(np.asarray(found) - np.asarray(expected)).max())


@pytest.mark.parametrize(("dtype", "convert"), PRECISE)
@pytest.mark.parametrize("size", [8, 33])
@every_dome
@every_observation
def test_adjoint_and_linearity(make: Any, dome: Dome, size: int, dtype: Any, convert: Any) -> None:
    observation = make(dome, size)
    x, z, y = lights(observation.shape, dtype, convert)
    tolerance = 1e-5 if dtype == np.float32 else 1e-12
    forward = observation.linear(x)
    assert forward.dtype == x.dtype
    assert forward.shape == observation.shape
    assert dot(forward, y) == pytest.approx(dot(x, observation.adjoint(y)), rel=tolerance)
    direct = dot(observation.direct(x), y)
    assert direct == pytest.approx(dot(x, observation.direct_adjoint(y)), rel=tolerance)
    assert gap(forward, observation.direct(x)) > 0.1  # or the law would be that of direct light
    mixed = observation.linear(2 * x - 3 * z)
    assert gap(mixed, 2 * forward - 3 * observation.linear(z)) < 20 * tolerance
    black = observation.observe(0 * x)
    assert gap(observation.observe(x) - black, forward) < 20 * tolerance


@every_dome
def test_the_adjoint_is_the_transposed_matrix(dome: Dome) -> None:
    """Column by column, so that errors of pixels could not cancel in a sum."""
    for make in OBSERVATIONS.values():
        observation = make(dome, 5)
        count = 5 * 5 * 3
        units = np.eye(count).reshape(count, *observation.shape)
        matrix = np.array([observation.linear(unit).ravel() for unit in units]).T
        turned = np.array([observation.adjoint(unit).ravel() for unit in units]).T
        assert turned == pytest.approx(matrix.T, abs=1e-13)
        assert np.abs(matrix - matrix.T).max() > 1e-3  # it is not symmetric
        # Primaries do not mix
        planes = matrix.reshape(25, 3, 25, 3)
        for p in range(3):
            assert not planes[:, p][:, :, [q for q in range(3) if q != p]].any()


@pytest.mark.parametrize("make", [tabulated, few_modes])
def test_the_adjoint_of_a_large_picture_in_float32(make: Any) -> None:
    observation = make(DOMES["truncated"], 512)
    x, _, y = lights(observation.shape, np.float32)
    forward, back = observation.linear(x), observation.adjoint(y)
    assert forward.dtype == back.dtype == np.float32
    assert dot(forward, y) == pytest.approx(dot(x, back), rel=1e-6)


@pytest.mark.parametrize("size", [31, 32, 33, 64, 97])
def test_strips_of_a_picture_make_no_difference(size: int) -> None:
    """Sums run over strips of 32 rows: one row of light at a time must come to the same."""
    observation = tabulated(DOMES["cap"], size)
    x = lights(observation.shape, np.float64)[0]
    rows = np.eye(size)[:, None, :, None, None] * x
    parts = sum(observation.linear(row) for row in rows)
    assert gap(parts, observation.linear(x)) < 1e-11
