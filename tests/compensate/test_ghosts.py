"""Ghost measures: their definitions, by hand-made edges and closed forms."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from theatres import BT709

from compensate.ghosts import edge_energy, ghost_left
from compensate.problem import Problem
from compensate.solver.baselines import clipped_subtraction
from compensate.weighting import CsfWeighting
from domesim.observation.crosstalk import Crosstalk, leak_matrices

ROWS, COLS = 21, 35


def stereo(crosstalk=((0.1,), (0.05,)), desired=None, **options) -> Problem:
    desired = picture() if desired is None else desired
    gains = np.ones((1, ROWS, COLS // 2 + 1))
    support = np.ones((ROWS, COLS), bool)
    weighting = CsfWeighting(gains, np.eye(3), support, (ROWS, COLS), views=2)
    observation = Crosstalk(ROWS, COLS, leak_matrices(crosstalk), **options)
    return Problem(observation, weighting, desired)


def picture() -> np.ndarray:
    """Dark, with a coloured bar that each eye sees elsewhere, and one on the border."""
    light = np.full((2, ROWS, COLS, 3), 0.002)
    light[0, :, 8:12] = [0.5, 0.4, 0.2]
    light[1, :, 15:20] = [0.5, 0.4, 0.2]
    light[1, 15:] = 0.3
    return light


class Measured(NamedTuple):
    """What is left of a problem's ghosts."""

    edge_energy: float
    ghost_left: float


def measured(problem: Problem, light: np.ndarray) -> Measured:
    observe, direct = problem.observation.observe, problem.observation.direct
    error = (observe(light) - problem.desired) @ BT709
    ghost = (observe(problem.desired) - direct(problem.desired)) @ BT709
    return Measured(edge_energy(error, ghost, 30.0), ghost_left(error, ghost, 30.0))


def edge(height: float, at: int = 40, size: int = 81) -> np.ndarray:
    """(view, row, col) planes with a step along the columns."""
    planes = np.zeros((2, 9, size))
    planes[:, :, at:] = height
    return planes


def test_doing_nothing_leaves_the_whole_ghost():
    for options in ({}, {"black": 0.03}):
        problem = stereo(**options)
        figures = measured(problem, problem.desired)
        assert figures.edge_energy == pytest.approx(1, abs=1e-12)
        assert figures.ghost_left == pytest.approx(1, abs=1e-12)


def test_the_perfect_picture_has_no_ghost():
    problem = stereo(desired=0.2 + picture())
    light, _ = clipped_subtraction(problem)
    figures = measured(problem, light)
    assert figures.edge_energy <= 1e-12
    assert abs(figures.ghost_left) <= 1e-12
    # no ghost and no error: 0; no ghost but an error: all of it is new
    none = stereo(0.0)
    assert measured(none, none.desired).edge_energy == 0
    assert measured(none, 0.5 * none.desired).edge_energy == np.inf
    assert measured(none, 0.5 * none.desired).ghost_left == 0


def test_brightness_does_not_matter():
    problem = stereo()
    light, _ = clipped_subtraction(problem)
    full = measured(problem, light)
    half = measured(stereo(desired=problem.desired / 2), light / 2)
    assert 0.05 < full.edge_energy < 0.95
    assert half.edge_energy == pytest.approx(full.edge_energy, rel=1e-12)


def test_a_single_edge():
    """Steps in one place: the ratio of their heights, whatever their sign."""
    ghost = edge(0.1)
    for pixels_per_degree in (5.0, 60.0):
        assert edge_energy(edge(-0.03), ghost, pixels_per_degree) == pytest.approx(0.3)
        assert edge_energy(edge(0.03, at=30), ghost, pixels_per_degree) == pytest.approx(0.3)
        assert edge_energy(0 * ghost + 0.7, ghost, pixels_per_degree) <= 1e-12
    along_rows = ghost.transpose(0, 2, 1)
    assert edge_energy(0.4 * along_rows, along_rows, 20.0) == pytest.approx(0.4)
    both = np.array([ghost[0], 0 * ghost[0]])
    assert edge_energy(both, ghost, 20.0) == pytest.approx(np.sqrt(0.5))


