"""The certified gap is an upper bound of the true one: small problems of every class.

Each is stopped early, at random, from a random start. The true minimum is SciPy's BVLS's, on the
problem's dense matrix: no code of the solver's is used but the cost and the Hessian's products.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import dome_pairs
import numpy as np
import pytest
from laws.test_linear_maps import RankTwo
from pairs import COLOURED, pair, share
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear
from theatres import BT709, closed_form, picture, unequal_weighting, viewing, weighting

from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import CsfWeighting, PerceptualWeighting, Weighting
from domesim.observation.base import AdjointObservation
from domesim.observation.crosstalk import Crosstalk, leak_matrices
from domesim.observation.followed import Followed
from domesim.observation.seats import SeveralSeats

Theatre = tuple[AdjointObservation, Weighting]


class Setting(NamedTuple):
    """What problems of a class share, so that one dense Hessian serves many pictures."""

    size: tuple[int, int]
    gain: float
    mu: float
    padding: int = 5

    def weighting(self, support: np.ndarray, views: int = 1) -> CsfWeighting:
        settings = PerceptualWeighting(LowFrequencyFloor(self.gain), padding=self.padding)
        return settings(viewing(), BT709, support, views)


SETTINGS = [
    Setting((4, 5), 0.1, 1e-3),
    Setting((5, 4), 0.3, 1e-4),
    Setting((3, 6), 0.0, 3e-4),
    Setting((5, 3), 1.0, 1e-3),
]


def dome(primaries: int, *, falloff: bool = True) -> Callable[[Setting], Theatre]:
    def made(setting: Setting) -> Theatre:
        side = max(setting.size) + (5 if primaries == 1 else 1)
        observation = closed_form(side, primaries, falloff=falloff)
        if primaries == 1:
            return observation, weighting(observation.screen, 1, setting.gain)
        return observation, setting.weighting(observation.screen)

    return made


def rank_two(setting: Setting) -> Theatre:
    observation = RankTwo(max(setting.size), 3)
    return observation, setting.weighting(observation.screen)


def unequal(setting: Setting) -> Theatre:
    observation = closed_form(max(setting.size), 3)
    return observation, unequal_weighting(observation.screen, setting.gain)


def stereo(leak: np.ndarray, *, mapped: bool = False) -> Callable[[Setting], Theatre]:
    def made(setting: Setting) -> Theatre:
        rows, cols = setting.size
        where = share(rows, cols) if mapped else None
        observation = Crosstalk(rows, cols, leak, share=where, black=0.002)
        return observation, setting.weighting(np.ones((rows, cols), bool), 2)

    return made


def seats(setting: Setting) -> Theatre:
    rows, cols = setting.size
    observation = SeveralSeats(
        [
            Crosstalk(rows, cols, leak_matrices(0.03), black=0.001),
            Crosstalk(rows, cols, COLOURED, share=share(rows, cols)),
        ]
    )
    each = setting.weighting(np.ones((rows, cols), bool), 2)
    return observation, each.with_importance(np.array([1.0, 0.8, 0.4, 0.5]))


def dome_in_3d(make: Callable[[int], Followed]) -> Callable[[Setting], Theatre]:
    def made(setting: Setting) -> Theatre:
        observation = make(max(setting.size))
        return observation, setting.weighting(observation.first.screen, 2)

    return made


CLASSES = {
    "dome, one primary": dome(1),
    "dome, colour": dome(3),
    "dome, corrected lens": dome(3, falloff=False),
    "dome, rank two": rank_two,
    "dome, a sensitivity for each channel": unequal,
    "pair, sum and difference": stereo(leak_matrices(0.05)),
    "pair, unequal matrices": stereo(COLOURED),
    "pair, map": stereo(COLOURED, mapped=True),
    "pair, several seats": seats,
    **{name: dome_in_3d(make) for name, make in dome_pairs.OBSERVATIONS.items()},
}


EXACT_PAIRS = ("pair, sum and difference", "pair, unequal matrices")
"""Their Hessian is the same in Fourier."""


@cache
def theatre(name: str, setting: Setting) -> tuple[AdjointObservation, Weighting, np.ndarray]:
    """And the dense root R of the Hessian on what is free: H = R'R."""
    observation, lambda_ = CLASSES[name](setting)
    bare = Problem(
        observation,
        lambda_,
        np.zeros(observation.seen_shape),
        anchor=np.zeros(observation.shape),
        regularisation=setting.mu,
    )
    columns = []
    for index in np.argwhere(free(observation)):
        unit = np.zeros(observation.shape)
        unit[tuple(index)] = 1
        columns.append(bare.curvature(unit)[1][free(observation)])
    hessian = np.array(columns)
    assert np.abs(hessian - hessian.T).max() <= 1e-12
    return observation, lambda_, cholesky(hessian)


def free(observation: AdjointObservation) -> np.ndarray:
    """Which values of light are not pinned."""
    inner = observation.first if isinstance(observation, Followed) else observation
    screen = getattr(inner, "screen", None)
    if screen is None:
        return np.ones(observation.shape, bool)
    return np.broadcast_to(screen[None, :, :, None], observation.shape)


