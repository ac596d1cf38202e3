"""Commands that messages and pages advise, by the real programs on made files.

What each makes is read by the product: the light is right, and what was promised is kept.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import run_for_real
from image_files import save, store
from plain_files import write_dpx
from stored_masters import picture
from videos import FFV1, KINDS, UNSAID, Kind, number_of, write_numbered, write_video, x264

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames import Frame, read_frame, read_master
from domesim.frames.encodings import encoding_named
from domesim.frames.video import frame_paths
from testing.raws import store_raw

HERE = Path(__file__).parents[1]
TRIED: set[str] = set()


def tool(program: str) -> str:
    """Where a program is; OpenImageIO's wheel brings its own."""
    beside = Path(oiio.__file__).parents[3].parent / "bin" / program
    beside = beside if beside.exists() else Path(sys.executable).parent / program
    found = str(beside) if beside.exists() else shutil.which(program)
    if found is None:
        pytest.skip(f"{program} is not installed")
    return found


def follow(name: str, source: Path, made: Path, **fields: object) -> bytes:
    """Do what people are told to, as it is written; what it prints."""
    TRIED.add(name)
    program, *words = shlex.split(ADVICE[name].given(**fields).replace("\\\n", ""))
    named = {"IN": str(source), "show.mov": str(source), "out.mov": str(made)}
    named |= {"OUT": str(made), "OUT.mkv": str(made)}
    extra = ["-v", "error", "-y"] if program == "ffmpeg" else []
    command = [tool(program), *extra, *(named.get(word, word) for word in words)]
    done = subprocess.run(command, capture_output=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def refusal(path: Path, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        read_master([path], **options)
    return str(caught.value)


def same(found: Frame, light: np.ndarray, atol: float = 0.0) -> None:
    np.testing.assert_allclose(found.pixels, light, atol=atol)


LIGHT = picture(32, 48).astype(np.float16).astype(np.float32)


# Pictures, by oiiotool.


@pytest.mark.parametrize("suffix", ["exr", "tif"])
def test_the_part_that_is_a_picture_is_taken(tmp_path: Path, suffix: str) -> None:
    """Not the last one, which is depth, or another page."""
    kind = "half" if suffix == "exr" else "float"
    specs = [oiio.ImageSpec(48, 32, 3, kind) for _ in range(2)]
    for number, spec in enumerate(specs):
        spec.attribute("oiio:subimagename", ("depth", "rgba")[number])
    pages = [(specs[1], LIGHT), (specs[0], 1 - LIGHT)]
    number = 0
    if suffix == "exr":
        depth = oiio.ImageSpec(48, 32, 1, "float")
        depth.channelnames = ("Z",)
        depth.attribute("oiio:subimagename", "depth")
        specs[0].attribute("oiio:subimagename", "other")
        pages = [(depth, LIGHT[..., :1]), (specs[1], LIGHT), (specs[0], 1 - LIGHT)]
        number = 1
    path = save(tmp_path / f"in.{suffix}", *pages)
    with pytest.raises(InputError) as caught:
        read_frame(path)
    message = str(caught.value)
    assert ADVICE["one part"].given(number=number) in message
    assert ("rgba" in message) == (suffix == "exr")
    follow("one part", path, tmp_path / f"out.{suffix}", number=number)
    same(read_frame(tmp_path / f"out.{suffix}"), LIGHT)


@pytest.mark.parametrize("name", ["x.png", "x.tif", "x.tga", "deep.png"])
def test_colours_under_an_alpha_of_0_come_out_whole(tmp_path: Path, name: str) -> None:
    dtype, most = (np.uint16, 65535) if name.startswith("deep") else (np.uint8, 255)
    codes = np.rint(LIGHT * most).astype(dtype)
    capture = np.dstack([codes, np.zeros((32, 48), dtype)])
    path = store(tmp_path / name, capture, "R,G,B,A")
    assert ADVICE["no alpha"].given() in refusal(path)
    out = tmp_path / f"out{path.suffix if path.suffix != '.tga' else '.png'}"
    follow("no alpha", path, out)
    same(read_frame(out), codes / np.float32(most), atol=1e-6)


@pytest.mark.parametrize("suffix", ["exr", "png", "dpx"])
def test_a_copy_is_the_same(tmp_path: Path, suffix: str) -> None:
    path = store(tmp_path / f"in.{suffix}", np.rint(LIGHT * 255).astype(np.uint8))
    follow("a copy", path, tmp_path / f"out.{suffix}")
    same(read_frame(tmp_path / f"out.{suffix}"), read_frame(path).pixels)


@pytest.mark.parametrize("suffix", ["exr", "png", "dpx"])
def test_grey_is_three_of_one(tmp_path: Path, suffix: str) -> None:
    codes = LIGHT[..., :1].astype(np.float16)
    if suffix != "exr":
        codes = np.rint(LIGHT[..., :1] * 255).astype(np.uint8)
    path = store(tmp_path / f"in.{suffix}", codes, "Y")
    assert (way := ADVICE["grey"].given(grey="Y")) in refusal(path), way
    follow("grey", path, tmp_path / f"out.{suffix}", grey="Y")
    expected = codes.astype(np.float32) / (1 if suffix == "exr" else 255)
    same(read_frame(tmp_path / f"out.{suffix}"), np.repeat(expected, 3, -1), atol=1e-6)


def test_a_layer_of_several_is_chosen(tmp_path: Path) -> None:
    names = ",".join(f"{layer}.{end}" for layer in ("key", "rim") for end in "RGB")
    both = np.dstack([LIGHT, LIGHT / 2]).astype(np.float16)
    path = store(tmp_path / "in.exr", both, names)
    message = refusal(path)
    assert "choose one of layers key, rim: --layer key, or" in message
    assert ADVICE["layer"].given(layer="key") in message
    follow("layer", path, tmp_path / "out.exr", layer="rim")
    same(read_frame(tmp_path / "out.exr"), LIGHT / 2)


def test_whole_numbers_stay_what_they_are(tmp_path: Path) -> None:
    numbers = np.random.default_rng(1).integers(0, 60, (32, 48, 3)).astype(np.uint32)
    path = save(tmp_path / "in.exr", (oiio.ImageSpec(48, 32, 3, "uint"), numbers))
    assert ADVICE["whole numbers"].given() in refusal(path)
    follow("whole numbers", path, tmp_path / "out.exr")
    same(read_frame(tmp_path / "out.exr"), numbers.astype(np.float32), atol=1e-4)


def test_overscan_is_cropped(tmp_path: Path) -> None:
    spec = oiio.ImageSpec(48, 32, 3, "half")
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = 4, 2, 40, 28
    path = save(tmp_path / "in.exr", (spec, LIGHT))
    window = "40x28+4+2"
    assert ADVICE["crop"].given(window=window) in refusal(path)
    follow("crop", path, tmp_path / "out.exr", window=window)
    same(read_frame(tmp_path / "out.exr"), LIGHT[2:30, 4:44])


def test_an_empty_view_is_left_out(tmp_path: Path) -> None:
    views = ("string[2]", ("left", "right"))
    path = store(tmp_path / "in.exr", LIGHT.astype(np.float16), multiView=views)
    assert ADVICE["one view"].given() in refusal(path)
    follow("one view", path, tmp_path / "out.exr")
    assert len(read_master([tmp_path / "out.exr"]).frames) == 1
    same(read_frame(tmp_path / "out.exr"), LIGHT)


def test_light_is_clamped_at_100_and_nowhere_else(tmp_path: Path) -> None:
    bright = LIGHT.copy()
    bright[0, 0] = 3e9
    path = store(tmp_path / "in.exr", bright)
    follow("clamp", path, tmp_path / "out.exr")
    bright[0, 0] = 100
    same(read_frame(tmp_path / "out.exr"), bright)


@pytest.mark.parametrize("suffix", ["exr", "dpx"])
def test_pixels_are_said_to_be_square(tmp_path: Path, suffix: str) -> None:
    codes = np.rint(LIGHT * 255).astype(np.uint8) if suffix == "dpx" else LIGHT.astype(np.float16)
    path = store(tmp_path / f"in.{suffix}", codes, PixelAspectRatio=2.0)
    if suffix == "dpx":
        path = write_dpx(tmp_path / "in.dpx", codes, 8, ">")
        content = bytearray(path.read_bytes())
        content[1628:1636] = b"\0\0\0\2\0\0\0\1"
        path.write_bytes(content)
    assert ADVICE["square pixels"].given() in refusal(path)
    follow("square pixels", path, tmp_path / f"out.{suffix}")
    read = read_frame(tmp_path / f"out.{suffix}")
    same(read, codes.astype(np.float32) / (255 if suffix == "dpx" else 1), atol=1e-6)
    assert suffix == "exr" or "Linear" in read.described()


def test_squeezed_views_are_stretched(tmp_path: Path) -> None:
    codes = np.zeros((54, 96, 3), np.uint8)
    codes[:, :48], codes[:, 48:] = 100, 200
    follow("stretch", store(tmp_path / "in.png", codes), tmp_path / "out.png", cols=192, rows=54)
    master = read_master([tmp_path / "out.png"], packing="side-by-side")
    for frame, code in zip(master.frames, (100, 200), strict=True):
        assert frame.pixels.shape == (54, 96, 3)
        np.testing.assert_allclose(frame.pixels[:, 8:-8], code / 255, atol=1e-6)


@pytest.mark.parametrize("suffix", ["png", "dpx"])
def test_the_gap_of_frame_packing_is_taken_out(tmp_path: Path, suffix: str) -> None:
    codes = np.random.default_rng(2).integers(0, 256, (1470, 1280, 3)).astype(np.uint8)
    path = store(tmp_path / f"in.{suffix}", codes)
    message = refusal(path, packing="top-bottom")
    assert ADVICE["without the gap"].given(cols=1280, high=720, low=750) in message
    follow("without the gap", path, tmp_path / f"out.{suffix}", cols=1280, high=720, low=750)
    master = read_master([tmp_path / f"out.{suffix}"], packing="top-bottom")
    whole = read_frame(path).pixels
    np.testing.assert_array_equal(master.frames[0].pixels, whole[:720])
    np.testing.assert_array_equal(master.frames[1].pixels, whole[750:])
    assert master.colour.means_the_same_as(read_frame(path).colour)


# Films.


def test_films_come_in_another_container_or_codec_as_they_are(tmp_path: Path) -> None:
    for suffix, kind, name in (
        (".ts", KINDS["H.264"], "another container"),
        (".mpg", Kind(".mpg", "mpeg2video", "yuv420p"), "another codec"),
        (".avi", Kind(".avi", "mjpeg", "yuvj420p", full=True), "another codec"),
    ):
        path = write_numbered(tmp_path / f"in{suffix}", kind, 6, rate=Fraction(25))
        with pytest.raises(InputError) as caught:
            read_frame(path)
        assert ADVICE[name].given() in str(caught.value)
        follow(name, path, tmp_path / f"{suffix[1:]}.mkv")
        frames = frame_paths(tmp_path / f"{suffix[1:]}.mkv")
        assert [number_of(read_frame(frame).pixels) for frame in frames] == [*range(1, 7)]
        dark = read_frame(frames[0]).pixels[:, -5:, 1].mean()
        assert dark == pytest.approx(0.3 if kind.full else (0.3 * 255 - 16) / 219, abs=0.02)


def rgba(path: Path, codec: str, kind: str, alpha: int) -> Path:
    """A film of three frames of one colour, by PyAV alone."""
    import av  # noqa: PLC0415

    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=24)
        stream.width, stream.height, stream.pix_fmt = 64, 64, kind
        for number in range(3):
            codes = np.full((64, 64, 4), (152, 30, 15, alpha), np.uint8)
            frame = av.VideoFrame.from_ndarray(codes, format="rgba").reformat(format=kind)
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.mark.parametrize(
    ("name", "codec", "kind"),
    [
        ("x.mkv", "ffv1", "bgra"),
        ("x.mov", "prores_ks", "yuva444p10le"),
        ("y.mkv", "ffv1", "yuva420p"),
    ],
)
def test_a_film_under_an_alpha_of_0_comes_out_whole(
    tmp_path: Path, name: str, codec: str, kind: str
) -> None:
    path, opaque = (rgba(tmp_path / f"{a}{name}", codec, kind, a) for a in (0, 255))
    assert ADVICE["no alpha of a film"].given() in refusal(frame_paths(path)[0])
    follow("no alpha of a film", path, tmp_path / "out.mkv")
    found, wanted = (read_frame(frame_paths(each)[0]) for each in (tmp_path / "out.mkv", opaque))
    same(found, wanted.pixels, atol=1 / 255)
    assert "alpha" not in found.described()


def test_alpha_beside_the_frames_of_vp9_is_no_secret(tmp_path: Path) -> None:
    """FFmpeg's own decoder leaves it out without a word."""
    path = rgba(tmp_path / "in.webm", "libvpx-vp9", "yuva420p", 128)
    with pytest.raises(InputError) as caught:
        frame_paths(path)
    assert ADVICE["alpha of VP9"].given() in str(caught.value)
    follow("alpha of VP9", path, tmp_path / "out.mkv")
    assert (
        "over black where its alpha" in read_frame(frame_paths(tmp_path / "out.mkv")[0]).described()
    )


def test_a_film_of_square_pixels_keeps_its_codes(tmp_path: Path) -> None:
    def stretch(stream: Any) -> None:
        stream.sample_aspect_ratio = stream.codec_context.sample_aspect_ratio = Fraction(2, 1)

    path = write_numbered(tmp_path / "in.mov", KINDS["ProRes 422"], 5, prepare=stretch)
    with pytest.raises(InputError) as caught:
        frame_paths(path)
    assert ADVICE["square pixels of a film"].given() in str(caught.value)
    follow("square pixels of a film", path, tmp_path / "out.mkv")
    frame = read_frame(frame_paths(tmp_path / "out.mkv")[4])
    assert frame.pixels.shape == (48, 128, 3)
    assert frame.bits == 10
    assert "stream's tags" in frame.colour.source
    assert number_of(frame.pixels[:, ::2]) == 5
    follow("stretch a film", path, tmp_path / "wide.mkv", cols=256, rows=48)
    assert read_frame(frame_paths(tmp_path / "wide.mkv")[0]).pixels.shape == (48, 256, 3)


@pytest.mark.long
def test_a_film_without_the_gap_of_frame_packing(tmp_path: Path) -> None:
    codes = np.random.default_rng(3).integers(0, 4096, (1470, 1280)).astype(np.uint16)
    path = write_video(tmp_path / "in.mkv", KINDS["FFV1"], [[codes] * 3] * 2)
    frame = frame_paths(path)[0]
    message = refusal(frame, packing="top-bottom")
    fields = {"high": 720, "low": 750}
    assert ADVICE["a film without the gap"].given(**fields) in message
    follow("a film without the gap", path, tmp_path / "out.mkv", **fields)
    master = read_master([frame_paths(tmp_path / "out.mkv")[0]], packing="top-bottom")
    whole = read_frame(frame).pixels
    np.testing.assert_array_equal(master.frames[0].pixels, whole[:720])
    np.testing.assert_array_equal(master.frames[1].pixels, whole[750:])


def test_interlaced_films_keep_their_rate(tmp_path: Path) -> None:
    made = tmp_path / "in.mkv"
    source = "testsrc2=s=64x48:r=25,format=yuv420p,setfield=tff"
    command = [tool("ffmpeg"), "-v", "error", "-f", "lavfi", "-i", source, "-frames:v", "10"]
    coding = ["-c:v", "libx264", "-flags", "+ildct+ilme", "-x264-params", "tff=1"]
    subprocess.run([*command, *coding, str(made)], check=True)
    assert ADVICE["whole frames"].given() in refusal(frame_paths(made)[0])
    follow("whole frames", made, tmp_path / "out.mkv")
    frames = frame_paths(tmp_path / "out.mkv")
    assert len(frames) == 10
    read_frame(frames[9])


def test_the_size_of_one_view_is_said(tmp_path: Path) -> None:
    source = write_numbered(tmp_path / "x.mkv", KINDS["FFV1"], 3)
    shutil.copy(source, tmp_path / "in.mkv")
    follow("size of one view", tmp_path / "in.mkv", tmp_path / "in.mkv", side="width", pixels=32)


# What a library cannot read, where programs are installed for it.


def test_raw_photographs_are_developed_to_linear_light(tmp_path: Path) -> None:
    """What the sensor saw; or light in the primaries of sRGB, which the file says."""
    light = np.zeros((40, 60, 3))
    light[:] = 0.2, 0.4, 0.1
    light[10:30, 20:40] = 0.6, 0.3, 0.5
    store_raw(tmp_path / "in.dng", light)
    assert ADVICE["develop"].given() in refusal(tmp_path / "in.dng")
    made = tmp_path / "in.tiff"
    follow("develop to measure", tmp_path / "in.dng", made)
    found = read_frame(made, colour=encoding_named("linear")).pixels[::2, ::2]
    for place in ((20, 30), (5, 5)):
        np.testing.assert_allclose(found[place], light[place], atol=1e-3)
    follow("develop", tmp_path / "in.dng", made)
    assert read_frame(made).colour.transfer == "linear"
    assert not read_frame(made).colour.assumed


def test_a_tiff_of_another_compression_keeps_light_above_1(tmp_path: Path) -> None:
    bright = LIGHT * 40
    plain = store(tmp_path / "plain.tif", bright)
    packed = tmp_path / "in.tif"
    done = subprocess.run([tool("tiffcp"), "-c", "lerc", plain, packed], check=False)
    if done.returncode:
        pytest.skip("this libtiff has no LERC")
    assert ADVICE["plain TIFF"].given() in refusal(packed)
    follow("plain TIFF", packed, tmp_path / "out.tif")
    same(read_frame(tmp_path / "out.tif"), bright, atol=1e-4)


# Pipes.

Y, X = np.mgrid[:128, :128] / 128
WAVES = np.stack([0.5 + 0.5 * np.sin(6 * X + 2 * Y), 0.5 + 0.5 * np.sin(5 * Y + 1), X * Y], -1)
GREEN = np.broadcast_to((0, 255, 0), (8, 8, 3))
WAVES[:16, :16], WAVES[16:32, :16] = (0, 1, 0), 1


def film(path: Path, name: str, *, tagged: bool) -> Path:
    """Smooth colours, white and pure green, of BT.709."""
    from domesim.frames.yuv import limited_codes, small_size  # noqa: PLC0415

    kind = {
        "8 bits": Kind(".mp4", "libx264", "yuv420p", x264("qp=0")),
        "ProRes": Kind(".mov", "prores_ks", "yuv422p10le", {"profile": "hq"}),
        "10 bits": Kind(".mkv", "ffv1", "yuv420p10le", FFV1),
    }[name]
    bits = 8 if name == "8 bits" else 10
    chroma = "4:2:2" if name == "ProRes" else "4:2:0"
    luma, *differences = limited_codes(WAVES.astype(np.float32), 1, bits)
    planes = [np.rint(luma), *(np.rint(small_size(each, chroma)) for each in differences)]
    unsaid = {"primaries": UNSAID, "transfer": UNSAID, "matrix": UNSAID}
    kind = kind if tagged else replace(kind, **unsaid)
    return write_video(path.with_suffix(kind.suffix), kind, [planes] * 2)


FILMS = [(name, tagged) for name in ("8 bits", "ProRes", "10 bits") for tagged in (True, False)]


@pytest.mark.parametrize(("name", "tagged"), FILMS)
def test_a_pipe_of_frames_is_what_compensate_decodes(
    tmp_path: Path, name: str, tagged: bool
) -> None:
    path = film(tmp_path / "in", name, tagged=tagged)
    wanted = read_frame(frame_paths(path)[0]).pixels * 255
    raw = follow("frames of a film", path, tmp_path / "out")
    found = np.frombuffer(raw, np.uint8).reshape(-1, 128, 128, 3)
    assert len(found) == 2
    assert np.abs(found[0] - wanted).mean() < 1
    assert abs(float((found[0] - wanted).mean())) < 0.2
    np.testing.assert_allclose(found[0][4:12, 4:12], GREEN, atol=2)
    assert (found[0][20:28, 4:12] == 255).all()


@pytest.mark.long
def test_a_screens_frames_are_what_it_shows(tmp_path: Path) -> None:
    """Of an X server without a screen, white all over; and a player takes them."""
    read, write = os.pipe()
    server = [tool("Xvfb"), "-displayfd", str(write), "-screen", "0", "640x480x24", "-wr"]
    with subprocess.Popen(server, pass_fds=[write], stderr=subprocess.DEVNULL) as running:
        try:
            os.close(write)
            with os.fdopen(read) as told:
                screen = f":{told.readline().strip()}"
            TRIED.add("frames of a screen")
            fields = {"cols": 64, "rows": 32, "screen": screen}
            words = shlex.split(ADVICE["frames of a screen"].given(**fields))[1:]
            few = [*words[:-1], "-frames:v", "2", words[-1]]  # a screen's frames do not end
            done = subprocess.run([tool("ffmpeg"), *few], capture_output=True, check=True)
        finally:
            running.terminate()
    assert np.frombuffer(done.stdout, np.uint8).shape == (2 * 64 * 32 * 3,)
    assert set(done.stdout) == {255}
    words = shlex.split(ADVICE["frames to look at"].given(cols=64, rows=32))[1:]
    player = [tool("ffplay"), "-v", "error", "-autoexit", *words]
    no_screen = {**os.environ, "SDL_VIDEODRIVER": "dummy"}
    shown = subprocess.run(
        player, input=done.stdout, capture_output=True, check=True, env=no_screen
    )
    assert not shown.stderr


@pytest.mark.parametrize(("name", "tagged"), [("R, G, B", True), *FILMS])
def test_y4m_is_what_compensate_decodes(tmp_path: Path, name: str, tagged: bool) -> None:
    from compensate.live.y4m import header_of  # noqa: PLC0415

    if name == "R, G, B":
        path = store(tmp_path / "in.png", np.rint(WAVES * 255).astype(np.uint8))
        wanted = read_frame(path).pixels * 255
    else:
        path = film(tmp_path / "in", name, tagged=tagged)
        wanted = read_frame(frame_paths(path)[0]).pixels * 255
    stream = follow("Y4M", path, tmp_path / "out")
    found = frame_of_y4m(stream) * 255
    assert header_of(stream.partition(b"\n")[0]).bits == 10
    assert np.abs(found - wanted).mean() < 1
    np.testing.assert_allclose(found[4:12, 4:12], GREEN, atol=2)


def frame_of_y4m(stream: bytes) -> np.ndarray:
    """The first frame of 4:4:4, by BT.709's equations."""
    head, _, rest = stream.partition(b"FRAME\n")
    bits = 10 if b"p10" in head else 8
    step = 2 ** (bits - 8)
    planes = np.frombuffer(rest, "<u2" if bits > 8 else "u1", 3 * 128 * 128).reshape(3, 128, 128)
    luma = (planes[0] - 16.0 * step) / (219 * step)
    blue, red = ((planes[k] - 128.0 * step) / (224 * step) for k in (1, 2))
    r, b = luma + 1.5748 * red, luma + 1.8556 * blue
    return np.clip(np.stack([r, (luma - 0.2126 * r - 0.0722 * b) / 0.7152, b], -1), 0, 1)


def test_y4m_of_full_range_is_limited(tmp_path: Path) -> None:
    kind = Kind(".mkv", "ffv1", "yuv444p", FFV1, full=True)
    grey = np.tile(np.arange(128) * 2.0, (128, 1))
    neutral = np.full((128, 128), 128.0)
    path = write_video(tmp_path / "in.mkv", kind, [[grey, neutral, neutral]])
    found = frame_of_y4m(follow("Y4M in limited range", path, tmp_path / "out"))
    np.testing.assert_allclose(found * 255, np.repeat(grey[..., None], 3, -1), atol=1.2)


# The registry.

PROGRAMS = (
    "oiiotool|ffmpeg|ffplay|mpv|convert|magick|mkvpropedit|mkvmerge|dcraw|tiffcp|gst-launch-1.0"
)
UNTRIED = {
    "a film by its shader": "tests/compensate/live has it, where Vulkan is",
    "a film in a player": "tests/compensate/live has it, where mpv and a screen are",
    "a film in gpu-next": "tests/compensate/live has it, where mpv has libplacebo 6",
}


def test_messages_take_their_commands_from_the_registry() -> None:
    """No command is written out anywhere else in the code."""
    for folder in ("domesim", "compensate"):
        for path in (HERE / folder).rglob("*.py"):
            if path.name != "advice.py":
                command = rf"\b(?:{PROGRAMS}) (?:-\S+ )*(?:IN|-f|-i|-vf)\b"
                assert not re.findall(command, path.read_text()), path


def test_pages_take_their_commands_from_the_registry() -> None:
    lines = [re.escape(f"{each.program} {each.arguments}") for each in ADVICE.values()]
    known = [re.sub(r"\\\{\w+\\\}", r"[\\w.:]+", each) for each in lines]
    found = 0
    for path in [*(HERE / "docs").glob("*.md"), HERE / "README.md"]:
        text = path.read_text()
        commands = re.findall(rf"`((?:{PROGRAMS}) [^`\n]* [^`\n]*)`", text)  # of two words or more
        for block in re.findall(r"```\n(.*?)```", text, re.DOTALL):
            typed = re.findall(rf"(?m)^(?:  \| )?((?:{PROGRAMS}) (?:.*\\\n)*.*)", block)
            commands += [each.partition(" \\\n  |")[0].strip() for each in typed]
        for command in commands:
            assert any(re.fullmatch(each, command) for each in known), command
        found += len(commands)
    assert found > 6


def test_every_advice_is_tried() -> None:
    tested = Path(__file__).read_text()
    for name in ADVICE:
        assert name in UNTRIED or f'"{name}"' in tested.partition("# The registry.")[0], name


@pytest.mark.long
@pytest.mark.parametrize(("name", "tagged"), [("8 bits", False), ("ProRes", True)])
def test_live_by_its_recipe_is_what_compensate_makes(
    tmp_path: Path, name: str, tagged: bool
) -> None:
    """Frames by FFmpeg, compensated as they come; and the film, from file to file."""
    path = film(tmp_path / "in", name, tagged=tagged)
    raw = follow("frames of a film", path, tmp_path / "out")
    live = ["live", "--scene", "dome_imax", "--size", "128x128", "--encoding", "bt709"]
    command = [sys.executable, "-m", "domesim", *live, "--dither", "none"]
    done = subprocess.run(command, input=raw, capture_output=True, check=True, cwd=HERE)
    found = np.frombuffer(done.stdout, np.uint8).reshape(-1, 128, 128, 3)[0]
    outcome = run_for_real(
        *("compensate", path, "--scene", "dome_imax", "--frames", "1", "--workers", "0"),
        *("--format", "png", "--output-bits", "8", "--out", tmp_path / "made"),
    )
    assert outcome.code == 0
    (made,) = (tmp_path / "made").glob("*.png")
    assert np.abs(found - read_frame(made).pixels * 255).mean() < 1
