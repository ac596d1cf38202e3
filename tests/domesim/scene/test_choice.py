"""What a job knows its scene by: what the scene's file says, and what is in files named there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from domesim.observation.radiosity import radiosity
from domesim.scene import load_dome
from domesim.scene.choice import SceneChoice

DOME = """
name = "mine"
description = "a dome"
[dome]
radius_m = 5.0
[screen]
albedo = 0.4
[projector]
white_cd_m2 = 30.0
black_cd_m2 = 0.01
[viewing]
adaptation_cd_m2 = 1.0
[[projector.units]]
name = "one"
position_m = [0.0, -2.0, 0.0]
look_at_m = [0.0, 5.0, 0.0]
kind = "perspective"
field_deg = 120.0
mask = "mask.png"
[[meshes]]
name = "booth"
file = "booth.stl"
albedo = 0.1
"""
NO_FILES = DOME.partition("[[")[0]


def stored(folder: Path, text: str = DOME, *, size: float = 1.0, grey: int = 65535) -> Path:
    """A scene's file, and a mesh and a mask that it names."""
    folder.mkdir(exist_ok=True)
    (folder / "mine.toml").write_text(text)
    trimesh.creation.box((size, 1.0, 1.0)).export(folder / "booth.stl")
    mask = np.full((4, 6), 65535, np.uint16)
    mask[0, 1] = grey
    Image.fromarray(mask).save(folder / "mask.png")
    return folder / "mine.toml"


def content(path: Path, transport: Path | None = None, seat: str | None = None) -> str:
    choice = SceneChoice(str(path), transport, seat)
    return choice.settled(choice.load()).content


def test_the_same_scene_has_the_same_digest_wherever_it_is(tmp_path: Path) -> None:
    here = content(stored(tmp_path / "here"))
    assert len(here) == 64
    assert content(stored(tmp_path / "there", f"# a note\n{DOME}")) == here


CHANGES = {
    "a figure": {"text": DOME.replace("30.0", "31.0")},
    "its name": {"text": DOME.replace("mine", "yours")},
    "a place": {"text": DOME.replace("-2.0", "-2.1")},
    "a mesh": {"size": 1.01},
    "a mask": {"grey": 65534},
}


@pytest.mark.parametrize("change", CHANGES)
def test_another_scene_has_another_digest(tmp_path: Path, change: str) -> None:
    mine, other = (
        content(stored(tmp_path / name, **changed))
        for name, changed in (("mine", {}), ("other", CHANGES[change]))
    )
    assert mine != other


def test_another_transport_is_another_scene(tmp_path: Path) -> None:
    path = stored(tmp_path, NO_FILES)
    found = [content(path)]
    for resolution in (6, 7):
        transport = radiosity(load_dome(path).theatre, resolution=resolution)
        transport.save(tmp_path / "transport.npz")
        found.append(content(path, tmp_path / "transport.npz"))
    assert len(set(found)) == 3


def test_settings_tell_seats_apart(tmp_path: Path) -> None:
    one, two = (SceneChoice("stereo_cinema_silver", None, seat) for seat in (None, "all"))
    one, two = (choice.settled(choice.load()) for choice in (one, two))
    assert one.content == two.content
    assert one.settings() != two.settings()
