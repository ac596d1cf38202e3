"""Alpha: a picture is what is seen over black, and is written back in the way of each format.

Rationale: PNG's colours are straight (PNG specification, 6.2), an EXR's are multiplied by alpha
(*Technical Introduction to OpenEXR*), a TIFF says which (ExtraSamples). Light is what counts.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from image_files import store

from domesim.frames import read_frame, write_frame
from domesim.frames.encodings import encoding_named
from domesim.frames.formats.jpeg2000 import boxes_of
from domesim.light.transfer import named

ROWS, COLS = 33, 40
NOTE = "over black where its alpha lets it through"


def decoded(codes: np.ndarray, transfer: str) -> np.ndarray:
    return named(transfer, white=48).decode(np.asarray(codes, np.float64))


def codes_and_alpha(dtype: str) -> tuple[np.ndarray, np.ndarray]:
    """(row, col, 3) and (row, col) in the file's own type: alpha of 0, of 1, and between."""
    rng = np.random.default_rng(4)
    codes, alpha = rng.random((ROWS, COLS, 3)), rng.random((ROWS, COLS))
    alpha[:5], alpha[5:10] = 0, 1
    if np.issubdtype(dtype, np.integer):
        top = np.iinfo(dtype).max
        return np.rint(codes * top).astype(dtype), np.rint(alpha * top).astype(dtype)
    return codes.astype(dtype), alpha.astype(dtype)


def straight_file(path: Path, dtype: str, **attributes: object) -> tuple[np.ndarray, np.ndarray]:
    """Stored as it is, by OpenImageIO alone; values 0..1 of codes and alpha."""
    codes, alpha = codes_and_alpha(dtype)
    store(path, np.dstack([codes, alpha]), "R,G,B,A", **attributes)
    scale = np.iinfo(dtype).max if np.issubdtype(dtype, np.integer) else 1
    return codes / scale, alpha / scale


