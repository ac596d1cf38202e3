"""The compare page: what is written, and what a reader finds in the browser."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from viewer import Viewer, assert_shown, open_page, srgb

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


def unpack(html: str) -> tuple[np.ndarray, np.ndarray]:
    """Read mask and views, in light, from the page as its script does."""
    data = page_data(html)
    shape = data["rows"], data["cols"]
    blobs = re.findall(r'data-payload="(\w+)"[^>]*>([^<]*)</script>', html)
    raw = [zlib.decompress(base64.b64decode(text)) for kind, text in blobs if kind != "map"]
    pictures = len(data["views"]) * (1 + data["stereo"])
    assert [kind for kind, _ in blobs if kind != "map"] == ["mask"] + ["picture"] * pictures
    bits = np.unpackbits(np.frombuffer(raw[0], np.uint8), count=shape[0] * shape[1])
    mask = bits.reshape(shape).astype(bool)
    found: list[np.ndarray] = []
    for blob, bases in zip(raw[1:], data["bases"], strict=True):
        found.append(unpack_picture(blob, [found[base] for base in bases], mask, data))
    light = np.moveaxis(np.stack(found), 1, -1)
    return mask, light


def unpack_picture(
    blob: bytes, bases: list[np.ndarray], mask: np.ndarray, data: dict[str, Any]
) -> np.ndarray:
    """(primary, row, col) light of a payload, as `compensate.page.packing` describes it."""
    shape, tile, peak, top = mask.shape, data["tile"], data["peak"], data["top"]
    tiles = tuple(-(-side // tile) for side in shape)
    count = 3 * (len(bases) + 1) * tiles[0] * tiles[1] if bases else 0
    numbers = np.frombuffer(blob, "<f4", count + 3).astype(float)
    small = np.frombuffer(blob, np.uint8, 3 * mask.size, offset=4 * (count + 3))
    folded = small.astype(np.int64)
    folded[small == 255] += np.frombuffer(blob, "<u4", offset=4 * (count + 3) + 3 * mask.size)
    steps = np.where(folded % 2, -(folded + 1) // 2, folded // 2).reshape(3, *shape)
    off = np.cumsum(steps, axis=2)
    if bases:
        grids = numbers[:count].reshape(3, len(bases) + 1, *tiles)
        place = [np.clip((np.arange(side) + 0.5) / tile - 0.5, 0, n - 1)
                 for side, n in zip(shape, tiles, strict=True)]  # fmt: skip
        at = np.meshgrid(*place, indexing="ij")
        wide = np.stack([[map_coordinates(grid, at, order=1) for grid in each] for each in grids])
        light = sum(wide[:, k] * base for k, base in enumerate(bases)) + wide[:, len(bases)]
        light = np.maximum(light, np.maximum(numbers[count:], 0)[:, None, None])
        before = np.minimum(np.floor(top * np.cbrt(light / peak) + 0.5), top)
        codes = before.astype(np.int64) + off
    else:
        codes = np.stack([off[1] + off[0], off[1], off[1] + off[2]])
    return np.where(mask, peak * (codes / top) ** data["power"], 0)


# ------------------------------------------------------------------------------ what is written


def test_the_payload_is_the_light_to_a_thousandth_down_to_a_ten_thousandth_of_white(
    tmp_path: Path,
) -> None:
    views = make_views(5, 7)
    mask = disc(5, 7)
    found_mask, found = unpack(write(tmp_path / "page.html", views, mask=mask))
    np.testing.assert_array_equal(found_mask, mask)
    for view, light in zip(views, found, strict=True):
        np.testing.assert_allclose(light[mask], view.light[mask], rtol=1e-3)
        assert not light[~mask].any()


def test_the_right_eyes_payload_is_its_light_too(tmp_path: Path) -> None:
    views = make_stereo(5, 7)
    _, found = unpack(write(tmp_path / "page.html", views))
    np.testing.assert_allclose(found[::2], [view.light for view in views], rtol=1e-3)
    np.testing.assert_allclose(found[1::2], [view.right for view in views], rtol=1e-3)


def test_it_keeps_its_precision_with_highlights_of_eight_times_white(tmp_path: Path) -> None:
    light = np.full((5, 7, 3), 1e-4, np.float32)
    light[2, 3] = 8
    _, found = unpack(write(tmp_path / "page.html", [View("A", light)]))
    np.testing.assert_allclose(found[0], light, rtol=1e-3)


def test_black_stays_black_also_in_a_page_without_any_light(tmp_path: Path) -> None:
    _, found = unpack(write(tmp_path / "page.html", [View("Black", np.zeros((5, 7, 3)))]))
    assert not found.any()


@pytest.mark.parametrize("size", [30, 37, 59])
def test_reduction_conserves_the_mean_luminance(size: int) -> None:
    light = make_views()[0].light
    small, _ = _reduce(light, np.ones((ROWS, COLS), np.bool_), size)
    assert max(small.shape) == size
    np.testing.assert_allclose(
        (small @ LUMA).mean(dtype=float), (light @ LUMA).mean(dtype=float), rtol=1e-5
    )


def test_reduction_averages_areas_and_does_not_pick_points() -> None:
    light = np.zeros((ROWS, COLS, 3), np.float32)
    light[31, 41] = 1  # a star between the sampling points
    small, _ = _reduce(light, np.ones((ROWS, COLS), np.bool_), 28)
    np.testing.assert_allclose(small.sum(axis=(0, 1)), 1 / 9, rtol=1e-5)


def test_reduction_does_not_darken_the_rim_of_the_screen() -> None:
    mask = disc()
    light = np.where(mask[..., None], [0.5, 0.5, 0.5], np.nan)  # what is off the screen has no say
    small, small_mask = _reduce(light, mask, 31)
    np.testing.assert_allclose(small[small_mask], 0.5, rtol=1e-5)
    assert small_mask.mean() == pytest.approx(mask.mean(), rel=0.05)
    assert not small[~small_mask].any()


def test_the_page_says_that_it_is_reduced(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.html")
    small = write(tmp_path / "small.html", size=42)
    assert "area-averaged in linear light" not in whole
    assert "42 × 30 pixels, area-averaged in linear light from 84 × 60" in small


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


def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    assert write(tmp_path / "a.html") == write(tmp_path / "b.html")


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
    "no views": ([], {}, "at least one view"),
    "two sizes": ([View("A", LIGHT), View("B", LIGHT[1:])], {}, r"'B' .*\(5, 7, 3\).*\(4, 7, 3\)"),
    "no primaries": ([View("A", LIGHT[..., 0])], {}, r"\(row, col, 3\)"),
    "code values": ([View("A", LIGHT.astype(np.uint8))], {}, "linear light, got uint8"),
    "NaN": ([View("A", np.where(LIGHT > 0, np.nan, LIGHT))], {}, "finite"),
    "negative light": ([View("A", -LIGHT)], {}, ">= 0, got -0.5"),
    "one name twice": ([View("A", LIGHT), View("A", LIGHT)], {}, "different name"),
    "a strange kind": ([View("A", LIGHT, kind="felt")], {}, "got felt"),
    "no white": ([View("A", LIGHT)], {"white": 0.0}, "white > 0"),
    "no size": ([View("A", LIGHT)], {"size": 0}, "at least 16 pixels, got 0"),
    "a flat map": ([View("A", LIGHT, lost=LIGHT[..., 0])], {}, r"a map \(1, row, col\).*\(5, 7\)"),
    "a map below 0": ([View("A", LIGHT, lost=-LIGHT[None, ..., 0])], {}, "finite differences >= 0"),
    "the mask's shape": ([View("A", LIGHT)], {"mask": disc(7, 5)}, r"bool \(5, 7\)"),
    "an empty mask": ([View("A", LIGHT)], {"mask": np.zeros((5, 7), bool)}, "False everywhere"),
    "one eye short": (
        [View("A", LIGHT, right=LIGHT), View("B", LIGHT)],
        {},
        r"all have a right eye's picture or none, got \['B'\] without",
    ),
    "the right eye's size": ([View("A", LIGHT, right=LIGHT[1:])], {}, r"right eye.*\(4, 7, 3\)"),
    "the right eye's light": ([View("A", LIGHT, right=-LIGHT)], {}, "right eye.* >= 0, got -0.5"),
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


@pytest.mark.parametrize("path", ["missing/page.html", "."])
def test_an_unwritable_path_is_refused_in_one_line(path: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="wanted to write it, got") as caught:
        write(tmp_path / path)
    assert "\n" not in str(caught.value)


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


def test_the_split_moves_by_keyboard(viewer: Viewer) -> None:
    handle = viewer.find("split")
    assert handle.get_attribute("role") == "slider"
    for keys, share in (("ArrowLeft", 0.49), ("Shift+ArrowRight", 0.59), ("Home", 0), ("End", 1)):
        handle.press(keys)
        assert viewer.state()["split"] == pytest.approx(share)


def test_number_keys_show_a_view_whole_and_space_flips(viewer: Viewer) -> None:
    views = make_views()
    for key, view in (("1", 0), ("3", 2), (" ", 1), (" ", 2), (" ", 1)):
        viewer.page.keyboard.press(key)
        assert viewer.state()["mode"] == "flip"
        assert viewer.state()["shown"] == view
        assert_shown(viewer, views[view].light, 20, 30)
        assert_shown(viewer, views[view].light, 20, 54)


def test_space_held_compares_and_comes_back(viewer: Viewer) -> None:
    viewer.page.keyboard.press("2")
    viewer.page.keyboard.down(" ")
    assert viewer.state()["shown"] == 2
    viewer.page.wait_for_timeout(450)
    viewer.page.keyboard.up(" ")
    assert viewer.state()["shown"] == 1


def test_a_and_b_are_picked_and_swapped(viewer: Viewer) -> None:
    viewer.find("a-1").click()
    viewer.find("b-2").click()
    assert (viewer.state()["a"], viewer.state()["b"]) == (0, 1)
    viewer.page.keyboard.press("x")
    assert (viewer.state()["a"], viewer.state()["b"]) == (1, 0)


@pytest.mark.parametrize("area", [1, 5, 21])
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


def test_steps_of_any_size_are_kept(tmp_path: Path) -> None:
    """Around the largest that fits into a byte: what is more takes four bytes more."""
    steps = np.array([0, 127, -127, 128, -128, 129, -129, 255, 30000, -29000])
    codes = np.tile(30000 + np.cumsum(steps), (2, 1))
    codes[0, 0] = 65535  # the peak
    light = np.stack([(codes / 65535) ** 3] * 3, axis=-1)
    _, found = unpack(write(tmp_path / "page.html", [View("A", light)]))
    np.testing.assert_allclose(found[0], light, rtol=1e-12)


def test_what_is_clipped_at_black_is_kept(browser: Any, tmp_path: Path) -> None:
    """Also in the browser: its least light is stored aside, and nothing else of it."""
    master = make_views()[0]
    clipped = View("Clipped", np.maximum(master.light, np.float32([0.01, 0.02, 0.03])))
    _, found = unpack(write(tmp_path / "page.html", [master, clipped]))
    np.testing.assert_allclose(found[1], clipped.light, rtol=2e-3)
    for viewer in open_page(browser, tmp_path / "page.html"):
        shown = viewer.page.evaluate("domesimViewer.light()[1]")
        light = np.moveaxis(np.reshape(shown, (3, ROWS, COLS)), 0, -1)
        np.testing.assert_allclose(light, WHITE * found[1], rtol=1e-9)


@pytest.mark.parametrize("file", ["page_file", "stereo_file"])
def test_the_browser_unpacks_the_light_that_was_packed(
    browser: Any, file: str, request: pytest.FixtureRequest
) -> None:
    path = request.getfixturevalue(file)
    _, expected = unpack(path.read_text())
    for viewer in open_page(browser, path):
        found = viewer.page.evaluate("domesimViewer.light()")
        light = np.reshape(found, (len(found), 3, ROWS, COLS))
        np.testing.assert_allclose(np.moveaxis(light, 1, -1), WHITE * expected, rtol=1e-9)


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


def test_the_probe_says_when_it_is_outside_the_screen(viewer: Viewer) -> None:
    viewer.page.mouse.move(*viewer.point(2, 3))
    viewer.state()
    assert "outside the screen" in viewer.find("where").inner_text()
    assert viewer.colour(2, 3)[3] == 0


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


def test_two_fingers_zoom_the_picture(browser: Any, page_file: Path) -> None:
    page = browser.new_page(viewport={"width": 390, "height": 844}, has_touch=True)
    viewer = Viewer(page).open(page_file)
    before, (x, y) = viewer.state()["zoom"], viewer.point(20, 30)
    touch = page.context.new_cdp_session(page)
    for kind, apart in (("Start", 20), ("Move", 30), ("Move", 40), ("End", None)):
        fingers = [] if apart is None else [{"x": x + side * apart, "y": y} for side in (-1, 1)]
        touch.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": fingers})
    assert viewer.state()["zoom"] == pytest.approx(2 * before, rel=0.02)
    np.testing.assert_allclose(viewer.point(20, 30), (x, y), atol=3)
    assert not viewer.state()["pinned"]
    page.touchscreen.tap(*viewer.point(20, 30))
    assert viewer.state()["probe"] == {"row": 20, "col": 30}
    page.close()
    assert viewer.complaints == []


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


def test_help_opens_and_closes_by_keyboard(viewer: Viewer) -> None:
    viewer.page.keyboard.press("?")
    assert viewer.find("help").is_visible()
    viewer.page.keyboard.press("Escape")
    assert viewer.find("help").is_hidden()


def test_figures_and_facts_can_be_read(viewer: Viewer) -> None:
    cells = viewer.find("figures").locator("tbody td").all_inner_texts()
    assert cells == ["cd/m²", "4.2", "–", "–"]
    viewer.page.get_by_text("How this was made").click()
    assert "converged" in viewer.find("facts").inner_text()


def test_a_browser_that_cannot_unpack_is_told_so(browser: Any, page_file: Path) -> None:
    page = browser.new_page()
    page.add_init_script("delete window.DecompressionStream")
    viewer = Viewer(page).open(page_file)
    assert "no DecompressionStream" in viewer.find("message").inner_text()
    page.close()
    assert viewer.complaints == []


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


def test_a_mono_page_says_nothing_of_eyes(viewer: Viewer) -> None:
    assert viewer.find("eyes").count() == 0
    viewer.page.keyboard.press("o")
    assert viewer.state()["eye"] == "left"


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


def test_left_minus_right_is_coloured_by_its_sign(stereo: Viewer) -> None:
    seen = make_stereo()[1]
    difference = (seen.light.astype(float) - right_of(seen)) @ LUMA
    stereo.page.keyboard.press("2")
    stereo.page.keyboard.press("m")
    red, _, blue, _ = stereo.colour(*map(int, np.unravel_index(difference.argmax(), (ROWS, COLS))))
    assert red > blue + 20
    red, _, blue, _ = stereo.colour(*map(int, np.unravel_index(difference.argmin(), (ROWS, COLS))))
    assert blue > red + 20
    assert "left brighter" in stereo.find("legend").inner_text()


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


def test_the_ghost_that_is_left_is_told_for_each_view(stereo: Viewer) -> None:
    stereo.page.keyboard.press("o")
    stereo.state()
    untouched = stereo.find("ghost-left").locator("tbody tr").first.locator("td")
    assert untouched.all_inner_texts() == ["2.4", "2.4", "0", "0"]  # 0.05 of 48 cd/m²


def test_side_by_side_shows_the_left_eye_left(stereo: Viewer) -> None:
    seen = make_stereo()[1]
    stereo.page.keyboard.press("2")
    stereo.page.keyboard.press("p")
    stereo.state()
    box = stereo.find("picture").bounding_box()
    for cell, light in enumerate((seen.light.astype(float), right_of(seen))):
        at = stereo.page.evaluate(f"domesimViewer.toWindow(20, 30, {cell})")
        shown = stereo.page.evaluate(
            "([x, y]) => [...document.getElementById('picture').getContext('2d')"
            ".getImageData(x, y, 1, 1).data]",
            [int(at["x"] - box["x"]), int(at["y"] - box["y"])],
        )
        np.testing.assert_allclose(shown[:3], srgb(light[20, 30]), atol=0.6)


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


def test_the_wiggle_does_not_start_itself_where_motion_is_unwanted(
    browser: Any, stereo_file: Path
) -> None:
    for viewer in open_page(browser, stereo_file, reduced_motion="reduce"):
        viewer.page.keyboard.press("w")
        assert not viewer.state()["playing"]
        viewer.page.keyboard.press("w")
        assert viewer.state()["playing"]


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


@pytest.mark.parametrize("width", [390, 1200])
def test_a_stereo_page_fits_its_width(browser: Any, stereo_file: Path, width: int) -> None:
    for viewer in open_page(browser, stereo_file, viewport={"width": width, "height": 844}):
        for keys in ("go", "sp", "fc", "gm", "sw"):
            for key in keys:
                viewer.page.keyboard.press(key)
            viewer.state()
            assert viewer.page.evaluate("document.documentElement.scrollWidth") == width
