"""The page about a job: its progress, and its worst frames.

It is written anew every few seconds, whole, and asks the browser to load it again until the run has
ended. Beside it lie all figures as a table: ``frames.csv``, and ``frames.parquet`` where pyarrow is
installed (extra ``tables``); and the SHA-256 of all results, ``SHA256SUMS``.

A run of some of the frames (``--frames 1-12``) tells of these, in files of its own
(``report-1-12.html``): a farm's many runs neither overwrite each other's nor read all records.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, final
from urllib.parse import quote

from domesim.errors import InputError
from domesim.host.console import duration
from domesim.host.files import written_sums
from domesim.host.writing import write_whole
from domesim.light.ties import ascending
from domesim.shows.job import Job, versions
from domesim.shows.sealed import read_sealed
from domesim.shows.small import small_of
from domesim.shows.timeline import Clip, drawn, named
from domesim.shows.work import Column, Failed, Finished, Judged, Order

EVERY = 3.0
"""Seconds between two versions of the page."""

SHOWN = 50
"""Worst frames that the page names."""

_LONGEST = 60  # letters of a file's name that say which frames
_POINTS = 800  # of a curve
_WIDTH, _HEIGHT = 480, 48


@final
@dataclass(frozen=True)
class Curve:
    """A figure over all frames, as the page draws it: the worst of each few.

    All figures of one unit have one scale.
    """

    title: str
    unit: str
    points: str  # of an SVG polyline
    most: str
    mean: str
    worst: str  # the frame that has the worst


@final
class Report:
    """A run's page.

    Parameters
    ----------
    job
        Whose frames they are.
    orders
        Those of this run.
    what
        What is done, in one word.
    part
        As of `Show`.
    checked_last
        Those orders that were done before, if they are as they were.
    rate
        Frames a second.
    """

    def __init__(
        self,
        job: Job,
        orders: Sequence[Order],
        what: str,
        part: str = "",
        *,
        checked_last: Sequence[Order] = (),
        rate: float = 24.0,
    ) -> None:
        self._mark = f"-{part[:_LONGEST]}" if part else ""
        self.page = job.folder / f"report{self._mark}.html"
        self._job, self._orders, self._what = job, orders, what
        self._unchecked = {order.output[0].name for order in checked_last}
        self._recipe, self._writing = orders[0].recipe, orders[0].writing
        self._columns = self._recipe.columns()
        self._outcomes: dict[str, Finished | Failed] = {}
        self._began, self._written = time.time(), 0.0
        self._new, self._rate = 0, rate
        self.warnings: list[str] = []
        """What the last page warns of, one a line."""
        self.films: list[Clip] = []
        """Clips that were judged as films, the worst first."""
        self.film_note = ""
        """How far that may be believed."""
        self._drawn: dict[str, str] | None = None
        self._left_out: set[str] = set()
        self._films: dict[str, str] = {}

    def leave_out(self, names: Iterable[str]) -> None:
        """Leaves out results by the names of their records: the show has no such frames now."""
        self._left_out.update(names)
        self._drawn = None

    def add_films(self, sums: Mapping[Path, str]) -> None:
        """Adds the SHA-256 of videos that were made of the frames."""
        folder = self._job.folder
        self._films = {os.path.relpath(path, folder): digest for path, digest in sums.items()}

    def add(self, order: Order, outcome: Finished | Failed) -> None:
        """Adds a frame that has ended."""
        self._outcomes[order.output[0].name] = outcome
        self._drawn = None
        self._unchecked.discard(order.output[0].name)
        self._new += not (isinstance(outcome, Finished) and outcome.kept)
        if time.time() - self._written > EVERY:
            with suppress(InputError):  # reported when the run ends, if it still is so
                self._write("running")

    def interrupt(self) -> None:
        """Marks the run as ended early."""
        with suppress(InputError):  # the run's end is reported already
            self._end("stopped")

    def finish(self) -> Path:
        """All frames have ended; where the page is.

        Raises
        ------
        InputError
            If it, or a table, cannot be written.
        """
        self._end("ended")
        return self.page

    @property
    def rate(self) -> float:
        """Frames a second."""
        return self._rate

    def loss(self, order: Order) -> float | None:
        """Returns the first column of a frame; None if it is not done, or has none."""
        outcome = self._outcomes.get(order.output[0].name)
        figures = outcome.figures if isinstance(outcome, Finished) else {}
        value = figures.get(self._columns[0].key)
        return float(value) if isinstance(value, int | float) else None

    def worst(self, count: int) -> list[Order]:
        """Frames of this run that are done, those first whose first column is largest."""
        known = {order.output[0].name: order for order in self._orders}
        return [known[name] for name in self._ranked(self._done())[:count]]

    def _done(self) -> dict[str, dict[str, Any]]:
        """Figures of the frames that are done, in their order."""
        figures = {
            name: each.figures
            for name, each in self._outcomes.items()
            if isinstance(each, Finished)
        }
        return {name: figures[name] for name in sorted(figures, key=_natural)}

    def _ranked(self, rows: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Names of frames, those first whose first column is largest; equal ones in their order."""
        names, column = list(rows), self._columns[0].key
        order = ascending([-_number(rows[name].get(column)) for name in names])
        return [names[at] for at in order]

    def _end(self, state: str) -> None:
        rows, sums = self._rows()
        try:
            write_tables(self._job.folder / f"frames{self._mark}", list(rows.values()))
            write_whole(self._job.folder / f"SHA256SUMS{self._mark}", written_sums(sums))
        finally:
            self._write(state, rows)

    def _rows(self) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
        """Figures of this run's frames, and unless it is of a part, of the job's others, by the
        result's name; and the SHA-256 of their files.
        """
        rows: dict[str, dict[str, Any]] = {}
        sums: dict[str, dict[str, str]] = {}
        for place in () if self._mark else self._job.folder.glob("[!.]*.json"):
            name = place.name.removesuffix(".json")
            if name == "settings" or name in self._outcomes or name in self._left_out:
                continue
            with suppress(OSError, ValueError, LookupError, TypeError):
                kept = read_sealed(place)
                rows[name], sums[name] = dict(kept["figures"]), dict(kept["results"])
        for name, outcome in self._outcomes.items():
            if isinstance(outcome, Finished):
                rows[name], sums[name] = outcome.figures, outcome.results
        names = sorted(rows, key=_natural)
        together = {file: digest for name in names for file, digest in sums[name].items()}
        return {name: rows[name] for name in names}, together | self._films

    def _write(self, state: str, rows: Mapping[str, dict[str, Any]] | None = None) -> None:
        if rows is None:
            rows = self._done()
        ended = sum(isinstance(each, Finished) for each in self._outcomes.values())
        elapsed = time.time() - self._began
        left = len(self._orders) - len(self._outcomes) - len(self._unchecked)
        rate = self._new / elapsed if elapsed > 0 else 0.0
        ranked = self._ranked(rows)
        page = _template().render(
            what=self._what,
            state=state,
            every=round(EVERY),
            ended=ended,
            total=len(self._orders),
            beyond=len(rows) - ended,
            unchecked=len(self._unchecked),
            table=f"frames{self._mark}.csv",
            rate=rate,
            elapsed=duration(elapsed),
            now=time.strftime("%Y-%m-%d %H:%M:%S"),
            left=duration(left / rate) if rate else "",
            failed=[each.reason for each in self._outcomes.values() if isinstance(each, Failed)],
            unlike=unlike(rows.values()),
            columns=self._columns,
            curves=_curves(self._columns, rows),
            timeline=self._over_time(rows) if state != "running" else None,
            warnings=self.warnings,
            films=self.films,
            film_note=self.film_note,
            ends=[*rows][:1] + [*rows][-1:],
            verdicts=self._verdicts(rows.values()),
            about=self._recipe.about,
            small=self._recipe.small,
            worst=[self._row(name, rows[name]) for name in ranked[:SHOWN]],
            options=self._recipe.options(self._writing),
            settings=_settings(self._job),
            others=self._others(rows.values()),
            versions=versions(),
            size=(_WIDTH, _HEIGHT),
            shown=SHOWN,
        )
        self._written = time.time()
        write_whole(self.page, page.encode("utf-8", "replace"))

    def _over_time(self, rows: Mapping[str, dict[str, Any]]) -> dict[str, str] | None:
        """Draws the show over its time; None where there is nothing to draw."""
        if self._drawn is not None:
            return self._drawn
        names, self.warnings = list(rows), []
        numbers = [re.findall(r"\d+", Path(name).stem) for name in names]
        if not all(numbers):
            return None
        seconds = [int(each[-1]) / self._rate for each in numbers]
        frames = [rows[name] for name in names]
        with suppress(LookupError, TypeError, AttributeError):  # of another version
            if timeline := self._recipe.over_time(frames, seconds):
                self.warnings = [named(alarm, names) for alarm in timeline.alarms]
                self._drawn = {"svg": drawn(timeline, seconds), "note": timeline.note}
        return self._drawn

    def _others(self, rows: Iterable[Mapping[str, Any]]) -> list[tuple[int, str]]:
        """Counts frames that other settings than the job's made, each with its settings' file."""
        counts = Counter(str(row.get("settings", self._job.settings)) for row in rows)
        del counts[self._job.settings]
        return [
            (count, str(self._job.settings_file(digest).relative_to(self._job.folder)))
            for digest, count in counts.most_common()
        ]

    def _row(self, name: str, figures: Mapping[str, Any]) -> dict[str, Any]:
        compared = self._job.folder / page_name(name)
        output = figures.get("output", name)
        first = output if isinstance(output, str) else output[0]
        small = small_of(self._job.folder, name)
        return {
            "name": name,
            "link": self._link(first),
            "page": self._link(compared) if compared.exists() else "",
            "small": self._link(small) if small.exists() else "",
            "judged": self._judged(figures),
            "pictures": [
                (Path(path).stem.rpartition(".")[2], self._link(path))
                for path in figures.get("pictures", ())
            ],
            "cells": [column.shown(figures.get(column.key)) for column in self._columns],
        }

    def _link(self, path: str | Path) -> str:
        return quote(os.path.relpath(path, self._job.folder), errors="surrogateescape")

    def _judged(self, figures: Mapping[str, Any]) -> Judged | None:
        """Returns the recipe's verdict on a frame; none on one of another version."""
        with suppress(LookupError, TypeError):
            return self._recipe.judged(figures)
        return None

    def _verdicts(self, rows: Iterable[Mapping[str, Any]]) -> list[tuple[int, Judged]]:
        """How many frames have each verdict, those first that need most."""
        verdicts: dict[str, tuple[int, Judged]] = {}
        for judged in filter(None, map(self._judged, rows)):
            count = verdicts[judged.verdict][0] if judged.verdict in verdicts else 0
            verdicts[judged.verdict] = (count + 1, judged)
        return sorted(verdicts.values(), key=lambda each: (-each[1].needs, -each[0]))


