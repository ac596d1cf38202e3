"""Left and right in one picture: each packing is what it is called, and comes back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import Run

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_master, write_frame, write_master
from domesim.frames.views import TOGETHER, Master, packed
from domesim.shows.show import find_show

SRGB = ColourTag("srgb", "BT.709", "test")
LINEAR = ColourTag("linear", "BT.709", "test")
ROWS, COLS = 12, 20


def views(rows: int = ROWS, cols: int = COLS) -> np.ndarray:
    return np.random.default_rng(1).random((2, rows, cols, 3)).astype(np.float32)


def pair(
    folder: Path, light: np.ndarray, colour: ColourTag = LINEAR, suffix: str = ".exr"
) -> Master:
    paths = [folder / f"{eye}{suffix}" for eye in ("left", "right")]
    for path, view in zip(paths, light, strict=True):
        write_frame(
            Frame(view, path, colour, 32 if suffix == ".exr" else 16, suffix == ".exr"), path
        )
    return read_master(paths)


def picture(folder: Path, master: Master, packing: str) -> np.ndarray:
    """As it lies in the file."""
    path = folder / f"one{master.path.suffix}"
    write_master(packed(master, packing), [path])
    return oiio.ImageInput.open(str(path)).read_image("float")


def test_whole_views_lie_beside_each_other(tmp_path):
    master = pair(tmp_path, views())
    left, right = master.pixels
    assert picture(tmp_path, master, "side-by-side") == pytest.approx(np.hstack([left, right]))
    assert picture(tmp_path, master, "top-bottom") == pytest.approx(np.vstack([left, right]))


def test_half_views_are_means_of_light(tmp_path):
    codes = pair(tmp_path, views(), SRGB, ".png")
    linear = np.where(
        codes.pixels <= 0.04045, codes.pixels / 12.92, ((codes.pixels + 0.055) / 1.055) ** 2.4
    )
    found = picture(tmp_path, codes, "side-by-side-half")
    found = np.where(found <= 0.04045, found / 12.92, ((found + 0.055) / 1.055) ** 2.4)
    assert found.shape == (ROWS, COLS, 3)
    assert found[:, : COLS // 2] == pytest.approx(
        (linear[0, :, ::2] + linear[0, :, 1::2]) / 2, abs=1e-4
    )
    assert found[:, COLS // 2 :] == pytest.approx(
        (linear[1, :, ::2] + linear[1, :, 1::2]) / 2, abs=1e-4
    )
    master = pair(tmp_path, views())
    found = picture(tmp_path, master, "top-bottom-half")
    assert found[: ROWS // 2] == pytest.approx(
        (master.pixels[0, ::2] + master.pixels[0, 1::2]) / 2, abs=1e-6
    )


@pytest.mark.parametrize(("rows", "cols", "gap"), [(1080, 1920, 45), (720, 1280, 30)])
def test_frame_packed_pictures_are_hdmi_s(tmp_path, rows, cols, gap):
    light = np.broadcast_to(np.linspace(0, 1, cols, dtype=np.float32)[:, None], (rows, cols, 3))
    master = pair(tmp_path, np.stack([light, 0.5 * light]))
    found = picture(tmp_path, master, "frame-packed")
    assert found.shape[:2] == (2 * rows + gap, cols)
    assert (found[rows : rows + gap] == 0).all()
    assert found[rows - 1] == pytest.approx(light[0])
    assert found[rows + gap] == pytest.approx(0.5 * light[0])
    again = read_master([tmp_path / "one.exr"], packing="frame-packed")
    assert (again.pixels == master.pixels).all()


def test_rows_take_turns(tmp_path):
    master = pair(tmp_path, views())
    found = picture(tmp_path, master, "row-interleaved")
    assert found[0::2] == pytest.approx(master.pixels[0, 0::2])
    assert found[1::2] == pytest.approx(master.pixels[1, 1::2])


def test_an_anaglyph_keeps_white_and_tells_the_eyes_apart(tmp_path):
    light = np.zeros((2, ROWS, COLS, 3), np.float32)
    light[:, :4] = 1.0
    light[0, 4:8], light[1, 8:] = 0.8, 0.8
    found = picture(tmp_path, pair(tmp_path, light), "anaglyph")
    assert found[:4] == pytest.approx(1.0, abs=0.03)
    left, right = found[5, 0], found[9, 0]
    assert left[0] > 0.6
    assert max(left[1:]) < 0.05
    assert min(right[1:]) > 0.6
    assert right[0] < 0.05


@pytest.mark.parametrize(
    "packing", [each for each in TOGETHER if each not in ("anaglyph", "frame-packed")]
)
def test_what_was_packed_is_read_and_written_the_same(tmp_path, packing):
    first = picture(tmp_path, pair(tmp_path, views(), SRGB, ".png"), packing)
    master = read_master([tmp_path / "one.png"], packing=packing)
    assert master.frames[0].pixels.shape == (ROWS, COLS, 3)
    assert np.abs(picture(tmp_path, master, packing) - first).max() <= 1.01 / 65535


def test_packings_that_do_not_fit_are_refused(tmp_path):
    master = pair(tmp_path, views(7, 9))
    for packing, wanted in (("frame-packed", "1920 x 1080"), ("side-by-side-half", "even width")):
        with pytest.raises(InputError, match=wanted):
            picture(tmp_path, master, packing)
    write_frame(master.frames[0], tmp_path / "odd.exr")
    for packing, wanted in (("frame-packed", "1920 x 2205"), ("row-interleaved", "an even height")):
        with pytest.raises(InputError, match=wanted):
            read_master([tmp_path / "odd.exr"], packing=packing)
    with pytest.raises(InputError, match="takes packing"):
        read_master([tmp_path / "odd.exr"], packing="anaglyph")


def arguments(folder: Path) -> tuple[object, ...]:
    return ("compensate", f"{folder}/%V.exr", "--scene", "stereo_polarised_paper", "--out")


def test_the_command_writes_one_picture(run: Run, tmp_path: Path) -> None:
    light = 0.1 + 0.5 * views()
    pair(tmp_path, light)
    found = run(*arguments(tmp_path), tmp_path / "two", "--json").figures()
    assert len(found["frames"][0]["output"]) == 2
    out, packing = tmp_path / "one", "side-by-side-half"
    run(*arguments(tmp_path), out, "--output-packing", packing, "--json").figures()
    assert [path.name for path in out.glob("*.exr")] == ["left.exr"]
    two = read_master([tmp_path / "two" / "left.exr", tmp_path / "two" / "right.exr"])
    expected = picture(tmp_path, two, packing)
    assert oiio.ImageInput.open(str(out / "left.exr")).read_image("float") == pytest.approx(
        expected, abs=1e-3
    )


def test_nuke_s_places_name_both_views(tmp_path: Path) -> None:
    for name in ("left", "right", "l", "r"):
        (tmp_path / name).mkdir()
        for number in (1, 2):
            (tmp_path / name / f"a.{number:04}.exr").write_bytes(b"")
    for place, names in (("%V", ("left", "right")), ("%v", ("l", "r"))):
        moments = find_show(f"{tmp_path}/{place}/a.%04d.exr").moments
        assert [path.parent.name for path in moments[1]] == list(names)
        assert [path.name for path in moments[1]] == ["a.0002.exr"] * 2
    with pytest.raises(InputError, match="names both views"):
        find_show(f"{tmp_path}/%V/a.%04d.exr", left="x.exr")


def test_what_cannot_be_packed_is_refused(run: Run, tmp_path: Path) -> None:
    pair(tmp_path, views())
    run(*arguments(tmp_path), tmp_path / "out", "--output-packing", "x").is_refused("not known")
    dome = ("compensate", tmp_path / "left.exr", "--scene", "dome_imax", "--out", tmp_path / "out")
    run(*dome, "--output-packing", "anaglyph").is_refused(
        "wanted left and right for", "leave it out"
    )
