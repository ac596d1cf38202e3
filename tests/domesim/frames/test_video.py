"""Videos as masters: the right frame, with the right colours, or a line that says why not."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batches import do_show, harmful_in
from open_files import nothing_left_open
from videos import (
    FFV1,
    KINDS,
    UNSAID,
    Kind,
    number_of,
    numbered,
    rewritten,
    write_numbered,
    write_video,
)

from domesim.errors import InputError
from domesim.frames import Frame, read_frame
from domesim.frames.dithering import seed_of
from domesim.frames.encodings import encoding_named
from domesim.frames.film import write_film
from domesim.frames.timing import Timing
from domesim.frames.video import frame_paths
from domesim.host.files import KEPT_OPEN
from domesim.shows.run import Done
from domesim.shows.show import find_show
from domesim.shows.work import Writing

pytest.importorskip("av")

COUNT = 40
LOSSLESS = {
    "4:4:4": Kind(".mkv", "ffv1", "yuv444p10le", FFV1),
    "4:4:4 of 12 bits": Kind(".mkv", "ffv1", "yuv444p12le", FFV1),
    "4:2:2": Kind(".mkv", "ffv1", "yuv422p10le", FFV1),
    "4:2:0": Kind(".mkv", "ffv1", "yuv420p", FFV1),
}


@pytest.fixture(scope="module", params=KINDS)
def clip(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    kind = KINDS[request.param]
    return write_numbered(tmp_path_factory.mktemp("clip") / f"film{kind.suffix}", kind, COUNT)


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short one that notices damage."""
    return write_numbered(tmp_path_factory.mktemp("film") / "film.mkv", KINDS["FFV1"], 12)


def read_all(path: Path) -> None:
    for frame in frame_paths(path):
        read_frame(frame)


def refusal(path: Path) -> str:
    """Of the first of its frames that is refused."""
    with pytest.raises(InputError) as caught, nothing_left_open(), KEPT_OPEN:
        read_all(path)
    message = str(caught.value)
    assert "\n" not in message
    assert path.name in message
    return message


# Which frame.


def test_each_number_names_its_frame_in_any_order(clip: Path) -> None:
    paths = frame_paths(clip)
    in_order = [read_frame(path).pixels for path in paths]
    assert [number_of(pixels) for pixels in in_order] == list(range(1, COUNT + 1))
    order = 2 * list(range(COUNT))
    random.Random(1).shuffle(order)
    for place in order:
        assert np.array_equal(read_frame(paths[place]).pixels, in_order[place]), paths[place]
    for place in order[:12]:  # as the first of a process
        KEPT_OPEN.close()
        assert np.array_equal(read_frame(paths[place]).pixels, in_order[place]), paths[place]


@pytest.mark.parametrize("rate", [Fraction(24000, 1001), Fraction(60), Fraction(25)])
@pytest.mark.parametrize("name", ["H.264", "FFV1"])
def test_any_constant_rate_will_do(tmp_path: Path, name: str, rate: Fraction) -> None:
    kind = KINDS[name]
    path = write_numbered(tmp_path / f"film{kind.suffix}", kind, 30, rate=rate)
    frames = [read_frame(each) for each in frame_paths(path)]
    assert [number_of(frame.pixels) for frame in frames] == list(range(1, 31))
    attributes = {name: value for name, _, value in frames[0].header.attributes}
    assert attributes["FramesPerSecond"] == (rate.numerator, rate.denominator)


@pytest.mark.parametrize("name", ["H.264", "HEVC of open groups", "ProRes 4444"])
def test_what_was_trimmed_off_in_front_does_not_count(tmp_path: Path, name: str) -> None:
    """By an edit list, as QuickTime does; the decoder needs it all the same."""
    kind = KINDS[name]
    path = tmp_path / f"film{kind.suffix}"
    write_numbered(path, kind, 30, times=lambda place: place - 5)
    paths = frame_paths(path)
    for place in (0, 3, 24, 8, 1, 2, 16):
        assert number_of(read_frame(paths[place]).pixels) == place + 6
    assert len(paths) == 25


# Its colours.


