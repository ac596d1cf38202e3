"""Anderson acceleration: what it solves exactly."""

from __future__ import annotations

import numpy as np

from compensate.solver.admm.anderson import Anderson

RATES = np.array([0.5, 0.1, 0.02])[:, None, None]


def distances(memory: int, steps: int) -> list[float]:
    """How far s <- s + rate (aim - s) of planes of different rates is from where it leads."""
    aim = np.random.default_rng(0).normal(size=(3, 13, 18))
    s = np.zeros_like(aim)
    anderson = Anderson(memory)
    found = []
    for _ in range(steps):
        found.append(float(np.abs(s - aim).max()))
        residual = RATES * (aim - s)
        s = anderson.next(s + residual, residual)
    return found


def test_as_many_points_as_there_are_rates_are_enough():
    """With three rates, three old points cancel all of the residual (Walker & Ni, theorem 2.2)."""
    assert distances(0, 8)[-1] > 0.5
    assert distances(3, 8)[-1] < 1e-7


def test_it_begins_anew_where_the_residual_grows():
    """What it knew of another problem does not mislead it."""
    anderson = Anderson(3)
    random = np.random.default_rng(1)
    for size in (1e-6, 0.9e-6, 0.8e-6):
        anderson.next(random.normal(size=(1, 4, 4)), size * random.normal(size=(1, 4, 4)))
    point, residual = random.normal(size=(2, 1, 4, 4))
    np.testing.assert_array_equal(anderson.next(point, residual), point)
