"""What commands say, and to whom: text for people, JSON for programs, progress on long work."""

from __future__ import annotations

import errno
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar, final

from rich.console import Console as RichConsole
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from domesim.errors import InputError
from domesim.frames import Master, read_master, write_master
from domesim.frames.messages import reason
from domesim.frames.views import require_writable
from domesim.shows import Show


@final
class Console:
    """One command's outputs.

    Parameters
    ----------
    quiet
        Say nothing but errors.
    json
        Print figures to standard output as one JSON object, and no text there.
    """

    def __init__(self, *, quiet: bool = False, json: bool = False) -> None:
        self._text = not (quiet or json)
        self._json = json
        self._bars = RichConsole(stderr=True)
        self._shows_bars = self._text and self._bars.is_terminal
        self._describe: Callable[[str], None] = lambda text: None

    def say(self, text: str) -> None:
        """A line for a person, on standard output."""
        if self._text:
            _print(text)

    def figures(self, figures: dict[str, Any]) -> None:
        """The command's figures, for a program."""
        if self._json:
            _print(json.dumps(figures, indent=1, allow_nan=False))

    def note(self, text: str) -> None:
        """How the piece of work under way gets on, beside the progress bar."""
        self._describe(text)

    @contextmanager
    def share(self, what: str) -> Iterator[Callable[[float, str], None]]:
        """A progress bar for one long piece of work, with the time it will still take.

        Call what it yields with the share that is done (0..1) and how it gets on.
        """
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=self._bars, disable=not self._shows_bars) as bar:
            task = bar.add_task(what, total=1.0)
            yield lambda done, how: bar.update(task, completed=done, description=f"{what}, {how}")

    @contextmanager
    def progress(self, what: str, total: int) -> Iterator[Callable[[str], None]]:
        """A progress bar; call what it yields with the name of each piece as it starts."""
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=self._bars, disable=not self._shows_bars) as bar:
            task = bar.add_task(what, total=total)
            started, current = 0, ""

            def start(name: str) -> None:
                nonlocal started, current
                current = f"{what} {name}"
                bar.update(task, completed=started, description=current)
                started += 1

            self._describe = lambda text: bar.update(task, description=f"{current}, {text}")
            try:
                yield start
            finally:
                self._describe = lambda text: None
            bar.update(task, completed=started)


