"""Two eyes: what subtraction, the paper's method and the default leave for both eyes together.

Rationale
    The paper's claim is about two eyes, and all other judges here have one. `compensate.vision.
    binocular` holds published models of two: the fused picture by Ding and Sperling's gain control,
    the contrast of both by two stages (Meese, Georgeson and Baker), and rivalry by the ratio of
    contrasts (DiCE). The pairs of `quality` are shown in
    `stereo_polarised_paper` with crosstalk of 2, 5 and 10 %, at a white of 15 cd/m². No constant of
    these models was chosen on them; the default was chosen on some of them, by other judges.
    ColorVideoVDP, the mean of both eyes alone, is asked at 5 %.
Expected
    All three figures are 0 for the master, and rise with crosstalk from 0 to 10 % on all pairs.
    The default harms nobody. Over pairs it loses less than nothing done in fused loss and contrast,
    and its rivalry is that of nothing done, within a hundredth of the picture. By none of the three
    is it shown to be worse than subtraction: no interval lies above 0. On at most one pair of
    twelve it loses more than 0.02 JOD of ColorVideoVDP against the better of nothing and
    subtraction.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any, final

import numpy as np
from scipy import stats

from compensate.aim import Aim
from compensate.pose import Eye, Posed, pose
from compensate.ruler import NO_DIFFERENCE
from compensate.solve import solved
from compensate.vision.binocular.pair import Pair
from compensate.weighting import PerceptualWeighting
from domesim.light import Light
from testing.places import stereo_at
from testing.statistics import Estimate, estimate
from validation import inputs, judges
from validation.experiment import (
    Check,
    Column,
    Finding,
    Missing,
    Table,
    Work,
    at_least,
    at_most,
)
from validation.inputs import CHOOSING, PAIRED, Input

DEFAULT, NOTHING, SUBTRACTION, PAPER = "contrast", "nothing", "subtraction", "paper's weighting"
"""Names of ways, as in `quality`; the first is the product's default."""
WAYS: Mapping[str, tuple[str, Eye]] = {
    NOTHING: ("none", Aim()),
    SUBTRACTION: ("subtractive", Aim()),
    PAPER: ("perceptual", PerceptualWeighting()),
    DEFAULT: ("perceptual", Aim()),
}
CROSSTALK, USUAL, WHITE = (0.02, 0.05, 0.1), 0.05, 15.0
RISING = (0.0, 0.02, 0.05, 0.1)
"""Crosstalk at which nothing is done, to see that figures rise."""
FIGURES = {
    "fused_loss": ("fused loss", "JOD"),
    "contrast": ("contrast", "thresholds"),
    "rivalry": ("rivalry", "share of the picture"),
}


@dataclass(frozen=True)
class Cell:
    """One way at one place; JOD of ColorVideoVDP at the usual crosstalk."""

    fused_loss: float
    contrast: float
    rivalry: float
    judged: float | None


@dataclass(frozen=True)
class Rise:
    """Figures of nothing done, at each of `RISING`."""

    fused_loss: list[float]
    contrast: list[float]
    rivalry: list[float]


def run(work: Work) -> Finding:
    """All ways of all pairs."""
    if importlib.util.find_spec("cv2") is None:
        raise Missing("needs OpenCV: pip install 'domesim[disparity]'")
    wanted, left_out = inputs.wanted(work)
    pairs = {n: o for n, o in wanted.items() if o.kind == PAIRED}
    left_out = [text for text in left_out if text.partition(":")[0] not in inputs.DOMES]
    crosstalk = (USUAL,) if work.quick else CROSSTALK
    rises, cells = {}, {}
    for name, one in pairs.items():
        light = cache(one.read)
        rises[name] = work.step(f"{name}: rising", Rise, partial(_rise, light))
        for share in crosstalk:
            case = Case(light, share)
            for way in WAYS:
                cells[name, share, way] = work.step(
                    f"{name} at {share:g}: {way}",
                    Cell,
                    partial(_cell, case, way, judged=share == USUAL and not work.quick),
                )
    if not work.quick and any(
        cell.judged is None for key, cell in cells.items() if key[1] == USUAL
    ):
        left_out.append("ColorVideoVDP: it needs pip install 'domesim[metrics]'")
    return Finding(
        result=_told(cells, pairs),
        checks=tuple(_checks(rises, cells, quick=work.quick)),
        tables=(_differences(cells, pairs), _by_pair(cells)),
        figures=_figures(cells),
        left_out=tuple(left_out),
    )


