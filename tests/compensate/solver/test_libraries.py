"""The solver on other array libraries than NumPy: the same result, with as many transforms.

A GPU is not needed: what PyTorch does there, it does on the processor too.
"""

from __future__ import annotations

import importlib
import types

import numpy as np
import pytest
from array_libraries import OTHERS
from laws.test_linear_maps import RankTwo
from pairs import OBSERVATIONS, pair_problem
from stored_masters import store
from theatres import picture, problem, weighting

from compensate.devices import on_device
from compensate.problem import Problem
from compensate.solver.admm import ADMM
from compensate.solver.baselines import clipped_subtraction
from compensate.solver.result import Status
from domesim.errors import InputError
from domesim.light import on_host

Posed = tuple[Problem, np.ndarray]


def low_rank() -> Posed:
    """A dome with two modes of pollution."""
    observation = RankTwo(9, 3)
    master = picture(9, seed=1)
    on = observation.screen[None, :, :, None]
    bounds = (np.where(on, 0, master), np.where(on, 1, master))
    seen, lambda_ = observation.direct(master), weighting(observation.screen)
    start, _ = clipped_subtraction(Problem(observation, lambda_, seen, bounds))
    return Problem(observation, lambda_, seen, bounds, anchor=start, regularisation=1e-3), start


PROBLEMS = {
    "dome": lambda: problem(9),
    "dome, one primary": lambda: problem(9, 1),
    "dome, corrected lens": lambda: problem(9, falloff=False),
    "dome, rank two": low_rank,
    **{
        f"pair, {name}": lambda name=name: pair_problem(OBSERVATIONS[name](4, 5))
        for name in ("constant", "3x3", "map of 3x3", "linearised table", "several seats")
    },
}


def as_type(posed: Problem, start: np.ndarray, dtype: type) -> Posed:
    """It in that precision; the start stays the anchor where it is."""
    there = posed.sent(lambda array: np.asarray(array, dtype))
    return there, there.anchor if start is posed.anchor else start.astype(dtype)


def solved(make, convert, dtype, solver):
    """Anew each time: transforms are counted from 0."""
    posed, start = as_type(*make(), dtype)
    there = posed.sent(convert)
    found = solver(there, there.anchor if start is posed.anchor else convert(start))
    assert found.light.dtype == there.desired.dtype
    assert type(found.light) is type(there.desired)
    return found, posed.cost(on_host(found.light))


@pytest.mark.parametrize("convert", OTHERS)
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_same_result_with_as_many_transforms(name, convert):
    solver = ADMM(tolerance=3e-2, max_iterations=60)
    wanted, cost = solved(PROBLEMS[name], np.asarray, np.float64, solver)
    assert wanted.status is Status.CONVERGED
    found, other = solved(PROBLEMS[name], convert, np.float64, solver)
    assert np.abs(on_host(found.light) - wanted.light).max() <= 1e-10
    assert found.ffts == wanted.ffts
    assert found.iterations == wanted.iterations
    assert found.status is wanted.status
    assert found.gap == pytest.approx(wanted.gap, rel=1e-6)
    assert found.optimality == pytest.approx(wanted.optimality, rel=1e-6, abs=1e-12)
    assert other == pytest.approx(cost, rel=1e-10)


@pytest.mark.parametrize("name", ["linearised table", "several seats", "constant"])
def test_a_device_gets_the_problem_and_numpy_gets_the_light(name):
    pytest.importorskip("torch")
    solver = ADMM()
    posed, start = pair_problem(OBSERVATIONS[name](5, 6))
    wanted = solver(posed, start)
    posed, start = pair_problem(OBSERVATIONS[name](5, 6))
    found = on_device(solver, "torch")(posed, start)
    assert isinstance(found.light, np.ndarray)
    assert np.abs(found.light - wanted.light).max() <= 1e-10
    assert found.ffts == wanted.ffts
    assert found.status is wanted.status


def test_the_processor_is_left_alone():
    solver = ADMM()
    assert on_device(solver, "cpu") is solver


def without(monkeypatch, name: str) -> None:
    real = importlib.import_module

    def imported(asked: str, *rest: str):
        if asked == name:
            raise ImportError(asked)
        return real(asked, *rest)

    monkeypatch.setattr(importlib, "import_module", imported)


def pretend(monkeypatch, name: str, library: object) -> None:
    real = importlib.import_module
    monkeypatch.setattr(
        importlib, "import_module", lambda asked, *rest: library if asked == name else real(asked)
    )


def test_a_library_that_is_not_installed(monkeypatch):
    without(monkeypatch, "torch")
    wanted = (
        r"--device cuda needs torch, which is not installed.*pip install 'domesim\[gpu\]'.*"
        "leave --device out"
    )
    with pytest.raises(InputError, match=wanted):
        on_device(ADMM(), "cuda")


@pytest.mark.parametrize(
    ("device", "count", "found"),
    [
        ("cuda", 0, "no CUDA device"),
        ("cuda:2", 2, r"only 2 CUDA device\(s\)"),
        ("cuda", None, "no CUDA device"),
    ],
)
def test_a_gpu_that_is_not_there(device, count, found, monkeypatch):
    def counted() -> int:
        if count is None:
            raise RuntimeError("CUDA driver version is insufficient")
        return count

    pretend(
        monkeypatch,
        "torch",
        types.SimpleNamespace(cuda=types.SimpleNamespace(device_count=counted)),
    )
    with pytest.raises(InputError, match=rf"{device}: {found} found; leave --device out"):
        on_device(ADMM(), device)


@pytest.mark.parametrize("device", ["gpu", "cuda:", "cuda:x", "torch:0", ""])
def test_a_device_that_is_not_known(device):
    with pytest.raises(InputError, match=f"--device {device}: not known; use cpu"):
        on_device(ADMM(), device)


def test_the_command_says_so_before_it_works(tmp_path, monkeypatch, run):
    without(monkeypatch, "torch")
    master, out = tmp_path / "master.png", tmp_path / "out"
    store(master, kind="uint8")
    how = ("--scene", "dome_imax", "--weighting", "paper", "--device", "cuda", "--out", out)
    run("compensate", master, *how).is_refused("--device cuda needs torch")
    assert not out.exists()
