"""Forced-choice paired comparisons: which condition do people prefer, and how sure is that?

In each trial somebody sees two of several conditions and chooses one. Three questions, three
answers:

- Do people prefer anything at all? If not, condition i, shown in n_i trials, wins n_i / 2 of them.
  The differences d of wins have the covariance L / 4, with L the Laplacian of the graph of trials,
  so d' (L / 4)^+ d is chi-square distributed [1]. Pearson's sum of d_i² / (n_i / 2), which the
  paper uses (section 4.1), takes wins for multinomial; but of the conditions that a trial does not
  show none can win it. For t conditions, all pairs shown equally often, Pearson's statistic is
  t / (2 (t - 1)) of the other: the same for two, 3/4 for three.
- Which pairs differ? Exact binomial tests, corrected for their number after Holm [2], and intervals
  after Clopper and Pearson [3].
- How much? Scale values s after Bradley and Terry [4]: i is preferred to j with log-odds s_i - s_j.
  The likeliest values exist only if no set of conditions wins all its trials with the rest [5].

Trials count as independent. Choices of one person are more alike than that; so put fewer trials
each before more people, and do not believe p-values to their last zeros.

[1] H. A. David, The Method of Paired Comparisons (1988). [2] S. Holm, Scandinavian Journal of
Statistics 6, 65 (1979). [3] C. J. Clopper and E. S. Pearson, Biometrika 26, 404 (1934). [4] R. A.
Bradley and M. E. Terry, Biometrika 39, 324 (1952). [5] L. R. Ford, American Mathematical Monthly
64 (8), 28 (1957).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from scipy.sparse.csgraph import connected_components
from scipy.special import expit, xlogy

from domesim.errors import InputError
from domesim.light.guarded import guarded
from validation.experiment import Missing

Wins = NDArray[np.int64]
"""(condition, condition) how often the first was preferred to the second."""


@final
@dataclass(frozen=True)
class ChiSquare:
    """A test by the chi-square distribution.

    Attributes
    ----------
    statistic, freedom, p
        Its value, its degrees of freedom, and the probability of a larger one.
    """

    statistic: float
    freedom: int
    p: float


@final
@dataclass(frozen=True)
class Pair:
    """Two conditions.

    Attributes
    ----------
    first, second
        Their names.
    trials, wins
        How often they were compared, and how often the first was preferred.
    share
        wins / trials.
    low, high
        Ends of the 95 % interval of this share after Clopper and Pearson, of this pair alone.
    p, adjusted
        Two-sided, of a share of 1/2; and corrected for the number of pairs after Holm.
    significant
        Whether the corrected one is at most the study's `false_alarm`.
    """

    first: str
    second: str
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
class Scale:
    """What Bradley and Terry's model says.

    Attributes
    ----------
    values, errors
        Log-odds of each condition of being preferred to the first one, and their standard errors
        (both 0 for the first itself). For differences from another condition, name that one first.
    misfit
        Likelihood-ratio test of the model, which cannot say that A beats B beats C beats A. None if
        there are no more pairs than values.
    """

    values: tuple[float, ...]
    errors: tuple[float, ...]
    misfit: ChiSquare | None


@final
@dataclass(frozen=True)
class NoScale:
    """There are no likeliest scale values.

    Attributes
    ----------
    reason
        Why, and what to do.
    """

    reason: str


@final
@dataclass(frozen=True)
class Study:
    """What a study shows.

    Attributes
    ----------
    names
        Names of the conditions.
    pairs
        Pairs that were compared, in the conditions' order.
    scale
        Scale values after Bradley and Terry.
    equality
        Test of no preference at all.
    pearson
        The paper's statistic for it; too small by `equality`'s measure, see this module.
    """

    names: tuple[str, ...]
    pairs: tuple[Pair, ...]
    scale: Scale | NoScale
    equality: ChiSquare
    pearson: float


def analyse(wins: ArrayLike, names: Sequence[str], *, false_alarm: float = 0.05) -> Study:
    """What a study by paired comparisons shows.

    Parameters
    ----------
    wins
        (condition, condition) counts: how often the first was preferred to the second. Pairs may be
        compared unequally often, or never.
    names
        Names of the conditions. Scale values are relative to the first.
    false_alarm
        Probability of calling any pair different if none is.

    Returns
    -------
    study
        Scale values, pairs that differ, and a test of equality.

    Raises
    ------
    InputError
        If `wins` are not counts of at least two conditions that trials link, directly or by others;
        or `names` are not theirs.
    Missing
        Without statsmodels.
    """
    counts = _guarded(wins, names)
    if not 0 < false_alarm < 1:
        raise InputError(f"false_alarm lies between 0 and 1, got {false_alarm:g}")
    return Study(
        tuple(names),
        _pairs(counts, names, false_alarm),
        _scale(counts, names),
        *_equality(counts),
    )


@guarded(p="... test")
def holm(p: ArrayLike) -> NDArray[np.float64]:
    """(..., test) p-values corrected for the number of tests after Holm."""
    # Not by statsmodels' multipletests, which takes one family at a time and 50 ms for it
    p = np.asarray(p, np.float64)
    order = np.argsort(p, axis=-1)
    tests = p.shape[-1]
    scaled = np.take_along_axis(p, order, -1) * np.arange(tests, 0, -1)
    adjusted = np.empty_like(p)
    np.put_along_axis(adjusted, order, np.maximum.accumulate(scaled, -1).clip(max=1), -1)
    return adjusted


def totals_from_chi2(
    conditions: int, trials: int, chi2: float, *, digits: int
) -> NDArray[np.int64]:
    """(set, condition) all numbers of wins that agree with a printed Pearson chi-square.

    Parameters
    ----------
    conditions, trials
        Number of conditions of a study that compared all pairs equally often; trials of all pairs
        together.
    chi2
        Pearson's statistic for equal wins, as printed.
    digits
        Digits behind its point.

    Returns
    -------
    totals
        (set, condition) numbers of wins.

    Raises
    ------
    InputError
        If trials cannot be shared equally among the pairs, or there are too many sets to try.
    """
    pairs = conditions * (conditions - 1) // 2
    if conditions < 2 or trials < 1 or trials % pairs:
        raise InputError(
            f"each pair of {conditions} conditions has as many trials, got {trials} in all"
        )
    each = trials // pairs
    most = each * (conditions - 1)
    if (most + 1) ** (conditions - 1) > 10**7:
        raise InputError(
            f"{trials} trials of {conditions} conditions are too many to try; most are 10^7 sets"
        )
    free = np.indices((most + 1,) * (conditions - 1)).reshape(conditions - 1, -1).T
    totals = np.column_stack([free, trials - free.sum(1)])
    # A subset of k conditions wins at least the trials among themselves (Landau): enough, too
    subsets = np.arange(1, conditions + 1)
    least = each * subsets * (subsets - 1) // 2
    possible = np.all(np.cumsum(np.sort(totals, 1), 1) >= least, 1)
    statistic = np.sum((totals - trials / conditions) ** 2, 1) * (conditions / trials)
    # Ends of the interval count: a half may have been rounded up or down
    agrees = np.abs(statistic - chi2) <= 0.5 * 10.0**-digits + 1e-9
    return np.asarray(totals[possible & agrees], np.int64)


def wins_from_totals(totals: Sequence[int]) -> NDArray[np.int64]:
    """(set, condition, condition) all counts of three conditions that add up to given wins.

    Parameters
    ----------
    totals
        Wins of each, from as many trials of each pair.

    Raises
    ------
    InputError
        If these are not three, or do not share their trials equally among the pairs.
    """
    if len(totals) != 3 or sum(totals) % 3:
        raise InputError(f"three wins that add up to a multiple of 3, got {list(totals)}")
    each = sum(totals) // 3
    first = np.arange(each + 1)  # of condition 0 over 1; all else follows
    wins = np.zeros((each + 1, 3, 3), np.int64)
    wins[:, 0, 1], wins[:, 1, 0] = first, each - first
    wins[:, 0, 2] = totals[0] - first
    wins[:, 2, 0] = each - wins[:, 0, 2]
    wins[:, 1, 2] = totals[1] - wins[:, 1, 0]
    wins[:, 2, 1] = each - wins[:, 1, 2]
    return wins[np.all(wins >= 0, (1, 2))]


def _guarded(wins: ArrayLike, names: Sequence[str]) -> Wins:
    try:
        if np.iscomplexobj(np.asarray(wins)):
            raise TypeError
        given = np.asarray(wins, np.float64)
    except (TypeError, ValueError):
        raise InputError("wins is a square table of counts, got something else") from None
    if given.ndim != 2 or given.shape[0] != given.shape[1] or len(given) < 2:
        raise InputError(f"wins is (condition, condition), 2 or more, got shape {given.shape}")
    if wrong := [float(x) for x in given.ravel() if not (x >= 0 and x == np.floor(x) < 2**53)]:
        raise InputError(f"wins are counts: 0, 1, 2, ..., got {wrong[0]:g}")
    if np.any(np.diag(given)):
        raise InputError("no condition is compared with itself: wins has zeros on its diagonal")
    if len(names) != len(given):
        raise InputError(f"wins has {len(given)} conditions, got {len(names)} names")
    if len(set(names)) != len(names):
        raise InputError(f"each condition has its own name, got {', '.join(names)}")
    counts = given.astype(np.int64)
    groups, group = connected_components(counts + counts.T > 0, directed=False)
    if groups > 1:
        inside, outside = _named(names, group == 0), _named(names, group != 0)
        raise InputError(f"no trial compares {inside} with {outside}: analyse them one by one")
    return counts


def _pairs(wins: Wins, names: Sequence[str], false_alarm: float) -> tuple[Pair, ...]:
    compared = [(i, j) for i, j in combinations(range(len(names)), 2) if wins[i, j] + wins[j, i]]
    tests = [stats.binomtest(int(wins[i, j]), int(wins[i, j] + wins[j, i])) for i, j in compared]
    adjusted = holm([test.pvalue for test in tests])
    pairs = []
    for (i, j), test, p in zip(compared, tests, adjusted, strict=True):
        interval = test.proportion_ci(0.95, method="exact")
        pairs.append(
            Pair(
                names[i],
                names[j],
                trials=test.n,
                wins=test.k,
                share=float(test.statistic),
                low=float(interval.low),
                high=float(interval.high),
                p=float(test.pvalue),
                adjusted=float(p),
                significant=bool(p <= false_alarm),
            )
        )
    return tuple(pairs)


def _scale(wins: Wins, names: Sequence[str]) -> Scale | NoScale:
    try:
        # A second to import, and not part of a plain installation
        from statsmodels.genmod.families import Binomial  # noqa: PLC0415
        from statsmodels.genmod.generalized_linear_model import GLM  # noqa: PLC0415
    except ImportError:
        raise Missing("needs statsmodels: pip install 'domesim[study]'") from None

    groups, group = connected_components(wins > 0, directed=True, connection="strong")
    if groups > 1:
        return NoScale(_why_not(wins, names, group))
    # Each choice is a success of the difference (winner - loser)
    winner, loser = np.nonzero(wins)
    units = np.eye(len(wins))[:, 1:]
    difference = units[winner] - units[loser]
    model = GLM(np.ones(len(winner)), difference, Binomial(), freq_weights=wins[winner, loser])
    # Of the deviance, the default criterion would be below rounding for many trials
    fit = model.fit(tol_criterion="params", tol=1e-6)
    if not fit.converged:
        return NoScale("the fit did not converge; state the pairs' intervals instead")
    values = np.concatenate([[0.0], fit.params])
    return Scale(
        tuple(values.tolist()),
        (0.0, *np.asarray(fit.bse).tolist()),
        _misfit(wins, values),
    )


def _why_not(wins: Wins, names: Sequence[str], group: NDArray[np.int32]) -> str:
    """Names conditions that never lost to the rest; there are some if groups are several."""
    unbeaten = next(
        inside
        for inside in (group == number for number in range(group.max() + 1))
        if not wins[np.ix_(~inside, inside)].any()
    )
    best, rest = _named(names, unbeaten), _named(names, ~unbeaten)
    return (
        f"nobody preferred {rest} to {best}, so that no finite scale values are likeliest; state "
        f"the pairs' intervals instead, or collect more trials"
    )


def _misfit(wins: Wins, values: NDArray[np.float64]) -> ChiSquare | None:
    trials = wins + wins.T
    freedom = int(np.count_nonzero(np.triu(trials))) - len(wins) + 1
    if freedom == 0:
        return None
    expected = trials * expit(values[:, None] - values[None, :])
    ratio = np.divide(wins, expected, out=np.ones(wins.shape), where=wins > 0)
    statistic = 2 * float(np.sum(xlogy(wins, ratio)))
    return ChiSquare(statistic, freedom, float(stats.chi2.sf(statistic, freedom)))


def _equality(wins: Wins) -> tuple[ChiSquare, float]:
    trials = wins + wins.T
    shown = trials.sum(1)
    off = wins.sum(1) - shown / 2
    laplacian = np.diag(shown) - trials
    # All differences add up to 0: without the first, the rest says everything
    statistic = float(off[1:] @ np.linalg.solve(laplacian[1:, 1:] / 4, off[1:]))
    freedom = len(wins) - 1
    equality = ChiSquare(statistic, freedom, float(stats.chi2.sf(statistic, freedom)))
    return equality, float(np.sum(off**2 / (shown / 2)))


def _named(names: Sequence[str], chosen: NDArray[np.bool_]) -> str:
    return " or ".join(name for name, is_in in zip(names, chosen, strict=True) if is_in)
