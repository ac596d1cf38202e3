"""Results as videos: lossless or nearly, tagged, and made anew only if they must be."""

from __future__ import annotations

import json
import time
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batches import do_show, harmful_in
from command_line import Run
from numpy.typing import NDArray
from videos import KINDS, write_numbered

from domesim.commands.shows import suffix_of
from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_frame, write_frame
from domesim.frames.encodings import encoding_named
from domesim.frames.film import FILMS, write_film
from domesim.frames.timing import USUAL_RATE, Timing, exact_rate, timing_of
from domesim.frames.video import frame_paths
from domesim.host.console import Console
from domesim.shows import job
from domesim.shows.estimate import estimate
from domesim.shows.film import Films
from domesim.shows.job import open_job, sha256
from domesim.shows.run import Done, Running
from domesim.shows.show import find_show
from domesim.shows.work import Writing

pytest.importorskip("av")

VIDEO = ColourTag("bt1886", "BT.709", "the test")
TIMING = Timing(Fraction(30000, 1001), "01:02:03:04")


def written(
    path: Path, pictures: list[NDArray[Any]], bits: int, colour: ColourTag = VIDEO, **options: Any
) -> list[Frame]:
    """Write pictures as a film, and read it."""
    frames = (
        Frame(picture.astype(np.float32), path.with_name(f"a.{k}.png"), colour, bits, False)
        for k, picture in enumerate(pictures)
    )
    write_film(path, frames, len(pictures), colour, TIMING, **options)
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    return [read_frame(each) for each in frame_paths(path)]


def pictures(rows: int = 64, cols: int = 64) -> list[NDArray[Any]]:
    """Smooth, and with edges and noise, all colours alike."""
    y, x = np.mgrid[:rows, :cols] / max(rows, cols)
    smooth = np.stack([x, y, 0.5 + 0.4 * np.sin(7 * x)], -1)
    noise = np.random.default_rng(1).random((rows, cols, 3))
    return [smooth, 0.8 * smooth + 0.1 * (x > y)[..., None], noise]


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_ffv1_comes_back_bit_by_bit(tmp_path: Path, bits: int) -> None:
    codes = np.random.default_rng(bits).integers(0, 2**bits, (3, 37, 53, 3))
    frames = written(tmp_path / "film.mkv", list(codes / (2**bits - 1)), bits)
    assert [frame.bits for frame in frames] == [bits] * 3
    for frame, right in zip(frames, codes, strict=True):
        assert np.array_equal(np.rint(frame.pixels * (2**bits - 1)), right)


@pytest.mark.parametrize("suffix", [".mkv", ".mov", ".mp4"])
def test_the_same_frames_give_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    """No time, version or number drawn by lot is in them."""
    bits = 8 if suffix == ".mkv" else 16
    contents = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        path = tmp_path / name / f"film{suffix}"
        written(path, pictures(), bits)
        contents.append(path.read_bytes())
        time.sleep(1.1 * (name == "first"))
    assert contents[0] == contents[1]


def test_prores_comes_back_nearly(tmp_path: Path) -> None:
    """In codes of 12 bits; 10 bits of Y, C_B and C_R alone are 1.5 off, on average."""
    originals = pictures(63, 85)
    found = written(tmp_path / "film.mov", originals, 16)
    off = [np.abs(a.pixels - b) * 4095 for a, b in zip(found, originals, strict=True)]
    assert [frame.bits for frame in found] == [12] * 3
    assert off[0].mean() < 2
    assert off[0].max() < 16
    assert off[2].mean() < 20  # noise, which no master is


@pytest.mark.parametrize("bits", [8, 10])
def test_a_preview_comes_back_as_its_codec_has_it(tmp_path: Path, bits: int) -> None:
    """H.264 of 8 bits, HEVC of 10, in codes of 8 bits, with the tags that players know."""
    import av  # noqa: PLC0415

    film = next(each for each in FILMS[".mp4"] if bits in each.bits)
    originals = pictures()[:2]
    found = written(tmp_path / "film.mp4", originals, 16, film=film)
    assert [frame.bits for frame in found] == [bits] * 2
    assert timing_of(frame_paths(tmp_path / "film.mp4")[0], USUAL_RATE) == TIMING
    off = [np.abs(a.pixels - b) * 255 for a, b in zip(found, originals, strict=True)]
    assert off[0].mean() < 2
    assert off[0].max() < 18
    with av.open(str(tmp_path / "film.mp4")) as opened:
        assert opened.streams.video[0].codec_context.codec_tag == {8: "avc1", 10: "hvc1"}[bits]
    (tmp_path / "odd").mkdir()
    with pytest.raises(InputError, match="wanted frames of even width and height"):
        written(tmp_path / "odd/film.mp4", pictures(64, 63), 16, film=film)


