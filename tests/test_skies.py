"""A hybrid dome says which light is which magnitude, and every command tells stars by that."""

from __future__ import annotations

import re
import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from command_line import Run
from stored_masters import store

from compensate.page.comparison import Comparison, compare_methods, faintest_of, projected_of
from domesim.frames import read_master
from domesim.inspection.magnitudes import faintest_star, projected_star
from domesim.scene import DomeScene, load_scene
from testing.content import charts

BRIGHTER = 2.0
"""Magnitudes by which the show's stars are brighter than the sky's."""


@pytest.fixture
def hybrid(tmp_path: Path) -> Path:
    plain = resources.files("scenes").joinpath("dome_planetarium.toml").read_text("utf-8")
    content = tomllib.loads(plain)
    natural = -2.5 * np.log10(7 * np.radians(1 / 60) ** 2 / 2.54e-6)
    content["sky"] = {"zero_point": natural - BRIGHTER, "star_projector": {"image_arcmin": 2.0}}
    content["ambient"] = {"luminance_cd_m2": 0.0002}
    path = tmp_path / "hybrid.toml"
    path.write_text(tomlkit.dumps(content))
    return path


@pytest.fixture
def master(tmp_path: Path) -> Path:
    light = np.asarray(charts.CHARTS["ten stars"](128)[0])
    return store(tmp_path / "stars.exr", light, "float")


def compared(scene: object, master: Path) -> Comparison:
    return compare_methods(read_master([master]), scene, solver=None, weighting=None)


def test_compare_counts_from_the_show_s_zero_and_has_the_star_projector(
    hybrid: Path, master: Path
) -> None:
    scene = load_scene(hybrid)
    assert isinstance(scene, DomeScene)
    plain = load_scene({**tomllib.loads(hybrid.read_text()), "sky": {}})
    with_sky, without = (compared(each, master) for each in (scene, plain))
    for method, outcome in with_sky.outcomes.items():
        found, other = (faintest_of(c.outcomes[method].figures) for c in (with_sky, without))
        assert found is not None
        assert other is not None
        assert found == pytest.approx([each - BRIGHTER for each in other], abs=1e-5)
        projected, sky = projected_of(outcome.figures), outcome.figures.sky
        assert sky is not None
        assert projected == pytest.approx(projected_star(scene, 10 ** ((12.58 - sky) / 2.5)))
    rows = {row.name: row for row in with_sky._table()}
    values = rows["Star projector's faintest star"].values
    assert list(values) == list(rows["Faintest star"].values)
    assert values["Master"] > values["Seen, untouched"]
    assert "Star projector's faintest star" not in {row.name for row in without._table()}


def test_commands_tell_the_star_projector(run: Run, hybrid: Path, master: Path) -> None:
    out = hybrid.parent / "out"
    common = (master, "--scene", hybrid, "--out", out)
    said = re.search(
        r"faintest star falls from .* mag, the star projector's from (.*) to (.*) \(Sch",
        run("predict", *common).out,
    )
    assert said is not None
    figures = run("predict", *common, "--json").figures()["frames"][0]
    scene = load_scene(hybrid)
    assert isinstance(scene, DomeScene)
    for key in ("master", "untouched"):
        wanted = projected_star(scene, figures["dark"][key])
        assert wanted is not None
        assert figures[f"projected_star_{key}"] == pytest.approx(wanted._asdict())
    told = run("compensate", *common, "--workers", "0").out
    assert re.search(
        r"star projector: faintest star \d\.\d \(Crumey 2014, F = 2\), \d\.\d \(Sch", told
    )


def test_scene_show_tells_what_the_video_takes(run: Run, hybrid: Path) -> None:
    page = hybrid.with_suffix(".html")
    found = run("scene", "show", hybrid, "--out", page, "--json").figures()
    disc = float(np.pi / 4 * np.radians(2 / 60) ** 2)
    off = faintest_star(0.0002, disc).crumey
    assert found["star_projector"] == pytest.approx(off)
    black = faintest_star(found["black_frame_cd_m2"], disc).crumey
    assert found["star_projector_black"] == pytest.approx(black)
    assert off > black > found["star_projector_night"] + 0.5
    text = page.read_text()
    assert f"the video takes {off - black:.1f}" in text
    point = faintest_star(found["black_frame_cd_m2"], 0.0).crumey
    assert found["black_sky_faintest_star"] == pytest.approx(point - BRIGHTER)


def test_mistakes_are_named(run: Run, hybrid: Path) -> None:
    hybrid.write_text(hybrid.read_text().replace("image_arcmin = 2.0", "image_arcmin = 0.0"))
    run("scene", "check", hybrid).is_refused("sky.star_projector.image_arcmin")
