"""Files that are not damaged, but stored in a way that is not read, or larger than memory."""

from __future__ import annotations

import resource
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.frames.png import chunk

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
    if compression != "tiff_deflate":
        np.testing.assert_array_equal(read_frame(path).pixels, plain.pixels)
        return
    with pytest.raises(InputError) as caught:
        read_frame(path)
    assert "got ZIP of reversed bits (fill order lsb2msb). It is not damaged" in str(caught.value)


@pytest.mark.parametrize(("compression", "name"), [("zstd", "ZSTD"), ("lzma", "LZMA")])
def test_a_compression_that_is_not_read_is_named(
    tmp_path: Path, compression: str, name: str
) -> None:
    path = tiff(tmp_path / "x.tif", compression)
    try:
        read_frame(path)
    except InputError as error:
        assert f"got {name}. It is not damaged: save it with LZW or ZIP" in str(error)  # noqa: PT017


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
        timeout=100,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )


def test_a_dry_run_of_what_memory_cannot_hold_tells_how_much_it_takes(tmp_path: Path) -> None:
    path = large_png(tmp_path / "x.png", 16384)
    options = ("--scene", "dome_hemisphere", "--out", tmp_path / "out", "--dry-run")
    done = in_memory(6 << 30, "-m", "domesim", "compensate", path, *options)
    assert done.returncode == 0, done.stderr
    assert "1 frames: about 81 GB of memory a worker" in done.stdout
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
