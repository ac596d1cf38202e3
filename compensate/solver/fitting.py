"""Which solver fits a problem, and why: the fastest that can solve it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, final

from compensate.problem import Problem
from compensate.solver.accelerated import Accelerated
from compensate.solver.admm import ADMM, require_certifiable
from compensate.solver.kinds import Kind, kind_of
from compensate.solver.result import Result
from domesim.light import Light
from domesim.scene import Scene


class Fitting(NamedTuple):
    """A solver, and why it is the one."""

    solver: ADMM | Accelerated
    why: str


def fitting(problem: Problem) -> Fitting:
    """The fastest solver of `problem`: `ADMM`, which certifies its answer, or `Accelerated`.

    ADMM takes what Fourier diagonalises: a weighting by spatial frequency, of a dome whose
    pollution is of low rank, of a pair whose views mix pixelwise, or of both (`kinds`).
    Accelerated takes any linear observation and weighting, and stops by the KKT residual.
    """
    observation = type(problem.observation).__name__
    if kind_of(problem.observation) is Kind.OTHER:
        return Fitting(
            Accelerated(),
            f"Accelerated, as ADMM takes domes of low rank and pairs, got {observation}",
        )
    try:
        require_certifiable(problem)
    except ValueError as refusal:
        return Fitting(Accelerated(), f"Accelerated, as {refusal}")
    return Fitting(
        ADMM(),
        f"ADMM, as Fourier diagonalises {type(problem.weighting).__name__} of what "
        f"{observation} shows",
    )


@final
@dataclass(frozen=True)
class Fitted:
    """Solves by ADMM what it knows, and else by `Accelerated`, to the same gap if it has one.

    Parameters
    ----------
    known
        The solver of what it knows.
    """

    known: ADMM

    def general(self, scene: Scene) -> str:
        """Says that only the general solver takes a scene; "" where a fast one does."""
        if kind_of(scene.solvable(8, 8)) is not Kind.OTHER:
            return ""
        return (
            f"{scene.name}: no fast solver knows this composition of {scene.pollution} light; "
            f"accelerated gradients solve it, and take longer"
        )

    def __call__(self, problem: Problem, start: Light) -> Result:
        """Minimise `problem` from the light `start` (view, row, col, primary)."""
        if kind_of(problem.observation) is not Kind.OTHER:
            return self.known(problem, start)
        general = Accelerated(1e-6, gap=self.known.tolerance, progress=self.known.progress)
        return general(problem, start)