def light_of(path: Path, transfer: str) -> np.ndarray:
    """(row, col, 3) over black of a file, by OpenImageIO alone and the format's own rule."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    reader = oiio.ImageInput.open(str(path), config)
    straight = path.suffix in (".png", ".jp2") or reader.spec().getattribute(
        "oiio:UnassociatedAlpha"
    )
    samples = reader.read_image("float").astype(np.float64)
    light = decoded(samples[..., :3], transfer)
    return light * samples[..., 3:4] if straight and samples.shape[2] == 4 else light


STRAIGHT = [
    ("in.png", "uint8", "srgb"),
    ("in.png", "uint16", "srgb"),
    ("in.tif", "uint8", "srgb"),
    ("in.tif", "uint16", "srgb"),
    ("in.tif", "float32", "linear"),
    ("in.tga", "uint8", "srgb"),
    ("in.jp2", "uint8", "srgb"),
    ("in.webp", "uint8", "srgb"),
]


@pytest.mark.parametrize(("name", "dtype", "transfer"), STRAIGHT)
def test_straight_colours_are_multiplied_in_linear_light(
    tmp_path: Path, name: str, dtype: str, transfer: str
) -> None:
    lossless = {"compression": "lossless:100"} if name.endswith("webp") else {}
    codes, alpha = straight_file(tmp_path / name, dtype, **lossless)
    read = read_frame(tmp_path / name)
    assert read.colour.transfer == transfer
    expected = decoded(codes, transfer) * alpha[..., None]
    light = decoded(read.pixels, transfer)
    if name.endswith("webp"):  # changes what is under an alpha of 0, and little else
        np.testing.assert_allclose(light, expected, atol=0.02)
    else:
        np.testing.assert_allclose(light, expected, rtol=1e-5, atol=1e-7)
    assert (light[:5] == 0).all()
    assert NOTE in read.described()


def test_colours_are_multiplied_by_the_encoding_that_a_person_names(tmp_path: Path) -> None:
    codes, alpha = straight_file(tmp_path / "in.png", "uint16")
    for name in ("st2084", "dcdm", "linear", "p3-d65"):
        colour = encoding_named(name)
        read = read_frame(tmp_path / "in.png", colour=colour)
        expected = decoded(codes, colour.transfer) * alpha[..., None]
        light = decoded(read.pixels, colour.transfer)
        np.testing.assert_allclose(light, expected, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("source", ["in.png", "in.jp2"])
def test_a_dcps_codestream_gets_the_picture_over_black(tmp_path: Path, source: str) -> None:
    """It has no alpha. Expected: within what its 12 lossy bits are for smooth pictures."""
    codes = np.full((ROWS, COLS, 4), (40000, 30000, 50000, 20000), np.uint16)
    read = read_frame(store(tmp_path / source, codes, "R,G,B,A"), colour=encoding_named("dcdm"))
    write_frame(read, tmp_path / "out.j2c")
    written = read_frame(tmp_path / "out.j2c").pixels
    np.testing.assert_allclose(written, read.pixels, rtol=0, atol=2 / 4095)


@pytest.mark.parametrize(("suffix", "dtype"), [("exr", "float16"), ("tif", "uint16")])
def test_associated_colours_are_light_as_they_are(tmp_path: Path, suffix: str, dtype: str) -> None:
    codes, alpha = codes_and_alpha(dtype)
    samples = np.dstack([codes, alpha])
    source = store(tmp_path / f"in.{suffix}", samples, "R,G,B,A", oiio__UnassociatedAlpha=0)
    read = read_frame(source)
    scale = 65535 if dtype == "uint16" else 1
    np.testing.assert_allclose(read.pixels, codes.astype(np.float64) / scale, rtol=1e-6)
    assert NOTE in read.described()
    write_frame(read, tmp_path / f"out.{suffix}")
    reader = oiio.ImageInput.open(str(tmp_path / f"out.{suffix}"))
    np.testing.assert_array_equal(reader.read_image("unknown"), samples)


def test_an_opaque_alpha_is_not_worth_a_word(tmp_path: Path) -> None:
    samples = np.full((ROWS, COLS, 4), 255, np.uint8)
    assert NOTE not in read_frame(store(tmp_path / "in.png", samples, "R,G,B,A")).described()


@pytest.mark.parametrize(("name", "dtype", "transfer"), STRAIGHT[:5])
def test_a_straight_file_comes_back(tmp_path: Path, name: str, dtype: str, transfer: str) -> None:
    """To the code, but for what is hidden under an alpha of 0, which becomes black."""
    codes, alpha = codes_and_alpha(dtype)
    store(tmp_path / name, np.dstack([codes, alpha]), "R,G,B,A")
    write_frame(read_frame(tmp_path / name), tmp_path / f"out{name[2:]}")
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    result = oiio.ImageInput.open(str(tmp_path / f"out{name[2:]}"), config).read_image("unknown")
    codes[alpha == 0] = 0
    np.testing.assert_array_equal(result[..., 3], alpha)
    if dtype == "float32":
        np.testing.assert_allclose(result[..., :3], codes, rtol=1e-6)
    else:
        np.testing.assert_array_equal(result[..., :3], codes)


@pytest.mark.parametrize("target", ["exr", "png", "tif", "jp2"])
@pytest.mark.parametrize("source", ["straight.png", "straight.tif", "associated.exr"])
def test_another_format_shows_the_same_light(tmp_path: Path, source: str, target: str) -> None:
    codes, alpha = codes_and_alpha("float16" if source.endswith("exr") else "uint16")
    if source.endswith("exr"):
        codes = codes * alpha[..., None]  # as renderers give it
    path = store(tmp_path / source, np.dstack([codes, alpha]), "R,G,B,A")
    read = read_frame(path)
    write_frame(read, tmp_path / f"x.{target}")
    transfer = read.colour.transfer
    light = light_of(tmp_path / f"x.{target}", transfer)
    np.testing.assert_allclose(light, light_of(path, transfer), atol=4e-5)
    np.testing.assert_allclose(
        read_frame(tmp_path / f"x.{target}", colour=read.colour).pixels, read.pixels, atol=2e-3
    )


@pytest.mark.parametrize("suffix", ["dpx", "jpg"])
def test_a_format_without_alpha_gets_the_picture_over_black(tmp_path: Path, suffix: str) -> None:
    codes = np.full((ROWS, COLS, 4), 200, np.uint8)
    codes[..., 3] = 128
    read = read_frame(store(tmp_path / "in.png", codes, "R,G,B,A"))
    write_frame(read, tmp_path / f"x.{suffix}")
    light = decoded(read_frame(tmp_path / f"x.{suffix}").pixels, "srgb")
    expected = decoded(np.array(200 / 255), "srgb") * 128 / 255
    np.testing.assert_allclose(light, expected, atol=4e-3)


@pytest.mark.parametrize(("suffix", "dtype"), [("png", "uint8"), ("tif", "float32")])
def test_light_where_nothing_was_raises_alpha(tmp_path: Path, suffix: str, dtype: str) -> None:
    """A veil that a solver lays over the transparent part must reach the projector."""
    straight_file(tmp_path / f"in.{suffix}", dtype)
    read = read_frame(tmp_path / f"in.{suffix}")
    brighter = np.maximum(read.pixels, np.float32(0.3))
    write_frame(read.with_pixels(brighter), tmp_path / f"out.{suffix}")
    light = light_of(tmp_path / f"out.{suffix}", read.colour.transfer)
    np.testing.assert_allclose(light, decoded(brighter, read.colour.transfer), atol=4e-3)


def test_associated_alpha_of_jpeg_2000_is_known_by_its_box(tmp_path: Path) -> None:
    codes, alpha = codes_and_alpha("uint8")
    source = store(tmp_path / "in.jp2", np.dstack([codes, alpha]), "R,G,B,A")
    content = source.read_bytes()
    header = next(box for kind, box, _ in boxes_of(content) if kind == b"jp2h")
    told = [(k, 0, k + 1) for k in range(3)] + [(3, 2, 0)]  # 2: of colours multiplied by it
    definition = struct.pack(">H12H", 4, *(value for each in told for value in each))
    inner = header[8:] + struct.pack(">I4s", 8 + len(definition), b"cdef") + definition
    content = content.replace(header, struct.pack(">I4s", 8 + len(inner), b"jp2h") + inner)
    source.write_bytes(content)
    read = read_frame(source)
    np.testing.assert_allclose(read.pixels, codes / 255, atol=1e-6)
    write_frame(read, tmp_path / "out.jp2")
    np.testing.assert_array_equal(read_frame(tmp_path / "out.jp2").pixels, read.pixels)
