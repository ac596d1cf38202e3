"""What a show survives: ``make faults`` harms a dome show and a pair's, and tells what happened.

Each fault is done to a command while it works on a small show. The same command is then typed again
until it ends well, and its results are compared byte by byte with those of a run that nothing
happened to.
"""

from __future__ import annotations

import hashlib
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import psutil

from domesim.frames import ColourTag, Frame, write_frame
from domesim.host.system import ENDINGS

assert sys.platform != "win32"  # whose processes cannot be harmed like these

FRAMES, SIZE = 12, 64
_OTHER = {"dome_planetarium": "dome_hemisphere", "stereo_cinema_silver": "stereo_polarised_paper"}
"""Another scene for the same kind of master, by scene."""
_PATIENCE = 60.0  # s
_TAG = ColourTag("linear", "BT.709", "made up")


@dataclass(frozen=True)
class Show:
    """A show that is harmed.

    Parameters
    ----------
    name
        For a person.
    folder
        Its masters are in ``in``.
    arguments
        Arguments of the command, but for where results go.
    """

    name: str
    folder: Path
    arguments: tuple[str, ...]

    def start(
        self, out: Path, *more: str, limit: Callable[[], None] | None = None
    ) -> subprocess.Popen[str]:
        """Start the command in a session of its own, in which `limit` is called first."""
        command = [sys.executable, "-m", "domesim", *self.arguments, "--out", str(out), *more]
        with (self.folder / "log").open("a") as log:
            return subprocess.Popen(
                command,
                stdout=log,
                stderr=subprocess.STDOUT,
                text=True,
                start_new_session=True,
                env={**os.environ, "PYTHONFAULTHANDLER": "1"},
                preexec_fn=limit,  # noqa: PLW1509 - there are no threads here
            )


@dataclass(frozen=True)
class Fault:
    """Something that is done to a run.

    Parameters
    ----------
    name
        For a person.
    harm
        Does it, to the running command and its folder of results.
    more
        Arguments of the command besides.
    limit
        Sets a limit of the system for the first run.
    only_first
        Arguments that the first run has in addition.
    """

    name: str
    harm: Callable[[subprocess.Popen[str], Path], None]
    more: tuple[str, ...] = ("--workers", "2")
    limit: Callable[[], None] | None = None
    only_first: tuple[str, ...] = ()


def faults(show: Show) -> list[Fault]:
    """All that are tried of a show."""
    found = [
        Fault(f"{number.name} to the command and its workers", _send(number))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    ]
    alone = ("--workers", "0")
    return [
        *found,
        Fault("SIGTERM to a command without workers", _send(signal.SIGTERM), alone),
        Fault("kill -9 of the command", lambda run, out: run.kill()),
        Fault("kill -9 of a command without workers", lambda run, out: run.kill(), alone),
        Fault("kill -9 of one of two commands in its folder", _kill_one_of_two(show)),
        Fault("kill -9 of a worker", lambda run, out: _workers(run)[0].kill()),
        Fault(
            "SIGSTOP of a worker",
            lambda run, out: _workers(run)[0].suspend(),
            ("--workers", "2", "--frame-timeout", "5"),
        ),
        Fault("a folder of results that goes away", lambda run, out: _remove(out)),
        Fault("a folder of records that goes away", lambda run, out: _remove(out / "job")),
        Fault("a folder of claims that goes away", lambda run, out: _remove(out / "job/claims")),
        Fault("a flipped bit in each record", _each("job/[!.]*.*.json", _flip)),
        Fault("a flipped bit in each result", _each("[!.]*.exr", _flip)),
        Fault("results cut in half", _each("[!.]*.exr", lambda path: os.truncate(path, 300))),
        Fault("a flipped bit in the settings", _each("job/settings.json", _flip), alone),
        Fault("a table in whose place is a folder", _block),
        Fault(
            "other masters of its names, and another scene, into its folder: refused",
            _intrude(show),
        ),
        Fault("somebody's files of its results' names: refused", _theirs(show)),
        Fault("14 file handles", _wait, limit=_at_most(resource.RLIMIT_NOFILE, 14)),
        Fault("1 GB of address space", _wait, limit=_at_most(resource.RLIMIT_AS, 1000 << 20)),
        Fault(
            "a disk that takes 4 kB of a file", _wait, limit=_at_most(resource.RLIMIT_FSIZE, 4096)
        ),
        Fault("a scheduler that is none", _wait, only_first=("--scheduler", "tcp://127.0.0.1:9")),
    ]


