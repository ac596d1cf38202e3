"""Shows: what is done is kept and not done again, and what goes wrong harms its own frame only."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import platform
import re
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from batches import LINEAR, Harmful, copied, do_show, harmful_in, make_show, show_of
from command_line import Run
from pyarrow import parquet

from domesim.errors import InputError
from domesim.frames import Frame, read_frame, write_frame
from domesim.host.console import Console
from domesim.host.writing import LIST, make_own, temporary_of
from domesim.shows import cluster, crew, job, report
from domesim.shows.estimate import estimate
from domesim.shows.job import FOLDER, open_job
from domesim.shows.report import Report
from domesim.shows.run import Running, crew_of, each_frame
from domesim.shows.show import find_show
from domesim.shows.work import Failed, Order, Writing
from testing.schedulers import more_workers, scheduler

PATIENCE = 180.0  # s: for what must happen to happen
TESTS = Path(__file__).parents[2]


@pytest.fixture
def recipe(tmp_path: Path) -> Harmful:
    return harmful_in(tmp_path)


@pytest.fixture(autouse=True)
def _workers_find_the_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(TESTS), str(TESTS.parent)]))


def is_whole(folder: Path, count: int) -> bool:
    """Whether all results are there, are right, and nothing else is."""
    names = [f"in.{number:04d}.exr" for number in range(1, count + 1)]
    out = folder / "out"
    found = sorted(path.name for path in out.iterdir() if path.name not in (FOLDER, LIST))
    return found == names and all(
        np.array_equal(read_frame(out / name).pixels, read_frame(folder / "in" / name).pixels)
        for name in names
    )


def until(true: Callable[[], bool]) -> None:
    began = time.monotonic()
    while not true():
        assert time.monotonic() - began < PATIENCE, "nothing happened"
        time.sleep(0.02)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(")")[-1].split()[0] != "Z"
    except OSError:
        return False


# What is kept, in this process.


def test_what_is_done_is_not_done_again(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 3)
    first = copied(tmp_path, recipe, 0)
    again = copied(tmp_path, recipe, 0)
    assert (first.kept, again.kept) == (0, 3)
    assert first.frames == again.frames
    assert recipe.begun() == ["in.0001.exr", "in.0002.exr", "in.0003.exr"]
    assert is_whole(tmp_path, 3)


def test_what_was_half_written_is_removed(tmp_path: Path, recipe: Harmful) -> None:
    """A process that is killed while it writes leaves temporary files."""
    make_show(tmp_path / "in", 2)
    copied(tmp_path, recipe, 0)
    names = ("out/in.0002.exr", "out/job/in.0002.exr.json")
    ask = "import sys; from domesim.host.writing import *; print(temporary_of(Path(sys.argv[1])))"
    left = [
        Path(subprocess.check_output([sys.executable, "-c", ask, tmp_path / name], text=True)[:-1])
        for name in names
    ]
    under_way = temporary_of(tmp_path / "out/in.0001.exr")  # of a process that lives
    for path in (*left, under_way, tmp_path / "out/in.0002.exr"):
        path.write_bytes(b"half")
    assert copied(tmp_path, recipe, 0).kept == 1
    assert not any(path.exists() for path in left)
    under_way.unlink()
    assert is_whole(tmp_path, 2)


def test_anew_is_of_the_frames_that_are_named(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 3)
    copied(tmp_path, recipe, 0)
    do_show(show_of(tmp_path / "in", "2"), tmp_path, recipe, anew=True)
    assert recipe.begun().count("in.0002.exr") == 2
    assert copied(tmp_path, recipe, 0).kept == 3


@pytest.mark.parametrize(
    "content", ["[]", '{"figures": 1}', '{"sources": null}', '{"sources": {"in.0002.exr": []}}']
)
def test_a_record_of_something_else_is_none(tmp_path: Path, recipe: Harmful, content: str) -> None:
    make_show(tmp_path / "in", 3)
    copied(tmp_path, recipe, 0)
    place = tmp_path / "out/job/in.0002.exr.json"
    changed = {**json.loads(place.read_text()), **dict(json.loads(content))}
    place.write_text(json.dumps(changed) if changed else content)
    done = copied(tmp_path, recipe, 0)
    assert len(done.frames) == 3
    assert is_whole(tmp_path, 3)


def test_another_program_does_no_frame(tmp_path: Path, recipe: Harmful) -> None:
    """Of a worker that came after the command had looked at all of them."""
    make_show(tmp_path / "in", 1)
    with open_job(tmp_path, {"domesim": "0.0.1"}) as another:
        place = (tmp_path / "in.0001.exr",)
        found = cluster.do(Order(show_of(tmp_path / "in"), place, recipe, Writing(), another))
    assert isinstance(found, Failed)
    assert "wanted domesim 0.0.1" in found.reason
    assert not recipe.begun()


def damage(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)


def touch(path: Path) -> None:
    path.write_bytes(path.read_bytes())


CHANGES: dict[str, tuple[Callable[[Path], object], bool]] = {
    "a damaged result": (lambda folder: damage(folder / "out/in.0002.exr"), True),
    "a lost result": (lambda folder: (folder / "out/in.0002.exr").unlink(), True),
    "a damaged record": (lambda folder: damage(folder / "out/job/in.0002.exr.json"), True),
    "half a record": (lambda folder: (folder / "out/job/in.0002.exr.json").write_text("{"), True),
    "another master": (
        lambda folder: (folder / "in/in.0002.exr").write_bytes(
            (folder / "in/in.0003.exr").read_bytes()
        ),
        True,
    ),
    "the same master, copied anew": (lambda folder: touch(folder / "in/in.0002.exr"), False),
}


@pytest.mark.parametrize("change", CHANGES)
def test_only_what_is_not_as_it_was_is_done_again(
    change: str, tmp_path: Path, recipe: Harmful
) -> None:
    make_show(tmp_path / "in", 3)
    copied(tmp_path, recipe, 0)
    act, matters = CHANGES[change]
    act(tmp_path)
    done = copied(tmp_path, recipe, 0)
    assert done.kept == 3 - matters
    assert recipe.begun().count("in.0002.exr") == 1 + matters
    assert is_whole(tmp_path, 3)


def test_no_worker_waits_for_results_to_be_read(
    tmp_path: Path, recipe: Harmful, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What no run has done is done before any of the other results is read to see if it holds."""
    make_show(tmp_path / "in", 4)
    copied(tmp_path, recipe, 0)
    (tmp_path / "out/job/in.0003.exr.json").unlink()
    damage(tmp_path / "out/in.0002.exr")
    begun_when_read: dict[str, list[str]] = {}
    original = job.sha256

    def sha256(path: Path) -> str:
        if path.parent.name == "out":
            begun_when_read.setdefault(path.name, recipe.begun())
        return original(path)

    monkeypatch.setattr(job, "sha256", sha256)
    assert copied(tmp_path, recipe, 0).kept == 2
    assert set(begun_when_read) == {f"in.{number:04d}.exr" for number in (1, 2, 3, 4)}
    assert all(begun.count("in.0003.exr") == 2 for begun in begun_when_read.values())
    assert recipe.begun().count("in.0002.exr") == 2
    assert len(recipe.begun()) == 6
    assert is_whole(tmp_path, 4)


