"""Figures of a show over its time, as a drawing for the report."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any, final

Line = Sequence[float | None]
"""A figure at each frame; None where it is not known."""


@final
@dataclass(frozen=True)
class Panel:
    """Figures of one unit.

    Parameters
    ----------
    label
        What they are, with their unit.
    lines
        Name -> the figure at each frame.
    limit
        Figures above it are warned of.
    from_zero
        Whether 0 is shown.
    """

    label: str
    lines: Mapping[str, Line]
    limit: float | None = None
    from_zero: bool = True


@final
@dataclass(frozen=True)
class Alarm:
    """Frames that somebody should look at.

    Parameters
    ----------
    first, last
        Places of the first frame and of the last.
    why
        A clause, for a person.
    """

    first: int
    last: int
    why: str


@final
@dataclass(frozen=True)
class Timeline:
    """A show over its time.

    Parameters
    ----------
    panels
        From top to bottom.
    alarms
        In order.
    note
        What the figures are, in sentences.
    """

    panels: Sequence[Panel]
    alarms: Sequence[Alarm] = ()
    note: str = ""


@final
@dataclass(frozen=True)
class Clip:
    """Consecutive frames, judged as a film.

    Parameters
    ----------
    first, last
        Names of its first frame and of its last.
    start
        Seconds from the show's first frame.
    lost
        JOD lost, by what is shown.
    """

    first: str
    last: str
    start: float
    lost: Mapping[str, float]


def runs(marked: Sequence[bool]) -> Iterator[tuple[int, int]]:
    """Finds where marks follow one another: places of the first and the last of each run."""
    first = None
    for place, mark in enumerate([*marked, False]):
        if mark and first is None:
            first = place
        elif not mark and first is not None:
            yield first, place - 1
            first = None


def drawn(timeline: Timeline, seconds: Sequence[float]) -> str:
    """Draws it.

    Parameters
    ----------
    timeline
        What is drawn.
    seconds
        Time of each frame.

    Returns
    -------
    svg
        An SVG element in the text's colour.
    """
    import matplotlib as mpl  # noqa: PLC0415 - slow to import
    from matplotlib.figure import Figure  # noqa: PLC0415

    frame = seconds[1] - seconds[0] if len(seconds) > 1 else 1.0
    names = dict.fromkeys(name for panel in timeline.panels for name in panel.lines)
    colours = dict(zip(names, cycle(_COLOURS), strict=False))
    with mpl.rc_context(
        {
            "svg.hashsalt": "domesim",
            "svg.fonttype": "none",
            "font.size": 9,
            "text.color": _TEXT,
            "axes.edgecolor": _TEXT,
            "axes.labelcolor": _TEXT,
            "xtick.color": _TEXT,
            "ytick.color": _TEXT,
        }
    ):
        figure = Figure((10.4, 1.8 * len(timeline.panels) + 0.4), layout="constrained")
        figure.patch.set_alpha(0)
        grid = figure.subplots(len(timeline.panels), 1, squeeze=False, sharex=True)[:, 0]
        for axes, panel in zip(grid, timeline.panels, strict=True):
            axes.patch.set_alpha(0)
            axes.spines[["top", "right"]].set_visible(False)
            for name, line in panel.lines.items():
                times, values = _thinned(seconds, line)
                axes.plot(times, values, color=colours[name], label=name, linewidth=1.6)
            if panel.limit is not None:
                axes.axhline(panel.limit, color=_BAD, linewidth=1, linestyle="--")
            for alarm in timeline.alarms:
                ends = seconds[alarm.first] - frame / 2, seconds[alarm.last] + frame / 2
                axes.axvspan(*ends, color=_BAD, alpha=0.22, linewidth=0)
            if panel.from_zero:
                begin_at_zero(axes)
            axes.set_ylabel(panel.label)
            if len(panel.lines) > 1:
                axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
        grid[-1].set_xlabel("seconds")
        grid[-1].margins(x=0.01)
        memory = io.StringIO()
        figure.savefig(
            memory, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type"))
        )
    drawing = memory.getvalue()
    return drawing[drawing.index("<svg") :].replace(_TEXT, "currentColor")


def begin_at_zero(axes: Any) -> None:
    """Shows 0 and a little more than the most: a line that never changes would lie on the frame.

    Parameters
    ----------
    axes
        Matplotlib's, with all of its lines.
    """
    most = float(axes.dataLim.y1)
    axes.set_ylim(0, 1.05 * most if most > 0 else 1)


def _thinned(seconds: Sequence[float], line: Line) -> tuple[list[float], list[float]]:
    """Least and most of each few frames of a long show."""
    values = [math.nan if value is None else value for value in line]
    step = -(-len(values) // _POINTS)
    if step == 1:
        return list(seconds), values
    times: list[float] = []
    ends: list[float] = []
    for start in range(0, len(values), step):
        part = [value for value in values[start : start + step] if math.isfinite(value)]
        times += [seconds[start]] * 2
        ends += [min(part), max(part)] if part else [math.nan] * 2
    return times, ends


def named(alarm: Alarm, names: Sequence[str]) -> str:
    """Tells of an alarm, with the names of its frames."""
    first, last = names[alarm.first], names[alarm.last]
    return f"{first if first == last else f'{first} to {last}'}: {alarm.why}"


_POINTS = 500  # of a line that are drawn one by one
_TEXT = "#010203"  # stands for the page's own text colour
_BAD = "#d9534a"
_COLOURS = ("#8b929e", "#e08a2e", "#3f8fd8", "#3fa56b")
