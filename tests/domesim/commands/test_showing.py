"""The page of ``domesim scene show``: to scale, right, self-contained, and fit for a phone."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from command_line import exit_code
from rooms import THEATRES

from domesim.commands.scene_show import marked
from domesim.inspection.plans import WIDTH, dome_plan, dome_section, flat_plan, flat_section
from domesim.scene import load_dome, load_scene, load_stereo
from domesim.scene.drafts import DomeWish, dome_draft
from domesim.scene.loading import scene_of_text
from domesim.scene.measured_dome import whole_transport

SCENES = {
    "mine.toml": dome_draft(DomeWish(6.0, 15.0, projectors=3, seats=(1, 2)), "mine"),
    "stereo_cinema_silver": "",
}


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The pages of all, made once."""
    folder, found = tmp_path_factory.mktemp("pages"), {}
    for name, text in SCENES.items():
        if text:
            (folder / name).write_text(text)
        found[name] = folder / f"{name}.html"
        scene = folder / name if text else name
        options = ("--out", found[name], "--no-cutaway", "--quiet")
        assert exit_code("scene", "show", scene, *options) == 0
        assert found[name].stat().st_size < 1_000_000
    return found


def shown(page: Path) -> dict[str, float]:
    """Figures of a page, by their names."""
    found = re.findall(r'data-figure="([^"]+)" data-value="([^"]+)"', page.read_text())
    return {key: float(value) for key, value in found}


def test_a_dome_has_the_figures_of_the_check(pages, run):
    page = pages["mine.toml"]
    checked = run("scene", "check", page.with_suffix(""), "--json").figures()
    figures = shown(page)
    common = figures.keys() & checked.keys()
    assert {"checkerboard_contrast", "black_frame_cd_m2", "lumens", "seats"} <= common
    assert len(common) >= 10
    for key in common:
        assert figures[key] == pytest.approx(checked[key], rel=1e-6), key


def test_the_night_scene_has_the_figures_of_observe(pages, run, tmp_path):
    page = pages["mine.toml"]
    master = Path(str(resources.files("scenes").joinpath("masters", "night.exr")))
    options = ("--scene", page.with_suffix(""), "--out", tmp_path, "--json")
    (frame,) = run("observe", master, *options).figures()["frames"]
    figures = shown(page)
    for key in ("direct_cd_m2", "pollution_cd_m2"):
        assert figures[f"picture_{key}"] == pytest.approx(frame[key], rel=1e-5)


