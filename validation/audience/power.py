"""How many viewers are enough, by simulated audiences.

One method, the best, is chosen over each other one in the given share of choices; the others are
equal. People differ: each viewer has scale values of their own, and the log-odds of a pair have the
standard deviation `spread` over viewers. The mean log-odds are such that the share over all people
is the one that was given. A study succeeds if the best is significantly preferred to *all* others,
by the test of `inference`, corrected after Holm.

How much people differ is not known before the first study; the paper does not print it. Look at
several spreads: at 0 all people are alike, at 1 and a share of 0.6 one in three prefers the other.
"""

from __future__ import annotations

from itertools import combinations
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import expit

from domesim.errors import InputError
from validation.audience.inference import sign_changes
from validation.experiment import Record
from validation.study import holm

FALSE_ALARM = 0.05
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(61)


@final
class Situation(Record):
    """What is assumed of an audience and a study.

    Attributes
    ----------
    share
        Share of choices of the whole population for the best method over each other one.
    spread
        Standard deviation over viewers of the log-odds of a pair.
    methods
        How many are compared.
    each
        Choices of each viewer for each pair of methods: masters times repeats.
    """

    share: float
    spread: float
    methods: int
    each: int

    def log_odds(self) -> float:
        """Mean log-odds of the best over each other that give `share`."""
        return float(brentq(lambda mean: self._share(mean) - self.share, -30, 30))

    def _share(self, mean: float) -> float:
        weights = _WEIGHTS / _WEIGHTS.sum()
        return float(weights @ expit(mean + self.spread * _NODES))

    def require(self) -> None:
        """See that it is possible.

        Raises
        ------
        InputError
            If it is not.
        """
        if not 0.5 <= self.share < 1:
            raise InputError(f"--share is from 0.5 to below 1, got {self.share:g}")
        if not 0 <= self.spread <= 5:
            raise InputError(f"--spread is from 0 to 5 log-odds, got {self.spread:g}")
        if self.methods < 2 or self.each < 1:
            raise InputError(
                f"a study wants 2 methods and 1 choice of each pair, got {self.methods} and "
                f"{self.each}"
            )


def simulated(
    situation: Situation, viewers: int, audiences: int, random: np.random.Generator
) -> NDArray[np.int64]:
    """Simulates the choices of audiences whose best method is the first.

    Parameters
    ----------
    situation
        What is assumed.
    viewers, audiences
        Viewers of an audience, and number of audiences.
    random
        Source of random numbers.

    Returns
    -------
    choices
        (audience, viewer, method, method) how often the first was preferred to the second.
    """
    scale = np.zeros(situation.methods)
    scale[0] = situation.log_odds()
    own = situation.spread / np.sqrt(2) * random.standard_normal((audiences, viewers, len(scale)))
    own += scale
    counts = np.zeros((audiences, viewers, len(scale), len(scale)), np.int64)
    for i, j in combinations(range(len(scale)), 2):
        won = random.binomial(situation.each, expit(own[..., i] - own[..., j]))
        counts[..., i, j], counts[..., j, i] = won, situation.each - won
    return counts


def power(situation: Situation, viewers: int, *, audiences: int = 1000, seed: int = 0) -> float:
    """Share of simulated studies that succeed.

    Parameters
    ----------
    situation
        What is assumed.
    viewers
        How many there are.
    audiences, seed
        How many are simulated, and the seed of their random numbers.

    Returns
    -------
    power
        Share of studies that prove the best method better than each other, 0..1.

    Raises
    ------
    InputError
        If the situation is impossible, or there are fewer than two viewers.
    """
    situation.require()
    if viewers < 2:
        raise InputError(f"--viewers are 2 or more, got {viewers}")
    random = np.random.default_rng([seed, viewers])
    counts = simulated(situation, viewers, audiences, random)
    pairs = list(combinations(range(situation.methods), 2))
    # The best is in the first pairs
    best = [k for k, pair in enumerate(pairs) if pair[0] == 0]
    p = np.empty((audiences, len(pairs)))
    won = np.empty_like(p)
    for k, (i, j) in enumerate(pairs):
        differences = counts[..., i, j] - counts[..., j, i]
        won[:, k] = differences.sum(1)
        p[:, k] = [sign_changes(each) for each in differences]
    succeeded = (holm(p) <= FALSE_ALARM) & (won > 0)
    return float(np.mean(succeeded[:, best].all(1)))
