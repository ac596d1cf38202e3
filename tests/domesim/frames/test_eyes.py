"""Files that say which eye is which: they are believed, kept, and not argued with."""

from __future__ import annotations

import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from command_line import Run
from PIL import Image
from test_as_players_show import box, with_box
from videos import KINDS, write_video

from domesim.errors import InputError
from domesim.frames import read_frame, read_master, write_master
from domesim.frames.formats.png import chunk
from domesim.frames.video import frame_paths

ROWS, COLS = 32, 48


def views() -> tuple[np.ndarray, np.ndarray]:
    """Left and right, (row, col, 3) 8 bits: left is darker."""
    row, col = np.mgrid[:ROWS, :COLS]
    left = np.stack([row * 3, col * 2, row + col], -1).astype(np.uint8)
    return left, left + 100


def packed(first: np.ndarray, second: np.ndarray, packing: str) -> np.ndarray:
    return np.concatenate([first, second], 1 if packing == "side-by-side" else 0)


def cross_png(path: Path, mode: int) -> Path:
    left, right = views()
    pair = (right, left) if mode == 0 else (left, right)
    Image.fromarray(packed(*pair, "side-by-side")).save(path)
    content = path.read_bytes()
    path.write_bytes(content[:33] + chunk(b"sTER", bytes([mode])) + content[33:])
    return path


def jps(path: Path, layout: int, flags: int) -> Path:
    left, right = views()
    packing = {2: "side-by-side", 3: "top-bottom"}.get(layout, "side-by-side")
    pair = (left, right) if flags & 4 else (right, left)
    Image.fromarray(packed(*pair, packing)).save(path, quality=100, subsampling=0)
    body = b"_JPSJPS_" + struct.pack(">H4B", 4, 0, flags, layout, 1) + b"\0\0"
    content = path.read_bytes()
    segment = b"\xff\xe3" + struct.pack(">H", len(body) + 2) + body
    path.write_bytes(content[:2] + segment + content[2:])
    return path


def assert_eyes(path: Path, packing: str = "side-by-side", tolerance: int = 0) -> None:
    master = read_master([path], packing=packing)
    for frame, view in zip(master.frames, views(), strict=True):
        found = np.rint(frame.pixels * 255)
        np.testing.assert_allclose(found, view, atol=tolerance)


@pytest.mark.parametrize("mode", [0, 1])
def test_a_png_says_it_by_ster(tmp_path: Path, mode: int) -> None:
    path = cross_png(tmp_path / "in.png", mode)
    assert_eyes(path)
    master = read_master([path], packing="side-by-side")
    assert f"{'right' if mode == 0 else 'left'} first (sTER)" in master.described()
    write_master(master, [tmp_path / "out.png"])
    assert chunk(b"sTER", bytes([mode])) in (tmp_path / "out.png").read_bytes()
    with Image.open(path) as old, Image.open(tmp_path / "out.png") as new:
        np.testing.assert_array_equal(np.asarray(old), np.asarray(new))
    assert_eyes(tmp_path / "out.png")


@pytest.mark.parametrize("layout", [2, 3])
@pytest.mark.parametrize("flags", [0, 4])
def test_a_jpeg_says_it_as_jps_does(tmp_path: Path, layout: int, flags: int) -> None:
    path = jps(tmp_path / "in.jpg", layout, flags)
    packing = {2: "side-by-side", 3: "top-bottom"}[layout]
    assert_eyes(path, packing, tolerance=3)
    master = read_master([path], packing=packing)
    write_master(master, [tmp_path / "out.jpg"])
    content = (tmp_path / "out.jpg").read_bytes()
    assert b"_JPSJPS_\0\4" + bytes([0, flags, layout, 1]) in content
    assert content.count(b"_JPSJPS_") == 1
    assert_eyes(tmp_path / "out.jpg", packing, tolerance=4)


@pytest.mark.parametrize("name", ["pair.pns", "pair.jps"])
def test_stereo_suffixes_are_known(tmp_path: Path, out: Path, run: Run, name: str) -> None:
    made = (
        cross_png(tmp_path / "a.png", 0) if name.endswith("pns") else jps(tmp_path / "a.jpg", 2, 0)
    )
    path = made.rename(tmp_path / name)
    stereo = ("--scene", "stereo_cinema_silver", "--method", "none", "--out", out)
    result = run("compensate", path, *stereo, "--packing", "side-by-side")
    assert result.code == 0, result
    assert_eyes(out / name, tolerance=4)


