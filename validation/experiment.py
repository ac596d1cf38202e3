"""What an experiment is: a claim, what was measured, and whether it is as expected.

An experiment is a module of `validation.experiments`. Its docstring opens with the claim and has
the sections *Rationale* and *Expected*; its `run` takes a `Work` and returns a `Finding`. Findings
hold nothing but text and numbers. What its steps return is stored, and read back after a kill.
"""

from __future__ import annotations

import csv
import functools
import hashlib
import importlib
import inspect
import io
import math
import re
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from types import ModuleType
from typing import Annotated, Generic, TypeVar, final

from pydantic import BaseModel, BeforeValidator, ConfigDict, TypeAdapter, ValidationError
from pydantic_core import to_json

from domesim.errors import InputError
from domesim.frames import write_whole
from domesim.host.writing import make_own
from domesim.pathtrace.llvm import load_mitsuba


def _finite(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Number = Annotated[float | None, BeforeValidator(_finite)]
"""A figure that is stored; None if it could not be computed, which JSON has no other word for."""

T = TypeVar("T")
Item = TypeVar("Item")


class Record(BaseModel):
    """Something that is stored as JSON."""

    model_config = ConfigDict(frozen=True, extra="forbid")


@final
@dataclass(frozen=True)
class Check:
    """One figure and where it was expected to lie.

    Attributes
    ----------
    what
        What was measured.
    found
        The figure; not finite if it could not be computed.
    low, high
        Least and largest value that is as expected; one may be None.
    unit
        Its unit; empty for a ratio or a count.
    """

    what: str
    found: float
    low: float | None = None
    high: float | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        """Refuse a check without a bound, which could not fail."""
        if all(_finite(bound) is None for bound in (self.low, self.high)):
            raise ValueError(f"a check needs a bound: {self.what}")

    @property
    def passed(self) -> bool:
        """Whether the figure lies within its bounds."""
        above = self.low is None or self.found >= self.low
        return (
            math.isfinite(self.found) and above and (self.high is None or self.found <= self.high)
        )

    @property
    def told(self) -> str:
        """What was found and what was expected, in words."""
        return f"{self.what}: {self.written}, expected {self.expected}"

    @property
    def written(self) -> str:
        """The figure, in words."""
        if not math.isfinite(self.found):
            return "nothing"
        return f"{self.found:.4g} {self.unit}".rstrip()

    @property
    def expected(self) -> str:
        """The bounds, in words."""
        low, high = (None if x is None else f"{x:.4g}" for x in (self.low, self.high))
        if low is not None and high is not None:
            words = low if low == high else f"{low} to {high}"
        else:
            words = f"at most {high}" if low is None else f"at least {low}"
        return f"{words} {self.unit}".rstrip()


@final
@dataclass(frozen=True)
class Column:
    """A column of a table; `digits` is how its numbers are written, a format of Python's."""

    name: str
    unit: str = ""
    digits: str = ".3g"


Cell = bool | int | float | str | None


@final
@dataclass(frozen=True)
class Table:
    """Figures to compare with each other."""

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def __post_init__(self) -> None:
        """Refuse a row that has not a cell for each column."""
        if wrong := [row for row in self.rows if len(row) != len(self.columns)]:
            raise ValueError(f"a table of {len(self.columns)} columns got the row {wrong[0]}")

    @property
    def numeric(self) -> list[bool]:
        """Which columns hold numbers."""
        return [
            any(isinstance(row[c], Real) for row in self.rows) for c in range(len(self.columns))
        ]

    @property
    def csv(self) -> str:
        """The figures as they are, in CSV; a heading has its unit."""
        memory = io.StringIO()
        rows = csv.writer(memory, lineterminator="\n")
        heads = (f"{each.name}, {each.unit}" if each.unit else each.name for each in self.columns)
        rows.writerow(heads)
        rows.writerows(self.rows)
        return memory.getvalue()

    def written(self) -> Iterator[list[str]]:
        """Rows as text."""
        for row in self.rows:
            yield [_written(cell, column) for cell, column in zip(row, self.columns, strict=True)]


@final
@dataclass(frozen=True)
class Plot:
    """A diagram, as SVG and PDF; `alt` says what it shows to those who cannot see it.

    `data` is what is drawn, in CSV.
    """

    caption: str
    alt: str
    svg: str
    pdf: bytes = b""
    data: str = ""


@final
@dataclass(frozen=True)
class Panel:
    """One of several pictures side by side, as a data URI."""

    title: str
    alt: str
    data: str


@final
@dataclass(frozen=True)
class Pictures:
    """Pictures to compare with each other."""

    caption: str
    panels: tuple[Panel, ...]


@final
@dataclass(frozen=True)
class Finding:
    """What an experiment found.

    Attributes
    ----------
    result
        In words, with the figures that matter; paragraphs.
    checks
        At least one.
    advice
        What to do about it, in a sentence or two.
    tables, plots, pictures
        What the report shows.
    figures
        To be quoted by README and docs, by name.
    left_out
        What was not measured, and why.
    judged
        Whether the judges that it is about were asked.
    """

    result: str
    checks: tuple[Check, ...]
    advice: str = ""
    tables: tuple[Table, ...] = ()
    plots: tuple[Plot, ...] = ()
    pictures: tuple[Pictures, ...] = ()
    figures: Mapping[str, float | None] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    judged: bool = True

    def __post_init__(self) -> None:
        """Refuse a finding that could not fail."""
        if not self.checks:
            raise ValueError("a finding needs checks")

    @property
    def passed(self) -> bool:
        """Whether every check is as expected."""
        return not self.failed

    @property
    def failed(self) -> tuple[str, ...]:
        """Checks that are not as expected, in words."""
        return tuple(check.told for check in self.checks if not check.passed)


def require_tracer() -> None:
    """See that paths can be traced.

    Raises
    ------
    Missing
        If not.
    """
    try:
        load_mitsuba()
    except InputError as fault:
        raise Missing(str(fault)) from None


class Missing(Exception):  # noqa: N818 (nothing went wrong)
    """Something that an experiment needs; the message says what, and how to get it."""


def at_most(what: str, found: float, bound: float, unit: str = "") -> Check:
    """A check that a figure is small enough."""
    return Check(what=what, found=float(found), unit=unit, high=float(bound))


def at_least(what: str, found: float, bound: float, unit: str = "") -> Check:
    """A check that a figure is large enough."""
    return Check(what=what, found=float(found), unit=unit, low=float(bound))


def between(what: str, found: float, low: float, high: float, unit: str = "") -> Check:
    """A check that a figure lies between two others."""
    return Check(what=what, found=float(found), unit=unit, low=float(low), high=float(high))


def equal(what: str, found: float, wanted: float, unit: str = "") -> Check:
    """A check that a count is what it should be."""
    return between(what, found, wanted, wanted, unit)


@final
@dataclass
class Work:
    """How much of an experiment to do, and what of it has been done before.

    Parameters
    ----------
    quick
        Whether minutes matter more than accuracy.
    seed
        Seed of all random numbers.
    store
        Folder for finished steps; without it nothing is kept.
    note
        Told which step is under way.
    heard
        Folder for what judges said (`validation.hearing`).
    """

    quick: bool = True
    seed: int = 0
    store: Path | None = None
    note: Callable[[str], None] = lambda text: None
    heard: Path | None = None
    seconds: float = field(default=0.0, init=False)
    """Time that the steps took, now or before they were stored, s."""
    _names: set[str] = field(default_factory=set, init=False)

    def step(self, name: str, kind: type[T], measure: Callable[[], T]) -> T:
        """What `measure` returns, of type `kind`; stored, and not measured again after a kill.

        Parameters
        ----------
        name
            What is measured, unique within the experiment.
        kind
            Type of the result: a dataclass, or anything that pydantic can write as JSON.
        measure
            Does the work.

        Raises
        ------
        ValueError
            If there was a step of that name.
        """
        if name in self._names:
            raise ValueError(f"two steps are called {name!r}")
        self._names.add(name)
        path = None if self.store is None else self.store / f"{_slug(name)}.json"
        stored: TypeAdapter[_Step[T]] = TypeAdapter(_Step[kind])  # type: ignore[valid-type]
        if path is not None:
            try:
                kept = stored.validate_json(path.read_bytes())
            except (OSError, ValidationError):
                pass  # not there yet; or cut off, or of another version: done again
            else:
                self.seconds += kept.seconds
                return kept.value
        self.note(name)
        begin = time.perf_counter()
        value = measure()
        done = _Step(time.perf_counter() - begin, value)
        if path is not None:
            make_own(path.parent)
            # JSON has no infinities, but Pydantic reads and writes them
            write_whole(path, to_json(done, inf_nan_mode="constants"))
        self.seconds += done.seconds
        return done.value

    def each(
        self,
        items: Mapping[str, Item],
        kind: type[T],
        measure: Callable[[Item], T],
    ) -> dict[str, T]:
        """`step` for each of several items, by name."""
        return {
            name: self.step(name, kind, functools.partial(measure, item))
            for name, item in items.items()
        }


@final
@dataclass(frozen=True)
class _Step(Generic[T]):
    seconds: float
    value: T


@final
@dataclass(frozen=True)
class Experiment:
    """A module that shows something.

    Attributes
    ----------
    name
        Name of the module.
    claim, rationale, expected
        From its docstring.
    module
        The module itself.
    """

    name: str
    claim: str
    rationale: str
    expected: str
    module: ModuleType

    def run(self, work: Work) -> Finding:
        """Do the work.

        Raises
        ------
        Missing
            If this machine lacks something for it.
        """
        found = self.module.run(work)
        assert isinstance(found, Finding)
        return found


def load_experiment(name: str) -> Experiment:
    """The experiment of that name.

    Raises
    ------
    ValueError
        If its docstring has not the three parts.
    """
    module = importlib.import_module(f"validation.experiments.{name}")
    text = inspect.cleandoc(module.__doc__ or "")
    match = re.fullmatch(r"(.+?)\n\nRationale\n(.+?)\nExpected\n(.+)", text, re.DOTALL)
    if match is None:
        raise ValueError(f"{module.__name__}: its docstring needs a claim, Rationale and Expected")
    claim, rationale, expected = (" ".join(part.split()) for part in match.groups())
    return Experiment(name, claim, rationale, expected, module)


def _slug(name: str) -> str:
    """A file name of a step's name, one to one."""
    plain = re.sub(r"[^A-Za-z0-9.-]+", "-", name)[:60]
    return f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def _written(cell: Cell, column: Column) -> str:
    if _finite(cell) is None:
        return "–"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, str):
        return cell
    return format(cell, column.digits) if isinstance(cell, float) else f"{cell:,}"
