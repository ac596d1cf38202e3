"""Baselines: exact where they promise it, by the equations that define them."""

from __future__ import annotations

import numpy as np
import pytest
from laws.test_linear_maps import RankTwo
from theatres import closed_form, picture, problem, weighting

from compensate import subtract
from compensate.problem import Problem
from compensate.solver.baselines import (
    RaisedBlack,
    Subtractive,
    clipped_subtraction,
    unclipped,
)
from compensate.solver.gpcg import GPCG


@pytest.mark.parametrize("falloff", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_subtraction_is_the_fixed_point(seed, falloff):
    """x = clip(x + D^-1 (seen - psi(x))): with the pollution of the clipped picture."""
    posed, start = problem(15, seed=seed, falloff=falloff)
    gain = posed.observation.factors.direct_gain[None, :, :, None]
    again = posed.project(start - posed.residual(start) / gain)
    on = posed.observation.screen[None, :, :, None]
    assert np.abs((again - start) * on).max() <= 1e-9
    assert np.mean((start <= 0)[0][posed.observation.screen]) > 0.2
    one_shot = posed.project(unclipped(posed.observation, posed.desired)[0])
    assert np.abs((one_shot - start) * on).max() > 1e-3


def test_subtraction_solves_several_modes():
    observation = RankTwo(9, 3)
    screen = observation.screen
    master = picture(9)
    on = screen[None, :, :, None]
    bounds = (np.where(on, 0, master), np.where(on, 1, master))
    posed = Problem(observation, weighting(screen), observation.direct(master), bounds)
    light = Subtractive()(posed, master).light
    gain = observation.factors.direct_gain[None, :, :, None]
    again = posed.project(light - posed.residual(light) / gain)
    assert np.abs((again - light) * on).max() <= 1e-9


def test_a_raised_black_shows_the_compressed_master_exactly():
    posed, start = problem(15, falloff=False)
    result = RaisedBlack()(posed, start)
    on = posed.observation.screen
    seen = posed.observation.observe(result.light)[0][on]
    wanted = posed.desired[0][on]
    white = posed.observation.direct(np.ones_like(start))[0][on]
    # seen = black white + (1 - black) wanted, for one black level
    lift = white - wanted
    black = ((seen - wanted) * lift).sum() / (lift**2).sum()
    assert 0.05 < black < 0.9
    assert seen == pytest.approx(black * white + (1 - black) * wanted, abs=1e-9)
    # and it is the smallest: some pixel is at its bound
    assert result.light[0][on].min() == pytest.approx(0, abs=1e-9)


def test_frozen_pollution_is_minimised():
    posed, start = problem(9)
    frozen = posed.frozen(start)
    assert GPCG(max_iterations=3)(frozen, start).cost <= frozen.cost(start)


def test_a_first_estimate_of_some_pixels_saves_passes(monkeypatch):
    observation = closed_form(128, falloff=False)
    screen = observation.screen
    rows, cols = np.mgrid[:128, :128] / 127
    master = np.stack([rows * cols, rows**3, cols**4], -1)[None] * screen[None, :, :, None]
    bounds = (0.0, screen[None, :, :, None].astype(float))
    posed = Problem(observation, weighting(screen), master, bounds)
    light, passes = clipped_subtraction(posed)
    monkeypatch.setattr(subtract, "_EVERY", 128)  # a corner, which tells nothing
    same, more = clipped_subtraction(posed)
    assert passes < more
    np.testing.assert_allclose(light, same, atol=1e-7)