def posed(name: str, setting: Setting, seed: int) -> Problem:
    """With a picture, an anchor and bounds of its own."""
    observation, lambda_, _ = theatre(name, setting)
    random = np.random.default_rng(seed)
    views, rows, cols, primaries = observation.shape
    master = picture(rows, primaries, seed) if views == 1 else pair(rows, cols, seed)
    on = free(observation)
    lower, upper = np.where(on, 0, master), np.where(on, 1, master)
    if seed % 3 == 0:  # neither black nor white is where it was
        lower = np.where(on, 0.01 * random.random(master.shape), master)
        upper = np.where(on, 0.6 + 0.4 * random.random(master.shape), master)
    anchor = np.clip(master - 0.05 * random.random(master.shape), lower, upper)
    return Problem(
        observation,
        lambda_,
        observation.direct(master),
        (lower, upper),
        anchor=anchor,
        regularisation=setting.mu,
    )


def least(name: str, setting: Setting, problem: Problem) -> float:
    """The minimum, of BVLS on the dense problem 1/2 ||R v - b||²."""
    observation, _, root = theatre(name, setting)
    on = free(observation)
    fixed = np.where(on, 0, problem.lower)
    right = -solve_triangular(root, problem.gradient(fixed)[on], trans="T")
    bounds = (problem.lower[on], problem.upper[on])
    light = fixed.copy()
    light[on] = lsq_linear(root, right, bounds, method="bvls", tol=1e-13, max_iter=500).x
    light = problem.project(light)
    assert problem.optimality(light) <= 1e-9
    return problem.cost(light)


def cases():
    """Classes, precisions, and how many problems of each; the long ones are more than 400."""
    for name in CLASSES:
        for precision, few, many in ((np.float64, 2, 32), (np.float32, 1, 8)):
            yield pytest.param(name, precision, few)
            yield pytest.param(name, precision, many, marks=pytest.mark.long)


@pytest.mark.parametrize(("name", "precision", "many"), list(cases()))
def test_it_bounds_the_true_gap(name, precision, many):
    certified, useful = 0, 0
    for seed in range(many):
        setting = SETTINGS[seed % len(SETTINGS)]
        random = np.random.default_rng(1000 + seed)
        problem = posed(name, setting, seed)
        steps = int(random.integers(2, 21))
        solver = ADMM(tolerance=1e-13, max_iterations=steps)
        start = problem.anchor if seed % 4 else random.random(problem.anchor.shape)
        if precision is np.float32:
            problem = of_type(problem, precision)
            start = problem.anchor if seed % 4 else start.astype(precision)
        early = solver(problem, start)
        problem = of_type(problem, np.float64)
        light = early.light.astype(np.float64)
        assert (light >= problem.lower).all()
        assert (light <= problem.upper).all()
        if early.gap is None:
            continue
        certified += 1
        minimum = least(name, setting, problem)
        cost = problem.cost(light)
        true_gap = cost / minimum - 1
        assert early.gap >= true_gap - 1e-9, f"problem {seed}: {early.gap} < {true_gap}"
        useful += early.gap <= 30 * true_gap + 1e-3
    # A bound that is never given, or far off, is no use
    assert certified >= 0.5 * many
    assert useful >= 0.5 * certified


@pytest.mark.parametrize("name", CLASSES)
def test_it_is_sharp_without_bounds_and_padding(name):
    """So that no part of it can be too small."""
    setting = Setting((4, 8), 0.3, 1e-3, padding=0)
    for seed in range(3):
        problem = posed(name, setting, seed)
        on = free(problem.observation)
        problem = Problem(
            problem.observation,
            problem.weighting,
            problem.desired,
            (np.where(on, -9.0, problem.lower), np.where(on, 9.0, problem.upper)),
            anchor=problem.anchor,
            regularisation=setting.mu,
        )
        steps = 2 + seed
        early = ADMM(tolerance=1e-13, max_iterations=steps)(problem, problem.anchor)
        true_gap = problem.cost(early.light) / least(name, setting, problem) - 1
        assert true_gap > 1e-5
        if name in EXACT_PAIRS:  # nothing is off the screen
            assert true_gap * (1 - 1e-9) <= early.gap <= true_gap * (1 + 1e-4)
        elif early.gap is not None:
            # Where primaries mix, what is seen is that of the light to 1e-9
            assert early.gap >= true_gap - 1e-9


def of_type(problem: Problem, dtype: type) -> Problem:
    """The same numbers in another precision."""
    return Problem(
        problem.observation,
        problem.weighting,
        problem.desired.astype(dtype),
        (problem.lower.astype(dtype), problem.upper.astype(dtype)),
        anchor=problem.anchor.astype(dtype),
        regularisation=problem.regularisation,
    )


@pytest.mark.parametrize("seed", range(3))
def test_it_holds_in_single_precision_far_from_the_base(seed):
    """Sums are differences of large ones there, and certified no better than they are rounded."""
    setting = Setting((5, 6), 0.3, 1e-6)
    problem = posed("pair, sum and difference", setting, seed)
    random = np.random.default_rng(seed)
    anchor = random.uniform(0, 1, problem.anchor.shape)

    def in_precision(dtype):
        return Problem(
            problem.observation,
            problem.weighting,
            problem.desired.astype(dtype),
            anchor=anchor.astype(dtype),
            regularisation=setting.mu,
        )

    double = in_precision(np.float64)
    exact = ADMM(tolerance=1e-9, max_iterations=5000)(double, anchor).cost
    found = ADMM(tolerance=1e-6, max_iterations=200)(in_precision(np.float32), anchor.astype("f4"))
    assert found.gap is None or found.gap >= double.cost(found.light.astype(float)) / exact - 1
