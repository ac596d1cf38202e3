"""What is expected of the figures, and what is said of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from compensate.solver.result import Status
from validation.experiment import Check, at_least, at_most
from validation.experiments.quality.gains import (
    SHORT,
    VISIBLE,
    falls,
    gains,
    geometric,
    news,
    of_contrast,
    shortfalls,
)
from validation.experiments.quality.inputs import Input, Place, kinds, words
from validation.experiments.quality.judging import NEW, Cell, Cells
from validation.experiments.quality.ways import CHOSEN, UNLIMITED, WAYS
from validation.statistics import estimate

MOST_NEW = 0.01
"""Share of the screen that new artefacts may have."""


def laws(cells: Cells) -> Iterator[Check]:
    """What holds whatever judges say."""
    places = list(cells.values())
    contours = [ways["none"].contour for ways in places]
    yield at_most(
        "nothing done: difference of its ghost contour to 1, the largest",
        max(abs(contour - 1) for contour in contours if contour is not None),
        1e-9,
    )
    yield at_most(
        f"{WAYS[CHOSEN].title}: visible error over subtraction's, mean",
        float(
            np.mean(
                [
                    ways[CHOSEN].error / ways["subtractive"].error
                    for ways in places
                    if ways["subtractive"].error > 0
                ]
            )
        ),
        0.9,
    )
    for name, which in ((CHOSEN, "that it might have chosen"), (UNLIMITED, "other")):
        found = [_over_the_least(ways, name) for ways in places if name in ways]
        if found:
            yield at_most(
                f"{WAYS[name].title}: cost over the least of all methods {which}, the largest",
                max(found),
                1.001,
            )
    yield at_most(
        f"{WAYS[CHOSEN].title}: certified gap where it is visible, the largest",
        max(
            (
                np.inf if ours.gap is None else ours.gap
                for ours in (ways[CHOSEN] for ways in places)
                if ours.status not in (Status.INVISIBLE.name, Status.EXACT.name)
            ),
            default=0.0,
        ),
        1e-3,
    )


def expectations(cells: Cells) -> Iterator[Check]:
    """What issue 7 asks for, of the judges."""
    title = WAYS[CHOSEN].title
    found = estimate(gains(cells, CHOSEN).values())
    seen = f"over subtraction where that is seen (JOD < {VISIBLE:g}), mean over inputs"
    yield at_least(f"{title}: gain {seen}", found.mean, 0.1, "JOD")
    yield at_least(f"{title}: gain {seen}, lower end of its 95 % interval", found.low, 0, "JOD")
    yield _largest(
        f"{title}: largest shortfall against the better of subtraction and nothing",
        shortfalls(cells, CHOSEN),
        SHORT,
        "JOD",
    )
    contours = falls(cells, CHOSEN)
    if contours:
        yield at_least(
            f"{title}: subtraction's ghost contour over its own where subtraction clips, "
            f"geometric mean over pairs",
            geometric(contours),
            2,
        )
    hues = {way: _hues(cells, way) for way in (CHOSEN, "subtractive")}
    if hues[CHOSEN]:
        yield at_most(
            f"{title}: shift of hue of domemasters' darker half over subtraction's",
            float(np.mean(hues[CHOSEN]) / np.mean(hues["subtractive"])),
            0.5,
        )
    yield _largest(
        f"{title}: share of the screen with a new artefact ({NEW:g} JOD worse than subtraction "
        f"and nothing), the largest",
        news(cells, CHOSEN),
        MOST_NEW,
    )


def told(cells: Cells, wanted: Mapping[str, Input], *, judged: bool) -> str:
    """What was found, in words; `judged` says whether ColorVideoVDP was there."""
    contours = falls(cells, CHOSEN)
    rises = {place: 1 / times for place, times in contours.items()}
    text = (
        f"{len(cells)} cases (an input at a pollution and a luminance) of {len(wanted)} inputs. "
        f"The ghost contour falls {geometric(contours):.2f} times against subtraction (geometric "
        f"mean over pairs; {min(contours.values()):.2f} to {max(contours.values()):.2f}), of "
        f"contrast {geometric(falls(cells, CHOSEN, of_contrast)):.2f} times. Of light it is more "
        f"than subtraction's in {_beyond(rises, 1, '.2f')}."
    )
    if not judged:
        return text
    title = WAYS[CHOSEN].title
    found = estimate(gains(cells, CHOSEN).values())
    over_none, over_paper = (
        estimate(gains(cells, CHOSEN, other).values()) for other in ("none", "uniform 0.1")
    )
    text = (
        f"{text}\n\nWhere subtraction leaves what is seen, {title} gains {found.written} JOD over "
        f"subtraction, {over_none.written} over nothing and {over_paper.written} over the paper's "
        f"weighting."
    )
    for kind, names in kinds(wanted).items():
        part = {place: ways for place, ways in cells.items() if place[0] in names}
        text += f" Of {kind}: {estimate(gains(part, CHOSEN).values()).written} over subtraction."
    text += _by_flip(cells)
    for what, values, bound, digits in (
        (
            f"it falls more than {SHORT:g} JOD short of the better of subtraction and nothing",
            shortfalls(cells, CHOSEN),
            SHORT,
            ".3f",
        ),
        (
            f"new artefacts cover more than {MOST_NEW:.0%} of the screen",
            news(cells, CHOSEN),
            MOST_NEW,
            ".1%",
        ),
    ):
        text += f"\n\nIn {_beyond(values, bound, digits)} {what}."
    return text


def _over_the_least(ways: Mapping[str, Cell], name: str) -> float:
    """Cost of a way over the least of others: for the chosen one, of those that it may project."""
    least = min(
        cell.cost
        for other, cell in ways.items()
        if other != name and (cell.allowed or name != CHOSEN)
    )
    return ways[name].cost / least if least > 0 else float(ways[name].cost > 0)


def _largest(what: str, values: Mapping[Place, float], bound: float, unit: str = "") -> Check:
    place = max(values, key=values.__getitem__)
    return at_most(f"{what} ({words(place)})", values[place], bound, unit)


def _hues(cells: Cells, way: str) -> list[float]:
    return [hue for hue in (ways[way].hue for ways in cells.values()) if hue is not None]


def _by_flip(cells: Cells) -> str:
    """What FLIP says."""
    found = [
        (ours.flip, plain.flip)
        for ours, plain in ((ways[CHOSEN], ways["subtractive"]) for ways in cells.values())
        if ours.flip is not None and plain.flip is not None
    ]
    if not found:
        return ""
    mine, other = np.mean(found, axis=0)
    better = sum(ours < plain for ours, plain in found)
    return (
        f"\n\nFLIP, which thinks of a desktop display, is {mine:.4f} on average ({other:.4f} with "
        f"subtraction), and less than with subtraction in {better} of {len(found)} cases."
    )


def _beyond(values: Mapping[Place, float], bound: float, digits: str) -> str:
    """In how many cases a figure is beyond its bound, and of which inputs."""
    beyond: dict[str, list[float]] = {}
    for (name, _, _), value in values.items():
        if value > bound:
            beyond.setdefault(name, []).append(value)
    text = f"{sum(map(len, beyond.values()))} of {len(values)} cases"
    if beyond:
        inputs = (
            f"{name} in {len(some)} of {sum(place[0] == name for place in values)}, up to "
            f"{format(max(some), digits)}"
            for name, some in beyond.items()
        )
        text += f" ({'; '.join(inputs)})"
    return text
