"""A colorimeter's readings: which projector showed what, through which filter of the eyewear.

Columns of the file (CSV, or TOML sections [[reading]]; see ``tables``), but for ``.ti3`` (see
``ti3``):

    projector   left, right             whose picture it was; the other one black or off
    filter      left, right, none       the eyewear's filter before the meter
    channel     R, G, B, W, K           full-screen colour; K is black
    level       0..1                    code value; if absent, 1, and 0 for K
    X, Y, Z     cd/m²                   Y is luminance; or x, y and one of
    Y, Lv       cd/m²                   luminance, beside x and y
    fL                                  the same in foot-lamberts
    note                                anything

Rows of the same projector, filter, channel and level are repeats. A table without projector and
filter is one display, seen without eyewear. Rows of R, G, B or W at level 0 are readings of black.

A TOML file may name a table for each session instead, in sections [[table]] with projector, filter
and file (from the TOML file's folder): such as the four ``.ti3`` of a stereo pair.
"""

from __future__ import annotations

import tomllib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.host.numbers import decimal
from domesim.host.texts import toml_in
from domesim.readings.noise import Noise, estimated_noise
from domesim.readings.tables import Mistakes, Row, Table, read_table, text_of
from domesim.readings.ti3 import ti3_table

Floats = NDArray[np.float64]
Black = Literal["included", "subtracted"]

CHANNELS = ("R", "G", "B", "W", "K")
EYES = ("left", "right")
DISPLAY = "display"
"""Name of the projector in a table that names none."""
NO_FILTER = "none"

BRIGHTEST = 1e6
"""cd/m²: what is brighter is in another unit."""
NOT_LIGHT = "the unit is cd/m², and no light is negative; measure again"
FOOT_LAMBERT = 1 / (np.pi * 0.3048**2)
"""cd/m²: by the foot of 0.3048 m."""
CONFLICT = 0.2
"""Repeats that differ by more than this share of the brighter are no repeats."""
CONFLICT_FLOOR = 0.05
"""... if they also differ by more than this, cd/m²: black is mostly noise."""


@final
@dataclass(frozen=True)
class Reading:
    """One row: `xyz` (3,) in cd/m², of a `channel` at a code value `level`, and its line."""

    projector: str
    through: str
    channel: str
    level: float
    xyz: tuple[float, float, float]
    line: int


@final
@dataclass(frozen=True, eq=False)
class Mean:
    """The mean of repeats, its variance, and the lines that it comes from.

    Parameters
    ----------
    channel, level
        What was shown, and its code value.
    xyz, variance
        (3,) cd/m², and the square of the standard error.
    lines
        Line numbers in the file.
    """

    channel: str
    level: float
    xyz: Floats
    variance: Floats
    lines: tuple[int, ...]

    @property
    def place(self) -> str:
        """``R at level 0.5``."""
        return self.channel if self.channel in "WK" else f"{self.channel} at level {self.level:g}"


@final
@dataclass(frozen=True, eq=False)
class Session:
    """All readings of one projector through one filter.

    Parameters
    ----------
    source, projector, through
        The file, whose picture, which filter.
    black
        Whether the readings hold the black, or it was subtracted from them already.
    means
        By channel, rising in level; K has one.
    """

    source: str
    projector: str
    through: str
    black: Black
    means: Mapping[str, tuple[Mean, ...]]

    @property
    def name(self) -> str:
        """``left projector through right filter``."""
        if self.projector == DISPLAY:
            return "display"
        seen = "no filter" if self.through == NO_FILTER else f"{self.through} filter"
        return f"{self.projector} projector through {seen}"

    @property
    def dark(self) -> Mean | None:
        """The reading of black."""
        return self.means["K"][0] if "K" in self.means else None

    def full(self, channel: str) -> Mean | None:
        """Returns the reading of a channel at level 1."""
        means = self.means.get(channel, ())
        return means[-1] if means and means[-1].level == 1 else None

    def net(self, mean: Mean) -> Floats:
        """(3,) XYZ of a reading without black, cd/m²."""
        if self.black == "subtracted" or self.dark is None:
            return mean.xyz
        return np.asarray(mean.xyz - self.dark.xyz)

    @property
    def dark_variance(self) -> Floats:
        """(3,) variance that subtracting black adds to each net reading, (cd/m²)²."""
        if self.black == "subtracted" or self.dark is None:
            return np.zeros(3)
        return self.dark.variance


