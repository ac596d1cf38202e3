"""Deghosting baselines: what they promise, by hand, by closed form and by SciPy and colour."""

from __future__ import annotations

import colour
import numpy as np
import pytest
from array_libraries import LIBRARIES
from laws.test_crosstalk_laws import BLACK, COLOURED, LEVELS, grey_table
from scipy.optimize import minimize
from theatres import problem as dome_problem

from compensate.problem import Problem
from compensate.solver.baselines import RaisedBlack, Subtractive, clipped_subtraction
from compensate.solver.deghosting import (
    LocallyRaisedBlack,
    PerceptualSubtraction,
    PlayerShader,
    bumps,
    uncorrectable,
)
from compensate.solver.result import Status
from compensate.weighting import CsfWeighting
from domesim.light.rounding import ROUNDING
from domesim.observation.crosstalk import Crosstalk, leak_matrices
from domesim.observation.grey_to_grey import GreyToGrey
from domesim.observation.projector import conversion
from domesim.observation.seats import SeveralSeats

ROWS, COLS = 9, 11
SHARE = 0.5 + np.random.default_rng(1).random((2, ROWS, COLS))
VEIL = LocallyRaisedBlack(pixels_per_degree=2.0)
SOLVERS = [
    Subtractive(),
    RaisedBlack(),
    PlayerShader(),
    PerceptualSubtraction(),
    VEIL,
]
by_name = pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)


