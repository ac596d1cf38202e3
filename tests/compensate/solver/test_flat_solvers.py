"""Flat cinemas: subtraction by any way is the same, and the optimum is SciPy's, certified."""

from __future__ import annotations

import numpy as np
import pytest
from dome_pairs import pair_problem
from dome_pairs import shutter as dome_pair_shutter
from flat_cinemas import (
    COMPOSITIONS,
    WAY,
    cinema,
    crosstalk,
    room_and_flat_crosstalk,
    shutter,
)
from theatres import problem as dome_problem
from theatres import weighting

from compensate import subtract
from compensate.problem import Problem
from compensate.solver.accelerated import Accelerated, certified, convexity
from compensate.solver.admm import ADMM
from compensate.solver.baselines import Subtractive, clipped_subtraction
from compensate.solver.fitting import Fitted
from compensate.solver.kinds import Kind, kind_of
from compensate.solver.result import Status
from compensate.subtract import reflecting, subtracted
from domesim.observation.base import AdjointObservation
from testing.dense import bvls, dense

ROWS, COLS = 4, 5


def posed(observation: AdjointObservation, seed: int = 0) -> Problem:
    """A dark picture, much of which cannot be shown."""
    random = np.random.default_rng(seed)
    views, rows, cols, primaries = observation.shape
    master = random.random(observation.shape) ** 8
    lambda_ = weighting(np.ones((rows, cols), bool), primaries, 0.1)
    lambda_ = lambda_.with_importance(np.ones(views))
    plain = Problem(observation, lambda_, observation.direct(master))
    start, _ = clipped_subtraction(plain)
    return Problem(
        observation,
        lambda_,
        plain.desired,
        anchor=start,
        regularisation=random.choice([1e-3, 1e-2]),
    )


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name == "pair, polarised" else pytest.mark.long)
        for name in COMPOSITIONS
    ],
)
def test_the_optimum_is_that_of_dense_least_squares(name):
    problem = posed(COMPOSITIONS[name](ROWS, COLS))
    best = bvls(problem)
    light = Accelerated(1e-9, max_iterations=20000)(problem, problem.anchor).light
    assert np.abs(light - best).max() < 1e-6
    assert problem.cost(light) == pytest.approx(problem.cost(best), rel=1e-9)
    assert np.count_nonzero(best < 1e-9) > 3  # much is clipped


def test_a_pair_in_a_room_is_solved_fast():
    problem = posed(room_and_flat_crosstalk(ROWS, COLS))
    assert kind_of(problem.observation) is Kind.REFLECTED_PAIR
    cost = problem.cost(bvls(problem))
    found = Fitted(ADMM(tolerance=1e-4))(problem, problem.anchor)
    assert found.gap is not None
    assert (found.cost - cost) / cost <= found.gap <= 1e-4


def gaps(seed: int) -> tuple[float, float]:
    """What is certified of an unfinished solution, and the true gap."""
    name = list(COMPOSITIONS)[seed % len(COMPOSITIONS)]
    problem = posed(COMPOSITIONS[name](3, 4), seed)
    best = Accelerated(1e-7)(problem, problem.anchor)  # a hair above the least cost
    for doublings in range(8):  # far from the optimum it bounds nothing
        steps = (5 + seed % 60) << doublings
        few = Accelerated(1e-9, max_iterations=steps, gap=1e-9)(problem, problem.anchor)
        if few.gap is not None:
            break
    return few.gap, (few.cost - best.cost) / best.cost


@pytest.mark.parametrize("seed", [6, 8, 11])  # whose bounds are tight
def test_what_is_certified_is_above_the_true_gap(seed):
    bound, true = gaps(seed)
    assert true > 0
    assert true - 1e-12 <= bound