@final
@dataclass(frozen=True)
class Readings:
    """A file of readings.

    Parameters
    ----------
    source
        The file's name, for messages.
    rows
        Its rows.
    black
        ``included`` in the readings of colours, or ``subtracted`` from them already.
    noise
        Noise of one reading.
    files
        All that was read.
    left_out, unread
        How many rows of mixed colours, and how many that were not filled in.
    """

    source: str
    rows: tuple[Reading, ...]
    black: Black
    noise: Noise
    files: tuple[Path, ...] = ()
    left_out: int = 0
    unread: int = 0

    @property
    def sessions(self) -> tuple[tuple[str, str], ...]:
        """(projector, filter) of all sessions, in the file's order."""
        return tuple(dict.fromkeys((row.projector, row.through) for row in self.rows))

    def session(self, projector: str, through: str) -> Session:
        """All readings of one projector through one filter.

        Raises
        ------
        InputError
            If there are none.
        """
        by_level: dict[str, dict[float, list[Reading]]] = defaultdict(lambda: defaultdict(list))
        for row in self.rows:
            if (row.projector, row.through) == (projector, through):
                by_level[row.channel][row.level].append(row)
        if not by_level:
            held = ", ".join("/".join(session) for session in self.sessions)
            raise InputError(
                f"{self.source}: no reading of projector {projector} through filter {through}; "
                f"there are {held}"
            )
        means = {
            channel: tuple(self._mean(levels[level]) for level in sorted(levels))
            for channel, levels in by_level.items()
        }
        return Session(self.source, projector, through, self.black, means)

    def _mean(self, rows: list[Reading]) -> Mean:
        xyz = np.mean([row.xyz for row in rows], axis=0)
        variance = self.noise.variance(xyz, len(rows))
        lines = tuple(row.line for row in rows)
        return Mean(rows[0].channel, rows[0].level, xyz, variance, lines)


def read_readings(
    path: str | Path, *, black: Black | None = None, noise: Noise | None = None
) -> Readings:
    """Reads a file of readings.

    Parameters
    ----------
    path
        A ``.csv``, ``.toml`` or ``.ti3`` file.
    black
        Whether readings of colours hold the black. If None, what the file says (TOML key
        ``black``), or ``included``.
    noise
        Noise of one reading. If None, what repeats show, or 1 % and 0.001 cd/m² where they are few.

    Raises
    ------
    InputError
        If the file cannot be read, or with all its mistakes, each with its line.
    """
    path = Path(path)
    if path.suffix.lower() == ".toml":
        named = _named_tables(path)
        if named:
            return _of_tables(path, named, black, noise)
    table = read_table(path, {".ti3": ti3_table})
    paired = ("projector", "filter") if table.columns & {"projector", "filter"} else ()
    light = _light_columns(table)
    known = ("projector", "filter", "channel", "level", *light, "note")
    table.require(known, (*paired, "channel", *light))
    filled = table.filled(light)
    readings = [reading for row in filled if (reading := _reading(table, row))]
    if not table.rows:
        table.mistakes.add(0, "wanted rows of readings, got none")
    black = _black(table) if black is None else black
    _note_conflicts(readings, table.mistakes)
    table.mistakes.raise_any()
    if noise is None:
        noise = estimated_noise(_repeats(readings), Noise())
    return Readings(
        table.mistakes.source,
        tuple(readings),
        black,
        noise,
        (path,),
        table.left_out,
        len(table.rows) - len(filled),
    )


def _named_tables(path: Path) -> list[dict[str, Any]]:
    """Returns the sections [[table]] of a TOML file; none of any other."""
    try:
        sections = toml_in(text_of(path)).get("table", [])
    except tomllib.TOMLDecodeError:
        return []
    wanted = {"projector": EYES, "filter": (*EYES, NO_FILTER)}
    for number, section in enumerate(sections, 1):
        where = f"{path}: [[table]] {number}"
        if not isinstance(section, dict) or set(section) != {*wanted, "file"}:
            raise InputError(f"{where} must have projector, filter and file")
        for key, allowed in wanted.items():
            if section[key] not in allowed:
                raise InputError(
                    f"{where}: {key} must be {' or '.join(allowed)}, got {section[key]!r}"
                )
        if not isinstance(section["file"], str):
            raise InputError(f"{where}: file must be a path, got {section['file']!r}")
    return list(sections)


def _of_tables(
    path: Path, named: list[dict[str, Any]], black: Black | None, noise: Noise | None
) -> Readings:
    """One table of several, each one session."""
    rows: list[Reading] = []
    blacks, files, left_out = set(), [path], 0
    for section in named:
        file = path.parent / section["file"]
        one = read_readings(file, black=black)
        if one.sessions != ((DISPLAY, NO_FILTER),):
            raise InputError(
                f"{file}: named as one session by {path.name}, must not have columns projector and "
                f"filter"
            )
        rows += [
            replace(row, projector=section["projector"], through=section["filter"])
            for row in one.rows
        ]
        blacks.add(one.black)
        files.append(file)
        left_out += one.left_out
    if len(blacks) > 1:
        raise InputError(f"{path}: black must be included in all tables, or subtracted in all")
    if noise is None:
        noise = estimated_noise(_repeats(rows), Noise())
    return Readings(str(path), tuple(rows), blacks.pop(), noise, tuple(files), left_out)