def bt709(luma: float, blue: float, red: float) -> list[float]:
    """R, G, B by the constants of ITU-R BT.709-6, items 3.3 and 3.4, inverted by hand."""
    return [
        luma + 1.5748 * red,
        luma - 0.2126 / 0.7152 * 1.5748 * red - 0.0722 / 0.7152 * 1.8556 * blue,
        luma + 1.8556 * blue,
    ]


@pytest.mark.parametrize("name", LOSSLESS)
@pytest.mark.parametrize("full", [False, True])
def test_plain_colours_follow_bt709(tmp_path: Path, name: str, *, full: bool) -> None:
    kind = replace(LOSSLESS[name], full=full)
    bits = {"yuv420p": 8, "yuv444p12le": 12}.get(kind.pixels, 10)
    codes = [np.rint(np.array(each) * 2**bits) for each in ((0.4, 0.55, 0.48), (0.7, 0.45, 0.53))]
    planes = [
        [
            np.full_like(plane, code)
            for plane, code in zip(numbered(0, kind.pixels), each, strict=True)
        ]
        for each in codes
    ]
    path = write_video(tmp_path / "film.mkv", kind, planes)
    for frame, (luma, blue, red) in zip(frame_paths(path), codes, strict=True):
        step = 2 ** (bits - 8)
        if full:
            largest = 2**bits - 1
            expected = bt709(
                luma / largest, (blue - 128 * step) / largest, (red - 128 * step) / largest
            )
        else:
            expected = bt709(
                (luma - 16 * step) / (219 * step),
                (blue - 128 * step) / (224 * step),
                (red - 128 * step) / (224 * step),
            )
        read = read_frame(frame)
        assert read.bits == bits
        assert np.abs(read.pixels - expected).max() < 1e-5


@pytest.mark.parametrize("name", ["4:2:2", "4:2:0"])
def test_colour_differences_lie_where_h264_has_them(tmp_path: Path, name: str) -> None:
    """A ramp of colour comes back as a ramp: between rows, and on every second column."""
    kind = replace(LOSSLESS[name], full=True)
    luma, blue, red = (plane.copy() for plane in numbered(0, kind.pixels))
    bits, down = (8, 2) if name == "4:2:0" else (10, 1)
    half = 2 ** (bits - 1)
    luma[:] = half
    rows, cols = np.mgrid[: blue.shape[0], : blue.shape[1]].astype(float)
    blue[:] = half + 2 * rows - 20
    red[:] = half + cols - 16
    path = write_video(tmp_path / "film.mkv", kind, [[luma, blue, red]])
    pixels = read_frame(frame_paths(path)[0]).pixels * (2**bits - 1)
    y, x = np.mgrid[: luma.shape[0], : luma.shape[1]].astype(float)
    place = (y + 0.5) / down - 0.5 if down == 2 else y
    inner = (slice(2, -2), slice(0, -2))
    assert np.abs(pixels[..., 2] - half - 1.8556 * (2 * place - 20))[inner].max() < 1e-3
    assert np.abs(pixels[..., 0] - half - 1.5748 * (x / 2 - 16))[inner].max() < 1e-3


def test_r_g_b_come_as_they_are(film: Path) -> None:
    for number, frame in enumerate(frame_paths(film), 1):
        green, blue, red = numbered(number, "gbrp12le")
        codes = read_frame(frame).pixels * 4095
        assert np.array_equal(np.rint(codes), np.stack([red, green, blue], -1))


@pytest.mark.parametrize("pixels", ["yuva444p12le", "gbrap12le"])
def test_alpha_is_kept(tmp_path: Path, pixels: str) -> None:
    planes = numbered(5, pixels)
    planes[3] = np.arange(48 * 64).reshape(48, 64)
    kind = Kind(".mkv", "ffv1", pixels, FFV1, matrix=1 if pixels[0] == "y" else 0)
    header = read_frame(frame_paths(write_video(tmp_path / "film.mkv", kind, [planes]))[0]).header
    assert header.channels == ("R", "G", "B", "A")
    assert np.array_equal(header.extra[0], planes[3] << 4 | planes[3] >> 8)  # 16 bits


