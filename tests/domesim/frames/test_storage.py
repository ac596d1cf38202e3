"""Files that are not damaged, but stored in a way that is not read, or larger than memory."""

from __future__ import annotations

import re
import resource
import shutil
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from image_files import store
from PIL import Image

from domesim.errors import InputError
from domesim.frames import read_frame, write_frame
from domesim.frames.formats.png import chunk

REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def tiff(path: Path, compression: str, *, reverse: bool = False) -> Path:
    """A TIFF whose bytes have their least significant bit first, if it is `reverse`."""
    codes = np.random.default_rng(2).integers(0, 256, (33, 40, 3)).astype(np.uint8)
    Image.fromarray(codes).save(path, compression=compression, tiffinfo={266: 2 if reverse else 1})
    if reverse and compression == "raw":  # libtiff, which does the others, reverses them
        content = bytearray(path.read_bytes())
        with Image.open(path) as opened:
            places = zip(opened.tag_v2[273], opened.tag_v2[279], strict=True)
        for begin, size in places:
            content[begin : begin + size] = content[begin : begin + size].translate(REVERSED)
        path.write_bytes(content)
    return path


@pytest.mark.parametrize("compression", ["raw", "tiff_lzw", "packbits", "tiff_deflate"])
def test_bits_in_reverse_are_read_or_named(tmp_path: Path, compression: str) -> None:
    plain = read_frame(tiff(tmp_path / "plain.tif", compression))
    path = tiff(tmp_path / "x.tif", compression, reverse=True)
    np.testing.assert_array_equal(read_frame(path).pixels, plain.pixels)


def saved_anew(path: Path, codes: np.ndarray, *options: object) -> Path:
    """A TIFF by ImageMagick, whose libtiff knows more compressions than OpenImageIO's."""
    if shutil.which("identify") is None:  # `convert` is also the name of other programs
        pytest.skip("no ImageMagick")
    store(path.with_suffix(".plain.tif"), codes, compression="none")
    command = ["convert", path.with_suffix(".plain.tif"), *options, path]
    subprocess.run(list(map(str, command)), check=True, capture_output=True)
    return path


@pytest.mark.parametrize("compression", ["zstd", "lzma"])
@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("uint8", ()),
        ("uint16", ("-define", "tiff:predictor=2")),
        ("uint16", ("-define", "tiff:tile-geometry=16x16")),
        ("uint16", ("-endian", "msb", "-define", "tiff:rows-per-strip=7")),
    ],
)
def test_what_openimageio_does_not_unpack_is_read(
    tmp_path: Path, compression: str, kind: str, options: tuple[object, ...]
) -> None:
    top = np.iinfo(kind).max
    codes = np.random.default_rng(3).integers(0, top, (33, 40, 3), kind)
    path = saved_anew(tmp_path / "x.tif", codes, "-compress", compression, *options)
    said = subprocess.run(["identify", "-format", "%C", path], capture_output=True, check=True)
    assert said.stdout.decode().lower() == compression
    found = read_frame(path).pixels * top
    np.testing.assert_array_equal(np.rint(found), codes)
    write_frame(read_frame(path), tmp_path / "out.tif")
    np.testing.assert_array_equal(read_frame(tmp_path / "out.tif").pixels, read_frame(path).pixels)


def test_a_flat_picture_of_zstd_is_no_damage(tmp_path: Path) -> None:
    """It is 5 000 times as large as its file."""
    Image.new("RGB", (2048, 2048), (9, 9, 9)).save(
        tmp_path / "x.tif", compression="zstd", tiffinfo={278: 2048}
    )
    assert (tmp_path / "x.tif").stat().st_size < 4000
    assert np.ptp(read_frame(tmp_path / "x.tif").pixels) == 0


@pytest.mark.parametrize("compression", ["ZSTD", "ZIP", "HTJ2K256", "LJ2K"])
def test_a_black_exr_is_no_damage(tmp_path: Path, compression: str) -> None:
    exr = pytest.importorskip("OpenEXR")
    header = {"compression": getattr(exr, f"{compression}_COMPRESSION"), "type": exr.scanlineimage}
    exr.File(header, {"RGB": np.zeros((1024, 1024, 3), np.float16)}).write(str(tmp_path / "x.exr"))
    frame = read_frame(tmp_path / "x.exr")
    assert not frame.pixels.any()
    write_frame(frame, tmp_path / "out.exr")
    assert read_frame(tmp_path / "out.exr").pixels.shape == (1024, 1024, 3)


def test_a_compression_that_nobody_knows_is_named(tmp_path: Path) -> None:
    path = tiff(tmp_path / "x.tif", "tiff_deflate")
    content = bytearray(path.read_bytes())
    place = content.index(struct.pack("<HHI", 259, 3, 1))
    struct.pack_into("<H", content, place + 8, 50002)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"got compression scheme 50002\. It is not damaged"):
        read_frame(path)


def large_png(path: Path, side: int) -> Path:
    """All black: 16384² are 1 MB."""
    lines = zlib.compressobj(9)
    row = bytes(1 + 3 * side)
    pixels = b"".join(lines.compress(row) for _ in range(side)) + lines.flush()
    header = side.to_bytes(4) * 2 + b"\x08\2\0\0\0"
    parts = (chunk(b"IHDR", header), chunk(b"IDAT", pixels), chunk(b"IEND", b""))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    return path


def in_memory(limit: int, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        text=True,
        capture_output=True,
        check=False,
        timeout=300,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )


def test_a_dry_run_of_what_memory_cannot_hold_tells_how_much_it_takes(tmp_path: Path) -> None:
    path = large_png(tmp_path / "x.png", 16384)
    options = ("--scene", "dome_hemisphere", "--out", tmp_path / "out", "--dry-run")
    done = in_memory(6 << 30, "-m", "domesim", "compensate", path, *options)
    assert done.returncode == 0, done.stderr
    told = re.search(r"1 frames: about (\d+)\.\d GB of memory a worker", done.stdout)
    assert told
    assert int(told[1]) > 6
    assert "none was tried" in done.stdout
    assert not (tmp_path / "out").exists()


def test_a_picture_that_memory_cannot_hold_is_refused_in_one_line(tmp_path: Path) -> None:
    path = large_png(tmp_path / "x.png", 8192)
    program = "import sys; from domesim.frames import read_master; read_master([sys.argv[1]])"
    done = in_memory(900 << 20, "-c", program, path)
    assert "x.png: wanted memory for a picture of this size, got none" in done.stderr


# Tables and scenes as Windows's editors save them.


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_a_scene_may_have_a_byte_order_mark(tmp_path: Path, encoding: str) -> None:
    from importlib import resources  # noqa: PLC0415

    from domesim.scene import load_scene  # noqa: PLC0415

    text = resources.files("scenes").joinpath("dome_hemisphere.toml").read_text()
    mark = {"utf-16-le": b"\xff\xfe", "utf-16-be": b"\xfe\xff"}.get(encoding, b"")
    (tmp_path / "x.toml").write_bytes(mark + text.encode(encoding))
    assert load_scene(tmp_path / "x.toml").views == 1


@pytest.mark.parametrize("brand", [b"heic", b"mif1", b"avif"])
def test_pictures_of_phones_are_no_videos(tmp_path: Path, brand: bytes) -> None:
    """They are in the same container."""
    path = tmp_path / "x.heic"
    path.write_bytes(b"\0\0\0\x18ftyp" + brand + bytes(200))
    with pytest.raises(InputError, match=r"wanted a complete HEIF|domesim\[heif\]"):
        read_frame(path)
