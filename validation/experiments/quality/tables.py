"""The figures: in tables, and by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from compensate.contrast import (
    DOME_CHROMA,
    DOME_FLOOR,
    DOME_GAIN,
    PAIR_CHROMA,
    PAIR_DAMPING,
    PAIR_FLOOR,
    PAIR_GAIN,
    ContrastWeighting,
)
from compensate.leeway import Leeway
from compensate.softening import Softening
from validation.experiment import Cell as Entry
from validation.experiment import Column, Table
from validation.experiments.quality.gains import (
    SHORT,
    alike,
    falling_back,
    falls,
    gains,
    geometric,
    news,
    of_contrast,
    quality,
    shortfalls,
)
from validation.experiments.quality.inputs import USUAL_LUMINANCE, Input, words
from validation.experiments.quality.judging import Cells
from validation.experiments.quality.ways import CHOSEN, MAIN, WAYS, Way
from validation.statistics import estimate

BACK = (1.0, 1.25, 1.5, 2.0, 3.0)
"""Margins of a fall-back that are looked at."""


def written(cells: Cells, wanted: Mapping[str, Input], *, judged: bool) -> Iterator[Table]:
    """By input, over all inputs, by setting, and by place."""
    if judged:
        yield _by_input(cells, wanted)
    yield _ranking(
        cells,
        MAIN,
        "Methods, over all inputs, pollutions and luminances. Gains are over subtraction where "
        "that is seen, with Student's 95 % interval over inputs; shortfalls are against the better "
        "of subtraction and nothing, over all cases.",
    )
    usual, soft, leeway = ContrastWeighting(), Softening(), Leeway()
    yield _ranking(
        {place: ways for place, ways in cells.items() if place[2] == USUAL_LUMINANCE},
        WAYS,
        f"What each setting of the weighting of local contrast is worth, at "
        f"{USUAL_LUMINANCE:g} cd/m² and all pollutions. Usual, of pairs and domes: low-frequency "
        f"gain {PAIR_GAIN:g} and {DOME_GAIN:g}, chroma times {PAIR_CHROMA:g} and {DOME_CHROMA:g}, "
        f"floor {PAIR_FLOOR:g} and {DOME_FLOOR:g} cd/m², reach {usual.reach:g}°; of domes, most "
        f"{usual.most:g}; of pairs, damping {PAIR_DAMPING:g}. Pairs change by up to "
        f"{leeway.times:g} times the ghost within {leeway.reach:g}°, and lose up to "
        f"{leeway.share:g} of their light; their ghosts' edges are softened: height "
        f"{soft.height:g}, reach {soft.reach:g}°, crowding {soft.crowding:g} of {soft.crowd:g}°, "
        f"half a rim at {soft.contrast:g} times, dark is {soft.dark:g} cd/m², near is "
        f"{soft.near:g}°, a step {soft.step:g} of the ghost within {soft.nearby:g}°; around ghosts "
        f"that stand out changes are damped {1 + soft.firmness:g} times as much, half of that at "
        f"{soft.firm:g} times.",
    )
    if judged:
        yield _falling_back(cells)
    yield _by_place(cells)


def by_name(cells: Cells) -> dict[str, float | None]:
    """To be quoted elsewhere."""
    found: dict[str, float | None] = {}
    for place, ways in cells.items():
        name, pollution, white = place
        for way, cell in ways.items():
            start = f"quality.{name}.{pollution:g}.{white:g}.{way}"
            found |= {
                f"{start}.quality": cell.quality,
                f"{start}.flip": cell.flip,
                f"{start}.contour": cell.contour,
                f"{start}.new": cell.new,
                f"{start}.hue": cell.hue,
            }
    for way in MAIN:
        overall = estimate(gains(cells, way).values())
        found |= {
            f"quality.gain.{way}": overall.mean,
            f"quality.gain.{way}.low": overall.low,
            f"quality.gain.{way}.high": overall.high,
        }
    return found


def _by_input(cells: Cells, wanted: Mapping[str, Input]) -> Table:
    rows: list[tuple[Entry, ...]] = [
        (
            name,
            *(
                float(
                    np.mean([quality(ways[way]) for (n, _, _), ways in cells.items() if n == name])
                )
                for way in MAIN
            ),
        )
        for name in wanted
    ]
    return Table(
        caption="ColorVideoVDP by input: means over its pollutions and luminances.",
        columns=(
            Column(name="input"),
            *(Column(name=way.title, unit="JOD", digits=".3f") for way in MAIN.values()),
        ),
        rows=tuple(rows),
    )


def _ranking(cells: Cells, ways: Mapping[str, Way], caption: str) -> Table:
    rows: list[tuple[Entry, ...]] = []
    for name, way in ways.items():
        found = estimate(gains(cells, name).values())
        short = {k: v for k, v in shortfalls(cells, name).items() if np.isfinite(v)}
        worst = max(short, key=short.__getitem__) if short else None
        flips = [
            (here[name].flip or 0.0) - (here["subtractive"].flip or 0.0)
            for here in cells.values()
            if name in here and here[name].flip is not None
        ]
        hues = [here[name].hue for here in cells.values()]
        rows.append(
            (
                way.title,
                found.mean,
                found.low,
                found.high,
                None if worst is None else short[worst],
                "" if worst is None else words(worst),
                sum(value > SHORT for value in short.values()),
                float(np.mean(flips)) if flips else None,
                geometric(falls(cells, name)),
                geometric(falls(cells, name, of_contrast)),
                float(np.mean([hue for hue in hues if hue is not None])),
                max(news(cells, name).values(), default=None),
                float(np.mean([here[name].seconds for here in cells.values()])),
            )
        )
    return Table(
        caption=caption,
        columns=(
            Column(name="method"),
            Column(name="gain", unit="JOD", digits="+.3f"),
            Column(name="from", unit="JOD", digits="+.3f"),
            Column(name="to", unit="JOD", digits="+.3f"),
            Column(name="worst shortfall", unit="JOD", digits="+.3f"),
            Column(name="where"),
            Column(name=f"cases short by {SHORT:g}"),
            Column(name="FLIP over subtraction's", digits="+.4f"),
            Column(name="ghost contour falls", unit="times", digits=".2f"),
            Column(name="of contrast", unit="times", digits=".2f"),
            Column(name="hue shift, domes", unit="°", digits=".0f"),
            Column(name="new artefacts, most", unit="of the screen", digits=".1%"),
            Column(name="time", unit="s", digits=".2f"),
        ),
        rows=tuple(rows),
    )


def _falling_back(cells: Cells) -> Table:
    compared, agreed = alike(cells, CHOSEN)
    return Table(
        caption=(
            f"Could it know by itself when to leave a picture to subtraction? Its own visible "
            f"error ranks it and nothing or subtraction as ColorVideoVDP does in {agreed} of "
            f"{compared} cases in which that sees more than {SHORT:g} JOD between them. If it fell "
            f"back on subtraction wherever its visible error is not so many times less:"
        ),
        columns=(
            Column(name="times less", digits="g"),
            Column(name="cases that fall back"),
            Column(name="gain over subtraction, mean of all cases", unit="JOD", digits="+.3f"),
            Column(name="worst shortfall", unit="JOD", digits="+.3f"),
        ),
        rows=tuple((times, *falling_back(cells, CHOSEN, times)) for times in BACK),
    )


def _by_place(cells: Cells) -> Table:
    rows: list[tuple[Entry, ...]] = []
    for place, ways in cells.items():
        name, pollution, white = place
        ours, plain = ways[CHOSEN], ways["subtractive"]
        qualities = (ways[way].quality for way in MAIN)
        rows.append(
            (
                name,
                pollution,
                white,
                ours.clipped,
                *qualities,
                ours.new,
                plain.contour,
                ours.contour,
                plain.hue,
                ours.hue,
            )
        )
    return Table(
        caption=(
            "All cases: ColorVideoVDP of each method, JOD, and ghost contours where subtraction "
            "clips. Pollution is crosstalk or albedo."
        ),
        columns=(
            Column(name="input"),
            Column(name="pollution", digits="g"),
            Column(name="white", unit="cd/m²", digits="g"),
            Column(name="clipped", digits=".0%"),
            *(Column(name=way.title, digits=".3f") for way in MAIN.values()),
            Column(name="new artefacts", unit="of the screen", digits=".1%"),
            Column(name="contour, subtraction", digits=".3f"),
            Column(name=f"contour, {WAYS[CHOSEN].title}", digits=".3f"),
            Column(name="hue shift, subtraction", unit="°", digits=".0f"),
            Column(name=f"hue shift, {WAYS[CHOSEN].title}", unit="°", digits=".0f"),
        ),
        rows=tuple(rows),
    )
