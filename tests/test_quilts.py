"""Quilts: read and written as they lie, compensated, and told of by each command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from command_line import Run

from domesim.errors import InputError
from domesim.frames import ColourTag, Frame, read_master, write_frame, write_master
from domesim.frames.quilts import layout_in
from domesim.scene import load_scene

ROWS, COLS, LEFT_OVER = 12, 17, (1, 3)
"""Of a view, and what the picture has more."""
NAME = "show_qs4x2a1.78"
LINEAR = ColourTag("linear", "BT.709", "test")
SCENE = "autostereo_8"


def views() -> np.ndarray:
    """(8, row, col, 3) light: some of all, and black where a neighbour is bright."""
    light = 0.3 + 0.2 * np.random.default_rng(1).random((8, ROWS, COLS, 3))
    for view in range(8):
        light[view, 2:6, view : view + 4] = 0.9
        light[view, 8:, 8 - view : 12 - view] = 0.0
    return light.astype(np.float32)


def quilted(light: np.ndarray) -> np.ndarray:
    """By the convention, written anew: the first view at the bottom left; left over is 0.7."""
    above, beside = LEFT_OVER
    picture = np.full((2 * ROWS + above, 4 * COLS + beside, 3), 0.7, np.float32)
    for number, view in enumerate(light):
        row, col = 1 - number // 4, number % 4
        picture[above + row * ROWS :, col * COLS :][:ROWS, :COLS] = view
    return picture


@pytest.fixture
def quilt(tmp_path: Path) -> Path:
    path = tmp_path / f"{NAME}.exr"
    write_frame(Frame(quilted(views()), path, LINEAR, 32, floating=True), path)
    return path


def light_in(path: Path) -> np.ndarray:
    """(8, row, col, 3) of a linear quilt, by OpenImageIO alone."""
    picture = oiio.ImageInput.open(str(path)).read_image("float")[LEFT_OVER[0] :, : 4 * COLS, :3]
    rows = picture.reshape(2, ROWS, 4, COLS, 3)[::-1]
    return rows.swapaxes(1, 2).reshape(8, ROWS, COLS, 3)


def test_views_are_those_of_the_name(quilt: Path) -> None:
    master = read_master([quilt])
    assert (master.packing, len(master.frames)) == ("quilt", 8)
    assert (master.pixels == views()).all()
    assert "8 x 17 x 12 EXR" in master.described()
    assert "a quilt of 4 x 2 views" in master.described()


def test_a_quilt_is_written_as_it_was_read(quilt: Path, tmp_path: Path) -> None:
    out = tmp_path / f"other_qs4x2a1.78{quilt.suffix}"
    master = read_master([quilt])
    write_master(master.with_pixels(0.5 * master.pixels), [out])
    assert light_in(out) == pytest.approx(0.5 * views())
    whole = oiio.ImageInput.open(str(out)).read_image("float")
    assert whole.shape[:2] == (2 * ROWS + 1, 4 * COLS + 3)
    assert (whole[0] == whole[1]).all()  # what is left over repeats its neighbours
    assert (whole[:, -3:] == whole[:, -4:-3]).all()


def test_alpha_goes_with_its_view(tmp_path: Path) -> None:
    path, out = tmp_path / "a_qs2x2a1.0.png", tmp_path / "b_qs2x2a1.0.png"
    codes = np.random.default_rng(2).integers(0, 256, (6, 8, 4), np.uint8)
    spec = oiio.ImageSpec(8, 6, 4, "uint8")
    writer = oiio.ImageOutput.create(str(path))
    writer.open(str(path), spec)
    writer.write_image(codes)
    writer.close()
    master = read_master([path])
    alpha = [frame.header.extra[0] for frame in master.frames]
    assert (alpha[0] == codes[3:, :4, 3]).all()
    assert (alpha[3] == codes[:3, 4:, 3]).all()
    write_master(master, [out])
    assert (oiio.ImageInput.open(str(out)).read_image("uint8")[..., 3] == codes[..., 3]).all()


@pytest.mark.parametrize(
    ("name", "layout"),
    [
        ("show_qs8x6a0.75.png", (8, 6)),
        ("show_qs5x9a1.778.0001.exr", (5, 9)),
        ("show_qs11x6a0.5625.mp4", (11, 6)),
        ("show_qs8x6.png", None),
        ("qs8x6a0.75.png", None),
        ("show.png", None),
    ],
)
def test_names_say_the_layout(name: str, layout: tuple[int, int] | None) -> None:
    assert layout_in(Path("folder_qs2x2a1") / name) == layout


def test_names_that_do_not_fit_are_refused(quilt: Path, tmp_path: Path) -> None:
    plain, small = tmp_path / "plain.exr", tmp_path / "small_qs99x1a1.exr"
    for path in (plain, small):
        path.write_bytes(quilt.read_bytes())
    with pytest.raises(InputError, match=r"plain.*name says how many .* Rename it"):
        read_master([plain], packing="quilt")
    with pytest.raises(InputError, match="99 x 1 views, as its name says, got 71 x 25 px"):
        read_master([small])


def test_subtraction_of_a_quilt_is_exact(run: Run, quilt: Path, out: Path) -> None:
    arguments = ("--scene", SCENE, "--method", "subtractive", "--out", out)
    assert run("compensate", quilt, *arguments).code == 0
    shown = light_in(out / quilt.name).astype(float)
    needed = views() - 0.1667 * (np.roll(shown, 1, 0) + np.roll(shown, -1, 0))  # black stays
    assert (shown == 0).any()
    assert shown == pytest.approx(np.clip(needed, 0, 1), abs=2e-6)


def test_each_command_knows_many_views(run: Run, quilt: Path, tmp_path: Path) -> None:
    scene = ("--scene", SCENE, "--out")
    assert run("observe", quilt, *scene, tmp_path / "seen").code == 0
    seen = light_in(tmp_path / "seen" / quilt.name)
    expected = load_scene(SCENE).observation(ROWS, COLS).observe(views())
    assert seen == pytest.approx(expected, abs=1e-5)
    assert run("predict", quilt, *scene, tmp_path / "maps").code == 0
    channels = oiio.ImageInput.open(str(tmp_path / "maps" / f"{NAME}.maps.exr")).spec().channelnames
    assert {name.split(".")[0] for name in channels} == {f"view{k:02}" for k in range(1, 9)}
    page = tmp_path / "page.html"
    assert run("compare", quilt, *scene, page).code == 0
    assert "views 4 and 5 of 8" in page.read_text()
    card = run("report-card", SCENE, quilt, "--json").figures()
    assert card["crosstalk"]["view 8"]["system"] == pytest.approx(2 * 0.1667)
    methods = card["quilt"]["methods"]
    assert methods["perceptual"]["one_eye"] < methods["none"]["one_eye"]
    run("shader", *scene, tmp_path / "x", "--size", "68x24").is_refused("not of many views")


def test_views_that_the_scene_has_not_are_refused(run: Run, quilt: Path, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "out")
    seven = run("compensate", quilt, "--scene", "autostereo_7", *out)
    seven.is_refused("quilts of 7 views", "got a quilt of 4 x 2 views", "_qs8x6a0.75")
    run("compensate", quilt, "--scene", "stereo_room", *out).is_refused("wanted left and right")
    plain = tmp_path / "plain.exr"
    plain.write_bytes(quilt.read_bytes())
    run("compensate", plain, "--scene", SCENE, *out).is_refused("quilts of 8", "got one picture")
    paper = run("compensate", quilt, "--scene", SCENE, *out, "--method", "paper")
    paper.is_refused("not known for autostereo_8")
