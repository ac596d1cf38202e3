"""What measured pairs will leave of ghosts is what they leave: readings, photographs."""

from __future__ import annotations

import json

import numpy as np
import pytest
from foreseeing import held, left, night, posed_in
from rigs import LEFT, RIGHT, TO_LEFT, TO_RIGHT, Rig, masters
from studio import NOISE, Studio, random_maps, store_all

from compensate.figures import Appraisal
from domesim.observation.crosstalk import Crosstalk
from domesim.readings.meter import Noise, read_readings
from domesim.readings.pair import measured_pair
from domesim.scene import StereoScene, load_stereo
from domesim.scene.crosstalk_maps import load_maps
from domesim.scene.loading import scene_of_text

RIG_TOML = """\
name = "rig"
[screen]
width_m = 2.5
height_m = 1.4
[projector]
primaries = "measured"
[crosstalk]
readings = "rig.csv"
allow_negative = true
[viewing]
distance_m = 3.0
adaptation_cd_m2 = 5.0
"""


@pytest.mark.long
@pytest.mark.parametrize("noise", [Noise(0.003, 0.005), Noise(0.01, 0.0003)])
def test_pairs_by_readings(tmp_path, noise):
    """The rig is as it is, and readings are noisy, black's or all: each time another scene."""
    rig = Rig(noise=noise, repeats=3, ramps=False)
    found, seen = [], []
    for seed in range(160):
        (tmp_path / "rig.csv").write_text(rig.csv(seed))
        scene = scene_of_text(RIG_TOML, "rig", tmp_path)
        assert isinstance(scene, StereoScene)
        posed = posed_in(scene, night(scene, 27, 48, lift=0.2))
        found.append(Appraisal(posed).foreseen(posed.subtractive))
        pair = measured_pair(read_readings(tmp_path / "rig.csv"), allow_negative=True)
        # Ghosts as the rig has them, in the common gamut that was found
        inverse, mixed = np.linalg.inv(pair.gamut.primaries), pair.gamut.matrices
        leaks = [inverse @ LEFT @ TO_LEFT @ mixed[1], inverse @ RIGHT @ TO_RIGHT @ mixed[0]]
        black = scene.ambient / scene.projector.white
        room = Crosstalk(27, 48, np.stack(leaks), black=black)
        seen.append(left(posed, posed.subtractive, room))
    light, error = zip(*seen, strict=True)
    assert 0.90 <= held([one.light for one in found], light) <= 0.98
    assert 0.90 <= held([one.weighted for one in found], error) <= 0.98


def test_the_command_says_what_is_left(run, tmp_path):
    (tmp_path / "rig.csv").write_text(Rig(noise=Noise(0.003, 0.005), ramps=False).csv())
    (tmp_path / "rig.toml").write_text(RIG_TOML)
    left_file, right_file = masters(tmp_path)
    given = ("compensate", "--left", left_file, "--right", right_file, "--out", tmp_path / "out")
    said, figures = [], []
    for scene in (tmp_path / "rig.toml", "stereo_cinema_silver"):
        code, out, err = run(*given, "--scene", scene, "--anew")
        assert (code, err) == (0, "")
        said.append("as surely as the room was measured" in out)
        code, out, err = run(*given, "--scene", scene, "--anew", "--json")
        assert (code, err) == (0, "")
        figures.append(json.loads(out)["frames"][0])
    assert said == [True, False]
    for name in ("light_left", "error_left"):
        low, likely, high = figures[0][name]
        assert 0 < low < likely < high
        assert figures[1][name] is None


@pytest.mark.long
def test_pairs_by_photographs(tmp_path, run):
    """Each time another screen."""
    leaks = (0.015 * np.eye(3), 0.02 * np.eye(3))
    rows, cols = 45, 75
    found, seen = [], []
    for seed in range(60):
        maps = random_maps(np.random.default_rng(seed), (rows, cols))
        studio = Studio(maps, NOISE, matrices=leaks)
        path = store_all(tmp_path, studio, seed=1000 + seed, primaries=True)
        out = tmp_path / "mine.toml"
        code, _, err = run("measure", "crosstalk", path, "--out", out, "--allow-negative")
        assert (code, err) == (0, "")
        scene = load_stereo(out).with_maps(load_maps(out.with_suffix(".npz")))
        posed = posed_in(scene, night(scene, rows, cols, lift=0.2))
        found.append(Appraisal(posed).foreseen(posed.subtractive))
        black = scene.ambient / scene.projector.white
        room = Crosstalk(rows, cols, np.stack(leaks), share=maps, black=black)
        seen.append(left(posed, posed.subtractive, room))
    light, error = zip(*seen, strict=True)
    assert 0.90 <= held([one.light for one in found], light) <= 0.985
    assert 0.90 <= held([one.weighted for one in found], error) <= 0.985
