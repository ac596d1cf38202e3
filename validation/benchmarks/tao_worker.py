"""PETSc/TAO in a process of its own, which asks its parent for costs and gradients.

``python3 tao_worker.py METHOD VALUES FILE ITERATIONS``: runs on the system's Python, without
domesim. FILE maps five float64 vectors of VALUES: start and answer, lower bound, upper bound, what
is asked about, what is answered. Each line on standard output says one thing:

    ready       PETSc has been loaded
    quadratic   the cost at the fourth vector (the answering line) and the gradient (the fifth)
    product     the Hessian times the fourth vector (the fifth)
    done        nothing more: the first vector is TAO's answer
"""

from __future__ import annotations

import glob
import importlib
import sys
from typing import Any

import numpy as np

# Where Debian puts it; its own path file looks where only the development package links to.
DEBIAN = "/usr/lib/petscdir/petsc*/*-real/lib/python3/dist-packages"


def petsc() -> Any:
    """PETSc, set up for a Hessian without a matrix: faces of the box are masked in its products."""
    sys.path += sorted(glob.glob(DEBIAN))  # noqa: PTH207 - a pattern of a whole path
    options = "-ksp_max_it 10 -pc_type none -tao_subset_type matrixfree"
    importlib.import_module("petsc4py").init(options.split())
    return importlib.import_module("petsc4py.PETSc")


def main(method: str, values: int, path: str, iterations: int) -> None:
    """Minimise, from the mapped vectors."""
    library = petsc()
    print("ready", flush=True)
    vectors = np.memmap(path, np.float64, "r+", shape=(5, values))
    answer, lower, upper, question, reply = vectors

    def ask(what: str, about: Any) -> str:
        question[:] = about.getArray(readonly=True)
        print(what, flush=True)
        return sys.stdin.readline()

    def quadratic(tao: Any, point: Any, gradient: Any) -> float:
        cost = float(ask("quadratic", point))
        gradient.setArray(reply)
        return cost

    class Hessian:
        def mult(self, matrix: Any, direction: Any, product: Any) -> None:
            ask("product", direction)
            product.setArray(reply)

    def vector(given: Any) -> Any:
        return library.Vec().createWithArray(np.array(given), comm=library.COMM_SELF)

    tao = library.TAO().create(comm=library.COMM_SELF)
    tao.setType(method)
    hessian = library.Mat().createPython([values, values], Hessian(), comm=library.COMM_SELF)
    hessian.setUp()
    tao.setObjectiveGradient(quadratic, None)
    tao.setHessian(lambda tao, point, matrix, preconditioner: None, hessian)
    tao.setVariableBounds((vector(lower), vector(upper)))
    tao.setMaximumIterations(iterations)
    tao.setTolerances(gatol=0.0, grtol=1e-9, gttol=0.0)
    tao.setFromOptions()
    solution = vector(answer)
    tao.solve(solution)
    answer[:] = solution.getArray(readonly=True)
    print("done", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
