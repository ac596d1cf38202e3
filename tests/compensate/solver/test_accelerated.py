"""Accelerated projected gradient, against solvers that we did not write and our own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pairs import OBSERVATIONS, pair_problem
from test_solvers import PROBLEMS, bvls, lbfgsb
from theatres import problem

from compensate.problem import Problem
from compensate.solver.accelerated import Accelerated
from compensate.solver.admm import ADMM
from compensate.solver.result import Status
from compensate.weighting import Masked

EXACT = Accelerated(tolerance=1e-9, max_iterations=50000)


@pytest.mark.parametrize("name", PROBLEMS)
def test_it_finds_the_light_of_bvls(name):
    posed, start = problem(5, **PROBLEMS[name])
    wanted = bvls(posed)
    result = EXACT(posed, start)
    assert result.status is Status.CONVERGED
    assert np.abs(result.light - wanted).max() <= 1e-6
    assert result.cost == pytest.approx(posed.cost(wanted), rel=1e-9)


def test_it_agrees_with_lbfgsb():
    posed, start = problem(24, seed=3)
    assert EXACT(posed, start).cost == pytest.approx(lbfgsb(posed, start), rel=1e-6)


@pytest.mark.parametrize("name", ["constant", "map of 3x3"])
def test_it_agrees_with_admm_on_pairs(name):
    posed, start = pair_problem(OBSERVATIONS[name](9, 12))
    result = EXACT(posed, start)
    wanted = ADMM(tolerance=1e-9, max_iterations=5000)(posed, start)
    assert result.status is Status.CONVERGED
    assert result.cost == pytest.approx(wanted.cost, rel=1e-7)
    assert np.abs(result.light - wanted.light).max() <= 1e-4


def test_it_takes_a_spatial_mask():
    posed, start = pair_problem(OBSERVATIONS["constant"](9, 12))
    mask = np.linspace(0.3, 1, 9 * 12).reshape(9, 12)
    masked = posed.weighted_by(Masked(mask, posed.weighting))
    result = EXACT(masked, start)
    assert result.status is Status.CONVERGED
    assert result.cost == pytest.approx(lbfgsb(masked, start), rel=1e-6)


def test_steps_with_momentum_need_fewer_ffts():
    """Or it were plain projected gradient."""
    posed, start = problem(24, mu=1e-4)
    result = Accelerated(tolerance=1e-6)(posed, start)
    light, steps = start, 0
    while posed.cost(light) > result.cost * (1 + 1e-6) and steps < 5 * result.iterations:
        light = posed.project(light - posed.gradient(light) / 1.2)
        steps += 1
    assert steps > 2 * result.iterations


def test_the_work_is_counted():
    """The start's gradient, a curvature, and each step: two FFTs a plane."""
    posed, start = problem(9)
    result = Accelerated(tolerance=0.0, max_iterations=7)(posed, start)
    assert result.status is Status.EXHAUSTED
    assert result.ffts == (1 + 1 + 7) * 2 * 3


def test_a_start_at_the_minimum_is_kept():
    posed, start = problem(9)
    least = EXACT(posed, start)
    again = Accelerated(tolerance=1.0)(posed, least.light)
    assert again.status is Status.CONVERGED
    assert again.iterations == 0
    assert np.array_equal(again.light, least.light)


def test_rounding_is_admitted():
    single, start = problem(24, seed=3, dtype=np.float32)
    result = replace(EXACT, tolerance=1e-12)(single, start)
    assert result.status is Status.STALLED
    double, exact_start = problem(24, seed=3)
    least = EXACT(double, exact_start).cost
    assert result.light.dtype == np.float32
    assert double.cost(result.light.astype(np.float64)) <= least * (1 + 1e-4)


def test_pins_and_bounds_are_kept():
    posed, _ = problem(15)
    bright = posed.observation.invert(posed.desired)
    light = Accelerated()(posed, bright).light
    assert (light >= posed.lower).all()
    assert (light <= posed.upper).all()


def test_nothing_to_do_is_no_division_by_zero():
    posed, _ = problem(9)
    light = np.full_like(posed.desired, 0.5)
    bare = Problem(posed.observation, posed.weighting, posed.observation.observe(light))
    result = Accelerated()(bare, light)
    assert result.status is Status.CONVERGED
