"""Crosstalk of every kind: linear, with its adjoint and inverse; impossible kinds are refused."""

from __future__ import annotations

import numpy as np
import pytest
from array_libraries import LIBRARIES
from laws.test_linear_maps import assert_affine, dot
from theatres import BT709, viewing

from compensate.problem import Problem
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import PerceptualWeighting
from domesim.errors import InputError
from domesim.observation.crosstalk import Crosstalk, leak_matrices
from domesim.observation.grey_to_grey import GreyToGrey

ROWS, COLS = 5, 7
COLOURED = np.array(
    [
        [[0.05, 0.01, -0.01], [0.0, 0.04, 0.02], [0.004, 0.0, 0.03]],
        [[0.02, -0.005, 0.0], [0.003, 0.06, 0.0], [0.0, 0.02, 0.09]],
    ]
)
SHARE = 0.5 + np.random.default_rng(1).random((2, ROWS, COLS))
LEVELS = np.array([0.0, 0.05, 0.3, 0.6, 1.0])


def crosstalk(given, **options) -> Crosstalk:
    return Crosstalk(ROWS, COLS, leak_matrices(given), **options)


def grey_table(primaries: int = 3) -> np.ndarray:
    """(view, primary, own, other): more leaks the farther the pictures are apart; uneven."""
    random = np.random.default_rng(4)
    own, other = np.meshgrid(LEVELS, LEVELS, indexing="ij")
    table = 0.1 * (other - own) * (own < other) + 0.03 * other * (1 - own)
    return table * (0.5 + random.random((2, primaries, 1, 1)))


def grey_to_grey(**options) -> GreyToGrey:
    return GreyToGrey(ROWS, COLS, LEVELS, grey_table(), **options)


def light(seed: int = 0, dtype=np.float64) -> np.ndarray:
    return np.random.default_rng(seed).random((2, ROWS, COLS, 3)).astype(dtype)


BLACK = [[0.001, 0.002, 0.003], [0.004, 0.005, 0.006]]
CROSSTALK = {
    "constant": lambda: crosstalk(0.05),
    "per direction": lambda: crosstalk([[0.02], [0.08]]),
    "per primary": lambda: crosstalk([0.02, 0.05, 0.11]),
    "per direction and primary": lambda: crosstalk([[0.02, 0.05, 0.11], [0.07, 0.03, 0.01]]),
    "3x3": lambda: crosstalk(COLOURED[0]),
    "3x3 per direction": lambda: crosstalk(COLOURED),
    "map": lambda: crosstalk([[0.02], [0.08]], share=SHARE),
    "map x 3x3, black": lambda: crosstalk(COLOURED, share=SHARE, black=BLACK),
}
KINDS = {
    **CROSSTALK,
    "linearised table": lambda: grey_to_grey(black=BLACK).linearised(light(9)),
}


@pytest.mark.parametrize("convert", LIBRARIES)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", KINDS)
def test_crosstalk_is_affine_with_an_adjoint(name, dtype, convert):
    if name == "linearised table":
        observation = grey_to_grey(black=BLACK).linearised(convert(light(9, dtype)))
    else:
        observation = KINDS[name]()
    random = np.random.default_rng(2)
    x, z, y = (convert(random.standard_normal((2, ROWS, COLS, 3)).astype(dtype)) for _ in range(3))
    tolerance = 1e-6 if dtype == np.float32 else 1e-13
    assert observation.shape == (2, ROWS, COLS, 3)
    assert observation.observe(x).dtype == x.dtype
    assert_affine(observation, x, z, y, tolerance)


def test_a_pixel_by_hand():
    """psi_L = x_L + s_L M_L x_R + black_L: primaries of the seeing eye are M's rows."""
    observation = CROSSTALK["map x 3x3, black"]()
    x = light(3)
    seen = observation.observe(x)
    for view, row, col in ((0, 1, 6), (1, 4, 2)):
        leaked = SHARE[view, row, col] * COLOURED[view] @ x[1 - view, row, col]
        expected = x[view, row, col] + leaked + BLACK[view]
        assert seen[view, row, col] == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("name", KINDS)
def test_central_is_the_matrix_of_all_pixels_where_they_are_alike(name):
    observation = KINDS[name]()
    x = light(5)
    found = np.einsum("vpuq,uijq->vijp", observation.central, x)
    gap = np.abs(found - observation.linear(x)).max()
    assert (gap <= 1e-15) == (not name.startswith(("map", "linearised")))
    # The mean over the picture of a flat picture is right in any case.
    x = np.broadcast_to(x[:, :1, :1], x.shape)
    found = np.einsum("vpuq,uijq->vijp", observation.central, x).mean(axis=(1, 2))
    assert found == pytest.approx(observation.linear(x).mean(axis=(1, 2)), abs=1e-14)


