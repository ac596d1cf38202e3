"""Tables of people and meters: rows that know their line in the file.

A CSV file has one line of column names; lines that are empty or begin with # are skipped. The same
table in TOML is a list of [[reading]] sections. Nothing is guessed: what cannot be read is a
mistake, and all mistakes of a file are reported at once, with their lines.
"""

from __future__ import annotations

import csv
import difflib
import math
import re
import reprlib
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias, final

from domesim.errors import InputError
from domesim.host.files import read_plain
from domesim.host.texts import text_in, toml_in


@final
@dataclass
class Mistakes:
    """What is wrong with a file, collected until `raise_any`."""

    source: str
    found: list[tuple[int, str]] = field(default_factory=list)

    def add(self, line: int, text: str) -> None:
        """Note a mistake of a line; line 0 is the whole file."""
        if (line, text) not in self.found:
            self.found.append((line, text))

    @contextmanager
    def collecting(self) -> Iterator[None]:
        """Note an InputError instead of raising it."""
        try:
            yield
        except InputError as error:
            self.add(0, str(error))

    def raise_any(self) -> None:
        """Raise all mistakes, in the order of their lines.

        Raises
        ------
        InputError
            If there is one.
        """
        lines = [f"line {line}: {text}" if line else text for line, text in sorted(self.found)]
        if len(lines) == 1:
            raise InputError(f"{self.source}: {lines[0]}")
        if lines:
            raise InputError("\n  ".join([f"{self.source} has {len(lines)} mistakes:", *lines]))


@final
@dataclass(frozen=True)
class Row:
    """One row: its line and its cells by column name; absent and empty cells are missing."""

    line: int
    cells: Mapping[str, Any]