def test_parts_of_a_show_belong_to_one_job(tmp_path: Path, recipe: Harmful) -> None:
    """As render farms do them: the same command for each range of frames."""
    make_show(tmp_path / "in", 4)
    copied_part = [
        subprocess.run(
            [sys.executable, "-c", PART, str(tmp_path), part], check=True, env=os.environ
        )
        for part in ("1-2", "4")
    ]
    assert len(copied_part) == 2
    # Each tells of its own frames, and reads no other's records
    assert frames_told(tmp_path, "-1-2") == ["0001", "0002"]
    assert frames_told(tmp_path, "-4") == ["0004"]
    assert not (tmp_path / "out/job/frames.csv").exists()
    assert "1 of 1 frames are done" in (tmp_path / "out/job/report-4.html").read_text()
    done = copied(tmp_path, recipe, 0)
    assert done.kept == 3
    assert frames_told(tmp_path) == ["0001", "0002", "0003", "0004"]


@pytest.mark.parametrize(
    ("same", "report"),
    [(("3-3", "3"), "report-3.html"), (("1-4x2", "3, 1", "1,3"), "report-1,3.html")],
)
def test_frames_have_one_report_however_they_are_written(
    tmp_path: Path, recipe: Harmful, same: tuple[str, ...], report: str
) -> None:
    """Farms hand out one frame as 3-3; a person says 3."""
    make_show(tmp_path / "in", 4)
    for part in same:
        do_show(show_of(tmp_path / "in", part), tmp_path, recipe)
        assert [path.name for path in (tmp_path / "out/job").glob("report*.html")] == [report]


def frames_told(folder: Path, part: str = "") -> list[str]:
    """Numbers of the frames in a table of the job's."""
    lines = (folder / f"out/job/frames{part}.csv").read_text().splitlines()
    return [line.split(",")[1].rsplit("/", 1)[-1][3:7] for line in lines[1:]]


PART = """
import sys
from pathlib import Path
from batches import do_show, harmful_in, show_of
folder = Path(sys.argv[1])
do_show(show_of(folder / "in", sys.argv[2]), folder, harmful_in(folder))
"""


def test_mixing_keeps_and_anew_does_not(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 2)
    copied(tmp_path, recipe, 0)
    place = tmp_path / "out/job/settings.json"
    place.write_text(place.read_text().replace("harm", "other"))
    with pytest.raises(InputError, match="command: other there, harm now"):
        copied(tmp_path, recipe, 0)
    assert copied(tmp_path, recipe, 0, mixed=True).kept == 2
    assert copied(tmp_path, recipe, 0, anew=True).kept == 0


def test_frames_of_other_settings_are_done_again(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 2)
    do_show(show_of(tmp_path / "in"), tmp_path, recipe, Writing(dither=True))
    do_show(show_of(tmp_path / "in", "1"), tmp_path, recipe, anew=True)
    assert copied(tmp_path, recipe, 0).kept == 1


