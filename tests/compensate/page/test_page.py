"""The compare page: what is written, and what a reader finds in the browser."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from viewer import Viewer, assert_shown, srgb

from compensate.page.page import Figure, View, _reduce, write_page
from domesim.errors import InputError
from domesim.room.dome import Dome
from domesim.room.theatre import Floor, Theatre, Viewpoint

ROWS, COLS, WHITE = 60, 84, 48.0  # not square: rows and columns cannot be mistaken
LUMA = np.array([0.2126, 0.7152, 0.0722])
THEATRE = Theatre(
    Dome(8.0, np.pi / 2, tilt=np.radians(20)),
    (0.5,) * 3,
    floor=Floor(-4.0, 8.0, (0.1,) * 3),
    viewpoints={
        "centre": Viewpoint((0.5, -1.0, -2.0), (0.0, 6.0, 3.0), np.radians(90)),
        "back": Viewpoint((2.0, -5.0, -1.0), (0.0, 6.0, 3.0), np.radians(70)),
    },
)


def disc(rows: int = ROWS, cols: int = COLS) -> np.ndarray:
    y, x = np.mgrid[:rows, :cols]
    radius = min(rows, cols) / 2
    return np.hypot(y + 0.5 - rows / 2, x + 0.5 - cols / 2) <= radius


def make_views(rows: int = ROWS, cols: int = COLS) -> list[View]:
    """A master over five decades of light, and two ways of seeing it."""
    rng = np.random.default_rng(7)
    master = (10 ** rng.uniform(-4, 0, (rows, cols, 3))).astype(np.float32)
    return [
        View("Master", master, "what should be seen", "master"),
        View("Seen without", master + np.float32(0.05), "pollution on top"),
        View("Seen, perceptual", 0.9 * master + np.float32(0.01), "compensated"),
    ]


def make_stereo(rows: int = ROWS, cols: int = COLS) -> list[View]:
    """The same views for two eyes, of which the right one's has another peak."""
    left = make_views(rows, cols)
    rng = np.random.default_rng(11)
    right = (1.5 * 10 ** rng.uniform(-4, 0, (rows, cols, 3))).astype(np.float32)
    pairs = [right, right + np.float32(0.05), np.float32(0.9) * right + np.float32(0.01)]
    return [replace(view, right=light) for view, light in zip(left, pairs, strict=True)]


def write(path: Path, views: list[View] | None = None, **settings: Any) -> str:
    options = {"title": "A title", "subtitle": "A subtitle", "white": WHITE} | settings
    write_page(path, make_views() if views is None else views, **options)
    return path.read_text(encoding="utf-8")