def _black(table: Table) -> Black:
    settings = dict(table.settings)
    black = settings.pop("black", "included")
    for name in settings:
        table.mistakes.add(0, f"key {name!r} is not known; outside [[reading]] only black is")
    if black == "subtracted":
        return "subtracted"
    if black != "included":
        table.mistakes.add(0, f"black must be included or subtracted, got {black!r}")
    return "included"


def _reading(table: Table, row: Row) -> Reading | None:
    projector: str | None = DISPLAY
    through: str | None = NO_FILTER
    if table.columns & {"projector", "filter"}:
        projector = table.word(row, "projector", EYES)
        through = table.word(row, "filter", (*EYES, NO_FILTER))
    channel = table.word(row, "channel", CHANNELS)
    level: float | None = 0.0 if channel == "K" else 1.0
    if "level" in row.cells:
        level = table.number(
            row, "level", above=0, below=1, remedy="divide codes by the largest, 2^bits - 1"
        )
    if channel == "K" and level:
        table.mistakes.add(row.line, f"level of K must be 0, got {level:g}; is it another channel?")
    xyz = light_of(table, row, _light_columns(table))
    if projector is None or through is None or channel is None or level is None or xyz is None:
        return None
    if level == 0:
        channel = "K"
    x, y, z = xyz
    return Reading(projector, through, channel, level, (float(x), float(y), float(z)), row.line)


def _light_columns(table: Table) -> tuple[str, str, str]:
    """Columns of a reading's light: X, Y, Z, or luminance, x, y."""
    if not {"x", "y"} <= table.columns:
        return "X", "Y", "Z"
    return next((name for name in ("Lv", "fL") if name in table.columns), "Y"), "x", "y"


def light_of(table: Table, row: Row, columns: Sequence[str]) -> Floats | None:
    """A reading's light; None and a mistake if it has none.

    Parameters
    ----------
    table, row
        Where it stands.
    columns
        ``X, Y, Z``; luminance (``Y``, ``Lv`` or ``fL``), ``x, y``; or one figure alone.

    Returns
    -------
    light
        (channel,) X, Y, Z, or the figure alone; cd/m², or lux.
    """
    first, *others = columns
    if not others or first == "X":
        values = [_light(table, row, column) for column in columns]
        known = [value for value in values if value is not None]
        scale = FOOT_LAMBERT if first == "fL" else 1.0
        return scale * np.array(known) if len(known) == len(values) else None
    luminance = _light(table, row, first)
    x, y = (
        table.number(row, column, above=0, below=1, remedy="it is a chromaticity of CIE 1931")
        for column in others
    )
    if luminance is None or x is None or y is None:
        return None
    if not (y > 0 and x + y <= 1):
        table.mistakes.add(
            row.line,
            f"x and y must be a chromaticity, got {x:g} and {y:g}; without any, as of a black that "
            "is too dark for it, write those of white",
        )
        return None
    luminance *= FOOT_LAMBERT if first == "fL" else 1.0
    return np.array([luminance * x / y, luminance, luminance * (1 - x - y) / y])


def _light(table: Table, row: Row, column: str) -> float | None:
    return table.number(row, column, above=0, below=BRIGHTEST, remedy=NOT_LIGHT)


def _groups(rows: list[Reading]) -> list[list[Reading]]:
    groups: dict[tuple[str, str, str, float], list[Reading]] = defaultdict(list)
    for row in rows:
        groups[row.projector, row.through, row.channel, row.level].append(row)
    return [group for group in groups.values() if len(group) > 1]


def _repeats(rows: list[Reading]) -> list[Floats]:
    return [np.array([row.xyz for row in group]) for group in _groups(rows)]


def _note_conflicts(rows: list[Reading], mistakes: Mistakes) -> None:
    for first, *others in _groups(rows):
        for row in others:
            a, b = np.array(first.xyz), np.array(row.xyz)
            apart = float(np.linalg.norm(a - b))
            brighter = max(float(np.linalg.norm(a)), float(np.linalg.norm(b)))
            if apart > max(CONFLICT * brighter, CONFLICT_FLOOR):
                mistakes.add(
                    row.line,
                    f"{row.channel} at level {row.level:g} must repeat line {first.line}, got XYZ "
                    f"{words(b)} after {words(a)}; measure again, or delete the wrong row",
                )


def words(xyz: Floats) -> str:
    """Formats XYZ for a person: ``50.3 26 3.37``."""
    return " ".join(decimal(value) for value in xyz)