def test_the_settings_of_each_frame_stay_known(tmp_path: Path, recipe: Harmful) -> None:
    """Whoever finds a frame can tell with what it was made, and by the digest that this is it."""
    make_show(tmp_path / "in", 3)
    copied(tmp_path, recipe, 0)
    (tmp_path / "out/in.0002.exr").unlink()
    show = show_of(tmp_path / "in")
    dithered = do_show(show, tmp_path, recipe, Writing(dither=True), mixed=True)
    assert dithered.kept == 2
    for number in (1, 2, 3):
        record = json.loads((tmp_path / f"out/job/in.{number:04d}.exr.json").read_text())
        place = tmp_path / "out/job/settings" / f"{record['settings']}.json"
        assert hashlib.sha256(place.read_bytes()).hexdigest() == record["settings"]
        assert json.loads(place.read_text())["dither"] == (number == 2)
        assert record["figures"]["settings"] == record["settings"]
    (other,) = {frame["settings"] for frame in dithered.frames[::2]}
    page = (tmp_path / "out/job/report.html").read_text()
    assert f'2 frames were made with other settings: <a href="settings/{other}.json">' in page
    assert page.count("other settings") == 1


def test_settings_are_the_same_however_they_are_named(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 2)
    for suffix in (None, ".exr", None):
        done = do_show(show_of(tmp_path / "in"), tmp_path, recipe, Writing(suffix))
    assert done.kept == 2


def test_there_are_no_more_workers_than_memory(tmp_path: Path, monkeypatch: Any) -> None:
    make_show(tmp_path / "in", 4)
    show, recipe = show_of(tmp_path / "in"), Harmful(tmp_path)
    monkeypatch.setattr("domesim.shows.run.cores", lambda: 4)
    monkeypatch.setattr(Harmful, "memory", lambda self, rows, cols: 10**9)
    for limit, workers in ((10**10, 4), (2.6e9, 2), (1, 1)):  # a container's
        monkeypatch.setattr("domesim.shows.run.limit_of_group", partial(float, limit))
        crew = crew_of(Running(), recipe, show)
        assert crew is not None
        assert crew.workers == workers


def test_a_single_file_is_no_job(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 1)
    show = find_show(str(tmp_path / "in/in.0001.exr"))
    done = each_frame(show, tmp_path / "out", recipe, Console(quiet=True), what="copying")
    assert [path.name for path in (tmp_path / "out").glob("[!.]*")] == ["in.0001.exr"]
    assert done.report is None


# Faults.


def test_a_truncated_master_fails_alone(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 3)
    path = tmp_path / "in/in.0002.exr"
    path.write_bytes(path.read_bytes()[:-40])
    done = copied(tmp_path, recipe, 0)
    assert [Path(frame["input"]).name for frame in done.frames] == ["in.0001.exr", "in.0003.exr"]
    (reason,) = done.failed
    assert "in.0002.exr" in reason
    assert not (tmp_path / "out/in.0002.exr").exists()


def test_a_fault_of_ours_fails_alone(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 2)
    done = copied(tmp_path, Harmful(recipe.log, faulty="in.0001.exr"), 0)
    (reason,) = done.failed
    assert "a fault of domesim itself: ZeroDivisionError: a fault of two lines" in reason
    assert "batches.py" in (tmp_path / "out/job/in.0001.exr.fault.txt").read_text()
    assert len(done.frames) == 1
    copied(tmp_path, recipe, 0)
    assert not (tmp_path / "out/job/in.0001.exr.fault.txt").exists()


@pytest.mark.parametrize("small_disk", ["432k"], indirect=True)
@pytest.mark.parametrize("workers", [0, 1])
def test_a_full_disk_leaves_what_is_whole(
    tmp_path: Path, small_disk: Path, recipe: Harmful, workers: int
) -> None:
    noise = np.random.default_rng(1)
    (tmp_path / "in").mkdir()
    for number in range(1, 10):
        path = tmp_path / "in" / f"in.{number:04d}.exr"
        pixels = noise.random((100, 100, 3), np.float32)
        write_frame(Frame(pixels, path, LINEAR, 32, floating=True), path)
    (tmp_path / "out").symlink_to(small_disk)
    done = copied(tmp_path, recipe, workers)
    *full, left = done.failed
    assert full
    assert done.frames
    assert all("space" in reason.lower() and "\n" not in reason for reason in full)
    # Days of work for nothing else
    assert len(done.frames) + len(full) <= len(recipe.begun()) < 9
    assert left == f"{9 - len(done.frames) - len(full)} of 9 frames were not begun after that"
    for frame in done.frames:
        name = Path(frame["input"]).name
        assert np.array_equal(
            read_frame(tmp_path / "out" / name).pixels,
            read_frame(tmp_path / "in" / name).pixels,
        )
    assert not list((tmp_path / "out").glob(".*.tmp-*"))
    again = copied(tmp_path, recipe, workers)
    # Those that have a record are not called lost
    left_again = 9 - len(done.frames) - (len(again.failed) - 1)
    assert again.failed[-1] == f"{left_again} of 9 frames were not begun after that"


@pytest.mark.parametrize("workers", [0, 2])
@pytest.mark.parametrize("gone", ["out", "out/job"])
def test_a_folder_that_goes_away_is_told_once(
    tmp_path: Path, recipe: Harmful, capsys: pytest.CaptureFixture[str], workers: int, gone: str
) -> None:
    make_show(tmp_path / "in", 30)
    done = copied(tmp_path, Harmful(recipe.log, removes=tmp_path / gone), workers)
    assert done.failed
    assert len(recipe.begun()) < 30
    assert done.report is None
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 3, errors
    assert "no such file or directory" in errors[0]
    assert "frames were not begun after that" in errors[1]
    assert "report.html" in errors[2]


