"""How many modes patterns can tell: leave-patterns-out cross-validation.

A pattern is left out, a core is fitted to the others, and what it foretells of the one left out is
compared with its photograph. As patterns add up, others are left out with it as long as it is a sum
of those that remain: a half and the other half would tell white without any modes.

Modes are those functions that carry the whole core best, for all primaries together. With few of
them details of the room are lost; with many, what is foretold is no better. The fewest are taken
that foretell as well as the best do, within the standard error of the difference over patterns [1].

What is foretold wrongly beyond noise, in relation to what the core's own covariance allows, also
tells whether that covariance can be believed.

[1] T. Hastie, R. Tibshirani, J. Friedman, *The Elements of Statistical Learning*, 2nd ed., Springer
2009, section 7.10.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.light.ties import ascending
from domesim.measure.dome.reflected import Core, fitted, foretold
from domesim.measure.dome.responses import Responses

Floats = NDArray[np.float64]

HIGHEST = 12
"""Most modes that are tried."""
FEWEST = 4
"""Modes that patterns should be able to tell: measured rooms had 3 to 7."""
NEGLIGIBLE = 1e-3
"""Relative error of reflected light that nobody sees."""
_SUM = 0.02
"""Rms over the screen's places within which a pattern is a sum of others."""


@final
@dataclass(frozen=True, eq=False)
class Ranks:
    """What cross-validation says.

    Attributes
    ----------
    error
        (rank,) rms error of the reflected light of patterns left out, relative to it, from rank 1.
    rank
        The one to take.
    patterns
        How many patterns were left out, each once.
    widening
        Standard errors of the core are too small by this factor; 1 if they are not.
    """

    error: Floats
    rank: int
    patterns: int
    widening: float

    @property
    def exhausted(self) -> bool:
        """Whether more patterns would tell more, or could."""
        if len(self.error) < FEWEST:
            return True
        gained = self.error[-2] - self.error[-1]
        return self.rank == len(self.error) and bool(gained > NEGLIGIBLE)


def modes_of(cores: Sequence[Floats]) -> Floats:
    """(function, function) orthonormal: modes, the strongest first, as sums of functions.

    Signs of modes do not show, as modes stand on both sides of a core.
    """
    square = sum(core @ core.T + core.T @ core for core in cores)
    return np.asarray(np.linalg.eigh(square)[1][:, ::-1])


def reduced(core: Floats, modes: Floats) -> Floats:
    """(function, function): what modes (function, mode) carry of a core."""
    inside = modes @ modes.T
    return np.asarray(inside @ core @ inside)


def cross_validated(responses: Responses, cores: Sequence[Core]) -> Ranks | None:
    """Which rank foretells photographs of other patterns best; None if none can be left out.

    Parameters
    ----------
    responses
        What places show.
    cores
        (primary,) fitted to all.
    """
    folds = [
        (pattern, kept)
        for pattern in np.unique(responses.pattern)
        if responses.excitation[responses.pattern == pattern].any()
        and _independent(responses.only(kept := independent_of(responses, int(pattern)))) >= 2
    ]
    if not folds:
        return None
    highest = min(HIGHEST, *(_independent(responses.only(kept)) for _, kept in folds))
    lost = np.zeros((len(folds), highest))
    light, allowed, excess = np.zeros(len(folds)), 0.0, 0.0
    for number, (pattern, kept) in enumerate(folds):
        others = responses.only(kept)
        fits = [fitted(others, p, core.expectation, core.core) for p, core in enumerate(cores)]
        modes = modes_of([each.core for each in fits])
        for shot in np.flatnonzero(responses.pattern == pattern):
            for p, each in enumerate(fits):
                for rank in range(1, highest + 1):
                    part = reduced(each.core, modes[:, :rank])
                    predicted = foretold(responses, p, kept, each.counted, part, int(shot))
                    weight = predicted.counted / predicted.variance
                    lost[number, rank - 1] += np.sum(weight * predicted.off**2 - predicted.counted)
                predicted = foretold(responses, p, kept, each.counted, each.core, int(shot))
                weight = predicted.counted / predicted.variance
                light[number] += np.sum(weight * predicted.reflected**2)
                excess += float(np.sum(weight * predicted.off**2 - predicted.counted))
                allowed += float(weight @ _claimed(responses, each, p, int(shot)))
    shares = lost / light.sum()
    total = shares.sum(0)
    best = int(ascending(total)[0])
    worse = shares - shares[:, [best]]
    margin = np.sqrt(len(folds)) * worse.std(0, ddof=1) if len(folds) > 1 else np.zeros(highest)
    rank = int(np.argmax(total - total[best] <= margin)) + 1
    return Ranks(
        error=np.sqrt(np.maximum(total, 0.0)),
        rank=rank,
        patterns=len(folds),
        widening=float(np.sqrt(max(1.0, excess / allowed))),
    )


def _claimed(responses: Responses, found: Core, primary: int, photograph: int) -> Floats:
    """(place,) variance of the reflected light that a core's covariance claims."""
    excitation = responses.excitation[photograph, primary]
    count = len(excitation)
    carried = found.uncertainty.of(np.eye(count)[:, :, None] * excitation)
    return np.asarray(np.sum(responses.functions * (carried @ responses.functions), 0))


def independent_of(responses: Responses, pattern: int) -> NDArray[np.bool_]:
    """(photograph,) bool: those from which a pattern cannot be added up.

    Of patterns that have the same share in the sum, the one with the lowest index is left out.
    """
    numbers, first, shown = np.unique(responses.pattern, return_index=True, return_inverse=True)
    light = responses.direct[first].transpose(0, 2, 1).reshape(len(numbers), -1)
    own = light[np.searchsorted(numbers, pattern)]
    kept = np.asarray(numbers != pattern)
    while kept.any():
        share, *_ = np.linalg.lstsq(light[kept].T, own)
        if np.sqrt(np.mean((own - share @ light[kept]) ** 2)) > _SUM * np.sqrt(np.mean(own**2)):
            break
        kept[np.flatnonzero(kept)[ascending(-np.abs(share))[0]]] = False
    return np.asarray(kept[shown])


def _independent(responses: Responses) -> int:
    """How many patterns differ in what they excite; of sums, rounding leaves 1e-16."""
    if not len(responses.pattern):
        return 0
    return int(np.linalg.matrix_rank(responses.excitation.mean(1), tol=1e-3))
