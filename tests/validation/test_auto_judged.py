"""``--method auto`` by ColorVideoVDP itself."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.util import find_spec
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
from testing.content.orbit import space
from testing.pairs import generated
from validation import judges


def gained(masters: Path, results: Path, count: int) -> np.ndarray:
    """(frame,) JOD of results as stored, less that of the untouched masters."""
    scene = load_scene(SCENE)
    stage, found = Stage(scene), []
    for number in range(1, count + 1):
        names = [f"{eye}.{number:04d}.dpx" for eye in EYES]
        master, result = (
            np.clip(decoded(read_master([place / each for each in names], colour=P3), scene), 0, 1)
            for place in (masters, results)
        )
        posed = stage.pose(master)
        before, after = (
            judges.colorvideovdp(posed.wanted, posed.seen(light), scene)
            for light in (master, result)
        )
        found.append(after - before)
    return np.array(found)


def moving(shots: Sequence[np.ndarray], each: int) -> list[np.ndarray]:
    return [np.roll(shot, 2 * k, axis=2) for shot in shots for k in range(each)]


judged = pytest.mark.skipif(find_spec("pycvvdp") is None, reason="ColorVideoVDP is not installed")


@judged
@pytest.mark.long
def test_no_frame_is_worse_by_the_judge_itself(run: Run, tmp_path: Path, out: Path) -> None:
    """A film of 24 pairs as stored, by ColorVideoVDP."""
    masters = film(tmp_path / "in", three_shots(320, lamps(320), 8))
    how = ("--scene", SCENE, "--method", "auto", "--out", out)
    assert run("compensate", *masters, *how).code == 0
    assert gained(tmp_path / "in", out, 24).min() > -0.01


@judged
@pytest.mark.long
def test_each_method_has_its_shot_by_the_judge_itself(run: Run, tmp_path: Path) -> None:
    """Lights before a night take the aim, a sky with texture subtraction, stars on black nothing.

    Strong veils (``--lift 4``) make the stars' shot worse than untouched; subtraction alone gives
    away what the aim gains. The choice does neither.
    """
    sky = np.clip(space(240), 0, 1)
    stars = np.where(sky > 0.02, sky, 0)
    each, methods = 4, ("perceptual", "subtractive", "none")
    masters = film(tmp_path / "in", moving([generated(240), sky, stars], each))
    gains = {}
    for method in ("auto", *methods[:2]):
        how = ("--scene", SCENE, "--lift", 4, "--as-given", "--out", tmp_path / method, "--json")
        result = run("compensate", *masters, *how, "--method", method)
        assert result.code == 0
        gains[method] = gained(tmp_path / "in", tmp_path / method, 3 * each).reshape(3, each)
        if method == "auto":
            cues = json.loads(result.out)["cues"]
            assert [cue["method"] for cue in cues] == list(methods)
    assert gains["auto"].min() > -0.01
    assert gains["perceptual"][2].max() < -0.01
    assert gains["auto"].mean() > gains["perceptual"].mean() + 0.005
    assert gains["auto"].mean() > gains["subtractive"].mean() + 0.005
