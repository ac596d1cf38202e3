"""An audience's study says no more than its viewers: intervals, power and false alarms hold.

Rationale
    `domesim study` (`validation.audience`) asks viewers to choose, tells shares and scale values
    with 95 % intervals, and promises power. Choices of one person are alike, so all of these have
    to count people, not choices. Here audiences are simulated whose truth is known. Each viewer has
    scale values of their own. Shares of choices are compared with the population's share; scale
    values with those of a model of the same audience that has very many viewers. Power is promised
    by `domesim study power`, and compared with studies that are played trial by trial and analysed
    by the code that analyses a real one.
Expected
    95 % intervals of shares cover 93 to 97 % for 8 to 26 viewers, 12 and 20 choices of each pair,
    and people who differ by 0 to 1 log-odds; intervals of trials taken as independent do not.
    Promised and found power agree within 3 points. Without a preference a study shows one in at
    most 5 %, within chance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from scipy import stats

from validation.audience.analysis import analyse_study
from validation.audience.inference import audience, share_interval
from validation.audience.power import FALSE_ALARM, Situation, power, simulated
from validation.audience.rehearsal import attentive, planned
from validation.experiment import (
    Column,
    Finding,
    Table,
    Work,
    at_most,
    between,
)
from validation.study import NoScale, Scale

VIEWERS, EACH, SHARES, SPREADS = (8, 16, 26), (12, 20), (0.5, 0.65, 0.8), (0.0, 0.5, 1.0)
"""Numbers of people, choices of each for a pair, shares, and log-odds by which people differ."""
METHODS = ("perceptual", "subtractive", "none")
MASTERS = tuple(f"master {number}" for number in range(1, 11))
PLAYED = ((16, 0.65, 0.5), (12, 0.6, 0.0), (20, 0.65, 1.0))
"""Viewers, share and spread of studies that are played: powers from a third to nearly all."""
SIGMAS = 3.0
"""Standard deviations of a simulated share that its bound is relaxed by."""


@dataclass(frozen=True)
class Covered:
    """How often intervals hold the truth, in one situation.

    Attributes
    ----------
    viewers, each, share, spread
        The situation.
    found, as_independent
        Share of intervals that cover: the kit's, and Clopper's and Pearson's of all choices.
    """

    viewers: int
    each: int
    share: float
    spread: float
    found: float
    as_independent: float


@dataclass(frozen=True)
class Played:
    """Power as promised and as found, and how often a scale value's interval holds the truth."""

    viewers: int
    share: float
    spread: float
    promised: float
    found: float
    scale_covered: float


def covered(audiences: int, seed: int) -> list[Covered]:
    """Coverage of the intervals of shares."""
    rows = []
    for k, (viewers, each, share, spread) in enumerate(product(VIEWERS, EACH, SHARES, SPREADS)):
        situation = Situation(share=share, spread=spread, methods=2, each=each)
        random = np.random.default_rng([seed, k])
        wins = simulated(situation, viewers, audiences, random)[:, :, 0, 1]
        ends = np.array([share_interval(won, np.full(viewers, each)) for won in wins])
        total, trials = wins.sum(1), viewers * each
        low = stats.beta.ppf(0.025, total, trials - total + 1)
        high = stats.beta.ppf(0.975, total + 1, trials - total)
        rows.append(
            Covered(
                viewers,
                each,
                share,
                spread,
                float(np.mean((ends[:, 0] <= share) & (share <= ends[:, 1]))),
                float(
                    np.mean((np.nan_to_num(low) <= share) & (share <= np.nan_to_num(high, nan=1)))
                ),
            )
        )
    return rows


def played(viewers: int, share: float, spread: float, audiences: int, seed: int) -> Played:
    """Studies played trial by trial, and analysed as real ones are."""
    situation = Situation(share=share, spread=spread, methods=len(METHODS), each=2 * len(MASTERS))
    promised = power(situation, viewers, audiences=10 * audiences, seed=seed + 1)
    study = planned(MASTERS, METHODS, viewers=viewers, seed=seed)
    random = np.random.default_rng([seed, viewers])
    scale = np.zeros(len(METHODS))
    scale[0] = situation.log_odds()
    # What a model without people, which lies between them, finds of very many
    many = audience(simulated(situation, 4000, 1, random)[0], METHODS).independent.scale
    assert isinstance(many, Scale)
    succeeded = held = 0
    for _ in range(audiences):
        own = spread / np.sqrt(2) * random.standard_normal((viewers, len(METHODS)))
        answers = [attentive(study, n + 1, scale + own[n], random) for n in range(viewers)]
        found = analyse_study(study, answers).everybody
        succeeded += all(
            one.significant and one.share > 0.5
            for one in found.preferences
            if one.first == METHODS[0]
        )
        value = found.independent.scale
        if found.errors is None or isinstance(value, NoScale):
            continue
        half = found.quantile * found.errors[1]
        held += abs(value.values[1] - many.values[1]) <= half
    return Played(viewers, share, spread, promised, succeeded / audiences, held / audiences)


