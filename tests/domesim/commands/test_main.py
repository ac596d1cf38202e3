"""The process of the command: how it is set up before anything is loaded."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import version

import pytest
from command_line import exit_code

import domesim

PRINTING = """
import atexit, gc, os
from domesim.__main__ import main
names = "OPENBLAS_NUM_THREADS", "KMP_BLOCKTIME"
atexit.register(lambda: print(*(os.environ[name] for name in names), gc.isenabled()))
main()
"""


def settings(**given: str) -> list[str]:
    """Threads of BLAS, how long MKL's threads spin (ms), and whether garbage is collected."""
    own = ("OPENBLAS_NUM_THREADS", "KMP_BLOCKTIME")
    others = {name: value for name, value in os.environ.items() if name not in own}
    done = subprocess.run(
        [sys.executable, "-c", PRINTING, "--help"],
        env={**others, **given}, check=True, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stderr == ""
    return done.stdout.splitlines()[-1].split()


def test_no_librarys_threads_spin() -> None:
    assert settings() == ["1", "0", "True"]


def test_a_users_own_settings_hold() -> None:
    assert settings(OPENBLAS_NUM_THREADS="2", KMP_BLOCKTIME="9") == ["2", "9", "True"]


def test_too_little_address_space_is_told_before_a_library_crashes() -> None:
    command = f"ulimit -v 400000 && exec {sys.executable} -m domesim --help"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "wanted an address space of 1048576 kB at least, got 400000" in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_version_is_the_packages(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("--version") == 0
    assert capsys.readouterr().out == f"domesim {version('domesim')}\n"
    assert domesim.__version__ == version("domesim")


@pytest.mark.parametrize("command", [(), ("measure",)])
def test_no_line_of_help_is_cut_off(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert exit_code(*command, "--help") == 0
    told = capsys.readouterr().out
    assert "..." not in told.replace("[ARGS]...", "")
    assert max(map(len, told.splitlines())) <= 80
    entries = told.partition("Commands:\n")[2].split("\n  ")
    assert len(entries) > 4
    assert told.rstrip().endswith(".")


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("domesim comp", {"compare", "compensate"}),
        ("domesim measure resp", {"response"}),
        ("domesim observe --outp", {"--output-encoding", "--output-bits", "--output-packing"}),
        ("domesim observe a.exr --scene dome_d", {"dome_dark"}),
        ("domesim observe a.exr --scene ./dome_d", set()),  # files are the shell's own matter
    ],
)
def test_a_shell_completes(
    typed: str,
    completed: set[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("_DOMESIM_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(typed.count(" ")))
    assert exit_code() == 0
    assert set(capsys.readouterr().out.split()) == completed