def test_a_grey_preview_is_right_to_half_a_code(tmp_path: Path) -> None:
    """Limited range, BT.709, and colour differences where they are said to be."""
    colours = np.array([[0.25, 0.5, 0.75], [0.9, 0.1, 0.3]])
    plain = [np.broadcast_to(colours[k], (64, 64, 3)) for k in (0, 1)]
    for frame, colour in zip(written(tmp_path / "film.mp4", plain, 16), colours, strict=True):
        np.testing.assert_allclose(frame.pixels[16:48, 16:48].mean((0, 1)), colour, atol=0.006)


def test_what_is_rounded_to_prores_can_be_dithered(tmp_path: Path) -> None:
    """A grey between two codes of 10 bits is right on average."""
    grey = 0.4 + 0.3 / 876
    plain = [np.full((64, 64, 3), grey)]
    undithered = written(tmp_path / "film.mov", plain, 16)[0].pixels.mean()
    dithered = written(tmp_path / "film.mov", plain, 16, dithered=True)[0].pixels.mean()
    assert abs(undithered - grey) > 0.2 / 876
    assert abs(dithered - grey) < 0.05 / 876


SAID = {
    **dict.fromkeys(("bt709", "bt2020", "st2084", "hlg"), ".mov"),
    **dict.fromkeys(("srgb", "dcdm"), ".mkv"),
}


@pytest.mark.parametrize("name", SAID)
def test_it_says_what_it_is(tmp_path: Path, name: str) -> None:
    colour = encoding_named(name)
    path = tmp_path / f"film{SAID[name]}"
    (frame, *_) = written(path, pictures(), 16, colour)
    assert frame.colour.means_the_same_as(colour)
    assert not frame.colour.assumed
    if SAID[name] == ".mov":
        matrix = "BT.2020" if colour.primaries == "BT.2020" else "BT.709"
        assert frame.colour.source == f"file: stream's tags; {matrix} matrix; limited range"
    assert timing_of(frame_paths(path)[0], USUAL_RATE) == TIMING
    assert timing_of(frame_paths(path)[1], USUAL_RATE).timecode == ""


def test_a_film_is_whole_or_not_there(tmp_path: Path) -> None:
    path = tmp_path / "film.mkv"
    sizes = [np.zeros((8, 8, 3)), np.zeros((8, 9, 3))]
    with pytest.raises(InputError, match=r"a.1.png: wanted frames of one size"):
        written(path, sizes, 16)
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match=r"film.mkv: wanted to write it, got"):
        written(tmp_path / "none/film.mkv", sizes[:1], 16)


# As a show's results.


def sequence(folder: Path, count: int = 5, **attributes: Any) -> str:
    folder.mkdir(exist_ok=True)
    for number in range(1, count + 1):
        pixels = np.full((16, 18, 3), number / 100, np.float32)
        write_frame(Frame(pixels, folder, VIDEO, 16, False), folder / f"show.{number:04d}.png")
    return str(folder / "show.####.png")


def filmed(master: str, folder: Path, suffix: str = ".mkv", **options: Any) -> Done:
    show = find_show(master, frames=options.pop("frames", None))
    recipe = harmful_in(folder, faulty=options.pop("faulty", ""))
    return do_show(show, folder, recipe, Writing(suffix, **options))


def levels(path: Path) -> list[int]:
    return [round(100 * float(read_frame(each).pixels.mean())) for each in frame_paths(path)]


