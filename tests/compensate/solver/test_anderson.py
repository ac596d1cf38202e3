"""Anderson acceleration: what it solves exactly, and what short planes lose."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from compensate.solver.admm.anderson import Anderson, Short

RATES = (0.5, 0.1, 0.02)


@pytest.fixture(params=["plain", "compiled"])
def loops(request, monkeypatch):
    module = None
    if request.param == "compiled":
        pytest.importorskip("numba")
        module = importlib.import_module("compensate.solver.admm.loops")
    monkeypatch.setattr("compensate.solver.admm.anderson.loops", lambda *planes: module)


def distances(dtype, memory: int, steps: int) -> list[float]:
    """How far s <- s + rate (aim - s) of planes of different rates is from where it leads."""
    random = np.random.default_rng(0)
    aims = [random.normal(size=(13, 18)).astype(dtype) for _ in RATES]
    s = [np.zeros_like(aim) for aim in aims]
    anderson = Anderson(memory, [1.0, 1.0, 1.0])
    found = []
    for _ in range(steps):
        found.append(max(float(np.abs(p - aim).max()) for p, aim in zip(s, aims, strict=True)))
        residual = [dtype(rate) * (aim - p) for p, aim, rate in zip(s, aims, RATES, strict=True)]
        point = [p + r for p, r in zip(s, residual, strict=True)]
        s = anderson.next(point, residual)
    return found


def test_as_many_points_as_there_are_rates_are_enough():
    """With three rates, three old points cancel all of the residual (Walker & Ni, theorem 2.2)."""
    assert distances(np.float64, 0, 8)[-1] > 0.5
    assert distances(np.float64, 3, 8)[-1] < 1e-7


def test_a_lower_penalty_does_not_make_what_was_found_look_better():
    """The solver takes the energy for a sign of its gap, which is as it was."""
    anderson = Anderson(2, [1.0])
    residual = np.ones((8, 8))
    anderson.next([residual.copy()], [residual])
    assert anderson.energy == 64
    anderson.reweigh([0.25])
    assert anderson.energy == 64
    anderson.next([residual.copy()], [residual])
    assert anderson.energy == 16


@pytest.mark.parametrize("memory", [2, 3])
def test_short_points_do_as_well(memory, loops):
    exact, short = (distances(dtype, memory, 12) for dtype in (np.float64, np.float32))
    assert short[5] == pytest.approx(exact[5], abs=2e-3)
    assert short[-1] < 2e-3


def test_a_short_plane_is_within_half_a_code_of_its_rows_largest():
    random = np.random.default_rng(1)
    plane = (random.normal(size=(30, 40)) * 10.0 ** random.integers(-6, 3, (30, 1))).astype("f4")
    plane[3] = 0
    short = Short(plane.shape)
    short[:20, :], short[20:, :] = plane[:20], plane[20:]
    assert short.codes.nbytes == plane.nbytes / 2
    found, largest = short.rows(slice(None)), np.abs(plane).max(axis=1, keepdims=True)
    assert found.dtype == np.float32
    assert np.all(np.abs(found - plane) <= largest * (0.5 / 32767 + 1e-6))
    assert not found[3].any()
    assert np.allclose(short.rows(slice(4, 9), 0.5), found[4:9] / 2)
