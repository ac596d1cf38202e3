"""Videos as players show them: what containers and streams say in passing is heard."""

from __future__ import annotations

import struct
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest
from videos import KINDS, Kind, number_of, numbered, write_numbered, write_video, x264, x265

from domesim.errors import InputError
from domesim.frames import read_frame, read_master
from domesim.frames.containers import siting_of
from domesim.frames.video import frame_paths

pytest.importorskip("av")


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_frame(frame_paths(path)[0])
    assert "\n" not in str(caught.value)
    return str(caught.value)


# Cropping.


def element(name: int, content: bytes) -> bytes:
    """One of Matroska's (RFC 8794), of less than 16384 bytes."""
    size = 0x4000 | len(content)
    return name.to_bytes((name.bit_length() + 7) // 8) + size.to_bytes(2) + content


def pieces(content: bytes) -> list[tuple[int, bytes]]:
    """Name and content of the elements that follow each other; an unknown size goes to the end."""
    found, place = [], 0
    while place < len(content):
        name, sized = (9 - content[place].bit_length() for _ in range(2))
        at = place + name
        sized = 9 - content[at].bit_length()
        size = int.from_bytes(content[at : at + sized]) & ((1 << 7 * sized) - 1)
        begin = at + sized
        end = len(content) if size == (1 << 7 * sized) - 1 else begin + size
        found.append((int.from_bytes(content[place:at]), content[begin:end]))
        place = end
    return found


def with_more(content: bytes, way: tuple[int, ...], more: bytes) -> bytes:
    """Elements with `more` at the end of a way; what says where others lie is left out."""
    made = []
    for name, inner in pieces(content):
        held = with_more(inner, way[1:], more) if way and name == way[0] else inner
        if name not in (SEEK_HEAD, CUES):
            wide = (len(held) | 1 << 56).to_bytes(8)
            made.append(name.to_bytes((name.bit_length() + 7) // 8) + wide + held)
    return b"".join(made) + (more if not way else b"")


SEEK_HEAD, CUES = 0x114D9B74, 0x1C53BB6B
TO_VIDEO = (0x18538067, 0x1654AE6B, 0xAE, 0xE0)


def with_pixel_crop(path: Path, crops: dict[int, int]) -> Path:
    """A Matroska file whose picture is cropped."""
    more = b"".join(element(name, bytes([value])) for name, value in crops.items())
    path.write_bytes(with_more(path.read_bytes(), TO_VIDEO, more))
    return path


@pytest.mark.parametrize("kind", ["FFV1", "HEVC"])
def test_matroskas_crop_is_cut_off(tmp_path: Path, kind: str) -> None:
    path = write_numbered(tmp_path / "in.mkv", KINDS[kind], 3)
    whole = [read_frame(frame).pixels for frame in frame_paths(path)]
    cropped = with_pixel_crop(
        write_numbered(tmp_path / "cut.mkv", KINDS[kind], 3),
        {0x54AA: 2, 0x54BB: 4, 0x54CC: 6, 0x54DD: 8},
    )
    frames = frame_paths(cropped)
    for frame, pixels in zip(frames, whole, strict=True):
        np.testing.assert_array_equal(read_frame(frame).pixels, pixels[4:-2, 6:-8])
    from domesim.frames.reading import size_of  # noqa: PLC0415

    assert size_of(frames[0]) == (whole[0].shape[0] - 6, whole[0].shape[1] - 14)


def box(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), kind) + content


def with_box(path: Path, told: bytes, config: bytes = b"avcC") -> Path:
    """The MP4 with a box more in its sample entry; its index lies behind the frames."""
    content = path.read_bytes()
    place = content.index(config) - 4
    (size,) = struct.unpack_from(">I", content, place)
    changed = bytearray(content[: place + size] + told + content[place + size :])
    entry = {b"avcC": b"avc1", b"hvcC": b"hev1"}[config]
    for kind in (entry, b"stsd", b"stbl", b"minf", b"mdia", b"trak", b"moov"):
        at = changed.rindex(kind, 0, place + 8) - 4
        (old,) = struct.unpack_from(">I", changed, at)
        struct.pack_into(">I", changed, at, old + len(told))
    path.write_bytes(changed)
    return path


@pytest.mark.parametrize(
    ("aperture", "cut"),
    [
        ((48, 1, 40, 1, 0, 1, 0, 1), (slice(4, -4), slice(8, -8))),
        ((48, 1, 40, 1, 4, 1, -2, 1), (slice(2, -6), slice(12, -4))),
        ((96, 2, 48, 1, 0, 1, 0, 1), (slice(None), slice(8, -8))),
        ((64, 1, 48, 1, 0, 1, 0, 1), (slice(None), slice(None))),
        ((640, 1, 48, 1, 0, 1, 0, 1), (slice(None), slice(None))),  # nonsense
        ((64, 0, 48, 1, 0, 1, 0, 1), (slice(None), slice(None))),
    ],
)
def test_a_clean_aperture_is_what_is_shown(
    tmp_path: Path, aperture: tuple[int, ...], cut: tuple[slice, slice]
) -> None:
    path = write_numbered(tmp_path / "in.mp4", KINDS["H.264"], 3)
    whole = read_frame(frame_paths(path)[1]).pixels
    told = box(b"clap", struct.pack(">8i", *aperture))
    found = read_frame(frame_paths(with_box(path, told))[1]).pixels
    np.testing.assert_array_equal(found, whole[cut])


# Projections, and both eyes.


def sv3d(projection: bytes) -> bytes:
    header = box(b"prhd", bytes(16))
    return box(b"sv3d", box(b"svhd", bytes(5)) + box(b"proj", header + projection))


def vexu(projection: bytes, eyes: int) -> bytes:
    """Apple's: a projection, and which eyes there are (1 left, 2 right)."""
    told = box(b"eyes", box(b"stri", bytes(4) + bytes([eyes])))
    return box(b"vexu", told + box(b"proj", box(b"prji", bytes(4) + projection)))


EQUIRECTANGULAR = box(b"equi", bytes(20))
CUBE = box(b"cbmp", bytes(12))


@pytest.mark.parametrize(
    ("told", "got"),
    [
        (sv3d(EQUIRECTANGULAR), "equirectangular"),
        (sv3d(CUBE), "a cube"),
        (vexu(b"hequ", 1), "half equirectangular"),
    ],
)
def test_a_video_that_says_it_is_a_panorama_is_refused(
    tmp_path: Path, told: bytes, got: str
) -> None:
    path = with_box(write_numbered(tmp_path / "in.mp4", KINDS["H.264"], 3), told)
    assert f"one that says it is {got}. Make a domemaster" in refusal(path)


@pytest.mark.parametrize("projection", [b"rect", b"fish"])
def test_flat_pictures_and_fisheyes_are_as_they_are_projected(
    tmp_path: Path, projection: bytes
) -> None:
    path = write_numbered(tmp_path / "in.mp4", KINDS["H.264"], 3)
    frames = frame_paths(with_box(path, vexu(projection, 1)))
    assert number_of(read_frame(frames[1]).pixels) == 2


def test_matroskas_projection_is_heard(tmp_path: Path) -> None:
    path = write_numbered(tmp_path / "in.mkv", KINDS["FFV1"], 3)
    assert read_frame(frame_paths(path)[0]).pixels.any()
    told = element(0x7670, element(0x7671, b"\1"))
    said = tmp_path / "said.mkv"
    said.write_bytes(with_more(path.read_bytes(), TO_VIDEO, told))
    assert "equirectangular" in refusal(said)


@pytest.mark.parametrize("eyes", [1, 2, 3])
def test_a_spatial_video_is_named_and_one_eye_is_flat(tmp_path: Path, eyes: int) -> None:
    path = write_numbered(tmp_path / "in.mp4", KINDS["HEVC without B"], 3)
    path = with_box(path, vexu(b"rect", eyes), b"hvcC")
    if eyes == 3:
        assert "a spatial video (MV-HEVC)" in refusal(path)
    else:
        assert len(read_master([frame_paths(path)[0]]).frames) == 1


# Packed views whose display size is that of both.


def packed_video(path: Path, cols: int, rows: int, mode: str) -> Path:
    """As mkvmerge writes it: the display's size is that of all pixels."""
    said = {"stereo_mode": mode}
    grey = np.full((rows, cols), 2048)
    grey[: rows // 2, : cols // 2] = 960
    write_video(path, KINDS["FFV1"], [[grey] * 3] * 2, metadata=said)
    size = element(0x54B0, cols.to_bytes(2)) + element(0x54BA, rows.to_bytes(2))
    path.write_bytes(with_more(path.read_bytes(), TO_VIDEO, size))
    return path


@pytest.mark.parametrize(
    ("cols", "rows", "mode"),
    [(384, 108, "left_right"), (432, 90, "right_left"), (192, 216, "top_bottom")],
)
def test_whole_views_are_not_stretched_by_the_size_of_both(
    tmp_path: Path, cols: int, rows: int, mode: str
) -> None:
    path = packed_video(tmp_path / "in.mkv", cols, rows, mode)
    packing = "top-bottom" if mode == "top_bottom" else "side-by-side"
    master = read_master([frame_paths(path)[0]], packing=packing)
    sides = (rows // 2, cols) if packing == "top-bottom" else (rows, cols // 2)
    assert master.frames[0].pixels.shape[:2] == sides


@pytest.mark.parametrize(
    ("cols", "rows", "mode", "size"),
    [
        (192, 108, "left_right", "width=96"),
        (256, 128, "left_right", "width=128"),
        (192, 108, "bottom_top", "height=54"),
    ],
)
def test_squeezed_views_are_refused_with_both_ways_out(
    tmp_path: Path, cols: int, rows: int, mode: str, size: str
) -> None:
    message = refusal(packed_video(tmp_path / "in.mkv", cols, rows, mode))
    assert f"--set display-{size})" in message
    assert "stretch them" in message


# Colour differences.

PLACES = {
    "left": (1, 0.0, 0.5),
    "center": (2, 0.5, 0.5),
    "topleft": (3, 0.0, 0.0),
    "top": (4, 0.5, 0.0),
    "bottomleft": (5, 0.0, 1.0),
    "bottom": (6, 0.5, 1.0),
}


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize("codec", ["libx264", "libx265"])
def test_colour_differences_lie_where_the_stream_says(
    tmp_path: Path, name: str, codec: str
) -> None:
    """A ramp of colour comes back as a ramp from where it is said to begin."""
    if codec == "libx265" and name not in ("left", "center", "topleft"):
        pytest.skip("x265 writes no others")
    number, across, down = PLACES[name]
    options = (
        x264(f"qp=0:chromaloc={number - 1}")
        if codec == "libx264"
        else x265(f"lossless=1:chromaloc={number - 1}")
    )
    kind = Kind(".mp4", codec, "yuv420p10le", options)
    luma, blue, red = (plane.copy() for plane in numbered(0, kind.pixels))
    luma[:] = 512
    rows, cols = np.mgrid[: blue.shape[0], : blue.shape[1]].astype(float)
    blue[:] = 512 + 4 * rows - 40
    red[:] = 512 + 4 * cols - 64
    path = write_video(tmp_path / "film.mp4", kind, [[luma, blue, red]])
    pixels = read_frame(frame_paths(path)[0]).pixels
    y, x = np.mgrid[: luma.shape[0], : luma.shape[1]].astype(float)
    grey = (512 - 64) / 876
    inner = (slice(2, -2), slice(2, -2))
    blue_there = (4 * (y - down) / 2 - 40) / 896 * 1.8556
    red_there = (4 * (x - across) / 2 - 64) / 896 * 1.5748
    assert np.abs(pixels[..., 2] - grey - blue_there)[inner].max() < 1e-5
    assert np.abs(pixels[..., 0] - grey - red_there)[inner].max() < 1e-5


def test_threads_ask_for_it_one_after_the_other(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """PyAV has one level of what is logged for all: another's may not be taken off."""
    import av  # noqa: PLC0415

    kind = Kind(".mp4", "libx264", "yuv420p", x264("qp=0:chromaloc=2"))
    path = write_video(tmp_path / "film.mp4", kind, [numbered(0, kind.pixels)])
    with av.open(str(path)) as opened:
        frame = next(opened.decode(video=0))
    together = Barrier(2)

    def asked(_: int) -> list[str]:
        return [siting_of(frame) for _ in range(300) if together.wait() >= 0]

    with ThreadPoolExecutor(2) as threads:
        found = [each for part in threads.map(asked, range(2)) for each in part]
    assert set(found) == {"topleft"}
    assert not capfd.readouterr().err


# Range.


def test_rgb_that_says_limited_and_is_full_is_doubted(tmp_path: Path) -> None:
    noise = np.random.default_rng(2).integers(0, 4096, (3, 48, 64)).astype(np.uint16)
    kind = replace(KINDS["FFV1"], full=False)
    full = write_video(tmp_path / "full.mkv", kind, [list(noise)])
    assert (
        "its codes are those of full range: is it?" in read_frame(frame_paths(full)[0]).described()
    )
    held = 256 + noise // 4096 * 3504
    held[:, 0, 0] = 3760
    within = write_video(tmp_path / "held.mkv", kind, [list(held)])
    said = read_frame(frame_paths(within)[0]).described()
    assert "limited range" in said
    assert "is it?" not in said


def test_what_h264_says_of_its_range_goes_before_its_container(tmp_path: Path) -> None:
    kind = Kind(".mkv", "libx264", "yuv420p", x264("qp=0:fullrange=on"))
    path = write_video(tmp_path / "in.mkv", replace(kind, full=True), [numbered(5, "yuv420p")] * 2)
    content = path.read_bytes()
    assert content.count(b"\x55\xb9\x81\x02") == 1  # Range: full
    path.write_bytes(content.replace(b"\x55\xb9\x81\x02", b"\x55\xb9\x81\x01"))
    read = read_frame(frame_paths(path)[0])
    assert "its container says limited" in read.described()
    grey = {round(float(value) * 255) for value in np.unique(read.pixels)}
    assert grey == {76, 178}


# Short ones, and other containers and codecs.


@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize("codec", ["libx264", "libx265"])
def test_a_matroska_of_few_frames_has_all_of_them(tmp_path: Path, count: int, codec: str) -> None:
    several = f"bframes={2 if count > 2 else 0}"
    options = {"libx264": x264("bframes=2"), "libx265": x265(several)}[codec]
    path = write_numbered(tmp_path / "in.mkv", Kind(".mkv", codec, "yuv420p", options), count)
    frames = frame_paths(path)
    assert [number_of(read_frame(each).pixels) for each in frames] == [*range(1, count + 1)]


@pytest.mark.parametrize("name", ["in.ts", "in.m2ts", "in.mp4", "in.mov"])
def test_transport_streams_are_named(tmp_path: Path, name: str) -> None:
    stream = write_numbered(tmp_path / "made.ts", KINDS["H.264"], 3).read_bytes()
    if name == "in.m2ts":
        packets = [stream[k : k + 188] for k in range(0, len(stream), 188)]
        stream = b"".join(bytes(4) + packet for packet in packets)
    path = tmp_path / name
    path.write_bytes(stream)
    with pytest.raises(InputError, match=r"got one in MPEG-TS called .*-c copy OUT.mkv"):
        read_frame(path) if path.suffix.endswith("ts") else frame_paths(path)


CODECS: dict[str, tuple[str, str, str, Callable[[], dict[str, str]]]] = {
    "AV1": (".mkv", "libsvtav1", "yuv420p", lambda: {"svtav1-params": "lp=1"}),
    "VP9": (".webm", "libvpx-vp9", "yuv420p", dict),
    "DNxHR": (".mov", "dnxhd", "yuv422p", lambda: {"profile": "dnxhr_hq"}),
    "CineForm": (".mov", "cfhd", "gbrp12le", dict),
    "HAP": (".mov", "hap", "rgba", dict),
    "Motion JPEG": (".mov", "mjpeg", "yuvj422p", dict),
    "v210": (".mov", "v210", "yuv422p10le", dict),
}


@pytest.mark.parametrize("name", CODECS)
def test_other_codecs_are_decoded_as_ffmpeg_does(tmp_path: Path, name: str) -> None:
    import av  # noqa: PLC0415

    suffix, codec, pixels, options = CODECS[name]
    try:
        av.Codec(codec, "w")
    except av.codec.codec.UnknownCodecError:
        pytest.skip(f"this FFmpeg writes no {name}")
    path = tmp_path / f"in{suffix}"
    ramp = np.linspace(0.1, 0.9, 256 * 256).reshape(256, 256)
    frames = []
    for shift in range(3):
        grey = np.roll(ramp, shift * 40, 0)
        planes = []
        if pixels == "rgba":
            planes = [np.rint(np.dstack([grey] * 3 + [np.ones_like(grey)]) * 255)]
        else:
            for each in av.VideoFormat(pixels, 256, 256).components:
                values = np.full((each.height, each.width), 0.5) if each.is_chroma else grey
                planes.append(np.rint(values * (2**each.bits - 1)))
        frames.append(planes)
    if name == "v210":
        frames = [[np.rint(plane) for plane in planes] for planes in frames]
    full = "j" in pixels or pixels.startswith(("rgb", "gbr"))
    kind = Kind(
        suffix, codec, pixels, options(), matrix=0 if pixels.startswith("gbr") else 1, full=full
    )
    write_video(path, kind, frames)
    found = [read_frame(frame) for frame in frame_paths(path)]
    assert found[0].header.format.startswith(name)
    for shift, frame in enumerate(found):
        wanted = np.roll(ramp, shift * 40, 0)
        if not full:
            wanted = np.clip((wanted * 255 - 16) / 219, 0, 1)
        assert np.abs(frame.pixels[..., 1] - wanted).mean() < 0.02