def test_the_certificate_is_that_of_the_bound_by_hand():
    problem = posed(cinema(ROWS, COLS))
    modulus = convexity(problem)
    matrix, _, _ = dense(problem)
    assert 0 < modulus <= np.linalg.eigvalsh(matrix.T @ matrix)[0] * (1 + 1e-9)
    x = np.full(problem.observation.shape, 0.2)
    gradient = np.random.default_rng(3).standard_normal(x.shape) * modulus
    y = np.linspace(0, 1, 2001)
    by_hand = gradient[..., None] * (0.2 - y) - modulus / 2 * (0.2 - y) ** 2
    assert certified(problem, x, gradient, modulus) == pytest.approx(
        by_hand.max(axis=-1).sum(), rel=1e-5
    )


def test_the_general_solver_stops_at_the_certified_gap():
    problem = posed(shutter(ROWS, COLS))
    result = Fitted(ADMM(tolerance=1e-2))(problem, problem.anchor)
    assert result.status in (Status.CONVERGED, Status.INVISIBLE)
    assert result.gap is not None
    assert 0 < result.gap <= 1e-2
    known, start = dome_problem(9)
    assert Fitted(ADMM())(known, start).light == pytest.approx(ADMM()(known, start).light, abs=0)


def test_an_observation_says_what_it_is():
    assert kind_of(dome_problem(7)[0].observation) is Kind.LOW_RANK
    assert kind_of(dome_pair_shutter(7)) is Kind.REFLECTED_PAIR
    assert kind_of(crosstalk(4, 5)) is Kind.PIXELWISE
    assert kind_of(cinema(4, 5)) is kind_of(shutter(4, 5)) is Kind.OTHER
    assert kind_of(WAY.only("room").one_view(4, 5, 0.0)) is Kind.LOW_RANK
    assert reflecting(shutter(4, 5)).shape == (1, 4, 5, 3)
    assert reflecting(crosstalk(4, 5)) is None


@pytest.mark.parametrize("kind", ["dome", "pair", "3D dome"])
def test_rounds_find_what_the_fast_ways_find(kind, monkeypatch):
    if kind == "dome":
        problem = dome_problem(9)[0]
    elif kind == "pair":
        problem = posed(crosstalk(6, 7))
    else:
        problem = pair_problem(dome_pair_shutter(9))[0]
    monkeypatch.setattr("domesim.light.strips.SAMPLES", 30)  # several strips
    fast, _ = clipped_subtraction(problem)
    monkeypatch.setattr(subtract, "_parts", lambda observation, like: None)
    by_rounds, rounds = clipped_subtraction(problem)
    assert rounds < 200
    assert np.abs(by_rounds - fast).max() < 2e-7


INVERTED = {
    "dome": lambda: dome_problem(9)[0].observation,
    "pair": lambda: crosstalk(6, 7),
    "3D dome": lambda: dome_pair_shutter(9),
    **{name: lambda make=make: make(6, 7) for name, make in COMPOSITIONS.items()},
}


@pytest.mark.parametrize("name", INVERTED)
def test_subtraction_without_bounds_inverts_what_is_seen(name):
    observation = INVERTED[name]()
    light = np.random.default_rng(5).standard_normal(observation.shape)
    back, _ = subtracted(observation, observation.observe(light), (-np.inf, np.inf))
    assert np.abs(back - light).max() < 1e-7


@pytest.mark.parametrize("name", COMPOSITIONS)
def test_subtraction_is_exact_where_it_does_not_clip(name):
    problem = posed(COMPOSITIONS[name](8, 9))
    result = Subtractive()(problem, problem.anchor)
    assert result.status is Status.CLOSED_FORM
    error = problem.observation.observe(result.light) - problem.desired
    free = (result.light > 0) & (result.light < 1)
    assert 0.3 < free.mean() < 0.95
    assert np.abs(error[free]).max() < 1e-8
    assert error[result.light == 0].min() > 0
    again, rounds = clipped_subtraction(problem, start=result.light)
    assert np.abs(again - result.light).max() < 1e-7
    newton = name in ("pair, room alone", "pair, room, flat crosstalk")
    assert newton or rounds <= 2
