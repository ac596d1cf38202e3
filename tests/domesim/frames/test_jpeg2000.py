"""JPEG 2000: lossless at each depth, boxes kept, what OpenImageIO would bend refused."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from icc_profiles import icc_profile
from image_files import save, store
from test_frames import SRGB, refusal

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_frame, write_frame
from domesim.frames.formats.jpeg2000 import boxes_of, comments_of, with_comments

ROWS, COLS = 40, 53
SIZ = 4  # where its length is, in a codestream


def codes(bits: int, channels: int = 3) -> np.ndarray:
    """(row, col, channel): every code that there is room for, in other orders by channel."""
    rng = np.random.default_rng(bits)
    return rng.permuted(np.arange(ROWS * COLS * channels) % 2**bits).reshape(ROWS, COLS, channels)


def widened(values: np.ndarray, bits: int) -> np.ndarray:
    """As OpenImageIO takes them."""
    if bits == 8:
        return values.astype(np.uint8)
    return (values << (16 - bits) | values >> (2 * bits - 16)).astype(np.uint16)


def stored_j2k(path: Path, bits: int, channels: int = 3) -> Path:
    depth = {} if bits in (8, 16) else {"oiio__BitsPerSample": bits}
    return store(path, widened(codes(bits, channels), bits), **depth)


def frame(bits: int = 12) -> Frame:
    return Frame(
        (codes(bits) / (2**bits - 1)).astype(np.float32), Path("made.up"), SRGB, bits, False
    )


@pytest.mark.parametrize("suffix", ["jp2", "j2k", "j2c", "jpc"])
@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_every_code_survives(tmp_path: Path, suffix: str, bits: int) -> None:
    write_frame(frame(bits), tmp_path / f"a.{suffix}")
    read = read_frame(tmp_path / f"a.{suffix}")
    assert (read.bits, read.floating, read.header.format) == (bits, False, "JPEG 2000")
    np.testing.assert_array_equal(np.rint(read.pixels * (2**bits - 1)), codes(bits))
    write_frame(read, tmp_path / f"b.{suffix}")
    first, second = ((tmp_path / f"{name}.{suffix}").read_bytes() for name in "ab")
    assert first == second
    assert first.startswith(b"\0\0\0\x0cjP  " if suffix == "jp2" else b"\xff\x4f\xff\x51")


@pytest.mark.parametrize("bits", [8, 12])
def test_pillow_reads_the_same_codes(tmp_path: Path, bits: int) -> None:
    """Pillow's OpenJPEG is built apart, and its unpacking is its own."""
    image = pytest.importorskip("PIL.Image")
    write_frame(frame(bits), tmp_path / "x.jp2")
    # Of 12 bits Pillow rounds to the upper 8, beyond white to 0.
    opened = np.asarray(image.open(tmp_path / "x.jp2"))
    expected = codes(bits) if bits == 8 else (codes(bits) + 8 >> 4) % 256
    np.testing.assert_array_equal(opened, expected)


# What boxes hold.


def box(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), kind) + content


def with_boxes(path: Path, *, inside: bytes = b"", **instead: bytes) -> Path:
    """The .jp2 with an XML and a UUID box, and one with other boxes in its header's."""
    parts = []
    for kind, whole, content in boxes_of(path.read_bytes()):
        if kind != b"jp2h":
            parts.append(whole)
            continue
        header = [box(each, instead.get(each.decode(), old)) for each, _, old in boxes_of(content)]
        parts.append(box(kind, b"".join(header) + inside))
    shot = box(b"xml ", b"<shot>sh010</shot>")
    parts[-1:] = [shot, parts[-1], box(b"uuid", b"0123456789abcdef" + b"XMP")]
    path.write_bytes(b"".join(parts))
    return path


def kept(path: Path) -> list[bytes]:
    return [whole for kind, whole, _ in boxes_of(path.read_bytes()) if kind != b"jp2c"]


def test_boxes_survive(tmp_path: Path) -> None:
    resolution = box(b"res ", box(b"resc", struct.pack(">4H2b", 300, 1, 300, 1, 2, 2)))
    source = with_boxes(stored_j2k(tmp_path / "in.jp2", 12), inside=resolution)
    read = read_frame(source)
    write_frame(read.with_pixels(read.pixels / 2), tmp_path / "out.jp2")
    assert kept(tmp_path / "out.jp2") == kept(source)
    assert read_frame(tmp_path / "out.jp2").colour == ColourTag("srgb", "BT.709", "file: sRGB")


@pytest.mark.parametrize("suffix", ["jp2", "j2k"])
@pytest.mark.parametrize("told", [[], [(1, b"sh010 \xe9"), (0, bytes(range(9)))]])
def test_comments_survive(tmp_path: Path, suffix: str, told: list[tuple[int, bytes]]) -> None:
    comments = b"".join(
        b"\xff\x64" + struct.pack(">2H", 4 + len(text), kind) + text for kind, text in told
    )
    source, result = tmp_path / f"in.{suffix}", tmp_path / f"out.{suffix}"
    by_encoder = stored_j2k(source, 12).read_bytes()
    assert b"OpenJPEG" in comments_of(by_encoder)
    source.write_bytes(with_comments(by_encoder, comments))
    longer = len(comments) - len(comments_of(by_encoder))
    assert len(source.read_bytes()) == len(by_encoder) + longer
    write_frame(read_frame(source), result)
    assert comments_of(result.read_bytes()) == comments
    np.testing.assert_array_equal(read_frame(result).pixels, frame().pixels)
    assert kept(result) == kept(source)


