r"""What choices of several people show, when those of one person are alike.

`validation.study` takes all choices as independent. They are not: a person who likes a method likes
it again. Here a viewer is what is drawn at random, and everything is about the audience that the
viewers were drawn from.

*Share* of choices for one of a pair: w_i of viewer i's n_i choices are for it, p = sum w / sum n.
By linearisation its variance is

    v = V / (V - 1) sum (w_i - p n_i)² / (sum n)²

for V viewers; as if the choices were n_e = p (1 - p) / v independent ones [1]. The 95 % interval is
Wilson's [2] for n_e choices, with Student's quantile of V - 1 degrees of freedom, because v is an
estimate [3]. Simulated audiences choose it among others (`validation.experiments.audiences`): for
8 to 40 viewers it covers 94 to 98 %; Student's interval of the shares covers as few as 91 %.

*Whether* a pair differs: if nobody preferred anything, each viewer's d_i = 2 w_i - n_i would be as
likely the other way round. Over all 2^V ways to turn them, p is the share of ways in which the sum
of d_i is at least as far from 0 as it is. This test of sign changes [4] is exact for any number of
viewers, and needs six for p < 0.05. Pairs are corrected after Holm.

*How much*: the scale values of Bradley and Terry are those of `validation.study`; their errors are
those of viewers, by the sandwich B^-1 M B^-1 [5] with B the information of all choices and
M = V / (V - 1) sum s_i s_i' of the viewers' scores.

[1] J. N. K. Rao and A. J. Scott, J. Am. Stat. Assoc. 76, 221 (1981). [2] E. B. Wilson, J. Am.
Stat. Assoc. 22, 209 (1927). [3] E. L. Korn and B. I. Graubard, Survey Methodology 24, 193 (1998),
who take Clopper's and Pearson's interval. [4] R. A. Fisher, The Design of Experiments (1935),
section 21. [5] K.-Y. Liang and S. L. Zeger, Biometrika 73, 13 (1986).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from scipy.special import expit

from domesim.errors import InputError
from domesim.light.guarded import guarded
from validation.study import Scale, Study, analyse, holm

Counts = NDArray[np.int64]


@final
@dataclass(frozen=True)
class Preference:
    """How often an audience prefers the first of two conditions.

    Attributes
    ----------
    first, second
        Names of the conditions.
    viewers, trials, wins
        How many people chose, how often, and how often the first.
    share, low, high
        wins / trials, and the ends of its 95 % interval.
    p, adjusted
        Two-sided, of no preference; and corrected for the number of pairs after Holm.
    significant
        Whether `adjusted` is at most the study's `false_alarm`.
    """

    first: str
    second: str
    viewers: int
    trials: int
    wins: int
    share: float
    low: float
    high: float
    p: float
    adjusted: float
    significant: bool


@final
@dataclass(frozen=True)
class Audience:
    """What a study shows of the audience that its viewers were drawn from.

    Attributes
    ----------
    names
        Names of the conditions.
    preferences
        Preferences of all pairs that were compared, in the conditions' order.
    independent
        The same choices as if each were of another person, by `validation.study`.
    errors
        Standard errors of `independent.scale`'s values, of viewers; None if there is no scale, or
        one viewer.
    quantile
        Student's, which times `errors` is the half of a 95 % interval.
    """

    names: tuple[str, ...]
    preferences: tuple[Preference, ...]
    independent: Study
    errors: tuple[float, ...] | None
    quantile: float


@guarded
def audience(counts: ArrayLike, names: Sequence[str], *, false_alarm: float = 0.05) -> Audience:
    """What the choices of several viewers show.

    Parameters
    ----------
    counts
        (viewer, condition, condition) how often each viewer preferred the first to the second.
    names
        Names of the conditions. Scale values are relative to the first.
    false_alarm
        Probability of calling any pair different if none is.

    Returns
    -------
    study
        Preferences of the pairs, with intervals over viewers.

    Raises
    ------
    InputError
        If there are fewer than two viewers, and as for `validation.study.analyse`.
    Missing
        Without statsmodels.
    """
    wins = np.asarray(counts)
    if wins.ndim != 3 or len(wins) < 2:
        raise InputError(
            f"choices are (viewer, condition, condition) of 2 or more viewers, got shape "
            f"{wins.shape}; ask more people"
        )
    study = analyse(wins.sum(0), names, false_alarm=false_alarm)
    wins = wins.astype(np.int64)
    pairs = [
        (i, j)
        for i, j in combinations(range(len(names)), 2)
        if (wins[:, i, j] + wins[:, j, i]).any()
    ]
    found = [(wins[:, i, j], wins[:, i, j] + wins[:, j, i]) for i, j in pairs]
    p = [sign_changes(2 * won - trials) for won, trials in found]
    preferences = []
    for (i, j), (won, trials), one, adjusted in zip(pairs, found, p, holm(p), strict=True):
        low, high = share_interval(won, trials)
        preferences.append(
            Preference(
                names[i],
                names[j],
                viewers=int(np.count_nonzero(trials)),
                trials=int(trials.sum()),
                wins=int(won.sum()),
                share=float(won.sum() / trials.sum()),
                low=low,
                high=high,
                p=one,
                adjusted=float(adjusted),
                significant=bool(adjusted <= false_alarm),
            )
        )
    errors = None
    if isinstance(study.scale, Scale):
        errors = _errors(wins, np.array(study.scale.values))
    quantile = float(stats.t.ppf(0.975, len(wins) - 1))
    return Audience(tuple(names), tuple(preferences), study, errors, quantile)


@guarded(wins="viewer", trials="viewer")
def share_interval(wins: ArrayLike, trials: ArrayLike) -> tuple[float, float]:
    """95 % interval of an audience's share of choices (module docstring).

    Parameters
    ----------
    wins, trials
        (viewer,) choices for one condition, and all. Viewers without any are left out.

    Returns
    -------
    interval
        Its ends, 0..1.

    Raises
    ------
    InputError
        If fewer than two viewers have chosen.
    """
    won, of = np.asarray(wins, np.float64), np.asarray(trials, np.float64)
    won, of = won[of > 0], of[of > 0]
    viewers = len(of)
    if viewers < 2:
        raise InputError(f"an interval wants choices of 2 or more viewers, got {viewers}")
    share = won.sum() / of.sum()
    variance = viewers / (viewers - 1) * np.sum((won - share * of) ** 2) / of.sum() ** 2
    # All viewers the same: nothing says that their choices are alike
    alone = share * (1 - share)
    effective = alone / variance if variance > 0 and alone > 0 else of.sum()
    square = stats.t.ppf(0.975, viewers - 1) ** 2
    middle = (share + square / (2 * effective)) / (1 + square / effective)
    half = np.sqrt(square * (alone / effective + square / (4 * effective**2)))
    half /= 1 + square / effective
    return float(max(middle - half, 0)), float(min(middle + half, 1))


@guarded(differences="difference, finite")
def sign_changes(differences: ArrayLike) -> float:
    """Two-sided p of (viewer,) whole differences being as likely the other way round."""
    sizes = np.abs(np.asarray(differences, np.int64))
    found = abs(int(np.sum(differences)))
    most = int(sizes.sum())
    ways = np.zeros(2 * most + 1)  # of sums -most..most: their probabilities
    ways[most] = 1
    for size in sizes[sizes > 0]:
        ways = (np.roll(ways, size) + np.roll(ways, -size)) / 2
    sums = np.abs(np.arange(-most, most + 1))
    return float(min(ways[sums >= found].sum(), 1))


def _errors(wins: Counts, values: NDArray[np.float64]) -> tuple[float, ...]:
    """Standard errors of scale values by viewers; 0 for the first, which is the reference."""
    viewers = len(wins)
    expected = expit(values[:, None] - values[None, :])
    trials = wins + wins.transpose(0, 2, 1)
    scores = (wins - trials * expected).sum(2)[:, 1:]
    weights = trials.sum(0) * expected * (1 - expected)
    bread = np.linalg.inv((np.diag(weights.sum(1)) - weights)[1:, 1:])
    spread = viewers / (viewers - 1) * scores.T @ scores
    variance = np.diag(bread @ spread @ bread)
    return (0.0, *np.sqrt(variance).tolist())
