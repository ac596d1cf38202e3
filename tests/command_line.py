"""The command in this process."""

from __future__ import annotations

import sys

import pytest

from domesim import cli


def outcome_of(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], *arguments: object
) -> tuple[int, str, str]:
    """Of ``domesim ARGUMENTS``: exit code, standard output and standard error."""
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)  # typer replaces it
    monkeypatch.setattr(sys, "argv", ["domesim", *map(str, arguments)])
    capfd.readouterr()
    code: int = 0
    try:
        cli.run()
    except SystemExit as end:
        code = end.code or 0
    seen = capfd.readouterr()
    assert "Traceback" not in seen.out + seen.err
    return code, seen.out, seen.err
