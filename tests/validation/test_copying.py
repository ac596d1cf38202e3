"""Shows by workers are compared with copies of the same frames, as many at once."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from domesim.errors import InputError
from validation.benchmarks import copying
from validation.benchmarks.commands import Job
from validation.benchmarks.copying import Compared
from validation.cli import bench


class Machine:
    """Copies and shows that only count; each copy waits until as many are under way as wanted."""

    def __init__(self, monkeypatch, at_once: int) -> None:
        self.done: list[str] = []
        self.most = self._under_way = 0
        self._lock, self._barrier = threading.Lock(), threading.Barrier(at_once)
        monkeypatch.setattr(copying, "_copy", self._copy)
        monkeypatch.setattr(copying, "run_command", self._command)

    def _copy(self, master: Path, copied: Path) -> None:
        with self._lock:
            self._under_way += 1
            self.most = max(self.most, self._under_way)
        self._barrier.wait(timeout=60)
        with self._lock:
            self._under_way -= 1
            self.done.append(master.name)
        assert master.exists()
        assert copied.name != master.name

    def _command(self, *arguments: str) -> Job:
        self.done.append(" ".join(arguments))
        return Job(seconds=12, cpu_s=18, gib=1, figures={})


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_as_many_copies_as_workers_are_made_at_once_of_the_same_frames(monkeypatch, workers):
    machine = Machine(monkeypatch, workers)
    (found,) = copying.comparisons([workers], quick=True)
    frames = copying.FRAMES * workers
    assert machine.most == workers
    copied_before, shows, copied_after = (
        machine.done[:frames], machine.done[frames:-frames], machine.done[-frames:],
    )  # fmt: skip
    assert len(set(copied_before)) == frames
    assert sorted(copied_before) == sorted(copied_after)
    (show,) = shows
    assert f"--workers {workers} " in show
    assert f"--frames 1-{frames} " in show
    assert (found.workers, found.frames, found.busy) == (workers, frames, 1.5)


def test_a_show_is_told_in_copies():
    found = Compared(2, 12, seconds=30, cpu_s=54, copy_seconds=12, copy_cpu_s=21.6)
    assert found.ratio == 2.5
    assert found.busy == 1.8
    told = copying.line(found)
    assert "2.50" in told
    assert "4.50  (1.80 a copy)" in told
    assert "1.8 of" in told


@pytest.mark.parametrize(("given", "files"), [("0", True), ("two", True), ("2", False)])
def test_workers_that_cannot_be_are_refused(tmp_path, given, files):
    with pytest.raises(InputError, match="--workers"):
        bench(out=tmp_path, files=files, workers=given, quick=True, quiet=True, json=False)


def test_a_missing_oiiotool_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(copying, "OIIOTOOL", tmp_path / "oiiotool")
    with pytest.raises(InputError, match="oiiotool"):
        bench(out=tmp_path, files=True, workers="1", quick=True, quiet=True, json=False)


@pytest.mark.long
def test_a_show_and_copies_are_timed(tmp_path, monkeypatch):
    monkeypatch.setattr(copying, "FRAMES", 1)
    (found,) = copying.comparisons([1], quick=True)
    assert min(found.seconds, found.cpu_s, found.copy_seconds, found.copy_cpu_s) > 0
    assert found.cpu_s > found.copy_cpu_s
    assert copying.write(tmp_path, [found]).stat().st_size > 0
