"""Work on one frame of a show: read, solve, write, keep a record.

Whoever does it (`alone`, `cluster`) only decides where and when. A mistake is handed on as a
`Failed`, so that the other frames go on.
"""

from __future__ import annotations

import hashlib
import os
import socket
import sys
import tempfile
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, Generic, Protocol, TypeAlias, TypeVar, final

import psutil
from numpy.typing import NDArray

from domesim.errors import HopelessError, InputError, reason
from domesim.frames import ColourTag, Master, read_master, write_master
from domesim.frames.messages import joined
from domesim.frames.packings import ANAGLYPH, Shared
from domesim.frames.reading import size_of, unsaid
from domesim.frames.views import keeps_layers, made_for, packed
from domesim.host.console import about
from domesim.host.numbers import decimal
from domesim.host.system import peak_memory
from domesim.shows.job import Job, Record, versions
from domesim.shows.show import Show
from domesim.shows.small import small_of, write_small
from domesim.shows.timeline import Timeline

Files: TypeAlias = tuple[Path, ...]
"""Files of one moment: one, or left and right."""

Note: TypeAlias = Callable[[str], None]
"""Told how the frame under way gets on."""

P = TypeVar("P")
S = TypeVar("S")


class Write(Protocol):
    """Writes a result."""

    @property
    def output(self) -> Files:
        """Files that the result goes to."""

    def __call__(self, result: Master, /) -> None:
        """Write it."""

    def stored(self) -> Master:
        """Reads back what was written; can be called once, for it is large."""

    def beside(self, files: Sequence[Path]) -> None:
        """Other files that belong to the result have been written."""

    def small(self, *pictures: NDArray[Any]) -> None:
        """Show `pictures` in the report, as `Recipe.small` names them: see `write_small`."""


@final
@dataclass(frozen=True)
class Work(Generic[P, S]):
    """What is done to each master of a show, in three parts.

    Parameters
    ----------
    prepare
        Prepares a master that was read.
    solve
        Solves what was prepared.
    finish
        Writes the result of what was solved; returns figures, and a line for a person.
    ready
        Computes what masters of so many rows and columns share, while the first of them is read.
    """

    prepare: Callable[[Master], P]
    solve: Callable[[P], S]
    finish: Callable[[S, Write], tuple[dict[str, Any], str]]
    ready: Callable[[int, int], object] | None = None


@final
@dataclass(frozen=True)
class Column:
    """A figure of each frame that the report shows.

    Parameters
    ----------
    key
        Its name in the figures.
    title
        For a person.
    unit
        Unit of the figure; columns of one unit are drawn together. "%" for a share.
    less
        Whether less is worse; more is, by default.
    """

    key: str
    title: str
    unit: str
    less: bool = False

    def shown(self, value: Any) -> str:
        """A figure as text."""
        if not isinstance(value, int | float):
            return "–" if value is None else str(value)
        return decimal(100 * value if self.unit == "%" else value)


@final
@dataclass(frozen=True)
class Judged:
    """Verdict of a report on a frame.

    Parameters
    ----------
    verdict
        In a few words.
    reason
        Why, with the figures that it rests on.
    needs
        How much it asks for somebody: 0 nothing, 1 a look, 2 more.
    """

    verdict: str
    reason: str
    needs: int


