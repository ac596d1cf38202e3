"""What rounding leaves is nothing, and what is more is something, wherever it is."""

from __future__ import annotations

import array_api_strict
import numpy as np
import pytest

from domesim.light.rounding import ROUNDING, is_rounding


@pytest.mark.parametrize("xp", [np, array_api_strict])
@pytest.mark.parametrize("sign", [1, -1])
def test_one_sample_beyond_rounding_is_found(monkeypatch, xp, sign):
    monkeypatch.setattr("domesim.light.strips.SAMPLES", 6)
    light = np.full((2, 5, 3, 3), 0.5)
    expected = light.copy()
    light[1, 4, 2, 0] += sign * 0.9 * ROUNDING
    assert is_rounding(xp.asarray(light), xp.asarray(expected))
    light[1, 3, 1, 2] += sign * 1.1 * ROUNDING
    assert not is_rounding(xp.asarray(light), xp.asarray(expected))
    assert not is_rounding(xp.asarray(light))
    assert is_rounding(xp.asarray(0.0 * light))
