"""docs/reproducible.md: its quick commands show what stands there."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from documented import ROOT, blocks

from domesim.frames import read_frame, write_frame

NIGHT = Path("scenes/masters/night.exr")
BLOCKS = list(blocks("docs/reproducible.md"))
SHELL = [block.text for block in BLOCKS if block.language == "bash"]
QUICK = [text for text in SHELL if "domesim master" not in text]


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A folder with a smaller master, where commands are run."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    NIGHT.parent.mkdir(parents=True)
    night = read_frame(ROOT / NIGHT)
    write_frame(replace(night, pixels=night.pixels[::8, ::8].copy()), NIGHT)


@pytest.mark.long
def test_quick_commands_show_what_the_page_says(clone):
    assert len(QUICK) == 2
    for text in QUICK:
        done = subprocess.run(["bash", "-ec", text], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    (python,) = (block.text for block in BLOCKS if block.language == "python")
    with redirect_stdout(StringIO()) as said:
        exec(python, {})
    steps, share = said.getvalue().removeprefix("steps: ").split(", of ")
    assert int(steps) <= 1
    assert float(share.split()[0]) < 1e-2
