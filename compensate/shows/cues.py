"""A cue list: which method a show's shots get, so that no frame looks worse than untouched.

All frames are looked at in small before any is done: what ColorVideoVDP takes from each (the
ruler), untouched, subtracted, and by the aim. A shot gets one method, so that nothing flickers:
of those that are worse than untouched in none of its frames, the one that loses least on average.

A cut is where a picture changes by more than `CUT`, and twice as much as before and after: neither
motion, nor a fade, nor a flash. Pictures are compared in `GRID` x `GRID` parts of each view, by the
cube root of their luminance. Where a cut is missed, two shots share the more cautious choice.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, final

import numpy as np

from compensate.pose import Eye, Posed, Stage
from compensate.ruler import whole_block_of
from compensate.shows.cue_list import CANDIDATES, CueList, Knobs
from compensate.shows.titles import Titles
from domesim.frames import Master
from domesim.frames.video import video_of
from domesim.host.console import Console
from domesim.host.writing import prepare_folder, write_whole
from domesim.light.planes import gathered
from domesim.scene.choice import SceneChoice
from domesim.scene.screening import averaged_on_screen
from domesim.shows.job import FOLDER, make_folder
from domesim.shows.run import Running, crew_of, figures_of_all, orders_of
from domesim.shows.sequences import number_of
from domesim.shows.show import Show
from domesim.shows.work import Column, Note, Recipe, Work, Write, Writing

AUTO = "auto"
"""Name of the choice among `CANDIDATES`."""
CUT = 0.05
"""Least mean change of a picture's cube root at a cut, of white's."""
GRID = 8
ALIKE = 0.001
"""JOD by which a method may be worse than untouched: what the ruler's rounding comes to."""
CUES = "cues.csv"
"""The cue list's file, in a job's folder."""


@final
@dataclass(frozen=True)
class Cue:
    """A shot, and what it gets.

    Parameters
    ----------
    first, last
        Its first and last master, by the file's name.
    frames
        How many it has.
    method
        One of `CANDIDATES`.
    lost
        Mean of what its frames lose by each of them, JOD.
    worst
        By how much a frame is worse than untouched, at most, by each of them, JOD.
    """

    first: str
    last: str
    frames: int
    method: str
    lost: Mapping[str, float]
    worst: Mapping[str, float]


def chosen(lost: Sequence[Mapping[str, float]]) -> str:
    """Chooses the method of a shot from what its frames lose by each."""
    fit = [
        method
        for method in CANDIDATES
        if all(frame[method] <= frame["none"] + ALIKE for frame in lost)
    ]
    return min(fit, key=lambda method: sum(frame[method] for frame in lost))


def shots(signatures: Sequence[Sequence[float]]) -> list[range]:
    """Parts a show into shots by what `signature` says of its frames."""
    if not signatures:
        return []
    steps = np.abs(np.diff(np.asarray(signatures, np.float64), axis=0)).mean(axis=1)
    around = np.pad(steps, 1)
    known = np.pad(np.ones_like(steps), 1)
    before_and_after = (around[:-2] + around[2:]) / np.maximum(known[:-2] + known[2:], 1)
    cuts = np.flatnonzero((steps > CUT) & (steps > 2 * before_and_after)) + 1
    ends = [0, *cuts.tolist(), len(signatures)]
    return [range(begin, end) for begin, end in pairwise(ends)]


def signature(posed: Posed) -> list[float]:
    """Returns cube roots of the master's luminance in parts of each view, 1 = white."""
    light = gathered(posed.planes, posed.desired.shape)  # titles are no cuts
    luminance = posed.scene.projector.luminance(light) / posed.scene.projector.white
    means = [
        part.mean()
        for view in luminance
        for rows in np.array_split(view, GRID)
        for part in np.array_split(rows, GRID, axis=1)
        if part.size
    ]
    return [float(each) for each in np.cbrt(np.maximum(means, 0))]


@final
@dataclass(frozen=True)
class Looking(Recipe):
    """Tells what each frame loses by each method, in small; nothing is written.

    Parameters
    ----------
    scene
        The theatre, or stereo system.
    eye
        What the aim is made for.
    titles
        What a server composites over the frames; None for nothing.
    """

    scene: SceneChoice
    eye: Eye
    titles: Titles | None = None

    def work(self, note: Note) -> Work[Any, Any]:
        """See `Recipe`."""
        from compensate.report_card import losses  # noqa: PLC0415 - slow to load

        theatre = self.scene.load()
        stage = Stage(theatre, self.eye)

        def prepare(source: Master) -> Posed:
            step = whole_block_of(*source.frames[0].pixels.shape[:2])
            overlay = None if self.titles is None else self.titles.of(source, theatre)
            small = None if overlay is None else overlay.in_small(step)
            return stage.pose(averaged_on_screen(source, theatre, step), small)

        def solve(posed: Posed) -> tuple[dict[str, float], list[float]]:
            return losses(posed), signature(posed)

        def end(
            found: tuple[dict[str, float], list[float]], write: Write
        ) -> tuple[dict[str, Any], str]:
            return {"lost": found[0], "signature": found[1]}, ""

        return Work(prepare, solve, end)

    def settings(self) -> dict[str, Any]:
        """See `Recipe`."""
        overlay = {} if self.titles is None else {"overlay": self.titles.settings()}
        return {"command": "look", **self.scene.settings(), "eye": repr(self.eye), **overlay}

    def columns(self) -> tuple[Column, ...]:
        """See `Recipe`."""
        return ()

    def memory(self, rows: int, cols: int) -> int:
        """See `Recipe`."""
        return 500_000_000 + 40 * 4 * rows * cols


