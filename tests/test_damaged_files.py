"""Damaged files of all formats: a frame or one line, never a crash, an end that does not come, or
anything printed by a library."""

from __future__ import annotations

import struct
import sys
import zlib
from collections import Counter
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from damaged_files import DAMAGES, NAMES, VIDEOS, followed, outcome, readings, sound_files

from domesim.errors import InputError
from domesim.frames import read_frame, read_master
from domesim.frames.formats.png import chunk

# Truncation that nobody can tell: what a TGA may have behind its pixels, it may lack; of a video
# one frame is read, whatever lies behind it; of a JPEG with a gain map the first picture.
MAY_BE_CUT = ("x.tga", "gain.jpg", *VIDEOS)


@pytest.mark.parametrize("count", [500, pytest.param(20_000, marks=pytest.mark.long)])
def test_each_damaged_file_is_a_frame_or_one_line(tmp_path: Path, count: int) -> None:
    found = list(readings(0, count, tmp_path))
    assert [each.number for each in found] == list(range(count))
    assert [each for each in found if each.found.startswith("WRONG")] == []
    counts = Counter((each.damage, each.found.partition(":")[0]) for each in found)
    assert {damage for damage, _ in counts} == {damage.__name__ for damage, _ in DAMAGES}
    sources = NAMES
    cuts = [
        each
        for each in found
        if (each.damage, each.found) == ("cut", "frame")
        and sources[each.number % len(sources)] not in MAY_BE_CUT
    ]
    assert cuts == []
    # Bits of pixels without a checksum can change unseen; most other damage is noticed.
    refused = sum(n for (_, outcome), n in counts.items() if outcome == "refused")
    assert 0.5 < refused / len(found) < 0.8
    # Content decides what a picture is; of a video, its suffix decides that it is one.
    misnamed = [
        each
        for each in found
        if (each.damage, each.found.partition(":")[0]) == ("wrong_suffix", "refused")
        and not {each.name.partition("-")[2], sources[each.number % len(sources)]} & set(VIDEOS)
    ]
    assert misnamed == []


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    return sound_files(tmp_path_factory.mktemp("sound"))


def test_the_sound_files_are_frames(tmp_path: Path, sound: dict[str, bytes]) -> None:
    for name, content in sound.items():
        if name not in VIDEOS:
            (tmp_path / name).write_bytes(content)
            shape = read_master([tmp_path / name]).pixels.shape[1:3]
            assert sorted(shape) == [40, 53], name