@final
class Case:
    """A pair at one crosstalk.

    Parameters
    ----------
    light
        Reads the pair.
    share
        The crosstalk.
    """

    def __init__(self, light: Callable[[], Light], share: float) -> None:
        self._light, self._share = light, share

    @cached_property
    def posed(self) -> Posed:
        """The pair in its scene."""
        return pose(self._light(), stereo_at(self._share, WHITE), Aim())

    @cached_property
    def pair(self) -> Pair:
        """Its master."""
        return Pair(self.posed.wanted, self.posed.scene)

    def seen(self, way: str) -> Light:
        """What is seen by one way."""
        method, eye = WAYS[way]
        posed = self.posed
        if not isinstance(eye, Aim):
            posed = pose(posed.desired, posed.scene, eye)
        return posed.seen(solved(posed, method).light)


def _rise(light: Callable[[], Light]) -> Rise:
    found = []
    pair: Pair | None = None
    black: Light | None = None
    for share in RISING:
        posed = Case(light, share).posed
        seen = posed.seen(posed.desired)
        if pair is None or black is None:
            black = seen  # no crosstalk, but the projector's black, which is no matter of two eyes
            pair = Pair(black, posed.scene)
        found.append(pair.two_eyes(seen))
    return Rise(*([getattr(each, name) for each in found] for name in FIGURES))


def _cell(case: Case, way: str, *, judged: bool) -> Cell:
    posed, seen = case.posed, case.seen(way)
    found = case.pair.two_eyes(seen)
    jod = None
    if judged:
        try:
            jod = judges.colorvideovdp(posed.wanted, seen, posed.scene)
        except Missing:
            jod = None
    return Cell(found.fused_loss, found.contrast, found.rivalry, jod)


def _over_pairs(cells: Mapping[Any, Cell], way: str, other: str, figure: str) -> Estimate:
    """Mean over pairs of the difference between two ways, averaged over crosstalk."""
    names = dict.fromkeys(name for name, _, _ in cells)
    shares = dict.fromkeys(share for _, share, _ in cells)
    found = []
    for name in names:
        each = [
            getattr(cells[name, share, way], figure) - getattr(cells[name, share, other], figure)
            for share in shares
            if getattr(cells[name, share, way], figure) is not None
        ]
        if each:
            found.append(float(np.mean(each)))
    return estimate(found)


def _checks(rises: Mapping[str, Rise], cells: Mapping[Any, Cell], *, quick: bool) -> list[Check]:
    found = []
    for name, (told, unit) in FIGURES.items():
        steps = [float(np.min(np.diff(getattr(rise, name)))) for rise in rises.values()]
        found.append(at_least(f"{told}: least step as crosstalk rises, all pairs", min(steps), 0.0))
        first = max(getattr(rise, name)[0] for rise in rises.values())
        found.append(at_most(f"{told}: of no crosstalk", first, 0.0))
        if not quick:
            ours = _over_pairs(cells, DEFAULT, NOTHING, name)
            bound = 0.01 if name == "rivalry" else 0.0
            found.append(
                at_most(f"{told}: default less nothing, over pairs", ours.mean, bound, unit)
            )
    if quick:
        return found
    for name, (told, unit) in FIGURES.items():
        more = _over_pairs(cells, DEFAULT, SUBTRACTION, name)
        what = f"{told}: default less subtraction, lower end of the interval"
        found.append(at_most(what, more.low, 0.0, unit))
    if short := _short(cells):
        what = f"pairs {NO_DIFFERENCE:g} JOD short of the better of nothing and subtraction"
        share = float(np.mean(np.array(short) < -NO_DIFFERENCE))
        found.append(at_most(what, 100 * share, 100 / 12, "%"))
    return found


