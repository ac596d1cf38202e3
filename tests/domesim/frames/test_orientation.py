"""Pictures that are stored turned: light is computed as they are shown; results stored as before.

A picture whose four corners differ tells how it was turned.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from image_files import store
from plain_files import read_dpx, write_dpx

from domesim.errors import InputError
from domesim.frames import read_frame, read_master, write_frame, write_master
from domesim.frames.reading import size_of

ROWS, COLS = 34, 48
# Exif 2.32, tag 274: on which side of what is shown the file's row 0 and column 0 lie.
SIDES = {
    1: ("top", "left"),
    2: ("top", "right"),
    3: ("bottom", "right"),
    4: ("bottom", "left"),
    5: ("left", "top"),
    6: ("right", "top"),
    7: ("right", "bottom"),
    8: ("left", "bottom"),
}
# SMPTE ST 268-1, table 2: where the first pixel lies, of pictures whose lines are rows.
DPX = {0: 1, 1: 2, 2: 4, 3: 3}
CASES = [(suffix, k) for suffix in ("tif", "png", "jpg", "exr") for k in SIDES]
CASES += [("dpx", k) for k in DPX.values()]


def stored_picture(dtype: str) -> np.ndarray:
    """(row, col, 3) as in the file: smooth, no two corners alike, so that JPEG keeps it."""
    row, col = np.mgrid[:ROWS, :COLS]
    values = np.stack([row / ROWS, col / COLS, (row + col) / (ROWS + COLS)], -1) * 0.8 + 0.1
    if np.issubdtype(dtype, np.integer):
        return np.rint(values * np.iinfo(dtype).max).astype(dtype)
    return values.astype(dtype)


def as_shown(picture: np.ndarray, orientation: int) -> np.ndarray:
    """By the definition: each stored (0, 0), row and column lie on the sides of `SIDES`."""
    first, second = SIDES[orientation]
    if first in ("left", "right"):
        picture = np.moveaxis(picture, 0, 1)
    if "bottom" in (first, second):
        picture = picture[::-1]
    if "right" in (first, second):
        picture = picture[:, ::-1]
    return picture


def oriented(path: Path, orientation: int) -> tuple[Path, np.ndarray]:
    dtype = {".exr": "float16", ".dpx": "uint16", ".hdr": "float32"}.get(path.suffix, "uint8")
    if path.suffix == ".jpg":
        extra = {"Compression": "jpeg:100", "jpeg:subsampling": "4:4:4"}
    else:
        extra = {"oiio:BitsPerSample": 10} if path.suffix == ".dpx" else {}
    picture = stored_picture(dtype)
    store(path, picture, Orientation=orientation, **extra)
    if path.suffix == ".dpx":
        content = bytearray(path.read_bytes())
        order = ">" if content[:4] == b"SDPX" else "<"
        field = {exif: dpx for dpx, exif in DPX.items()}[orientation]
        struct.pack_into(order + "H", content, 768, field)
        path.write_bytes(content)
    scale = np.iinfo(dtype).max if np.issubdtype(dtype, np.integer) else 1
    return path, picture / scale


@pytest.mark.parametrize(("suffix", "orientation"), CASES)
def test_a_picture_is_read_as_it_is_shown(tmp_path: Path, suffix: str, orientation: int) -> None:
    path, picture = oriented(tmp_path / f"in.{suffix}", orientation)
    read = read_frame(path)
    np.testing.assert_allclose(read.pixels, as_shown(picture, orientation), atol=0.02)
    assert size_of(path) == read.pixels.shape[:2]
    assert ("turned upright" in read.described()) == (orientation != 1)


@pytest.mark.parametrize(("suffix", "orientation"), CASES)
def test_a_result_is_stored_as_its_master_was(
    tmp_path: Path, suffix: str, orientation: int
) -> None:
    path, picture = oriented(tmp_path / f"in.{suffix}", orientation)
    read = read_frame(path)
    darker = read.pixels * np.float32(0.5)
    write_frame(read.with_pixels(darker), tmp_path / f"out.{suffix}")
    reader = oiio.ImageInput.open(str(tmp_path / f"out.{suffix}"))
    assert reader.spec().getattribute("Orientation") == orientation
    np.testing.assert_allclose(reader.read_image("float"), picture / 2, atol=0.02)
    if suffix == "dpx":
        fields = [(tmp_path / f"{name}.dpx").read_bytes()[768:770] for name in ("in", "out")]
        assert fields[0] == fields[1]


@pytest.mark.parametrize("target", ["exr", "png", "tif", "dpx"])
def test_another_format_gets_it_upright(tmp_path: Path, target: str) -> None:
    for suffix in ("tif", "jpg", "dpx"):
        orientation = 3 if suffix == "dpx" else 6
        path, picture = oriented(tmp_path / f"in.{suffix}", orientation)
        if suffix == target:
            continue
        write_frame(read_frame(path), tmp_path / f"x.{target}")
        reader = oiio.ImageInput.open(str(tmp_path / f"x.{target}"))
        assert reader.spec().getattribute("Orientation") in (None, 1)
        shown = as_shown(picture, orientation)
        np.testing.assert_allclose(reader.read_image("float"), shown, atol=0.02)


@pytest.mark.parametrize(("field", "orientation"), [(4, 5), (5, 6), (6, 8), (7, 7)])
@pytest.mark.parametrize("order", "<>")
def test_a_dpx_whose_lines_are_columns_is_turned(
    tmp_path: Path, field: int, orientation: int, order: str
) -> None:
    """SMPTE ST 268-1, image orientation: the first pixels of lines are those of columns."""
    codes = np.random.default_rng(5).integers(0, 1024, (9, 16, 3))
    path = write_dpx(tmp_path / "in.dpx", codes, 10, order)
    content = bytearray(path.read_bytes())
    struct.pack_into(order + "H", content, 768, field)
    path.write_bytes(content)
    read = read_frame(path)
    np.testing.assert_array_equal(np.rint(read.pixels * 1023), as_shown(codes, orientation))
    write_frame(read, tmp_path / "out.dpx")
    written = read_dpx(tmp_path / "out.dpx")
    np.testing.assert_array_equal(written.codes, codes)
    assert (tmp_path / "out.dpx").read_bytes()[768:770] == content[768:770]


def test_the_other_channels_turn_along(tmp_path: Path) -> None:
    samples = np.dstack([stored_picture("uint16"), stored_picture("uint16")[..., 0]])
    source = store(tmp_path / "in.tif", samples, "R,G,B,mask", Orientation=6)
    read = read_frame(source)
    np.testing.assert_array_equal(read.header.extra[0], as_shown(samples[..., 3], 6))
    write_frame(read, tmp_path / "out.tif")
    result = oiio.ImageInput.open(str(tmp_path / "out.tif")).read_image("unknown")
    np.testing.assert_array_equal(result, samples)


def test_views_are_packed_as_the_picture_is_shown(tmp_path: Path) -> None:
    path, picture = oriented(tmp_path / "in.tif", 3)
    master = read_master([path], packing="side-by-side")
    left = as_shown(picture, 3)[:, : COLS // 2]
    np.testing.assert_allclose(master.frames[0].pixels, left, atol=1e-6)
    write_master(master, [tmp_path / "out.tif"])
    files = (path, tmp_path / "out.tif")
    pair = [oiio.ImageInput.open(str(each)).read_image("uint8") for each in files]
    np.testing.assert_array_equal(*pair)


@pytest.mark.parametrize("stated", [0, 9, 255])
def test_what_is_no_orientation_is_upright(tmp_path: Path, stated: int) -> None:
    picture = stored_picture("uint8")
    read = read_frame(store(tmp_path / "in.tif", picture, Orientation=stated))
    np.testing.assert_allclose(read.pixels, picture / 255, atol=1e-6)


RADIANCE = {
    "-Y {r} +X {c}": 1,
    "-Y {r} -X {c}": 2,
    "+Y {r} -X {c}": 3,
    "+Y {r} +X {c}": 4,
    "+X {c} -Y {r}": 5,
    "-X {c} -Y {r}": 6,
    "-X {c} +Y {r}": 7,
    "+X {c} +Y {r}": 8,
}


@pytest.mark.parametrize("order", RADIANCE)
def test_the_order_of_pixels_in_an_hdr(tmp_path: Path, order: str) -> None:
    """By G. Ward, *Real Pixels*: the first axis is the slower; Y grows upwards, X to the right."""
    orientation = RADIANCE[order]
    rows, cols = 3, 5  # of the file: short lines are not run-length coded
    mantissa = np.arange(rows * cols, dtype=np.uint8).reshape(rows, cols) * 7 + 128
    samples = np.stack([mantissa, mantissa, mantissa, np.full_like(mantissa, 128)], -1)
    shape = (cols, rows) if orientation >= 5 else (rows, cols)
    size = order.format(r=shape[0], c=shape[1])
    path = tmp_path / "in.hdr"
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n".encode()
    path.write_bytes(head + samples.tobytes())
    light = mantissa / 256
    found = read_frame(path).pixels[..., 0]
    np.testing.assert_allclose(found, as_shown(light, orientation), atol=0.01)


def test_a_png_tells_its_size_before_it_is_looked_through(tmp_path: Path) -> None:
    path = store(tmp_path / "in.png", stored_picture("uint8"))
    sides = size_of(path)
    content = bytearray(path.read_bytes())
    content[content.index(b"IDAT") + 20] ^= 1
    path.write_bytes(content)
    assert size_of(path) == sides == stored_picture("uint8").shape[:2]
    with pytest.raises(InputError, match="wrong checksum"):
        read_frame(path)
