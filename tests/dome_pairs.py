"""Small 3D domes that can fail a test: uneven lens, albedos and leaks, and ambient light."""

from __future__ import annotations

import numpy as np
from pairs import COLOURED, pair
from theatres import ALBEDOS, closed_form, dome, weighting

from compensate.problem import Problem
from compensate.solver.baselines import clipped_subtraction
from domesim.observation.crosstalk import Crosstalk, leak_matrices
from domesim.observation.dome_pair import dome_pair
from domesim.observation.followed import Followed
from domesim.observation.lowrank import LowRank, LowRankObservation
from domesim.observation.spherical import ClosedFormDome


def differing(summed: ClosedFormDome, kept: float) -> LowRankObservation:
    """How the difference of the views is seen, of which each reflection keeps a share."""
    primaries = summed.shape[3]
    return ClosedFormDome(
        dome(),
        *summed.screen.shape,
        albedo=ALBEDOS[:primaries],
        lens_gain=summed.factors.direct_gain,
        kept=kept,
        primaries=primaries,
    )


def shutter(size: int, primaries: int = 3) -> Followed:
    summed = closed_form(size, primaries)
    leaks = leak_matrices([[0.04], [0.09]], primaries)
    return dome_pair(summed, summed, Crosstalk(size, size, leaks))


def spectral(size: int, primaries: int = 3) -> Followed:
    """Colours leak into others."""
    summed = closed_form(size, primaries)
    mixed = np.zeros((2, primaries, primaries))
    mixed[:, :3, :3] = COLOURED[:, :primaries, :primaries]
    return dome_pair(summed, summed, Crosstalk(size, size, mixed))


def polarised(size: int, primaries: int = 3, kept: float = -0.8) -> Followed:
    summed = closed_form(size, primaries)
    leaks = leak_matrices(0.11, primaries)
    return dome_pair(summed, differing(summed, kept), Crosstalk(size, size, leaks))


def of_modes(size: int, primaries: int = 3) -> Followed:
    """A room of two modes, of which the difference of the views keeps none but a third."""
    random, one = np.random.default_rng(5), closed_form(size, primaries)
    factors = LowRank(
        one.factors.direct_gain,
        random.random((2, size, size)) * one.screen,
        random.random((primaries, 2, 2)) / size**2,
        random.random((2, size, size)) * one.screen,
        random.random((primaries, size, size)) * one.screen,
    )
    summed = LowRankObservation(factors, one.screen)
    leaks = leak_matrices([[0.02], [0.05]], primaries)
    return dome_pair(summed, differing(one, 0.5), Crosstalk(size, size, leaks))


OBSERVATIONS = {
    "3D, shutter": shutter,
    "3D, spectral": spectral,
    "3D, polarised": polarised,
    "3D, depolarised": lambda size, primaries=3: polarised(size, primaries, 0.0),
    "3D, room of two modes": of_modes,
}


def pair_problem(
    observation: Followed, *, seed: int = 0, mu: float = 1e-3, gain: float = 0.1
) -> tuple[Problem, np.ndarray]:
    """A regularised problem of dark views, and its exact subtraction."""
    _, size, _, primaries = observation.shape
    screen = observation.first.screen
    on = np.where(screen, 1.0, 0)[None, :, :, None]
    master = pair(size, size, seed)[..., :primaries] * on
    seen = observation.direct(master)
    lambda_ = weighting(screen, primaries, gain).with_importance(np.ones(2))
    start, _ = clipped_subtraction(Problem(observation, lambda_, seen, (0.0, on)))
    bounds = (0.0, on)
    posed = Problem(observation, lambda_, seen, bounds, anchor=start, regularisation=mu)
    return posed, start