@final
@dataclass(frozen=True)
class Table:
    """The rows of a file, the columns that it has, and (TOML) the keys outside the rows.

    Rows that have no place in the table are `left_out`, and counted.
    """

    rows: tuple[Row, ...]
    columns: frozenset[str]
    header: int
    settings: Mapping[str, Any]
    mistakes: Mistakes
    left_out: int = 0

    def require(self, known: Iterable[str], wanted: Iterable[str]) -> None:
        """Notes unknown columns, and `wanted` ones that are missing."""
        known = tuple(known)
        for name in sorted(self.columns - set(known)):
            near = difflib.get_close_matches(name, known, 1) or [
                column for column in known if column.lower() == name.lower()
            ]
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            self.mistakes.add(self.header, f"column {name!r} is not known; {hint}")
        for name in wanted:
            if name not in self.columns:
                self.mistakes.add(
                    self.header, f"column {name} is missing; got {', '.join(sorted(self.columns))}"
                )

    def filled(self, columns: Iterable[str]) -> tuple[Row, ...]:
        """Rows with something in one of the columns; a mistake if there are rows, but none such."""
        wanted = set(columns)
        rows = tuple(row for row in self.rows if wanted & set(row.cells))
        if self.rows and not rows:
            self.mistakes.add(
                self.header,
                f"wanted readings in {', '.join(columns)}, got a table that nobody has filled in",
            )
        return rows

    def word(self, row: Row, column: str, allowed: tuple[str, ...]) -> str | None:
        """The cell's word, in the spelling of `allowed`; None and a mistake if it is not one."""
        if column not in self.columns:
            return None
        cell = row.cells.get(column)
        spelt = {word.lower(): word for word in allowed}
        spelling = spelt.get(cell.strip().lower()) if isinstance(cell, str) else None
        if spelling is None:
            got = "nothing" if cell is None else reprlib.repr(cell)
            self.mistakes.add(
                row.line, f"{column} must be {', '.join(allowed[:-1])} or {allowed[-1]}, got {got}"
            )
        return spelling

    def number(
        self, row: Row, column: str, *, above: float, below: float, remedy: str
    ) -> float | None:
        """The cell's number in above..below; None and a mistake if it is not one."""
        if column not in self.columns:
            return None
        cell = row.cells.get(column)
        try:
            value = math.nan if isinstance(cell, bool) or cell is None else float(cell)
        except (TypeError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            got = "nothing" if cell is None else reprlib.repr(cell)
            self.mistakes.add(
                row.line, f"{column} must be a number, got {got}; measure again, or delete the row"
            )
            return None
        if not above <= value <= below:
            self.mistakes.add(
                row.line, f"{column} must be {above:g} to {below:g}, got {value:g}; {remedy}"
            )
            return None
        return value


Reader: TypeAlias = Callable[[str, Mistakes], Table]
"""A file's text -> its table."""


def read_table(path: str | Path, others: Mapping[str, Reader] = MappingProxyType({})) -> Table:
    """The table of a ``.csv`` or ``.toml`` file.

    Parameters
    ----------
    path
        The file.
    others
        Suffix -> what reads files of that kind, too.

    Raises
    ------
    InputError
        If there is no such file, it is no text, or its kind is not known; with all mistakes of its
        rows' form otherwise only when the caller raises `Table.mistakes`.
    """
    path = Path(path)
    readers: dict[str, Reader] = {".csv": _csv, ".toml": _toml, **others}
    if path.suffix.lower() not in readers:
        *first, last = readers
        raise InputError(
            f"{path}: wanted readings as {', '.join(first)} or {last}, got "
            f"{path.suffix or path.name!r}"
        )
    return readers[path.suffix.lower()](text_of(path), Mistakes(str(path)))


def text_of(path: Path) -> str:
    """A text file's content.

    Raises
    ------
    InputError
        If there is no such file, or it is no text.
    """
    try:
        return text_in(read_plain(path))
    except UnicodeDecodeError:
        raise InputError(
            f"{path}: readings are a text file in UTF-8, this is not; export it as CSV (UTF-8)"
        ) from None
    except OSError as error:
        raise InputError(
            f"{path}: wanted a file of readings, got '{error.strerror}'; check the path"
        ) from error


def _csv(text: str, mistakes: Mistakes) -> Table:
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError(f"{mistakes.source}: wanted a line of column names and rows, got nothing")
    if re.fullmatch(r"sep=.", lines[0][1].strip().strip('"')):  # to Excel
        del lines[0]
    if not lines:
        raise InputError(f"{mistakes.source}: wanted column names and rows, got 'sep=' alone")
    header, names = lines[0][0], _cells(lines[0][1])
    if len(names) == 1 and re.search(r"[;\t]", names[0]):
        raise InputError(
            f"{mistakes.source}: line {header}: cells must be separated by commas (and numbers "
            f"have a point), got {reprlib.repr(lines[0][1])}; export it as CSV with commas"
        )
    for name in {name for name in names if names.count(name) > 1}:
        mistakes.add(header, f"column {name!r} is there {names.count(name)} times; keep one")
    rows = []
    for number, line in lines[1:]:
        cells = _cells(line)
        refuse_decimal_comma(mistakes.source, number, cells)
        if len(cells) != len(names):
            mistakes.add(
                number,
                f"must have {len(names)} cells ({','.join(names)}), got {len(cells)}; numbers "
                f"have a decimal point, not a comma",
            )
            continue
        pairs = zip(names, cells, strict=True)
        rows.append(Row(number, {name: cell for name, cell in pairs if cell}))
    return Table(tuple(rows), frozenset(names), header, {}, mistakes)


def refuse_decimal_comma(source: str, line: int, cells: Iterable[str]) -> None:
    """Refuse a table whose numbers have a comma, rather than each of them.

    Raises
    ------
    InputError
        If one of the cells of a line is such a number.
    """
    for cell in cells:
        if re.fullmatch(r"[-+]?[0-9]+,[0-9]+([eE][-+]?[0-9]+)?", cell.strip('" ')):
            raise InputError(
                f"{source}: line {line}: numbers have a decimal point, got {cell!r}; export it "
                f"with points"
            )


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], skipinitialspace=True))]


def _toml(text: str, mistakes: Mistakes) -> Table:
    try:
        content = toml_in(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{mistakes.source}: not valid TOML: {error}") from None
    sections = content.pop("reading", None)
    if not isinstance(sections, list) or not all(isinstance(s, dict) for s in sections):
        raise InputError(f"{mistakes.source}: wanted sections [[reading]], got none")
    # tomllib gives no lines; headers are searched in the text.
    tables = [
        number
        for number, line in enumerate(text.splitlines(), 1)
        if re.match(r"\s*\[\[\s*reading\s*\]\]", line)
    ]
    numbers = tables if len(tables) == len(sections) else [1] * len(sections)
    rows = tuple(Row(n, section) for n, section in zip(numbers, sections, strict=True))
    columns = frozenset(name for section in sections for name in section)
    return Table(rows, columns, numbers[0], content, mistakes)