@pytest.mark.parametrize(
    ("pixels", "order"), [("bgr0", (2, 1, 0)), ("bgra", (2, 1, 0, 3)), ("rgb48le", (0, 1, 2))]
)
def test_packed_samples_come_as_they_are(
    tmp_path: Path, pixels: str, order: tuple[int, ...]
) -> None:
    channels, largest = (3, 65535) if pixels == "rgb48le" else (4, 255)
    codes = np.arange(47 * 61 * channels).reshape(47, 61, channels) % (largest - 4)
    codes[..., 3:] = largest  # a picture over black would be darker
    kind = Kind(".mkv", "ffv1", pixels, FFV1, matrix=0, full=True)
    frame = read_frame(frame_paths(write_video(tmp_path / "film.mkv", kind, [[codes]]))[0])
    assert np.array_equal(np.rint(frame.pixels * largest), codes[..., order[:3]])
    assert [*map(np.ndarray.tolist, frame.header.extra)] == (
        [codes[..., 3].tolist()] if len(order) == 4 else []
    )


TAGS = {
    "BT.709": ((1, 1, 1), "bt1886", "BT.709"),
    "BT.2020": ((9, 14, 9), "bt1886", "BT.2020"),
    "ST 2084": ((9, 16, 9), "st2084", "BT.2020"),
    "HLG": ((9, 18, 9), "hlg1000", "BT.2020"),
    "sRGB": ((1, 13, 1), "srgb", "BT.709"),
    "P3-D65": ((12, 1, 1), "bt1886", "P3-D65"),
}


@pytest.mark.parametrize("name", TAGS)
def test_the_streams_tags_name_the_encoding(tmp_path: Path, name: str) -> None:
    (primaries, transfer, matrix), curve, gamut = TAGS[name]
    for codec in ("H.264", "ProRes 4444"):
        kind = replace(KINDS[codec], primaries=primaries, transfer=transfer, matrix=matrix)
        path = write_numbered(tmp_path / f"film{kind.suffix}", kind, 2)
        frame = read_frame(frame_paths(path)[0])
        assert (frame.colour.transfer, frame.colour.primaries) == (curve, gamut)
        assert not frame.colour.assumed
        assert f"{'BT.2020' if matrix == 9 else 'BT.709'} matrix; limited range" in str(
            frame.colour
        )


def test_what_the_container_says_counts_before_what_frames_say(tmp_path: Path) -> None:
    """Of ProRes they often say nothing."""
    kind = replace(KINDS["ProRes 4444"], primaries=9, transfer=16, matrix=9)
    path = write_numbered(tmp_path / "film.mov", kind, 2, frames_say=False)
    colour = read_frame(frame_paths(path)[0]).colour
    assert (colour.transfer, colour.primaries) == ("st2084", "BT.2020")


def untagged(tmp_path: Path, **tags: int) -> Path:
    unsaid = {"primaries": UNSAID, "transfer": UNSAID, "matrix": UNSAID, **tags}
    kind = replace(KINDS["H.264"], **unsaid)
    return frame_paths(write_numbered(tmp_path / "film.mp4", kind, 2))[0]


def test_what_is_not_said_is_assumed_and_said_so(tmp_path: Path) -> None:
    colour = read_frame(untagged(tmp_path)).colour
    assert (colour.transfer, colour.primaries) == ("bt1886", "BT.709")
    assert colour.source == "assumed for video; BT.709 matrix assumed; limited range"
    colour = read_frame(untagged(tmp_path, primaries=9)).colour
    assert (colour.transfer, colour.primaries) == ("bt1886", "BT.2020")
    assert "transfer assumed; BT.2020 matrix assumed" in colour.source
    colour = read_frame(untagged(tmp_path, transfer=18)).colour
    assert (colour.transfer, colour.primaries) == ("hlg1000", "BT.2020")
    assert "primaries assumed; BT.2020 matrix assumed" in colour.source


def test_hlg_of_other_primaries_is_refused(tmp_path: Path) -> None:
    """Its OOTF is of BT.2020's luminance (ITU-R BT.2100)."""
    with pytest.raises(InputError, match="HLG of primaries 12"):
        read_frame(untagged(tmp_path, primaries=12, transfer=18))


def test_encoding_overrides_what_the_stream_says(tmp_path: Path) -> None:
    path = untagged(tmp_path, transfer=9)  # logarithmic
    with pytest.raises(InputError, match=r"film.0001.mp4: .* got transfer 9 .*--encoding"):
        read_frame(path)
    frame = read_frame(path, colour=encoding_named("st2084"))
    assert (frame.colour.transfer, frame.colour.primaries) == ("st2084", "BT.2020")
    assert "--encoding st2084; BT.2020 matrix assumed" in frame.colour.source
    assert frame.header.colour is None


