"""Accelerated projected gradient: its work, its stops, its rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from theatres import problem

from compensate.problem import Problem
from compensate.solver.accelerated import Accelerated
from compensate.solver.result import Status

EXACT = Accelerated(tolerance=1e-9, max_iterations=50000)


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


def test_nothing_to_do_is_no_division_by_zero():
    posed, _ = problem(9)
    light = np.full_like(posed.desired, 0.5)
    bare = Problem(posed.observation, posed.weighting, posed.observation.observe(light))
    result = Accelerated()(bare, light)
    assert result.status is Status.CONVERGED
