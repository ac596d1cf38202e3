"""Which solver fits a problem, and why: the fastest that can solve it."""

from __future__ import annotations

from typing import NamedTuple

from compensate.problem import Problem
from compensate.solver.accelerated import Accelerated
from compensate.solver.admm import ADMM, require_certifiable
from compensate.solver.dome_pairs import parts_of
from domesim.observation.lowrank import LowRankObservation
from domesim.observation.stereo import StereoObservation


class Fitting(NamedTuple):
    """A solver, and why it is the one."""

    solver: ADMM | Accelerated
    why: str


def fitting(problem: Problem) -> Fitting:
    """The fastest solver of `problem`: `ADMM`, which certifies its answer, or `Accelerated`.

    ADMM takes what Fourier diagonalises: a weighting by spatial frequency, of a dome whose
    pollution is of low rank, of a pair whose views mix pixelwise, or of both. Accelerated takes any
    linear observation and weighting, and stops by the KKT residual.
    """
    observation = type(problem.observation).__name__
    known = isinstance(problem.observation, LowRankObservation | StereoObservation)
    if not known and parts_of(problem.observation) is None:
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
