"""Scenes: what is bundled loads and cites its figures; every mistake is named with its path."""

from __future__ import annotations

import re
import tomllib
from importlib import resources

import pytest

from domesim.errors import InputError
from domesim.observation.spherical import closed_form_gain
from domesim.scene import load_scene, scene_names

GOOD = """
name = "mine"
[dome]
radius_m = 8.0
[screen]
albedo = [0.4, 0.5, 0.6]
perforation = 0.2
[projector]
white_cd_m2 = 10.0
black_cd_m2 = 0.01
[projector.lens]
position_m = [0.0, 1.0, 0.0]
corrected = false
[ambient]
luminance_cd_m2 = 0.02
[viewing]
adaptation_cd_m2 = 1.0
"""


def flat(table, path=""):
    for key, value in table.items():
        if isinstance(value, dict):
            yield from flat(value, f"{path}{key}.")
        else:
            yield f"{path}{key}"


def sections(figure):
    parts = figure.split(".")
    return {".".join(parts[: k + 1]) for k in range(len(parts))}


@pytest.mark.parametrize("name", scene_names())
def test_bundled_scenes_load_and_cite_every_figure(name):
    scene = load_scene(name)
    assert scene.name == name
    assert scene.observation(8, 8).shape == (scene.views, 8, 8, 3)
    many = re.fullmatch(r"autostereo_(\d+)", name)
    expected = 2 if "stereo" in name else 1
    assert scene.views == (int(many[1]) if many else expected)
    table = tomllib.loads(resources.files("scenes").joinpath(f"{name}.toml").read_text())
    sources = table.pop("sources")
    figures = {path for path in flat(table) if "." in path}
    ideal = {"dome.half_angle_deg", "dome.tilt_deg", "projector.primaries", "projector.black_cd_m2"}
    # A source may stand for several figures, for a section, or for all.
    cited = {part.strip() for key in sources for part in key.split(",")}
    uncited = {figure for figure in figures if cited.isdisjoint({"all", *sections(figure)})}
    assert uncited <= (ideal if name == "dome_hemisphere" else set())


def test_a_scene_becomes_its_objects(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    scene = load_scene(path)
    assert scene.albedo == pytest.approx((0.32, 0.4, 0.48))
    observation = scene.observation(16, 16)
    expected = closed_form_gain(0.4, 8.0, scene.dome.screen_area)
    assert observation.factors.core[1, 0, 0] == pytest.approx(expected)
    assert observation.factors.direct_gain.max() > 1.1
    assert observation.factors.ambient[0, 8, 8] == pytest.approx(0.003)
    assert scene.viewing.extent == pytest.approx(180)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("dome_imx", "did you mean 'dome_imax'"),
        ("", "scene '' is not known; use one of"),
        ("a\nb", r"scene 'a.nb' is not known"),
        ("nowhere", "use one of autostereo_7, autostereo_8, cinema_2d, dome_dark"),
        ("nowhere.toml", "No such file"),
        ("some/folder", "No such file"),
        (".", "Is a directory|not known"),
    ],
)
def test_an_unknown_scene_is_refused(name, message):
    with pytest.raises(InputError, match=message):
        load_scene(name)


@pytest.mark.parametrize(("share", "asked"), [(0.005, False), (0.1, False), (0.3, True)])
def test_a_share_that_looks_like_percent_is_asked_about(share, asked):
    told = {"share": share, "to_left": None, "to_right": None}
    scene = load_scene("stereo_spectral", crosstalk=told)
    assert ("typed in percent" in scene.facts()["Crosstalk"]) == asked
