"""Files are closed by whoever opens them, however it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from open_files import nothing_left_open, open_files
from videos import KINDS, write_numbered

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_frame, write_frame
from domesim.frames.film import write_film
from domesim.frames.formats import base
from domesim.frames.timing import Timing
from domesim.frames.video import frame_paths
from domesim.host.files import KEPT_OPEN
from domesim.pathtrace import layers
from scenes.artwork.night.__main__ import write as write_night
from scenes.artwork.night.picture import Night
from testing.masters import write_exr

NOISE = np.random.default_rng(1).random((200, 200, 3)).astype(np.float32)
VIDEO = ColourTag("bt1886", "BT.709", "the test")


def frame(rows: int = 200) -> Frame:
    return Frame(NOISE[:rows], Path("a.0001.png"), VIDEO, 8, floating=False)


@pytest.mark.parametrize("suffix", ["exr", "png", "tif", "jpg", "dpx", "j2k"])
def test_an_encoder_that_is_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    def interrupted(_: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(base, "problem_of", interrupted)
    with pytest.raises(KeyboardInterrupt), nothing_left_open():
        write_frame(frame(), tmp_path / f"x.{suffix}")
    assert not list(tmp_path.iterdir())


WRITERS: dict[str, Callable[[Path], None]] = {
    "frame": lambda path: write_frame(frame(), path),
    "layers": lambda path: layers.write_layers(path, {"": NOISE}, {}),
    "night": lambda path: write_night(path, NOISE, Night()),
    "master": lambda path: write_exr(path, NOISE),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_full_disk(small_disk: Path, writer: str) -> None:
    with pytest.raises((InputError, OSError)), nothing_left_open():
        WRITERS[writer](small_disk / "x.exr")
    assert writer == "master" or not list(small_disk.iterdir())


def test_layers_that_are_interrupted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(layers, "_write_rows", interrupted)
    with pytest.raises(KeyboardInterrupt), nothing_left_open():
        layers.write_layers(tmp_path / "x.exr", {"": NOISE}, {})
    assert not list(tmp_path.iterdir())


def films(folder: Path, frames: Iterator[Frame], suffix: str, sound: Path) -> None:
    write_film(folder / f"x{suffix}", frames, 9, VIDEO, Timing(Fraction(24), ""), sound=sound)


@pytest.mark.parametrize("suffix", [".mkv", ".mov"])
def test_a_film_of_unequal_frames(tmp_path: Path, suffix: str) -> None:
    pytest.importorskip("av")
    sound = write_numbered(tmp_path / "sound.mkv", KINDS["FFV1"], 3)
    with pytest.raises(InputError, match="one size and depth"), nothing_left_open():
        films(tmp_path, iter([frame(), frame(rows=100)]), suffix, sound)
    assert list(tmp_path.iterdir()) == [sound]


@pytest.mark.parametrize("suffix", [".mkv", ".mov"])
def test_a_film_on_a_full_disk(small_disk: Path, tmp_path: Path, suffix: str) -> None:
    pytest.importorskip("av")
    sound = write_numbered(tmp_path / "sound.mkv", KINDS["FFV1"], 3)
    with pytest.raises(InputError, match="no space left"), nothing_left_open():
        films(small_disk, iter([frame()] * 9), suffix, sound)
    assert not list(small_disk.iterdir())


def test_a_title_that_is_not_utf_8(tmp_path: Path) -> None:
    pytest.importorskip("av")
    title = {"title": "a dome"}
    path = write_numbered(tmp_path / "a.mkv", KINDS["FFV1"], 2, metadata=title)
    path.write_bytes(path.read_bytes().replace(b"a dome", b"a d\xf4me"))
    with nothing_left_open(), KEPT_OPEN:
        frames = iter([read_frame(each) for each in frame_paths(path)])
        write_film(tmp_path / "b.mkv", frames, 2, VIDEO, Timing(Fraction(24), ""), sound=path)


def test_the_last_few_videos_stay_open_until_they_are_closed(tmp_path: Path) -> None:
    pytest.importorskip("av")
    KEPT_OPEN.close()
    paths = [write_numbered(tmp_path / f"{k}.mkv", KINDS["FFV1"], 2) for k in range(6)]
    before = open_files()
    with nothing_left_open():
        for path in [*paths, *paths]:
            read_frame(frame_paths(path)[1])
        names = sorted(each.rpartition("/")[2] for each in open_files() - before)
        assert names == ["2.mkv", "3.mkv", "4.mkv", "5.mkv"]
        KEPT_OPEN.close()
    read_frame(frame_paths(paths[0])[0])  # which opens it again
    KEPT_OPEN.close()
