"""Screens of uneven paint: in closed form, and as paths find them."""

from __future__ import annotations

import numpy as np
import pytest

from compensate import compensate
from domesim import load_scene, observe, render, tabulate
from domesim.errors import InputError
from domesim.room.masks import written_mask
from domesim.scene.loading import scene_content

SIZE = 48


@pytest.fixture
def painted(tmp_path):
    """A dome of 200 degrees; its right half is half as white, and its lower rows are dirty."""
    factors = np.ones((64, 64))
    factors[:, 32:] = 0.5
    factors[48:] *= 0.8
    (tmp_path / "paint.png").write_bytes(written_mask(factors))
    content = scene_content("dome_hemisphere")
    content["dome"]["half_angle_deg"] = 100.0
    content["screen"] = {"albedo": [0.6, 0.5, 0.7], "albedo_map": str(tmp_path / "paint.png")}
    content["projector"]["black_cd_m2"] = 0.0
    return content


def window():
    light = np.full((1, SIZE, SIZE, 3), 0.01)
    light[:, 10:18, 28:38] = 0.9
    return light


def test_every_place_receives_the_same(painted):
    """rho / rho_white (x + s), s = sum(rho a x) / (4 pi r² - sum(rho a)), on any sphere."""
    scene, light = load_scene(painted), window()
    on = scene.screen(SIZE, SIZE)
    areas = scene.pixel_areas(SIZE, SIZE)
    areas = areas / areas.sum() * scene.dome.screen_area
    place = np.arange(SIZE)
    factors = np.where(place < SIZE / 2, 1.0, 0.5) * np.where(place < 0.75 * SIZE, 1, 0.8)[:, None]
    for p, white in enumerate(scene.albedo):
        rho, x = white * factors, light[0, ..., p]
        s = np.sum(rho * areas * x) / (4 * np.pi * scene.dome.radius**2 - np.sum(rho * areas))
        seen = observe(light, scene)[0, ..., p]
        np.testing.assert_allclose(seen[on], (factors * (x + s))[on], rtol=1e-4)
        np.testing.assert_allclose(seen[~on], x[~on])
    assert scene.approximation is None
    assert compensate(light, scene).status.name == "AIMED"


def test_paths_find_the_same(painted):
    scene, light = load_scene(painted), window()
    on = scene.screen(SIZE, SIZE)
    direct = scene.observation(SIZE, SIZE).direct(light)[0]
    added = observe(light, scene)[0] - direct
    found = render(light, scene, error=0.02)[0] - direct
    left, right = on.copy(), on.copy()
    left[:, SIZE // 2 :], right[:, : SIZE // 2] = False, False
    for half in (left, right):
        np.testing.assert_allclose(added[half].mean(0), found[half].mean(0), rtol=0.01)
    assert added[left].mean() > 1.8 * added[right].mean()


def test_what_is_no_paint_is_refused(painted, tmp_path):
    path = painted["screen"]["albedo_map"]
    even = load_scene(painted, screen={"albedo_map": None})
    assert load_scene(painted).digest != even.digest
    with pytest.raises(InputError, match="albedo_map"):
        tabulate(painted)
    for factors in (np.zeros((8, 8)), np.ones((8, 9))):
        (tmp_path / "wrong.png").write_bytes(written_mask(factors))
        with pytest.raises(InputError, match=r"screen.albedo_map .*square domemaster above black"):
            load_scene(painted, screen={"albedo_map": str(tmp_path / "wrong.png")})
    with pytest.raises(InputError, match=r"none\.png"):
        load_scene(painted, screen={"albedo_map": "none.png"})
    (tmp_path / "mine.toml").write_text(
        'name = "mine"\n[dome]\nradius_m = 5\n[screen]\nalbedo = 0.5\nalbedo_map = "paint.png"\n'
        "[projector]\nwhite_cd_m2 = 10\n[viewing]\nadaptation_cd_m2 = 1\n"
    )
    assert scene_content(tmp_path / "mine.toml")["screen"]["albedo_map"] == path


def test_the_paint_of_an_ellipsoid_is_left_out_and_told(painted):
    flat = {"height_ratio": 0.8, "half_angle_deg": 90.0}
    scene = load_scene(painted, dome=flat)
    assert "a screen painted unevenly" in scene.facts()["Left out"]
    even = load_scene(painted, dome=flat, screen={"albedo_map": None})
    np.testing.assert_array_equal(observe(window(), scene), observe(window(), even))