@pytest.mark.parametrize("blur", [1.0, 3.0, 6.0])
def test_a_blurred_edge_in_closed_form(blur):
    """An edge blurred by s keeps (1 + s²/sigma²)^(-1/4)."""
    pixels_per_degree = 45.0
    sigma = pixels_per_degree / (2 * np.pi * 3)
    ghost = edge(0.1)
    smooth = gaussian_filter(ghost, (0, 0, blur), mode="nearest")
    expected = (1 + (blur / sigma) ** 2) ** -0.25
    assert edge_energy(smooth, ghost, pixels_per_degree) == pytest.approx(expected, rel=5e-3)


def test_the_smallest_gaussian_is_of_seven_tenths_of_a_pixel():
    ghost = edge(0.1)
    smooth = gaussian_filter(ghost, (0, 0, 1.0), mode="nearest")
    coarse = edge_energy(smooth, ghost, 1.0)
    assert coarse == edge_energy(smooth, ghost, 0.7 * 6 * np.pi)
    assert coarse != edge_energy(smooth, ghost, 0.8 * 6 * np.pi)


def test_resolution_does_not_matter():
    random = np.random.default_rng(4)
    ghost = gaussian_filter(random.random((2, 60, 60)), (0, 3, 3))
    error = gaussian_filter(ghost, (0, 2, 2))
    coarse = edge_energy(error, ghost, 45.0)
    twice = [np.repeat(np.repeat(planes, 2, axis=1), 2, axis=2) for planes in (error, ghost)]
    assert edge_energy(*twice, 90.0) == pytest.approx(coarse, rel=0.01)


@pytest.mark.parametrize("share", [1.0, 0.3, 0.0, -0.4])
def test_ghost_left_is_the_share_with_its_sign(share):
    """Whatever else is in the picture, as long as its edges lie elsewhere."""
    ghost = edge(0.1)
    elsewhere = edge(0.3, at=6) - edge(0.3, at=7)
    for error in (share * ghost, share * ghost + 0.7, share * ghost + elsewhere):
        assert ghost_left(error, ghost, 60.0) == pytest.approx(share, abs=1e-9)
    assert edge_energy(share * ghost, ghost, 60.0) == pytest.approx(abs(share), abs=1e-12)
    across = edge(0.1).transpose(0, 2, 1)
    square = np.zeros((2, 81, 81))
    square[:, :, 40:] = 0.1
    assert ghost_left(square.transpose(0, 2, 1), square, 60.0) == pytest.approx(0, abs=1e-12)
    assert ghost_left(-0.2 * across, across, 60.0) == pytest.approx(-0.2)


def test_the_other_eyes_ghost_is_not_this_eyes():
    ghost = np.stack([edge(0.1)[0], edge(0.2, at=30)[0]])
    swapped = ghost[::-1]
    assert ghost_left(ghost, ghost, 20.0) == pytest.approx(1)
    assert abs(ghost_left(swapped, ghost, 20.0)) < 0.1


@pytest.mark.parametrize("blur", [1.0, 3.0])
def test_ghost_left_of_a_blurred_edge_in_closed_form(blur):
    """Gaussian slopes of variances sigma² and sigma² + s²: (1 + s²/(2 sigma²))^(-1/2)."""
    pixels_per_degree = 45.0
    sigma = pixels_per_degree / (2 * np.pi * 3)
    ghost = edge(0.1)
    smooth = gaussian_filter(ghost, (0, 0, blur), mode="nearest")
    expected = (1 + (blur / sigma) ** 2 / 2) ** -0.5
    assert ghost_left(smooth, ghost, pixels_per_degree) == pytest.approx(expected, rel=5e-3)


def test_ghost_left_is_at_most_the_edge_energy():
    random = np.random.default_rng(5)
    for _ in range(5):
        error, ghost = random.standard_normal((2, 2, 20, 30))
        assert abs(ghost_left(error, ghost, 30.0)) <= edge_energy(error, ghost, 30.0)
