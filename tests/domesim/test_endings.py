"""What ends a command, and what only ends its printing."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from batches import make_show

from domesim import endings
from domesim.console import Console, complain

SCENE = "dome_planetarium"


def command(folder: Path) -> list[str]:
    master, out = folder / "in/in.####.exr", folder / "out"
    command = ["observe", master, "--scene", SCENE, "--out", out, "--workers", 0]
    return [sys.executable, "-m", "domesim", *map(str, command)]


def results(folder: Path) -> list[Path]:
    return list((folder / "out").glob("*.exr"))


def test_a_terminal_that_is_closed_ends_the_job_in_order(tmp_path: Path) -> None:
    """Progress bars and messages have nowhere to go then."""
    make_show(tmp_path / "in", 200, (64, 64))
    child, terminal = pty.fork()
    if child == 0:
        os.execv(sys.executable, command(tmp_path))
    began = time.monotonic()
    while len(results(tmp_path)) < 2 and time.monotonic() - began < 60:
        if select.select([terminal], [], [], 0.02)[0]:
            os.read(terminal, 1 << 16)
    os.close(terminal)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code == 129
    assert 2 <= len(results(tmp_path)) < 200
    assert "(observing, stopped)" in (tmp_path / "out/job/report.html").read_text()


def test_a_reader_that_has_had_enough_ends_the_printing_only(tmp_path: Path) -> None:
    """As of ``| head -1``."""
    make_show(tmp_path / "in", 30, (8, 8))
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command(tmp_path), text=True, **pipes) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline().startswith(SCENE)
        process.stdout.close()
        errors = process.stderr.read()
    assert (process.returncode, errors) == (0, "")
    assert len(results(tmp_path)) == 30


def test_a_second_sigterm_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """SLURM and systemd send several; only Ctrl-C means more the second time."""
    before = {each: signal.getsignal(each) for each in endings.ENDINGS}
    monkeypatch.setattr(endings, "_last", signal.SIGINT)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    heard: list[int] = []
    try:
        with endings.alike(), endings.heard_by(lambda: heard.append(1)):
            for each in (signal.SIGTERM, signal.SIGHUP, signal.SIGTERM):
                signal.raise_signal(each)
            assert heard == [1]
            assert endings.exit_code() == 143
            signal.raise_signal(signal.SIGINT)
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def test_names_reach_no_terminal_raw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Escape codes colour, move and rename; U+202E turns what follows around."""
    make_show(tmp_path / "in", 1, (8, 8))
    name = "\x1b[31m[red]\u202e.exr"
    master = (tmp_path / "in/in.0001.exr").rename(tmp_path / name)
    console = Console()
    result = os.fsdecode(b"out/caf\xe9")
    console.say(f"{master}: done\n  -> {result}")
    with console.progress("observing", 1) as start:
        start(name)
    complain(f"{master}: none")
    said, errors = capsys.readouterr()
    assert said.endswith(": done\n  -> out/caf\\udce9\n")
    for text in (said, errors):
        assert r"\x1b[31m[red]\u202e.exr" in text
        assert "\x1b" not in text
