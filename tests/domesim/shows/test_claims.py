"""Commands that work in one folder divide its frames."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import batches
import pytest
import sharing
from batches import copied, harmful_in, make_show

from domesim.shows import clients
from domesim.shows.claims import FOLDER, Claims
from domesim.shows.clients import Clients, clients_of
from domesim.shows.job import FOLDER as JOB

ROOT = Path(__file__).parents[3]
FRAMES = 12


def started(folder: Path, seconds: float, workers: int = 0) -> subprocess.Popen[str]:
    """A command of its own that does the show of a folder."""
    return subprocess.Popen(
        [sys.executable, batches.__file__, str(folder), str(workers), str(seconds)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT / "tests"), str(ROOT)])},
    )


def ended(run: subprocess.Popen[str]) -> int:
    said, _ = run.communicate(timeout=300)
    assert "Traceback" not in said, said
    return run.returncode


def attempts(folder: Path) -> Counter[str]:
    """How often each frame was begun."""
    return Counter(path.name.rsplit(".", 1)[0] for path in (folder / "log").iterdir())


def results(folder: Path) -> dict[str, str]:
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((folder / "out").glob("[!.]*.exr"))
    }


def shared(folder: Path, count: int, *, killed: bool, seed: int, seconds: float = 0.05) -> None:
    """Starts commands together, and kills one of them at a random moment if that is asked for."""
    make_show(folder / "in", FRAMES)
    harmful_in(folder)
    chance = random.Random(seed)
    runs = [started(folder, seconds) for _ in range(count)]
    victim = runs[0] if killed else None
    if victim is not None:
        while not any((folder / "log").iterdir()):
            time.sleep(0.01)
        time.sleep(chance.uniform(0, FRAMES * seconds))
        victim.send_signal(signal.SIGKILL)
        victim.communicate()
    others = [run for run in runs if run is not victim]
    assert [ended(run) for run in others] == [0] * len(others)
    begun = attempts(folder)
    assert len(results(folder)) == len(begun) == FRAMES
    # A command reads ahead: of one that was killed, two frames were under way at most
    assert max(begun.values()) <= 1 + killed, begun
    assert sum(begun.values()) <= FRAMES + 2 * killed, begun
    assert not list((folder / "out" / JOB / FOLDER).iterdir())


def test_no_frame_is_done_twice(tmp_path: Path) -> None:
    shared(tmp_path, 2, killed=False, seed=0)


def test_frames_of_a_killed_command_are_done_by_the_other(tmp_path: Path) -> None:
    shared(tmp_path, 2, killed=True, seed=1)


@pytest.mark.long
def test_four_commands_divide_the_frames(tmp_path: Path) -> None:
    """Of 50 starts it was tried, too: ``STARTS=50 pytest -m long -k four_commands``."""
    for start in range(int(os.environ.get("STARTS", "3"))):
        shared(tmp_path / str(start), 4, killed=True, seed=start)


@pytest.mark.long
def test_shows_that_are_killed_have_the_bytes_of_one_that_is_not(tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    make_show(whole / "in", FRAMES)
    copied(whole, harmful_in(whole), 0)
    for number in range(6):
        folder, chance = tmp_path / str(number), random.Random(number)
        make_show(folder / "in", FRAMES)
        harmful_in(folder)
        for _ in range(3):
            run = started(folder, 0.05, workers=number % 2)
            time.sleep(chance.uniform(0.3, 3.0))
            run.send_signal(signal.SIGKILL)
            run.communicate()
        assert ended(started(folder, 0.0)) == 0
        assert results(folder) == results(whole)


def test_one_command_alone_makes_the_report(tmp_path: Path) -> None:
    make_show(tmp_path / "in", 2)
    recipe = harmful_in(tmp_path)
    page = copied(tmp_path, recipe, 0).report
    assert page is not None
    sums = page.with_name("SHA256SUMS")
    sums.unlink()
    with clients_of(page.parent) as other:
        theirs = claims_of(page.parent, other)
        assert theirs.take(page.name)
        at_work = threading.Timer(0.5, theirs.give_back, [page.name])
        at_work.start()
        done = copied(tmp_path, recipe, 0)
        at_work.join()
        assert (len(done.frames), done.failed, done.report) == (2, [], page)
        assert not sums.exists()
        assert theirs.take(page.name)
    copied(tmp_path, recipe, 0)  # the other one is gone
    assert sums.exists()
    assert not list((page.parent / FOLDER).iterdir())


@pytest.mark.parametrize("killed", [False, True])
def test_commands_that_have_a_folder_by_two_ways_divide_its_frames(
    tmp_path: Path, killed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the program `sharing` tries it where a folder is mounted twice."""
    (tmp_path / "one").mkdir()
    (tmp_path / "two").symlink_to("one")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT / "tests"), str(ROOT)]))
    done = sharing.shared([tmp_path / "one", tmp_path / "two"], killed=killed)
    assert set(done) <= ({1, 2} if killed else {1})
    assert done[2] <= 1


# One claim.


def claims_of(folder: Path, alive: Clients) -> Claims:
    alive.share()
    return Claims(folder, alive)


def test_a_claim_is_one_commands_until_it_is_given_back(tmp_path: Path) -> None:
    with clients_of(tmp_path) as first, clients_of(tmp_path) as second:
        ours, theirs = claims_of(tmp_path, first), claims_of(tmp_path, second)
        assert ours.take("a")
        assert ours.take("a")
        assert not theirs.take("a")
        assert theirs.take("b")
        ours.give_back("a")
        assert theirs.take("a")
        assert not ours.take("a")