def test_strength_is_the_largest_leak():
    observation = CROSSTALK["map x 3x3, black"]()
    norms = [np.linalg.norm(SHARE[v].max() * COLOURED[v], 2) for v in range(2)]
    assert observation.strength == pytest.approx(max(norms))


def test_matrices_from_fewer_numbers():
    both = leak_matrices([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    assert (both[0] == np.diag([0.1, 0.2, 0.3])).all()
    assert (both[1] == np.diag([0.4, 0.5, 0.6])).all()
    assert (leak_matrices([[0.1], [0.2]]) == [0.1 * np.eye(3), 0.2 * np.eye(3)]).all()
    assert (leak_matrices([0.1, 0.2, 0.3]) == np.diag([0.1, 0.2, 0.3])).all()
    assert leak_matrices(0.1, primaries=4).shape == (2, 4, 4)
    assert (leak_matrices(COLOURED) == COLOURED).all()
    with pytest.raises(ValueError, match=r"leak_matrices takes .* got \(4,\)"):
        leak_matrices([0.1] * 4)


@pytest.mark.parametrize("convert", LIBRARIES)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_linearised_table_is_the_table_there(dtype, convert):
    exact = grey_to_grey(black=BLACK)
    at = light(6, dtype)
    at[:, 0] = LEVELS[np.random.default_rng(1).integers(0, 5, at[:, 0].shape)]
    at = convert(at)
    gap = np.asarray(exact.linearised(at).observe(at) - exact.observe(at))
    assert np.abs(gap).max() <= (1e-6 if dtype == np.float32 else 1e-15)


def test_the_linearised_table_has_its_slopes():
    """Central differences, pixel by pixel, in cells of the table (not across its knots)."""
    exact = grey_to_grey(black=BLACK)
    at = light(7)
    step = 1e-6
    assert np.abs(at[..., None] - LEVELS).min() > 2 * step
    linear = exact.linearised(at)
    for view in range(2):
        moved = np.zeros_like(at)
        moved[view] = step * (1 + light(8)[view])
        difference = (exact.observe(at + moved) - exact.observe(at - moved)) / 2
        assert np.abs(difference - linear.linear(moved)).max() <= 1e-9 * step


def test_at_the_table_s_ends_slopes_are_those_inside():
    """A white pixel can only get darker, a black one only brighter."""
    exact = grey_to_grey()
    for at, step in ((np.ones((2, ROWS, COLS, 3)), -1e-6), (np.zeros((2, ROWS, COLS, 3)), 1e-6)):
        moved = step * light(8)
        difference = exact.observe(at + moved) - exact.observe(at)
        assert np.abs(difference - exact.linearised(at).linear(moved)).max() <= 1e-5 * abs(step)


def test_a_table_is_looked_up_by_own_and_other():
    table = grey_table()
    exact = grey_to_grey(black=BLACK)
    x = np.empty((2, ROWS, COLS, 3))
    x[0], x[1] = LEVELS[1], LEVELS[3]
    seen = exact.observe(x)
    assert seen[0, 2, 3] == pytest.approx(LEVELS[1] + table[0, :, 1, 3] + BLACK[0], abs=1e-15)
    assert seen[1, 2, 3] == pytest.approx(LEVELS[3] + table[1, :, 3, 1] + BLACK[1], abs=1e-15)
    x[0] = (LEVELS[1] + LEVELS[2]) / 2
    between = (LEVELS[1] + LEVELS[2] + table[0, :, 1, 3] + table[0, :, 2, 3]) / 2
    assert exact.observe(x)[0, 2, 3] == pytest.approx(between + BLACK[0], abs=1e-15)
    assert exact.observe(x + 2)[0] == pytest.approx(x[0] + 2 + np.array(BLACK[0]), abs=1e-15)


def test_a_table_of_linear_crosstalk_is_crosstalk():
    table = np.broadcast_to(0.05 * LEVELS, (2, 3, 5, 5))
    exact = GreyToGrey(ROWS, COLS, LEVELS, table)
    x = light(2)
    assert exact.observe(x) == pytest.approx(crosstalk(0.05).observe(x), abs=1e-15)
    linear = exact.linearised(x)
    assert linear.linear(x) == pytest.approx(crosstalk(0.05).linear(x), abs=1e-15)


@pytest.mark.parametrize("name", KINDS)
def test_the_gradient_is_that_of_the_cost(name):
    """Central differences are exact for a quadratic, but for rounding."""
    observation = KINDS[name]()
    lambda_ = PerceptualWeighting(LowFrequencyFloor(0.3), padding=5)(
        viewing(), BT709, np.ones((ROWS, COLS), bool), views=2
    )
    posed = Problem(observation, lambda_, light(1), anchor=light(2), regularisation=1e-2)
    at, step = light(3), 0.1
    gradient = posed.gradient(at)
    for view, row, col, primary in np.ndindex(2, 2, 2, 3):
        towards = np.zeros_like(at)
        towards[view, 3 * row, 5 * col, primary] = step
        slope = (posed.cost(at + towards) - posed.cost(at - towards)) / (2 * step)
        assert gradient[view, 3 * row, 5 * col, primary] == pytest.approx(slope, abs=1e-11)
    towards = light(4) - light(5)
    slope = (posed.cost(at + towards) - posed.cost(at - towards)) / 2
    assert dot(gradient, towards) == pytest.approx(slope, rel=1e-11)


def test_a_colour_may_leak_as_less_than_nothing():
    observation = crosstalk(COLOURED)
    red = np.zeros((2, ROWS, COLS, 3))
    red[1, ..., 2] = 1
    assert observation.observe(red)[0].min() < 0


PERCENT = 100 * grey_table()
NAN_TABLE, LESS, DARKER = grey_table(), grey_table(), grey_table()
NAN_TABLE[0, 1, 2, 3] = np.nan
DARKER[1, 2, :, 4] = [0.3, 0.2, 0.0, 0.0, 0.0]
LESS[0, 0, 1, 2] = -0.06
STEEP = np.broadcast_to([0.0, 0.02, 0.03], (2, 1, 3, 3))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: crosstalk([[0.1], [-0.01]]),
            "to the right eye: a white .* of the left .* exchanged",
        ),
        (lambda: crosstalk(COLOURED - 0.04), "to the left eye: a white picture of the right"),
        (lambda: crosstalk([[0.9], [0.1]]), "to the left eye must be well below .* 90%"),
        (lambda: crosstalk(0.5, share=2 * SHARE), "well below the picture itself"),
        (lambda: crosstalk(np.nan), "crosstalk must be finite"),
        (lambda: crosstalk(0.1, share=SHARE - 1), "crosstalk map must be light >= 0"),
        (lambda: crosstalk(0.1, black=-0.1), "black must be light >= 0, got -0.1"),
        (lambda: GreyToGrey(5, 7, LEVELS[:-1], grey_table()[:, :, 1:, 1:]), "from 0 to 1"),
        (lambda: GreyToGrey(5, 7, LEVELS[[0, 2, 1, 3, 4]], grey_table()), "must rise"),
        (lambda: GreyToGrey(5, 7, LEVELS, NAN_TABLE), "must be finite"),
        (lambda: GreyToGrey(5, 7, LEVELS, grey_table() + 0.01), "start at 0 .* Subtract black"),
        (lambda: GreyToGrey(5, 7, LEVELS, LESS), "more light than there is"),
        (lambda: GreyToGrey(5, 7, LEVELS, DARKER), "brighter picture look brighter"),
        (lambda: GreyToGrey(5, 7, [0.0, 0.01, 1.0], STEEP), "own light than with the other's"),
        (lambda: GreyToGrey(5, 7, LEVELS, PERCENT), "well below the picture .* in percent"),
    ],
)
def test_the_impossible_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Crosstalk(5, 7, np.zeros((3, 3))), r"matrices \(2, p, p\), .* got \(3, 3\)"),
        (lambda: Crosstalk(5, 7, np.zeros((2, 3, 1))), r"got \(2, 3, 1\)"),
        (lambda: crosstalk(0.1, share=SHARE[:, :4]), r"map \(2, 5, 7\), got \(2, 4, 7\)"),
        (lambda: GreyToGrey(5, 7, LEVELS, grey_table()[:1]), r"table \(2, p, k, k\), got"),
        (lambda: GreyToGrey(5, 7, LEVELS, grey_table()[..., 1:]), "5 levels, got a table"),
        (lambda: crosstalk(0.1).observe(np.zeros((1, 5, 7, 3))), r"\(2, 5, 7, 3\), got"),
    ],
)
def test_wrong_shapes_are_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()