# What is wrong with it.


def test_a_flipped_bit_of_ffv1_is_noticed_and_other_frames_are_not_harmed(
    film: Path, tmp_path: Path
) -> None:
    """FFmpeg itself computes the checksum, and then makes up what was there."""
    content = film.read_bytes()
    whole = [read_frame(path).pixels for path in frame_paths(film)]
    generator = random.Random(2)
    refused = 0
    for number in range(20):
        damaged = bytearray(content)
        # Behind the headers, and before the index
        damaged[generator.randrange(1200, len(content) - 400)] ^= 1 << generator.randrange(8)
        path = tmp_path / f"film{number}.mkv"
        path.write_bytes(damaged)
        try:
            frames = frame_paths(path)
        except InputError as error:
            refused += 1
            assert "film" in str(error)  # noqa: PT017
            continue
        for frame, right in zip(frames, whole, strict=True):
            try:
                pixels = read_frame(frame).pixels
            except InputError as error:
                refused += 1
                assert frame.name in str(error)  # noqa: PT017
            else:
                assert np.array_equal(pixels, right)
    assert 18 <= refused <= 30  # a frame each, or the file


def with_packet(path: Path, place: int, content: bytes) -> None:
    """Change a coded frame, from its beginning on."""
    whole = bytearray(path.read_bytes())
    position, size = packets_of(path)[place]
    assert len(content) <= size
    whole[position : position + len(content)] = content
    path.write_bytes(whole)


@pytest.mark.parametrize(
    ("name", "filler"), [("H.264 without key frames", b"\x0c"), ("HEVC without B", b"\x4c\x01")]
)
def test_frames_after_one_that_the_decoder_leaves_out_are_refused(
    tmp_path: Path, name: str, filler: bytes
) -> None:
    """Of a coded frame that is filler by its own account, FFmpeg says nothing."""
    path = write_numbered(tmp_path / "film.mp4", KINDS[name], 20)
    whole = [read_frame(each).pixels for each in frame_paths(path)]
    _, size = packets_of(path)[8]
    with_packet(path, 8, ((size - 4).to_bytes(4) + filler).ljust(size, b"\0"))
    frames = frame_paths(path)
    for place in (3, 7):
        assert np.array_equal(read_frame(frames[place]).pixels, whole[place])
    for place in (8, 9, 19, 15):  # in whatever order
        with pytest.raises(InputError, match=frames[place].name):
            read_frame(frames[place])


def packets_of(path: Path) -> list[tuple[int, int]]:
    """Where coded frames begin, and their sizes, in bytes."""
    import av  # noqa: PLC0415

    with av.open(str(path)) as container:
        return [(packet.pos, packet.size) for packet in container.demux(video=0) if packet.size]