def test_a_table_that_cannot_be_written_is_a_failure(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 2)
    make_own(tmp_path / "out/job")
    (tmp_path / "out/job/frames.csv").mkdir()
    done = copied(tmp_path, recipe, 0)
    assert len(done.frames) == 2
    (reason,) = done.failed
    assert "frames.csv" in reason
    assert done.report is not None
    assert "2 of 2 frames are done (copying, ended)" in done.report.read_text()


def test_a_killed_worker_loses_its_own_frame_only(tmp_path: Path, recipe: Harmful) -> None:
    """Kill -9 in the middle of a frame."""
    make_show(tmp_path / "in", 4)
    killed: list[int] = []

    slow = Harmful(recipe.log, seconds=1.0)

    def kill() -> None:
        until(lambda: bool(slow.pids()))
        pid = slow.pids().pop()
        os.kill(pid, signal.SIGKILL)
        killed.append(pid)

    killer = threading.Thread(target=kill)
    killer.start()
    done = copied(tmp_path, slow, 2)
    killer.join()
    assert killed
    assert not done.failed
    assert len(slow.begun()) == 5  # one of them twice
    assert is_whole(tmp_path, 4)


def test_workers_that_do_not_start_again_are_not_waited_for(
    tmp_path: Path, recipe: Harmful, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_show(tmp_path / "in", 2)
    monkeypatch.setattr(crew, "_LOST", "1ms")
    with pytest.raises(InputError, match="wanted 1 workers, got none: they died"):
        copied(tmp_path, Harmful(recipe.log, deadly="in.0001.exr"), 1)


def test_a_deadly_frame_is_given_up_and_named(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 4)
    deadly = Harmful(recipe.log, deadly="in.0002.exr", seconds=0.3)
    done = copied(tmp_path, deadly, 2)
    (reason,) = done.failed
    assert "in.0002.exr: given up; 3 workers died of it" in reason
    assert len(done.frames) == 3
    begun = deadly.begun()
    assert begun.count("in.0002.exr") == 3
    assert len(begun) == 6  # the others once
    report = (tmp_path / "out/job/report.html").read_text()
    assert "given up" in report


@pytest.mark.parametrize("holding", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_frame_without_end_is_given_up_and_named(
    tmp_path: Path, recipe: Harmful, *, holding: bool
) -> None:
    make_show(tmp_path / "in", 4)
    endless = Harmful(recipe.log, endless="in.0002.exr", holding=holding)
    done = copied(tmp_path, endless, 2, frame_timeout=1.5)
    (reason,) = done.failed
    assert "in.0002.exr: given up; 3 workers" in reason
    assert "were not done with it after 2 s. If that is too short, raise --frame-timeout" in reason
    assert len(done.frames) == 3
    begun = endless.begun()
    assert begun.count("in.0002.exr") == 3
    assert len(begun) == 6  # the others once
    until(lambda: not any(alive(pid) for pid in endless.pids()))
    assert not (tmp_path / "out/in.0002.exr").exists()


@pytest.mark.parametrize("where", ["here", pytest.param("elsewhere", marks=pytest.mark.long)])
def test_a_worker_that_stands_still_is_given_up(
    tmp_path: Path, recipe: Harmful, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """It cannot end itself, nor can anybody ask it to."""
    monkeypatch.setattr(cluster, "_SILENCE", 1.0)
    make_show(tmp_path / "in", 4)
    slow = Harmful(recipe.log, seconds=0.5)
    stopped: list[int] = []

    def stop() -> None:
        until(lambda: bool(slow.pids()))
        stopped.append(slow.pids().pop())
        os.kill(stopped[0], signal.SIGSTOP)

    stopper = threading.Thread(target=stop)
    stopper.start()
    try:
        if where == "here":
            done = copied(tmp_path, slow, 1, frame_timeout=4.0)
        else:
            with scheduler(2) as (address, _):
                done = copied(tmp_path, slow, 0, scheduler=address, frame_timeout=4.0)
    finally:
        stopper.join()
        with suppress(ProcessLookupError):
            os.kill(stopped[0], signal.SIGKILL)
    assert not done.failed
    assert len(slow.begun()) == 5  # one of them twice
    assert is_whole(tmp_path, 4)


@pytest.mark.long
def test_a_worker_that_stands_still_at_the_end_is_ended(tmp_path: Path, recipe: Harmful) -> None:
    """Python waits for its children when it ends."""
    make_show(tmp_path / "in", 3)
    process = program(tmp_path, 2, 1.0)
    until(lambda: len(records(tmp_path)) == 2 and len(recipe.begun()) == 3)
    busy = {int(path.read_text()) for path in recipe.log.glob("in.0003.exr.*")}
    (idle,) = recipe.pids() - busy
    os.kill(idle, signal.SIGSTOP)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    assert errors == ""
    assert not alive(idle)


def faults_of_a_second_array() -> int:
    """Pages that a process fetches for an array as large as one that was freed before."""
    np.ones(20_000_000, np.float32)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.ones(20_000_000, np.float32)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries aren't told")
def test_a_worker_keeps_the_memory_of_its_last_frame() -> None:
    """In threads that begin before it could be told: else each frame fetches it anew."""
    with crew.client_of(crew.Crew(), print) as client:
        told = client.submit(faults_of_a_second_array, pure=False)
        assert told.result(PATIENCE) < 20


def test_a_frame_timeout_is_for_each_frame(tmp_path: Path, recipe: Harmful) -> None:
    """A worker does many more than one in that time."""
    make_show(tmp_path / "in", 6)
    done = copied(tmp_path, Harmful(recipe.log, seconds=0.5), 1, frame_timeout=2.0)
    assert len(done.frames) == 6
    assert len(recipe.begun()) == 6
    with pytest.raises(InputError, match="--frame-timeout must be at least 0"):
        copied(tmp_path, recipe, 1, frame_timeout=-1.0)
    for running, limit in (
        (Running(scheduler="tcp://node1:8786", frame_timeout=5.0), 5.0),
        (Running(2, frame_timeout=0.0), None),
    ):
        asked = crew_of(running, recipe, show_of(tmp_path / "in"))
        assert asked is not None
        assert asked.limit == limit
    idle = "import time; from domesim.shows import cluster as c\nwith c._within(0.3): pass\n"
    subprocess.run([sys.executable, "-c", f"{idle}time.sleep(0.6)"], check=True, env=os.environ)


def program(folder: Path, workers: int, seconds: float, *more: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(TESTS / "batches.py"), str(folder), str(workers), str(seconds), *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Whoever runs the tests in the background makes their children ignore Ctrl-C
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )


def records(folder: Path) -> dict[str, int]:
    """When each frame's record was written."""
    return {path.name: path.stat().st_mtime_ns for path in (folder / "out/job").glob("in.*.json")}


@pytest.mark.usefixtures("hangup")
@pytest.mark.parametrize(
    "end",
    [
        "SIGKILL",
        "SIGINT",
        *(pytest.param(end, marks=pytest.mark.long) for end in ("SIGTERM", "SIGHUP")),
    ],
)
def test_a_run_that_was_ended_goes_on(end: str, tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 6)
    process = program(tmp_path, 2, 0.5)
    until(lambda: len(recipe.begun()) >= 4)
    if end == "SIGKILL":
        process.kill()
    else:  # as a terminal, SLURM and systemd do: to the workers, too
        os.killpg(process.pid, signal.Signals[end])
    _, errors = process.communicate(timeout=PATIENCE)
    pids = recipe.pids()
    until(lambda: not any(alive(pid) for pid in pids))  # no worker outlives the command
    before, begun = records(tmp_path), len(recipe.begun())
    assert len(before) >= 2
    page = (tmp_path / "out/job/report.html").read_text()
    assert "running" not in page
    assert "Last update: 20" in page
    if end != "SIGKILL":
        assert process.returncode == 128 + signal.Signals[end]
        assert "Traceback" not in errors
        assert f"{len(before)} of 6 frames are done; the same command goes on" in errors
        assert "(copying, stopped)" in page
    done = copied(tmp_path, recipe, 0)
    assert done.kept == len(before)
    assert {name: records(tmp_path)[name] for name in before} == before
    assert len(recipe.begun()) - begun == 6 - len(before)
    assert is_whole(tmp_path, 6)


class Interrupting(SimpleQueue[str]):
    """Ctrl-C comes when the third frame's end has just been heard of."""

    heard = 0

    def get(self, block: bool = True, timeout: float | None = None) -> str:
        key = super().get(block, timeout)
        self.heard += 1
        if self.heard == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return key


def test_ctrl_c_loses_no_frame_whenever_it_comes(
    tmp_path: Path, recipe: Harmful, monkeypatch: Any
) -> None:
    """The command once waited for ever for a frame that it had heard of."""
    make_show(tmp_path / "in", 40)
    monkeypatch.setattr(cluster, "SimpleQueue", Interrupting)

    def late(number: int, frame: Any) -> None:
        raise TimeoutError("still waiting")

    # Who runs tests in the background makes them ignore Ctrl-C
    usual = signal.default_int_handler
    handlers = {signal.SIGALRM: late, signal.SIGINT: usual}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    signal.setitimer(signal.ITIMER_REAL, PATIENCE / 3)
    try:
        with pytest.raises(KeyboardInterrupt):
            copied(tmp_path, recipe, 2)
        assert signal.getsignal(signal.SIGINT) is usual
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)
    kept = [name.removesuffix(".json") for name in records(tmp_path)]
    assert 3 <= len(kept) < 40
    assert sorted(kept) == recipe.begun()


def test_a_lost_scheduler_is_told_and_nothing_is_lost(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 6)
    with scheduler(2) as (address, head):
        process = program(tmp_path, 0, 1.0, address)
        until(lambda: len(records(tmp_path)) >= 1)
        head.kill()
        _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert f"{address}: lost it" in errors
    assert "Traceback" not in errors
    before = records(tmp_path)
    done = copied(tmp_path, recipe, 0)
    assert done.kept == len(before) >= 1
    assert is_whole(tmp_path, 6)


class Losing:
    """A client that lets go of all frames, and sees a little later that its scheduler is lost."""

    cluster = None

    def __init__(self, looks: int) -> None:
        self.looks = looks  # until it is seen that the scheduler is lost

    @property
    def status(self) -> str:
        self.looks -= 1
        return "running" if self.looks >= 0 else "connecting"

    def submit(self, *arguments: Any, **options: Any) -> Any:
        future = SimpleNamespace(key=str(time.monotonic_ns()), status="cancelled")
        future.add_done_callback = lambda tell: tell(future)
        return future


class Breaking(Losing):
    """One whose calls fail first."""

    def submit(self, *arguments: Any, **options: Any) -> Any:
        raise OSError("the connection was closed")


@pytest.mark.parametrize("kind", [Losing, Breaking])
def test_no_frame_is_blamed_for_a_lost_scheduler(
    tmp_path: Path, recipe: Harmful, monkeypatch: Any, kind: type[Losing]
) -> None:
    """Whatever is heard of first."""
    make_show(tmp_path / "in", 2)
    client = kind(5)
    monkeypatch.setattr(cluster, "client_of", lambda crew, tell: nullcontext(client))
    with pytest.raises(InputError, match="lost it"):
        copied(tmp_path, recipe, 2)
    assert client.looks >= -2  # it is not waited for longer than needed


class Forgetful(Losing):
    """One whose first answer is lost with the worker that has it."""

    def submit(self, task: Any, order: Any, **options: Any) -> Any:
        answers = iter([TimeoutError(), task(order)])

        def result(patience: float) -> Any:
            answer = next(answers)
            if isinstance(answer, TimeoutError):
                raise answer
            return answer

        future = SimpleNamespace(key=order.name, status="finished", result=result)
        future.add_done_callback = lambda tell: tell(future)
        return future


def test_a_result_that_is_lost_with_its_worker_is_waited_for(
    tmp_path: Path, recipe: Harmful, monkeypatch: Any
) -> None:
    make_show(tmp_path / "in", 2)
    client = Forgetful(sys.maxsize)
    monkeypatch.setattr(cluster, "client_of", lambda crew, tell: nullcontext(client))
    assert len(copied(tmp_path, recipe, 1).frames) == 2
    assert is_whole(tmp_path, 2)


def test_frames_that_a_scheduler_keeps_cancelling_are_given_up(
    tmp_path: Path, recipe: Harmful, monkeypatch: Any
) -> None:
    make_show(tmp_path / "in", 2)
    monkeypatch.setattr(cluster, "_SETTLING", 0.1)
    monkeypatch.setattr(cluster, "client_of", lambda crew, tell: nullcontext(Losing(sys.maxsize)))
    done = copied(tmp_path, recipe, 2)
    assert [reason.split(": ")[1] for reason in done.failed] == [
        "the scheduler keeps cancelling it"
    ] * 2


def test_frames_that_need_a_gpu_go_where_one_is(tmp_path: Path, recipe: Harmful) -> None:
    """Of two workers on loopback one says that it has a GPU."""
    make_show(tmp_path / "in", 4)
    with scheduler(1) as (address, _), more_workers(address, "GPU=1") as (with_gpu,):
        done = copied(tmp_path, Harmful(recipe.log, needs_gpu=True), 0, scheduler=address)
    assert len(done.frames) == 4
    assert recipe.pids() == {with_gpu}


def test_a_dry_run_tells_and_leaves_nothing(
    tmp_path: Path, recipe: Harmful, capfd: pytest.CaptureFixture[str]
) -> None:
    make_show(tmp_path / "in", 40)
    slow = Harmful(recipe.log, seconds=0.1)
    show = show_of(tmp_path / "in")
    figures = estimate(show, tmp_path / "out/frames", slow, Console(), Writing(), Running(0))
    said = capfd.readouterr()
    assert "a worker had a core for" in said.out + said.err  # it sleeps
    assert not (tmp_path / "out").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "log"]
    assert figures["frames"] == 40
    begun = slow.begun()
    assert 2 <= len(begun) == figures["sampled"] <= 8
    assert {begun[0], begun[-1]} == {"in.0001.exr", "in.0040.exr"}  # from all over the show
    assert figures["seconds_frame"] >= 0.05  # it sleeps twice as long; ends are not even
    assert figures["seconds_total"] >= 40 * figures["seconds_frame"]
    copied(tmp_path, recipe, 0)
    took = sum(path.stat().st_size for path in (tmp_path / "out").glob("*.exr"))
    assert figures["disk_total"] == pytest.approx(took, rel=0.02)


def test_a_dry_run_counts_the_report(
    tmp_path: Path, recipe: Harmful, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_show(tmp_path / "in", 3)
    monkeypatch.setattr(Report, "finish", lambda _: time.sleep(1))
    show, console = show_of(tmp_path / "in"), Console(quiet=True)
    figures = estimate(show, tmp_path / "out", recipe, console, Writing(), Running(0))
    assert figures["seconds_total"] > 1 > figures["seconds_frame"]


@pytest.mark.parametrize("workers", [0, 2])
def test_a_dry_run_of_one_master_tells_of_many_like_it(
    tmp_path: Path, recipe: Harmful, workers: int
) -> None:
    make_show(tmp_path / "in", 1)
    busy = Harmful(recipe.log, seconds=0.05)
    only = find_show(str(tmp_path / "in/in.0001.exr"))
    console, running = Console(quiet=True), Running(workers, threads=1 if workers else None)
    figures = estimate(only, tmp_path / "out", busy, console, Writing(), running, 36000)
    assert figures["frames"] == 36000
    assert set(busy.begun()) == {"in.0001.exr"}
    assert len(busy.begun()) == figures["sampled"] == 2 * max(1, workers)
    of_36 = estimate(only, tmp_path / "out", busy, console, Writing(), running, 36)
    assert figures["disk_total"] == 1000 * of_36["disk_total"]
    # It sleeps: what cores do in that time does not count its sleep
    assert 0 < 3600 * figures["core_hours"] < 36000 * figures["seconds_frame"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "log"]


def test_a_dry_run_of_what_cannot_be_done_says_so(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 3)
    for path in (tmp_path / "in").iterdir():
        path.write_bytes(b"no image")
    with pytest.raises(InputError, match="no frame of 3 could be done"):
        estimate(
            show_of(tmp_path / "in"),
            tmp_path / "out",
            recipe,
            Console(quiet=True),
            Writing(),
            Running(0),
        )


def test_the_report_leads_to_results_and_all_figures(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 11)
    done = copied(tmp_path, recipe, 0)
    assert done.report is not None
    page = done.report.read_text()
    links = re.findall(r'<td class="frame"><a href="([^"]+)"', page)
    assert len(links) == 11
    assert all((done.report.parent / link).is_file() for link in links)
    assert links[0].endswith("in.0011.exr")  # the brightest, which this recipe calls the worst
    assert 'http-equiv="refresh"' not in page  # it has ended
    assert frames_told(tmp_path) == [f"{number:04d}" for number in range(1, 12)]


def test_a_page_tells_how_far_it_is(tmp_path: Path, recipe: Harmful, monkeypatch: Any) -> None:
    monkeypatch.setattr(report, "EVERY", 0.0)
    make_show(tmp_path / "in", 3)
    place = tmp_path / "out/job/report.html"
    seen: list[str] = []
    original = report.Report.add

    def add(self: report.Report, *arguments: Any) -> None:
        original(self, *arguments)
        seen.append(place.read_text())

    monkeypatch.setattr(report.Report, "add", add)
    copied(tmp_path, recipe, 0)
    assert [re.findall(r"<h1>(\d of \d)", page) for page in seen] == [
        ["1 of 3"],
        ["2 of 3"],
        ["3 of 3"],
    ]
    assert all('http-equiv="refresh"' in page for page in seen)


def test_the_table_is_there_for_data_frames(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 3)
    copied(tmp_path, recipe, 0)
    table = parquet.read_table(tmp_path / "out/job/frames.parquet")
    assert table.column("level").to_pylist() == pytest.approx([0.25, 0.5, 0.75])
    assert "encoding.transfer" in table.column_names


@pytest.mark.long
def test_a_render_farm_does_each_frame_once(tmp_path: Path) -> None:
    """The Open Job Description template, by its own command line."""
    make_show(tmp_path / "in", 3, (64, 64))
    binaries = Path(sys.executable).parent
    settings = {
        "Master": tmp_path / "in/in.####.exr",
        "Scene": "dome_planetarium",
        "Out": tmp_path / "out",
        "Frames": "1-3",
        "FramesToATask": 2,
    }
    subprocess.run(
        [
            *(binaries / "openjd", "run", TESTS.parent / "docs/farm/compensate.openjd.yaml"),
            *(word for name, value in settings.items() for word in ("-p", f"{name}={value}")),
        ],
        check=True,
        capture_output=True,
        env={**os.environ, "PATH": f"{binaries}:{os.environ['PATH']}"},
    )
    assert len(list((tmp_path / "out").glob("in.*.exr"))) == 3
    assert len(records(tmp_path)) == 3
    assert frames_told(tmp_path, "-1-2") == ["0001", "0002"]
    assert frames_told(tmp_path, "-3") == ["0003"]


FLAMENCO = """
// Of Flamenco's manager what its job types use, as its manual has it
const job = { tasks: [], addTask(task) { this.tasks.push(task); } };
class Task {
    constructor(name, type) { Object.assign(this, { name, type, commands: [], after: [] }); }
    addCommand(command) { this.commands.push(command); }
    addDependency(task) { this.after.push(task.name); }
}
const author = {
    Task: (name, type) => new Task(name, type),
    Command: (name, parameters) => ({ name, parameters }),
};
function frameChunker(frames, size) {
    const [first, last] = frames.split("-").map(Number), chunks = [];
    for (let at = first; at <= last; at += size) {
        const end = Math.min(at + size - 1, last);
        chunks.push(at === end ? `${at}` : `${at}-${end}`);
    }
    return chunks;
}
"""


@pytest.mark.long
def test_flamencos_tasks_do_a_show(tmp_path: Path, run: Run) -> None:
    """Its JavaScript is run; the commands are run here, chunks in the other order."""
    driver = pytest.importorskip("playwright._impl._driver")
    node, _ = driver.compute_driver_executable()
    make_show(tmp_path / "in", 3, (16, 16))
    settings = {
        "master": str(tmp_path / "in" / "in.####.exr"),
        "scene": "dome_hemisphere",
        "out": str(tmp_path / "out"),
        "frames": "1-3",
        "chunk_size": 2,
    }
    job_type = (TESTS.parent / "docs/farm/compensate.flamenco.js").read_text()
    script = f"{FLAMENCO}{job_type}job.settings = {json.dumps(settings)}; compileJob(job);"
    script += "console.log(JSON.stringify([JOB_TYPE.settings.map((each) => each.key), job.tasks]));"
    told = subprocess.run([node, "-e", script], check=True, capture_output=True).stdout
    keys, tasks = json.loads(told)
    assert set(keys) == set(settings)
    *chunks, report = tasks
    assert report["after"] == [task["name"] for task in chunks]
    for task in (*chunks[::-1], report):
        (command,) = task["commands"]
        assert (command["name"], command["parameters"]["exe"]) == ("exec", "domesim")
        assert run(*command["parameters"]["args"]).code == 0
    assert len(list((tmp_path / "out").glob("in.*.exr"))) == 3
    assert frames_told(tmp_path, "-1-2") == ["0001", "0002"]
    assert frames_told(tmp_path) == ["0001", "0002", "0003"]


# Masters that go, and messages.


def test_results_whose_masters_are_gone_are_told_and_removed_on_request(
    tmp_path: Path, recipe: Harmful
) -> None:
    make_show(tmp_path / "in", 6)
    copied(tmp_path, recipe, 0)
    for number in (4, 5, 6):
        (tmp_path / "in" / f"in.{number:04d}.exr").unlink()
    edited = tmp_path / "out/in.0005.exr"
    edited.write_bytes(b"by hand")

    def sums() -> str:
        return (tmp_path / "out/job/SHA256SUMS").read_text()

    assert copied(tmp_path, recipe, 0).kept == 3
    assert "in.0003" in sums()
    assert "in.0004" not in sums()
    assert (tmp_path / "out/in.0004.exr").exists()
    assert copied(tmp_path, recipe, 0, prune=True).kept == 3
    left = sorted(path.name for path in (tmp_path / "out").glob("[!.]*.exr"))
    assert left == ["in.0001.exr", "in.0002.exr", "in.0003.exr", "in.0005.exr"]
    assert edited.read_bytes() == b"by hand"
    records = [path.name for path in (tmp_path / "out/job").glob("in.*.json")]
    assert sorted(records) == [f"in.{number:04d}.exr.json" for number in (1, 2, 3)]


def test_frames_of_a_part_are_not_left_over(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 3)
    copied(tmp_path, recipe, 0)
    show = find_show(str(tmp_path / "in" / "in.1-2####.exr"))
    do_show(show, tmp_path, recipe, prune=True)
    assert is_whole(tmp_path, 3)


def test_one_cause_is_told_a_few_times_and_counted(
    tmp_path: Path, recipe: Harmful, capsys: pytest.CaptureFixture[str]
) -> None:
    make_show(tmp_path / "in", 40)
    show = show_of(tmp_path / "in")
    for path in (tmp_path / "in").iterdir():
        path.unlink()
    done = do_show(show, tmp_path, recipe)
    assert len(done.failed) == 40
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 4, said
    assert "37 more like it" in said[-1]


def test_workers_of_another_version_are_told_once_and_leave_no_settings(
    tmp_path: Path,
    recipe: Harmful,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    make_show(tmp_path / "in", 12)
    with monkeypatch.context() as patch:
        patch.setattr("domesim.shows.run.program_of", lambda recipe: "0.0.1+another")
        done = copied(tmp_path, recipe, 0)
    assert not done.frames
    said = capsys.readouterr().err.splitlines()
    assert sum("install the same there" in line for line in said) == 1
    assert len(said) <= 2
    # With the right version there, the same command goes on
    assert len(copied(tmp_path, recipe, 0).frames) == 12


@pytest.mark.long
def test_a_scheduler_that_stands_still_is_told_and_ctrl_c_is_heard(tmp_path: Path) -> None:
    make_show(tmp_path / "in", 40)
    harmful_in(tmp_path)
    with scheduler(1) as (address, head):
        command = [sys.executable, str(TESTS / "batches.py"), str(tmp_path), "0", "0.5"]
        told = tmp_path / "told"
        command += [address, "loud"]
        with told.open("w") as file:
            run = subprocess.Popen(
                command,
                stdout=file,
                stderr=file,
                env={**os.environ, "SILENCE": "2"},
                # A shell's background job is deaf to it
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
            )
        try:
            until(lambda: len(list((tmp_path / "out/job").glob("in.*.json"))) > 1)
            head.send_signal(signal.SIGSTOP)
            until(lambda: "has not answered for" in told.read_text())
            run.send_signal(signal.SIGINT)
            until(lambda: "Ctrl-C again leaves them" in told.read_text())
            run.send_signal(signal.SIGINT)
            assert run.wait(PATIENCE) == 130
        finally:
            head.send_signal(signal.SIGCONT)
            run.kill()
            run.wait()
    assert "Traceback" not in told.read_text()


def test_a_file_system_that_turns_read_only_is_told_once(
    tmp_path: Path,
    recipe: Harmful,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    make_show(tmp_path / "in", 30)
    original = os.fsync

    def fsync(handle: int) -> None:
        if len(recipe.begun()) > 3:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        original(handle)

    monkeypatch.setattr("domesim.host.writing.os.fsync", fsync)
    done = copied(tmp_path, recipe, 0)
    assert 1 <= len(done.frames) <= 3
    assert len(recipe.begun()) < 8
    assert done.report is not None
    assert done.report.exists()
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 3, errors
    assert all("read-only" in line for line in errors[::2])
