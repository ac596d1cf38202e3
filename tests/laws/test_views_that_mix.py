"""Crosstalk of many views: its laws, exact subtraction, and that two of them are a pair."""

from __future__ import annotations

import numpy as np
import pytest
from array_libraries import LIBRARIES
from laws.test_crosstalk_laws import BLACK, COLOURED
from laws.test_linear_maps import assert_affine

from compensate.subtract import subtracted
from domesim.errors import InputError
from domesim.observation.crosstalk import Crosstalk, leak_matrices, leaks_of_views

VIEWS, ROWS, COLS = 5, 4, 7
RANDOM = np.random.default_rng(3)
SHARES = RANDOM.uniform(0, 0.15, (3, VIEWS, VIEWS))
"""(primary, view, view): the matrix is uneven, and its diagonal is not read."""
PLACES = RANDOM.uniform(0.5, 1.5, (VIEWS, ROWS, COLS))
DARK = RANDOM.uniform(0, 0.01, (VIEWS, 3))
OWN = np.array(SHARES)
OWN[:, range(VIEWS), range(VIEWS)] = 0


def views(**options) -> Crosstalk:
    return Crosstalk(ROWS, COLS, leaks_of_views(SHARES), **options)


KINDS = {
    "everywhere": views,
    "by place": lambda: views(share=PLACES),
    "by place, with black": lambda: views(share=PLACES, black=DARK),
}


def light(seed: int, dtype=np.float64) -> np.ndarray:
    return np.random.default_rng(seed).random((VIEWS, ROWS, COLS, 3)).astype(dtype)


def by_hand(x: np.ndarray, share=1.0, black=0.0) -> np.ndarray:
    """Written here anew: each primary of each view by a sum over views."""
    seen = np.array(x, np.float64)
    for v, u, p in np.ndindex(VIEWS, VIEWS, 3):
        seen[v, ..., p] += np.broadcast_to(share, PLACES.shape)[v] * OWN[p, v, u] * x[u, ..., p]
    return seen + np.broadcast_to(black, (VIEWS, 3))[:, None, None]


@pytest.mark.parametrize("convert", LIBRARIES)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", KINDS)
def test_many_views_are_affine_with_an_adjoint(name, dtype, convert):
    random = np.random.default_rng(2)
    shape = (VIEWS, ROWS, COLS, 3)
    x, z, y = (convert(random.standard_normal(shape).astype(dtype)) for _ in range(3))
    tolerance = 1e-6 if dtype == np.float32 else 1e-13
    assert_affine(KINDS[name](), x, z, y, tolerance)


def test_what_is_seen_by_hand():
    x = light(1)
    assert views().observe(x) == pytest.approx(by_hand(x), abs=1e-14)
    found = KINDS["by place, with black"]().observe(x)
    assert found == pytest.approx(by_hand(x, PLACES, DARK), abs=1e-14)


@pytest.mark.parametrize("name", KINDS)
def test_subtraction_undoes_what_can_be_undone(name):
    observation = KINDS[name]()
    x = 0.2 + 0.6 * light(4)
    found, _ = subtracted(observation, observation.observe(x))
    assert found == pytest.approx(x, abs=1e-13)


def test_where_light_is_missing_each_view_does_what_it_can():
    """The one x = clip(wanted - what is seen of the others): no view wastes light."""
    observation, wanted = KINDS["by place, with black"](), light(5) ** 4
    found, _ = subtracted(observation, wanted)
    needed = wanted - (by_hand(found, PLACES, DARK) - found)
    assert (found == 0).mean() > 0.1
    assert found == pytest.approx(np.clip(needed, 0, 1), abs=1e-13)


@pytest.mark.parametrize("share", [None, PLACES[:2]])
def test_two_of_many_views_are_a_pair(share):
    pair = Crosstalk(ROWS, COLS, leak_matrices(COLOURED), share=share, black=BLACK)
    leaks = np.zeros((2, 3, 2, 3))
    leaks[0, :, 1], leaks[1, :, 0] = COLOURED
    two = Crosstalk(ROWS, COLS, leaks, share=share, black=BLACK)
    x = light(6)[:2]
    assert (two.matrices == COLOURED).all()
    for seen in ("observe", "linear", "adjoint"):
        assert getattr(two, seen)(x) == pytest.approx(getattr(pair, seen)(x), abs=1e-15)
    expected = np.ones((2, 1, 1)) if share is None else share
    by_pair = x + expected[..., None] * np.einsum("vpq,vijq->vijp", COLOURED, x[::-1])
    assert two.observe(x) == pytest.approx(by_pair + np.reshape(BLACK, (2, 1, 1, 3)), abs=1e-15)
    assert two.strength == pytest.approx(pair.strength, abs=1e-15)


def test_a_view_that_nobody_leaks_to_sees_itself():
    alone = np.array(SHARES)
    alone[:, 2] = 0
    x = light(7)
    seen = Crosstalk(ROWS, COLS, leaks_of_views(alone)).observe(x)
    assert (seen[2] == x[2]).all()
    assert (seen[1] > x[1]).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: leaks_of_views(SHARES[0, 0]), r"shares \(view, view\), got \(5,\)"),
        (lambda: leaks_of_views(SHARES[:2]), "3 primaries, got 2"),
        (lambda: Crosstalk(4, 7, np.zeros((5, 3, 4, 3))), r"\(n, p, n, p\) of n views"),
        (lambda: views(share=PLACES[:2]), r"map \(5, 4, 7\), got \(2, 4, 7\)"),
        (lambda: views(black=DARK[:2]), r"shape \(5, 3\), got \(2, 3\)"),
        (lambda: Crosstalk(4, 7, np.eye(15).reshape(5, 3, 5, 3) / 9), "view 1 to itself must be 0"),
        (lambda: Crosstalk(4, 7, leaks_of_views(-SHARES)), "white picture of the view"),
        (lambda: Crosstalk(4, 7, leaks_of_views(np.ones((5, 5)))), "view 1 must be well below"),
        (lambda: Crosstalk(4, 7, leaks_of_views(_beside(9, 0.55))), "9 views cannot be undone"),
    ],
)
def test_the_impossible_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def _beside(count: int, share: float) -> np.ndarray:
    return share * (np.eye(count, k=1) + np.eye(count, k=-1))
