"""Solving elsewhere than in NumPy: on a GPU, by PyTorch.

A solver computes with the library of the arrays it is given (`domesim.light.namespace`). So a
problem's arrays go to the device, and the light that is found comes back: nothing else differs.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace
from functools import update_wrapper
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensate.methods import Solver
from compensate.problem import Problem
from compensate.solver.result import Result
from domesim.errors import InputError
from domesim.light import Array, Light, namespace, on_host

CPU = "cpu"
"""NumPy, which needs nothing else."""

_KNOWN = "cpu (NumPy), or cuda or cuda:1 (PyTorch on a GPU)"


def on_device(solver: Solver, device: str) -> Solver:
    """Makes a solver that works on a device of a solver of problems in NumPy.

    Parameters
    ----------
    solver
        The solver to run there.
    device
        ``cpu``: here, as it is; ``cuda`` or ``cuda:1``: a GPU, by PyTorch; ``torch``: the
        processor, by PyTorch, for tests without a GPU.

    Raises
    ------
    InputError
        If the name is not known, the library is not installed, or there is no such GPU.
    """
    if device == CPU:
        return solver
    send = sender_to(device)

    def solve(problem: Problem, start: Light) -> Result:
        there = problem.sent(send)
        # Solvers know their own start again by its being the anchor
        at_anchor = start is problem.anchor
        result = solver(there, there.anchor if at_anchor else send(start))
        return replace(result, light=on_host(result.light))

    return update_wrapper(solve, solver, assigned=(), updated=())  # for `inspect.unwrap`


def sender_to(device: str) -> Callable[[Array], Array]:
    """Returns a function that makes arrays on the device of NumPy's; see `on_device`."""
    kind, colon, number = device.partition(":")
    numbered = kind == "cuda" and number.isdecimal()
    if kind not in ("cuda", "torch") or (colon and not numbered):
        raise InputError(f"--device {device}: not known; use {_KNOWN}")
    torch = _torch(device)
    if kind == "torch":
        return lambda array: torch.tensor(np.asarray(array, order="C"))
    _require_gpu(device, torch.cuda.device_count, int(number or 0))
    return lambda array: torch.tensor(np.asarray(array, order="C")).pin_memory().to(device)


def fetched(array: Array) -> NDArray[Any]:
    """`array` as NumPy's, like `on_host`, but three times as fast from a GPU again and again.

    PyTorch keeps memory that a GPU writes to by itself for the next time.
    """
    if not getattr(array, "is_cuda", False):
        return on_host(array)
    host = namespace(array).empty(array.shape, dtype=array.dtype, pin_memory=True)
    return np.asarray(host.copy_(array))


def _torch(device: str) -> Any:
    try:
        return importlib.import_module("torch")
    except ImportError:
        raise InputError(
            f"--device {device} needs torch, which is not installed (pip install 'domesim[gpu]'); "
            f"leave --device out to run on the processor"
        ) from None


def _require_gpu(device: str, count: Callable[[], int], number: int) -> None:
    try:
        devices = count()
    except Exception:
        devices = 0
    if number < devices:
        return
    there = f"only {devices} CUDA device(s)" if devices else "no CUDA device"
    raise InputError(
        f"--device {device}: {there} found; leave --device out to run on the processor"
    )
