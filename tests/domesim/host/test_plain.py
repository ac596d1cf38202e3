"""What is no small plain file is refused at once, instead of read for ever."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.frames.video import frame_paths
from domesim.host.arrays import read_arrays
from domesim.measure.dome.file import read_survey
from domesim.readings.meter import read_readings
from domesim.room.furniture import from_file
from domesim.room.masks import read_mask
from domesim.scene import load_scene
from domesim.scene.mpcdi import read_mpcdi

READERS: dict[str, Callable[[Path], object]] = {
    "scene.toml": load_scene,
    "survey.toml": read_survey,
    "readings.csv": read_readings,
    "readings.ti3": read_readings,
    "transport.npz": lambda path: read_arrays(path, "a", "transport", ()),
    "picture.exr": read_frame,
    "film.mp4": frame_paths,
    "film.mkv": frame_paths,
    "lamps.mpcdi": read_mpcdi,
    "mask.png": read_mask,
    "seats.stl": lambda path: from_file(path, "seats", (0.1, 0.1, 0.1)),
}


@pytest.fixture
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Opening a pipe that nobody writes to would wait for ever."""

    def refuse(path: object, *arguments: object, **options: object) -> int:
        raise AssertionError(f"{path} was opened")

    monkeypatch.setattr(Path, "open", refuse)
    monkeypatch.setattr(Path, "read_bytes", refuse)


@pytest.mark.parametrize("name", READERS)
@pytest.mark.usefixtures("patience")
def test_a_pipe_is_not_opened(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match=f"{name}.*device or pipe"):
        READERS[name](tmp_path / name)


@pytest.mark.parametrize(
    "name", [name for name in READERS if not name.startswith(("picture", "film"))]
)
@pytest.mark.usefixtures("patience")
def test_a_giant_is_named_and_not_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.touch()
    os.truncate(path, 300 << 30)  # takes no room
    with pytest.raises(InputError, match=f"{name}.*MiB, got {300 << 10}"):
        READERS[name](path)
