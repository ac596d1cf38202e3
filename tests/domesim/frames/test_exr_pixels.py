"""Our own EXR chunks are those of OpenImageIO, byte for byte, and are read to the same samples."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_frame
from domesim.frames.formats import exr
from domesim.frames.formats.base import Format
from domesim.frames.reading import read_image
from domesim.frames.writing import encoded

pytest.importorskip("deflate")

T = TypeVar("T")
RANDOM = np.random.default_rng(0)
LINEAR = ColourTag("linear", "BT.709", "made so")


def noise(*shape: int) -> np.ndarray:
    """Any halves: none of their chunks shrinks."""
    return RANDOM.integers(0, 0x7BFF, (*shape, 3), np.uint16).view(np.float16)


def ramp(*shape: int) -> np.ndarray:
    return (np.ones((*shape, 3)) * np.linspace(0, 1, shape[1])[:, None]).astype(np.float16)


def by_openimageio(work: Callable[[], T], monkeypatch: pytest.MonkeyPatch) -> T:
    with monkeypatch.context() as patch:
        patch.setattr(exr, "is_available", lambda: False)
        return work()


def frame_of(pixels: np.ndarray, compression: str, origin: tuple[int, int] = (0, 0)) -> Frame:
    """As if it came from an EXR of that compression."""
    frame = Frame(pixels, Path("x.exr"), LINEAR, 16, floating=True)
    of_file: Format = exr.EXR("openexr", "EXR", (".exr",), (16, 32))
    header = replace(
        frame.header,
        format="EXR",
        file=of_file,
        kinds=("half",) * 3,
        attributes=(("compression", "string", compression),),
        origin=origin,
    )
    return replace(frame, header=header)


@pytest.mark.parametrize("compression", ["zip", "zips"])
@pytest.mark.parametrize("pixels", [noise, ramp])
@pytest.mark.parametrize("shape", [(5, 7), (16, 9), (17, 33), (300, 21)])
def test_chunks_are_those_of_openimageio(
    shape: tuple[int, int],
    pixels: Callable[..., np.ndarray],
    compression: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "x.exr"
    frame = frame_of(pixels(*shape), compression, origin=(3, -40))
    ours = encoded(frame, path, None)
    assert ours == by_openimageio(lambda: encoded(frame, path, None), monkeypatch)
    path.write_bytes(ours)
    found = exr.halves_of(path, ["R", "G", "B"])
    assert found is not None
    np.testing.assert_array_equal(found.view(np.uint16), frame.pixels.view(np.uint16))


def test_what_is_read_is_what_openimageio_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With an alpha, which stands first in the file and last in the picture."""
    path = tmp_path / "x.exr"
    frame = frame_of(ramp(40, 30), "zip")
    alpha = np.linspace(0.5, 1, 1200, dtype=np.float16).reshape(40, 30)
    header = replace(
        frame.header,
        channels=("R", "G", "B", "A"),
        kinds=("half",) * 4,
        extra=(alpha,),
    )
    path.write_bytes(encoded(replace(frame, header=header), path, None))
    assert exr.halves_of(path, ["R", "G", "B", "A"]) is not None
    found = read_image(path, repair=False, halves=True)
    expected = by_openimageio(lambda: read_image(path, repair=False, halves=True), monkeypatch)
    np.testing.assert_array_equal(found.pixels, expected.pixels)
    np.testing.assert_array_equal(found.header.extra[0], expected.header.extra[0])


@pytest.mark.parametrize("at", [1, 4, 40])
def test_a_damaged_chunk_is_left_to_openimageio(at: int, tmp_path: Path) -> None:
    path = tmp_path / "x.exr"
    content = bytearray(encoded(frame_of(ramp(48, 400), "zip"), path, None))
    path.write_bytes(content)
    read_frame(path)
    content[-at] ^= 0x11
    path.write_bytes(content)
    assert exr.halves_of(path, ["R", "G", "B"]) is None


@pytest.mark.parametrize("size", [b"\x10\0\0\xff", b"\xff\xff\xff\xff"])
def test_a_header_that_ends_elsewhere_is_left_to_openimageio(tmp_path: Path, size: bytes) -> None:
    """Of a box OpenEXR knows the size, and believes no other."""
    path = tmp_path / "x.exr"
    content = encoded(frame_of(ramp(32, 40), "zip"), path, None)
    stated = b"displayWindow\0box2i\0"
    assert content.count(stated + b"\x10\0\0\0") == 1
    path.write_bytes(content.replace(stated + b"\x10\0\0\0", stated + size))
    assert exr.halves_of(path, ["R", "G", "B"]) is None
    with pytest.raises(InputError, match=r"x\.exr: wanted"):
        read_frame(path)


def test_chunks_that_stand_elsewhere_are_left_to_openimageio(tmp_path: Path) -> None:
    """The places of two chunks are exchanged: each tells its own lines."""
    path = tmp_path / "x.exr"
    content = encoded(frame_of(ramp(32, 40), "zip"), path, None)
    path.write_bytes(content)
    places = next(k for k in range(len(content)) if _is_place(content, k))
    swapped = content[places + 8 : places + 16] + content[places : places + 8]
    path.write_bytes(content[:places] + swapped + content[places + 16 :])
    assert exr.halves_of(path, ["R", "G", "B"]) is None


def _is_place(content: bytes, position: int) -> bool:
    """Whether two chunks' places stand there, of which the first follows them."""
    return int.from_bytes(content[position : position + 8], "little") == position + 16


def test_other_samples_are_left_to_openimageio(tmp_path: Path) -> None:
    path = tmp_path / "x.exr"
    frame = Frame(ramp(20, 20).astype(np.float32), path, LINEAR, 32, floating=True)
    path.write_bytes(encoded(frame, path, 32))
    assert exr.halves_of(path, ["R", "G", "B"]) is None
    np.testing.assert_array_equal(read_frame(path).pixels, frame.pixels)
