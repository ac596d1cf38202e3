"""Panoramas as domemasters: against functions on the sphere, and against FFmpeg."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

from domesim.errors import InputError
from domesim.room.dome import Dome
from domesim.room.panorama import FACES, CubeStrip, Equirectangular, domemaster_of

HEMISPHERE = np.pi / 2


def light_of(directions: np.ndarray) -> np.ndarray:
    """(..., 3) light along unit vectors of the room: as different as can be in x, y and z."""
    x, y, z = np.moveaxis(directions, -1, 0)
    planes = [0.5 + 0.3 * x * z + 0.1 * np.sin(3 * y), 0.5 + 0.4 * y, 0.5 + 0.4 * z - 0.1 * x]
    return np.stack(planes, -1)


def equirectangular(rows: int) -> np.ndarray:
    latitude = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)[:, None]
    longitude = np.pi * ((np.arange(2 * rows) + 0.5) / rows - 1)[None]
    x, y = np.cos(latitude) * np.sin(longitude), np.cos(latitude) * np.cos(longitude)
    return light_of(np.stack([x, y, np.sin(latitude) * np.ones_like(longitude)], -1))


def cube_strip(side: int, faces: str) -> np.ndarray:
    """Of what each letter says, by hand: x right, y front, z up."""
    away = 2 * (np.arange(side) + 0.5) / side - 1
    u, v = away[None, :] * np.ones((side, 1)), away[:, None] * np.ones((1, side))
    one = np.ones((side, side))
    seen = {
        "f": (u, one, -v),
        "b": (-u, -one, -v),
        "r": (one, -u, -v),
        "l": (-one, u, -v),
        "u": (u, v, one),
        "d": (u, -v, -one),
    }
    places = np.concatenate([np.stack(seen[letter], -1) for letter in faces], 1)
    return light_of(places / np.linalg.norm(places, axis=-1, keepdims=True))


def wanted(dome: Dome, size: int) -> np.ndarray:
    inside = dome.inside(size, size)[..., None]
    return np.asarray(light_of(dome.directions(size, size) @ dome.to_room.T) * inside)


@pytest.mark.parametrize("tilt", [0.0, 20.0, -35.0])
@pytest.mark.parametrize("half", [HEMISPHERE, 1.2, 2.0])
def test_an_equirectangular_one_is_what_the_dome_sees(tilt: float, half: float) -> None:
    dome = Dome(1.0, half, np.radians(tilt))
    errors = []
    for rows in (64, 128):
        made = domemaster_of(Equirectangular(equirectangular(rows)), dome)
        assert len(made.light) == 2 * round(2 * rows / (2 * np.pi) * half)
        errors.append(np.abs(made.light - wanted(dome, len(made.light))).max())
        assert made.loss < 1e-3
    assert errors[1] < 1e-3
    assert errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("faces", [FACES, "lrfbud"])
def test_a_cube_strip_is_what_the_dome_sees(faces: str) -> None:
    dome = Dome(1.0, HEMISPHERE, np.radians(25.0))
    made = domemaster_of(CubeStrip(cube_strip(80, faces), faces), dome, 200)
    np.testing.assert_allclose(made.light, wanted(dome, 200), atol=3e-3)
    assert made.loss < 1e-3


def test_front_and_right_lie_where_a_domemaster_has_them() -> None:
    light = np.zeros((64, 128, 1))
    light[30:34, 62:66] = 1  # straight ahead
    light[30:34, 94:98] = 2  # a quarter to the right
    made = domemaster_of(Equirectangular(light), Dome(1.0, HEMISPHERE * 1.2)).light[..., 0]
    size = len(made)
    half = size // 2
    assert made[half:, half - 4 : half + 4].max() > 0.9
    assert made[half - 4 : half + 4, half:].max() > 1.8
    assert made[:half].max() < 2.1
    assert made[: half - 6].max() == 0


def test_stripes_that_meet_at_the_zenith_are_grey_there() -> None:
    """Picked from single pixels, its middle would be black or white."""
    light = np.zeros((256, 512, 1))
    light[:, ::2] = 1
    made = domemaster_of(Equirectangular(light), Dome(1.0, HEMISPHERE)).light
    middle = made[120:136, 120:136]
    np.testing.assert_allclose(middle, 0.5, atol=0.03)


@pytest.mark.parametrize("size", [64, 128, 256])
def test_stars_keep_their_light(size: int) -> None:
    """Where they fall between pixels, too, and in a smaller picture."""
    light = np.zeros((128, 256, 1))
    rows, cols = np.random.default_rng(5).integers([[4], [0]], [[52], [256]], (2, 60))
    light[rows, cols] = 50
    latitude = np.pi * (0.5 - (np.arange(128) + 0.5) / 128)
    given = float((light.sum((1, 2)) * np.cos(latitude)).sum() * (np.pi / 128) ** 2)
    made = domemaster_of(Equirectangular(light), Dome(1.0, HEMISPHERE), size)
    areas = Dome(1.0, HEMISPHERE).pixel_areas(size, size)
    assert float((made.light[..., 0] * areas).sum()) == pytest.approx(given, rel=0.02)
    assert made.light.min() >= 0


def test_what_a_smaller_picture_loses_is_told() -> None:
    light = np.random.default_rng(6).random((128, 256, 1)) + 0.5
    panorama = Equirectangular(light)
    losses = [domemaster_of(panorama, Dome(1.0, HEMISPHERE), size).loss for size in (32, 128, 512)]
    assert losses[0] > losses[1] > 2 * losses[2] > 0
    assert 0.12 < losses[0] < 0.2  # its texture, between pixels: 0.29 * 2 / 3, and less at the pole
    black = domemaster_of(Equirectangular(np.zeros((16, 32, 3))), Dome(1.0, HEMISPHERE))
    assert black.loss == 0


def test_other_shapes_are_refused() -> None:
    with pytest.raises(InputError, match="twice as wide as high, got 60 x 32 px"):
        Equirectangular(np.zeros((32, 60, 3)))
    with pytest.raises(InputError, match="six times as wide as high, got 32 x 8 px"):
        CubeStrip(np.zeros((8, 32, 3)), FACES)
    with pytest.raises(InputError, match="got 'rludff'"):
        CubeStrip(np.zeros((8, 48, 3)), "rludff")
    with pytest.raises(InputError, match="at least 2 x 2"):
        domemaster_of(Equirectangular(np.zeros((8, 16, 3))), Dome(1.0, 1.0), 1)


def by_ffmpeg(light: np.ndarray, way: str, rows: int, cols: int) -> np.ndarray:
    if shutil.which("ffmpeg") is None:
        pytest.skip("ffmpeg is not installed")
    codes = np.rint(light * 65535).astype(">u2")
    size = f"{codes.shape[1]}x{codes.shape[0]}"
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb48be"]
    chain = f"format=gbrp16le,v360={way}:interp=line:w={cols}:h={rows},format=rgb48be"
    command = ["ffmpeg", "-v", "error", *raw, "-s", size, "-i", "-", "-vf", chain, *raw, "-"]
    done = subprocess.run(command, input=codes.tobytes(), capture_output=True, check=True)
    return np.frombuffer(done.stdout, ">u2").reshape(rows, cols, 3) / 65535


@pytest.mark.parametrize("tilt", [0, 20, -30])
def test_ffmpegs_fisheye_is_the_same(tilt: int) -> None:
    """To v360's own precision of places."""
    light = np.clip(equirectangular(256), 0, 1)
    found = domemaster_of(Equirectangular(light), Dome(1.0, HEMISPHERE, np.radians(tilt)), 256)
    theirs = by_ffmpeg(light, f"e:fisheye:h_fov=180:v_fov=180:pitch={90 - tilt}", 256, 256)
    inside = Dome(1.0, HEMISPHERE).inside(250, 250)
    off = np.abs(found.light - theirs)[3:-3, 3:-3][inside]
    assert off.max() < 5e-3
    assert off.mean() < 1e-3


def test_ffmpegs_cube_is_read() -> None:
    light = np.clip(equirectangular(256), 0, 1)
    strip = by_ffmpeg(light, "e:c6x1", 128, 768)
    dome = Dome(1.0, HEMISPHERE, 0.3)
    made = domemaster_of(CubeStrip(strip, FACES), dome, 200)
    np.testing.assert_allclose(made.light, wanted(dome, 200), atol=5e-3)
