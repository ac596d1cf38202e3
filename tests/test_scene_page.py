"""docs/scene-new.md: its commands say what stands there, from nothing to a compensated frame."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from domesim.frames import ColourTag, Frame, read_frame, write_frame
from domesim.scene import load_scene

FOLDER = Path(__file__).parents[1] / "docs"
PAGE = (FOLDER / "scene-new.md").read_text()


@pytest.mark.long
def test_the_walk_says_what_the_page_says(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    Path("scenes").symlink_to(FOLDER.parent / "scenes")
    light = np.zeros((64, 64, 3), np.float32)
    light[40:50, 20:40] = 1
    colour = ColourTag("linear", "BT.709", "a test")
    write_frame(Frame(light, Path("frame.exr"), colour, 16, floating=True), Path("frame.exr"))
    blocks = re.findall(r"^```\n\$ domesim (.*?)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 6
    for command, said in blocks:
        code, out, err = run(*shlex.split(command))
        assert code == 0
        first, *rest = said.split("...\n")
        assert (out + err).startswith(first), command
        assert all(part in out for part in rest), command
    assert "<svg" in Path("advice.svg").read_text()
    assert not np.array_equal(read_frame(Path("out/frame.exr")).pixels, light)
    assert len(load_scene("mine.toml").theatre.lenses) == 5
    assert Path("mine.html").stat().st_size > 100_000


def test_its_pictures_are_there_and_small():
    named = re.findall(r"\]\((scene-new/[^)]+)\)", PAGE)
    assert sorted(named) == sorted(f"scene-new/{p.name}" for p in (FOLDER / "scene-new").iterdir())
    assert sum((FOLDER / name).stat().st_size for name in named) < 250_000
