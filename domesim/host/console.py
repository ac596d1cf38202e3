"""What commands say, and to whom: text for people, JSON for programs, progress on long work."""

from __future__ import annotations

import errno
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, TextIO, cast, final

from domesim.errors import InputError, reason


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
        self._shows_bars = self._text and bool(sys.stderr) and sys.stderr.isatty()
        self._describe: Callable[[str], None] = lambda text: None

    def say(self, *lines: str) -> None:
        """Prints lines for a person; details of a line are indented below it."""
        if self._text:
            _print("\n".join(map(printable, lines)))

    def figures(self, figures: dict[str, Any]) -> None:
        """Prints the command's figures, for a program."""
        if self._json:
            _print(json.dumps(figures, indent=1, allow_nan=False))

    def note(self, text: str) -> None:
        """Shows beside the progress bar how the current work gets on."""
        self._describe(text)

    @contextmanager
    def share(self, what: str) -> Iterator[Callable[[float, str], None]]:
        """A progress bar for one long piece of work, with the time it will still take.

        Call what it yields with the share that is done (0..1) and how it gets on.
        """
        with self._bar(pieces=False) as bar:
            task = bar.add_task(what, total=1.0)
            yield lambda done, how: bar.update(task, completed=done, description=f"{what}, {how}")

    @contextmanager
    def progress(self, what: str, total: int) -> Iterator[Callable[[str], None]]:
        """A progress bar; call what it yields with the name of each piece as it starts."""
        with self._bar(pieces=True) as bar:
            task = bar.add_task(what, total=total)
            started, current = 0, ""

            def start(name: str) -> None:
                nonlocal started, current
                current = _printable(f"{what} {name}")
                bar.update(task, completed=started, description=current)
                started += 1

            self._describe = lambda text: bar.update(task, description=f"{current}, {text}")
            try:
                yield start
            finally:
                self._describe = lambda text: None
            bar.update(task, completed=started)

    def _bar(self, *, pieces: bool) -> Any:
        """A progress bar, which counts pieces or has a share."""
        if not self._shows_bars:
            return nullcontext(_Unseen())
        from rich import console, progress  # noqa: PLC0415 - fifty modules

        columns = (
            progress.TextColumn("{task.description}", markup=False),
            progress.BarColumn(),
            progress.MofNCompleteColumn() if pieces else progress.TaskProgressColumn(),
            progress.TimeElapsedColumn(),
            progress.TimeRemainingColumn(),
        )
        terminal = console.Console(file=cast(TextIO, _Sturdy(sys.stderr)))
        return progress.Progress(*columns, console=terminal)


@final
class _Unseen:
    """A progress bar where there is no terminal."""

    def add_task(self, _what: str, **_settings: Any) -> int:
        """Its number."""
        return 0

    def update(self, _task: int, **_settings: Any) -> None:
        """Nothing."""


def complain(message: object) -> None:
    """Prints a mistake on standard error."""
    with _heard(sys.stderr):
        print(f"domesim: {printable(str(message))}", file=sys.stderr, flush=True)


def printable(text: str) -> str:
    """Makes text safe for a terminal: names of files may hold line breaks and terminal codes.

    Lines of its own are indented.
    """
    return "\n  ".join(map(_printable, text.split("\n  ")))


def output_is_lost() -> bool:
    """Whether a write to standard output has failed."""
    return _lost


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Puts the file's name before the message of any `InputError` inside.

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
        raise type(error)(f"{path}: {error}") from error


def duration(seconds: float) -> str:
    """Formats a time for a person."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 90:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def _printable(line: str) -> str:
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in line)


def _print(text: str) -> None:
    global _lost  # noqa: PLW0603
    with _heard(sys.stdout) as problems:
        print(text, flush=True)
    # A pipe breaks when whoever reads has had enough
    if problems and problems[0].errno not in (errno.EPIPE, errno.EIO):
        _lost = True
        complain(
            f"standard output: wanted to write to it, got '{reason(problems[0])}'. The work goes "
            f"on without it. Send it elsewhere."
        )


_lost = False


@final
class _Sturdy:
    """A stream for progress bars that survives the end of its terminal."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> None:
        with _heard(self._stream):
            self._stream.write(text)

    def flush(self) -> None:
        with _heard(self._stream):
            self._stream.flush()


@contextmanager
def _heard(stream: TextIO) -> Iterator[list[OSError]]:
    """Collects the errors of a stream that cannot be written to; drops what it is sent after."""
    problems: list[OSError] = []
    try:
        yield problems
    except OSError as error:
        problems.append(error)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def sized(count: float) -> str:
    """Formats a number of bytes for a person."""
    unit, name = next(each for each in _UNITS if count >= each[0] or each is _UNITS[-1])
    return f"{count / unit:.3g} {name}"


_UNITS = ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB"))
