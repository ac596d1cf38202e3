"""``domesim domemaster``: panoramas in files, sequences and films; what they say, and cannot be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from command_line import Run
from image_files import store
from test_as_players_show import EQUIRECTANGULAR, sv3d, with_box
from test_as_they_come import gpano
from videos import KINDS, write_video

from domesim.frames import read_frame, read_master
from domesim.frames.video import frame_paths

ROWS = 48
FROM = ("--from", "equirectangular")


def halves(front: float, back: float) -> np.ndarray:
    """(row, col, 3) codes: the front half of all directions, and the back half."""
    codes = np.full((ROWS, 2 * ROWS, 3), back, np.float32)
    codes[:, ROWS // 2 : -ROWS // 2] = front
    return codes


def sides(path: Path) -> tuple[float, float]:
    """Codes at the front, which is at the bottom, and at the back."""
    pixels = read_frame(path).pixels
    size = len(pixels)
    return float(pixels[-size // 8, size // 2, 1]), float(pixels[size // 8, size // 2, 1])


@pytest.mark.parametrize(("suffix", "made"), [("png", "png"), ("jpg", "png"), ("exr", "exr")])
def test_a_picture_is_one_in_its_own_encoding(
    tmp_path: Path, out: Path, run: Run, suffix: str, made: str
) -> None:
    codes = halves(0.8, 0.2)
    if suffix != "exr":
        codes = np.rint(codes * 255).astype(np.uint8)
    path = store(tmp_path / f"x.{suffix}", codes)
    done = run("domemaster", path, *FROM, "--out", out, "--json")
    assert done.code == 0, done.err
    (figures,) = done.figures()["frames"]
    assert figures["size"] == ROWS
    assert 0 < figures["loss_percent"] < 20
    result = read_frame(out / f"x.{made}")
    assert result.colour.means_the_same_as(read_frame(path).colour)
    assert result.bits == (32 if suffix == "exr" else 16)
    assert sides(out / f"x.{made}") == pytest.approx((0.8, 0.2), abs=0.01)
    assert not result.pixels[0, 0].any()


def test_the_dome_leans_and_has_a_field(tmp_path: Path, out: Path, run: Run) -> None:
    codes = np.zeros((ROWS, 2 * ROWS, 3), np.uint8)
    codes[: ROWS // 2] = 200  # the sky
    path = store(tmp_path / "x.png", codes)
    options = ("--tilt", 30, "--field", 160, "--size", 80)
    assert run("domemaster", path, *FROM, *options, "--out", out).code == 0
    column = read_frame(out / "x.png").pixels[:, 40, 0]
    horizon = (1 + 60 / 80) * 40  # 60 degrees from the zenith, to the front
    assert np.argmax(np.diff(column[:-1]) < -0.2) == pytest.approx(horizon - 1, abs=1.5)
    assert column[2] > 0.7  # 50 degrees above the back's horizon


def test_a_cube_needs_its_faces_order(tmp_path: Path, out: Path, run: Run) -> None:
    codes = np.zeros((16, 96, 3), np.uint8)
    for k in range(6):
        codes[:, 16 * k : 16 * (k + 1)] = 40 * (k + 1)
    path = store(tmp_path / "x.png", codes)
    run("domemaster", path, "--from", "cube-strip", "--out", out).is_refused("--faces rludfb")
    run("domemaster", path, *FROM, "--faces", "rludfb", "--out", out).is_refused("--faces is for")
    run("domemaster", path, "--from", "cube", "--out", out).is_refused("use equirectangular or")
    chosen = ("--from", "cube-strip", "--faces", "rludfb", "--out", out)
    assert run("domemaster", path, *chosen).code == 0
    front, back = sides(out / "x.png")
    assert (front * 255, back * 255) == pytest.approx((200, 240), abs=1)


def test_a_film_that_says_so_is_taken_where_it_is_asked_for(
    tmp_path: Path, out: Path, run: Run
) -> None:
    luma = np.rint(16 + 219 * halves(0.8, 0.2)[..., 0])
    grey = np.full((ROWS // 2, ROWS), 128.0)
    path = write_video(tmp_path / "x.mp4", KINDS["H.264"], [[luma, grey, grey]] * 3)
    said = with_box(path, sv3d(EQUIRECTANGULAR))
    way = "domesim domemaster --from equirectangular"
    scene = ("--scene", "dome_hemisphere")
    assert way in run("observe", frame_paths(said)[0], *scene, "--out", out).err
    assert run("domemaster", said, *FROM, "--frames", "2-3", "--out", out).code == 0
    names = sorted(each.name for each in out.glob("*.png"))
    assert names == ["x.0002.png", "x.0003.png"]
    assert sides(out / names[0]) == pytest.approx((0.8, 0.2), abs=0.03)
    assert read_master([out / names[0]]).colour.transfer == "bt1886"


def test_what_says_that_it_is_another_is_refused(tmp_path: Path, out: Path, run: Run) -> None:
    store(tmp_path / "x.png", np.rint(halves(0.8, 0.2) * 255).astype(np.uint8))
    content = (tmp_path / "x.png").read_bytes()
    for name in ("equirectangular", "cylindrical"):
        (tmp_path / f"{name}.png").write_bytes(content + gpano(name, element=True))
    assert run("domemaster", tmp_path / "equirectangular.png", *FROM, "--out", out).code == 0
    refused = run("domemaster", tmp_path / "cylindrical.png", *FROM, "--out", out)
    refused.is_refused("one that says it is cylindrical")


@pytest.mark.parametrize("option", [("--field", "0"), ("--tilt", "200"), ("--size", "1")])
def test_options_that_cannot_be(tmp_path: Path, out: Path, run: Run, option: tuple[str]) -> None:
    path = store(tmp_path / "x.png", np.zeros((8, 16, 3), np.uint8))
    assert run("domemaster", path, *FROM, *option, "--out", out).code == 2
    assert not list(out.glob("*")) if out.exists() else True


@pytest.mark.parametrize(("cols", "kind"), [(64, "equirectangular"), (192, "cube-strip"), (48, "")])
def test_the_way_is_told_by_a_pictures_shape(
    tmp_path: Path, out: Path, run: Run, cols: int, kind: str
) -> None:
    path = store(tmp_path / "x.png", np.full((32, cols, 3), 90, np.uint8))
    refused = run("observe", path, "--scene", "dome_hemisphere", "--out", out)
    refused.is_refused("a domemaster is square", *([f"domemaster --from {kind})"] if kind else []))
    assert kind or "panorama" not in refused.err


def test_an_exr_that_is_an_environment_map(tmp_path: Path, out: Path, run: Run) -> None:
    """Of OpenEXR's attribute envmap, which the domemaster made of it does not say."""
    for kind in (OpenEXR.ENVMAP_LATLONG, OpenEXR.ENVMAP_CUBE):
        path = tmp_path / f"{kind.name}.exr"
        with OpenEXR.File({"envmap": kind}, {"RGB": halves(0.8, 0.2).astype(np.float16)}) as file:
            file.write(str(path))
    cube, panorama = path, tmp_path / "ENVMAP_LATLONG.exr"
    scene = ("--scene", "dome_hemisphere")
    way = "domesim domemaster --from equirectangular"
    assert way in run("observe", panorama, *scene, "--out", out).err
    run("domemaster", cube, *FROM, "--out", out).is_refused("one that says it is a cube")
    assert run("domemaster", panorama, *FROM, "--out", out).code == 0
    assert sides(out / panorama.name) == pytest.approx((0.8, 0.2), abs=0.03)
    assert run("observe", out / panorama.name, *scene, "--out", out / "seen").code == 0