class Recipe(ABC):
    """A command's settings, and the work that they ask for: what is sent to whoever does it.

    It can be hashed, compared and pickled.
    """

    @abstractmethod
    def work(self, note: Note) -> Work[Any, Any]:
        """The work, with what frames of one show share.

        Raises
        ------
        InputError
            If a file that the settings name cannot be read.
        """

    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """All that results depend on besides the master, for JSON: files by their SHA-256."""

    @abstractmethod
    def columns(self) -> tuple[Column, ...]:
        """What the report shows of each frame; frames are ranked by the first."""

    @abstractmethod
    def memory(self, rows: int, cols: int) -> int:
        """Bytes that a worker needs for frames of that size, about."""

    def resources(self) -> dict[str, float]:
        """Resources of a worker besides cores, by Dask's names: ``{"GPU": 1}``."""
        return {}

    def beside(self, output: Files) -> Sequence[Path]:
        """All other files that are written for the frame whose result is `output`."""
        return ()

    @property
    def about(self) -> str:
        """Says in a sentence of the report what its figures take for granted; "" for nothing."""
        return ""

    def doubt(self, masters: Iterable[Master]) -> str | None:
        """Asks about a whole show before a frame of it is done.

        Parameters
        ----------
        masters
            Some frames of it, which are read as they are asked for.

        Returns
        -------
        question
            A line, with the way out; None without doubt.

        Raises
        ------
        HopelessError
            If none of it can be done.
        """
        return None

    small = ""
    """What the small pictures of a report are, in words; "" without any."""

    def judged(self, figures: Mapping[str, Any]) -> Judged | None:
        """Returns the verdict on a frame with these figures; None for none."""
        return None

    def over_time(
        self, frames: Sequence[Mapping[str, Any]], seconds: Sequence[float]
    ) -> Timeline | None:
        """Returns what a report draws of a show over its time; None for nothing.

        Parameters
        ----------
        frames
            Their figures, in order.
        seconds
            Time of each.
        """
        return None

    def options(self, writing: Writing) -> dict[str, str]:
        """The options of the command line that results depend on, defaults too: name -> value."""
        return {}

    def film(self, masters: Iterable[Master], rate: float) -> dict[str, float]:
        """Judges consecutive frames as a film.

        Parameters
        ----------
        masters
            The frames.
        rate
            Frames a second.

        Returns
        -------
        lost
            JOD lost, by what is shown; the first is what counts.

        Raises
        ------
        InputError
            If what judges films is not installed.
        """
        raise NotImplementedError

    film_note = ""
    """How far what `film` says may be believed, in a sentence."""
    compares = False
    """Whether there are pages that compare what may be done with a master, and films of it."""

    def compare(self, master: Master, page: Path) -> None:
        """Write such a page."""
        raise NotImplementedError


@final
@dataclass(frozen=True)
class Writing:
    """How masters are read and results written.

    Parameters
    ----------
    suffix, bits
        Suffix and bits of the results' files and samples, such as ``.png``; the master's if None.
    dither
        As for `write_master`.
    repair
        As for `read_master`.
    fps
        Frame rate of a video that results become (`domesim.shows.film`), frames a second; the
        master's if None.
    output
        The results' encoding; the master's if None.
    together
        How left and right are to lie in one picture; as in the master's files if None.
    film
        The name of a video that results become; after theirs if None.
    """

    suffix: str | None = None
    bits: int | None = None
    dither: bool = False
    repair: bool = False
    fps: float | None = None
    output: ColourTag | None = None
    together: Shared | None = None
    film: Path | None = None

    def places(self, show: Show, folder: Path) -> tuple[Files, ...]:
        """Where in `folder` a show's results go; see `Show.outputs`."""
        return show.outputs(folder, self.suffix, together=self.together is not None)

    def options(self) -> dict[str, str]:
        """Options of `Recipe.options` that all commands that write frames have."""
        options = {
            "--format": "as the master" if self.suffix is None else self.suffix.lstrip("."),
            "--bits": "as the master" if self.bits is None else str(self.bits),
            "--dither": "tpdf" if self.dither else "none",
            "--output-encoding": "as the master" if self.output is None else self.output.named,
        }
        if self.together is not None:
            options["--output-packing"] = self.together
        if self.fps is not None:
            options["--fps"] = f"{self.fps:g}"
        return options | ({"--repair": "yes"} if self.repair else {})


@final
@dataclass(frozen=True)
class Order:
    """One frame to do.

    Parameters
    ----------
    show
        The show; of its moments, only this frame's.
    output
        Where the result goes: as many files as it has.
    recipe, writing
        How.
    job
        Where its record goes; None to keep none.
    """

    show: Show
    output: Files
    recipe: Recipe
    writing: Writing
    job: Job | None = None

    @property
    def moment(self) -> Files:
        """The master's files."""
        return self.show.moments[0]

    @property
    def name(self) -> str:
        """The order's name, for a person."""
        return " and ".join(path.name for path in self.moment)

    def kept(self) -> Record | str:
        """What is kept of it, as of `Job.kept`; "" without a job."""
        sums = self.show.sums[0] if self.show.sums else ()
        return "" if self.job is None else self.job.kept(self.moment, self.output, sums)


@final
@dataclass(frozen=True)
class Finished:
    """A frame that is done.

    Parameters
    ----------
    figures
        For a program, with ``input``, ``output`` and what was read.
    line
        For a person.
    seconds
        Seconds of ``reading`` (and preparing), ``solving`` and ``writing`` (and finishing).
    maker
        Who did it: ``host``, ``pid``, the memory that this process has (``resident``) and had at
        most (``peak``), bytes, and the seconds of all its threads so far (``cpu``).
    kept
        Whether it had been done before.
    again
        Why it was not kept although it had been; "" if it had not.
    results
        As of `Record`; nothing without a job.
    """

    figures: dict[str, Any]
    line: str
    seconds: dict[str, float] = field(default_factory=dict)
    maker: dict[str, Any] = field(default_factory=dict)
    kept: bool = False
    again: str = ""
    results: dict[str, str] = field(default_factory=dict)