def try_all(folder: Path) -> list[tuple[str, ...]]:
    """Rows of the table: what was done, what the command said, what was lost, seconds until it
    had all frames again.
    """
    rows: list[tuple[str, ...]] = []
    for show in (dome_show(folder / "dome"), pair_show(folder / "pair")):
        whole = show.folder / "whole"
        if _ended(show.start(whole)) != 0:
            raise RuntimeError((show.folder / "log").read_text())
        wanted = _results(whole)
        for number, fault in enumerate(faults(show)):
            out = show.folder / str(number)
            (show.folder / "log").unlink()
            rows.append((show.name, fault.name, *_tried(show, fault, out, wanted)))
            print(" | ".join(rows[-1]), flush=True)
    return rows


def _tried(show: Show, fault: Fault, out: Path, wanted: dict[str, str]) -> tuple[str, str, str]:
    """How the command ended, what was lost, and the seconds until it went on and was done."""
    run = show.start(out, *fault.more, *fault.only_first, limit=fault.limit)
    _until(lambda: len(_records(out)) >= 2 or run.poll() is not None)
    before = {path.name: path.read_bytes() for path in _records(out)}
    fault.harm(run, out)
    began = time.monotonic()
    found_later = run.poll() == 0
    code = _ended(run)
    said = (show.folder / "log").read_text()
    again = 0
    more: tuple[str, ...] = fault.more
    while _results(out) != wanted or code != 0 or (found_later and not again):
        if again == 3:
            return f"exit {code}", "NOT MENDED", "-"
        refused = "damaged, or was edited" in (show.folder / "log").read_text()
        more = (*fault.more, "--anew") if refused else fault.more
        with suppress(OSError):  # the folder that `_block` put there
            (out / "job/frames.csv").rmdir()
        code = _ended(show.start(out, *more))
        again += 1
    took = time.monotonic() - began
    kept = sum(path.read_bytes() == before.get(path.name) for path in _records(out))
    if "Traceback" in said or run.returncode == -signal.SIGABRT:
        Path(f"{out}.txt").write_text(said)
        return f"SAID TOO MUCH: {out}.txt", "nothing", f"{took:.0f}"
    happened = f"exit {_shown(run.returncode)}, {again} more run{'s' if again != 1 else ''}"
    if more[-1] == "--anew":
        happened += " (--anew)"
    lost = len(before) - kept
    return happened, f"nothing; {lost} of {len(before)} done again", f"{took:.0f}"


def dome_show(folder: Path) -> Show:
    """Masters of a dome."""
    _masters(folder / "in/show", 1)
    master = str(folder / "in/show.####.exr")
    return Show("dome", folder, ("observe", master, "--scene", "dome_planetarium"))


def pair_show(folder: Path) -> Show:
    """Masters of a pair in two sequences."""
    _masters(folder / "in/left", 2)
    _masters(folder / "in/right", 3)
    sides = (f"--{side}={folder / f'in/{side}.####.exr'}" for side in ("left", "right"))
    return Show("pair", folder, ("observe", *sides, "--scene", "stereo_cinema_silver"))


def _masters(stem: Path, seed: int) -> None:
    noise = np.random.default_rng(seed)
    stem.parent.mkdir(parents=True, exist_ok=True)
    for number in range(1, FRAMES + 1):
        _write(stem.with_name(f"{stem.name}.{number:04d}.exr"), noise)


def _write(path: Path, noise: np.random.Generator) -> None:
    pixels = noise.random((SIZE, SIZE, 3), np.float32)
    write_frame(Frame(pixels, path, _TAG, 16, floating=True), path)


def _send(number: signal.Signals) -> Callable[[subprocess.Popen[str], Path], None]:
    return lambda run, out: os.killpg(run.pid, number)


def _workers(run: subprocess.Popen[str]) -> list[psutil.Process]:
    children = psutil.Process(run.pid).children(recursive=True)
    return [each for each in children if "spawn_main" in " ".join(each.cmdline())]


def _each(
    pattern: str, harm: Callable[[Path], None]
) -> Callable[[subprocess.Popen[str], Path], None]:
    """Returns a function that harms files of a run that has ended; the next run finds them."""

    def do(run: subprocess.Popen[str], out: Path) -> None:
        _ended(run)
        for path in out.glob(pattern):
            harm(path)

    return do


