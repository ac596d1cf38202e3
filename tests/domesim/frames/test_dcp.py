"""The picture of a DCP: X'Y'Z' in JPEG 2000 in MXF, and a folder of one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from cinema_mxf import ENCRYPTED, TRIPLET, cinema_mxf, codestreams_of, write_cinema_mxf
from command_line import Outcome, Run
from image_files import store
from videos import Kind, write_numbered

from domesim.errors import InputError
from domesim.frames import Frame, Master, read_frame, read_master, write_frame
from domesim.frames.encodings import encoding_named
from domesim.frames.formats.jpeg2000 import is_cinema
from domesim.frames.timing import Timing, timing_of
from domesim.frames.video import frame_paths
from domesim.shows.sequences import find_frames, find_moments, find_pairs

av = pytest.importorskip("av")
ROWS, COLS = 96, 96


def codes(number: int) -> np.ndarray:
    """(row, col, XYZ) of 12 bits, smooth: JPEG 2000 of a DCP is lossy."""
    row, col = np.mgrid[:ROWS, :COLS]
    return np.stack([row * 20, col * 20, row * 10 + col * 10], -1) + 30 * number


def track(path: Path, count: int = 3) -> Path:
    if shutil.which("ffmpeg") is None:
        pytest.skip("no ffmpeg, whose encoder knows digital cinema's profile")
    raw = b"".join((codes(k) << 4).astype("<u2").tobytes() for k in range(count))
    size = ("-pix_fmt", "xyz12le", "-s", f"{COLS}x{ROWS}", "-r", "24")
    profile = ("-c:v", "libopenjpeg", "-format", "j2k", "-cinema_mode", "2k_24")
    command = ["ffmpeg", "-v", "error", "-y", "-f", "rawvideo", *size, "-i", "-", *profile, path]
    subprocess.run(command, input=raw, check=True)
    return path


def dcp(folder: Path) -> Path:
    folder.mkdir()
    track(folder / "picture.mxf")
    (folder / "ASSETMAP.xml").write_text("<AssetMap/>")
    sound = Kind(".mxf", "mpeg2video", "yuv420p")
    write_numbered(folder / "other.mxf", sound, 2, rate=Fraction(24))
    return folder


def test_x_y_z_codes_come_as_they_are(tmp_path: Path) -> None:
    frames = frame_paths(track(tmp_path / "in.mxf"))
    assert len(frames) == 3
    for k, path in enumerate(frames):
        read = read_frame(path)
        assert (read.bits, read.colour.transfer, read.colour.primaries) == (12, "dcdm", "XYZ")
        assert np.abs(read.pixels * 4095 - codes(k)).max() < 1.51
        with av.open(str(tmp_path / "in.mxf")) as opened:
            decoded = list(opened.decode(video=0))[k]
        plane = np.frombuffer(decoded.planes[0], "<u2").reshape(ROWS, -1)[:, : 3 * COLS]
        expected = plane.reshape(ROWS, COLS, 3) >> 4
        np.testing.assert_array_equal(np.rint(read.pixels * 4095), expected)
    assert timing_of(frames[0], Fraction(25)) == Timing(Fraction(24), "00:00:00:00")


def test_a_dcps_folder_is_its_picture(tmp_path: Path) -> None:
    folder = dcp(tmp_path / "dcp")
    assert [path.name for path in find_frames(folder)] == [f"picture.{k:04}.mxf" for k in (1, 2, 3)]
    assert len(find_frames(folder, "2-3")) == 2
    track(folder / "second.mxf")
    with pytest.raises(InputError, match=r"got picture\.mxf, second\.mxf\. Name one"):
        find_frames(folder)
    (folder / "ASSETMAP.xml").unlink()
    with pytest.raises(InputError, match="got a folder"):
        find_frames(folder)


def test_other_mxfs_are_told_by_what_they_are(tmp_path: Path) -> None:
    path = write_numbered(
        tmp_path / "x.mxf", Kind(".mxf", "mpeg2video", "yuv420p"), 2, rate=Fraction(25)
    )
    with pytest.raises(InputError) as caught:
        find_frames(path)
    assert "wanted a DCP's picture in MXF" in str(caught.value)
    assert ".mov, .mp4, .m4v, .mkv" in str(caught.value)


# Two eyes.

PAIRS = 4


def stereo(path: Path, **options: object) -> Path:
    """Left and right in turn: picture 2 n is left's n."""
    return write_cinema_mxf(path, [codes(k) for k in range(2 * PAIRS)], stereo=True, **options)


