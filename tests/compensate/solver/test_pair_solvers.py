"""Stereo pairs: the product's solver against solvers that we did not write, and its certificate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pairs import OBSERVATIONS, pair_problem, two_views
from scipy.ndimage import gaussian_filter
from theatres import BT709, viewing

from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.baselines import clipped_subtraction
from compensate.solver.gpcg import GPCG
from compensate.solver.result import Status
from compensate.weighting import CsfWeighting, PerceptualWeighting
from domesim.observation.crosstalk import Crosstalk, leak_matrices


def test_frozen_crosstalk_is_not_the_minimum_of_two_numbers():
    """Worked out by hand in validation/notes/0005: the other eye could leave some of its light."""
    crosstalk, seen = 0.1, np.array([0.005, 0.4]).reshape(2, 1, 1, 1)
    weighting = CsfWeighting(
        np.ones((1, 2, 2)), np.eye(1), np.ones((1, 1), np.bool_), (2, 2), views=2
    )
    posed = Problem(Crosstalk(1, 1, leak_matrices(crosstalk, 1)), weighting, seen)
    exact, frozen = (
        GPCG(frozen=frozen, tolerance=1e-12)(posed, seen).light.ravel() for frozen in (False, True)
    )
    assert exact == pytest.approx([0, 0.4005 / 1.01], abs=1e-12)
    assert frozen == pytest.approx([0, 0.4], abs=1e-12)


@pytest.mark.parametrize("name", OBSERVATIONS)
def test_it_stops_by_its_certificate_in_single_precision(name):
    posed, start = pair_problem(OBSERVATIONS[name](24, 31), mu=1e-4)
    single = Problem(
        posed.observation,
        posed.weighting,
        posed.desired.astype(np.float32),
        anchor=start.astype(np.float32),
        regularisation=1e-4,
    )
    found = ADMM()(single, start.astype(np.float32))
    assert found.status is Status.CONVERGED
    assert found.light.dtype == np.float32
    assert found.iterations <= 80
    least = ADMM(tolerance=1e-8, max_iterations=4000)(posed, start).cost
    assert posed.cost(found.light.astype(np.float64)) <= least * 1.001


@pytest.mark.parametrize("peak", [0.4, 0.6])
def test_crosstalk_that_varies_wildly_is_solved_all_the_same(peak):
    share = np.full((2, 24, 31), 0.02)
    share[:, 8:14, 10:18] = peak
    observation = Crosstalk(24, 31, leak_matrices(1.0), share=share)
    posed, start = pair_problem(observation, mu=1e-4)
    found = ADMM(max_iterations=1500)(posed, start)
    assert found.status is Status.CONVERGED
    check = GPCG(tolerance=1e-5, max_iterations=2000, max_cg_steps=60)(posed, start)
    assert found.cost <= check.cost * 1.001


def textured(rows: int, cols: int) -> np.ndarray:
    """A pair with fine texture, and darkness beside it."""
    random = np.random.default_rng(0)
    fine = gaussian_filter(random.standard_normal((2, rows, cols, 3)), (0, 1.5, 1.5, 0))
    wide = gaussian_filter(random.standard_normal((2, rows, cols, 1)), (0, 12, 12, 0))
    fine, wide = fine / fine.std(), wide / wide.std()
    light = 0.5 * np.clip(wide, 0, 1) * (1 + 0.5 * fine) + 0.005 * np.abs(fine)
    return np.clip(light, 0, 1).astype(np.float32)


def test_pixels_finer_than_the_eye_take_a_few_times_the_transforms():
    """The penalty goes by what is seen; one of 0.05 takes twice as many."""
    master = textured(192, 256)
    _, rows, cols, _ = master.shape
    degrees = cols / 86
    near = replace(viewing(), extent=degrees, image_area=degrees**2 * rows / cols)
    weighting = PerceptualWeighting()(near, BT709, np.ones((rows, cols), bool), 2)
    plain = Problem(Crosstalk(rows, cols, leak_matrices(0.05)), weighting, master)
    start = np.asarray(clipped_subtraction(plain)[0], np.float32)
    posed = Problem(plain.observation, weighting, plain.desired, anchor=start, regularisation=1e-4)
    found = ADMM(stop_when_invisible=False)(posed, start)
    assert found.status is Status.CONVERGED
    assert found.ffts <= 450


def test_a_black_pair_that_cannot_be_black_is_solved():
    """Everything is at a bound."""
    plain = OBSERVATIONS["map"](12, 16)
    observation = Crosstalk(12, 16, plain.matrices, share=plain.share, black=0.01)
    master = np.zeros((2, 12, 16, 3))
    posed = Problem(observation, two_views(12, 16, 0.1), master, anchor=master, regularisation=1e-4)
    found = ADMM()(posed, master)
    assert found.status is Status.CONVERGED
    assert found.cost <= posed.cost(master) * (1 + 1e-12)
