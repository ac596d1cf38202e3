"""A job's folder: one show and one kind of settings at a time, and records that can be believed."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
import unicodedata
from pathlib import Path
from typing import Any

import pytest
from batches import Harmful, copied, do_show, harmful_in, make_show, show_of

from domesim.errors import InputError
from domesim.host.console import Console
from domesim.shows.job import open_job
from domesim.shows.run import Running, each_frame
from domesim.shows.work import Writing

TESTS = Path(__file__).parents[2]


@pytest.fixture
def recipe(tmp_path: Path) -> Harmful:
    return harmful_in(tmp_path)


@pytest.fixture(autouse=True)
def _others_find_the_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(TESTS), str(TESTS.parent)]))


# One show.


def test_another_show_does_not_replace_the_first(tmp_path: Path, recipe: Harmful) -> None:
    """Two folders of masters with the same names, and one folder for both results."""
    for name, count in (("in", 2), ("other", 3)):
        make_show(tmp_path / name, count)
    copied(tmp_path, recipe, 0)
    before = (tmp_path / "out/in.0001.exr").read_bytes()
    other = show_of(tmp_path / "other")
    with pytest.raises(InputError, match=r"masters: \.\./in/in\.#\.exr there, \.\./other/in\.#"):
        do_show(other, tmp_path, recipe)
    assert (tmp_path / "out/in.0001.exr").read_bytes() == before
    assert len(do_show(other, tmp_path, recipe, mixed=True).frames) == 3
    assert do_show(show_of(tmp_path / "in"), tmp_path, recipe, anew=True).kept == 0


def test_a_show_is_the_same_however_it_is_named(
    tmp_path: Path, recipe: Harmful, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_show(tmp_path / "in", 2)
    copied(tmp_path, recipe, 0)
    monkeypatch.chdir(tmp_path / "in")
    for place in (Path(), Path("../in")):
        assert do_show(show_of(place), tmp_path, recipe).kept == 2
    tmp_path.rename(tmp_path.with_name("moved"))  # masters and results together
    monkeypatch.chdir(tmp_path.with_name("moved"))
    assert do_show(show_of(Path("in")), Path(), recipe).kept == 2


# One kind of settings.

START = """
import json, sys
from pathlib import Path
from batches import do_show, harmful_in, show_of
from domesim.shows.work import Writing
from domesim.commands import guarded
folder, depth = Path(sys.argv[1]), int(sys.argv[2])
show = show_of(folder / "in")
recipe = harmful_in(folder, seconds=float(sys.argv[3]))
print("ready", flush=True)
sys.stdin.readline()
with guarded():
    do_show(show, folder, recipe, Writing(bits=depth), anew="anew" in sys.argv)
"""


def client(folder: Path, depth: int, seconds: float = 0.0, *more: str) -> subprocess.Popen[str]:
    """A command that waits for a line before it begins."""
    process = subprocess.Popen(
        [sys.executable, "-c", START, str(folder), str(depth), str(seconds), *more],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def both(first: subprocess.Popen[str], second: subprocess.Popen[str]) -> list[tuple[int, str]]:
    """Let two begin at once; their exit codes and errors."""
    for process in (first, second):
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    errors = [process.communicate(timeout=300)[1] for process in (first, second)]
    return [(first.returncode, errors[0]), (second.returncode, errors[1])]


def settings_used(folder: Path) -> set[str]:
    """What the records of all results say."""
    records = (folder / "out/job").glob("in.*.json")
    return {json.loads(path.read_text())["settings"] for path in records}


def one_of_two_starts(folder: Path) -> None:
    """Two clients of other settings begin at once: one does all, the other is told why not."""
    make_show(folder / "in", 2)
    ended = both(client(folder, 16, 0.2), client(folder, 32, 0.2))
    assert sorted(code for code, _ in ended) == [0, 2], ended
    (refused,) = (errors for code, errors in ended if code)
    assert refused.count("\n") == 1
    assert "holds a job of other settings (bits: " in refused
    depth = 16 if ended[0][0] == 0 else 32
    assert json.loads((folder / "out/job/settings.json").read_text())["bits"] == depth
    assert len(settings_used(folder)) == 1
    assert not list((folder / "out/job/clients").iterdir())


def test_two_starts_never_make_two_settings(tmp_path: Path) -> None:
    one_of_two_starts(tmp_path)


@pytest.mark.long
def test_ten_starts_never_make_two_settings(tmp_path: Path) -> None:
    for start in range(10):
        one_of_two_starts(tmp_path / str(start))


def test_two_starts_of_one_kind_join(tmp_path: Path) -> None:
    make_show(tmp_path / "in", 2)
    assert [code for code, _ in both(client(tmp_path, 16), client(tmp_path, 16))] == [0, 0]
    assert len(settings_used(tmp_path)) == 1


def test_who_would_change_the_settings_is_told_who_works_there(tmp_path: Path) -> None:
    make_show(tmp_path / "in", 2)
    at_work = client(tmp_path, 16, 30.0)
    assert at_work.stdin is not None
    at_work.stdin.write("\n")
    at_work.stdin.flush()
    while not list((tmp_path / "log").glob("*")):
        time.sleep(0.02)
    later = client(tmp_path, 32, 0.0, "anew")
    _, errors = later.communicate("\n", timeout=300)
    assert later.returncode == 2
    assert f"process {at_work.pid}" in errors
    assert "since" in errors
    # Killed, it holds nothing any more
    at_work.send_signal(signal.SIGKILL)
    at_work.communicate()
    after = client(tmp_path, 32, 0.0, "anew")
    _, errors = after.communicate("\n", timeout=300)
    assert (after.returncode, errors) == (0, "")
    assert len(settings_used(tmp_path)) == 1


def test_a_worker_of_a_client_that_is_gone_does_not_mix(tmp_path: Path, recipe: Harmful) -> None:
    """A scheduler's worker may still do its frame when the next client has other settings."""
    make_show(tmp_path / "in", 2)

    def change(folder: Path) -> None:
        with open_job(folder, {"method": "another"}, anew=True):
            pass

    show = show_of(tmp_path / "in")
    with pytest.MonkeyPatch.context() as patch:
        # The lock is not kept here: the client of the first settings is gone
        patch.setattr("domesim.shows.job.Clients.share", lambda self: None)
        patch.setattr("domesim.shows.job.Clients.enter_alone", lambda self: True)
        original = Harmful.work

        def work(self: Harmful, note: Any) -> Any:
            change(tmp_path / "out")
            return original(self, note)

        patch.setattr(Harmful, "work", work)
        done = do_show(show, tmp_path, recipe)
    assert not done.frames
    assert "other settings meanwhile" in done.failed[0]
    assert not list((tmp_path / "out").glob("*.exr"))


