"""Sums of masters are checked, and those of results are made: ``sha256sum`` agrees about both."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from batches import Harmful, copied, do_show, harmful_in, make_show, show_of
from command_line import Run
from image_files import store
from videos import KINDS, write_numbered

from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.host.files import written_sums
from domesim.shows import checksums
from domesim.shows.checksums import listed_sums
from domesim.shows.show import Show, find_show

ODD = ("plain.png", "a name.png", "back\\slash.png", "new\nline.png", "\r.png", "caf\udce9.png")


@pytest.fixture
def recipe(tmp_path: Path) -> Harmful:
    return harmful_in(tmp_path)


def listing_of(folder: Path, *options: str, pattern: str = "in.*") -> Path:
    """By sha256sum."""
    names = sorted(path.name for path in folder.glob(pattern))
    run = subprocess.run(["sha256sum", *options, *names], cwd=folder, check=True, stdout=-1)
    (folder / "SUMS").write_bytes(run.stdout)
    return folder / "SUMS"


def checked(folder: Path, frames: str | None = None) -> Show:
    return show_of(folder / "in", frames).listed_in(folder / "in/SUMS")


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-20] ^= 1
    path.write_bytes(content)


def agrees(folder: Path, name: str = "SHA256SUMS") -> list[str]:
    """Files that sha256sum finds as they are listed."""
    run = ["sha256sum", "--check", "--strict", name]
    told = subprocess.run(run, cwd=folder, check=True, stdout=-1).stdout
    return re.findall(r"(?m)^(.*): OK$", os.fsdecode(told))


# The format.


@pytest.mark.parametrize("options", [(), ("--binary",), ("--text",)])
def test_names_are_read_as_sha256sum_writes_them(tmp_path: Path, options: tuple[str, ...]) -> None:
    for name in ODD:
        (tmp_path / name).write_bytes(name.encode(errors="surrogateescape"))
    listing = listing_of(tmp_path, *options, pattern="*.png")
    found = listed_sums(listing, [tmp_path / name for name in ODD])
    told = [hashlib.sha256(name.encode(errors="surrogateescape")).hexdigest() for name in ODD]
    assert found == told


def test_names_are_written_as_sha256sum_reads_them(tmp_path: Path) -> None:
    for name in ODD:
        (tmp_path / name).touch()
    sums = dict.fromkeys(ODD, hashlib.sha256(b"").hexdigest())
    (tmp_path / "SHA256SUMS").write_bytes(written_sums(sums))
    assert len(agrees(tmp_path)) == len(ODD)


def test_names_count_from_the_folder_of_the_sums(tmp_path: Path, monkeypatch) -> None:
    make_show(tmp_path / "in", 1)
    digest = hashlib.sha256((tmp_path / "in/in.0001.exr").read_bytes()).hexdigest()
    (tmp_path / "lists").mkdir()
    (tmp_path / "lists/SUMS").write_text(f"# of a show\n\n{digest.upper()}  ../in/in.0001.exr\r\n")
    (tmp_path / "link").symlink_to(tmp_path / "in")
    monkeypatch.chdir(tmp_path / "in")
    for path in ("in.0001.exr", "../in/in.0001.exr", tmp_path / "link/in.0001.exr"):
        assert listed_sums(tmp_path / "lists/SUMS", [Path(path)]) == [digest]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89PNG\r\n", "lines of sha256sum.*line 1 is none"),
        (b"d41d8cd98f00b204e9800998ecf8427e  in.0001.exr\n", "lines of sha256sum.*line 1 is none"),
        (b"0" * 64 + b"  a\n" + b"1" * 64 + b"  a\n", "one sum of each file, got two of a"),
        (
            b"0" * 64 + b"  other.exr\n",
            r"in\.0001\.exr and 1 more: wanted a sum in .*none",
        ),
        (b"", r"in\.0001\.exr and 1 more: wanted a sum"),
        (None, "SUMS: wanted a file of SHA-256 sums, got 'no such file or directory'"),
    ],
)
def test_what_is_no_listing_of_the_masters_is_refused_at_once(
    tmp_path: Path, content: bytes | None, message: str
) -> None:
    make_show(tmp_path / "in", 2)
    if content is not None:
        (tmp_path / "in/SUMS").write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        checked(tmp_path)
    assert "\n" not in str(caught.value)


# Masters.


def test_a_damaged_jpeg_is_refused(run: Run, tmp_path: Path, out: Path) -> None:
    """Alone it decodes, to another picture."""
    noise = np.random.default_rng(1).integers(0, 256, (16, 16, 3), np.uint8)
    path = store(tmp_path / "in.jpg", noise)
    whole, listing = read_frame(path).pixels, listing_of(tmp_path)
    scene = ("--scene", "dome_hemisphere", "--checksums", listing)
    assert run("observe", path, *scene, "--out", out).code == 0
    flip(path)
    assert not np.array_equal(read_frame(path).pixels, whole)
    run("observe", path, *scene, "--out", out).is_refused("in.jpg: wanted SHA-256", "copy")


@pytest.mark.parametrize("workers", [0, 1])
def test_a_damaged_frame_is_named_and_the_others_are_done(
    tmp_path: Path, recipe: Harmful, workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, (Path(__file__).parents[2], "."))))
    make_show(tmp_path / "in", 3)
    listing_of(tmp_path / "in")
    flip(tmp_path / "in/in.0002.exr")
    done = do_show(checked(tmp_path), tmp_path, recipe, workers=workers)
    assert [Path(frame["input"]).name for frame in done.frames] == ["in.0001.exr", "in.0003.exr"]
    (reason,) = done.failed
    assert "in.0002.exr: wanted SHA-256" in reason
    assert "in.0002.exr" not in recipe.begun()
    # Copied again, the same command goes on
    flip(tmp_path / "in/in.0002.exr")
    assert (again := do_show(checked(tmp_path), tmp_path, recipe)).kept == 2
    assert not again.failed


def test_a_frame_that_was_done_of_a_damaged_master_is_not_kept(
    tmp_path: Path, recipe: Harmful
) -> None:
    """Its first run had no sums, and neither size nor time of the file have changed since."""
    make_show(tmp_path / "in", 2)
    listing_of(tmp_path / "in")
    shutil.copy(tmp_path / "in/in.0001.exr", tmp_path / "in/in.0002.exr")
    assert not copied(tmp_path, recipe, 0).failed
    done = do_show(checked(tmp_path), tmp_path, recipe)
    assert (done.kept, len(done.failed)) == (1, 1)
    assert "in.0002.exr: wanted SHA-256" in done.failed[0]


def test_a_video_is_hashed_once_and_not_by_each_frame(
    tmp_path: Path, recipe: Harmful, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    film = write_numbered(tmp_path / "in/film.mov", KINDS["ProRes 4444"], 3)
    listing = listing_of(tmp_path / "in", pattern="film.mov")
    show = find_show(str(film)).listed_in(listing)
    hashed: list[Path] = []
    plain = checksums.sha256
    monkeypatch.setattr(checksums, "sha256", lambda path: hashed.append(path) or plain(path))
    for moment in show.moments:
        show.read(moment, repair=False)
    assert hashed == [film]
    assert len(do_show(show, tmp_path, recipe).frames) == 3
    flip(film)
    assert "film.mov/film.0001.mov: wanted SHA-256" in do_show(show, tmp_path, recipe).failed[0]


def test_with_and_without_sums_it_is_one_job(tmp_path: Path, recipe: Harmful) -> None:
    make_show(tmp_path / "in", 2)
    listing_of(tmp_path / "in")
    do_show(checked(tmp_path, "1"), tmp_path, recipe)
    assert copied(tmp_path, recipe, 0).kept == 1
    assert do_show(checked(tmp_path), tmp_path, recipe).kept == 2


# Results.


def test_sums_of_results_are_made(tmp_path: Path, recipe: Harmful) -> None:
    """Of each part those of its frames, of the whole all; the next command takes them."""
    make_show(tmp_path / "in", 3)
    do_show(show_of(tmp_path / "in", "1-2"), tmp_path, recipe)
    job = tmp_path / "out/job"
    assert agrees(job, "SHA256SUMS-1-2") == ["../in.0001.exr", "../in.0002.exr"]
    names = [f"../in.{number:04d}.exr" for number in (1, 2, 3)]
    for _ in range(2):  # once done, once kept
        copied(tmp_path, recipe, 0)
        assert agrees(job) == names
    do_show(show_of(tmp_path / "in", "3"), tmp_path, recipe)
    assert agrees(job, "SHA256SUMS-3") == names[2:]
    following = show_of(tmp_path / "out").listed_in(job / "SHA256SUMS")
    (tmp_path / "next").mkdir()
    assert not do_show(following, tmp_path / "next", recipe).failed


def test_sums_of_what_failed_are_not_made(tmp_path: Path) -> None:
    make_show(tmp_path / "in", 3)
    copied(tmp_path, harmful_in(tmp_path, faulty="in.0002.exr"), 0)
    assert agrees(tmp_path / "out/job") == ["../in.0001.exr", "../in.0003.exr"]


def test_sums_of_left_right_and_pictures(run: Run, tmp_path: Path, out: Path) -> None:
    """Two folders for results of one name; and the maps that predict draws."""
    for side, level in (("L", 90), ("R", 100)):
        (tmp_path / side).mkdir()
        for number in (1, 2):
            noise = np.random.default_rng(level + number).integers(0, level, (24, 32, 3), np.uint8)
            store(tmp_path / side / f"{number:04d}.png", noise)
    sides = ("--left", tmp_path / "L/####.png", "--right", tmp_path / "R/####.png")
    how = ("--scene", "stereo_cinema_silver", "--workers", 0, "--out")
    assert run("observe", *sides, *how, out).code == 0
    names = ["../left/0001.png", "../right/0001.png", "../left/0002.png", "../right/0002.png"]
    assert agrees(out / "job") == names
    assert run("predict", *sides, "--as-given", *how, out / "maps").code == 0
    found = agrees(out / "maps/job")
    assert "../left/0001.maps.exr" in found or "../0001.maps.exr" in found
    assert any(name.endswith(".png") for name in found)


# What decoders say themselves.


def test_a_decoders_warning_is_an_error(tmp_path: Path) -> None:
    """Samples come all the same: libjpeg goes on, and OpenImageIO keeps the warning."""
    noise = np.random.default_rng(1).integers(0, 256, (32, 32, 3), np.uint8)
    whole = store(tmp_path / "whole.jpg", noise, jpeg__progressive=1).read_bytes()
    path, warned = tmp_path / "in.jpg", 0
    for place in range(len(whole) // 2, len(whole), 7):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 64]) + whole[place + 1 :])
        reader = oiio.ImageInput.open(str(path))
        if reader is None:
            assert oiio.geterror()
            continue
        says = reader.geterror()
        if reader.read_image(0, 0, 0, 3, "uint8") is not None and (says or reader.geterror()):
            warned += 1
            with pytest.raises(InputError, match=r"does not decode .JPEG error"):
                read_frame(path)
        reader.close()
    assert warned > 5
