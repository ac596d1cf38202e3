"""The resident process: nothing hangs, late frames are known, and mistakes are one line."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from live_pictures import frame_of
from PIL import Image

from compensate.live.process import read_exactly, stream
from compensate.live.y4m import header_of
from domesim.errors import InputError
from domesim.scene import load_scene

SCENE = ["--scene", "dome_imax"]
PLAIN = {**os.environ, "DOMESIM_FAST": "0"}
FRAME = 16 * 16 * 3
LONG = 60  # seconds: nothing may hang for so long


def live(*options: str, data: bytes) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [sys.executable, "-m", "domesim", "live", *options],
        input=data, capture_output=True, timeout=LONG, check=False, env=PLAIN,
    )  # fmt: skip


def is_refused(done: subprocess.CompletedProcess[bytes], *words: str) -> None:
    said = done.stderr.decode().splitlines()
    assert done.returncode == 2, said
    assert "Traceback" not in done.stderr.decode()
    assert said[-1].startswith("domesim: ")
    for word in words:
        assert word in said[-1]


def pipe() -> tuple[int, int]:
    return os.pipe()


def test_frames_keep_their_order_and_their_number():
    source, sink = pipe()
    frames = iter([bytes([n]) * 10 for n in range(20)])
    report = stream(frames, lambda frame, number: frame + bytes([number]), sink)
    os.close(sink)
    data = read_exactly(source, 1000)
    os.close(source)
    assert data == b"".join(bytes([n]) * 11 for n in range(20))
    assert (report.frames, report.dropped) == (20, 0)
    assert report.figures(25.0)["latency_frames"] >= 0


@pytest.mark.parametrize("drop", [False, True])
def test_frames_before_a_cut_one_go_out(drop):
    """What came whole was shown in time; only then the mistake is told."""
    source, sink = pipe()

    def cut():
        for n in range(1 if drop else 5):
            yield bytes([n]) * 10
        raise InputError("ended within frame 5")

    def slow(frame, number):
        time.sleep(0.05)
        return frame

    with pytest.raises(InputError, match="within frame 5"):
        stream(cut(), slow, sink, drop=drop)
    os.close(sink)
    data = read_exactly(source, 1000)
    os.close(source)
    assert data == b"".join(bytes([n]) * 10 for n in range(1 if drop else 5))


def test_a_frame_waits_for_one_other_at_most():
    """A sender that is faster than the computer is kept waiting, so that frames are not late."""
    _, sink = pipe()
    taken, ahead = [], []

    def come() -> Iterator[bytes]:
        for n in range(8):
            taken.append(n)
            yield b"x"

    def slow(frame: bytes, number: int) -> bytes:
        time.sleep(0.02)  # the sender has all the time that it wants
        ahead.append(len(taken) - number - 1)
        return frame

    assert stream(come(), slow, sink).dropped == 0
    assert max(ahead) <= 2  # one waits, and one is read


def test_late_frames_are_dropped_if_asked_for():
    _, sink = pipe()
    taken = []

    def come() -> Iterator[bytes]:
        for n in range(30):
            time.sleep(0.01)
            yield bytes([n])

    def slow(frame, number):
        time.sleep(0.06)
        taken.append((frame[0], number))
        return frame

    report = stream(come(), slow, sink, drop=True)
    assert report.dropped > 5
    assert report.frames + report.dropped == 30
    assert all(came == number for came, number in taken)  # those that are left out count, too


def test_whoever_reads_has_gone():
    source, sink = pipe()
    threading.Timer(0.2, os.close, [source]).start()
    endless = iter(lambda: b"x" * 100_000, None)
    with pytest.raises(InputError, match="has gone"):
        stream(endless, lambda frame, number: frame, sink)
    os.close(sink)


def test_it_is_seen_that_nobody_reads_while_no_frame_comes():
    source, sink = pipe()
    quiet, sender = pipe()
    threading.Timer(0.2, os.close, [source]).start()
    frames = iter(lambda: read_exactly(quiet, 10, sink), None)
    with pytest.raises(InputError, match="has gone"):
        stream(frames, lambda frame, number: frame, sink)
    for each in (sink, quiet, sender):
        os.close(each)


def test_a_mistake_in_a_frame_ends_it():
    _, sink = pipe()

    def broken(frame: bytes, number: int) -> bytes:
        raise InputError("frame 3 is broken")

    with pytest.raises(InputError, match="frame 3"):
        stream(iter([b"x"] * 9), broken, sink)


def test_raw_frames_through_the_command():
    """In turns: what is read and written in the same places is not mixed up."""
    frames = np.tile(
        np.random.default_rng(0).integers(0, 256, (2, 16, 16, 3), np.uint8), (4, 1, 1, 1)
    )
    options = ["--size", "16x16", "--fps", "25", "--json", "--dither", "none"]
    done = live(*SCENE, *options, data=frames.tobytes())
    assert done.returncode == 0, done.stderr
    found = np.frombuffer(done.stdout, np.uint8).reshape(frames.shape)
    assert (found == np.tile(found[:2], (4, 1, 1, 1))).all()
    assert (found[0] != found[1]).any()
    assert (found[:2] != frames[:2]).any(axis=(1, 2, 3)).all()
    told = json.loads(done.stderr.decode().split("ready\n")[1])
    assert told["frames"] == 8
    assert told["latency_ms"]["median"] > 0
    assert told["core_ms"] > 0
    assert told["copies"] > 1
    assert "latency_frames" in told


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--size", "16"], ["--size", "WIDTHxHEIGHT"]),
        (["--size", "16x17"], ["square"]),
        (["--size", "1x1"], ["2"]),
        (["--size", "16x16", "--pixel-format", "yuv420p"], ["rgb24"]),
        (["--size", "16x16", "--packing", "side-by-side"], ["one view"]),
        (["--size", "16x16", "--encoding", "wrong"], ["srgb"]),
        (["--size", "16x16", "--device", "wrong"], ["cuda"]),
    ],
)
def test_mistaken_options_are_one_line(run, options, words):
    run("live", *SCENE, *options).is_refused(*words)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"no stream at all", ["Y4M", "--size"]),
        (b"", ["Y4M"]),
        (b"YUV4MPEG2 W16 H16 Cmono", ["Cmono"]),
        (b"YUV4MPEG2 W16 Hx", ["Y4M"]),
        (b"YUV4MPEG2 W16 H16 It C420jpeg", ["interlaced"]),
        (b"YUV4MPEG2 W16 H16 C420jpeg XCOLORRANGE=FULL", ["full range"]),
    ],
)
def test_headers_that_are_refused(line, words):
    with pytest.raises(InputError) as refused:
        header_of(line)
    for word in words:
        assert word in str(refused.value)


@pytest.mark.long
@pytest.mark.parametrize(
    ("options", "data", "words"),
    [
        (["--size", "16x16"], b"\0" * (FRAME + 5), ["within frame 1", "--size"]),
        ([], b"YUV4MPEG2 W16 H16 C420jpeg\nFRAME\nshort", ["within frame 0"]),
        ([], b"YUV4MPEG2 W16 H16 C420jpeg\nNOISE\n", ["FRAME"]),
        (
            ["--size", "16x16", "--pixel-format", "rgbaf16"],
            np.full((16, 16, 4), np.nan, "<f2").tobytes(),
            ["frame 0", "NaN"],
        ),
    ],
)
def test_mistaken_frames_are_one_line(options, data, words):
    is_refused(live(*SCENE, *options, data=data), *words)


@pytest.mark.long
def test_a_pair_has_two_views():
    pair = ["--scene", "stereo_spectral", "--size"]
    is_refused(live(*pair, "15x16", data=b""), "even width")
    done = live(*pair, "18x7", data=bytes(range(256))[: 18 * 7] * 3)
    assert (done.returncode, len(done.stdout)) == (0, 18 * 7 * 3)


@pytest.mark.parametrize("name", ["dome_hemisphere", "stereo_polarised_paper"])
def test_a_cue_list_gives_what_it_gives_files(run, tmp_path, name):
    """A ramp frame by frame, and frames that are subtracted, left alone, or not named."""
    scene = load_scene(name)
    frames = np.stack([frame_of(scene, 32) // (1 + n % 3) for n in range(8)])
    for number, frame in enumerate(frames, 1):
        Image.fromarray(frame).save(tmp_path / f"in.{number}.png")
    (tmp_path / "cues.csv").write_text(
        "first,last,method,lift,ramp\n2,5,,4,3\n6,6,none,,\n7,7,subtractive,,\n"
    )
    how = ["--scene", name, "--encoding", "srgb", "--dither", "none"]
    how += [] if scene.views == 1 else ["--packing", "side-by-side"]
    cues = ["--cues", str(tmp_path / "cues.csv")]

    def files(*more):
        out = tmp_path / f"out{len(more)}"
        done = run("compensate", tmp_path / "in.#.png", *how, *more, "--workers", 0, "--out", out)
        assert done.code == 0, done.err
        return np.stack([np.asarray(Image.open(out / f"in.{n}.png")) for n in range(1, 9)])

    wanted, size = files(*cues), f"{frames.shape[2]}x{frames.shape[1]}"
    piped = live(*how, *cues, "--size", size, data=frames.tobytes())
    assert piped.returncode == 0, piped.stderr
    found = np.frombuffer(piped.stdout, np.uint8).reshape(frames.shape)
    assert np.abs(found.astype(int) - wanted).max() <= 1
    assert (found[5] == frames[5]).all()
    differs = (files() != wanted).any(axis=(1, 2, 3))
    assert differs.tolist() == [False, True, True, True, True, True, True, False]


@pytest.mark.long
@pytest.mark.parametrize("killed", ["reader", "writer"])
def test_whoever_is_killed_ends_it(killed):
    feed = "import sys, time\nwhile True: sys.stdout.buffer.write(bytes(768)); time.sleep(.01)"
    drain = "import sys\nwhile sys.stdin.buffer.read(768): pass"
    writer = subprocess.Popen([sys.executable, "-c", feed], stdout=subprocess.PIPE)
    process = subprocess.Popen(
        [sys.executable, "-m", "domesim", "live", *SCENE, "--size", "16x16"],
        stdin=writer.stdout, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=PLAIN,
    )  # fmt: skip
    reader = subprocess.Popen([sys.executable, "-c", drain], stdin=process.stdout)
    assert writer.stdout is not None
    assert process.stdout is not None
    assert process.stderr is not None
    writer.stdout.close()
    process.stdout.close()
    try:
        assert b"ready" in process.stderr.readline()
        time.sleep(0.5)
        (reader if killed == "reader" else writer).send_signal(signal.SIGKILL)
        code = process.wait(LONG)
        said = process.stderr.read().decode().splitlines()
    finally:
        for each in (reader, process, writer):
            each.kill()
            each.wait()
        process.stderr.close()
    assert len(said) == 1
    assert code == 2 if killed == "reader" else code in (0, 2)
    assert killed == "writer" or "has gone" in said[0]


@pytest.mark.parametrize("sampling", ["420jpeg", "422", "444", "420p10", "444p12"])
def test_planes_come_back(sampling):
    """Of smooth pictures within their edges, for colour is halved."""
    rows, cols = np.mgrid[:9, :13]
    picture = np.stack([rows / 9, cols / 13, 0.5 + 0 * rows], axis=-1)
    codes = np.asarray(np.rint(picture * 0.8 * 65535), np.uint16)
    header = header_of(f"YUV4MPEG2 W13 H9 F25:1 Ip C{sampling}".encode())
    data = header.encoded(codes)
    assert len(data) == header.size
    apart = np.abs(header.decoded(bytearray(data)).astype(int) - codes)[2:-2, 2:-2]
    assert apart.max() / 65535 < 2 / (1 << header.bits)


@pytest.mark.long
def test_a_stream_that_says_itself_what_it_is():
    head, body = b"YUV4MPEG2 W16 H16 F25:1 Ip C420jpeg", bytes([90] * 256 + [128] * 128)
    done = live(*SCENE, data=head + b"\n" + (b"FRAME\n" + body) * 3)
    assert done.returncode == 0, done.stderr
    first, rest = done.stdout.split(b"\n", 1)
    assert first == head
    assert len(rest) == 3 * (6 + len(body))
