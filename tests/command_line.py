"""The command, in this process and in its own, and what it did."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from open_files import nothing_left_open

from domesim import commands


class Outcome(NamedTuple):
    """What a run of the command did, as far as whoever started it sees."""

    code: int
    out: str
    err: str

    def is_refused(self, *words: str) -> None:
        """Exit code 2, and one line on standard error that has all `words`."""
        assert self.code == 2, self
        assert len(self.err.splitlines()) == 1, self.err
        assert self.err.startswith("domesim: ")
        for word in words:
            assert word in self.err

    def figures(self) -> dict[str, Any]:
        """Of ``--json``, when all went well."""
        assert (self.code, self.err) == (0, ""), self
        figures = json.loads(self.out)
        assert isinstance(figures, dict)
        assert not figures.get("failed")
        return figures


Run = Callable[..., Outcome]


def outcome(code: int, out: str, err: str) -> Outcome:
    assert "Traceback" not in out + err
    return Outcome(code, out, err)


def exit_code(*arguments: object) -> int:
    """Of ``domesim ARGUMENTS`` in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "excepthook", sys.excepthook)  # typer replaces it
        patch.setattr(sys, "argv", ["domesim", *map(str, arguments)])
        try:
            with nothing_left_open():
                commands.run()
        except SystemExit as end:  # pytest.raises would keep files open that frames hold
            code = end.code or 0
        else:
            pytest.fail("the command did not end with an exit code")
    assert isinstance(code, int)
    return code


def outcome_of(capfd: pytest.CaptureFixture[str], *arguments: object) -> Outcome:
    """Of ``domesim ARGUMENTS``. Descriptors are captured, for C++ libraries print, too."""
    capfd.readouterr()
    return outcome(exit_code(*arguments), *capfd.readouterr())


def run_for_real(*arguments: object, **options: Any) -> Outcome:
    """The command in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "domesim", *map(str, arguments)],
        text=True,
        check=False,
        timeout=300,
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options},
    )
    return outcome(done.returncode, done.stdout or "", done.stderr)
