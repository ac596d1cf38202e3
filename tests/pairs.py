"""Small stereo pairs that can fail a test: left differs from right, and each direction's leak."""

from __future__ import annotations

import numpy as np
from theatres import picture, weighting

from compensate.problem import Problem
from compensate.weighting import CsfWeighting
from domesim.observation.crosstalk import Crosstalk, leak_matrices
from domesim.observation.grey_to_grey import GreyToGrey
from domesim.observation.seats import SeveralSeats
from domesim.observation.stereo import StereoObservation

COLOURED = np.array(
    [
        [[0.06, 0.01, 0.0], [0.004, 0.05, -0.002], [0.0, 0.02, 0.08]],
        [[0.03, 0.0, 0.01], [0.0, 0.07, 0.006], [-0.003, 0.01, 0.04]],
    ]
)


def pair(rows: int, cols: int, seed: int = 0, dtype: type = np.float64) -> np.ndarray:
    """Dark views with bright patches in different places."""
    size = max(rows, cols)
    views = [picture(size, seed=seed + k, dtype=dtype)[:, :rows, :cols] for k in (0, 100)]
    return np.concatenate(views)


def share(rows: int, cols: int) -> np.ndarray:
    """A map that rises off the middle, more for the left eye on the left."""
    row, col = np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : cols * 1j]
    return np.stack([1 + 0.5 * (col - 0.3) ** 2 + 0.2 * row**2, 1.1 + 0.4 * col**2])


def table(primaries: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Levels, and a grey-to-grey table that no product of its sides could be."""
    levels = np.array([0.0, 0.1, 0.3, 0.6, 1.0])
    own, other = levels[:, None], levels[None, :]
    leak = (0.08 * other - 0.03 * own) * (1 + 0.5 * np.abs(other - own)) + 0.02 * own * other
    scale = np.array([1.0, 0.7])[:, None] * np.linspace(1, 0.6, primaries)
    return levels, scale[:, :, None, None] * leak


def grey(rows: int, cols: int) -> GreyToGrey:
    levels, entries = table()
    return GreyToGrey(rows, cols, levels, entries, black=[[0.001] * 3, [0.002] * 3])


OBSERVATIONS = {
    "constant": lambda r, c: Crosstalk(r, c, leak_matrices(0.05), black=0.002),
    "by direction": lambda r, c: Crosstalk(r, c, leak_matrices([[0.02], [0.07]])),
    "by primary": lambda r, c: Crosstalk(r, c, leak_matrices([0.03, 0.05, 0.1])),
    "3x3": lambda r, c: Crosstalk(r, c, COLOURED, black=[[0.001] * 3, [0.0, 0.002, 0.003]]),
    "map": lambda r, c: Crosstalk(r, c, leak_matrices(0.05), share=share(r, c)),
    "map of 3x3": lambda r, c: Crosstalk(r, c, COLOURED, share=share(r, c), black=0.001),
    "linearised table": lambda r, c: grey(r, c).linearised(pair(r, c, seed=9)),
    "several seats": lambda r, c: SeveralSeats(
        [
            Crosstalk(r, c, leak_matrices(0.03), black=0.001),
            Crosstalk(r, c, COLOURED, share=share(r, c)),
            Crosstalk(r, c, leak_matrices([[0.06], [0.02]])),
        ]
    ),
}


def two_views(
    rows: int, cols: int, gain: float = 0.1, importance: np.ndarray | None = None
) -> CsfWeighting:
    """The weighting of a pair, or of as many views as there are importances."""
    one = weighting(np.ones((rows, cols), bool), gain=gain)
    return one.with_importance(np.ones(2) if importance is None else importance)


def pair_problem(
    observation: StereoObservation, *, seed: int = 0, mu: float = 1e-3, gain: float = 0.1
) -> tuple[Problem, np.ndarray]:
    """A regularised problem, and a feasible start: the master, with a little less light."""
    _, rows, cols, _ = observation.shape
    master = pair(rows, cols, seed)
    seen = observation.direct(master)
    importance = np.linspace(1, 0.4, len(seen)) if len(seen) > 2 else None
    lambda_ = two_views(rows, cols, gain, importance)
    start = np.clip(master - 0.03 * master[::-1], 0, 1)
    problem = Problem(observation, lambda_, seen, anchor=start, regularisation=mu)
    return problem, start
