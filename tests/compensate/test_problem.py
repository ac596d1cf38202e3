"""The objective: its gradient against finite differences, its optimality, its guards."""

from __future__ import annotations

import numpy as np
import pytest
from theatres import picture, problem

from testing.dense import dense


def test_the_gradient_is_that_of_the_cost():
    posed, _ = problem(7)
    random = np.random.default_rng(0)
    for _ in range(5):
        x = picture(7, seed=9)
        d = random.standard_normal(x.shape)
        step = 1e-4
        slope = (posed.cost(x + step * d) - posed.cost(x - step * d)) / (2 * step)
        assert (posed.gradient(x) * d).sum() == pytest.approx(slope, rel=1e-7)


def test_the_curvature_is_that_of_the_gradient():
    posed, _ = problem(7)
    x, d = picture(7, seed=1), np.random.default_rng(0).standard_normal((1, 7, 7, 3))
    curvature, product = posed.curvature(d)
    assert product == pytest.approx(posed.gradient(x + d) - posed.gradient(x), rel=1e-9, abs=1e-12)
    assert curvature == pytest.approx((product * d).sum(), rel=1e-12)


def test_the_cost_is_that_of_the_dense_problem():
    posed, _ = problem(5)
    matrix, offset, free = dense(posed)
    light = posed.project(picture(5, seed=7))
    direct = 0.5 * np.sum((matrix @ light[free] - offset) ** 2)
    assert posed.cost(light) == pytest.approx(direct, rel=1e-12)


def test_frozen_pollution_has_the_true_cost_where_it_was_frozen():
    posed, start = problem(7)
    frozen = posed.frozen(start)
    assert frozen.cost(start) == pytest.approx(posed.cost(start), rel=1e-12)
    assert np.abs(frozen.gradient(start) - posed.gradient(start)).max() > 1e-6
