"""What a method projects for a posed master: by exact subtraction, the aim, or a solver."""

from __future__ import annotations

from compensate.methods import Solver, require_method
from compensate.pose import Posed
from compensate.solver.result import Result, Status
from domesim.errors import InputError


def solved(posed: Posed, method: str, solver: Solver | None = None) -> Result:
    """Solves a posed master by one method.

    Parameters
    ----------
    posed
        The master in its scene.
    method
        One of `compensate.methods.METHODS`.
    solver
        The method's solver with other settings than its own.

    Returns
    -------
    result
        What to project.

    Raises
    ------
    InputError
        If the method cannot solve this problem.
    """
    if method == "perceptual" and posed.exact:
        return Result(posed.subtractive, 0.0, 0.0, Status.EXACT, 0, 0, 0.0)
    if method == "perceptual" and solver is None and (aimed := posed.aimed()) is not None:
        return Result(aimed, None, None, Status.AIMED, 0, 0)
    if method == "subtractive" and solver is None:
        return Result(posed.subtractive, None, None, Status.CLOSED_FORM, 0, 0)
    if method == "none" and solver is None:
        return Result(posed.desired, None, None, Status.CLOSED_FORM, 0, 0)
    problem = posed.problem if method == "perceptual" else posed.single
    start = posed.desired if method == "none" else posed.subtractive
    chosen = solver or require_method(method, posed.scene)(posed.scene, problem)
    try:
        return chosen(problem, start)
    except ValueError as error:
        if method == "perceptual":
            raise
        raise InputError(f"method {method!r} does not fit {posed.scene.name}: {error}") from None