def plain(rows: int, cols: int) -> CsfWeighting:
    """Every residual counts alike."""
    gains = np.ones((1, rows, cols // 2 + 1))
    return CsfWeighting(gains, np.eye(3), np.ones((rows, cols), bool), (rows, cols), views=2)


def posed(observation, desired, bounds=(0.0, 1.0)) -> Problem:
    return Problem(observation, plain(*desired.shape[1:3]), desired, bounds)


def pair(dtype=np.float64) -> np.ndarray:
    """Dark pictures with bright, coloured patches, at other places from left to right."""
    random = np.random.default_rng(3)
    light = 0.03 * random.random((2, ROWS, COLS, 3))
    bright = random.random((2, ROWS, COLS, 1)) > 0.7
    return np.where(bright, random.random((2, ROWS, COLS, 3)), light).astype(dtype)


def by_hand(left=0.005, right=0.4, c=0.1, rows=3, cols=4) -> Problem:
    desired = np.stack([np.full((rows, cols, 3), left), np.full((rows, cols, 3), right)])
    return posed(Crosstalk(rows, cols, leak_matrices(c)), desired)


def grey() -> GreyToGrey:
    return GreyToGrey(ROWS, COLS, LEVELS, grey_table(), black=BLACK)


OBSERVATIONS = {
    "constant": lambda: Crosstalk(ROWS, COLS, leak_matrices(0.05)),
    "directions": lambda: Crosstalk(ROWS, COLS, leak_matrices([[0.02], [0.1]]), black=BLACK),
    "map x 3x3": lambda: Crosstalk(ROWS, COLS, COLOURED, share=SHARE),
    "linearised": lambda: GreyToGrey(ROWS, COLS, LEVELS, grey_table()).linearised(pair()),
}
by_kind = pytest.mark.parametrize("name", OBSERVATIONS)


def matrix_at(observation, row: int, col: int) -> np.ndarray:
    """(6, 6) from the six lights of a pixel to what is seen there."""
    result = np.empty((6, 6))
    for k, (view, p) in enumerate(np.ndindex(2, 3)):
        light = np.zeros(observation.shape)
        light[view, row, col, p] = 1
        result[:, k] = observation.linear(light)[:, row, col].ravel()
    return result


def delta_e(light: np.ndarray, desired: np.ndarray, to_xyz: np.ndarray) -> np.ndarray:
    """(view, row, col), by colour-science."""
    white = colour.XYZ_to_xy(to_xyz.sum(axis=1))
    lab = [colour.XYZ_to_Lab(rgb @ to_xyz.T, white) for rgb in (light, desired)]
    return colour.delta_E(*lab, method="CIE 1976")


def test_subtraction_by_hand():
    result = Subtractive()(by_hand(), None)
    assert result.light[0] == pytest.approx(0, abs=0)
    assert result.light[1] == pytest.approx(0.4, abs=1e-15)
    assert result.status is Status.CLOSED_FORM
    # and where nothing clips: (w_L - c w_R) / (1 - c²)
    light, _ = clipped_subtraction(by_hand(0.2, 0.5))
    assert light[0] == pytest.approx((0.2 - 0.05) / 0.99, abs=1e-15)
    assert light[1] == pytest.approx((0.5 - 0.02) / 0.99, abs=1e-15)


@by_kind
def test_subtraction_is_the_fixed_point(name):
    """x = clip(desired - black - phi(x))."""
    problem = posed(OBSERVATIONS[name](), pair())
    light, rounds = clipped_subtraction(problem)
    again = problem.project(light - problem.residual(light))
    assert np.abs(again - light).max() <= 2e-15
    assert rounds < 40
    clipped = uncorrectable(problem, light)
    assert 0.05 < clipped.mean() < 0.5
    assert (light[clipped] == 0).all() | (light[clipped] == 1).any()


@pytest.mark.parametrize("strength", [0.5, 0.89])
def test_subtraction_of_strong_crosstalk_ends(strength):
    problem = posed(Crosstalk(ROWS, COLS, leak_matrices(strength)), pair())
    light, rounds = clipped_subtraction(problem)
    assert rounds < 400
    assert np.abs(problem.project(light - problem.residual(light)) - light).max() <= 2e-15
    assert Subtractive(max_rounds=2)(problem, None).status is Status.EXHAUSTED


def test_subtraction_of_the_exact_table():
    problem = posed(grey(), pair())
    light, rounds = clipped_subtraction(problem)
    assert rounds < 60
    assert np.abs(problem.project(light - problem.residual(light)) - light).max() <= 1e-15
    # It is also that of the linearisation there.
    there = posed(grey().linearised(light), pair())
    assert clipped_subtraction(there)[0] == pytest.approx(light, abs=1e-14)


def test_subtraction_of_a_table_with_sharp_bends():
    """Slopes of 0.1 and 1.9: Newton's method would jump between them."""
    levels = np.linspace(0, 1, 11)
    zigzag = np.concatenate([[0], np.cumsum(np.tile([0.19, 0.01], 5))])
    curve = zigzag - levels
    table = np.zeros((2, 3, 11, 11)) + curve[:, None] + 0.04 * levels
    random = np.random.default_rng(5)
    problem = posed(GreyToGrey(ROWS, COLS, levels, table), random.random((2, ROWS, COLS, 3)))
    light, rounds = clipped_subtraction(problem)
    assert rounds < 60
    assert np.abs(problem.project(light - problem.residual(light)) - light).max() <= 1e-14


def test_subtraction_without_bounds_inverts():
    """Also beyond the table's ends, and where own light is seen far brighter than it is."""
    desired = pair()
    desired[0, 4:], desired[1, :, 3:5] = 1.3, -0.1
    table = np.minimum(LEVELS / 0.3, 1)[:, None] * (0.6 + 0.2 * LEVELS)
    steep = GreyToGrey(ROWS, COLS, LEVELS, np.broadcast_to(table, (2, 3, 5, 5)))
    for observation in (
        grey(),
        steep.linearised(0.25 * pair()),
        *(make() for make in OBSERVATIONS.values()),
    ):
        problem = posed(observation, desired, bounds=(-2.0, 3.0))
        light, rounds = clipped_subtraction(problem)
        assert rounds < 60
        assert np.abs(problem.residual(light)).max() <= 3e-15


@pytest.mark.parametrize("convert", LIBRARIES)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", ["map x 3x3", "exact table"])
def test_subtraction_on_every_array_library(name, dtype, convert):
    observation = grey() if name == "exact table" else OBSERVATIONS[name]()
    expected, _ = clipped_subtraction(posed(observation, pair()))
    light, rounds = clipped_subtraction(posed(observation, convert(pair(dtype))))
    assert light.dtype == convert(pair(dtype)).dtype
    assert rounds < 60
    assert np.asarray(light) == pytest.approx(expected, abs=1e-6 if dtype == np.float32 else 1e-14)


def test_a_raised_black_by_hand():
    """b + (1 - b) 0.005 = 0.1 (b + (1 - b) 0.4), so that the left eye projects nothing."""
    problem = by_hand()
    result = RaisedBlack()(problem, None)
    black = 0.035 / 0.935
    assert result.light[0] == pytest.approx(0, abs=1e-15)
    assert problem.observation.observe(result.light) == pytest.approx(
        black + (1 - black) * problem.desired, abs=1e-15
    )


@by_kind
def test_a_raised_black_is_exact_and_the_least(name):
    problem = posed(OBSERVATIONS[name](), pair())
    light = RaisedBlack()(problem, None).light
    seen = problem.observation.observe(light)
    lift = 1 - problem.desired
    black = ((seen - problem.desired) * lift).sum() / (lift**2).sum()
    assert 0.01 < black < 0.5
    assert seen == pytest.approx(problem.desired + black * lift, abs=1e-14)
    assert min(light.min(), 1 - light.max()) == pytest.approx(0, abs=1e-15)


def test_the_player_s_shader_has_one_number_for_each_eye_and_primary():
    observation = OBSERVATIONS["map x 3x3"]()
    problem = posed(observation, pair())
    light = PlayerShader()(problem, None).light
    for view in range(2):
        c = SHARE[view].mean() * COLOURED[view].sum(axis=1)
        expected = (1 - c) * pair()[view] + c * (1 - pair()[1 - view])
        assert light[view] == pytest.approx(expected, abs=1e-14)


@by_kind
def test_perceptual_subtraction_looks_nearer(name):
    to_xyz = conversion("P3-DCI", "XYZ")
    problem = posed(OBSERVATIONS[name](), pair())
    plain_light, _ = clipped_subtraction(problem)
    result = PerceptualSubtraction(to_xyz)(problem, None)
    ghosts = uncorrectable(problem, plain_light).any(axis=(0, 3))
    assert result.status is Status.CLOSED_FORM
    assert (result.light >= 0).all()
    assert (result.light <= 1).all()
    assert (result.light[:, ~ghosts] == plain_light[:, ~ghosts]).all()
    before, after = (
        delta_e(problem.observation.observe(light), problem.desired, to_xyz)[:, ghosts]
        for light in (plain_light, result.light)
    )
    assert (after <= before + 1e-3).all()
    clips = before.max(axis=0) > 1
    assert np.mean((after < 0.9 * before).any(axis=0)[clips]) > 0.4
    assert after.mean() < 0.9 * before.mean()


def test_perceptual_subtraction_finds_the_nearest_colours():
    """Neither eye finds a better one beside the other's, by L-BFGS-B from several starts."""
    to_xyz = conversion("BT.709", "XYZ")
    problem = posed(OBSERVATIONS["map x 3x3"](), pair())
    plain_light, _ = clipped_subtraction(problem)
    light = PerceptualSubtraction()(problem, None).light
    changed = np.argwhere((light != plain_light).any(axis=(0, 3)))
    assert len(changed) > 10
    for row, col in changed[:6]:
        matrix = matrix_at(problem.observation, row, col).reshape(2, 3, 2, 3)
        here = light[:, row, col]
        for view in range(2):
            ghost = matrix[view, :, 1 - view] @ here[1 - view]

            def squares(x, ghost=ghost, wanted=problem.desired[view, row, col]):
                return delta_e(x + ghost, wanted, to_xyz) ** 2

            for start in (here[view], (here[view] + 0.02) / 2):
                better = minimize(squares, start, method="L-BFGS-B", bounds=[(0, 1)] * 3).fun
                assert squares(here[view]) <= better + 1e-3


def test_perceptual_subtraction_in_parts_and_in_float32(monkeypatch):
    problem = posed(OBSERVATIONS["map x 3x3"](), pair())
    whole = PerceptualSubtraction()(problem, None).light
    monkeypatch.setattr("compensate.solver.deghosting.PIXELS_AT_ONCE", 7)
    assert PerceptualSubtraction()(problem, None).light == pytest.approx(whole, abs=1e-15)
    single = PerceptualSubtraction()(posed(problem.observation, pair(np.float32)), None).light
    assert single.dtype == np.float32
    assert single == pytest.approx(whole, abs=1e-4)
    assert PerceptualSubtraction(max_rounds=1)(problem, None).status is Status.EXHAUSTED


@by_kind
def test_a_local_veil_never_clips(name):
    problem = posed(OBSERVATIONS[name](), pair())
    result = VEIL(problem, None)
    assert result.status is Status.CLOSED_FORM
    seen = problem.observation.observe(result.light)
    veil = (seen - problem.desired) / (1 - problem.desired)
    assert (veil >= -ROUNDING).all()
    assert np.ptp(veil, axis=-1).max() <= 2 * ROUNDING
    assert veil.max() > 0.01


def test_a_local_veil_is_local():
    """Beyond three sigmas of the ghost the audience sees the master."""
    rows, cols = 5, 101
    desired = np.full((2, rows, cols, 3), 0.01)
    desired[1, 2, 50] = 0.8
    observation = Crosstalk(rows, cols, leak_matrices([[0.1], [0.03]]))
    problem = posed(observation, desired)
    result = LocallyRaisedBlack(pixels_per_degree=8, degrees=0.5)(problem, None)
    raised = observation.observe(result.light) - desired
    veil = raised[0, 2, :, 0] / 0.99
    assert np.abs(raised[:, :, :38]).max() <= 1e-15
    assert np.abs(raised[:, :, 63:]).max() <= 1e-15
    # the least that will do: w_L = c w_R at the ghost, whose height the Gaussian falls from
    assert 0.01 + 0.99 * veil[50] == pytest.approx(0.1 * (0.8 - 0.03 * 0), rel=1e-2)
    assert veil[50 + 4] == pytest.approx(np.exp(-0.5) * veil[50], rel=1e-2)
    assert (np.diff(veil[38:51]) >= -1e-15).all()
    assert np.abs(raised[1]).max() <= 1e-15


def test_a_veil_that_cannot_be_says_so():
    problem = posed(OBSERVATIONS["directions"](), pair())
    early = LocallyRaisedBlack(2.0, max_rounds=2)(problem, None)
    assert early.status is Status.EXHAUSTED
    assert (early.light >= 0).all()
    # black that is brighter than white: no veil helps
    bright = Crosstalk(3, 4, leak_matrices(0.1), black=1.2)
    desired = np.zeros((2, 3, 4, 3))
    assert VEIL(posed(bright, desired), None).status is Status.EXHAUSTED


@pytest.mark.parametrize("sigma", [0.3, 1.0, 4.0])
def test_bumps_cover_what_is_needed(sigma):
    random = np.random.default_rng(2)
    needed = random.random((40, 31)) ** 8 * (random.random((40, 31)) > 0.7)
    veil = bumps(needed, sigma)
    assert (veil >= needed).all()
    point = np.zeros((41, 41))
    point[20, 15] = 0.2
    row, col = np.indices(point.shape)
    squared = (row - 20) ** 2 + (col - 15) ** 2
    near = np.maximum(abs(row - 20), abs(col - 15)) <= np.ceil(3 * sigma)
    expected = 0.2 * np.exp(-squared / (2 * sigma**2)) * near
    assert bumps(point, sigma) == pytest.approx(expected, abs=1e-12)
    assert (bumps(np.zeros((3, 3)), sigma) == 0).all()
    flat = bumps(np.full((20, 20), 0.1), sigma)
    assert flat.max() <= 0.1 * max(1, 2 * np.pi * sigma**2 / 64) ** (1 / 64) * 1.01


@by_kind
@by_name
def test_where_nothing_clips_every_exact_method_shows_the_master(solver, name):
    desired = 0.2 + 0.6 * pair()
    problem = posed(OBSERVATIONS[name](), desired)
    result = solver(problem, None)
    error = np.abs(problem.residual(result.light)).max()
    if isinstance(solver, PlayerShader):
        assert error > 1e-2
    else:
        assert error <= 1e-13
    if isinstance(solver, PerceptualSubtraction | LocallyRaisedBlack):
        assert result.status is Status.EXACT


def test_no_other_observation_is_taken():
    dome, start = dome_problem(9)
    for solver in SOLVERS[2:]:
        if not isinstance(solver, Subtractive):
            with pytest.raises(ValueError, match="two views by one seat, got ClosedFormDome"):
                solver(dome, start)
    seats = SeveralSeats([OBSERVATIONS["constant"]()] * 2)
    gains = np.ones((1, ROWS, COLS // 2 + 1))
    on = np.ones((ROWS, COLS), bool)
    four = CsfWeighting(gains, np.eye(3), on, (ROWS, COLS), views=4)
    with pytest.raises(ValueError, match=r"one seat, got \(4, 9, 11, 3\)"):
        clipped_subtraction(Problem(seats, four, np.concatenate([pair(), pair()])))
    exact = posed(grey(), pair())
    for solver in SOLVERS[1:]:
        with pytest.raises(ValueError, match=r"affine observation.* got GreyToGrey"):
            solver(exact, None)
    one = Crosstalk(3, 4, leak_matrices(0.1, primaries=1))
    weighting = CsfWeighting(np.ones((1, 3, 3)), np.eye(1), np.ones((3, 4), bool), (3, 4), views=2)
    with pytest.raises(ValueError, match="takes 3 primaries, got 1"):
        PerceptualSubtraction()(Problem(one, weighting, np.ones((2, 3, 4, 1))), None)
