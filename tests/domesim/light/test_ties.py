"""Order, signs and roots that rounding does not decide."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from domesim.light.ties import ascending, root_of, upright

NOISE = st.lists(st.floats(-1e-13, 1e-13), min_size=6, max_size=6).map(np.array)


@settings(deadline=None)
@given(NOISE)
def test_equal_values_stand_as_they_were_given(noise):
    values = np.array([3.0, 1.0, 3.0, 2.0, 1.0, 3.0])
    assert ascending(values + noise).tolist() == [1, 4, 3, 0, 2, 5]
    assert ascending(-values * (1 + noise)).tolist() == [0, 2, 5, 3, 1, 4]


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        ([], []),
        ([2.0, 1.0], [1, 0]),
        ([np.inf, 1.0, -np.inf, np.inf], [2, 1, 0, 3]),
        ([0.0, 0.0], [0, 1]),
        ([1e-9, 3e-9, 0.0], [2, 0, 1]),
    ],
)
def test_values_that_differ_are_sorted(values, wanted):
    assert ascending(values).tolist() == wanted


def test_what_counts_as_equal_may_be_told():
    assert ascending([1.1, 1.0], 0.2).tolist() == [0, 1]
    assert ascending([1.1, 1.0], 0.05).tolist() == [1, 0]


def turned(values, seed):
    """A covariance with these eigenvalues."""
    axes = np.linalg.qr(np.random.default_rng(seed).standard_normal((len(values),) * 2))[0]
    return (axes * values) @ axes.T


@pytest.mark.parametrize("values", [[4.0, 2.0, 1.0], [3.0, 3.0, 1.0], [2.0, 1.0, 0.0], [0.0] * 3])
def test_a_root_is_the_same_for_equal_eigenvalues(values):
    covariance = turned(np.array(values), 1)
    root = root_of(covariance)
    assert root @ root.T == pytest.approx(covariance, abs=1e-12)
    assert root == pytest.approx(root.T, abs=1e-12)
    order = np.array([2, 0, 1])
    again = root_of(covariance[np.ix_(order, order)])
    assert again == pytest.approx(root[np.ix_(order, order)], abs=1e-7)


@settings(deadline=None)
@given(NOISE.map(lambda noise: noise.reshape(3, 2)), st.tuples(*2 * [st.sampled_from((-1, 1))]))
def test_signs_are_those_of_the_first_largest_number(noise, signs):
    vectors = np.array([[-0.6, -0.1], [0.5, 0.7], [0.6, -0.7]])
    found = upright((vectors + noise) * signs)
    assert found == pytest.approx(vectors * [-1, 1], abs=1e-12)