@pytest.mark.parametrize("name", ["H.264", "HEVC", "ProRes 4444"])
def test_a_frame_of_noughts_is_noticed(tmp_path: Path, name: str) -> None:
    kind = KINDS[name]
    path = write_numbered(tmp_path / f"film{kind.suffix}", kind, 20)
    position, size = packets_of(path)[10]
    begin = path.read_bytes()[position : position + size // 4]
    with_packet(path, 10, begin + bytes(size - size // 4))
    assert "wanted a complete video" in refusal(path)


def test_damage_that_prores_goes_on_after_is_noticed(tmp_path: Path) -> None:
    path = write_numbered(tmp_path / "film.mov", KINDS["ProRes 4444"], 20)
    frame = frame_paths(path)[9]
    position, size = packets_of(path)[9]
    begin = path.read_bytes()[position : position + size // 2]
    with_packet(path, 9, begin + bytes(40))
    with pytest.raises(InputError, match=r"film.0010.mov: .*does not decode .damaged"):
        read_frame(frame)
    read_frame(frame_paths(path)[10])


@pytest.mark.parametrize("kept", [0.02, 0.3, 0.7, 0.9])
def test_a_truncated_video_is_noticed(clip: Path, tmp_path: Path, kept: float) -> None:
    content = clip.read_bytes()
    path = tmp_path / clip.name
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(InputError, match=f"{clip.name}: wanted"):
        frame_paths(path)


def test_a_truncated_video_with_its_index_in_front_is_noticed(tmp_path: Path) -> None:
    import av  # noqa: PLC0415

    source = write_numbered(tmp_path / "source.mov", KINDS["ProRes 4444"], 12)
    path = tmp_path / "film.mov"
    with av.open(str(source)) as old:
        options = {"movflags": "faststart"}
        with av.open(str(path), "w", options=options) as new:
            stream = new.add_stream_from_template(old.streams.video[0])
            for packet in old.demux(video=0):
                if packet.size:
                    packet.stream = stream
                    new.mux(packet)
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")
    assert len(frame_paths(path)) == 12
    for length in (2 * len(content) // 3, len(content) - 10):
        path.write_bytes(content[:length])
        with pytest.raises(InputError, match="wanted a complete video"):
            frame_paths(path)


def test_a_missing_frame_is_noticed(film: Path, tmp_path: Path) -> None:
    path = rewritten(film, tmp_path / "film.mkv", lambda place: place != 4)
    assert "wanted 24 frames a second, all there, got none for frame 5" in refusal(path)


def test_a_rate_that_is_not_constant_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "film.mkv"
    write_numbered(path, KINDS["FFV1"], 12, times=lambda place: place + (place > 6) + (place > 9))
    assert "all there, got none for frame 8" in refusal(path)


def test_other_codecs_and_what_is_no_video_are_refused(tmp_path: Path) -> None:
    path = write_numbered(tmp_path / "film.mp4", Kind(".mp4", "mpeg4", "yuv420p"), 3)
    assert "wanted ProRes, FFV1, H.264, HEVC, AV1, VP9" in refusal(path)
    assert "got mpeg4" in refusal(path)
    grey = write_numbered(tmp_path / "grey.mkv", Kind(".mkv", "ffv1", "gray10le", FFV1), 3)
    assert "got gray10le" in refusal(grey)
    text = tmp_path / "text.mov"
    text.write_text("ffconcat version 1.0\nfile film.mp4\n")
    assert "does not decode" in refusal(text)


def test_the_extra_is_asked_for_in_one_line(film: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    film.touch()  # what is known of it is forgotten
    assert refusal(film).endswith(
        "film.mkv: videos and AVIF need the extra 'video': pip install 'domesim[video]'"
    )


# As a show.


def test_frames_are_chosen_by_number(film: Path) -> None:
    show = find_show(str(film), frames="2-12x5")
    assert [files[0].name for files in show.moments] == [f"film.{n:04d}.mkv" for n in (2, 7, 12)]
    assert show.numbered
    with pytest.raises(InputError, match=r"wanted frames 10-14, missing 13-14\..*--frames 1-12"):
        find_show(str(film), frames="10-14")


def test_one_frame_can_be_named(film: Path) -> None:
    show = find_show(str(film / "film.0012.mkv"))
    assert show.moments == ((film / "film.0012.mkv",),)
    assert not show.numbered
    for other in ("film.0013.mkv", "film.mkv", "other.0001.mkv"):
        with pytest.raises(InputError, match="there is no such file"):
            find_show(str(film / other))


def test_results_are_named_after_frames(film: Path, tmp_path: Path) -> None:
    show = find_show(str(film), frames="3")
    assert show.outputs(tmp_path, ".exr") == ((tmp_path / "film.0003.exr",),)
    assert show.outputs(tmp_path, None) == ((tmp_path / "film.0003.png",),)
    assert seed_of(show.moments[0][0]) == seed_of(tmp_path / "film.0003.exr") == (0, 3)


def test_two_videos_are_left_and_right(film: Path, tmp_path: Path) -> None:
    other = write_numbered(tmp_path / "film.mkv", replace(KINDS["FFV1"], codec="ffv1"), 13)
    with pytest.raises(InputError, match="same frames on both sides, missing 13 on the left"):
        find_show(None, str(film), str(other))
    show = find_show(None, str(film), str(other), frames="2-12")
    assert show.outputs(tmp_path, None)[0] == (
        tmp_path / "left/film.0002.png",
        tmp_path / "right/film.0002.png",
    )
    with pytest.raises(InputError, match="same image twice"):
        show.read(show.moments[0], repair=False)
    with pytest.raises(InputError, match="same file twice"):
        find_show(None, str(film), str(film))


def copied(film: Path, folder: Path, workers: int, **options: Any) -> Done:
    show = find_show(str(film), frames=options.pop("frames", None))
    return do_show(show, folder, harmful_in(folder), Writing(**options), workers=workers)


def test_workers_do_a_videos_frames_and_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    film = write_numbered(tmp_path / "film.mp4", KINDS["HEVC of open groups"], 30)
    first = copied(film, tmp_path, 2, frames="1-30x4")
    assert not first.failed
    for number in range(1, 30, 4):
        path = tmp_path / f"out/film.{number:04d}.png"
        assert number_of(read_frame(path).pixels) == number
        assert read_frame(path).colour.transfer == "bt1886"
    assert copied(film, tmp_path, 0, frames="1-9").kept == 3
    os.utime(film)  # the same, copied anew
    assert copied(film, tmp_path, 0, frames="1-9").kept == 9
    write_numbered(film, KINDS["HEVC of open groups"], 31)
    assert copied(film, tmp_path, 0, frames="1-3").kept == 0


def test_frames_that_a_video_has_lost_are_named(film: Path, tmp_path: Path) -> None:
    """It is cut short when the show has begun: what is there is done, what is not is named."""
    path = tmp_path / "film.mkv"
    path.write_bytes(film.read_bytes())
    show = find_show(str(path))
    path.write_bytes(film.read_bytes()[: film.stat().st_size // 2])
    done = do_show(show, tmp_path, harmful_in(tmp_path))
    assert len(done.frames) + len(done.failed) == 12
    assert len(done.frames) >= 4
    for frame in done.frames:
        number = int(Path(frame["input"]).stem[-4:])
        assert number_of(read_frame(Path(frame["output"])).pixels) == number
    lost = range(len(done.frames) + 1, 13)
    for number, reason in zip(lost, done.failed, strict=True):
        assert f"film.mkv/film.{number:04d}.mkv: wanted a complete video, got" in reason
        assert "\n" not in reason


def test_a_long_video_needs_no_memory(tmp_path: Path) -> None:
    """It is looked through before its first frame is used: hundreds of GB for some shows."""
    path = tmp_path / "film.mkv"
    colour = encoding_named("bt709")
    noise = np.random.default_rng(1).random((512, 512, 3), np.float32)
    frames = (Frame(noise, tmp_path / "a.png", colour, 16, False) for _ in range(24))
    write_film(path, frames, 24, colour, Timing(Fraction(24)))
    look = (
        "import re, sys; from pathlib import Path; import av\n"
        "from domesim.frames.video import frame_paths\n"
        "def peak():\n"
        "    said = Path('/proc/self/status').read_text()\n"
        "    return 1024 * int(re.search(r'VmHWM:\\s*(\\d+)', said)[1])\n"
        "before = peak(); frame_paths(Path(sys.argv[1])); print(peak() - before)"
    )
    grown = int(subprocess.check_output([sys.executable, "-c", look, path]))
    assert path.stat().st_size > 30e6
    assert 0 < grown < 0.4 * path.stat().st_size


def test_a_film_of_sound_only_is_told(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    path = tmp_path / "sound.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=48000)
        heard = av.AudioFrame(format="fltp", layout="stereo", samples=1024)
        heard.sample_rate = 48000
        for plane in heard.planes:
            plane.update(bytes(plane.buffer_size))
        container.mux(stream.encode(heard))
        container.mux(stream.encode(None))
    with pytest.raises(InputError, match=r"sound\.mp4: wanted pictures, got sound alone"):
        frame_paths(path)


@pytest.mark.parametrize("kind", ["H.264", "ProRes 4444"])
def test_a_film_without_its_index_is_told(tmp_path: Path, kind: str) -> None:
    """Of a recording that broke off: FFmpeg finds a damaged file, or one without streams."""
    film = write_numbered(tmp_path / f"film{KINDS[kind].suffix}", KINDS[kind], 3)
    content = film.read_bytes()
    end = content.index(b"moov") - 4
    film.write_bytes(content[:end] if end > len(content) // 2 else content[:end] + content[-900:])
    with pytest.raises(InputError, match=r"got an MP4 without its index \(moov\)"):
        frame_paths(film)