def test_what_cannot_say_it_has_left_first(tmp_path: Path) -> None:
    sources = {
        "png": (cross_png(tmp_path / "in.png", 0), "side-by-side"),
        "jpg": (jps(tmp_path / "in.jpg", 3, 0), "top-bottom"),
    }
    masters = {
        name: read_master([path], packing=packing) for name, (path, packing) in sources.items()
    }
    for source, master in masters.items():
        for suffix in ("tif", "exr", "dpx"):
            write_master(master, [tmp_path / f"{source}.{suffix}"])
            assert_eyes(tmp_path / f"{source}.{suffix}", tolerance=4, packing=master.packing)
    # Side by side a JPEG says what a PNG said; one above the other a PNG cannot.
    write_master(masters["png"], [tmp_path / "x.jpg"])
    assert_eyes(tmp_path / "x.jpg", tolerance=4)
    write_master(masters["jpg"], [tmp_path / "x.png"])
    assert_eyes(tmp_path / "x.png", tolerance=4, packing="top-bottom")


def test_the_command_goes_by_it_and_refuses_another_packing(
    tmp_path: Path, out: Path, run: Run
) -> None:
    path = cross_png(tmp_path / "in.png", 0)
    stereo = ("--scene", "stereo_cinema_silver", "--method", "none", "--out", out)
    result = run("compensate", path, *stereo)
    result.is_refused("--packing side-by-side, as it says itself")
    result = run("compensate", path, *stereo, "--packing", "side-by-side")
    assert result.code == 0, result
    assert "right first (sTER)" in result.out
    result = run("compensate", path, *stereo, "--packing", "top-bottom")
    result.is_refused("in.png", "top-bottom", "side-by-side, right first (sTER)")
    other = cross_png(tmp_path / "other.png", 0)
    result = run("compensate", "--left", path, "--right", other, "--as-given", *stereo)
    result.is_refused("wanted the left view", "holds both (sTER)")


@pytest.mark.parametrize("layout", [1, 4])
def test_views_in_other_layouts_are_refused(tmp_path: Path, layout: int) -> None:
    with pytest.raises(InputError, match=f"JPS of layout {layout}"):
        read_frame(jps(tmp_path / "in.jpg", layout, 4))


def test_a_mono_jps_is_an_ordinary_picture(tmp_path: Path) -> None:
    path = jps(tmp_path / "in.jpg", 2, 4)
    path.write_bytes(path.read_bytes().replace(bytes([0, 4, 2, 1]), bytes([0, 4, 2, 0]), 1))
    assert len(read_master([path]).frames) == 1


def mpo(path: Path, kinds: tuple[int, ...] = (0x020002, 0x020002), **options: object) -> Path:
    """An MPO by Pillow, whose pictures are of those kinds (CIPA DC-007, table 4): two views."""
    left, right = (Image.fromarray(view) for view in views())
    others = [right] * (len(kinds) - 1)
    quality = {"quality": 100, "subsampling": 0, **options}
    left.save(path, format="MPO", save_all=True, append_images=others, **quality)
    content = bytearray(path.read_bytes())
    place = content.index(b"MPF\0") + 4
    order = "<" if content[place : place + 2] == b"II" else ">"
    entries = content.index(struct.pack(order + "HHI", 0xB002, 7, 16 * len(kinds)), place)
    (offset,) = struct.unpack_from(order + "I", content, entries + 8)
    for k, kind in enumerate(kinds):
        struct.pack_into(order + "I", content, place + offset + 16 * k, kind)
    path.write_bytes(content)
    return path


def pictures_in(path: Path) -> list[np.ndarray]:
    """All that another program finds."""
    with Image.open(path) as opened:
        found = []
        for number in range(getattr(opened, "n_frames", 1)):
            opened.seek(number)
            found.append(np.asarray(opened.convert("RGB")).astype(int))
    return found