def test_a_3d_screen_has_the_crosstalk_of_its_seats(pages):
    scene = load_stereo("stereo_cinema_silver")
    figures = shown(pages["stereo_cinema_silver"])
    for name, seat in scene.seats.items():
        assert figures[f"crosstalk {name}"] == pytest.approx(seat.mean(), rel=0.01)
    assert figures["coverage BT.709"] == pytest.approx(100, abs=0.2)
    assert "Gamut, CIE 1976" in pages["stereo_cinema_silver"].read_text()


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1280, "light")])
@pytest.mark.parametrize("name", SCENES)
def test_a_browser_shows_it_without_network(pages, browser, name, scheme, width):
    context = browser.new_context(viewport={"width": width, "height": 844}, color_scheme=scheme)
    page, said, asked = context.new_page(), [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    address = pages[name].as_uri()
    page.goto(address)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate("[...document.images].every(image => image.naturalWidth > 0)")
    # No letter of a drawing is cut off
    cut = page.evaluate(
        """[...document.querySelectorAll('svg text')].filter(text => {
            const a = text.getBoundingClientRect();
            const b = text.ownerSVGElement.getBoundingClientRect();
            return a.left < b.left || a.right > b.right || a.top < b.top || a.bottom > b.bottom;
        }).map(text => text.textContent)"""
    )
    assert cut == []
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (paper == "rgb(255, 255, 255)") == (scheme == "light")
    assert said == []
    assert [url for url in asked if url != address and not url.startswith("data:")] == []
    context.close()


def _extents(svg: str, style: str) -> np.ndarray:
    """(across, down) size in pixels of all elements of a class."""
    found = re.findall(rf'class="{style}" points="([^"]+)"', svg)
    points = np.array([[float(v) for v in p.split(",")] for text in found for p in text.split()])
    return np.ptp(points, axis=0)


def test_plan_and_section_are_to_scale():
    scene = load_dome("dome_imax")
    places = marked(scene.theatre)
    plan, section = dome_plan(scene, places), dome_section(scene, places)
    diameter, radius = 2 * scene.dome.widest, scene.dome.radius
    scale = _extents(plan, "screen")[0] / diameter
    booth = _extents(plan, "thing")
    assert booth / scale == pytest.approx([5.0, 2.2], rel=0.02)
    assert scale == pytest.approx(WIDTH / (1.16 * diameter), rel=1e-3)
    floor = _extents(section, "cut")
    across = _extents(section, "screen")
    # From the highest place to the rim in front; the back rim is 25 degrees higher
    scale = floor[0] / (2 * scene.theatre.floor.radius)
    assert across[1] / scale == pytest.approx(radius * (1 + np.sin(scene.dome.tilt)), rel=0.01)
    assert across[0] / scale == pytest.approx(radius * (1 + np.cos(scene.dome.tilt)), rel=0.01)
    assert f"{diameter:.4g} m" in plan


@pytest.mark.parametrize("name", ["nearly a sphere", "ellipsoid", "tilted and truncated"])
def test_any_shape_can_be_drawn(name):
    booth = THEATRES["furnished"]
    theatre = replace(THEATRES[name], solids=booth.solids, lenses=booth.lenses)
    scene = replace(load_dome("dome_hemisphere"), name="odd <one>", theatre=theatre)
    places = marked(theatre)
    for svg in (dome_plan(scene, places), dome_section(scene, places)):
        assert "nan" not in svg
        assert "inf" not in svg
        assert "odd &lt;one&gt;" in svg


def test_the_front_is_up_in_the_plan_and_right_in_the_section():
    text = dome_draft(DomeWish(6.0, 20.0, projectors=1, layout="ring"), "mine")
    scene = scene_of_text(text, "mine.toml", Path())
    for svg, axis, back_is_more in ((dome_plan(scene, {}), "cy", True),
                                    (dome_section(scene, {}), "cx", False)):  # fmt: skip
        (place,) = re.findall(rf'class="lens"[^>]*\b{axis}="([\d.]+)"', svg)
        seats = re.findall(r'class="floor"[^>]*\bcy="([\d.]+)"', svg) or [str(WIDTH / 2)]
        assert (float(place) > float(seats[0])) == back_is_more


def test_a_3d_screen_to_scale():
    scene = load_stereo("stereo_cinema_silver")
    plan = flat_plan(scene)
    size = _extents(plan, "screen")
    beam = _extents(plan, "beam")
    assert beam[0] / size[1] == pytest.approx(30 / 10, rel=0.02)
    assert "20 m" in plan


def test_a_flat_cinema_s_room_to_scale():
    scene = load_scene("cinema_2d")
    for drawing, wanted in ((flat_plan(scene), 24 / 12), (flat_section(scene), 24 / 5.02)):
        room, screen = _extents(drawing, "wall"), _extents(drawing, "screen")
        assert room[0] / screen[1] == pytest.approx(wanted, rel=0.01)
    assert "wall" not in flat_plan(load_scene("stereo_cinema_silver"))


def test_corners_of_the_seats_are_shown():
    theatre = load_dome("dome_planetarium").theatre
    views = marked(theatre)
    assert len(views) == 9
    assert next(iter(views)) == "row1-seat1"
    x = [view.position[0] for view in views.values()]
    assert min(x) == min(view.position[0] for view in theatre.seats.values())
    assert list(marked(load_dome("dome_hemisphere").theatre)) == ["centre of the dome"]


@pytest.mark.long
def test_a_stored_transport_is_used_and_named(pages, run, tmp_path):
    """One that reflects half as much again as the bare screen."""
    scene = load_dome(pages["mine.toml"].with_suffix(""))
    bare = whole_transport(scene.theatre)
    replace(bare, core=1.5 * bare.core).save(tmp_path / "room.npz")
    options = ("--transport", tmp_path / "room.npz", "--no-cutaway", "--json")
    name = pages["mine.toml"].with_suffix("")
    figures = run("scene", "show", name, "--out", tmp_path / "a.html", *options).figures()
    assert figures["reflected_share"] == pytest.approx(1.5 * figures["closed_form_share"], rel=5e-3)
    assert "a stored transport of the whole theatre" in (tmp_path / "a.html").read_text()
    assert (
        "Reflected light is by the closed form of the bare screen."
        in pages["mine.toml"].read_text()
    )


def test_what_is_no_page_is_refused(run, tmp_path):
    run("scene", "show", "dome_imax", "--out", tmp_path / "a.pdf").is_refused("name it so")
    (tmp_path / "holes.toml").write_text(
        SCENES["mine.toml"].replace("aspect = 1.6", "aspect = 4.0")
    )
    run("scene", "show", tmp_path / "holes.toml", "--out", tmp_path / "a.html").is_refused(
        "of the screen dark"
    )