# Records.


def test_every_flipped_bit_of_a_record_is_found_and_said(
    tmp_path: Path, recipe: Harmful, capsys: pytest.CaptureFixture[str]
) -> None:
    make_show(tmp_path / "in", 2)
    copied(tmp_path, recipe, 0)
    place = tmp_path / "out/job/in.0002.exr.json"
    for chance in range(16):
        whole = bytearray(place.read_bytes())
        said_before = json.loads(whole)
        draw = random.Random(chance)
        at = draw.randrange(len(whole))
        whole[at] ^= 1 << draw.randrange(8)
        place.write_bytes(whole)
        done = each_frame(
            show_of(tmp_path / "in"),
            tmp_path / "out",
            recipe,
            Console(),
            what="copying",
            running=Running(workers=0),
        )
        assert [frame["level"] for frame in done.frames] == pytest.approx([1 / 3, 2 / 3])
        said = capsys.readouterr().out
        if done.kept < 2:
            assert "in.0002.exr: done again: its record is damaged" in said
        else:  # white space
            assert json.loads(place.read_bytes()) == said_before


def test_damaged_settings_are_told_from_others(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 2)
    copied(tmp_path, recipe, 0)
    place = tmp_path / "out/job/settings.json"
    place.write_bytes(place.read_bytes().replace(b'"dither": false', b'"dither": fAlse'))
    with pytest.raises(InputError, match=r"settings\.json: .* damaged"):
        copied(tmp_path, recipe, 0)
    assert copied(tmp_path, recipe, 0, mixed=True).kept == 2


def test_why_a_frame_is_done_again_is_said(
    tmp_path: Path, recipe: Harmful, capsys: pytest.CaptureFixture[str]
) -> None:
    make_show(tmp_path / "in", 3)
    copied(tmp_path, recipe, 0)
    (tmp_path / "out/in.0001.exr").unlink()
    (tmp_path / "in/in.0002.exr").write_bytes((tmp_path / "in/in.0003.exr").read_bytes())
    show = show_of(tmp_path / "in")
    each_frame(show, tmp_path / "out", recipe, Console(), what="copying", running=Running(0))
    said = capsys.readouterr().out
    assert "in.0001.exr: done again: its result is not as it was written" in said
    assert "in.0002.exr: done again: its master has changed" in said
    assert "in.0003.exr: done again" not in said


# One program.


def test_frames_of_another_program_are_not_mixed_unless_told(
    tmp_path: Path,
    recipe: Harmful,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """An upgrade need not change the version's number: the code itself counts."""
    make_show(tmp_path / "in", 3)
    copied(tmp_path, recipe, 0)
    (tmp_path / "out/in.0003.exr").unlink()
    monkeypatch.setattr("domesim.shows.work.code_of", lambda *packages: "0" * 64)
    with pytest.raises(InputError, match=r"domesim: 0\.1\.0\+\w{8} there, 0\.1\.0\+00000000 now"):
        copied(tmp_path, recipe, 0)
    done = each_frame(
        show_of(tmp_path / "in"),
        tmp_path / "out",
        recipe,
        Console(),
        what="copying",
        writing=Writing(),
        running=Running(workers=0, mixed=True),
    )
    assert done.kept == 2
    assert "2 of them with other settings" in capsys.readouterr().out


# Somebody's files.


@pytest.mark.parametrize("theirs", ["IN.0002.EXR", "in.0002.exr", "\uff49n.0002.exr"])
def test_a_name_that_the_file_system_takes_for_a_results_is_somebodys(
    tmp_path: Path, recipe: Harmful, monkeypatch: pytest.MonkeyPatch, theirs: str
) -> None:
    """Those of Windows and macOS take other cases, or other letters, for the same name."""

    def is_there(path: Path) -> bool:
        names = (each.name for each in path.parent.iterdir())
        return path.name in {unicodedata.normalize("NFKC", name).lower() for name in names}

    make_show(tmp_path / "in", 3)
    (tmp_path / "out").mkdir()
    place = tmp_path / "out" / theirs
    place.write_text("somebody's")
    monkeypatch.setattr(os.path, "lexists", is_there)
    with pytest.raises(InputError, match=r"in\.0002\.exr: wanted a free place"):
        copied(tmp_path, recipe, 0)
    assert place.read_text() == "somebody's"
    assert list((tmp_path / "out").iterdir()) == [place]
