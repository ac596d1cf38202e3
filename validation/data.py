"""Stereo pairs of the test data: photographs and renderings of ``SOURCES.tsv``, as they are.

All are Light (2, row, col, 3) in 0..1: the left eye's picture, and the right eye's. Trunks has
disparities of 94 to 168 pixels of 1920, all one way, because its camera did not converge.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from domesim.frames import read_master
from domesim.light import Light
from domesim.scene import Scene
from domesim.scene.screening import decoded, within_range
from validation.experiment import Missing

FOLDER = "DOMESIM_DATA"
"""Environment variable that names the folder of the test data."""

SEQUENCE = tuple(f"beachball {number}" for number in range(1, 5))
"""Names of successive frames."""

FILES: Mapping[str, tuple[str, ...]] = {
    "fog": ("stereo/fog_multiview.exr",),
    "trunks": ("stereo/trunks_1080p_L.exr", "stereo/trunks_1080p_R.exr"),
    "motorcycle": ("stereo/motorcycle_left.png", "stereo/motorcycle_right.png"),
    "fence": ("stereo/pair_fence_L.png", "stereo/pair_fence_R.png"),
    "museum": ("stereo/pair_museum_L.png", "stereo/pair_museum_R.png"),
    **{
        name: tuple(f"sequence/beachball_{number:04}_{eye}.exr" for eye in "LR")
        for number, name in enumerate(SEQUENCE, 1)
    },
}
"""Name -> files of the test data."""


def from_data(name: str, scene: Scene) -> tuple[Light, float]:
    """A pair of the test data, clipped to what the projector can show, and the share clipped.

    Raises
    ------
    Missing
        If its files are not there.
    """
    light = decoded(read_master(require(name)), scene)
    return within_range(light, scene.screen(*light.shape[1:3]))


def require(name: str) -> list[Path]:
    """The files of a pair of the test data.

    Raises
    ------
    Missing
        If they are not there.
    """
    paths = [data_folder() / file for file in FILES[name]]
    if absent := [path for path in paths if not path.is_file()]:
        raise Missing(f"needs {absent[0]}; set {FOLDER} to the folder of the test data")
    return paths


def present(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Those pairs of the test data that are there, and for the others why they are left out."""
    found, left_out = [], []
    for name in names:
        try:
            require(name)
        except Missing as missing:
            left_out.append(f"{name}: {missing}")
        else:
            found.append(name)
    return found, left_out


def data_folder() -> Path:
    """The folder of the test data: `FOLDER`, or beside the repository."""
    beside = Path(__file__).parents[2] / "shared" / "data"
    return Path(os.environ.get(FOLDER, beside))