@pytest.mark.parametrize(
    ("suffix", "bits"),
    [(".mkv", None), (".mkv", 12), (".mov", None), (".mp4", None), (".mp4", 10)],
)
def test_a_sequence_becomes_a_film(tmp_path: Path, suffix: str, bits: int | None) -> None:
    done = filmed(sequence(tmp_path / "in"), tmp_path, suffix, bits=bits, fps=60)
    (film,) = done.films
    assert film == tmp_path / f"out/show{suffix}"
    assert levels(film) == [1, 2, 3, 4, 5]
    frame = read_frame(frame_paths(film)[0])
    assert frame.bits == (bits or {".mkv": 16, ".mov": 12, ".mp4": 8}[suffix])
    assert frame.colour.means_the_same_as(VIDEO)
    assert timing_of(frame_paths(film)[0], USUAL_RATE).rate == 60


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
def test_a_films_name_is_a_film_beside_its_frames(tmp_path: Path, run: Run, suffix: str) -> None:
    (tmp_path / "in").mkdir()
    film, scene = tmp_path / f"to/mine.{suffix}", ("--scene", "dome_hemisphere", "--method", "none")
    pattern = tmp_path / "in/s.%04d.png"
    command = ("compensate", pattern, *scene, "--workers", 0, "--out", film)
    for number in (1, 2, 3):
        pixels = np.full((16, 16, 3), number / 10, np.float32)
        path = tmp_path / f"in/s.{number:04d}.png"
        write_frame(Frame(pixels, path, VIDEO, 16, False), path)
    done = run(*command, "--json")
    assert done.code == 0, done.err
    assert done.figures()["films"] == [str(film)]
    assert {each.name for each in (tmp_path / "to").iterdir()} >= {film.name, "mine"}
    assert len(list((tmp_path / "to/mine").glob("s.*.png"))) == 3
    assert len(frame_paths(film)) == 3
    before = film.read_bytes()
    assert "made before" in run(*command).out
    assert film.read_bytes() == before
    theirs = film.with_name(f"theirs.{suffix}")
    theirs.write_bytes(b"somebody else's")
    run(*command[:-1], theirs).is_refused("did not write")
    assert theirs.read_bytes() == b"somebody else's"
    run(*command, "--format", "png").is_refused("wanted a folder for --format png")
    one = tmp_path / "in/s.0001.png"
    run("compensate", one, *scene, "--out", tmp_path / "one.mp4").is_refused("wanted a folder")


def test_a_film_becomes_a_film_of_its_rate_and_timecode(tmp_path: Path) -> None:
    source = tmp_path / "film.mov"
    frames = (Frame(each.astype(np.float32), source, VIDEO, 16, False) for each in pictures())
    write_film(source, frames, 3, VIDEO, TIMING)
    (film,) = filmed(str(source), tmp_path).films
    assert timing_of(frame_paths(film)[0], USUAL_RATE) == TIMING
    for a, b in zip(frame_paths(source), frame_paths(film), strict=True):
        assert np.abs(read_frame(a).pixels - read_frame(b).pixels).max() < 1 / 65535


def test_a_video_is_read_through_once_for_all_workers(tmp_path: Path, monkeypatch: Any) -> None:
    kind = KINDS["FFV1"]
    source = write_numbered(tmp_path / f"film{kind.suffix}", kind, 3)
    filmed(str(source), tmp_path, ".png")
    job._video_content.cache_clear()  # as of another process
    read: list[Path] = []
    monkeypatch.setattr(job, "sha256", lambda path: (read.append(path), sha256(path))[1])
    with open_job(tmp_path / "out", {}, anew=True) as again:
        known = again.sources([frame_paths(source)[0]])
    assert next(iter(known.values()))[2] == sha256(source)
    assert not read
    flip(source)
    known = again.sources([frame_paths(source)[1]])
    assert next(iter(known.values()))[2] == sha256(source)
    assert read == [source]


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def test_it_is_made_anew_only_if_it_must_be(tmp_path: Path) -> None:
    master = sequence(tmp_path / "in")
    (film,) = filmed(master, tmp_path).films

    def made() -> bool:
        before = film.stat().st_mtime_ns if film.exists() else 0
        done = filmed(master, tmp_path)
        assert levels(film) == [1, 2, 3, 4, 5]
        assert json.loads((tmp_path / "out/job/show.mkv.film").read_text())["made_of"]
        assert done.films == (film,)
        return film.stat().st_mtime_ns != before

    assert not made()
    film.unlink()
    assert made()
    flip(film)
    assert made()
    assert not made()
    assert not filmed(master, tmp_path, frames="2-3").films  # a farm's ranges are no film
    assert not made()
    filmed(master, tmp_path, fps=25)  # no frame is done anew
    assert timing_of(frame_paths(film)[0], USUAL_RATE).rate == 25
    assert made()
    assert len(list((tmp_path / "log").iterdir())) == 5


def test_a_dry_run_counts_the_film(tmp_path: Path) -> None:
    """Frames from black to noise, so that only those from all over the show tell its size."""
    (tmp_path / "in").mkdir()
    noise = np.random.default_rng(1).random((48, 64, 3), np.float32)
    for number in range(12):
        frame = Frame(noise * np.float32(number / 12), tmp_path, VIDEO, 16, False)
        write_frame(frame, tmp_path / f"in/show.{number + 1:04d}.png")
    show = find_show(str(tmp_path / "in/show.####.png"))
    quiet, recipe = Console(quiet=True), harmful_in(tmp_path)
    promised = estimate(show, tmp_path / "dry", recipe, quiet, Writing(".mkv"), Running(0))
    (film,) = filmed(str(tmp_path / "in/show.####.png"), tmp_path).films
    assert promised["disk_video"] == pytest.approx(film.stat().st_size, rel=0.2)
    assert promised["disk_total"] == 12 * promised["disk_frame"] + promised["disk_video"]
    assert promised["seconds_video"] > 0
    frames = 12 * promised["seconds_frame"]
    assert promised["seconds_total"] >= frames + promised["seconds_video"]
    assert not (tmp_path / "dry").exists()


