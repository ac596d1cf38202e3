"""Who sees what, and in which order.

In each trial a viewer sees two pictures of one master, made by two methods, and chooses one. Each
viewer sees all pairs of methods of all masters equally often, with either picture first equally
often: within a viewer if `repeats` is even, else over masters and viewers. Order is random, by the
study's seed and the viewer's number; the same master does not come twice in a row if there are
others.

Two kinds of trials have a right answer, because one of their pictures is *spoilt* (`stimuli`).
*Training* trials come first, and their answers do not count. *Catch* trials are strewn among the
others: whoever does not look, or always presses one key, gets half of them wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import combinations, cycle
from typing import Literal, final

import numpy as np

from domesim.errors import InputError
from validation.experiment import Record

SPOILT = "spoilt"
"""Name of the condition that is worse than all methods."""
TRAINING, CATCH = 4, 8
"""Trials of these kinds for each viewer; both are even, so that either side is right as often."""

Kind = Literal["training", "catch", "choice"]


@final
class Trial(Record):
    """Two pictures, one after the other or side by side.

    Attributes
    ----------
    kind
        What it is for.
    master
        Name of the master.
    first, second
        The conditions of its two pictures: methods, or `SPOILT`.
    """

    kind: Kind
    master: str
    first: str
    second: str

    @property
    def right(self) -> int | None:
        """The right answer, 1 or 2; None where there is none."""
        if SPOILT not in (self.first, self.second):
            return None
        return 1 if self.second == SPOILT else 2


def plan(
    masters: Sequence[str], methods: Sequence[str], *, viewer: int, seed: int, repeats: int = 2
) -> tuple[Trial, ...]:
    """All trials of one viewer, in order.

    Parameters
    ----------
    masters, methods
        Their names.
    viewer
        Number of the viewer, from 1.
    seed
        Seed of the study.
    repeats
        How often the viewer sees each pair of methods of each master.

    Returns
    -------
    trials
        In the order in which the viewer sees them.

    Raises
    ------
    InputError
        If there is no master, fewer than two methods, a name twice, or a number below 1.
    """
    _require(masters, methods, viewer, repeats)
    random = np.random.default_rng([seed, viewer])
    pairs = list(combinations(methods, 2))
    choices = []
    for m, master in enumerate(masters):
        for p, pair in enumerate(pairs):
            for r in range(repeats):
                swapped = (viewer + m + p + r) % 2
                first, second = reversed(pair) if swapped else pair
                choices.append(Trial(kind="choice", master=master, first=first, second=second))
    trials = _apart(choices, random)
    ends = np.linspace(0, len(trials), CATCH + 1).round().astype(int)
    for k, side in reversed(list(enumerate(_sides(CATCH, random)))):
        at = int(random.integers(ends[k], max(ends[k + 1], ends[k] + 1)))
        near = {trial.master for trial in trials[max(at - 1, 0) : at + 1]}
        others = [name for name in masters if name not in near] or list(masters)
        trials.insert(at, _spoilt("catch", str(random.choice(others)), methods, side))
    training = zip(_sides(TRAINING, random), _cycled(masters, random), strict=False)
    return (*(_spoilt("training", master, methods, side) for side, master in training), *trials)


def _sides(count: int, random: np.random.Generator) -> list[int]:
    """Which side is right: either as often."""
    sides: list[int] = random.permutation(np.arange(count) % 2).tolist()
    return sides


def _cycled(masters: Sequence[str], random: np.random.Generator) -> Iterator[str]:
    return cycle([masters[k] for k in random.permutation(len(masters))])


def _spoilt(kind: Kind, master: str, methods: Sequence[str], side: int) -> Trial:
    """A trial with a right answer: the second picture if `side` is 1."""
    pair = (methods[0], SPOILT)
    first, second = reversed(pair) if side else pair
    return Trial(kind=kind, master=master, first=first, second=second)


def _apart(trials: list[Trial], random: np.random.Generator) -> list[Trial]:
    """The trials in random order; neighbours are of different masters as far as that is possible.

    The next trial is drawn from all that are left, but for those of the last master. A master that
    has more trials left than all others together must come next.
    """
    left = [trials[k] for k in random.permutation(len(trials))]
    ordered: list[Trial] = []
    while left:
        counts = Counter(trial.master for trial in left)
        last = ordered[-1].master if ordered else None
        most, many = counts.most_common(1)[0]
        allowed = [trial for trial in left if trial.master != last] or left
        if most != last and many > len(left) - many:
            allowed = [trial for trial in left if trial.master == most]
        ordered.append(allowed[0])
        left.remove(allowed[0])
    return ordered


def _require(masters: Sequence[str], methods: Sequence[str], viewer: int, repeats: int) -> None:
    if not masters:
        raise InputError("a study wants at least one master, got none; name some")
    if len(methods) < 2:
        raise InputError(
            f"a study compares at least two methods, got {', '.join(methods) or 'none'}; name more"
        )
    for names in (masters, methods):
        if len(set(names)) < len(names):
            raise InputError(f"a study wants each name once, got {', '.join(names)}; rename one")
    if viewer < 1 or repeats < 1:
        raise InputError(
            f"viewers and repeats are counted from 1, got viewer {viewer} and {repeats} repeats"
        )
