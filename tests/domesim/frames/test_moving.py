"""Moving pictures: shown as players show them, at the master's rate, with its sound.

FFmpeg's own decoding is the judge of what is shown, its prober of what a file says.
"""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Run
from image_files import store
from videos import FFV1, KINDS, Kind, numbered, write_numbered, write_video

from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.frames.encodings import encoding_named
from domesim.frames.timing import Timing, timing_of
from domesim.frames.video import frame_paths

av = pytest.importorskip("av")
ROWS, COLS = 48, 64
USUAL = Fraction(24)


def sloped() -> np.ndarray:
    """(row, col) 0..1 of a grey whose four corners differ."""
    row, col = np.mgrid[:ROWS, :COLS]
    return 0.2 + row / 100 + col / 400


def grey(kind: Kind, levels: np.ndarray) -> list[np.ndarray]:
    """Planes of limited range of a grey picture."""
    bits = 10 if "10" in kind.pixels else 8
    scale = 2 ** (bits - 8)
    luma = np.rint((16 + 219 * levels) * scale)
    small = tuple(n // 2 for n in levels.shape) if "420" in kind.pixels else levels.shape
    return [luma, np.full(small, 128 * scale), np.full(small, 128 * scale)]


def square(path: Path, kind: Kind, count: int, **options: Any) -> Path:
    """A domemaster."""
    if kind.codec == "ffv1":
        planes = [np.full((48, 48), 1000 + 9 * k) for k in range(3)]
    else:
        planes = grey(kind, np.full((48, 48), 0.4))
    return write_video(path, kind, [planes] * count, **options)


TURNS = {  # a, b, c, d of ISO/IEC 14496-12: x' = a x + c y, y' = b x + d y
    "upright": ((1, 0, 0, 1), lambda shown: shown),
    "mirrored": ((-1, 0, 0, 1), lambda shown: shown[:, ::-1]),
    "half": ((-1, 0, 0, -1), lambda shown: shown[::-1, ::-1]),
    "upside down": ((1, 0, 0, -1), lambda shown: shown[::-1]),
    "clockwise": ((0, 1, -1, 0), lambda shown: np.rot90(shown, -1)),
    "anticlockwise": ((0, -1, 1, 0), lambda shown: np.rot90(shown, 1)),
    "transposed": ((0, 1, 1, 0), lambda shown: shown.swapaxes(0, 1)),
    "transversed": ((0, -1, -1, 0), lambda shown: shown[::-1, ::-1].swapaxes(0, 1)),
}


PLAIN = {".mov": KINDS["ProRes 4444"], ".mp4": KINDS["H.264"]}


def turned_video(path: Path, matrix: tuple[float, ...]) -> Path:
    a, b, c, d = (round(65536 * value) for value in matrix)
    kind = PLAIN[path.suffix]
    return write_video(
        path,
        kind,
        [grey(kind, sloped())] * 2,
        prepare=lambda stream: stream.set_display_matrix([a, b, 0, c, d, 0, 0, 0, 1 << 30]),
    )


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("suffix", PLAIN)
def test_a_video_is_read_as_its_display_matrix_shows_it(
    tmp_path: Path, suffix: str, turn: str
) -> None:
    matrix, shown = TURNS[turn]
    read = read_frame(frame_paths(turned_video(tmp_path / f"in{suffix}", matrix))[0])
    np.testing.assert_allclose(read.pixels[..., 1], shown(sloped()), atol=0.03)
    assert ("turned upright" in read.described()) == (turn != "upright")


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg")
@pytest.mark.parametrize("turn", ["mirrored", "half", "upside down", "clockwise", "anticlockwise"])
def test_ffmpeg_shows_it_so(tmp_path: Path, turn: str) -> None:
    path = turned_video(tmp_path / "in.mov", TURNS[turn][0])
    command = ["ffmpeg", "-v", "error", "-i", path, "-frames:v", "1", "-pix_fmt", "rgb48le"]
    subprocess.run([*command, tmp_path / "shown.png"], check=True)
    shown = read_frame(tmp_path / "shown.png", colour=encoding_named("bt709")).pixels
    np.testing.assert_allclose(read_frame(frame_paths(path)[0]).pixels, shown, atol=0.03)


def test_a_picture_that_is_turned_askew_is_refused(tmp_path: Path) -> None:
    path = turned_video(tmp_path / "in.mov", (0.7071, 0.7071, -0.7071, 0.7071))
    with pytest.raises(InputError, match="turned by quarters"):
        read_frame(frame_paths(path)[0])


def with_cover(path: Path, film: Path) -> Path:
    """An MP4 with cover art, as shops sell it."""
    cover = store(path.parent / "cover.png", np.zeros((40, 40, 3), np.uint8))
    with av.open(str(film)) as old, av.open(str(cover)) as art, av.open(str(path), "w") as new:
        streams = [
            (source, new.add_stream_from_template(source.streams.video[0])) for source in (old, art)
        ]
        streams[1][1].disposition = av.stream.Disposition.attached_pic
        for source, stream in streams:
            for packet in source.demux(video=0):
                if packet.dts is not None:
                    packet.stream = stream
                    new.mux(packet)
    return path


def test_cover_art_is_no_second_picture(tmp_path: Path) -> None:
    film = write_numbered(tmp_path / "film.mp4", KINDS["H.264"], 3)
    path = with_cover(tmp_path / "in.mp4", film)
    with av.open(str(path)) as opened:
        if len(opened.streams.video) < 2:
            pytest.skip("this FFmpeg writes no cover")
    assert len(frame_paths(path)) == 3


@pytest.mark.parametrize(
    ("suffix", "container"),
    [(".wm", "Matroska or WebM"), (".avi", "AVI"), (".mxf", "MXF"), (".mpg", "MPEG")],
)
def test_videos_in_other_containers_are_told_by_name(
    tmp_path: Path, suffix: str, container: str
) -> None:
    codec = {".wm": "libvpx-vp9", ".mpg": "mpeg2video"}.get(suffix, "mpeg2video")
    kind = Kind(suffix, codec, "yuv420p")
    path = tmp_path / f"in{suffix}"
    frames = [numbered(1, "yuv420p")] * 2
    write_video(
        path.with_suffix(".webm") if suffix == ".wm" else path, kind, frames, rate=Fraction(25)
    )
    if suffix == ".wm":
        path.with_suffix(".webm").rename(path)
    with pytest.raises(InputError) as caught:
        read_frame(path)
    assert f"got one in {container} called '{suffix}'" in str(caught.value)
    assert "wanted a video in .mov, .mp4, .m4v, .mkv" in str(caught.value)


# Alpha.


@pytest.mark.parametrize("pixels", ["gbrap12le", "yuva444p12le"])
def test_a_video_is_what_is_seen_over_black(tmp_path: Path, pixels: str) -> None:
    planes = [np.full((ROWS, COLS), 2048) for _ in range(4)]
    planes[3] = np.zeros((ROWS, COLS))
    planes[3][:, COLS // 2 :] = 4095
    kind = Kind(".mkv", "ffv1", pixels, FFV1, matrix=1 if pixels[0] == "y" else 0, full=True)
    read = read_frame(frame_paths(write_video(tmp_path / "in.mkv", kind, [planes]))[0])
    assert not read.pixels[:, : COLS // 2].any()
    assert read.pixels[:, COLS // 2 :].min() > 0.2
    assert "over black" in read.described()


# Rate and timecode.


def dpx(path: Path, **said: object) -> Path:
    return store(path, np.full((40, 40, 3), 30000, np.uint16), **said)


BCD = {"01:02:03:00": 0x01020300, "23:59:59:29": 0x23595929, "10:00:00:04": 0x10000004}


@pytest.mark.parametrize("timecode", BCD)
@pytest.mark.parametrize("suffix", ["dpx", "exr"])
def test_files_say_rate_and_timecode(tmp_path: Path, suffix: str, timecode: str) -> None:
    code = ("timecode", (BCD[timecode], 0))
    said = {"smpte:TimeCode": code}
    if suffix == "dpx":
        path = dpx(tmp_path / "x.dpx", **said, **{"dpx:FrameRate": 30.0})
    else:
        rate = {"FramesPerSecond": ("rational", (30, 1))}
        path = store(tmp_path / "x.exr", np.full((9, 9, 3), 0.5, np.float16), **said, **rate)
    assert timing_of(path, USUAL) == Timing(Fraction(30), timecode)


@pytest.mark.parametrize(
    ("said", "rate"),
    [
        ({"dpx:FrameRate": 30.0, "dpx:TemporalFrameRate": 60.0}, 30),
        ({"dpx:FrameRate": 25.0}, 25),
        ({"dpx:TemporalFrameRate": 60.0}, 60),
        ({"dpx:FrameRate": 23.976}, Fraction(24000, 1001)),
        ({"dpx:TemporalFrameRate": 29.97}, Fraction(30000, 1001)),
        ({"dpx:FrameRate": 0.0, "dpx:TemporalFrameRate": 48.0}, 48),
        ({"dpx:FrameRate": float("nan"), "dpx:TemporalFrameRate": 48.0}, 48),
        ({"dpx:FrameRate": 2.66e36}, 24),
        ({"dpx:FrameRate": -1.0}, 24),
        ({}, 24),
    ],
)
def test_a_dpx_has_two_rates(tmp_path: Path, said: dict[str, float], rate: Fraction) -> None:
    assert timing_of(dpx(tmp_path / "x.dpx", **said), USUAL).rate == rate


def test_dropped_frames_are_told_apart(tmp_path: Path) -> None:
    said = {"smpte:TimeCode": ("timecode", (0x01020344, 0))}
    for rate, expected in ((29.97, "01:02:03;04"), (30.0, "01:02:03:04")):
        path = dpx(tmp_path / "x.dpx", **said, **{"dpx:FrameRate": rate})
        assert timing_of(path, USUAL).timecode == expected


@pytest.mark.parametrize("code", [0x25000000, 0x01600000, 0x01006000, 0x01000030, 0x3F7F7F3F])
def test_a_timecode_that_cannot_be_is_none(tmp_path: Path, code: int) -> None:
    path = dpx(tmp_path / "x.dpx", **{"smpte:TimeCode": ("timecode", (code, 0))})
    assert timing_of(path, USUAL) == Timing(USUAL)


def probed(path: Path) -> dict[str, Any]:
    command = ["ffprobe", "-v", "error", "-of", "json", "-show_streams", "-show_format", path]
    found = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    assert isinstance(found, dict)
    return found


@pytest.mark.skipif(shutil.which("ffprobe") is None, reason="no ffprobe")
@pytest.mark.parametrize("suffix", ["mkv", "mov"])
def test_a_film_has_the_rate_and_timecode_of_its_dpxs(
    tmp_path: Path, out: Path, run: Run, suffix: str
) -> None:
    for k in (1, 2):
        code = ("timecode", (0x01020300 + k - 1, 0))
        said = {"smpte:TimeCode": code, "dpx:FrameRate": 30.0, "dpx:TemporalFrameRate": 30.0}
        dpx(tmp_path / f"d.{k:04}.dpx", **said)
    options = ("--scene", "dome_hemisphere", "--method", "none", "--workers", 0, "--pages", 0)
    result = run("compensate", tmp_path / "d.####.dpx", "--format", suffix, "--out", out, *options)
    assert "(30 frames a second)" in result.out
    found = probed(out / f"d.{suffix}")
    (video,) = [each for each in found["streams"] if each["codec_type"] == "video"]
    assert video["r_frame_rate"] == "30/1"
    assert "01:02:03:00" in json.dumps(found)


# Sound.


def with_sound(path: Path, kind: Kind, codec: str, count: int = 12) -> Path:
    silent = square(path.with_stem("silent"), kind, count)
    with av.open(str(silent)) as old, av.open(str(path), "w") as new:
        video = new.add_stream_from_template(old.streams.video[0])
        audio = new.add_stream(codec, rate=48000)
        audio.codec_context.layout = "stereo"
        for packet in old.demux(video=0):
            if packet.dts is not None:
                packet.stream = video
                new.mux(packet)
        size = audio.codec_context.frame_size or 1024
        for k in range(24000 // size):
            phase = np.arange(k * size, (k + 1) * size) / 48000
            wave = np.sin(2 * np.pi * 440 * phase)
            shape, dtype = ((2, size), "flt") if audio.format.is_planar else ((1, 2 * size), "s16")
            if audio.format.is_planar:
                samples = np.stack([wave, wave]).astype(np.float32)
                frame = av.AudioFrame.from_ndarray(samples, format="fltp", layout="stereo")
            else:
                samples = np.repeat(wave * 20000, 2)[None].astype(np.int16)
                frame = av.AudioFrame.from_ndarray(samples, format="s16", layout="stereo")
            assert samples.shape == shape, dtype
            frame.sample_rate, frame.pts = 48000, k * size
            new.mux(audio.encode(frame))
        new.mux(audio.encode(None))
    return path


def sound_in(path: Path) -> tuple[str, bytes]:
    """Its codec, and all its packets."""
    with av.open(str(path)) as opened:
        if not opened.streams.audio:
            return "", b""
        (stream,) = opened.streams.audio
        packets = b"".join(bytes(packet) for packet in opened.demux(stream))
        return stream.codec_context.name, packets


def filmed(run: Run, path: Path, out: Path, suffix: str, *more: object) -> Any:
    options = ("--scene", "dome_hemisphere", "--method", "none", "--workers", 0, "--pages", 0)
    return run("compensate", path, "--format", suffix, "--out", out, *options, *more)


@pytest.mark.parametrize(
    ("name", "kind", "codec", "suffix"),
    [
        ("in.mov", KINDS["ProRes 4444"], "pcm_s16le", "mov"),
        pytest.param("in.mov", KINDS["ProRes 4444"], "pcm_s16le", "mkv", marks=pytest.mark.long),
        pytest.param("in.mp4", KINDS["H.264"], "aac", "mov", marks=pytest.mark.long),
        ("in.mkv", KINDS["FFV1"], "flac", "mkv"),
    ],
)
def test_sound_is_copied_as_it_is(
    tmp_path: Path, out: Path, run: Run, name: str, kind: Kind, codec: str, suffix: str
) -> None:
    path = with_sound(tmp_path / name, kind, codec)
    result = filmed(run, path, out, suffix)
    assert result.code == 0, result
    film = out / f"in.{suffix}"
    assert sound_in(film)[0] == codec
    assert sound_in(film) == sound_in(path)
    assert len(frame_paths(film)) == 12
    assert "without" not in result.out


def test_sound_that_a_file_cannot_hold_is_told(tmp_path: Path, out: Path, run: Run) -> None:
    path = with_sound(tmp_path / "in.mkv", KINDS["FFV1"], "flac")
    result = filmed(run, path, out, "mov")
    assert result.code == 0, result
    assert "without its sound in flac" in result.out
    assert sound_in(out / "in.mov") == ("", b"")


def test_sound_does_not_go_with_another_rate(tmp_path: Path, out: Path, run: Run) -> None:
    path = with_sound(tmp_path / "in.mov", KINDS["ProRes 4444"], "pcm_s16le")
    result = filmed(run, path, out, "mov", "--fps", 25)
    assert result.code == 0, result
    assert "without its sound, which is of another rate" in result.out
    assert sound_in(out / "in.mov") == ("", b"")


def test_a_film_says_that_it_has_no_alpha(tmp_path: Path, out: Path, run: Run) -> None:
    planes = [np.full((48, 48), 2000 + 9 * k) for k in range(4)]
    kind = Kind(".mkv", "ffv1", "gbrap12le", FFV1, matrix=0, full=True)
    path = write_video(tmp_path / "in.mkv", kind, [planes] * 2)
    for suffix in ("mkv", "mov"):
        result = filmed(run, path, out / suffix, suffix)
        assert "without alpha" in result.out, result
        master, film = (
            read_frame(frame_paths(each)[0]) for each in (path, out / suffix / f"in.{suffix}")
        )
        np.testing.assert_allclose(film.pixels, master.pixels, atol=0.01)


def test_the_header_of_an_exr_is_looked_at_only_for_its_own_rate(tmp_path: Path) -> None:
    path = tmp_path / "x.exr"
    store(path, np.full((9, 9, 3), 0.5, np.float16), FramesPerSecond=("rational", (0, 1)))
    assert timing_of(path, USUAL) == Timing(USUAL)
    content = bytearray(path.read_bytes())
    struct.pack_into("<I", content, 4, 0xFFFFFFFF)
    path.write_bytes(content)
    assert timing_of(path, USUAL) == Timing(USUAL)
