"""The compiled loops do what the strips of NumPy do."""

from __future__ import annotations

import importlib
import subprocess
import sys

import numpy as np
import pytest
from pairs import COLOURED, share
from pairs import pair as pictures
from theatres import weighting

from compensate.pose import pose
from compensate.problem import Problem
from compensate.solver.admm import ADMM, anderson, dome, fused, hessian, level, pair
from compensate.solver.baselines import clipped_subtraction
from compensate.weighting import PerceptualWeighting
from domesim.observation.crosstalk import Crosstalk, leak_matrices
from domesim.scene import load_dome
from validation.masters import night

USERS = (anderson, dome, hessian, level, pair)


@pytest.fixture
def compiled(monkeypatch):
    """Turn the compiled loops on and off."""
    pytest.importorskip("numba")
    module = importlib.import_module("compensate.solver.admm.loops")

    def turn(on):
        for user in USERS:
            monkeypatch.setattr(user, "loops", lambda *planes: module if on else None)

    return turn


def dark_pair(primaries, leak=None, share=None):
    leak = leak_matrices(0.05, primaries) if leak is None else leak
    observation = Crosstalk(40, 56, leak, share=share)
    master = (pictures(40, 56)[..., :primaries] ** 3).astype(np.float32)
    support = np.ones((40, 56), bool)
    lambda_ = weighting(support, primaries).with_importance(np.ones(2))
    anchor, _ = clipped_subtraction(Problem(observation, lambda_, master))
    return Problem(observation, lambda_, master, anchor=anchor, regularisation=1e-4), anchor


def dark_dome():
    posed = pose(night(64), load_dome("dome_imax"), PerceptualWeighting())
    return posed.problem, posed.subtractive


def dark_dome_in_3d():
    night_pair = np.concatenate([night(64), night(64, seed=1)])
    posed = pose(night_pair, load_dome("dome_stereo_polarised"), PerceptualWeighting())
    return posed.problem, posed.subtractive


PROBLEMS = {
    "pair of one": lambda: dark_pair(1),
    "pair of three": lambda: dark_pair(3),
    "pair, map": lambda: dark_pair(3, share=share(40, 56)),
    "pair, mixed": lambda: dark_pair(3, COLOURED),
    "dome": dark_dome,
    "3D dome": dark_dome_in_3d,
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_results_are_the_same(name, compiled):
    problem, start = PROBLEMS[name]()
    found = {}
    ADMM(max_iterations=1)(problem, start)  # the modes' transforms are kept from then on
    for on in (False, True):
        compiled(on)
        found[on] = ADMM(tolerance=1e-4, stop_when_invisible=False)(problem, start)
    assert found[True].iterations == found[False].iterations
    assert found[True].ffts == found[False].ffts
    # A gap of 1e-5 of the cost has some hundred roundings of it
    assert found[True].gap == pytest.approx(found[False].gap, rel=0.05)
    assert np.abs(found[True].light - found[False].light).max() <= 3e-4
    assert found[True].light.dtype == np.float32


def test_they_are_used_only_where_they_are_wanted(monkeypatch):
    monkeypatch.setenv("DOMESIM_FAST", "0")
    fused._compiled.cache_clear()
    assert fused.loops(np.zeros(3)) is None
    fused._compiled.cache_clear()


def test_the_solver_does_without_numba():
    """Importing it imports no extra."""
    code = "import sys, compensate.solver.admm; sys.exit('numba' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
