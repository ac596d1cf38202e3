"""Reading ahead and writing behind: what may happen at once, in which order, and what if not."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, Master, write_frame
from domesim.host.console import Console
from domesim.light.strips import SAMPLES, in_strips
from domesim.shows import run
from domesim.shows.run import Done, Running, each_frame
from domesim.shows.show import Show
from domesim.shows.work import Column, Note, Recipe, Work, Write

LINEAR = ColourTag("linear", "BT.709", "the test")
PATIENCE = 30.0  # s: only what does not overlap waits that long
A_WHILE = 0.2  # s: for what must not happen to happen


@pytest.fixture
def show(tmp_path: Path) -> Show:
    """Three masters; the level tells which."""
    paths = []
    for number in (1, 2, 3):
        path = tmp_path / f"in.{number}.exr"
        pixels = np.full((4, 6, 3), number / 4, np.float32)
        write_frame(Frame(pixels, path, LINEAR, 32, True), path)
        paths.append((path,))
    return Show(tuple(paths))


def number_of(master: Master) -> int:
    return round(4 * float(master.pixels[0, 0, 0, 0]))


def nothing(number: int) -> None:
    pass


def work(
    *,
    preparing: Callable[[int], None] = nothing,
    solving: Callable[[int], None] = nothing,
    finishing: Callable[[int], None] = nothing,
    written: Callable[[int], None] = nothing,
) -> Work[Master, Master]:
    """Masters go through as they are; the functions hear of their numbers."""

    def prepare(master: Master) -> Master:
        preparing(number_of(master))
        return master

    def solve(master: Master) -> Master:
        solving(number_of(master))
        return master

    def finish(master: Master, write: Write) -> tuple[dict[str, Any], str]:
        finishing(number_of(master))
        write(master)
        stored = write.stored()
        written(number_of(stored))
        return {"number": number_of(stored)}, f"told {number_of(stored)}"

    return Work(prepare, solve, finish)


class Given(Recipe):
    """Work that is there already."""

    def __init__(self, work: Work[Master, Master]) -> None:
        self._work = work

    def work(self, note: Note) -> Work[Master, Master]:
        return self._work

    def settings(self) -> dict[str, Any]:
        return {}

    def columns(self) -> tuple[Column, ...]:
        return ()

    def memory(self, rows: int, cols: int) -> int:
        return 1


def do(show: Show, folder: Path, steps: Work[Master, Master]) -> Done:
    alone = Running(workers=0)
    return each_frame(show, folder, Given(steps), Console(), what="testing", running=alone)


def threads() -> set[str]:
    return {
        t.name for t in threading.enumerate() if t.name.startswith(("domesim-read", "domesim-w"))
    }


def test_what_frames_share_is_computed_once_before_the_first_is_prepared(
    show: Show, tmp_path: Path
) -> None:
    told: list[object] = []

    def ready(rows: int, cols: int) -> None:
        time.sleep(A_WHILE)
        told.append((rows, cols))
        raise InputError("which the work tells by itself")

    steps = replace(work(preparing=told.append), ready=ready)
    assert len(do(show, tmp_path / "out", steps).frames) == 3
    assert told == [(4, 6), 1, 2, 3]


def raising(error: BaseException) -> Callable[[int], None]:
    """Raises it at the second master."""

    def at_second(number: int) -> None:
        if number == 2:
            raise error

    return at_second


def test_the_next_is_read_and_the_last_written_while_one_is_solved(
    show: Show, tmp_path: Path
) -> None:
    meeting = threading.Barrier(3)

    def meet_at(wanted: int) -> Callable[[int], None]:
        return lambda number: meeting.wait(PATIENCE) and None if number == wanted else None

    steps = work(preparing=meet_at(3), solving=meet_at(2), finishing=meet_at(1))
    done = do(show, tmp_path / "out", steps)
    assert [frame["number"] for frame in done.frames] == [1, 2, 3]


@pytest.mark.parametrize(("ahead", "busy"), [("preparing", "solving"), ("solving", "finishing")])
def test_never_more_than_one_is_ahead(show: Show, tmp_path: Path, ahead: str, busy: str) -> None:
    """Neither read while one is solved, nor solved while one is written."""
    second, third = threading.Event(), threading.Event()
    early = []

    def begins(number: int) -> None:
        {2: second, 3: third}.get(number, threading.Event()).set()

    def is_busy(number: int) -> None:
        if number == 1:
            assert second.wait(PATIENCE)
            early.append(third.wait(A_WHILE))

    done = do(show, tmp_path / "out", work(**{ahead: begins, busy: is_busy}))
    assert early == [False]
    assert len(done.frames) == 3


@pytest.mark.parametrize("step", ["preparing", "solving", "finishing", "written"])
def test_the_middle_one_fails(
    show: Show, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    """Told in its turn: the first is still being written when the second fails."""
    failed = threading.Event()
    told: list[str] = []
    monkeypatch.setattr(run, "complain", lambda error: told.append(f"failed: {error}"))
    monkeypatch.setattr(Console, "say", lambda _, text: told.append(text))

    def fail(number: int) -> None:
        if number == 2:
            failed.set()
            raise InputError("out of luck")

    steps = {step: fail}
    if step in ("preparing", "solving"):
        waiting = {1: lambda: failed.wait(PATIENCE)}
        steps["finishing"] = lambda number: waiting.get(number, bool)() and None
    done = do(show, tmp_path / "out", work(**steps))
    assert [frame["number"] for frame in done.frames] == [1, 3]
    assert [Path(frame["output"]).name for frame in done.frames] == ["in.1.exr", "in.3.exr"]
    (message,) = done.failed
    assert "in.2.exr" in message
    assert "out of luck" in message
    read, first, *_ = told
    assert read == "in.1.exr: 6 x 4 EXR, 32 bit float, linear (assumed for EXR)"
    assert [text.split()[-1] for text in (first.split("\n")[0], told[2])] == ["1", "luck"]
    assert told[3].startswith("in.3.exr: told 3")
    assert threads() == set()


@pytest.mark.parametrize("step", ["preparing", "solving", "finishing"])
def test_it_ends_at_once_with_nothing_half_written(show: Show, tmp_path: Path, step: str) -> None:
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        do(show, out, work(**{step: raising(KeyboardInterrupt())}))
    assert [path.name for path in sorted(out.glob("[!.]*"))] == ["in.1.exr"]
    assert threads() == set()


def test_an_interruption_waits_for_what_is_being_written(show: Show, tmp_path: Path) -> None:
    out = tmp_path / "out"
    interrupted = threading.Event()

    def solving(number: int) -> None:
        if number == 2:
            interrupted.set()
            raise KeyboardInterrupt

    def finishing(number: int) -> None:
        assert interrupted.wait(PATIENCE)

    with pytest.raises(KeyboardInterrupt):
        do(show, out, work(solving=solving, finishing=finishing))
    assert [path.name for path in out.glob("[!.]*")] == ["in.1.exr"]
    assert threads() == set()


def test_seconds_by_step(show: Show, tmp_path: Path) -> None:
    done = do(show, tmp_path / "out", work())
    assert set(done.seconds) == {"total", "reading", "solving", "writing"}
    assert all(seconds > 0 for seconds in done.seconds.values())
    assert max(done.seconds.values()) == done.seconds["total"]


@pytest.mark.parametrize("shape", [(2, 5, 7, 3), (1, 3000, 500, 3), (2, 3, SAMPLES, 3)])
def test_strips_cover_all_rows_once(shape: tuple[int, ...]) -> None:
    counts = np.zeros(shape[:2], int)

    def count(view: int, rows: slice) -> int:
        counts[view, rows] += 1
        return rows.stop - rows.start

    assert sum(in_strips(count, shape)) == shape[0] * shape[1]
    assert (counts == 1).all()


def test_what_fails_after_it_was_written_leaves_nothing_behind(show: Show, tmp_path: Path) -> None:
    done = do(show, tmp_path / "out", work(written=raising(InputError("too late"))))
    assert [Path(reason.split(":")[0]).name for reason in done.failed] == ["in.2.exr"]
    assert sorted(path.name for path in (tmp_path / "out").glob("*.exr")) == [
        "in.1.exr",
        "in.3.exr",
    ]
