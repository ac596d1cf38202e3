"""The paper's user study shows a preference if choices are independent, but not all it concludes.

Rationale
    The paper (section 4.1) prints two numbers of its user study: chi² = 283.0 of 960 choices
    between stills (16 people and 10 images, so each of 3 pairs of conditions twice: 320 choices a
    pair), and 58.8 of 120 choices between videos (10 people and 6 videos, so 2 conditions twice: 20
    choices a video). A printed chi² leaves only some numbers of wins, and these can all be counted
    out. It does not say who won; that perceptual compensation won most is taken from the text.
Expected
    Both chi² are far beyond chance. For video, 102 of 120 choices are the only possible ones. For
    stills many counts are possible, and some of them do not show that perceptual compensation is
    preferred to both others, although it wins most. If choices follow one scale, all show it.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from domesim.observation.uncertain import SIGMAS
from validation.experiment import Column, Finding, Table, Work, at_least, at_most, equal
from validation.study import (
    Scale,
    Study,
    analyse,
    holm,
    totals_from_chi2,
    wins_from_totals,
)

NAMES = ("perceptual", "subtractive", "none")
"""The stills' conditions."""

PERCEPTUAL, SUBTRACTIVE, NONE = range(3)
STILLS = 960
VIDEOS, CHOICES = 6, 20
"""Choices between stills; videos, and choices between two conditions of each."""

FALSE_ALARM = 0.05
"""Probability of a false alarm in any of the three pairs together."""


@dataclass(frozen=True)
class Totals:
    """A set of wins that agrees with the stills' chi².

    Attributes
    ----------
    wins
        (condition,).
    ways
        In which the choices of the three pairs can add up to them.
    concluded
        Number of these in which perceptual compensation is significantly preferred to both others.
    """

    wins: tuple[int, ...]
    ways: int
    concluded: int

    @property
    def perceptual_won(self) -> bool:
        """Whether perceptual compensation won most."""
        return self.wins[PERCEPTUAL] > max(self.wins[SUBTRACTIVE], self.wins[NONE])


@dataclass(frozen=True)
class Stills:
    """What the stills' chi² leaves possible.

    Attributes
    ----------
    totals
        All sets of wins.
    cases
        Name -> study of extreme choices, perceptual compensation winning most, and subtractive
        compensation coming second: which of the others did is not known.
    lead, lead_error
        Least lead of perceptual compensation on a Bradley-Terry scale in any set of wins that it
        leads, and its standard error, log-odds.
    """

    totals: tuple[Totals, ...]
    cases: dict[str, Study]
    lead: float
    lead_error: float


