"""The theatre cut open: every kind of it is drawn, the right half is gone, colours are in place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rooms import BARE, GREY, THEATRES

from domesim.errors import InputError
from domesim.frames import read_frame
from domesim.pathtrace import cutaway as module
from domesim.pathtrace.cutaway import cutaway, graticule, to_png
from domesim.room.dome import Dome
from domesim.room.theatre import Lamp, Theatre

RED, GREEN, BLUE = np.eye(3)
SMALL = {"width": 64, "height": 48, "samples": 4}


def master(size: int = 32) -> NDArray[np.float32]:
    """Green on the left (blue in its front half), red on the right."""
    picture = np.zeros((size, size, 3), np.float32)
    picture[:, : size // 2] = GREEN
    picture[size // 2 :, : size // 2] = BLUE
    picture[:, size // 2 :] = RED
    return picture


def is_like(picture: NDArray[np.float32], colour: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(row, col): whether a pixel is mostly of a primary."""
    own = picture[..., colour > 0].min(axis=-1)
    return np.asarray((own > 0.4) & (own > 2 * picture[..., colour == 0].max(axis=-1)))


def assert_alike(one: NDArray[np.float32], other: NDArray[np.float32]) -> None:
    """Means over blocks of 8 x 8 pixels differ by noise only: 0.06 at 4 paths, of 0..1."""
    apart = (one - other).reshape(6, 8, 8, 8, 3).mean(axis=(1, 3))
    assert np.abs(apart).max() < 0.06


@pytest.mark.parametrize("name", THEATRES)
def test_every_kind_of_theatre_is_drawn(name: str):
    picture = cutaway(THEATRES[name], **SMALL)
    assert picture.shape == (48, 64, 3)
    assert picture.dtype == np.float32
    assert np.all(np.isfinite(picture))
    assert picture.min() >= 0
    assert picture.max() <= 1
    assert np.mean(picture[:2]) > 0.5  # a light background
    assert picture.mean(axis=-1).std() > 0.05
    other = cutaway(THEATRES[name], np.zeros((8, 8, 3)), **SMALL)
    assert np.mean(np.abs(other - picture).max(axis=-1) > 0.15) > 0.1  # one sees the inside


def test_the_right_half_is_gone_and_the_front_is_on_the_right():
    picture = cutaway(BARE, master(), **SMALL)
    assert not is_like(picture, RED).any()
    rear, front = is_like(picture, GREEN), is_like(picture, BLUE)
    assert rear.mean() > 0.1
    assert front.mean() > 0.1
    assert np.nonzero(rear)[1].max() <= np.nonzero(front)[1].min() + 1


def test_a_lamp_shines_in_its_colour():
    exit_sign = Lamp("exit", (-9.0, 0.0, 2.0), (0.0, 1.5, 0.0), (0.0, 0.0, 1.5), (0.0, 1.0, 0.0))
    turned = replace(exit_sign, across=(0.0, -1.5, 0.0))
    settings = {"width": 64, "height": 48, "samples": 36}
    seen, from_behind = (
        is_like(cutaway(replace(BARE, lamps=(lamp,)), np.zeros((8, 8, 3)), **settings), GREEN).sum()
        for lamp in (exit_sign, turned)
    )
    assert seen > 30
    assert from_behind < 5


def test_strips_make_the_same_picture(monkeypatch: pytest.MonkeyPatch):
    settings = {"width": 64, "height": 48, "samples": 16}
    whole = cutaway(BARE, **settings)
    monkeypatch.setattr(module, "_AT_ONCE", 64 * 16 * 7)
    strips = cutaway(BARE, **settings)
    assert_alike(strips, whole)
    assert not np.array_equal(strips, whole)


@pytest.mark.parametrize("name", THEATRES)
def test_the_inside_is_the_screens_left_half(name: str):
    dome = THEATRES[name].dome
    inside = next(module._model(THEATRES[name], None))
    p, q, r = np.moveaxis(inside.triangles, 1, 0)
    area = np.linalg.norm(np.cross(q - p, r - p), axis=-1).sum() / 2
    assert area == pytest.approx(dome.screen_area / 2, rel=2e-3)
    assert inside.triangles[..., 0].max() < 1e-9 * dome.radius
    if dome.truncated_below is not None:
        assert inside.triangles[..., 2].min() == pytest.approx(dome.truncated_below)


def test_the_picture_is_mapped_as_the_dome_says():
    dome = Dome(7.0, np.radians(100), np.radians(20), height_ratio=0.8)
    inside = next(module._model(Theatre(dome, GREY), None))
    local = inside.triangles.reshape(-1, 3) @ dome.to_room
    directions = local / np.linalg.norm(local, axis=-1, keepdims=True)
    row, col = dome.pixel_of(directions, 1000)
    assert inside.uv is not None
    u, v = inside.uv.reshape(-1, 2).T
    assert np.abs(1000 * u - col - 0.5).max() < 1
    assert np.abs(1000 * v - row - 0.5).max() < 1


def test_the_graticule_marks_the_front():
    drawn = graticule(Dome(5.0, np.pi / 2), 256)
    assert drawn.shape == (256, 256, 3)
    reddish = drawn[..., 0] > 2 * drawn[..., 2]
    rows, cols = np.nonzero(reddish)
    assert rows.min() > 120
    assert abs(cols.mean() - 127.5) < 1
    ring = drawn[128, 128:, 1]  # from the zenith to the right: parallels at 15, 30, ... 75 degrees
    dark = ring < 0.3
    assert np.all([dark[round(128 * step / 6) - 2 : round(128 * step / 6) + 2].any()
                   for step in range(1, 6)])  # fmt: skip


def test_a_png_is_srgb(tmp_path: Path):
    picture = np.full((3, 4, 3), 0.2158605, np.float32)  # sRGB 128 / 255
    picture[0, 0] = (0.0, 1.0, 1.2)
    to_png(picture, tmp_path / "cut.png")
    frame = read_frame(tmp_path / "cut.png")
    assert (frame.colour.transfer, frame.bits) == ("srgb", 8)
    np.testing.assert_allclose(frame.pixels[1:], 128 / 255, atol=1e-6)
    np.testing.assert_array_equal(frame.pixels[0, 0], [0, 1, 1])
    with pytest.raises(InputError, match=r"wanted a name that ends in \.png, got '\.jpg'"):
        to_png(picture, tmp_path / "cut.jpg")
