"""What a bug report gets."""

from __future__ import annotations

import re
from importlib.metadata import version
from pathlib import Path

import pytest

from compensate.commands import doctor
from compensate.fourier import transforms


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without what takes seconds."""
    monkeypatch.setattr(doctor, "_gpu", lambda: "none")
    monkeypatch.setattr(doctor, "_SECONDS", 0.01)


@pytest.mark.usefixtures("_quick")
def test_one_screen_has_all(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DOMESIM_DATA", "/somewhere")
    outcome = run("doctor")
    assert (outcome.code, outcome.err) == (0, "")
    assert len(outcome.out.splitlines()) <= 24
    told = run("doctor", "--json").figures()["doctor"]
    assert told["domesim"].startswith(version("domesim"))
    assert told["FFT"] == transforms().__name__
    assert f"numpy {version('numpy')}" in told["Libraries"]
    assert "DOMESIM_DATA=/somewhere" in told["Settings"]
    assert re.match(r"\S+ [MGT]B/s written, \S+ [MGT]B free in ", told["Disk"])
    assert not list(tmp_path.iterdir())
    assert {"Extra fast", "Extra metrics", "Extra video"} <= set(told)
    assert "Extra dev" not in told


def test_what_is_missing_is_said():
    assert doctor._told(["numpy", "no-such-thing"]).endswith("; without no-such-thing")
    assert doctor._told(["no-such-thing"]) == "not installed (no-such-thing)"
    assert doctor._program("no-such-program", "--version") == "none"


def test_a_folder_that_takes_no_files():
    assert "which cannot be written to" in doctor._disk(Path("/proc"))