def _short(cells: Mapping[Any, Cell]) -> list[float]:
    """JOD of the default less the better of nothing and subtraction, of each judged pair."""
    judged = {key: cell.judged for key, cell in cells.items() if cell.judged is not None}
    return [
        jod - max(judged[name, share, NOTHING], judged[name, share, SUBTRACTION])
        for (name, share, way), jod in judged.items()
        if way == DEFAULT
    ]


def _told(cells: Mapping[Any, Cell], pairs: Mapping[str, Input]) -> str:
    text = f"{len(pairs)} pairs. "
    for name, (told, unit) in FIGURES.items():
        ours = _over_pairs(cells, DEFAULT, SUBTRACTION, name)
        paper = _over_pairs(cells, PAPER, SUBTRACTION, name)
        nothing = _over_pairs(cells, NOTHING, SUBTRACTION, name)
        text += (
            f"{told.capitalize()} ({unit}), over subtraction: the default {ours.written}, the "
            f"paper's weighting {paper.written}, nothing {nothing.written}. "
        )
    judged = _over_pairs(cells, DEFAULT, SUBTRACTION, "judged")
    if judged.inputs:
        text += f"ColorVideoVDP's JOD (more is better) of the default: {judged.written}. "
        text += (
            f"All pictures ranked by it and by fused loss: Spearman's {_agreement(cells):.2f}; the "
            f"four ways of each pair, in the mean: {_agreement_within(cells):.2f}. "
        )
    return text.rstrip()


def _agreement(cells: Mapping[Any, Cell]) -> float:
    """Rank correlation of fused loss with what ColorVideoVDP finds lost, over all its cells."""
    heard = [cell for cell in cells.values() if cell.judged is not None]
    losses = [(cell.fused_loss, -(cell.judged or 0.0)) for cell in heard]
    return float(stats.spearmanr(losses).statistic)


def _agreement_within(cells: Mapping[Any, Cell]) -> float:
    """The same of the ways of each pair, in the mean over pairs."""
    names = dict.fromkeys(name for name, _, _ in cells)
    return float(
        np.mean([_agreement({k: cell for k, cell in cells.items() if k[0] == n}) for n in names])
    )


def _differences(cells: Mapping[Any, Cell], pairs: Mapping[str, Input]) -> Table:
    rows = []
    for name, (told, unit) in {
        **FIGURES,
        "judged": ("ColorVideoVDP, more is better", "JOD"),
    }.items():
        for way in (NOTHING, PAPER, DEFAULT):
            found = _over_pairs(cells, way, SUBTRACTION, name)
            if found.inputs:
                rows.append((f"{told} ({unit})", way, found.mean, found.low, found.high))
    return Table(
        caption=(
            f"Difference from subtraction, mean over {len(pairs)} pairs and all crosstalks, with "
            f"95 % intervals (Student's over pairs). ColorVideoVDP at {USUAL:.0%} crosstalk."
        ),
        columns=(
            Column(name="figure"),
            Column(name="way"),
            Column(name="mean", digits="+.4f"),
            Column(name="low", digits="+.4f"),
            Column(name="high", digits="+.4f"),
        ),
        rows=tuple(rows),
    )


def _by_pair(cells: Mapping[Any, Cell]) -> Table:
    names = dict.fromkeys((name, share) for name, share, _ in cells)
    return Table(
        caption="All pairs: fused loss and rivalry of each way.",
        columns=(
            Column(name="pair"),
            Column(name="half"),
            Column(name="crosstalk", digits="g"),
            *(Column(name=f"fused loss, {way}", unit="JOD", digits=".3f") for way in WAYS),
            *(Column(name=f"rivalry, {way}", digits=".3f") for way in WAYS),
        ),
        rows=tuple(
            (
                name,
                "choosing" if name in CHOOSING else "reporting",
                share,
                *(cells[name, share, way].fused_loss for way in WAYS),
                *(cells[name, share, way].rivalry for way in WAYS),
            )
            for name, share in names
        ),
    )


def _figures(cells: Mapping[Any, Cell]) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for name in FIGURES:
        ours = _over_pairs(cells, DEFAULT, SUBTRACTION, name)
        found[f"two_eyes.{name}"] = ours.mean
        found[f"two_eyes.{name}.low"] = ours.low
        found[f"two_eyes.{name}.high"] = ours.high
    return found