def decoded(path: Path) -> list[np.ndarray]:
    """All pictures' codes, one after the other, by FFmpeg's program."""
    raw = ("-pix_fmt", "xyz12le", "-f", "rawvideo", "-")
    command = ["ffmpeg", "-v", "error", "-i", path, "-fps_mode", "passthrough", *raw]
    found = subprocess.run(command, check=True, capture_output=True).stdout
    return list(np.frombuffer(found, "<u2").reshape(-1, ROWS, COLS, 3) >> 4)


def assert_left_and_right(master: Master, number: int, expected: list[np.ndarray]) -> None:
    assert (master.packing, master.colour.transfer, master.bits) == ("files", "dcdm", 12)
    for eye, frame in enumerate(master.frames):
        read = frame.pixels * 4095
        np.testing.assert_array_equal(np.rint(read), expected[2 * number + eye])
        assert np.abs(read - codes(2 * number + eye)).max() < 1.51


@pytest.mark.parametrize(
    "options", [{}, {"labelled": False}, {"mappings": ()}], ids=["SMPTE", "Interop", "one mapping"]
)
def test_two_eyes_come_in_turn(
    tmp_path: Path, options: dict[str, object], capfd: pytest.CaptureFixture[str]
) -> None:
    path = stereo(tmp_path / "in.mxf", **options)
    moments, expected = find_moments(path), decoded(path)
    assert [[each.name for each in moment] for moment in moments] == [
        [f"in.{eye}.{k:04}.mxf" for eye in ("left", "right")] for k in range(1, PAIRS + 1)
    ]
    for number in (2, 0, 1, 3, 3, 0):
        assert_left_and_right(read_master(moments[number]), number, expected)
    assert timing_of(moments[0][1], Fraction(25)).rate == 24
    assert len(find_moments(path, "2-3")) == 2
    assert capfd.readouterr() == ("", "")


def test_each_codestream_is_as_another_decoder_has_it(tmp_path: Path) -> None:
    """OpenJPEG rounds the irreversible wavelet a little otherwise than FFmpeg."""
    pictures = [codes(k) for k in range(2)]
    moments = find_moments(write_cinema_mxf(tmp_path / "in.mxf", pictures, stereo=True))
    for frame, content in zip(
        read_master(moments[0]).frames, codestreams_of(pictures), strict=True
    ):
        (tmp_path / "x.j2k").write_bytes(content)
        other = read_frame(tmp_path / "x.j2k")
        assert other.colour.means_the_same_as(frame.colour)
        assert np.abs(other.pixels - frame.pixels).max() < 1.01 / 4095


def test_two_eyes_are_no_other_ones(tmp_path: Path) -> None:
    path = stereo(tmp_path / "in.mxf")
    ((left, right), *_) = find_moments(path)
    with pytest.raises(InputError, match="wanted the left view, got a file that says it is right"):
        read_master((right, left))
    for pair in ((path, path), (path, tmp_path / "x.####.png")):
        with pytest.raises(InputError, match="got a DCP of left and right"):
            find_pairs(*pair)
    with pytest.raises(InputError, match="same file twice"):
        read_master((left, left))


def test_a_lost_right_picture_is_noticed(tmp_path: Path) -> None:
    codestreams = codestreams_of([codes(k) for k in range(3)])
    content = cinema_mxf(codestreams, size=(COLS, ROWS), stereo=True)
    (tmp_path / "in.mxf").write_bytes(content)
    with pytest.raises(InputError, match="lacks its last right frame"):
        find_moments(tmp_path / "in.mxf")


