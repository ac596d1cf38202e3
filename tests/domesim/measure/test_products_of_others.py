"""Slopes of a product of factors, where one of them is 0."""

from __future__ import annotations

import numpy as np

from domesim.measure.dome.fit import _others


def test_a_factor_of_zero_leaves_all_slopes_finite():
    factors = np.random.default_rng(0).uniform(0.5, 1.5, (4, 3, 2))
    np.testing.assert_allclose(_others(factors), factors.prod(0) / factors, rtol=1e-12)
    factors[1, 0, 0] = 0
    found = _others(factors)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found[1], np.delete(factors, 1, 0).prod(0), rtol=1e-12)
    assert found[0, 0, 0] == 0