def test_boxes_that_no_longer_hold_are_written_anew(tmp_path: Path) -> None:
    profile = icc_profile("Display P3", "P3-D65").tobytes()
    source = with_boxes(stored_j2k(tmp_path / "in.jp2", 12), colr=b"\2\0\0" + profile)
    read = read_frame(source)
    assert (read.colour.transfer, read.colour.primaries) == ("srgb", "P3-D65")
    write_frame(read, tmp_path / "same.jp2")
    assert kept(tmp_path / "same.jp2") == kept(source)
    write_frame(replace(read, colour=SRGB), tmp_path / "srgb.jp2")
    assert read_frame(tmp_path / "srgb.jp2").colour == ColourTag("srgb", "BT.709", "file: sRGB")
    write_frame(read, tmp_path / "8.jp2", bits=8)
    assert read_frame(tmp_path / "8.jp2").bits == 8
    assert read_frame(tmp_path / "8.jp2").colour.primaries == "P3-D65"
    depth = {box: inner for box, _, inner in boxes_of((tmp_path / "8.jp2").read_bytes())}
    (_, _, header), *_ = boxes_of(depth[b"jp2h"])
    assert header[10] == 7
    for name in ("srgb", "8"):
        content = (tmp_path / f"{name}.jp2").read_bytes()
        assert b"<shot>sh010</shot>" in content
        assert b"0123456789abcdefXMP" in content


def test_a_colour_space_that_is_not_rgb_is_refused(tmp_path: Path) -> None:
    ycc = b"\1\0\0" + struct.pack(">I", 18)
    assert "colour space 18" in refusal(with_boxes(stored_j2k(tmp_path / "x.jp2", 8), colr=ycc))


# The codestream.


def cinema(path: Path) -> Path:
    spec = oiio.ImageSpec(COLS, ROWS, 3, "uint16")
    spec.attribute("oiio:BitsPerSample", 12)
    spec.attribute("jpeg2000:Cinema2K", oiio.TypeDesc("uint"), 24)
    smooth = np.linspace(0, 65535, ROWS * COLS).astype(np.uint16).reshape(ROWS, COLS, 1)
    save(path, (spec, np.broadcast_to(smooth, (ROWS, COLS, 3))))
    return path


def test_a_digital_cinema_profile_means_xyz(tmp_path: Path) -> None:
    """The encoder sets no profile for sizes that are none, so the number is put there."""
    content = bytearray(cinema(tmp_path / "in.j2k").read_bytes())
    for profile, transfer in ((3, "dcdm"), (4, "dcdm"), (0, "srgb")):
        struct.pack_into(">H", content, SIZ + 2, profile)
        (tmp_path / "x.j2k").write_bytes(content)
        read = read_frame(tmp_path / "x.j2k")
        assert (read.bits, read.colour.transfer) == (12, transfer)
        assert ("DCDM XYZ" in read.described()) == (transfer == "dcdm")
    write_frame(replace(read, colour=ColourTag("dcdm", "XYZ", "here")), tmp_path / "out.j2k")
    # Losslessly, and so not in that profile
    again = read_frame(tmp_path / "out.j2k")
    assert again.colour.source == "assumed for JPEG 2000"
    np.testing.assert_array_equal(again.pixels, read.pixels)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (SIZ + 12, struct.pack(">I", 5), "an offset"),
        (SIZ + 38, bytes([0x8B]), "several kinds"),
        (SIZ + 38, bytes([0x8B, 1, 1] * 3), "12 bits, signed"),
        (SIZ + 38, bytes([11, 2, 2] * 3), "subsampled"),
        (SIZ + 38, bytes([11, 1, 1, 11, 2, 2, 11, 2, 2]), "several kinds"),
        (SIZ + 38, bytes([13, 1, 1] * 3), "14 bits"),
    ],
)
def test_what_would_be_read_as_something_else_is_refused(
    tmp_path: Path, place: int, value: bytes, words: str
) -> None:
    content = bytearray(stored_j2k(tmp_path / "x.j2k", 12).read_bytes())
    content[place : place + len(value)] = value
    (tmp_path / "x.j2k").write_bytes(content)
    assert words in refusal(tmp_path / "x.j2k")


def test_sides_that_cannot_be_encoded_are_refused_before_work(tmp_path: Path) -> None:
    small = frame()
    small = replace(small, pixels=small.pixels[:, :31])
    with pytest.raises(InputError, match=r"wanted 32 px a side or more .*got 31 x 40"):
        write_frame(small, tmp_path / "x.jp2")


def test_a_folder_for_temporary_files_that_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    with pytest.raises(InputError, match=r"no such file.*TMPDIR"):
        write_frame(frame(), tmp_path / "x.jp2")