@pytest.mark.parametrize("eyes", [False, True])
def test_encrypted_pictures_are_refused(tmp_path: Path, eyes: bool) -> None:
    codestreams = [bytes(range(256)) * 4] * 4
    content = cinema_mxf(
        codestreams, size=(COLS, ROWS), stereo=eyes, essence=TRIPLET, container=ENCRYPTED
    )
    (tmp_path / "in.mxf").write_bytes(content)
    with pytest.raises(InputError, match="got an encrypted one"):
        find_moments(tmp_path / "in.mxf")


# And written.

WRAPPER = """#!{python}
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from cinema_mxf import cinema_mxf
*options, last = sys.argv[1:]
folders = [Path(each) for each in options if Path(each).is_dir()]
Path({told!r}).write_text(" ".join(each for each in options if Path(each) not in folders))
frames = [sorted(folder.iterdir()) for folder in folders]
streams = [path.read_bytes() for moment in zip(*frames, strict=True) for path in moment]
size = tuple(int.from_bytes(streams[0][k : k + 4], "big") for k in (8, 12))
if any(len(each) > {most} for each in streams):
    sys.exit("too large")
Path(last).write_bytes(cinema_mxf(streams, size=size, stereo="-3" in options))
"""
"""In place of asdcplib's, which few machines have: as its usage says it is called."""


@pytest.fixture
def wrapper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the wrapper writes how it was called."""
    folder, told = tmp_path / "bin", tmp_path / "told"
    folder.mkdir()
    tests = str(Path(__file__).parents[2])
    text = WRAPPER.format(python=sys.executable, tests=tests, told=str(told), most=1302083)
    (folder / "asdcp-wrap").write_text(text)
    (folder / "asdcp-wrap").chmod(0o755)
    monkeypatch.setenv("PATH", str(folder), prepend=os.pathsep)
    return told


def masters(folder: Path, name: str, count: int = 3) -> None:
    for number in range(1, count + 1):
        grey = np.repeat(codes(number)[..., 2:], 3, axis=2) / 4095
        store(folder / f"{name}.{number:04}.tif", ((grey * 65535).astype(np.uint16) // 16) * 16)


HOW = ("--method", "none", "--workers", 0, "--pages", 0, "--dither", "none", "--encoding", "dcdm")


def wrapped(run: Run, folder: Path, out: Path, *options: object, count: int = 3) -> Outcome:
    """What a command says that makes a DCP's picture of masters."""
    masters(folder, "in", count)
    order = ("compensate", folder / "in.####.tif", "--scene", "dome_hemisphere", *HOW)
    return run(*order, "--format", "mxf", "--out", out, *options)


def test_a_dcp_is_made_by_asdcplib(tmp_path: Path, out: Path, run: Run, wrapper: Path) -> None:
    result = wrapped(run, tmp_path, out)
    assert result.code == 0, result
    assert "in.mxf (24 frames a second, 2D, without sound)" in result.out
    assert wrapper.read_text() == "-L -p 24"
    frames = frame_paths(out / "in.mxf")
    assert len(frames) == 3
    for number, path in enumerate(frames, 1):
        grey = codes(number)[..., 2:]
        read = read_frame(path)
        assert read.colour.transfer == "dcdm"
        assert np.abs(read.pixels * 4095 - grey).max() < 2.1  # lossy, by about a code
    assert "(made before)" in wrapped(run, tmp_path, out).out
    assert "in.mxf (48 frames a second" in wrapped(run, tmp_path, out / "48", "--fps", 48).out
    assert wrapper.read_text() == "-L -p 48"


