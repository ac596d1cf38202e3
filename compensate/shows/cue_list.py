"""A show's knobs: what a person's cue list says of each frame.

A cue list is a table (CSV) of a row for each part of a show: its ``first`` and ``last`` frame, by
number or by a file's name; and, if they differ from the command's own, ``method``, ``lift`` and
``ramp``, the number of frames in which the lift goes to the cue's from that of the frame before.
Other columns, such as those that ``--method auto`` writes, are for the reader.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, final

from compensate.aim.settings import MOST_LIFT
from domesim.errors import InputError, reason
from domesim.host.files import read_plain
from domesim.host.texts import text_in
from domesim.shows.sequences import number_of

COLUMNS = ("first", "last", "method", "lift", "ramp")
CANDIDATES = ("perceptual", "subtractive", "none")
"""Methods that a show's parts may have; of equal ones ``--method auto`` takes the first."""


@final
@dataclass(frozen=True)
class Knobs:
    """What a part of a show gets.

    Parameters
    ----------
    first, last
        Numbers of its frames.
    method
        None for the command's own.
    lift
        None for the command's own.
    ramp
        Frames in which the lift comes to be that.
    """

    first: int
    last: int
    method: str | None = None
    lift: float | None = None
    ramp: int = 0


@final
@dataclass(frozen=True)
class CueList:
    """The cues of a show.

    Parameters
    ----------
    name
        Of its file.
    cues
        In order; none overlaps another.
    """

    name: str
    cues: tuple[Knobs, ...]

    @property
    def lifts(self) -> bool:
        """Whether it says any lift."""
        return any(cue.lift is not None for cue in self.cues)

    def at(self, number: int) -> Knobs | None:
        """The cue of a frame; None of one that has none."""
        return next((cue for cue in self.cues if cue.first <= number <= cue.last), None)

    def method(self, number: int, usual: str) -> str:
        """The method of a frame, `usual` where the list says nothing."""
        cue = self.at(number)
        return usual if cue is None else cue.method or usual

    def lift(self, number: int, usual: float) -> float:
        """The lift of a frame, `usual` where the list says nothing."""
        cue = self.at(number)
        if cue is None:
            return usual
        lift = usual if cue.lift is None else cue.lift
        done = (number - cue.first + 1) / (cue.ramp + 1)
        if done >= 1:
            return lift
        before = self.lift(cue.first - 1, usual)
        return before + done * (lift - before)

    def settings(self) -> list[list[Any]]:
        """What results depend on."""
        return [list(vars(cue).values()) for cue in self.cues]


def read_cue_list(path: Path) -> CueList:
    """Reads a cue list.

    Parameters
    ----------
    path
        The table.

    Returns
    -------
    cues
        In order of their frames.

    Raises
    ------
    InputError
        If it is no such table, or its cues overlap.
    """
    try:
        head, *rows = csv.reader(text_in(read_plain(path)).splitlines())
    except (OSError, ValueError, csv.Error) as error:
        why = reason(error) if isinstance(error, OSError) else "no text in lines"
        raise InputError(f"{path}: wanted a cue list (CSV), got '{why}'. Check the path") from None
    named = [name.strip().lower() for name in head]
    if not {"first", "last"} <= set(named) or not rows:
        raise InputError(
            f"{path}: wanted a table (CSV) with the columns first and last, and as wanted "
            f"{', '.join(COLUMNS[2:])}, got '{', '.join(named)}'"
        )
    cues = []
    for line, row in enumerate(rows, 2):
        cells = {name: cell.strip() for name, cell in zip(named, row, strict=False)}
        if any(cells.values()):
            cues.append(_knobs(f"{path}, line {line}", cells))
    cues.sort(key=lambda cue: cue.first)
    for cue, other in pairwise(cues):
        if cue.last >= other.first:
            raise InputError(
                f"{path}: wanted cues that do not overlap, got {cue.first} to {cue.last} and "
                f"{other.first} to {other.last}"
            )
    return CueList(path.name, tuple(cues))


def _knobs(where: str, cells: Mapping[str, str]) -> Knobs:
    method = cells.get("method") or None
    if method is not None and method not in CANDIDATES:
        raise InputError(
            f"{where}: method {method!r} is not known; use one of {', '.join(CANDIDATES)}"
        )
    first, last = (_frame(where, name, cells.get(name, "")) for name in ("first", "last"))
    if last < first:
        raise InputError(f"{where}: wanted a last frame from {first} on, got {last}")
    lift = _number(where, "lift", cells.get("lift", ""), 0, MOST_LIFT)
    ramp = _number(where, "ramp", cells.get("ramp", ""), 0, 10**6)
    return Knobs(first, last, method, lift, 0 if ramp is None else round(ramp))


def _frame(where: str, name: str, text: str) -> int:
    """A frame's number, as such or in its file's name."""
    number = int(text) if text.isdecimal() else number_of(Path(text))
    if number is None:
        raise InputError(f"{where}: wanted a frame's number or name as {name}, got '{text}'")
    return number


def _number(where: str, name: str, text: str, least: float, most: float) -> float | None:
    if not text:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise InputError(f"{where}: {name} must lie between {least:g} and {most:g}, got '{text}'")
    return value
