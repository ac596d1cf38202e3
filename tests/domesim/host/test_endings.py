"""What ends a command, and what only ends its printing."""

from __future__ import annotations

import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from batches import make_show
from command_line import Run

from domesim.host import endings
from domesim.host.console import Console, complain
from domesim.scene.writing import as_toml

SCENE = "dome_planetarium"


def command(folder: Path) -> list[str]:
    master, out = folder / "in/in.####.exr", folder / "out"
    command = ["observe", master, "--scene", SCENE, "--out", out, "--workers", 0]
    return [sys.executable, "-m", "domesim", *map(str, command)]


def results(folder: Path) -> list[Path]:
    return list((folder / "out").glob("*.exr"))


@pytest.mark.usefixtures("hangup")
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


RAW = "\x1b[31m\u202e\nforged: 12 of 12"
"""Colours, turns what follows around, and looks like a line of the command's own."""


@pytest.mark.parametrize("arguments", [(RAW,), (f"--{RAW}",), ("--output-bits", RAW), ()])
def test_arguments_that_are_not_understood_are_no_terminal_codes(
    run: Run, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    """A pattern of the shell's names files as they are."""
    outcome = run("observe", "a.png", *arguments, "--out", tmp_path / "out")
    assert outcome.code == 2
    assert outcome.err.startswith("Usage: ")
    assert all(line.isprintable() for line in outcome.err.splitlines())
    assert "\nforged" not in outcome.err


@pytest.mark.parametrize("command", ["observe", "compare", "tabulate"])
def test_a_scenes_name_is_no_terminal_code_and_may_be_any_bytes(
    run: Run, tmp_path: Path, command: str
) -> None:
    scene = tmp_path / os.fsdecode(b"caf\xe9.toml")
    name = json.dumps(RAW)
    scene.write_text(
        f"name = {name}\ndescription = {name}\nscreen = {{ albedo = 0.4 }}\n"
        "dome = { radius_m = 5.0 }\nprojector = { white_cd_m2 = 13.7 }\n"
        "viewing = { adaptation_cd_m2 = 1.4 }\n"
    )
    make_show(tmp_path / "in", 1, (16, 16))
    master = (tmp_path / "in/in.0001.exr").rename(tmp_path / f"{RAW.replace('/', '')}.exr")
    out = tmp_path / {"compare": "page.html", "tabulate": "light.npz"}.get(command, "out")
    words = (scene,) if command == "tabulate" else (master, "--scene", scene)
    outcome = run(command, *words, "--out", out)
    assert outcome.code == 0, outcome
    assert outcome.out
    for line in f"{outcome.out}{outcome.err}".splitlines():
        assert line.isprintable()
        assert not line.startswith("forged")


def test_what_was_measured_may_have_a_name_of_any_bytes() -> None:
    told = as_toml({"description": os.fsdecode(b"As measured: caf\xe9.toml.")})
    assert tomllib.loads(told.encode().decode()) == {"description": r"As measured: caf\udce9.toml."}