def page_data(html: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="page-data">(.*?)</script>', html, re.S)
    assert found
    data: dict[str, Any] = json.loads(found[1])
    return data


def light_of(window: Viewer, path: Path, rows: int = ROWS, cols: int = COLS) -> np.ndarray:
    """(picture, row, col, primary) light that the page has unpacked, 1 = white."""
    for viewer in window.used(path):
        found = np.array(viewer.page.evaluate("domesimViewer.light()"))
    return np.moveaxis(found.reshape(-1, 3, rows, cols), 1, -1) / WHITE


# ------------------------------------------------------------------------------ what is written


@pytest.mark.parametrize("lit", [1.0, 0.0])
def test_the_payload_is_the_light_to_a_thousandth_down_to_a_ten_thousandth_of_white(
    window: Viewer, tmp_path: Path, lit: float
) -> None:
    """Both eyes', with highlights of several times white; black stays black."""
    views, mask = make_stereo(), disc()
    views[0].light[2, 30] = 8
    views = [replace(v, light=lit * v.light, right=lit * right_of(v)) for v in views]
    write(tmp_path / "page.html", views, mask=mask)
    given = [light for view in views for light in (view.light, right_of(view))]
    for expected, light in zip(given, light_of(window, tmp_path / "page.html"), strict=True):
        np.testing.assert_allclose(light[mask], expected[mask], rtol=1e-3)
        assert not light[~mask].any()


def test_steps_of_any_size_are_kept(window: Viewer, tmp_path: Path) -> None:
    """Around the largest that fits into a byte: what is more takes four bytes more."""
    steps = np.array([0, 127, -127, 128, -128, 129, -129, 255, 30000, -29000])
    codes = np.tile(30000 + np.cumsum(steps), (2, 1))
    codes[0, 0] = 65535  # the peak
    light = np.stack([(codes / 65535) ** 3] * 3, axis=-1)
    write(tmp_path / "page.html", [View("A", light)])
    found = light_of(window, tmp_path / "page.html", 2, 10)
    np.testing.assert_allclose(found[0], light, rtol=1e-9)


def test_what_is_clipped_at_black_is_kept(window: Viewer, tmp_path: Path) -> None:
    """Its least light is stored aside, and nothing else of it."""
    master = make_views()[0]
    clipped = View("Clipped", np.maximum(master.light, np.float32([0.01, 0.02, 0.03])))
    write(tmp_path / "page.html", [master, clipped])
    found = light_of(window, tmp_path / "page.html")
    np.testing.assert_allclose(found[1], clipped.light, rtol=2e-3)


def test_reduction_conserves_the_mean_luminance() -> None:
    light = make_views()[0].light
    small, _ = _reduce(light, np.ones((ROWS, COLS), np.bool_), 37)
    assert max(small.shape) == 37
    np.testing.assert_allclose(
        (small @ LUMA).mean(dtype=float), (light @ LUMA).mean(dtype=float), rtol=1e-5
    )


def test_reduction_does_not_darken_the_rim_of_the_screen() -> None:
    mask = disc()
    light = np.where(mask[..., None], [0.5, 0.5, 0.5], np.nan)  # what is off the screen has no say
    small, small_mask = _reduce(light, mask, 31)
    np.testing.assert_allclose(small[small_mask], 0.5, rtol=1e-5)
    assert small_mask.mean() == pytest.approx(mask.mean(), rel=0.05)
    assert not small[~small_mask].any()


def test_text_is_escaped(tmp_path: Path) -> None:
    evil = "</script><img src=x onerror=alert(1)>\"'&"
    light = make_views(5, 7)[0].light
    html = write(
        tmp_path / "page.html",
        [View(evil, light, evil)],
        title=evil,
        subtitle=evil,
        figures=[Figure(evil, evil, {evil: evil}, evil)],
        facts={evil: evil},
    )
    assert "<img" not in html
    assert page_data(html)["views"][0]["name"] == evil


def test_the_page_asks_for_nothing_from_outside(tmp_path: Path) -> None:
    html = write(tmp_path / "page.html")
    assert "default-src 'none'" in html
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(", html)
    assert re.findall(r'(?:src|href)="([^"]*)"', html) == ["data:,"]


def test_a_failed_write_leaves_the_old_page_and_no_rubbish(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "page.html"
    before = write(path)

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(InputError, match=r"page.html: wanted to write it, got .*no space left"):
        write(path, title="Another")
    assert path.read_text(encoding="utf-8") == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["page.html"]


LIGHT = np.full((5, 7, 3), 0.5, np.float32)
BAD: dict[str, tuple[list[View], dict[str, Any], str]] = {
    "two sizes": ([View("A", LIGHT), View("B", LIGHT[1:])], {}, r"'B' .*\(5, 7, 3\).*\(4, 7, 3\)"),
    "NaN": ([View("A", np.where(LIGHT > 0, np.nan, LIGHT))], {}, "finite"),
    "negative light": ([View("A", -LIGHT)], {}, ">= 0, got -0.5"),
    "a flat map": ([View("A", LIGHT, lost=LIGHT[..., 0])], {}, r"a map \(1, row, col\).*\(5, 7\)"),
    "the mask's shape": ([View("A", LIGHT)], {"mask": disc(7, 5)}, r"bool \(5, 7\)"),
    "one eye short": (
        [View("A", LIGHT, right=LIGHT), View("B", LIGHT)],
        {},
        r"all have a right eye's picture or none, got \['B'\] without",
    ),
    "a figure's view": (
        [View("A", LIGHT)],
        {"figures": [Figure("F", "1", {"B": "2"})]},
        r"got \['B'\]",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    views, settings, message = BAD[case]
    with pytest.raises(InputError, match=message) as caught:
        write(tmp_path / "page.html", views, **settings)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


# ------------------------------------------------------------------------------ in the browser


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "page.html"
    write(
        path,
        mask=disc(),
        theatre=THEATRE,
        figures=[Figure("Mean", "cd/m²", {"Master": "4.2"}, "The mean over the screen.")],
        facts={"Solver": "converged"},
    )
    return path


@pytest.fixture
def viewer(window: Viewer, page_file: Path) -> Iterator[Viewer]:
    yield from window.used(page_file)


def test_split_shows_a_on_the_left_and_b_on_the_right(viewer: Viewer) -> None:
    _, without, perceptual = (view.light for view in make_views())
    assert viewer.state()["mode"] == "split"
    assert_shown(viewer, without, 20, 30)
    assert_shown(viewer, perceptual, 20, 54)


def test_the_split_is_dragged(viewer: Viewer) -> None:
    handle, frame = viewer.find("split"), viewer.find("picture").bounding_box()
    box = handle.bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + 100
    viewer.page.mouse.move(*middle)
    viewer.page.mouse.down()
    viewer.page.mouse.move(frame["x"] + 0.75 * frame["width"], middle[1], steps=4)
    viewer.page.mouse.up()
    assert viewer.state()["split"] == pytest.approx(0.75, abs=0.005)
    assert handle.get_attribute("aria-valuenow") == "75"
    assert_shown(viewer, make_views()[1].light, 20, 54)


def test_number_keys_show_a_view_whole_and_space_flips(viewer: Viewer) -> None:
    views = make_views()
    for key, view in (("1", 0), ("3", 2), (" ", 1), (" ", 2), (" ", 1)):
        viewer.page.keyboard.press(key)
        assert viewer.state()["mode"] == "flip"
        assert viewer.state()["shown"] == view
        assert_shown(viewer, views[view].light, 20, 30)
        assert_shown(viewer, views[view].light, 20, 54)


@pytest.mark.parametrize("area", [1, 21])
def test_the_probe_reads_every_view_in_candelas(viewer: Viewer, area: int) -> None:
    views, mask, half = make_views(), disc(), area // 2
    for row, col in ((30, 42), (5, 38), (50, 60)):
        found = viewer.page.evaluate(f"domesimViewer.probeAt({row}, {col}, {area})")
        window = np.s_[max(0, row - half) : row + half + 1, max(0, col - half) : col + half + 1]
        for view, value in zip(views, found["views"], strict=True):
            light = WHITE * view.light[window][mask[window]].astype(float).mean(axis=0)
            np.testing.assert_allclose([value["r"], value["g"], value["b"]], light, rtol=1e-3)
            assert value["y"] == pytest.approx(light @ LUMA, rel=1e-3)


def test_the_probe_knows_the_direction_in_the_dome(viewer: Viewer) -> None:
    probe = "([row, col]) => domesimViewer.probeAt(row, col).direction"
    front = viewer.page.evaluate(probe, [59, 41])
    right = viewer.page.evaluate(probe, [29, 71])
    assert front["zenith"] == pytest.approx(90 * np.hypot(29.5, 0.5) / 30)
    assert front["azimuth"] == pytest.approx(360 - np.degrees(np.arctan2(0.5, 29.5)))
    assert right["azimuth"] == pytest.approx(90, abs=1)
    assert viewer.page.evaluate("domesimViewer.probeAt(0, 0).onScreen") is False


def test_a_click_pins_the_probe_and_the_table_tells_its_values(viewer: Viewer) -> None:
    viewer.page.mouse.click(*viewer.point(20, 30))
    viewer.page.mouse.move(*viewer.point(40, 50))
    state = viewer.state()
    assert state["pinned"]
    assert state["probe"] == {"row": 20, "col": 30}
    assert viewer.find("where").inner_text().startswith("row 20, col 30")
    for number, view in enumerate(make_views(), 1):
        shown = viewer.find(f"probe-{number}").locator("td").all_inner_texts()
        light = WHITE * view.light[20, 30].astype(float)
        expected = [*light, light @ LUMA]
        np.testing.assert_allclose(
            [float(text) for text in shown[:4]], expected, rtol=2e-3, atol=6e-6
        )
    viewer.page.keyboard.press("ArrowRight")
    assert viewer.state()["probe"] == {"row": 20, "col": 31}
    viewer.page.keyboard.press("Escape")
    assert not viewer.state()["pinned"]


def test_exposure_changes_what_is_shown_as_predicted(viewer: Viewer) -> None:
    light = make_views()[0].light
    viewer.page.keyboard.press("1")
    assert viewer.find("badge").is_hidden()
    for stops in (-2, 3, 6):
        viewer.find("exposure").fill(str(stops))
        assert_shown(viewer, light, 33, 47)
        assert viewer.find("badge").is_visible()
    viewer.page.keyboard.press("[")
    assert viewer.state()["exposure"] == 5.5
    viewer.find("reset").click()
    assert_shown(viewer, light, 33, 47)
    assert viewer.find("badge").is_hidden()


def test_the_wheel_zooms_to_the_pointer_and_drag_pans(viewer: Viewer) -> None:
    before, at = viewer.state()["zoom"], viewer.point(20, 30)
    viewer.page.mouse.move(*at)
    viewer.page.mouse.wheel(0, -600)
    viewer.page.wait_for_function(f"domesimViewer.state().zoom > {1.5 * before}")
    np.testing.assert_allclose(viewer.point(20, 30), at, atol=1.5)
    viewer.page.mouse.down()
    viewer.page.mouse.move(at[0] + 60, at[1] - 40, steps=5)
    viewer.page.mouse.up()
    np.testing.assert_allclose(viewer.point(20, 30), (at[0] + 60, at[1] - 40), atol=1.5)
    assert not viewer.state()["pinned"]  # a drag is no click
    viewer.find("zoom-one").click()
    assert viewer.state()["zoom"] == 1
    viewer.find("zoom-fit").click()
    assert viewer.state()["zoom"] == before


def test_the_difference_is_coloured_by_its_sign(viewer: Viewer) -> None:
    master, _, perceptual = (view.light.astype(float) @ LUMA for view in make_views())
    difference = np.where(disc(), WHITE * (perceptual - master), 0)
    viewer.page.keyboard.press("d")
    brighter = np.unravel_index(difference.argmax(), difference.shape)
    darker = np.unravel_index(difference.argmin(), difference.shape)
    red, _, blue, _ = viewer.colour(*map(int, brighter))
    assert red > blue + 20
    red, _, blue, _ = viewer.colour(*map(int, darker))
    assert blue > red + 20
    assert "cd/m²" in viewer.find("legend").inner_text()
    viewer.find("scale").fill("0")
    assert not viewer.state()["scaleAuto"]


def test_without_script_the_page_says_what_it_needs(browser: Any, page_file: Path) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(page_file.as_uri())
    assert "This page needs JavaScript" in page.locator("noscript p").inner_text()
    assert page.get_by_text("The mean over the screen.").is_visible()
    context.close()


# ------------------------------------------------------------------------------ two eyes

DUBOIS = np.array(
    [
        [0.4561, 0.5005, 0.1764, -0.0435, -0.0879, -0.0016],
        [-0.0401, -0.0378, -0.0158, 0.3785, 0.7336, -0.0185],
        [-0.0152, -0.0206, -0.0055, -0.0722, -0.1130, 1.2264],
    ]
)
AMBER, BLUE = np.array([1, 0.5, 0.1]), np.array([0.1, 0.4, 1])
POINTS = ((20, 30), (33, 47), (50, 60))


def right_of(view: View) -> np.ndarray:
    assert view.right is not None
    return view.right.astype(float)


def ghost_of(light: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    off = light.astype(float) - wanted
    excess, lack = np.maximum(off, 0) @ LUMA, np.maximum(-off, 0) @ LUMA
    return excess[..., None] * AMBER + lack[..., None] * BLUE


@pytest.fixture(scope="module")
def stereo_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stereo") / "page.html"
    write(path, make_stereo())
    return path


@pytest.fixture
def stereo(window: Viewer, stereo_file: Path) -> Iterator[Viewer]:
    yield from window.used(stereo_file)


def test_each_eye_is_shown_alone(stereo: Viewer) -> None:
    seen = make_stereo()[1]
    stereo.page.keyboard.press("2")
    for point in POINTS:
        assert_shown(stereo, seen.light, *point)
    stereo.page.keyboard.press("e")
    for point in POINTS:
        assert_shown(stereo, right_of(seen), *point)


def test_the_anaglyph_is_dubois_in_linear_light(stereo: Viewer) -> None:
    seen = make_stereo()[1]
    both = np.concatenate([seen.light.astype(float), right_of(seen)], axis=-1)
    stereo.page.keyboard.press("2")
    stereo.page.keyboard.press("c")
    for point in POINTS:
        assert_shown(stereo, both @ DUBOIS.T, *point)


@pytest.mark.parametrize("eye", ["left", "right"])
def test_ghost_only_is_what_differs_from_the_master_amplified(stereo: Viewer, eye: str) -> None:
    master, _, seen = make_stereo()
    pair = (seen.light, master.light) if eye == "left" else (right_of(seen), right_of(master))
    stereo.page.keyboard.press("3")
    stereo.page.keyboard.press("o")
    stereo.page.locator("label", has=stereo.find(f"ghostOf-{eye}")).click()
    stereo.find("ghost-gain").fill("3")
    for point in POINTS:
        # atol in light: a difference of two codes that are right to 1e-3 each
        predicted = srgb(8 * ghost_of(*pair)[point])
        np.testing.assert_allclose(stereo.colour(*point)[:3], predicted, atol=2.5)
    stereo.page.keyboard.press("1")
    assert stereo.colour(20, 30) == [0, 0, 0, 255]  # the master has no ghost


BEATS = """
window.beats = [];
window.setInterval = (work, pause) => beats.push({ work, pause });
window.clearInterval = (beat) => delete beats[beat - 1];
"""


def test_the_wiggle_alternates_and_can_be_paused(browser: Any, stereo_file: Path) -> None:
    seen = make_stereo()[1]
    expected = [srgb(light[20, 30].astype(float)) for light in (seen.light, right_of(seen))]
    page = browser.new_page()
    page.add_init_script(BEATS)
    stereo = Viewer(page).open(stereo_file)
    page.keyboard.press("2")
    page.keyboard.press("w")
    assert page.evaluate("beats.flatMap(({ pause }) => pause)") == [250]  # ms: 4 a second
    shown = []
    for _ in range(4):
        colour = stereo.colour(20, 30)[:3]
        shown.append([np.allclose(colour, eye, atol=0.6) for eye in expected].index(True))
        page.evaluate("beats.forEach(({ work }) => work())")
    assert shown == [0, 1, 0, 1]
    stereo.find("wiggle-play").click()
    assert not stereo.state()["playing"]
    assert page.evaluate("beats.flatMap(({ pause }) => pause)") == []
    page.close()


def test_the_eyes_are_picked_by_keyboard(stereo: Viewer) -> None:
    eyes = ["right", "both", "difference", "anaglyph", "wiggle", "ghost", "left"]
    for key, eye in zip("epmcwoe", eyes, strict=True):
        stereo.page.keyboard.press(key)
        assert stereo.state()["eye"] == eye
        assert stereo.find(f"eye-{eye}").is_checked()


def test_the_probe_reads_both_eyes(stereo: Viewer) -> None:
    found = stereo.page.evaluate("domesimViewer.probeAt(20, 30)")
    for view, value in zip(make_stereo(), found["views"], strict=True):
        eyes = (view.light, value), (right_of(view), value["right"])
        for light, told in eyes:
            np.testing.assert_allclose(
                [told["r"], told["g"], told["b"]], WHITE * light[20, 30].astype(float), rtol=1e-3
            )


def test_the_split_moves_by_keyboard(viewer: Viewer) -> None:
    handle = viewer.find("split")
    assert handle.get_attribute("role") == "slider"
    for keys, share in (("ArrowLeft", 0.49), ("Shift+ArrowRight", 0.59), ("Home", 0), ("End", 1)):
        handle.press(keys)
        assert viewer.state()["split"] == pytest.approx(share)


def test_a_and_b_are_picked_and_swapped(viewer: Viewer) -> None:
    viewer.find("a-1").click()
    viewer.find("b-2").click()
    assert (viewer.state()["a"], viewer.state()["b"]) == (0, 1)
    viewer.page.keyboard.press("x")
    assert (viewer.state()["a"], viewer.state()["b"]) == (1, 0)


def test_display_gamma_changes_what_is_shown_as_predicted(viewer: Viewer) -> None:
    light = make_views()[0].light[33, 47].astype(float)
    viewer.page.keyboard.press("1")
    viewer.page.locator("label", has=viewer.find("gamma-2.4")).click()
    predicted = 255 * np.clip(light, 0, 1) ** (1 / 2.4)
    np.testing.assert_allclose(viewer.colour(33, 47)[:3], predicted, atol=0.6)
    assert "gamma 2.4" in viewer.find("badge").inner_text()


def test_the_dark_room_brings_shadows_to_mid_grey_unless_that_clips_the_picture(
    viewer: Viewer,
) -> None:
    lit = np.sort((make_views()[0].light.astype(float) @ LUMA)[disc()])
    stops = np.log2(0.18 / lit[int(0.475 * lit.size)]), np.log2(1 / lit[int(0.98 * lit.size)])
    assert abs(stops[0] - stops[1]) > 0.2
    viewer.find("dark-room").click()
    assert viewer.state()["exposure"] == pytest.approx(max(0, min(stops)), abs=0.06)
    assert viewer.page.evaluate("document.documentElement.classList.contains('dark-room')")
    viewer.find("dark-room").click()
    assert viewer.state()["exposure"] == 0


def test_the_grid_shows_all_views_at_the_same_place(viewer: Viewer) -> None:
    viewer.page.keyboard.press("g")
    viewer.state()
    box = viewer.find("picture").bounding_box()
    for cell, view in enumerate(make_views()):
        at = viewer.page.evaluate(f"domesimViewer.toWindow(20, 30, {cell})")
        shown = viewer.page.evaluate(
            "([x, y]) => [...document.getElementById('picture').getContext('2d')"
            ".getImageData(x, y, 1, 1).data]",
            [int(at["x"] - box["x"]), int(at["y"] - box["y"])],
        )
        np.testing.assert_allclose(shown[:3], srgb(view.light[20, 30].astype(float)), atol=0.6)
