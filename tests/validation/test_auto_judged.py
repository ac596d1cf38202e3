"""``--method auto`` by ColorVideoVDP itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from pair_films import EYES, P3, SCENE, film, three_shots

from compensate.pose import Stage
from domesim.frames import read_master
from domesim.scene import load_scene
from domesim.scene.screening import decoded
from testing.content.evening import lamps
from validation import judges


@pytest.mark.long
def test_no_frame_is_worse_by_the_judge_itself(run: Run, tmp_path: Path, out: Path) -> None:
    """A film of 24 pairs as stored, by ColorVideoVDP; not judged where that is not installed."""
    pytest.importorskip("pycvvdp")
    masters = film(tmp_path / "in", three_shots(320, lamps(320), 8))
    how = ("--scene", SCENE, "--method", "auto", "--out", out)
    assert run("compensate", *masters, *how).code == 0
    scene = load_scene(SCENE)
    stage, worst = Stage(scene), -np.inf
    for number in range(1, 25):
        names = [f"{eye}.{number:04d}.dpx" for eye in EYES]
        master, result = (
            np.clip(decoded(read_master([place / each for each in names], colour=P3), scene), 0, 1)
            for place in (tmp_path / "in", out)
        )
        posed = stage.pose(master)
        before, after = (
            judges.colorvideovdp(posed.wanted, posed.seen(light), scene)
            for light in (master, result)
        )
        worst = max(worst, before - after)
    assert worst < 0.01