def complain(message: object) -> None:
    """A mistake, on standard error."""
    # File names may hold line breaks and terminal codes. A message's own further lines are
    # indented.
    text = "\n  ".join(_printable(line) for line in str(message).split("\n  "))
    print(f"domesim: {text}", file=sys.stderr, flush=True)


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Whatever mistake is found inside is one of `path`: its message names the file.

    Raises
    ------
    InputError
        The one that was raised inside, with the path in front unless the name is there already.
    """
    try:
        yield
    except InputError as error:
        if path.name in str(error):
            raise
        raise InputError(f"{path}: {error}") from error


Write: TypeAlias = Callable[[Master], Master]
"""Writes a result and gives it back as it was stored."""

P = TypeVar("P")
S = TypeVar("S")


@final
@dataclass(frozen=True)
class Work(Generic[P, S]):
    """What is done to each master of a show, in three parts, each in a thread of its own.

    Parameters
    ----------
    prepare
        Of a master that was read, while the one before is solved.
    solve
        Of what was prepared, in the command's own thread.
    finish
        Of what was solved, while the next is: write the result; figures, and a line for a person.
    """

    prepare: Callable[[Master], P]
    solve: Callable[[P], S]
    finish: Callable[[S, Write], tuple[dict[str, Any], str]]


@final
@dataclass(frozen=True)
class Done:
    """What became of a show.

    Parameters
    ----------
    frames
        Figures of the masters that were written, in order, with ``input`` and ``output`` added: a
        path, or the paths of left and right.
    failed
        Messages of those that were not.
    seconds
        ``total``, from the first file to the last; and the sums of ``reading`` (and preparing),
        ``solving`` and ``writing`` (and finishing), which overlap.
    """

    frames: list[dict[str, Any]]
    failed: list[str]
    seconds: dict[str, float]


def each_frame(
    show: Show,
    folder: Path,
    work: Work[P, S],
    console: Console,
    *,
    what: str,
    repair: bool = False,
    suffix: str | None = None,
    bits: int | None = None,
) -> Done:
    """Read each master of a show, do `work` on it, write its result to `folder` under its name.

    While one is solved, the next is read and the last is written: never more are in memory. With a
    `suffix`, such as ``.png``, or `bits` a sample, results are written so. A master that fails is
    named and leaves nothing behind; the others go on.

    Raises
    ------
    InputError
        If the folder cannot be made or written to, or an output would replace its input.
    """
    outputs = show.outputs(folder, suffix)
    for place in {path.parent for output in outputs for path in output} | {folder}:
        prepare(place)
    steps = _Steps(show, work, console, repair, bits)
    jobs = list(zip(show.moments, outputs, strict=True))
    began = time.perf_counter()
    reader, writer = (ThreadPoolExecutor(1, f"domesim-{name}") for name in ("read", "write"))
    with console.progress(what, len(jobs)) as start:
        try:
            ahead = reader.submit(steps.read, *jobs[0])
            behind: Future[None] | None = None
            for job, following in zip_longest(jobs, jobs[1:]):
                start(job[0][0].name)
                read = ahead.result()
                if following is not None:
                    ahead = reader.submit(steps.read, *following)
                solved = steps.solve(job[0], read)
                if behind is not None:
                    behind.result()
                behind = writer.submit(steps.finish, job[0], job[1], solved)
                del read, solved
            if behind is not None:
                behind.result()
        finally:
            # What is being written gets its name; nothing else is begun.
            reader.shutdown(cancel_futures=True)
            writer.shutdown()
    steps.done.seconds["total"] = time.perf_counter() - began
    return steps.done


Files: TypeAlias = tuple[Path, ...]


@final
class _Steps(Generic[P, S]):
    """The steps of `each_frame`: a mistake is handed on, to be told when its turn comes."""

    def __init__(
        self, show: Show, work: Work[P, S], console: Console, repair: bool, bits: int | None
    ) -> None:
        self.done = Done([], [], dict.fromkeys(("total", "reading", "solving", "writing"), 0.0))
        self._show, self._work, self._console = show, work, console
        self._repair, self._bits = repair, bits

    def read(self, moment: Files, output: Files) -> tuple[P, int] | InputError:
        """What was prepared, and how many samples were repaired."""
        with self._timed("reading"):
            try:
                with about(moment[0]):
                    master = self._show.read(moment, repair=self._repair)
                    require_writable(master, output, self._bits)
                    return self._work.prepare(master), master.repaired
            except InputError as error:
                return error

    def solve(self, moment: Files, read: tuple[P, int] | InputError) -> tuple[S, int] | InputError:
        """What was solved, and how many samples were repaired."""
        if isinstance(read, InputError):
            return read
        with self._timed("solving"):
            try:
                with about(moment[0]):
                    return self._work.solve(read[0]), read[1]
            except InputError as error:
                return error

    def finish(self, moment: Files, output: Files, solved: tuple[S, int] | InputError) -> None:
        """Write it, and tell what became of it."""

        def write(result: Master) -> Master:
            """Write it, and read it as others will."""
            write_master(result, output, bits=self._bits)
            packing = None if result.packing in ("single", "files") else result.packing
            return read_master(output, packing=packing, repair=True, allow_identical=True)

        try:
            if isinstance(solved, InputError):
                raise solved
            with self._timed("writing"), about(moment[0]):
                figures, line = self._work.finish(solved[0], write)
        except InputError as error:
            self.done.failed.append(str(error))
            complain(error)
            return
        self.done.frames.append({"input": _named(moment), "output": _named(output), **figures})
        if solved[1]:
            self.done.frames[-1]["repaired"] = solved[1]
            line += f"; {solved[1]} impossible samples repaired"
        names = " and ".join(path.name for path in moment)
        self._console.say(f"{names}: {line}\n  -> {', '.join(map(str, output))}")

    @contextmanager
    def _timed(self, step: str) -> Iterator[None]:
        began = time.perf_counter()
        try:
            yield
        finally:
            self.done.seconds[step] += time.perf_counter() - began


def _named(paths: tuple[Path, ...]) -> str | list[str]:
    return str(paths[0]) if len(paths) == 1 else [str(path) for path in paths]


def prepare(folder: Path) -> None:
    """Make `folder`, and see that files can be made in it, before hours of work on them.

    Raises
    ------
    InputError
        If it cannot be made or written to.
    """
    try:
        str(folder).encode()
    except UnicodeEncodeError:  # OpenImageIO could write there, but not read
        raise InputError(f"{folder}: wanted a folder named in UTF-8. Choose another.") from None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"{folder}: wanted a folder for the results, got '{reason(error)}'. "
            "Choose one that can be made and written to."
        ) from error


def prepare_file(path: Path, *, instead_of: Path | None = None) -> None:
    """See that the file `path` can be made, its folder, too, before hours of work on it.

    Parameters
    ----------
    path
        The file; one that is there already will be replaced.
    instead_of
        A file that must not be.

    Raises
    ------
    InputError
        If it cannot be made, or would replace `instead_of`.
    """
    prepare(path.parent)
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"{path}: wanted a file named in UTF-8. Choose another name.") from None
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        # A little longer, as the names that unfinished files have
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", suffix=".exr"):
            pass
    except OSError as error:
        raise InputError(
            f"{path}: wanted a file for the results, got '{reason(error)}'. Choose another name."
        ) from error
    # A link to the input is the input, too.
    if instead_of is not None and os.path.realpath(path) == os.path.realpath(instead_of):
        raise InputError(
            f"{path}: wanted a place for the result, got the input itself. Choose another name."
        )


def _printable(line: str) -> str:
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in line)


def _print(text: str) -> None:
    try:
        print(text, flush=True)
    except BrokenPipeError:
        raise  # whoever reads has had enough: typer ends the command quietly
    except OSError as error:
        raise InputError(
            f"standard output: wanted to write to it, got '{reason(error)}'. Send it elsewhere."
        ) from error
