"""Black levels and contrasts: by hand, and as ``domesim observe`` finds them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from domesim.inspection.photometry import BOARD, ghost, photometry
from domesim.measure.patterns.dome import BOARDS
from domesim.scene import load_dome, load_scene, load_stereo
from domesim.scene.loading import scene_of_text

THEATRE = """
name = "mine"
[dome]
radius_m = 4.0
half_angle_deg = 100.0
[screen]
albedo = [0.6, 0.5, 0.3]
[projector]
white_cd_m2 = 12.0
black_cd_m2 = 0.03
[projector.lens]
position_m = [0.5, 0.0, -0.2]
corrected = false
[viewing]
adaptation_cd_m2 = 1.0
"""


def test_an_ideal_hemisphere_by_hand():
    """White gets 1/3 of its light from itself, a checkerboard half as much in all fields."""
    found = photometry(load_dome("dome_hemisphere"), 64)
    assert found.direct == pytest.approx(10)
    assert found.reflected == pytest.approx(10 / 3)
    assert found.lit == pytest.approx(10 + 10 / 6, rel=1e-3)
    assert found.dark == pytest.approx(10 / 6, rel=1e-3)
    assert found.checkerboard == pytest.approx(7, rel=1e-3)
    assert found.sequential is None
    assert found.black == 0
    assert found.uneven == pytest.approx(1)


def test_black_is_everywhere():
    scene = load_dome("dome_hemisphere")
    found = photometry(replace(scene, ambient=0.5), 64)
    assert found.black == pytest.approx(0.5)
    assert found.white == pytest.approx(10 + 10 / 3 + 0.5)
    assert found.sequential == pytest.approx(found.white / 0.5)
    assert found.dark == pytest.approx(10 / 6 + 0.5, rel=1e-3)


def test_lumens_are_those_that_were_given():
    """Also where falloff is not evened out, and brightness differs from place to place."""
    text = THEATRE.replace("white_cd_m2 = 12.0", "lumens = 900.0")
    found = photometry(scene_of_text(text, "mine.toml", Path()), 128)
    assert found.lumens == pytest.approx(900, rel=2e-3)
    assert found.evened[1] > 1.1
    assert found.evened[0] < 0.95


def test_the_board_is_one_of_the_patterns():
    sectors, rings = BOARDS[1]
    assert f"checkerboard-{sectors}x{rings}-" == BOARD


def test_crosstalk_is_that_of_the_seat():
    scene = load_stereo("stereo_spectral")
    for name in scene.seats:
        found = ghost(scene, name)
        seat = scene.seats[name]
        factor = 1.0 if seat.share is None else seat.share.mean()
        assert found.matrices == pytest.approx(seat.matrices * factor, rel=1e-3)
    assert ghost(scene, "side").shares.mean() > 1.2 * ghost(scene, "sweet spot").shares.mean()


def test_left_is_not_right():
    """The table's last row and column: black sees all of white, white nothing of white."""
    scene = load_scene("stereo_shutter")
    found = ghost(scene, "sweet spot")
    assert np.diag(found.matrices[0]) == pytest.approx(0.024)
    assert np.diag(found.matrices[1]) == pytest.approx(0.02)
    # White's own light is less by what the other eye's black takes
    assert found.shares[0] == pytest.approx(0.024 / (1 - 0.024), rel=1e-6)