def cued(
    show: Show,
    folder: Path,
    recipe: Looking,
    console: Console,
    *,
    writing: Writing,
    running: Running,
) -> list[Cue]:
    """Makes the cue list of a whole show, or reads the one that was made for the same files.

    Parameters
    ----------
    show
        All of its frames.
    folder
        Where results go; of a sequence the list lies beside their records.
    recipe
        How each frame is looked at.
    console
        Who is told.
    writing, running
        How masters are read, and by whom.

    Returns
    -------
    cues
        In order.

    Raises
    ------
    InputError
        If a master cannot be read.
    """
    place, key = folder / FOLDER / CUES, _key(show, recipe)
    if show.numbered and (found := _read(place, key)):
        console.say(f"{place} (made before)", *map(told, found))
        return found
    outputs = show.outputs(folder, None)
    orders = orders_of(show, outputs, recipe, Writing(repair=writing.repair))
    frames = figures_of_all(orders, crew_of(running, recipe, show), console, "looking")
    cues = [
        _cue(show, part, [frames[k]["lost"] for k in part])
        for part in shots([frame["signature"] for frame in frames])
    ]
    if show.numbered:
        prepare_folder(folder)
        make_folder(place.parent)
        write_whole(place, _written(cues, key).encode())
        console.say(f"-> {place}")
    console.say(*map(told, cues))
    return cues


def told(cue: Cue) -> str:
    """Says what a shot gets, and why."""
    frames = cue.first if cue.frames == 1 else f"{cue.first} to {cue.last}"
    return f"{frames}: {cue.method} (JOD lost: {lost_by(cue.lost)})"


def lost_by(lost: Mapping[str, float]) -> str:
    """Says what each of `CANDIDATES` loses."""
    return ", ".join(f"{_TITLES[method]} {lost[method]:.3f}" for method in CANDIDATES)


_TITLES = {"perceptual": "the aim", "subtractive": "subtracted", "none": "untouched"}


def listed(cues: Iterable[Cue]) -> CueList:
    """Returns cues as a person would list them."""

    def number(name: str) -> int:
        return number_of(Path(name)) or 0

    return CueList(CUES, tuple(Knobs(number(c.first), number(c.last), c.method) for c in cues))


def _cue(show: Show, part: range, lost: Sequence[Mapping[str, float]]) -> Cue:
    first, last = (show.moments[k][0].name for k in (part[0], part[-1]))
    means = {method: float(np.mean([each[method] for each in lost])) for method in CANDIDATES}
    worst = {method: max(each[method] - each["none"] for each in lost) for method in CANDIDATES}
    return Cue(first, last, len(part), chosen(lost), means, worst)


def _key(show: Show, recipe: Looking) -> str:
    """What the list depends on: settings, and names, sizes and times of all files."""
    files = {video_of(path) or path for moment in show.moments for path in moment}
    seen = []
    for path in sorted(files):
        with suppress(OSError):  # whoever reads it will say so
            status = path.stat()
            seen.append((path.name, status.st_size, status.st_mtime_ns))
    content = [
        recipe.settings(),
        seen,
        [str(each) for each in (show.packing, show.layer, show.colour)],
    ]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


_HEAD = ("first", "last", "frames", "method")


def _written(cues: Sequence[Cue], key: str) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns = [f"{kind}_{method}" for kind in ("lost", "worst") for method in CANDIDATES]
    writer.writerow([*_HEAD, *columns, key])
    for cue in cues:
        figures = [each[method] for each in (cue.lost, cue.worst) for method in CANDIDATES]
        writer.writerow([cue.first, cue.last, cue.frames, cue.method, *map(repr, figures), ""])
    return text.getvalue()


def _read(place: Path, key: str) -> list[Cue]:
    """The list that was made with that key; nothing if there is none."""
    with suppress(OSError, ValueError, LookupError):
        head, *rows = csv.reader(place.read_text("utf-8").splitlines())
        if head[-1] == key:
            return [_of_row(row) for row in rows]
    return []


def _of_row(row: Sequence[str]) -> Cue:
    first, last, frames, method, *figures = row
    values = [float(each) for each in figures[:-1]]
    count = len(CANDIDATES)
    lost, worst = (dict(zip(CANDIDATES, values[k : k + count], strict=True)) for k in (0, count))
    return Cue(first, last, int(frames), method, lost, worst)
