"""Codes that noise does not blur: what the mean of many pixels is off by is counted."""

from __future__ import annotations

import numpy as np
import pytest
from survey_rooms import CAMERA, PATTERNS, THEATRE

from domesim.measure.dome.photographs import Photographs, cells_of
from domesim.measure.dome.responses import responses_of
from domesim.measure.rounding import scatter_of, shared_rounding, step_of
from testing.screens import SMALL, raw_screen
from testing.statistics import calibration
from testing.surveys import Sensor, surveyed

SIZE = 64
STEP = 1 / 3583


def rounded(light: np.ndarray, spread: float, rng: np.random.Generator) -> np.ndarray:
    return STEP * np.round(light / STEP + spread * rng.standard_normal(light.shape))


@pytest.mark.parametrize("spread", [0.0, 0.02, 0.1, 0.2, 0.3, 0.5, 1.0])
def test_scatter_tells_what_means_are_off_by(spread):
    """Of light anywhere between two codes."""
    rng = np.random.default_rng(1)
    light = STEP * rng.uniform(0, 1, (20_000, 1))
    seen = rounded(np.repeat(light, 50, 1), spread, rng) / STEP
    scatter = seen.var(1, ddof=1).mean()
    off = np.mean((seen.mean(1) - light[:, 0] / STEP) ** 2) - scatter / 50
    assert shared_rounding(scatter) == pytest.approx(off, abs=1e-3)


def test_steps_are_those_of_codes():
    rng = np.random.default_rng(2)
    light = rng.uniform(0.002, 0.3, (40, 50, 3))
    codes = rounded(light, 0.0, rng)
    assert step_of([codes]) == pytest.approx(STEP)
    greens = codes.copy()
    greens[..., 1] = (codes[..., 1] + rounded(light, 1.0, rng)[..., 1]) / 2
    assert step_of([greens]) == pytest.approx(STEP)
    even = np.full((40, 50, 3), codes[0, 0, 0])
    assert step_of([even]) == 0
    assert step_of([even, codes]) == pytest.approx(STEP)
    assert step_of([light]) < 0.01 * STEP


def test_neighbours_tell_noise():
    noise = np.random.default_rng(3).normal(0, 0.2, (60, 81, 3))
    assert scatter_of(1 + noise).mean() == pytest.approx(0.04, rel=0.05)


def dark(spread: float, rng: np.random.Generator) -> tuple[np.ndarray, Photographs]:
    """Levels, and photographs of darkness, each the same at all places."""
    count = len(PATTERNS)
    levels = STEP * rng.uniform(3, 9, (count, 1, 1, 3))
    light = rounded(np.broadcast_to(levels, (count, SIZE, SIZE, 3)), spread, rng)
    shots = Photographs(CAMERA, light, np.arange(count), np.ones(count), (STEP,) * 3)
    return levels[:, 0, 0], shots


@pytest.mark.parametrize("spread", [0.02, 0.2, 0.7])
def test_cells_say_how_far_their_mean_may_be_off(spread):
    rng = np.random.default_rng(4)
    scores = []
    for _ in range(12):
        levels, shots = dark(spread, rng)
        cells = cells_of(THEATRE, PATTERNS, shots)
        error = np.sqrt(cells.variance.sum(1)) / cells.variance.shape[1]
        scores.append((cells.value.mean(1) - levels) / error)
    assert 0.8 < np.std(scores) < 1.2


def test_places_without_geometry_count_it_too():
    levels, shots = dark(0.02, np.random.default_rng(5))
    found = responses_of(THEATRE, PATTERNS, shots, 1)
    seen = np.isfinite(found.variance)
    off = (found.value - levels[:, None])[seen] / np.sqrt(found.variance[seen])
    assert 0.8 < np.std(off) < 1.2
    shared = found.weighed(found.value, shared=True).variance[seen]
    assert np.median(shared / found.variance[seen]) == pytest.approx(found.value.shape[1], rel=0.01)


def test_crosstalk_of_coarse_codes_is_as_sure_as_is_said():
    """Read-out noise of a tenth of a code, of 12 bits."""
    runs = [raw_screen(seed, SMALL, bits=12, read_out=0.1) for seed in range(12)]
    assert calibration(np.concatenate([run.off for run in runs])) > 1e-3


@pytest.mark.long
def test_albedos_of_coarse_codes_are_as_sure_as_is_said():
    """Of 40 domes, by raw files of 12 bits whose noise in the dark is a tenth of a code."""
    runs = [surveyed(seed, sensor=Sensor(12, 0.1), resolution=2) for seed in range(40)]
    z = np.array([[run.z[name] for name in ("screen", "floor")] for run in runs])
    assert 0.9 < np.mean(np.abs(z) < 1.96) < 0.99