def _wait(run: subprocess.Popen[str], out: Path) -> None:
    """Waits for the end: the harm was done before the run began."""
    _ended(run)


def _at_most(what: int, most: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(what, (most, most))


def _intrude(show: Show) -> Callable[[subprocess.Popen[str], Path], None]:
    """Returns a function that tries other masters, then another scene: both are refused."""

    def do(run: subprocess.Popen[str], out: Path) -> None:
        _ended(run)
        other, noise = show.folder / "other", np.random.default_rng(9)
        other.mkdir()
        for path in (show.folder / "in").iterdir():
            _write(other / path.name, noise)
        for old, new in (("/in/", "/other/"), (show.arguments[-1], _OTHER[show.arguments[-1]])):
            arguments = tuple(each.replace(old, new) for each in show.arguments)
            if (code := _ended(replace(show, arguments=arguments).start(out))) != 2:
                raise RuntimeError(f"{arguments} into a folder of others: exit {code}")

    return do


def _kill_one_of_two(show: Show) -> Callable[[subprocess.Popen[str], Path], None]:
    """Returns a function that starts another command, and kills the first; the other does all."""

    def do(run: subprocess.Popen[str], out: Path) -> None:
        other = show.start(out, "--workers", "2")
        _until(lambda: len(list((out / "job/clients").glob("*.json"))) == 2)
        run.kill()
        if (code := _ended(other)) != 0:
            raise RuntimeError(f"a command whose neighbour was killed: exit {code}")

    return do


def _theirs(show: Show) -> Callable[[subprocess.Popen[str], Path], None]:
    """Returns a function that tries a folder of somebody's files, which stay."""

    def do(run: subprocess.Popen[str], out: Path) -> None:
        _ended(run)
        theirs = out.with_name(f"{out.name}.theirs")
        theirs.mkdir()
        for path in out.glob("[!.]*.exr"):
            _write(theirs / path.name, np.random.default_rng(4))
        before = _results(theirs)
        code = _ended(show.start(theirs))
        if code != 2 or _results(theirs) != before or (theirs / "job").exists():
            raise RuntimeError(f"a folder of somebody's files: exit {code}")

    return do


def _flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def _remove(folder: Path) -> None:
    """Takes a folder away in one step, although somebody writes there."""
    folder.rename(folder.with_name(f"{folder.name}.gone"))


def _block(run: subprocess.Popen[str], out: Path) -> None:
    (out / "job/frames.csv").mkdir()


def _records(out: Path) -> list[Path]:
    return list((out / "job").glob("[!.]*.*.json"))


def _results(out: Path) -> dict[str, str]:
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in out.glob("[!.]*.exr")
    }


def _ended(run: subprocess.Popen[str]) -> int:
    """Its exit code; one that does not end tells where it is, and is ended."""
    try:
        return run.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        run.send_signal(signal.SIGABRT)
        return run.wait()


def _until(true: Callable[[], bool]) -> None:
    began = time.monotonic()
    while not true():
        if time.monotonic() - began > _PATIENCE:
            raise TimeoutError("the command did nothing")
        time.sleep(0.01)


def _shown(code: int) -> str:
    return str(code) if code >= 0 else f"by {signal.Signals(-code).name}"


def table(rows: Sequence[Sequence[str]]) -> str:
    """Table of docs/shows.md: a line for each fault, the dome's and the pair's figures together."""
    lines = ["| fault | dome: what happened | lost | s | pair: what happened | lost | s |"]
    lines.append("| --- " * 7 + "|")
    for name in dict.fromkeys(row[1] for row in rows):
        cells = [cell for row in rows if row[1] == name for cell in row[2:]]
        lines.append("| " + " | ".join([name, *cells]) + " |")
    return "\n".join(lines)


def _unignored() -> None:
    """Let commands hear the signals that nohup and a shell's & have ignored; this one does not."""
    for number in ENDINGS:
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, lambda number, frame: None)  # a handler is not inherited


if __name__ == "__main__":
    _unignored()
    with tempfile.TemporaryDirectory() as scratch:
        found = try_all(Path(scratch))
    print(table(found))
    sys.exit(any("NOT MENDED" in cell or "SAID TOO" in cell for row in found for cell in row))