def test_an_mpo_is_left_and_right(tmp_path: Path) -> None:
    path = mpo(tmp_path / "in.mpo")
    master = read_master([path])
    assert (master.packing, master.path) == ("mpo", path)
    for frame, picture in zip(master.frames, pictures_in(path), strict=True):
        np.testing.assert_allclose(np.rint(frame.pixels * 255), picture, atol=1)
    with pytest.raises(InputError, match="MPO of two views"):
        read_frame(path)
    for files in (("files", path, path), ("side-by-side", path)):
        packing, *paths = files
        with pytest.raises(InputError):
            read_master(paths, packing=packing)


@pytest.mark.parametrize("name", ["out.mpo", "out.jpg"])
def test_an_mpo_comes_back_as_one(tmp_path: Path, name: str) -> None:
    exif = Image.Exif()
    exif[0x010E], exif[0x0112] = "a dome", 1
    master = read_master([mpo(tmp_path / "in.mpo", exif=exif)])
    write_master(master, [tmp_path / name])
    for found, view in zip(pictures_in(tmp_path / name), views(), strict=True):
        np.testing.assert_allclose(found, view, atol=3)
    again = read_master([tmp_path / name])
    for new, old in zip(again.frames, master.frames, strict=True):
        np.testing.assert_allclose(new.pixels, old.pixels, atol=3 / 255)
    with Image.open(tmp_path / name) as opened:
        assert opened.getexif()[0x010E] == "a dome"
        kinds = [entry["Attribute"]["MPType"] for entry in opened.mpinfo[0xB002]]
    assert kinds == ["Multi-Frame Image: (Disparity)"] * 2
    with pytest.raises(InputError, match=r"wanted \.mpo or \.jpg"):
        write_master(master, [tmp_path / "out.png"])
    flat = read_master([cross_png(tmp_path / "flat.png", 0)])
    with pytest.raises(InputError, match=r"got one picture\. Choose \.jpg"):
        write_master(flat, [tmp_path / "flat.mpo"])


@pytest.mark.skipif(shutil.which("exiftool") is None, reason="no exiftool")
def test_exiftool_finds_both_in_an_mpo_of_ours(tmp_path: Path) -> None:
    write_master(read_master([mpo(tmp_path / "in.mpo")]), [tmp_path / "out.mpo"])
    command = ["exiftool", "-b", "-MPImage2", tmp_path / "out.mpo"]
    second = subprocess.run(command, check=True, capture_output=True).stdout
    (tmp_path / "second.jpg").write_bytes(second)
    np.testing.assert_allclose(pictures_in(tmp_path / "second.jpg")[0], views()[1], atol=3)


def test_mpos_of_more_views_or_less_than_they_say_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="MPO of 3 views"):
        read_master([mpo(tmp_path / "in.mpo", (0x020002,) * 3)])
    path = mpo(tmp_path / "cut.mpo")
    content = path.read_bytes()
    second = content.index(b"\xff\xd8\xff", 3)
    for length in (second, len(content) - 30):
        path.write_bytes(content[:length])
        with pytest.raises(InputError, match=r"cut\.mpo: wanted"):
            read_master([path])


def test_a_jpeg_with_another_picture_beside_is_an_ordinary_one(tmp_path: Path) -> None:
    """Large thumbnails, and the gain maps of phones."""
    left, right = (Image.fromarray(view) for view in views())
    left.save(tmp_path / "in.jpg", format="MPO", save_all=True, append_images=[right])
    assert read_frame(tmp_path / "in.jpg").pixels.shape == (ROWS, COLS, 3)


# Videos.

MODES = {
    "left_right": ("side-by-side", False),
    "right_left": ("side-by-side", True),
    "top_bottom": ("top-bottom", False),
    "bottom_top": ("top-bottom", True),
}


def stereo_video(path: Path, mode: str) -> Path:
    packing, swapped = MODES[mode]
    left, right = views()
    picture = packed(right, left, packing) if swapped else packed(left, right, packing)
    planes = [picture[..., k].astype(np.uint16) << 4 for k in (1, 2, 0)]
    write_video(path, KINDS["FFV1"], [planes] * 2, metadata={"stereo_mode": mode})
    return path