def unlike(frames: Iterable[Mapping[str, Any]]) -> list[str]:
    """Tells of frames whose size or encoding is another than most have; nothing if all are alike.

    Parameters
    ----------
    frames
        Their figures.
    """
    kinds: dict[str, list[str]] = {}
    for figures in frames:
        size = _SIZE.match(str(figures.get("read", "")))
        meant = figures.get("encoding") or {}
        if size is not None:
            kind = f"{size[0]}, {meant.get('transfer')} {meant.get('primaries')}"
            kinds.setdefault(kind, []).append(_name(figures.get("input")))
    most = max(kinds, key=lambda kind: len(kinds[kind]), default="")
    return [
        f"{names[0]}{f' and {len(names) - 1} more' if names[1:] else ''}: {kind}; the others {most}"
        for kind, names in kinds.items()
        if kind != most
    ]


def _name(files: Any) -> str:
    """The name of the first of a frame's files."""
    return Path(files[0] if isinstance(files, list) else str(files)).name


_SIZE = re.compile(r"(?:2 x )?\d+ x \d+")


def page_name(output: str) -> str:
    """Name of the page that compares a frame's methods."""
    return f"compare-{output}.html"


def write_tables(stem: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """All figures that are one number or text, as ``STEM.csv`` and ``STEM.parquet``.

    Raises
    ------
    InputError
        If they cannot be written.
    """
    flat = [_flat(row) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names)
    writer.writeheader()
    writer.writerows(flat)
    content = text.getvalue().encode("utf-8", "surrogateescape")
    write_whole(stem.with_name(f"{stem.name}.csv"), content)
    with suppress(ImportError):
        import pyarrow as pa  # noqa: PLC0415
        from pyarrow import parquet  # noqa: PLC0415

        table = pa.Table.from_pylist([{name: row.get(name) for name in names} for row in flat])
        sink = pa.BufferOutputStream()
        parquet.write_table(table, sink)
        write_whole(stem.with_name(f"{stem.name}.parquet"), sink.getvalue().to_pybytes())


def _flat(row: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Left and right as two columns, what is nested with its names joined."""
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, dict):
            flat.update(_flat(value, f"{above}{name}."))
        elif isinstance(value, list):
            if len(value) <= 4 and not any(isinstance(each, list | dict) for each in value):
                flat.update({f"{above}{name}.{k + 1}": each for k, each in enumerate(value)})
        else:
            flat[f"{above}{name}"] = value
    return flat


def _curves(columns: Sequence[Column], rows: Mapping[str, Mapping[str, Any]]) -> list[Curve]:
    """One for each figure that is known of some frame and not all 0."""
    values = {
        column: {name: _number(row.get(column.key)) for name, row in rows.items()}
        for column in columns
    }
    tops = {
        unit: max((v for c, each in values.items() if c.unit == unit for v in each.values()))
        for unit in ({column.unit for column in columns} if rows else set())
    }
    return [
        _curve(column, each, tops[column.unit])
        for column, each in values.items()
        if any(value > 0 for value in each.values())
    ]


def _curve(column: Column, values: Mapping[str, float], top: float) -> Curve:
    """The worst of each few frames, from left to right."""
    known = {name: value for name, value in values.items() if math.isfinite(value)}
    worst_of = min if column.less else max
    in_order = list(values.values())
    step = -(-len(in_order) // _POINTS)
    parts = (in_order[k : k + step] for k in range(0, len(in_order), step))
    peaks = [worst_of(filter(math.isfinite, part), default=-math.inf) for part in parts]
    peaks *= 2 if len(peaks) == 1 else 1  # a point has no length
    across = _WIDTH / (len(peaks) - 1)
    points = " ".join(
        f"{k * across:.1f},{_HEIGHT * (1 - max(peak, 0) / top):.1f}"
        for k, peak in enumerate(peaks)
        if math.isfinite(peak)
    )
    mean, worst = sum(known.values()) / len(known), worst_of(known, key=lambda name: known[name])
    shown = column.shown(known[worst]), column.shown(mean)
    return Curve(column.title, column.unit, points, *shown, worst)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else -math.inf


def _natural(name: str) -> list[Any]:
    """A key that sorts frame 9 before frame 10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _settings(job: Job) -> dict[str, Any]:
    with suppress(OSError, ValueError):
        settings: dict[str, Any] = json.loads((job.folder / "settings.json").read_text())
        return settings
    return {}


def _template() -> Any:
    from jinja2 import Environment, StrictUndefined  # noqa: PLC0415

    environment = Environment(autoescape=True, undefined=StrictUndefined)
    place = files("domesim.shows") / "report.html.j2"
    return environment.from_string(place.read_text("utf-8"))