def finished_before(record: Record) -> Finished:
    """A frame that is kept."""
    return Finished(record.figures, record.line, kept=True, results=record.results)


@final
@dataclass(frozen=True)
class Failed:
    """A frame that is not.

    Parameters
    ----------
    reason
        Why: one line.
    hopeless
        Whether the frames after it would fail as well.
    """

    reason: str
    hopeless: bool = False


@final
@dataclass(frozen=True)
class _Read(Generic[P]):
    """A master that was read and prepared.

    Parameters
    ----------
    prepared
        For `Work.solve`; and then what that gave, for `Work.finish`.
    repaired
        How many samples were.
    facts
        `Master.facts`.
    sources
        As for `Record.sources`.
    seconds, again
        As of `Finished`.
    """

    prepared: P
    repaired: int
    facts: dict[str, Any]
    sources: dict[str, Any]
    seconds: dict[str, float]
    again: str


@final
class Steps:
    """The three steps of each frame, which may be in threads of their own.

    Parameters
    ----------
    work
        What is done.
    """

    def __init__(self, work: Work[Any, Any]) -> None:
        self._work = work
        self._ready = work.ready

    def read(self, order: Order) -> _Read[Any] | Finished | Failed:
        """What was prepared; the frame itself if it was done before."""
        with _caught(order) as caught:
            before = order.kept()
            if isinstance(before, Record):
                return finished_before(before)
            if order.job is not None:
                _require_program(order.job, order.recipe)
                order.job.forget(order.output)
            seconds: dict[str, float] = {}
            with _timed(seconds, "reading"):
                sources = {} if order.job is None else order.job.sources(order.moment)
                how = order.writing
                known = [str(digest) for _, _, digest in sources.values()]
                with self._readied(order):
                    master = order.show.read(order.moment, repair=how.repair, known=known)
                facts = master.facts()
                if how.together is not None:
                    master = packed(master, how.together)
                master = made_for(master, order.output, how.bits, how.output)
                if how.output is not None:
                    facts["encoding"] = asdict(how.output)
                prepared = self._work.prepare(master)
            return _Read(prepared, master.repaired, facts, sources, seconds, before)
        return caught[0]

    @contextmanager
    def _readied(self, order: Order) -> Iterator[None]:
        """The first time, compute beside what frames of its size share."""
        ready, self._ready = self._ready, None
        if ready is None or order.show.packing is not None:  # whose views are smaller
            yield
            return
        with ThreadPoolExecutor(1, "domesim-ready") as beside:
            # What goes wrong there, reading and preparing will tell
            beside.submit(lambda: ready(*size_of(order.moment[0])))
            yield

    def solve(self, order: Order, read: _Read[Any] | Finished | Failed) -> Any:
        """What was solved."""
        if not isinstance(read, _Read):
            return read
        with _caught(order) as caught, _timed(read.seconds, "solving"):
            return replace(read, prepared=self._work.solve(read.prepared))
        return caught[0]

    def finish(self, order: Order, solved: _Read[Any] | Finished | Failed) -> Finished | Failed:
        """Write it, and keep its record."""
        if not isinstance(solved, _Read):
            return solved
        write = _Writer(order)
        with _caught(order) as caught:
            if order.job is not None:
                order.job.require_settings()
            with _timed(solved.seconds, "writing"):
                try:
                    figures, line = self._work.finish(solved.prepared, write)
                except BaseException:
                    write.discard()
                    raise
            named = {"input": _named(order.moment), "output": _named(order.output)}
            figures = {**named, **solved.facts, **figures}
            if solved.repaired:
                figures["repaired"] = solved.repaired
                line += f"\n  {solved.repaired} impossible samples repaired"
            if write.unsaid:
                figures["unsaid"] = write.unsaid
                line += f"\n  written as {write.unsaid}"
            maker, results = _maker(), {}
            if order.job is not None:
                figures["settings"] = order.job.settings
                record = Record(figures, line, solved.seconds, solved.sources, maker)
                results = order.job.keep(order.output, record, write.others)
            return Finished(
                figures, line, solved.seconds, maker, again=solved.again, results=results
            )
        return caught[0]

    def all(self, order: Order) -> Finished | Failed:
        """One after the other."""
        return self.finish(order, self.solve(order, self.read(order)))