def test_there_is_no_film_of_frames_that_failed(tmp_path: Path) -> None:
    done = filmed(sequence(tmp_path / "in"), tmp_path, faulty="show.0003.png")
    assert (len(done.failed), done.films) == (1, ())
    assert not (tmp_path / "out/show.mkv").exists()


@pytest.mark.parametrize("change", ["another frame", "half of it", "nothing"])
def test_there_is_no_film_of_frames_that_were_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    """After they were done, and before the film is made of them: no other picture, no fewer."""
    master = sequence(tmp_path / "in")

    def frames(self: Films, *arguments: Any) -> Any:
        found = original(self, *arguments)
        third, fourth = (tmp_path / f"out/show.{number:04d}.png" for number in (3, 4))
        if change == "nothing":
            third.unlink()
        else:
            whole = fourth.read_bytes()
            third.write_bytes(whole if change == "another frame" else whole[: len(whole) // 2])
        return found

    original = Films._frames
    with monkeypatch.context() as changed:
        changed.setattr(Films, "_frames", frames)
        with pytest.raises(InputError, match=r"out/show.0003.png: wanted") as refused:
            filmed(master, tmp_path)
    assert "\n" not in str(refused.value)
    assert not list((tmp_path / "out").glob("*.mkv"))
    done = filmed(master, tmp_path)
    assert done.kept == 4
    assert levels(done.films[0]) == [1, 2, 3, 4, 5]


def test_left_and_right_become_two(tmp_path: Path) -> None:
    for eye in ("L", "R"):
        sequence(tmp_path / eye, 3)
    show = find_show(
        None,
        str(tmp_path / "L/show.####.png"),
        str(tmp_path / "R/show.####.png"),
        as_given=True,
    )
    for kept in (0, 3):
        done = do_show(show, tmp_path, harmful_in(tmp_path), Writing(".mkv"))
        assert done.films == (tmp_path / "out/left/show.mkv", tmp_path / "out/right/show.mkv")
        assert done.kept == kept
    assert [levels(film) for film in done.films] == [[1, 2, 3]] * 2


REFUSED: dict[str, tuple[str, dict[str, Any]]] = {
    "is for a sequence or video, got one file": ("show.0001.png", {"suffix": ".mkv"}),
    "--bits 9: a .mkv holds 8, 10, 12, 16": ("show.####.png", {"suffix": ".mkv", "bits": 9}),
    "--bits 16: a .mov holds 12": ("show.####.png", {"suffix": ".mov", "bits": 16}),
    "--fps is for videos": ("show.####.png", {"suffix": ".exr", "fps": 25}),
    "--fps must lie between": ("show.####.png", {"suffix": ".mkv", "fps": -1}),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_a_film_is_refused_before_any_work(tmp_path: Path, message: str) -> None:
    name, options = REFUSED[message]
    sequence(tmp_path / "in")
    with pytest.raises(InputError, match=message):
        filmed(str(tmp_path / "in" / name), tmp_path, **options)
    assert not list((tmp_path / "log").iterdir())


def test_a_film_does_not_go_over_its_master(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    source = write_numbered(tmp_path / "out/film.mkv", KINDS["FFV1"], 3)
    with pytest.raises(InputError, match=r"film.mkv: wanted a place for the result, got the input"):
        filmed(str(source), tmp_path)
    assert not list((tmp_path / "log").iterdir())


def test_rates_are_what_is_meant() -> None:
    rates = {
        23.976: Fraction(24000, 1001),
        29.97: Fraction(30000, 1001),
        59.94: Fraction(60000, 1001),
    }
    assert all(exact_rate(shown) == meant for shown, meant in rates.items())
    assert [exact_rate(rate) for rate in (24, 12.5, 60)] == [24, Fraction(25, 2), 60]


def test_formats_have_names() -> None:
    assert [suffix_of(name) for name in ("mov", "MKV")] == [".mov", ".mkv"]
    with pytest.raises(InputError, match="mov, mkv or mp4"):
        suffix_of("avi")
