"""Solving elsewhere than in NumPy: on a GPU, by any library of the array API.

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

_KNOWN = "cpu (NumPy), cuda or cuda:1 (PyTorch), cupy or cupy:1, torch (PyTorch on the processor)"


def on_device(solver: Solver, device: str) -> Solver:
    """A solver of problems in NumPy that works on a device.

    Parameters
    ----------
    solver
        The solver to run there.
    device
        ``cpu``: here, as it is; ``cuda`` or ``cuda:1``: a GPU, by PyTorch; ``cupy`` or ``cupy:1``:
        a GPU, by CuPy; ``torch``: the processor, by PyTorch.

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
        found = solver(there, there.anchor if at_anchor else send(start))
        return replace(found, light=on_host(found.light))

    return update_wrapper(solve, solver, assigned=(), updated=())  # for `inspect.unwrap`


def sender_to(device: str) -> Callable[[Array], Array]:
    """Returns a function that makes arrays on the device of NumPy's; see `on_device`."""
    kind, colon, number = device.partition(":")
    numbered = kind in ("cuda", "cupy") and number.isdecimal()
    if kind not in ("cuda", "cupy", "torch") or (colon and not numbered):
        raise InputError(f"--device {device}: not known; use {_KNOWN}")
    if kind == "cupy":
        return _to_cupy(device, int(number or 0))
    torch = _imported("torch", device)
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


def _to_cupy(device: str, number: int) -> Callable[[Array], Array]:
    cupy = _imported("cupy", device)
    _require_gpu(device, cupy.cuda.runtime.getDeviceCount, number)
    # CuPy computes on a thread's current device, wherever arrays are
    cupy.cuda.Device(number).use()
    return lambda array: cupy.asarray(np.asarray(array, order="C"))


def _imported(library: str, device: str) -> Any:
    try:
        return importlib.import_module(library)
    except ImportError:
        way = "pip install 'domesim[gpu]'" if library == "torch" else "pip install cupy-cuda12x"
        raise InputError(
            f"--device {device} needs {library}, which is not installed ({way}); leave --device "
            f"out to run on the processor"
        ) from None


def _require_gpu(device: str, count: Callable[[], int], number: int) -> None:
    try:
        found = count()
    except Exception:
        found = 0
    if number < found:
        return
    there = f"only {found} CUDA device(s)" if found else "no CUDA device"
    raise InputError(
        f"--device {device}: {there} found; leave --device out to run on the processor"
    )
