"""Small problems as dense matrices, which reference solvers take."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from compensate.problem import Problem

Floats = NDArray[np.float64]


def dense(problem: Problem) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """The problem as 1/2 ||M v - b||² over its free values v, and which values are free."""
    shape = problem.observation.shape
    free = np.broadcast_to(problem.lower < problem.upper, shape)
    fixed = np.where(free, 0, np.broadcast_to(problem.lower, shape))
    columns, local = [], []
    root = np.sqrt(problem.regularisation)
    for index in np.argwhere(free):
        unit = np.zeros(shape)
        unit[tuple(index)] = 1
        columns.append(problem.weighting.apply(problem.observation.linear(unit)).ravel())
        local.append(root * problem.observation.local(unit).ravel())
    matrix = np.vstack([np.array(columns).T, np.array(local).T])
    offset = -problem.weighting.apply(problem.residual(fixed)).ravel()
    anchor = np.zeros(shape) if problem.anchor is None else np.asarray(problem.anchor)
    held = root * problem.observation.local(anchor - fixed).ravel()
    return matrix, np.concatenate([offset, held]), free


def bvls(problem: Problem) -> Floats:
    """The minimiser by SciPy's dense active-set method, as light."""
    matrix, offset, free = dense(problem)
    lower, upper = (np.broadcast_to(b, free.shape)[free] for b in (problem.lower, problem.upper))
    light = np.array(np.broadcast_to(problem.lower, free.shape), np.float64)
    answer = lsq_linear(matrix, offset, (lower, upper), method="bvls", tol=1e-14, max_iter=2000)
    light[free] = answer.x
    return light
