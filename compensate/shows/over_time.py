"""A show's black over its time: where what is reflected into it moves visibly.

The darker half of a frame (`compensate.plain`) is black, or nearly, in the master. What is bright
elsewhere is reflected into it, so it moves while a planet rises. It is warned of where it moves by
a visible step (`compensate.vision.flicker`), and the master's own does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from compensate.vision.flicker import LONGEST, SOURCE, steps
from domesim.host.numbers import decimal
from domesim.shows.timeline import Alarm, Line, Panel, Timeline, runs

STEP = 1.0
"""Visible steps that are warned of."""


def timeline(
    dark: Sequence[Mapping[str, Any] | None], seconds: Sequence[float], names: Mapping[str, str]
) -> Timeline | None:
    """Draws black, lift and stars over time, and finds where black moves visibly.

    Parameters
    ----------
    dark
        Figures of each frame, as of `compensate.figures.Dark`; None where they are not known.
    seconds
        Time of each frame.
    names
        What is drawn besides the master: a key of `dark` -> its name. The last is what is shown.

    Returns
    -------
    timeline
        None where fewer than two frames are known.
    """
    known = [place for place, each in enumerate(dark) if each]
    if len(known) < 2:
        return None

    def line(key: str) -> Line:
        return [each.get(key) if each else None for each in dark]

    every = {"master": "master", **names}
    lifts = {name: _less(line(key), line("master")) for key, name in names.items()}
    moved = {name: _moved(line(key), seconds, known) for key, name in every.items()}
    stars = {name: line(f"star_{key}") for key, name in every.items()}
    panels = [
        Panel("black, cd/m²", {name: line(key) for key, name in every.items()}),
        Panel("lift of black, cd/m²", lifts),
        Panel("black moves,\nvisible steps", moved, limit=STEP),
    ]
    if any(value is not None for each in stars.values() for value in each):
        panels.append(Panel("faintest star, mag", stars, from_zero=False))
    return Timeline(panels, _alarms(moved), _NOTE)


_NOTE = (
    "Black is the mean luminance of the darker half of a frame, its lift is what it has more than "
    f"the master's. It moves by a visible step where it changes, within {1000 * LONGEST:.0f} ms, "
    f"by as much as flicker of a wide field without edges must have to be seen ({SOURCE}). "
    "Frames are marked where that happens and the master's own black does not move so. Stars: "
    "Crumey 2014, F = 2."
)


def _less(line: Line, other: Line) -> Line:
    return [
        None if one is None or two is None else one - two
        for one, two in zip(line, other, strict=True)
    ]


def _moved(line: Line, seconds: Sequence[float], known: Sequence[int]) -> Line:
    """Visible steps of each known frame."""
    light = [float(line[place] or 0) for place in known]
    moved: list[float | None] = [None] * len(line)
    for place, each in zip(known, steps([seconds[place] for place in known], light), strict=True):
        moved[place] = each
    return moved


def _alarms(moved: Mapping[str, Line]) -> list[Alarm]:
    """Where what is shown, the last, moves visibly, and the master, the first, does not."""
    master, *_, shown = moved.values()
    marked = [(one or 0) >= STEP > (own or 0) for one, own in zip(shown, master, strict=True)]
    alarms = []
    for first, last in runs(marked):
        most = max(each or 0 for each in shown[first : last + 1])
        steps = decimal(most, 2)
        told = "a visible step" if steps == "1" else f"{steps} visible steps"
        alarms.append(Alarm(first, last, f"black moves by up to {told} ({SOURCE})"))
    return alarms