def false_alarms(audiences: int, seed: int) -> float:
    """Share of studies without a preference that show one."""
    situation = Situation(share=0.5, spread=0.5, methods=3, each=20)
    counts = simulated(situation, 12, audiences, np.random.default_rng([seed, 5]))
    found = [any(p.significant for p in audience(one, METHODS).preferences) for one in counts]
    return float(np.mean(found))


def run(work: Work) -> Finding:
    """Simulate audiences, and compare what they are told with the truth."""
    many, studies = (200, 40) if work.quick else (4000, 1000)
    rows = work.step("coverage", list[Covered], lambda: covered(many, work.seed))
    cases = PLAYED[:1] if work.quick else PLAYED
    found = [
        work.step(
            f"played: {viewers} viewers, {share:g}, {spread:g}",
            Played,
            partial(played, viewers, share, spread, studies, work.seed),
        )
        for viewers, share, spread in cases
    ]
    alarms = work.step("false alarms", float, lambda: false_alarms(many, work.seed))
    shares = np.array([row.found for row in rows])
    alone = np.array([row.as_independent for row in rows])
    slack = SIGMAS * float(np.sqrt(0.05 * 0.95 / many)) if work.quick else 0.0
    chance = SIGMAS * float(np.sqrt(0.25 / studies)) if work.quick else 0.0
    worst = max(abs(one.promised - one.found) for one in found)
    scales = np.array([one.scale_covered for one in found])
    return Finding(
        result=(
            f"In {len(rows)} situations of {many} simulated audiences each, 95 % intervals of "
            f"shares cover {_percent(shares.min(), shares.max())} of the time, "
            f"{100 * shares.mean():.1f} % in the mean. Were each choice taken for another "
            f"person's, the intervals would cover as little as {_percent(alone.min())}. "
            f"Intervals of scale values cover {_percent(scales.min(), scales.max())}. Power is "
            f"found within {100 * worst:.1f} points of what was promised. Without a preference, "
            f"{_percent(alarms)} of studies show one."
        ),
        checks=(
            between("shares: least coverage", shares.min(), 0.93 - slack, 0.97 + slack),
            between("shares: largest coverage", shares.max(), 0.93 - slack, 0.97 + slack),
            at_most("choices taken as independent: least coverage", alone.min(), 0.9),
            between("scale values: least coverage", scales.min(), 0.93 - chance, 0.97 + chance),
            at_most("power: largest error of a promise", worst, 0.03 + chance),
            at_most(
                "no preference: studies that show one",
                alarms,
                FALSE_ALARM + SIGMAS * float(np.sqrt(0.05 * 0.95 / many)),
            ),
        ),
        tables=(_coverage(rows), _powers(found)),
        figures={
            "audiences.coverage_low": float(shares.min()),
            "audiences.coverage_high": float(shares.max()),
            "audiences.power_error": worst,
            "audiences.false_alarms": alarms,
        },
        left_out=(
            "Real people. How much they differ is not known before the first study.",
            "Four choices of each pair by 8 people: intervals of shares beyond 0.8 then cover up "
            "to 98 %.",
        ),
    )


def _coverage(rows: list[Covered]) -> Table:
    return Table(
        caption="Coverage of 95 % intervals of an audience's share of choices.",
        columns=(
            Column(name="viewers"),
            Column(name="choices of each"),
            Column(name="share", digits=".2f"),
            Column(name="people differ by", unit="log-odds", digits=".1f"),
            Column(name="covered", digits=".3f"),
            Column(name="covered, choices taken as independent", digits=".3f"),
        ),
        rows=tuple((r.viewers, r.each, r.share, r.spread, r.found, r.as_independent) for r in rows),
    )


def _powers(found: list[Played]) -> Table:
    return Table(
        caption=(
            "Studies of three methods and ten masters, played trial by trial: power, and coverage "
            "of the scale value of the second method."
        ),
        columns=(
            Column(name="viewers"),
            Column(name="share", digits=".2f"),
            Column(name="people differ by", unit="log-odds", digits=".1f"),
            Column(name="power, promised", digits=".3f"),
            Column(name="power, found", digits=".3f"),
            Column(name="scale value covered", digits=".3f"),
        ),
        rows=tuple(
            (p.viewers, p.share, p.spread, p.promised, p.found, p.scale_covered) for p in found
        ),
    )


def _percent(*shares: float) -> str:
    return " to ".join(f"{100 * share:.1f}" for share in shares) + " %"
