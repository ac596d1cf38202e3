"""Displays that add light: what is seen through them is ambient light with a place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from stored_masters import store

from compensate.pose import Stage
from compensate.solve import solved
from compensate.subtract import subtracted
from domesim.errors import InputError
from domesim.scene import load_scene
from domesim.scene.loading import scene_content
from domesim.scene.writing import as_toml

ROWS, COLS = 12, 20
WHITE, BRIGHT, BLACK = 500.0, 200.0, 1.0
GLASSES = {
    "name": "glasses",
    "screen": {"width_m": 1.0, "height_m": 0.6},
    "projector": {"primaries": "BT.709", "white_cd_m2": WHITE, "black_cd_m2": BLACK},
    "viewing": {"distance_m": 2.0, "adaptation_cd_m2": 50.0},
    "ambient": {"luminance_cd_m2": BRIGHT, "photograph": "room.exr"},
}


def room(rows: int = ROWS, cols: int = COLS) -> np.ndarray:
    """A lit wall with a dark door."""
    light = np.linspace(0.2, 1.0, cols)[None, :, None] * np.array([1.0, 0.9, 0.7])
    light = np.repeat(light, rows, 0)
    light[rows // 2 :, cols // 4 : cols // 2] = 0.01
    return light.astype(np.float32)


def photographed(folder: Path, light: np.ndarray) -> Path:
    return store(folder / "room.exr", light, "float")


def scene(folder: Path, share: float = 0.0, **changes):
    content = {**GLASSES, "crosstalk": {"share": share}, **changes}
    (folder / "glasses.toml").write_text(as_toml(content))
    return load_scene(folder / "glasses.toml")


def master() -> np.ndarray:
    light = np.zeros((2, ROWS, COLS, 3), np.float32)
    light[0, 2:6, 3:9], light[1, 2:6, 5:11] = 0.9, 0.9
    return light


def behind() -> np.ndarray:
    """What the eyes see of nothing, written anew."""
    return room() * BRIGHT / WHITE + BLACK / WHITE


def test_it_is_seen_where_it_is(tmp_path):
    photographed(tmp_path, room())
    seen = scene(tmp_path, 0.05).observation(ROWS, COLS).observe(master())
    expected = master() + 0.05 * master()[::-1] + behind()
    assert seen == pytest.approx(expected, abs=1e-5)


def test_a_larger_photograph_is_averaged(tmp_path):
    stripes = np.tile([0.5, 2.0, 0.5], COLS)[None, :, None].astype(np.float32)  # of mean 1
    photographed(tmp_path, room().repeat(3, 0).repeat(3, 1) * stripes)
    seen = scene(tmp_path).observation(ROWS, COLS).observe(0 * master())
    assert seen[1] == pytest.approx(behind(), abs=1e-5)


def test_it_is_subtracted_where_there_is_light(tmp_path):
    photographed(tmp_path, room())
    observation = scene(tmp_path, 0.05).observation(ROWS, COLS)
    light, _ = subtracted(observation, master())
    needed = master() - 0.05 * light[::-1] - behind()
    assert light == pytest.approx(np.clip(needed, 0, 1), abs=1e-6)
    assert observation.observe(light)[0, 3, 4] == pytest.approx(0.9, abs=1e-6)


def test_black_stays_clear(tmp_path):
    """The aim paints no veils on the room: it is no ghost."""
    photographed(tmp_path, room())
    posed = Stage(scene(tmp_path)).pose(master())
    light = solved(posed, "perceptual").light
    assert light == pytest.approx(posed.subtractive, abs=1e-6)
    assert (light[master() == 0] == 0).all()


def test_another_photograph_is_another_scene(tmp_path):
    photographed(tmp_path, room())
    first = scene(tmp_path)
    photographed(tmp_path, 0.5 * room())
    assert scene(tmp_path).content != first.content
    content = scene_content(tmp_path / "glasses.toml")
    assert content["ambient"]["photograph"] == str((tmp_path / "room.exr").resolve())


def test_what_cannot_be_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"room\.exr"):
        scene(tmp_path)
    photographed(tmp_path, room())
    with pytest.raises(InputError, match="say how bright it is"):
        scene(tmp_path, ambient={"photograph": "room.exr"})
    with pytest.raises(InputError, match=r"neither \[lens\], \[room\] nor"):
        scene(tmp_path, lens={"throw_m": 3.0, "scattered": 0.01})
