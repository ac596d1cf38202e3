"""How many files a reader passes who follows a master's light to what is projected."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from types import FrameType

import numpy as np
import pytest

import compensate
import domesim
from compensate.master import compensate as compensated
from domesim.scene import load_scene

PACKAGES = [Path(package.__file__).parent for package in (compensate, domesim)]
MOST = 8
"""Files, but for those of `domesim.light`, which say what an array of light is."""


def files_that_get_light(light: np.ndarray, scene) -> list[str]:
    """Files with a function that gets an array of the light's size, as they are first entered."""
    found: dict[str, None] = {}

    def look(frame: FrameType, event: str, _: object) -> None:
        path = Path(frame.f_code.co_filename)
        if event != "call" or not any(path.is_relative_to(each) for each in PACKAGES):
            return
        values = frame.f_locals.values()
        if any(isinstance(v, np.ndarray) and v.shape[:3] == light.shape[:3] for v in values):
            found[f"{path.parent.name}/{path.name}"] = None

    threading.setprofile(look)
    sys.setprofile(look)
    try:
        compensated(light, scene)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return [name for name in found if not name.startswith("light/")]


@pytest.mark.parametrize("name", ["dome_imax", "stereo_cinema_silver"])
def test_light_passes_few_files(name):
    scene = load_scene(name)
    light = np.random.default_rng(0).random((scene.views, 96, 96, 3)).astype(np.float32) ** 6
    light *= scene.screen(96, 96)[None, :, :, None]
    files = files_that_get_light(light, scene)
    assert files[0] == "compensate/master.py"
    assert "compensate/subtract.py" in files
    assert len(files) <= MOST, files
