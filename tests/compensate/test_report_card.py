"""The report card: crosstalk in Woods' words, and what two eyes see of a pair."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compensate.report_card import crosstalk
from domesim.frames import ColourTag, Frame, write_frame
from domesim.observation.crosstalk import leak_matrices
from domesim.scene import load_scene

SCENE = "stereo_polarised_paper"


def test_system_crosstalk_is_what_the_scene_says_for_each_eye():
    scene = load_scene(SCENE)
    matrices = np.stack([leak_matrices(0.02)[0], leak_matrices(0.08)[0]])
    seat = replace(scene.seats["sweet spot"], matrices=matrices)
    found = crosstalk(replace(scene, seats={"sweet spot": seat}))
    assert found["left"].system == pytest.approx(0.02)
    assert found["right"].system == pytest.approx(0.08)
    assert found["right"].extinction == pytest.approx(12.5)
    assert "not annoying" in found["left"].verdict
    assert "often acceptable" in found["right"].verdict


@pytest.mark.parametrize(
    ("share", "words"), [(0.005, "below a visible step"), (0.2, "more than is acceptable")]
)
def test_verdicts_go_with_the_limits(share, words):
    scene = load_scene(SCENE)
    matrices = np.stack([leak_matrices(share)[0]] * 2)
    seat = replace(scene.seats["sweet spot"], matrices=matrices)
    assert words in crosstalk(replace(scene, seats={"sweet spot": seat}))["left"].verdict


def test_the_worst_place_is_worse_than_the_mean():
    found = crosstalk(load_scene("stereo_cinema_silver"))["left"]
    assert found.worst > 1.2 * found.system
    assert found.system == pytest.approx(0.01255, abs=2e-4)


def test_a_pair_is_told_of(run, tmp_path):
    pytest.importorskip("cv2")
    colour = ColourTag("srgb", "BT.709", "test")
    random = np.random.default_rng(0)
    texture = random.random((40, 120)).astype(np.float32).repeat(2, 0).repeat(2, 1)
    for eye, at in (("L", 12), ("R", 4)):
        pixels = np.repeat(0.1 * texture[:, 30:190, None], 3, axis=2)
        pixels[30:50, 60 + at : 90 + at] += 0.6
        path = tmp_path / f"{eye}.png"
        write_frame(Frame(pixels, path, colour, 16, floating=False), path, bits=16)
    eyes = ("--left", tmp_path / "L.png", "--right", tmp_path / "R.png")
    found = run("report-card", SCENE, *eyes, "--json").figures()
    methods = found["pair"]["methods"]
    for figure in ("fused_loss", "contrast", "one_eye"):
        assert methods["none"][figure] > methods["subtractive"][figure] >= 0
    assert found["pair"]["viewer_crosstalk"]["share_above_10"] > 0.01
    assert 0 < found["pair"]["clipped"] < 1
    assert found["crosstalk"]["left"]["system"] == pytest.approx(0.011, abs=1e-3)
