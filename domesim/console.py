"""What commands say, and to whom: text for people, JSON for programs, progress on long work."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, final

from rich.console import Console as RichConsole
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from domesim.errors import InputError
from domesim.frames import Frame, read_frame, write_frame
from domesim.sequences import output_path


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

    def say(self, text: str) -> None:
        """A line for a person, on standard output."""
        if self._text:
            print(text, flush=True)

    def figures(self, figures: dict[str, Any]) -> None:
        """The command's figures, for a program."""
        if self._json:
            print(json.dumps(figures, indent=1, allow_nan=False))

    def complain(self, error: InputError) -> None:
        """A mistake, on standard error; the command goes on."""
        print(f"domesim: {error}", file=sys.stderr, flush=True)

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
            started = 0

            def start(name: str) -> None:
                nonlocal started
                bar.update(task, completed=started, description=f"{what} {name}")
                started += 1

            yield start
            bar.update(task, completed=started)


def each_frame(
    paths: Sequence[Path],
    folder: Path,
    work: Callable[[Frame], tuple[Frame, dict[str, Any], str]],
    console: Console,
    *,
    what: str,
    repair: bool = False,
) -> tuple[list[dict[str, Any]], list[str]]:
    """Read each frame, do `work` on it, write its result to `folder` under the same name.

    `work` returns the new frame, its figures and a line for a person. A frame that fails is named
    and leaves nothing behind; the others go on.

    Returns
    -------
    figures
        Of the frames that were written, in order, with ``input`` and ``output`` added.
    failed
        Messages of those that were not.

    Raises
    ------
    InputError
        If the folder cannot be made, or an output would replace its input.
    """
    outputs = [output_path(path, folder) for path in paths]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot make this folder: {error.strerror}") from None
    done, failed = [], []
    with console.progress(what, len(paths)) as start:
        for path, output in zip(paths, outputs, strict=True):
            start(path.name)
            try:
                frame = read_frame(path, repair=repair)
                result, figures, line = work(frame)
                write_frame(result, output)
            except InputError as error:
                failed.append(_about(path, error))
                console.complain(InputError(failed[-1]))
                continue
            done.append({"input": str(path), "output": str(output), **figures})
            if frame.repaired:
                done[-1]["repaired"] = frame.repaired
                line += f"; {frame.repaired} impossible samples repaired"
            console.say(f"{path.name}: {line}\n  -> {output}")
    return done, failed


def _about(path: Path, error: InputError) -> str:
    """The error's message, with the file's name in front if it isn't there already."""
    message = str(error)
    return message if path.name in message else f"{path}: {message}"
