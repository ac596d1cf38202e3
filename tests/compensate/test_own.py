"""Observations and weightings of one's own, against the project's."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse

from compensate import compensate
from compensate.own import LinearWeighting, own_problem
from compensate.solver.accelerated import Accelerated
from compensate.solver.admm import ADMM
from compensate.solver.fitting import fitting
from compensate.solver.result import Status
from compensate.weighting import Masked, PerceptualWeighting
from domesim import load_scene
from domesim.errors import InputError
from domesim.observation.base import Observation
from domesim.observation.linear import LinearObservation

SIZE = 20
SHAPE = (1, SIZE, SIZE, 3)
DOME = load_scene("dome_imax")


@pytest.fixture
def desired() -> np.ndarray:
    """Mostly dark, so that subtraction clips."""
    random = np.random.default_rng(2)
    light = random.random(SHAPE) ** 6
    return light * DOME.screen(SIZE, SIZE)[None, :, :, None]


def by_functions() -> LinearObservation:
    """The giant dome's closed form."""
    dome = DOME.observation(SIZE, SIZE)
    ambient = dome.observe(np.zeros(SHAPE))
    return LinearObservation(SHAPE, dome.linear, dome.adjoint, ambient)


def by_matrix() -> LinearObservation:
    """The same."""
    dome = DOME.observation(SIZE, SIZE)
    unit = np.eye(np.prod(SHAPE)).reshape(-1, *SHAPE)
    matrix = np.stack([dome.linear(each).ravel() for each in unit], axis=1)
    ambient = dome.observe(np.zeros(SHAPE))
    return LinearObservation.of_matrix(SHAPE, scipy.sparse.csr_array(matrix), ambient)


@pytest.mark.parametrize("make", [by_functions, by_matrix])
def test_the_projects_own_dome_told_anew_has_the_same_answer(make, desired):
    observation = make()
    light = np.random.default_rng(3).random(SHAPE)
    assert observation.observe(light) == pytest.approx(DOME.observation(SIZE, SIZE).observe(light))
    ours = compensate(desired, DOME, solver=ADMM(1e-6, stop_when_invisible=False))
    own = compensate(desired, DOME, solver=Accelerated(1e-7), observation=observation)
    problem = own_problem(desired, DOME, observation)
    inside = DOME.screen(SIZE, SIZE)[None, :, :, None]
    costs = [problem.cost(result.light * inside) for result in (ours, own)]
    # Anchors differ a little, where nothing is seen
    assert costs[1] == pytest.approx(costs[0], rel=2e-3)
    assert own.status is Status.CONVERGED


def test_the_solver_that_fits_says_why(desired):
    dome = own_problem(desired, DOME)
    assert isinstance(fitting(dome).solver, ADMM)
    assert "ClosedFormDome" in fitting(dome).why
    pair = np.full((2, SIZE, SIZE, 3), 0.2)
    assert isinstance(fitting(own_problem(pair, load_scene("stereo_cinema_silver"))).solver, ADMM)
    own = own_problem(desired, DOME, by_functions())
    assert isinstance(fitting(own).solver, Accelerated)
    assert "got LinearObservation" in fitting(own).why
    masked = dome.weighted_by(Masked(np.ones((SIZE, SIZE)), dome.weighting))
    assert isinstance(fitting(masked).solver, Accelerated)
    assert "got Masked" in fitting(masked).why


def test_a_weighting_of_ones_own(desired):
    """Twice a weighting, told by functions: the same optimum."""
    csf = PerceptualWeighting()(
        DOME.viewing, DOME.projector.luminance_weights, DOME.screen(SIZE, SIZE)
    )
    own = LinearWeighting(SHAPE, csf.apply, csf.adjoint)
    found = compensate(desired, DOME, weighting=own, solver=Accelerated(1e-7))
    problem = own_problem(desired, DOME)
    wanted = ADMM(1e-6, stop_when_invisible=False)(problem, problem.anchor)
    assert problem.cost(found.light) == pytest.approx(wanted.cost, rel=1e-4)


def test_maps_that_are_not_what_they_should_be():
    with pytest.raises(ValueError, match="takes a linear apply"):
        LinearObservation(SHAPE, lambda x: x + 1, lambda y: y)
    with pytest.raises(ValueError, match="takes the adjoint of apply"):
        LinearObservation(SHAPE, lambda x: np.roll(x, 1, 2), lambda y: np.roll(y, 1, 2))
    with pytest.raises(ValueError, match=r"returns \(1, 20, 20, 3\), got \(1, 20, 20, 1\)"):
        LinearWeighting(SHAPE, lambda x: x[..., :1], lambda w: w)


class Seen(Observation):
    """A veil of a share of the mean, of which nobody gives an adjoint."""

    @property
    def shape(self):
        return SHAPE

    def _observe(self, light):
        return light + 0.3 * np.mean(light)

    def _direct(self, light):
        return light


def test_what_a_class_offers_decides(desired):
    seen = Seen()
    for weighting in (None, "aim"):
        result = compensate(desired, DOME, observation=seen, weighting=weighting)
        assert result.status is Status.AIMED
    subtracted = compensate(desired, DOME, observation=seen, method="subtractive").light
    on = DOME.screen(SIZE, SIZE)[None, :, :, None] & (subtracted > 0)
    np.testing.assert_allclose(
        seen.observe(subtracted)[np.broadcast_to(on, SHAPE)],
        desired[np.broadcast_to(on, SHAPE)],
        atol=1e-4,
    )
    with pytest.raises(InputError, match="need an observation with an adjoint, got Seen;"):
        compensate(desired, DOME, observation=seen, weighting="paper")
    with pytest.raises(InputError, match="compensate takes an Observation, got a int"):
        compensate(desired, DOME, observation=3)


def test_single_precision_stops_where_it_can_tell_no_more(desired):
    """What no iteration could improve is told, and costs what double precision finds."""
    solver, found = Accelerated(tolerance=1e-9, max_iterations=1000), {}
    for precision in (np.float32, np.float64):
        problem = own_problem(desired.astype(precision), DOME, by_functions())
        found[precision] = solver(problem, problem.anchor)
    single, double = found[np.float32], found[np.float64]
    assert single.status is Status.STALLED
    assert single.iterations < double.iterations <= 1000
    assert single.optimality <= np.finfo(np.float32).eps
    assert single.cost == pytest.approx(double.cost, rel=1e-4)