@pytest.mark.parametrize("mode", MODES)
def test_matroska_says_it_by_its_stereo_mode(tmp_path: Path, mode: str) -> None:
    path = stereo_video(tmp_path / "in.mkv", mode)
    frame = frame_paths(path)[0]
    master = read_master([frame], packing=MODES[mode][0])
    for found, view in zip(master.frames, views(), strict=True):
        np.testing.assert_array_equal(np.rint(found.pixels * 4095), view.astype(int) << 4)
    with pytest.raises(InputError, match="stereo mode"):
        read_master([frame], packing=next(p for p, _ in MODES.values() if p != MODES[mode][0]))


@pytest.mark.parametrize(
    "mode", ["anaglyph_cyan_red", "block_lr", "checkerboard_lr", "row_interleaved_rl"]
)
def test_other_stereo_modes_are_refused(tmp_path: Path, mode: str) -> None:
    left, _ = views()
    planes = [left[..., k].astype(np.uint16) << 4 for k in (1, 2, 0)]
    path = write_video(
        tmp_path / "in.mkv", KINDS["FFV1"], [planes] * 2, metadata={"stereo_mode": mode}
    )
    with pytest.raises(InputError, match=r"wanted views side by side"):
        read_frame(frame_paths(path)[0])


def test_a_mono_video_is_mono(tmp_path: Path) -> None:
    left, _ = views()
    planes = [left[..., k].astype(np.uint16) << 4 for k in (1, 2, 0)]
    path = write_video(
        tmp_path / "in.mkv", KINDS["FFV1"], [planes] * 2, metadata={"stereo_mode": "mono"}
    )
    assert len(read_master([frame_paths(path)[0]]).frames) == 1


@pytest.mark.parametrize(
    ("mode", "packing", "swapped"), [(1, "top-bottom", False), (2, "side-by-side", False)]
)
def test_mp4_says_it_by_st3d(tmp_path: Path, mode: int, packing: str, swapped: bool) -> None:
    left, right = views()
    grey = packed(left, right, packing)[..., 0]
    planes = [
        grey,
        np.full([n // 2 for n in grey.shape], 128),
        np.full([n // 2 for n in grey.shape], 128),
    ]
    told = box(b"st3d", struct.pack(">IB", 0, mode))  # Google, *Spherical Video V2 RFC*
    path = with_box(write_video(tmp_path / "in.mp4", KINDS["H.264"], [planes] * 2), told)
    master = read_master([frame_paths(path)[0]], packing=packing)
    first, second = (frame.pixels.mean() for frame in master.frames)
    assert (first < second) != swapped


def test_a_film_keeps_its_stereo_mode(tmp_path: Path, out: Path, run: Run) -> None:
    import av  # noqa: PLC0415

    path = stereo_video(tmp_path / "in.mkv", "right_left")
    stereo = ("--scene", "stereo_cinema_silver", "--method", "none", "--out", out)
    how = ("--packing", "side-by-side", "--workers", 0, "--format", "mkv", "--as-given")
    result = run("compensate", path, *stereo, *how)
    assert result.code == 0, result
    with av.open(str(out / "in.mkv")) as film:
        assert film.streams.video[0].metadata["stereo_mode"] == "right_left"
    (frame,) = frame_paths(out / "in.mkv")[:1]
    left, _ = read_master([frame], packing="side-by-side").frames
    np.testing.assert_allclose(left.pixels * 255, views()[0], atol=2)


def test_one_picture_that_says_so_stays_as_it_is(tmp_path: Path) -> None:
    """Without a packing it is one: a domemaster may say anything."""
    path = cross_png(tmp_path / "in.png", 0)
    master = read_master([path])
    assert master.packing == "single"
    assert "it says that it is side-by-side, right first (sTER)" in master.described()
    write_master(master, [tmp_path / "out.png"])
    assert chunk(b"sTER", b"\0") in (tmp_path / "out.png").read_bytes()


def test_halves_are_not_taken_for_pairs(tmp_path: Path) -> None:
    """A view that becomes a file of its own says nothing of two."""
    from dataclasses import replace  # noqa: PLC0415

    pair = read_master([cross_png(tmp_path / "in.png", 0)], packing="side-by-side")
    master = replace(pair, packing="files")
    write_master(master, [tmp_path / "l.png", tmp_path / "r.png"])
    assert b"sTER" not in (tmp_path / "l.png").read_bytes()
    assert len(read_master([tmp_path / "l.png", tmp_path / "r.png"]).frames) == 2
