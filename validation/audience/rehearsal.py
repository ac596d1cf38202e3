"""Simulated viewers who answer a study's plan, trial by trial: to rehearse it, and its analysis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from validation.audience.design import plan
from validation.audience.files import Answer, Answers, Study


def attentive(
    study: Study, number: int, scale: ArrayLike, random: np.random.Generator, *, lapses: float = 0.0
) -> Answers:
    """A viewer who chooses by scale values after Bradley and Terry, and sees what is spoilt.

    Parameters
    ----------
    study, number
        The study, and the number of the viewer's plan.
    scale
        (method,) log-odds.
    random
        Draws the choices.
    lapses
        Share of trials that are answered without a look.
    """
    values = dict(zip(study.methods, np.asarray(scale, np.float64), strict=True))
    choices = []
    for trial in study.viewers[number - 1]:
        if trial.right is not None:
            first = trial.right == 1
        else:
            first = random.random() < expit(values[trial.first] - values[trial.second])
        if random.random() < lapses:
            first = random.random() < 0.5
        choices.append(1 if first else 2)
    return answered(study, number, choices)


def answered(study: Study, number: int, choices: Sequence[int]) -> Answers:
    """A viewer who makes these choices, trial by trial."""
    given = tuple(Answer(trial=k, choice=choice) for k, choice in enumerate(choices))
    return Answers(study=study.digest, viewer=number, name=str(number), answers=given)


def planned(
    masters: Sequence[str], methods: Sequence[str], *, viewers: int, seed: int = 0, repeats: int = 2
) -> Study:
    """A study without pictures, of which only the plan matters.

    Parameters
    ----------
    masters, methods, viewers, seed, repeats
        As of `design.plan`; the number of viewers.
    """
    plans = (
        plan(masters, methods, viewer=number, seed=seed, repeats=repeats)
        for number in range(1, viewers + 1)
    )
    return Study(
        version="",
        scene="",
        show="display",
        stereo=True,
        question="",
        together=False,
        seconds=1.0,
        white=1.0,
        seed=seed,
        repeats=repeats,
        methods=tuple(methods),
        masters=dict.fromkeys(masters, ()),
        pictures={},
        viewers=tuple(plans),
    )