@final
class _Writer:
    """`Write` for an order."""

    def __init__(self, order: Order) -> None:
        self._order = order
        self.unsaid = ""
        self._stored: Master | None = None
        self._written = False
        self.others: tuple[Path, ...] = ()

    @property
    def output(self) -> Files:
        return self._order.output

    def beside(self, files: Sequence[Path]) -> None:
        self.others += tuple(files)

    def small(self, *pictures: NDArray[Any]) -> None:
        job, output = self._order.job, self._order.output
        if job is not None:
            with suppress(InputError, OSError):  # a report can do without
                write_small(small_of(job.folder, output[0].name), pictures)

    def __call__(self, result: Master, /) -> None:
        output, writing = self._order.output, self._order.writing
        write_master(result, output, bits=writing.bits, dither=writing.dither)
        self._written = True
        if result.packing == ANAGLYPH:  # whose eyes nobody can take apart
            self._stored = result
            return
        packing = None if result.packing in ("single", "files") else result.packing
        colour = result.colour
        del result  # what is read back takes its memory
        try:
            self._stored = read_master(
                output,
                packing=packing,
                repair=True,
                allow_identical=True,
                halves=True,
                colour=colour,
                layer=self._order.show.layer if keeps_layers(output[0]) else None,
            )
            self.unsaid = unsaid(self._stored.frames[0])
        except InputError:
            self.discard()  # an encoder that reports success is no proof
            raise

    def stored(self) -> Master:
        stored, self._stored = self._stored, None
        assert stored is not None  # written before
        return stored

    def discard(self) -> None:
        """Leave nothing behind of what was written."""
        for path in self._order.output if self._written else ():
            path.unlink(missing_ok=True)


def _maker() -> dict[str, Any]:
    """Returns the fields of `Finished` about this process."""
    return {
        "host": socket.gethostname(),
        "pid": os.getpid(),
        "resident": psutil.Process().memory_info().rss,
        "peak": peak_memory(),
        "cpu": time.process_time(),
    }


def program_of(recipe: Recipe) -> str:
    """Returns the version of domesim, and digests of its code and the recipe's.

    The code counts, because a version's number need not change with it.
    """
    package = type(recipe).__module__.partition(".")[0]
    return f"{versions().get('domesim')}+{code_of('domesim', package)[:8]}"


@cache
def code_of(*packages: str) -> str:
    """SHA-256 of all Python files of these."""
    digest = hashlib.sha256()
    for package in packages:
        for place in getattr(sys.modules[package], "__path__", ()):
            for file in sorted(Path(place).rglob("*.py")):
                digest.update(f"{file.relative_to(place)} {file.stat().st_size} ".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()


def _require_program(job: Job, recipe: Recipe) -> None:
    """Refuses a worker that has another version of the program."""
    ours = program_of(recipe)
    if ours != job.program:
        raise HopelessError(
            f"wanted domesim {job.program}, as the command has, got {ours} on "
            f"{socket.gethostname()}; install the same there"
        )


@contextmanager
def _caught(order: Order) -> Iterator[list[Failed]]:
    """Turns a mistake, or a fault of the program, into a `Failed` in the list."""
    failed: list[Failed] = []
    try:
        with about(order.moment[0]):
            yield failed
    except InputError as error:
        failed.append(Failed(str(error), hopeless=isinstance(error, HopelessError)))
    except OSError as error:
        where = error.filename or order.moment[0]
        failed.append(Failed(f"{order.moment[0]}: got '{reason(error)}' at {where}"))
    except MemoryError:
        failed.append(Failed(f"{order.moment[0]}: not enough memory for frames of this size"))
    except Exception as error:
        failed.append(Failed(_fault(order, error)))


def _fault(order: Order, error: Exception) -> str:
    """Reports a fault of the program in one line; the rest goes into a file."""
    message = f"{order.moment[0]}: a fault of domesim itself: {type(error).__name__}: {error}"
    if order.job is not None:
        place = order.job.fault(order.output)
    else:
        handle, name = tempfile.mkstemp(prefix="domesim-", suffix=".txt")
        os.close(handle)
        place = Path(name)
    with suppress(OSError):  # failing to write results is reported
        place.write_text("".join(traceback.format_exception(error)), errors="backslashreplace")
    return f"{joined(message)} (report it with {place})"


@contextmanager
def _timed(seconds: dict[str, float], step: str) -> Iterator[None]:
    began = time.perf_counter()
    try:
        yield
    finally:
        seconds[step] = time.perf_counter() - began


def _named(paths: Files) -> str | list[str]:
    return str(paths[0]) if len(paths) == 1 else [str(path) for path in paths]