def test_a_dcp_of_two_eyes_is_made(tmp_path: Path, out: Path, run: Run, wrapper: Path) -> None:
    for side in ("left", "right"):
        masters(tmp_path, f"in.{side}")
        for number in range(1, 4):  # not the same picture
            path = tmp_path / f"in.{side}.{number:04}.tif"
            pixels = oiio.ImageBuf(str(path)).get_pixels("uint16")
            store(path, pixels if side == "left" else pixels + 1600)
    pair = ("--left", tmp_path / "in.left.####.tif", "--right", tmp_path / "in.right.####.tif")
    scene = ("--scene", "stereo_cinema_silver", "--as-given", *HOW)
    result = run("compensate", *pair, *scene, "--format", "mxf", "--out", out)
    assert result.code == 0, result
    assert wrapper.read_text() == "-3 -L -p 24"
    moments = find_moments(out / "in.mxf")
    assert [len(moment) for moment in moments] == [2, 2, 2]
    for number, moment in enumerate(moments, 1):
        for frame, more in zip(read_master(moment).frames, (0, 100), strict=True):
            grey = codes(number)[..., 2:] + more
            assert np.abs(frame.pixels * 4095 - grey).max() < 2.1


@pytest.mark.long
def test_codestreams_of_a_dcp_have_its_profile_and_size(
    tmp_path: Path, out: Path, run: Run, wrapper: Path
) -> None:
    """Of noise, which does not compress: 250 Mbit/s, for both eyes together, at 24 a second."""
    noise = np.random.default_rng(0).random((540, 1024, 3)).astype(np.float32)
    frame = Frame(noise, tmp_path / "x.tif", encoding_named("dcdm"), 12, floating=False)
    write_frame(frame, tmp_path / "x.j2c")
    content = (tmp_path / "x.j2c").read_bytes()
    assert is_cinema(content)
    assert 1_200_000 < len(content) <= 1302083
    codes = (noise * 65535).astype(np.uint16) // 16 * 16
    for name in ("left.1", "right.1"):
        store(tmp_path / f"in.{name}.tif", codes)
    pair = ("--left", tmp_path / "in.left.#.tif", "--right", tmp_path / "in.right.#.tif")
    order = ("compensate", *pair, "--as-given", "--scene", "stereo_cinema_silver", *HOW)
    result = run(*order, "--format", "mxf", "--out", out)
    assert result.code == 2
    assert "wanted at most 651041 bytes" in result.err
    large = np.zeros((2200, 4100, 3), np.float32)
    with pytest.raises(InputError, match="at most 4096 x 2160 px"):
        write_frame(replace(frame, pixels=large), tmp_path / "x.j2c")
    with pytest.raises(InputError, match="wanted 12 bits"):
        write_frame(frame, tmp_path / "x.j2c", bits=16)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--fps", "23"), "48, 50, 60 frames a second, got 23"),
        (("--output-encoding", "srgb"), "is X'Y'Z'"),
        (("--frames", "1"), None),
    ],
)
def test_what_a_dcp_cannot_be_is_told_before(
    tmp_path: Path, out: Path, run: Run, wrapper: Path, options: tuple[str, ...], words: str | None
) -> None:
    result = wrapped(run, tmp_path, out, *options, count=2)
    if words is None:
        assert "leave --frames out" in result.out
    else:
        result.is_refused(words)
    assert not wrapper.exists()


def test_without_asdcplib_its_name_is_told(
    tmp_path: Path, out: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    wrapped(run, tmp_path, out, count=2).is_refused(
        "asdcp-wrap is not installed (build asdcplib from", "DCP-o-matic"
    )


def test_a_wrapper_that_fails_is_heard(tmp_path: Path, out: Path, run: Run, wrapper: Path) -> None:
    program = tmp_path / "bin" / "asdcp-wrap"
    program.write_text("#!/bin/sh\necho no such label >&2\nexit 3\n")
    result = wrapped(run, tmp_path, out, count=2)
    assert result.code == 2
    assert "got 'no such label' (it ended with 3)" in result.err
    assert not list(out.glob("*.mxf"))
    assert not list(out.glob(".*mxf"))
    assert len(list(out.glob("*.j2c"))) == 2
