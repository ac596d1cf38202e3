"""3D domes: exact subtraction by its conditions, and which solver takes them."""

from __future__ import annotations

import numpy as np
import pytest
from dome_pairs import OBSERVATIONS, pair_problem, shutter

from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.baselines import Subtractive, clipped_subtraction
from compensate.solver.fitting import fitting
from domesim.observation.crosstalk import Crosstalk, leak_matrices
from domesim.observation.followed import Followed


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", OBSERVATIONS)
def test_subtraction_is_exact_wherever_it_can_be(name, dtype):
    observation = OBSERVATIONS[name](33)
    posed, _ = pair_problem(observation, seed=4)
    wanted = posed.desired.astype(dtype)
    light, rounds = clipped_subtraction(Problem(observation, posed.weighting, wanted))
    error = observation.observe(light) - wanted
    tolerance = 2e-6 if dtype == np.float32 else 1e-8
    on = np.broadcast_to(observation.first.screen[None, :, :, None], light.shape)
    between = on & (light > 0) & (light < 1)
    assert np.abs(error[between]).max() <= tolerance
    assert error[on & (light == 0)].min() >= -tolerance
    assert 0.05 < between.mean() < 0.9
    assert (light.min(), np.abs(light[~on]).max()) == (0, 0)
    assert rounds <= 16


def test_what_no_solver_knows_goes_to_the_general_one():
    observation = shutter(9)
    posed, start = pair_problem(observation)
    mapped = Crosstalk(9, 9, leak_matrices(0.05), share=np.full((2, 9, 9), 1.1))
    composed = Followed(observation.first, mapped)
    other = Problem(
        composed,
        posed.weighting,
        posed.desired,
        (posed.lower, posed.upper),
        anchor=start,
        regularisation=1e-3,
    )
    assert "Followed" in fitting(other).why
    assert isinstance(fitting(posed).solver, ADMM)
    by_rounds = Subtractive()(other, start).light
    free = (by_rounds > 0) & (by_rounds < other.upper)
    assert free.mean() > 0.1
    assert np.abs((composed.observe(by_rounds) - other.desired)[free]).max() < 1e-8
    with pytest.raises(ValueError, match="domes of low rank and pairs"):
        ADMM()(other, start)
    found = fitting(other).solver(other, start)
    assert found.cost < other.cost(start)