def stills() -> Stills:
    """All choices that agree with chi² = 283.0 of 960."""
    totals, cases, leads = [], [], []
    for wins in totals_from_chi2(3, STILLS, 283.0, digits=1).tolist():
        ways = wins_from_totals(wins)
        concluded = _concluded(ways)
        totals.append(Totals(tuple(wins), len(ways), int(concluded.sum())))
        if wins[PERCEPTUAL] > wins[SUBTRACTIVE] >= wins[NONE]:
            cases.append((ways, concluded))
            # All ways have the same scale, which depends on the wins alone
            scale = analyse(ways[len(ways) // 2], NAMES).scale
            assert isinstance(scale, Scale)
            leads.append((-scale.values[SUBTRACTIVE], scale.errors[SUBTRACTIVE]))
    ways, concluded = (np.concatenate(part) for part in zip(*cases, strict=True))
    weaker = ways[:, PERCEPTUAL, [SUBTRACTIVE, NONE]].min(1)
    chosen = {
        "least favourable": np.argmin(weaker),
        "least that is significant": np.argmin(np.where(concluded, weaker, STILLS)),
        "most favourable": np.argmax(weaker),
    }
    return Stills(
        tuple(totals),
        {name: analyse(ways[i], NAMES, false_alarm=FALSE_ALARM) for name, i in chosen.items()},
        *min(leads),
    )


def run(work: Work) -> Finding:
    """Count out what is possible, and say whether it is as expected."""
    still = work.step("stills", Stills, stills)
    possible = totals_from_chi2(2, VIDEOS * CHOICES, 58.8, digits=1)
    won = int(possible.max())
    lost = VIDEOS * CHOICES - won
    (video,) = analyse([[0, won], [lost, 0]], ["perceptual", "other"]).pairs
    ahead = [totals for totals in still.totals if totals.perceptual_won]
    ways = sum(totals.ways for totals in ahead)
    doubtful = ways - sum(totals.concluded for totals in ahead)
    shares = [totals.wins[PERCEPTUAL] / (STILLS * 2 / 3) for totals in ahead]
    worst = still.cases["least favourable"].pairs[0]
    p = float(stats.chi2.sf(283.0, 2))
    return Finding(
        result=(
            f"Video: perceptual compensation was chosen in {won} of {won + lost} trials. For a "
            f"winner no other count gives the printed chi², so this one can be relied on: "
            f"{_percent(video.share)} of choices, 95 % interval "
            f"{_percent(video.low, video.high)}. The paper prints p = "
            f"0.01 for everything, probably its threshold; the exact p is {video.p:.0e}."
            "\n\n"
            f"Stills: {len(still.totals)} sets of wins give the printed chi², and choices in three "
            f"pairs can add up to them in {sum(t.ways for t in still.totals):,} ways. All say that "
            f"the preferences are no accident (p = {p:.0e}), none says whose they are. Suppose "
            f"that perceptual compensation won most, as the text says: it was then chosen in "
            f"{_percent(min(shares), max(shares))} of the trials that showed it. Still, in "
            f"{doubtful} of the {ways:,} ways that are left it is not significantly preferred to "
            f"both others; at worst the runner-up is chosen over it, {worst.trials - worst.wins} "
            f"to {worst.wins}. But if all choices follow one scale of preference, wins alone "
            f"decide, and it leads in every set, by at least {still.lead:.2f} ± "
            f"{still.lead_error:.2f} log-odds, {10 * np.exp(still.lead):.0f} choices to 10. So the "
            f"conclusion is probably right; to prove it, three counts would have had to be "
            f"printed, one per pair of conditions. (Ways are possibilities, not probabilities.)"
            "\n\n"
            f"Of three conditions a trial shows only two, so that wins vary less than the paper's "
            f"chi² assumes: it errs on the side of caution, and the right statistic is 4/3 of it, "
            f"{283.0 * 4 / 3:.0f}. For a study of your own, validation.study.analyse takes the "
            f"table of who won how often over whom."
        ),
        checks=(
            at_most("stills: p of chi² = 283.0", p, 0.01),
            at_most("video: exact p of equal preference", video.p, 0.01),
            equal("video: counts that give chi² = 58.8, whoever won", len(possible) / 2, 1),
            equal("video: choices for the preferred condition", won, 102),
            at_least("stills: sets of wins that give chi² = 283.0", len(still.totals), 2),
            at_least("stills: least share of perceptual, if it won most", min(shares), 0.5),
            at_least("stills: ways of these that do not show it to beat both", doubtful, 1),
            at_least(
                "stills: least lead on a Bradley-Terry scale over its standard error",
                still.lead / still.lead_error,
                SIGMAS,
            ),
        ),
        tables=(_pairs(still),),
        figures={
            "user_study.video_wins": won,
            "user_study.video_share": video.share,
            "user_study.video_share_low": video.low,
            "user_study.video_share_high": video.high,
            "user_study.video_p": video.p,
            "user_study.stills_p": p,
            "user_study.stills_sets": len(still.totals),
            "user_study.stills_ways": sum(totals.ways for totals in still.totals),
            "user_study.stills_ways_won": ways,
            "user_study.stills_ways_doubtful": doubtful,
            "user_study.stills_share_low": min(shares),
            "user_study.stills_share_high": max(shares),
            "user_study.stills_lead": still.lead,
            "user_study.stills_lead_error": still.lead_error,
        },
        left_out=(
            "How much one person's choices are alike. Each made 60 choices between stills, or 12 "
            "between videos; all tests here, and the paper's, take them for choices of as many "
            "strangers, for what each person chose is not printed. If each had always chosen the "
            "same, 102 of 120 would be worth 8 or 9 of 10 people: p = "
            f"{stats.binomtest(8, 10).pvalue:.2f} or {stats.binomtest(9, 10).pvalue:.2f}.",
            "What perceptual compensation of video was compared with. One degree of freedom means "
            "two conditions, yet the text says that it is preferred to both others.",
        ),
    )


def _concluded(ways: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(way,) whether perceptual compensation is significantly preferred to both others."""
    won = ways[:, PERCEPTUAL, [SUBTRACTIVE, NONE]]
    p = _two_sided(STILLS // 3)[np.column_stack([won, ways[:, SUBTRACTIVE, NONE]])]
    preferred = (holm(p)[:, :2] <= FALSE_ALARM) & (won > STILLS / 6)
    return np.asarray(np.all(preferred, 1))


@functools.cache
def _two_sided(trials: int) -> NDArray[np.float64]:
    """(wins,) p of equal preference."""
    return np.array([stats.binomtest(wins, trials).pvalue for wins in range(trials + 1)])


def _pairs(still: Stills) -> Table:
    return Table(
        caption=(
            "Stills: three possible outcomes, by the weaker of perceptual compensation's two "
            "preferences. Each pair has 320 choices; p of equal preference, two-sided; corrected "
            "for three pairs after Holm."
        ),
        columns=(
            Column(name="outcome"),
            Column(name="pair"),
            Column(name="choices for the first"),
            Column(name="share"),
            Column(name="95 % interval"),
            Column(name="p", digits=".1g"),
            Column(name="p, corrected", digits=".1g"),
        ),
        rows=tuple(
            (
                name,
                f"{pair.first} over {pair.second}",
                pair.wins,
                _percent(pair.share),
                _percent(pair.low, pair.high),
                pair.p,
                pair.adjusted,
            )
            for name, study in still.cases.items()
            for pair in study.pairs
        ),
    )


def _percent(*shares: float) -> str:
    return " to ".join(f"{100 * share:.0f}" for share in shares) + " %"