def test_a_claim_ends_with_its_command(tmp_path: Path) -> None:
    with clients_of(tmp_path) as second:
        theirs = claims_of(tmp_path, second)
        with clients_of(tmp_path) as first:
            assert claims_of(tmp_path, first).take("a")
            assert not theirs.take("a")
        assert theirs.take("a")


def test_a_command_elsewhere_counts_as_gone_when_its_heart_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever its machine's clock says."""
    monkeypatch.setattr(clients, "LEASE", 0.4)
    monkeypatch.setattr(clients, "BEAT", 1e6)
    monkeypatch.setattr(clients.socket, "gethostname", lambda: "there")
    with clients_of(tmp_path) as first:
        assert claims_of(tmp_path, first).take("a")
        monkeypatch.setattr(clients.socket, "gethostname", lambda: "here")
        with clients_of(tmp_path) as second:
            theirs = claims_of(tmp_path, second)
            until, beats = time.monotonic() + 1.0, 0
            while time.monotonic() < until:
                beats += 1
                os.utime(tmp_path / "clients" / first.name, (beats * 1e8, beats * 1e8))
                assert not theirs.take("a")
                time.sleep(0.02)
            time.sleep(0.5)
            assert theirs.take("a")


def test_a_claim_that_another_takes_first_stays_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two see that a command is gone; the slower one does not remove the faster one's claim."""
    with clients_of(tmp_path) as second, clients_of(tmp_path) as third:
        fast, slow = claims_of(tmp_path, second), claims_of(tmp_path, third)
        (tmp_path / FOLDER / "a").write_text("gone.json")

        def meanwhile(_holder: str) -> bool:
            monkeypatch.undo()
            assert fast.take("a")
            return False

        monkeypatch.setattr(third, "works", meanwhile)
        assert not slow.take("a")
        assert (tmp_path / FOLDER / "a").read_text() == second.name
        assert [path.name for path in (tmp_path / FOLDER).iterdir()] == ["a"]


def test_a_claim_that_was_taken_away_is_not_given_back_by_who_had_it(tmp_path: Path) -> None:
    """A machine slept for longer than the lease, and wakes."""
    with clients_of(tmp_path) as first, clients_of(tmp_path) as second:
        ours, theirs = claims_of(tmp_path, first), claims_of(tmp_path, second)
        assert ours.take("a")
        (tmp_path / FOLDER / "a").write_text("gone.json")
        assert theirs.take("a")
        ours.give_back("a")
        assert not ours.take("a")


def test_a_command_that_was_taken_for_gone_is_heard_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clients, "BEAT", 0.02)
    with clients_of(tmp_path) as first:
        first.share()
        (tmp_path / "clients" / first.name).unlink()
        while not first.works(first.name):
            time.sleep(0.01)


def test_a_lock_that_another_machine_does_not_see_ends_no_command_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """sshfs, and NFS with ``local_lock``, let one on each machine enter alone."""
    monkeypatch.setattr(clients.socket, "gethostname", lambda: "there")
    with clients_of(tmp_path) as first:
        assert claims_of(tmp_path, first).take("a")
        monkeypatch.setattr(clients.socket, "gethostname", lambda: "here")
        monkeypatch.setattr(clients, "locked", lambda lock, alone: True)
        with clients_of(tmp_path) as second:
            assert second.enter_alone()
            assert not claims_of(tmp_path, second).take("a")


def test_a_command_of_before_the_machine_was_started_anew_is_gone(tmp_path: Path) -> None:
    with clients_of(tmp_path) as first, clients_of(tmp_path) as second:
        assert claims_of(tmp_path, first).take("a")
        place = tmp_path / "clients" / first.name
        who = json.loads(place.read_text())
        assert not claims_of(tmp_path, second).take("a")
        place.write_text(json.dumps(who | {"up": "before"}))
        assert claims_of(tmp_path, second).take("a")


def test_a_claim_that_is_refused_in_other_words_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """sshfs says "not permitted" where a file has come there by another way."""

    def refuse(path: Path, mode: str = "r", *arguments: Any, **options: Any) -> Any:
        if mode == "x":
            raise PermissionError(errno.EPERM, "not permitted")
        return original(path, mode, *arguments, **options)

    with clients_of(tmp_path) as first, clients_of(tmp_path) as second:
        ours, theirs = claims_of(tmp_path, first), claims_of(tmp_path, second)
        assert ours.take("a")
        original = Path.open
        monkeypatch.setattr(Path, "open", refuse)
        assert not theirs.take("a")
        assert theirs.take("b")  # nobody can claim: frames are done all the same


def test_a_claim_that_nobody_can_read_or_remove_ends_no_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clients, "LEASE", 0.05)
    with clients_of(tmp_path) as first:
        ours = claims_of(tmp_path, first)
        (tmp_path / FOLDER / "a").mkdir()
        assert not ours.take("a")
        time.sleep(0.1)
        assert ours.take("a")


@pytest.mark.long
def test_two_commands_share_the_frames(tmp_path: Path) -> None:
    """By frames that take longer than all else, and sleep: the machine's cores do not matter."""
    make_show(tmp_path / "in", FRAMES)
    harmful_in(tmp_path)
    runs = [started(tmp_path, 0.5) for _ in range(2)]
    assert [ended(run) for run in runs] == [0, 0]
    pids = Counter(path.read_text() for path in (tmp_path / "log").iterdir())
    assert len(pids) == 2
    assert min(pids.values()) >= FRAMES // 4, pids