@pytest.mark.parametrize("name", [name for name in NAMES if name not in MAY_BE_CUT])
def test_truncation_is_noticed_wherever_it_is(
    tmp_path: Path, sound: dict[str, bytes], capfd: pytest.CaptureFixture[str], name: str
) -> None:
    content, size = sound[name], len(sound[name])
    for length in {*range(0, size, size // 40), *range(1, 25), *range(size - 25, size)}:
        (tmp_path / name).write_bytes(content[:length])
        assert outcome(tmp_path / name).startswith("refused"), length
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("end", "found"), [("os.abort()", "-6"), ("time.sleep(99)", "no end"), ("1 / 0", "1")]
)
def test_a_lost_reader_is_noticed_and_its_file_named(end: str, found: str) -> None:
    script = f"""if True:
        import json, os, time
        for number in range(3):
            told = {{"number": number, "damage": "cut", "name": "x.exr"}}
            print(json.dumps(told), flush=True)
            if number == 2:
                {end}
            print(json.dumps({{"found": "frame"}}), flush=True)
        """
    *sound, last = followed([sys.executable, "-c", script], 1.5)
    assert [each.found for each in sound] == ["frame"] * 2
    assert (last.number, last.found) == (2, f"WRONG: lost ({found})")


# What was found, one by one: each printed to standard error, or ended in a traceback.


def png(header: bytes, pixels: bytes, *others: bytes) -> bytes:
    parts = [chunk(b"IHDR", header), *others, chunk(b"IDAT", zlib.compress(pixels))]
    return b"\x89PNG\r\n\x1a\n" + b"".join([*parts, chunk(b"IEND", b"")])


HEADER = struct.pack(">2I5B", 4, 3, 8, 2, 0, 0, 0)
LINES = (b"\0" + bytes(range(12))) * 3
PNGS = {
    "no width": (png(struct.pack(">2I5B", 0, 3, 8, 2, 0, 0, 0), LINES), "got 0 x 3"),
    "a width of 2^32 - 1": (
        png(struct.pack(">2I5B", 2**32 - 1, 3, 8, 2, 0, 0, 0), LINES),
        "got 4294967295 x 3",
    ),
    "7 bits": (png(struct.pack(">2I5B", 4, 3, 7, 2, 0, 0, 0), LINES), "impossible header"),
    "colour 5": (png(struct.pack(">2I5B", 4, 3, 8, 5, 0, 0, 0), LINES), "impossible header"),
    "interlace 2": (png(struct.pack(">2I5B", 4, 3, 8, 2, 0, 0, 2), LINES), "impossible header"),
    "two headers": (png(HEADER, LINES, chunk(b"IHDR", HEADER)), "impossible header"),
    "short header": (png(HEADER[:-1], LINES), "impossible header"),
    "too few lines": (png(HEADER, LINES[:-1]), "too few pixels"),
    "no pixels": (png(HEADER, b""), "too few pixels"),
    "pixels without an end": (
        png(HEADER, LINES).replace(
            chunk(b"IDAT", zlib.compress(LINES)), chunk(b"IDAT", zlib.compress(LINES)[:-4])
        ),
        "too few pixels",
    ),
    "filter 5": (png(HEADER, LINES[:26] + b"\5" + LINES[27:]), "impossible filter"),
    "no deflate": (
        png(HEADER, LINES).replace(chunk(b"IDAT", zlib.compress(LINES)), chunk(b"IDAT", b"x" * 40)),
        "do not decode",
    ),
    "a reserved chunk": (png(HEADER, LINES, chunk(b"tEvt", b"a")), "impossible kind"),
    "a chunk that must be known": (png(HEADER, LINES, chunk(b"GFFs", b"a")), "must be understood"),
    "an odd chunk": (png(HEADER, LINES, chunk(b"gAM\1", b"\0\0\0\1")), "impossible kind"),
    "no header": (b"\x89PNG\r\n\x1a\n" + chunk(b"IDAT", b"") + chunk(b"IEND", b""), "IHDR"),
}


def refused(path: Path, content: bytes, capfd: pytest.CaptureFixture[str]) -> str:
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_frame(path)
    assert capfd.readouterr() == ("", "")
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_tiff_without_a_directory(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    refused(tmp_path / "a.tif", b"II*\0\0\0\0\0" + bytes(64), capfd)


@pytest.mark.parametrize("case", PNGS)
def test_an_impossible_png(tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str) -> None:
    content, words = PNGS[case]
    assert words in refused(tmp_path / "x.png", content, capfd)


def test_a_png_that_reaches_back_too_far(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Its pixels refer to more than the window that they state."""
    rng = np.random.default_rng(0)
    lines = [b"\0" + rng.bytes(897) for _ in range(2)]
    pixels = b"".join([*lines, lines[0]])
    stream = bytearray(zlib.compress(pixels))
    stream[0], stream[1] = 0x08, 0x1D  # a window of 256 bytes
    assert (stream[0] * 256 + stream[1]) % 31 == 0
    content = png(struct.pack(">2I5B", 299, 3, 8, 2, 0, 0, 0), b"")
    content = content.replace(chunk(b"IDAT", zlib.compress(b"")), chunk(b"IDAT", bytes(stream)))
    assert "do not decode" in refused(tmp_path / "x.png", content, capfd)


@pytest.mark.parametrize(("cols", "rows"), [(11, 9), (1, 1), (4, 2)])
def test_an_interlaced_png_is_whole(tmp_path: Path, cols: int, rows: int) -> None:
    """Adam7 (PNG specification, 8.1): passes that have no pixels have no lines."""
    samples = np.random.default_rng(0).integers(0, 256, (rows, cols, 3), np.uint8)
    passes = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4)]
    passes += [(1, 0, 2, 2), (0, 1, 1, 2)]
    pixels = b""
    for left, top, across, down in passes:
        part = samples[top::down, left::across]
        if part.size:
            pixels += b"".join(b"\0" + line.tobytes() for line in part)
    header = struct.pack(">2I5B", cols, rows, 8, 2, 0, 0, 1)
    (tmp_path / "x.png").write_bytes(png(header, pixels))
    read = read_frame(tmp_path / "x.png")
    np.testing.assert_array_equal(np.rint(read.pixels * 255), samples)
    (tmp_path / "x.png").write_bytes(png(header, pixels[:-1]))
    with pytest.raises(InputError, match="too few pixels"):
        read_frame(tmp_path / "x.png")


def test_a_jpeg_2000_whose_table_of_channels_is_cut(
    tmp_path: Path, sound: dict[str, bytes], capfd: pytest.CaptureFixture[str]
) -> None:
    assert "ends early" in refused(tmp_path / "x.j2k", sound["8.j2k"][:44] + b"\xff\xd9", capfd)


def test_htj2k_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Its decoder prints to standard error what it thinks of damage."""
    path = tmp_path / "x.j2c"
    spec = oiio.ImageSpec(40, 40, 3, "uint8")
    writer = oiio.ImageOutput.create(str(path))
    assert writer.open(str(path), spec)
    assert writer.write_image(np.zeros((40, 40, 3), np.uint8))
    assert writer.close()
    assert "got HTJ2K" in refused(path, path.read_bytes(), capfd)
