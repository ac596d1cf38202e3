"""How each viewer answered: told beside the results, and a reason to look, never to drop anybody.

*Catch trials* have a right answer. Who guesses gets each right by 1/2. It is told of a viewer who
got one wrong, if as many right ones are likelier than 5 % by guessing. *Sides*: first and second
are right equally often. It is told of who chooses one of them so often that a fair coin does it in
1 of 1000 viewers. *Otherwise* than others: the log-likelihood of the viewer's choices by the shares
of all, over what it would be of the average viewer, in its standard deviations; below -3 it is
told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from validation.audience.design import Trial
from validation.audience.files import Answers, Study

GUESSING, ONE_SIDED, OTHERWISE = 0.05, 0.001, -3.0
"""p above which catch trials may have been guessed; p of a side; standard deviations."""
HASTY = 0.25
"""Median time of an answer below which nobody has thought, s."""


@final
@dataclass(frozen=True)
class Viewer:
    """How one viewer answered.

    Attributes
    ----------
    name
        The number of the viewer's plan, or what a sheet says.
    answered, planned
        Trials, training left out.
    caught, catches
        Catch trials that were right, and all.
    guessing
        p of as many or more right ones by guessing; 1 without any.
    first
        Share of choices for the first picture.
    one_sided
        Two-sided p of that.
    otherwise
        Standard deviations below the average viewer's likelihood.
    seconds
        Median time of an answer, s; None on paper.
    told
        What to look at, in words.
    """

    name: str
    answered: int
    planned: int
    caught: int
    catches: int
    guessing: float
    first: float
    one_sided: float
    otherwise: float
    seconds: float | None
    told: tuple[str, ...]


def counts(study: Study, answers: Answers) -> NDArray[np.int64]:
    """(method, method) how often a viewer preferred the first to the second."""
    wins = np.zeros((len(study.methods),) * 2, np.int64)
    for _, winner, loser in _choices(study, answers):
        wins[study.methods.index(winner), study.methods.index(loser)] += 1
    return wins


def by_master(study: Study, everybody: Sequence[Answers]) -> dict[str, NDArray[np.int64]]:
    """Name of a master -> (method, method) choices of all viewers."""
    wins = {name: np.zeros((len(study.methods),) * 2, np.int64) for name in study.masters}
    for answers in everybody:
        for master, winner, loser in _choices(study, answers):
            wins[master][study.methods.index(winner), study.methods.index(loser)] += 1
    return wins


def viewer(study: Study, answers: Answers, shares: NDArray[np.float64]) -> Viewer:
    """How a viewer answered.

    Parameters
    ----------
    study, answers
        What was shown, and chosen.
    shares
        (method, method) share of all viewers' choices for the first; NaN where there are none.
    """
    trials = study.viewers[answers.viewer - 1]
    given = [(trials[one.trial], one) for one in answers.answers]
    counted = [(trial, one) for trial, one in given if trial.kind != "training"]
    right = [one.choice == trial.right for trial, one in counted if trial.right is not None]
    guessing = float(stats.binom.sf(sum(right) - 1, len(right), 0.5)) if right else 1.0
    firsts = sum(one.choice == 1 for _, one in counted)
    one_sided = float(stats.binomtest(firsts, len(counted)).pvalue) if counted else 1.0
    times = [one.seconds for _, one in counted if one.seconds is not None]
    seconds = float(np.median(times)) if times else None
    planned = sum(trial.kind != "training" for trial in trials)
    otherwise = _otherwise(study, answers, shares)
    told = []
    if len(counted) < planned:
        told.append("not finished")
    if not all(right) and guessing > GUESSING:
        told.append("catch trials no better than guessed")
    if one_sided < ONE_SIDED:
        told.append(f"chose the {'first' if 2 * firsts > len(counted) else 'second'} picture")
    if otherwise < OTHERWISE:
        told.append("chose otherwise than the others")
    if seconds is not None and seconds < HASTY:
        told.append("answered in haste")
    return Viewer(
        answers.name,
        len(counted),
        planned,
        sum(right),
        len(right),
        guessing,
        firsts / len(counted) if counted else 0.5,
        one_sided,
        otherwise,
        seconds,
        tuple(told),
    )


def chosen(trial: Trial, choice: int) -> tuple[str, str]:
    """The condition that was chosen, and the other one."""
    return (trial.first, trial.second) if choice == 1 else (trial.second, trial.first)


def _choices(study: Study, answers: Answers) -> list[tuple[str, str, str]]:
    """Master, method that was chosen, method that was not: without training and catch trials."""
    trials = study.viewers[answers.viewer - 1]
    return [
        (trials[one.trial].master, *chosen(trials[one.trial], one.choice))
        for one in answers.answers
        if trials[one.trial].kind == "choice"
    ]


def _otherwise(study: Study, answers: Answers, shares: NDArray[np.float64]) -> float:
    """Log-likelihood of the choices over its mean, in its standard deviations."""
    methods = study.methods
    found = mean = variance = 0.0
    for _, winner, loser in _choices(study, answers):
        p = float(np.clip(shares[methods.index(winner), methods.index(loser)], 0.01, 0.99))
        logs = np.log([p, 1 - p])
        found += logs[0]
        expected = float(np.dot([p, 1 - p], logs))
        mean += expected
        variance += float(np.dot([p, 1 - p], (logs - expected) ** 2))
    return float((found - mean) / np.sqrt(variance)) if variance > 0 else 0.0
