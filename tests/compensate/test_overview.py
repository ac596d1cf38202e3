"""What a few sums tell of a dome is what its whole pictures show."""

from dataclasses import replace

import numpy as np
import pytest

from compensate import ruler, subtract
from compensate.overview import Overview
from compensate.plain import around_of
from compensate.ruler import averaged
from compensate.subtract import Floor, subtracted
from domesim.light.planes import Columns, planes_of
from domesim.observation.lowrank import LowRank, LowRankObservation
from domesim.scene import load_scene

ROWS, COLS = 45, 37
SCREEN = np.hypot(*np.mgrid[-1 : 1 : ROWS * 1j, -1 : 1 : COLS * 1j]) < 1
RANDOM = np.random.default_rng(1)


def dome(rank: int, gain: float) -> LowRankObservation:
    """One of random modes; of a direct gain that falls to `gain` at one side."""
    shape = rank, ROWS, COLS
    factors = LowRank(
        direct_gain=np.where(SCREEN, np.linspace(1, gain, COLS), 1),
        spread=RANDOM.uniform(0.5, 1, shape) * SCREEN,
        core=RANDOM.uniform(0, 0.1, (3, rank, rank)),
        collect=RANDOM.uniform(0.5, 1, shape) * SCREEN / SCREEN.sum(),
        ambient=RANDOM.uniform(0, 0.01, (3, ROWS, COLS)) * SCREEN,
    )
    return LowRankObservation(factors, SCREEN)


DOMES = pytest.mark.parametrize("observation", [dome(1, 1.0), dome(3, 0.5)], ids=["one", "three"])
LIGHT = RANDOM.random((1, ROWS, COLS, 3), np.float32) ** 4
AREAS = RANDOM.uniform(1, 2, (ROWS, COLS)) * SCREEN


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of three pixels, which do not fill the picture."""
    monkeypatch.setattr(ruler, "FINEST", 15)


@DOMES
def test_an_overview_is_the_average_of_what_is_observed(observation: LowRankObservation) -> None:
    overview = Overview(observation, SCREEN, AREAS)
    seen = observation.observe(LIGHT)
    small, own, excited = overview.of(LIGHT)
    assert own is not None
    assert excited is not None
    np.testing.assert_allclose(small, averaged(seen, SCREEN), atol=1e-6)
    np.testing.assert_allclose(own, averaged(observation.direct(LIGHT), SCREEN), atol=1e-6)
    weights = np.array([0.2, 0.7, 0.1])
    pollution = np.sum(AREAS * ((seen - observation.direct(LIGHT))[0] @ weights)) / AREAS.sum()
    assert overview.pollution(excited, weights) == pytest.approx(pollution, rel=1e-5)


@DOMES
def test_what_is_seen_around_places_is_what_is_observed_there(
    observation: LowRankObservation,
) -> None:
    overview = Overview(observation, SCREEN, AREAS)
    rows, cols = np.array([20, 2, 30]), np.array([7, 15, 34])
    found = overview.around(LIGHT, overview.of(LIGHT))(0, rows, cols)
    expected = around_of(planes_of(observation.observe(LIGHT)), 0, rows, cols)
    np.testing.assert_allclose(found, expected, atol=1e-6)


@DOMES
def test_a_floor_is_what_subtraction_leaves_beside_own_light(
    observation: LowRankObservation,
) -> None:
    upper = SCREEN[None, :, :, None].astype(np.float32)
    wanted = observation.direct(LIGHT * upper)
    floor = Floor(observation, planes_of(wanted), upper)
    light, _ = subtracted(observation, wanted, (0.0, upper))
    shown, some = observation.observe(light), slice(10, 20)
    np.testing.assert_array_equal(floor.subtracted(), light)
    beside = np.stack(floor.planes(0, some, slice(0, COLS)), -1)
    np.testing.assert_allclose(beside, (shown - observation.direct(light))[0, some], atol=1e-6)
    projected, left = (np.stack(each, -1) for each in floor.projected(some, slice(0, COLS)))
    np.testing.assert_array_equal(projected, light[0, some])
    np.testing.assert_allclose(left, (shown - wanted)[0, some], atol=1e-6)
    worst = float(np.abs(shown - wanted).max())
    assert floor.leaves(0.9 * worst)
    assert not floor.leaves(1.1 * worst)


def test_newtons_last_look_is_saved_where_it_would_change_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = cols = 1200
    factors = LowRank(
        np.broadcast_to(1.0, (rows, cols)),
        np.ones((1, rows, cols)),
        np.full((3, 1, 1), 0.3 / (rows * cols)),
        np.ones((1, rows, cols)),
        np.zeros((3, rows, cols)),
    )
    observation = LowRankObservation(factors, np.ones((rows, cols), np.bool_))
    # Fine enough that every eighth row and column tell of nearly all
    wave = np.sin(np.arange(rows) / 50)[:, None] * np.cos(np.arange(cols) / 40)
    wanted = (0.02 + 0.3 * np.maximum(wave, 0))[None, :, :, None] * np.ones(3)
    wanted = wanted.astype(np.float32) + RANDOM.uniform(0, 0.003, wanted.shape).astype(np.float32)
    quick, steps = subtracted(observation, wanted)
    monkeypatch.setattr(subtract, "_NOTHING", 0.0)
    sure, more = subtracted(observation, wanted)
    assert steps < more
    assert np.abs(quick - sure).max() < 1e-7


@pytest.mark.parametrize("rank", [1, 3])
@pytest.mark.parametrize("strength", [0.5, 4.0, 50.0])
def test_reflection_stronger_than_the_picture_is_subtracted_exactly(rank, strength):
    """Of lit pixels beside black: Newton's steps alone would go from all to nothing and back."""
    plain = dome(rank, 1.0).factors
    core = strength * plain.core / plain.core.sum(axis=(1, 2), keepdims=True)
    observation = LowRankObservation(replace(plain, core=core), SCREEN)
    wanted = ((np.indices((ROWS, COLS)).sum(0) % 2) * SCREEN)[None, ..., None] * np.ones(3)
    light, _ = subtracted(observation, wanted, (0.0, 1.0))
    around = observation.observe(light) - observation.direct(light)
    np.testing.assert_allclose(light, np.clip(wanted - around, 0, 1), atol=1e-6)


def test_what_holds_on_the_screen_alone_gives_the_same_there() -> None:
    """A dome's maps that are the same all over the screen are never made."""
    dome, size = load_scene("dome_imax"), 60
    observation, screen = dome.solvable(size, size), dome.screen(size, size)
    on = screen[None, :, :, None]
    light = RANDOM.random((1, size, size, 3), np.float32) ** 4 * on
    columns = Columns(screen)
    floor = Floor(observation, planes_of(light), columns=columns)
    found, _ = subtracted(observation, light, (0.0, 1.0), columns=columns)
    overview = Overview(observation, screen, dome.pixel_areas(size, size))
    small = overview.of(light).small
    assert "factors" not in vars(observation)
    expected, _ = subtracted(observation, light, (0.0, on.astype(np.float32)))
    np.testing.assert_allclose(floor.subtracted(), expected, atol=1e-7)
    np.testing.assert_allclose(found, expected, atol=1e-7)
    seen = observation.observe(light)
    np.testing.assert_allclose(small, averaged(seen, screen), atol=1e-6)
    shown = observation.observe(expected) - light
    worst = float(np.abs(shown).max())
    assert floor.leaves(0.9 * worst)
    assert not floor.leaves(1.1 * worst)
