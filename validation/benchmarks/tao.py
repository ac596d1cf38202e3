"""PETSc/TAO, where it is installed: its own process minimises, this one knows the problem.

Debian and Ubuntu have it as ``python3-petsc4py``, for their own Python; a petsc4py in ours is taken
first. Vectors go through a mapped file, so that costs, gradients and Hessian products are computed
and counted here. Munson et al., "TAO Users Manual", ANL/MCS-TM-322: GPCG is Moré and Toraldo's, as
the paper uses (objective values cost it a Hessian product each); BLMVM is Benson and Moré's
limited-memory quasi-Newton method with bounds.
"""

from __future__ import annotations

import functools
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from domesim.light import Light
from validation.benchmarks.recording import Recorder
from validation.experiment import Missing

WORKER = Path(__file__).with_name("tao_worker.py")
SYSTEM_PYTHON = "/usr/bin/python3"
_PROBE = "import runpy, sys; runpy.run_path(sys.argv[1])['petsc']()"


@functools.cache
def interpreter() -> str:
    """A Python that has petsc4py.

    Raises
    ------
    Missing
        If there is none.
    """
    for python in (sys.executable, SYSTEM_PYTHON):
        probe = [python, "-I", "-c", _PROBE, str(WORKER)]
        if (
            Path(python).exists()
            and not subprocess.run(probe, check=False, capture_output=True).returncode
        ):
            return python
    raise Missing("python3-petsc4py is not installed (apt-get install python3-petsc4py)")


def minimise_by_tao(method: str, recorder: Recorder, start: Light, iterations: int) -> Light:
    """TAO's answer, from `start`.

    Parameters
    ----------
    method
        ``gpcg`` or ``blmvm``.
    recorder
        Recorder of the problem, in float64.
    start
        Feasible light.
    iterations
        Most that TAO may do.

    Raises
    ------
    Missing
        If petsc4py is not installed.
    RuntimeError
        If TAO fails.
    """
    problem, python = recorder.problem, interpreter()
    lower, upper = (np.broadcast_to(b, start.shape) for b in (problem.lower, problem.upper))
    free = lower < upper
    values = int(np.count_nonzero(free))
    with tempfile.NamedTemporaryFile() as file:
        vectors = np.memmap(file.name, np.float64, "w+", shape=(5, values))
        answer, least, most, question, reply = vectors
        answer[:], least[:], most[:] = start[free], lower[free], upper[free]
        command = [python, "-I", str(WORKER), method, str(values), file.name, str(iterations)]
        with subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            assert process.stderr is not None
            try:
                process.stdout.readline()
                recorder.begin()
                for line in process.stdout:
                    if line.startswith("done"):
                        break
                    light = filled(start, free, question)
                    if line.startswith("quadratic"):
                        number, image = problem.quadratic(light)
                    else:
                        direction = filled(np.zeros_like(start), free, question)
                        number, image = problem.curvature(direction)
                    reply[:] = image[free]
                    # GPCG asks for products of points and of directions: all lights may count
                    if np.all((question >= least) & (question <= most)):
                        recorder.see(light.copy)
                    recorder.pay()
                    print(repr(number), file=process.stdin, flush=True)
                else:
                    said = process.stderr.read().split()
                    raise RuntimeError(f"TAO ended early: {' '.join(said)[-200:]}")
            finally:
                process.kill()
        return filled(start, free, answer)


def filled(light: Light, free: Any, values: Any) -> Light:
    """`light` with those values where it is `free`."""
    result = light.copy()
    result[free] = values
    return result
