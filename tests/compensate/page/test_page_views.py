"""The compare page's maps of visible differences, and the dome from its seats."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from colour.blindness import matrix_cvd_Machado2009
from command_line import exit_code
from scipy.ndimage import map_coordinates
from viewer import Viewer, assert_shown, open_page, srgb

from compensate.page.page import Figure, View, write_page
from compensate.vision.differences import EXPONENT, JOD, STILL
from domesim.room.dome import Dome
from domesim.room.theatre import Floor, Theatre, Viewpoint, Wall

SIDE, WHITE = 96, 48.0
SEATS = {
    "front": Viewpoint((0.5, 3.0, -2.0), (0.0, 6.0, 4.0), np.radians(80)),
    "centre": Viewpoint((0.5, -1.0, -2.0), (0.0, 6.0, 3.0), np.radians(90)),
}
THEATRE = Theatre(
    Dome(8.0, np.radians(95), tilt=np.radians(20), height_ratio=0.9),
    (0.5,) * 3,
    floor=Floor(-4.0, 8.0, (0.1,) * 3),
    wall=Wall(8.5, -4.0, 0.0, (0.1,) * 3),
    viewpoints=SEATS,
)
BELOW, LINE, NONE = [22, 22, 22], [255, 255, 255], [62, 62, 62]


def smooth(rows: int = SIDE, cols: int = SIDE) -> np.ndarray:
    """Light without edges, of another colour everywhere."""
    y, x = np.mgrid[:rows, :cols] / max(rows, cols)
    waves = [np.sin(5 * x + 2 * y), np.sin(4 * y - x + 1), np.sin(3 * x + 5 * y + 2)]
    return np.stack([0.4 + 0.3 * wave for wave in waves], axis=-1).astype(np.float32)


def visible(rows: int = SIDE, cols: int = SIDE) -> np.ndarray:
    """(row, col) JND: from 0.25 on the left to 128 on the right."""
    return np.broadcast_to(2 ** np.linspace(-2, 7, cols), (rows, cols)).astype(np.float32)


def lost(jnd: np.ndarray, eyes: int = 1) -> np.ndarray:
    return np.stack([JOD * (STILL * jnd) ** EXPONENT] * eyes)


def views(eyes: int = 1) -> list[View]:
    master = smooth()
    pictures = [
        ("Master", master, "master", None),
        ("Seen, untouched", master + np.float32(0.1), "seen", lost(visible(), eyes)),
        ("Seen, perceptual", master * np.float32(0.8), "seen", lost(visible() / 4, eyes)),
        ("Projected", master * np.float32(0.6), "projected", None),
    ]
    return [
        View(name, light, "a note", kind, light * np.float32(0.9) if eyes == 2 else None, found)
        for name, light, kind, found in pictures
    ]


def write(path: Path, *, theatre: Theatre | None = THEATRE, eyes: int = 1) -> Path:
    mask = None if theatre is None else theatre.dome.inside(SIDE, SIDE)
    meaning = "A sentence that is long enough to need a few lines on a phone, which it gets."
    figures = [
        Figure(name, "cd/m²", {"Master": "0.000123", "Seen, perceptual": "1.234"}, meaning)
        for name in ("Quality lost", "Darkest 1 %")
    ]
    facts = {"Solver": "x" * 200}
    write_page(path, views(eyes), title="A title", subtitle="A subtitle", white=WHITE,
               figures=figures, facts=facts, mask=mask, theatre=theatre)  # fmt: skip
    return path


@pytest.fixture(scope="module")
def dome_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("dome") / "page.html")


@pytest.fixture
def dome(window: Viewer, dome_file: Path) -> Iterator[Viewer]:
    yield from window.used(dome_file)


# ------------------------------------------------------------------ maps of visible differences


def cividis(viewer: Viewer, jnd: float) -> list[int]:
    share = np.log(jnd) / np.log(512)
    ramp: list[list[int]] = viewer.page.evaluate("domesimLight.ramps.magnitude")
    return ramp[round(share * (len(ramp) - 1))]


def test_the_map_is_coloured_from_the_threshold_up(dome: Viewer) -> None:
    dome.page.keyboard.press("2")
    dome.page.keyboard.press("v")
    jnd = visible()[48]
    for col in (30, 50, 70, 90):
        np.testing.assert_allclose(dome.colour(48, col)[:3], cividis(dome, jnd[col]), atol=4)
    assert dome.colour(48, 10)[:3] == BELOW
    at_line = int(np.argmax(jnd >= 1))
    assert dome.colour(48, at_line)[:3] == LINE
    assert "JND" in dome.find("legend").inner_text()
    dome.page.keyboard.press("v")
    assert_shown(dome, views()[1].light, 48, 50)


def test_the_share_above_the_line_is_the_maps(dome: Viewer) -> None:
    screen = THEATRE.dome.inside(SIDE, SIDE)
    rows = dome.find("visible-share").locator("tbody tr")
    for number, jnd in enumerate((visible(), visible() / 4)):
        (share,) = rows.nth(number).locator("td").all_inner_texts()
        assert float(share.split()[0]) == pytest.approx(100 * (jnd >= 1)[screen].mean(), abs=2)


@pytest.mark.long
def test_a_pair_has_a_map_for_each_eye(browser: Any, tmp_path: Path) -> None:
    path = write(tmp_path / "pair.html", theatre=None, eyes=2)
    for viewer in open_page(browser, path):
        assert viewer.find("visible-share").locator("tbody tr").count() == 4
        viewer.page.keyboard.press("2")
        viewer.page.keyboard.press("o")
        viewer.page.keyboard.press("v")
        assert viewer.state()["eye"] == "left"
        viewer.page.keyboard.press("e")
        expected = cividis(viewer, visible()[48, 70])
        np.testing.assert_allclose(viewer.colour(48, 70)[:3], expected, atol=4)
        viewer.page.keyboard.press("c")
        assert viewer.state()["layer"] == "light"
        assert viewer.find("place-dome").count() == 0


@pytest.mark.filterwarnings("ignore:.*shift paradigm")
def test_scales_are_told_apart_by_the_colour_blind(dome: Viewer) -> None:
    """Lightness rises along sizes; signs differ in hue, by Machado et al. (2009)."""
    ramps = dome.page.evaluate("domesimLight.ramps")
    for defect in ("Protanomaly", "Deuteranomaly", "Tritanomaly"):
        assert_told_apart(ramps, defect)


def assert_told_apart(ramps: dict[str, list[list[int]]], defect: str) -> None:
    seen = {}
    for name, ramp in ramps.items():
        light = (np.array(ramp)[::10] / 255) ** 2.2
        seen[name] = np.clip(light @ matrix_cvd_Machado2009(defect, 1.0).T, 0, 1)
    rise = np.diff((seen["magnitude"] @ [0.2126, 0.7152, 0.0722]) ** (1 / 3))
    assert (rise > 0).all()
    ends = np.cbrt(seen["signed"])
    for step in (5, 15, 25):  # as bright, on both sides of zero
        middle = len(ends) // 2
        assert np.abs(ends[middle + step] - ends[middle - step]).max() > 0.08


# ------------------------------------------------------------------ the dome from a seat


def ray_of(viewpoint: Viewpoint, x: float, y: float, width: float, height: float) -> np.ndarray:
    """The ray of a pixel: a pinhole camera that stands upright."""
    forward = np.subtract(viewpoint.look_at, viewpoint.position)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    reach = np.tan(viewpoint.field / 2)
    across, above = (2 * x / width - 1) * reach, (height - 2 * y) / width * reach
    return forward + across * right + above * up


def pixel_on(dome: Dome, eye: Any, ray: np.ndarray) -> tuple[float, float]:
    """Row and col that a ray meets, by bisection on how far it is inside."""
    low, high = 0.0, 40.0
    for _ in range(80):
        middle = (low + high) / 2
        point = (np.asarray(eye) + middle * ray) @ dome.to_room
        distance = np.linalg.norm(point)
        inside = distance < dome.distance(point / distance)
        low, high = (middle, high) if inside else (low, middle)
    theta = np.arccos(point[2] / distance) / dome.half_angle
    side = theta * point[:2] / np.linalg.norm(point[:2])
    return (side[1] + 1) / 2 * SIDE, (side[0] + 1) / 2 * SIDE


def domed(viewer: Viewer) -> dict[str, float]:
    viewer.page.keyboard.press("t")
    assert viewer.state()["place"] == "dome"
    box: dict[str, float] = viewer.find("picture").bounding_box()
    return box


def shot(viewer: Viewer) -> np.ndarray:
    """(row, col, rgb) of the window."""
    import io  # noqa: PLC0415

    from PIL import Image  # noqa: PLC0415

    viewer.state()
    return np.asarray(Image.open(io.BytesIO(viewer.page.screenshot())).convert("RGB"))


@pytest.mark.parametrize("seat", ["front", "centre"])
def test_rays_meet_the_screen_where_geometry_has_it(dome: Viewer, seat: str) -> None:
    number = list(SEATS).index(seat)
    look = dome.page.evaluate(f"domesimDome.facing({number})")
    for x, y in ((320, 180), (100, 40), (600, 20), (500, 300)):
        ray = dome.page.evaluate(
            "([look, x, y]) => domesimDome.rayAt(look, x, y, 640, 360)", [look, x, y]
        )
        expected = ray_of(SEATS[seat], x, y, 640, 360)
        np.testing.assert_allclose(ray, expected, atol=1e-3)  # seats are rounded to 0.1 mm
        found = dome.page.evaluate(
            "([eye, ray]) => domesimDome.pictureAt(eye, ray)", [SEATS[seat].position, ray]
        )
        row, col = pixel_on(THEATRE.dome, SEATS[seat].position, np.array(ray))
        assert (found["row"], found["col"]) == pytest.approx((row, col), abs=1e-3)


def test_what_is_drawn_is_the_picture_where_the_rays_meet_it(dome: Viewer) -> None:
    dome.page.keyboard.press("2")
    box = domed(dome)
    drawn = shot(dome)
    light = views()[1].light.astype(float)
    checked = 0
    for x, y in ((0.5, 0.4), (0.2, 0.3), (0.8, 0.2), (0.6, 0.1), (0.5, 0.55), (0.7, 0.5)):
        px, py = int(x * box["width"]), int(y * box["height"])
        ray = ray_of(SEATS["centre"], px + 0.5, py + 0.5, box["width"], box["height"])
        row, col = pixel_on(THEATRE.dome, SEATS["centre"].position, ray)
        if np.hypot(row - SIDE / 2, col - SIDE / 2) > 0.49 * SIDE:
            continue
        checked += 1
        at = [[row - 0.5], [col - 0.5]]
        expected = [srgb(map_coordinates(light[..., c], at, order=1)[0]) for c in range(3)]
        np.testing.assert_allclose(drawn[int(box["y"]) + py, int(box["x"]) + px], expected, atol=2)
    assert checked >= 4


def test_exposure_and_maps_are_seen_on_the_dome(dome: Viewer) -> None:
    dome.page.keyboard.press("2")
    box = domed(dome)
    place = int(box["y"] + 0.3 * box["height"]), int(box["x"] + 0.5 * box["width"])
    neutral = shot(dome)[place].astype(int)
    dome.page.keyboard.press("[")
    assert (shot(dome)[place] < neutral - 15).all()
    dome.page.keyboard.press("v")
    ramp = np.array(dome.page.evaluate("domesimLight.ramps.magnitude"))
    assert np.abs(ramp - shot(dome)[place]).max(axis=1).min() <= 3


def test_dragging_looks_around_and_what_is_grabbed_stays_below_the_pointer(dome: Viewer) -> None:
    box = domed(dome)
    x, y = box["x"] + 0.4 * box["width"], box["y"] + box["height"] / 3
    before = dome.state()["look"]
    grabbed = dome.page.evaluate(
        "([x, y]) => domesimDome.pictureAt(domesimDome.seats[1].eye,"
        " domesimDome.rayAt(domesimViewer.state().look, x, y, ...domesimViewer.size()))",
        [x - box["x"], y - box["y"]],
    )
    dome.page.mouse.move(x, y)
    dome.page.mouse.down()
    dome.page.mouse.move(x + 40, y + 25, steps=8)
    dome.page.mouse.up()
    after = dome.state()["look"]
    assert after["turn"] < before["turn"]
    assert after["rise"] > before["rise"]
    row, col = grabbed["row"] - 0.5, grabbed["col"] - 0.5
    np.testing.assert_allclose(dome.point(row, col), (x + 40, y + 25), atol=12)
    assert not dome.state()["pinned"]


def test_another_seat_sees_another_view(dome: Viewer) -> None:
    domed(dome)
    assert dome.state()["seat"] == 1  # "centre" is where it begins
    before = shot(dome)
    dome.find("seat").select_option(label="front")
    state = dome.state()
    assert state["seat"] == 0
    assert state["look"]["field"] == pytest.approx(80)
    assert np.abs(shot(dome).astype(int) - before).max() > 20


def test_the_probe_works_on_the_dome(dome: Viewer) -> None:
    box = domed(dome)
    x, y = box["width"] * 0.4, box["height"] * 0.3
    dome.page.mouse.click(box["x"] + x, box["y"] + y)
    state = dome.state()
    row, col = pixel_on(
        THEATRE.dome,
        SEATS["centre"].position,
        ray_of(SEATS["centre"], x, y, box["width"], box["height"]),
    )
    assert state["pinned"]
    assert abs(state["probe"]["row"] + 0.5 - row) <= 1
    assert abs(state["probe"]["col"] + 0.5 - col) <= 1
    np.testing.assert_allclose(dome.point(**state["probe"]), (box["x"] + x, box["y"] + y), atol=12)


@pytest.mark.long
def test_without_webgl_the_page_says_so(browser: Any, dome_file: Path) -> None:
    page = browser.new_page()
    page.add_init_script(
        "const get = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {"
        " return kind === 'webgl2' ? null : get.call(this, kind, ...rest); };"
    )
    viewer = Viewer(page).open(dome_file)
    assert viewer.find("dome-missing").is_visible()
    viewer.page.keyboard.press("t")
    assert viewer.state()["place"] == "flat"
    page.close()
    assert viewer.complaints == []


# A headset that looks ahead with both eyes, 6 cm apart, and shows them side by side.
HEADSET = """
const eye = (x) => ({
  projectionMatrix: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, -1, 0, 0, -0.2, 0],
  transform: { matrix: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, 0, 0, 1] }, side: x,
});
class Session extends EventTarget {
  updateRenderState({ baseLayer }) { window.layer = baseLayer; }
  async requestReferenceSpace(kind) { return kind; }
  requestAnimationFrame(work) {
    setTimeout(() => work(0, { getViewerPose: () => ({ views: [eye(-0.03), eye(0.03)] }) }), 30);
  }
  end() { this.dispatchEvent(new Event("end")); }
}
window.XRWebGLLayer = class {
  constructor(session, gl) {
    this.gl = gl;
    this.framebuffer = gl.createFramebuffer();
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 200, 100, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }
  getViewport({ side }) { return { x: side < 0 ? 0 : 100, y: 0, width: 100, height: 100 }; }
  read() {
    const { gl } = this, found = new Uint8Array(4 * 200 * 100);
    const bound = gl.getParameter(gl.FRAMEBUFFER_BINDING);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.readPixels(0, 0, 200, 100, gl.RGBA, gl.UNSIGNED_BYTE, found);
    gl.bindFramebuffer(gl.FRAMEBUFFER, bound);
    return [...found];
  }
};
Object.defineProperty(navigator, "xr", { value: {
  isSessionSupported: async (kind) => kind === "immersive-vr" && YES,
  requestSession: async () => (window.session = new Session()),
} });
WebGL2RenderingContext.prototype.makeXRCompatible = async () => {};
"""


@pytest.mark.long
def test_a_headset_shows_both_eyes_and_its_trigger_flips(browser: Any, dome_file: Path) -> None:
    page = browser.new_page(viewport={"width": 1200, "height": 800})
    page.add_init_script(HEADSET.replace("YES", "true"))
    viewer = Viewer(page).open(dome_file)
    viewer.page.keyboard.press("t")
    viewer.state()
    viewer.find("headset").click()
    page.wait_for_function("window.layer && layer.read().some((v) => v > 60 && v < 255)")
    assert viewer.state()["shown"] == 2
    seen = np.array(page.evaluate("layer.read()")).reshape(100, 200, 4)[..., :3]
    eye = np.array(SEATS["centre"].position)
    ahead = np.subtract(SEATS["centre"].look_at, eye) * [1, 1, 0]
    ahead /= np.linalg.norm(ahead)
    side = np.cross(ahead, [0, 0, 1])
    light = views()[2].light.astype(float)
    for first, shift in ((0, -0.03), (100, 0.03)):  # 80 rows up of 100: a rise of 0.61
        ray = ahead + 0.61 * np.array([0, 0, 1]) + 0.01 * side
        row, col = pixel_on(THEATRE.dome, eye + shift * side, ray)
        found = seen[80, first + 50]
        np.testing.assert_allclose(found, srgb(light[int(row), int(col)]), atol=6)
    page.evaluate("session.dispatchEvent(new Event('select'))")
    assert viewer.state()["shown"] == 1
    before = seen[80, 50].copy()
    page.wait_for_function(f"Math.abs(layer.read()[4 * (80 * 200 + 50)] - {before[0]}) > 5")
    page.evaluate("session.end()")
    viewer.state()
    assert shot(viewer).std() > 5  # the page draws again
    page.close()
    assert viewer.complaints == []


# ------------------------------------------------------------------ how it is presented


def test_one_to_one_is_the_theatres_luminance_on_the_readers_display(dome: Viewer) -> None:
    dome.find("display-nits").fill("300")
    dome.find("display-nits").blur()
    dome.find("one-to-one").click()
    assert dome.state()["exposure"] == pytest.approx(np.log2(WHITE / 300), abs=0.006)
    assert "300 cd/m²" in dome.find("one-to-one-note").inner_text()
    assert "16 %" in dome.find("one-to-one-note").inner_text()
    assert dome.find("one-to-one").get_attribute("aria-pressed") == "true"
    dome.page.keyboard.press("1")
    expected = srgb(views()[0].light[40, 40].astype(float) * WHITE / 300)
    np.testing.assert_allclose(dome.colour(40, 40)[:3], expected, atol=1)


def test_nothing_is_cut_off_or_overlaps_on_a_phone(browser: Any, dome_file: Path) -> None:
    for viewer in open_page(browser, dome_file, viewport={"width": 390, "height": 844}):
        viewer.page.keyboard.press("t")
        viewer.state()
        assert viewer.page.evaluate("document.documentElement.scrollWidth") == 390
        boxes = viewer.page.evaluate(
            "[...document.querySelectorAll('.bar button, .bar .segment')]"
            ".map((each) => each.getBoundingClientRect()).filter(({ width }) => width)"
        )
        for one, other in pairwise(boxes):
            assert one["right"] <= other["left"] + 0.5 or other["top"] > one["top"] + 20
        assert boxes[-1]["right"] <= 390
        # Figures: whole, with the view that they are of
        cells = viewer.page.evaluate(
            "[...document.querySelectorAll('.figures td:not(.unit)')].map((cell) => ({"
            " whole: cell.scrollWidth <= cell.clientWidth, box: cell.getBoundingClientRect(),"
            " view: getComputedStyle(cell, '::before').content }))"
        )
        assert len(cells) == 2 * len(views())
        for cell in cells:
            assert cell["whole"]
            assert cell["box"]["left"] >= 0
            assert cell["box"]["right"] <= 390
            assert cell["view"].strip('"') in [each.name for each in views()]


@pytest.mark.long
def test_the_bundled_masters_page_is_no_larger_than_6_megabytes(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    with resources.as_file(resources.files("scenes") / "masters" / "night.exr") as master:
        code = exit_code("compare", master, "--scene", "dome_imax", "--out", page, "--quiet")
    assert code == 0
    assert page.stat().st_size <= 6e6
    html = page.read_text()
    assert "1024 × 1024 pixels" in html
    told = re.search(r"light of 1/100 of white to ([\d.]+) %", html)
    assert told
    assert float(told[1]) < 1


@pytest.mark.long
@pytest.mark.parametrize("seat", ["front", "centre"])
def test_the_view_from_a_seat_is_the_path_tracers(browser: Any, tmp_path: Path, seat: str) -> None:
    """Light that comes straight from the screen, within Delta E 1 in the middle of the picture."""
    from colour import XYZ_to_Lab, delta_E  # noqa: PLC0415 - takes a second
    from colour.models import RGB_COLOURSPACE_sRGB  # noqa: PLC0415

    from domesim.pathtrace.tracer import Settings, Tracer  # noqa: PLC0415

    size, width, height = 512, 320, 180
    light = smooth(size, size)
    path = tmp_path / "page.html"
    screen = THEATRE.dome.inside(size, size)
    write_page(path, [View("Master", light, kind="master")], title="T", subtitle="", white=WHITE,
               mask=screen, theatre=THEATRE)  # fmt: skip
    tracer = Tracer(THEATRE)
    settings = Settings(least=16, most=16, bounces=1, per_bounce=True)
    traced = tracer.view(tracer.picture(light), SEATS[seat], width, height, settings)
    assert traced.bounces is not None
    direct = np.asarray(traced.bounces[0], float)

    page = browser.new_page(viewport={"width": 1200, "height": 900}, color_scheme="dark")
    viewer = Viewer(page).open(path)
    page.add_style_tag(content=f".frame {{ position: fixed; inset: 0 auto auto 0; z-index: 9; "
                               f"width: {width}px; height: {height}px; }}")  # fmt: skip
    viewer.page.keyboard.press("1")
    viewer.page.keyboard.press("t")
    viewer.find("seat").select_option(label=seat)
    shown = shot(viewer)[:height, :width] / 255
    page.close()

    middle = (slice(height // 4, 3 * height // 4), slice(width // 4, 3 * width // 4))
    to_xyz = RGB_COLOURSPACE_sRGB.matrix_RGB_to_XYZ
    decoded = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    labs = [XYZ_to_Lab(rgb[middle] @ to_xyz.T) for rgb in (decoded, np.clip(direct, 0, 1))]
    off = delta_E(*labs, method="CIE 2000")
    assert labs[0].std(axis=(0, 1)).max() > 5  # it is no plain picture
    assert off.max() < 1


def test_split_shows_a_left_and_b_right_in_the_dome_and_space_flips(dome: Viewer) -> None:
    box = domed(dome)
    at = [
        (int(box["y"] + 0.3 * box["height"]), int(box["x"] + x * box["width"])) for x in (0.3, 0.7)
    ]
    split = shot(dome)
    whole = []
    for key in ("2", "3"):
        dome.page.keyboard.press(key)
        whole.append(shot(dome))
    for place, picture, other in zip(at, whole, whole[::-1], strict=True):
        np.testing.assert_array_equal(split[place], picture[place])
        assert np.abs(split[place].astype(int) - other[place]).max() > 5
    dome.page.keyboard.down(" ")
    assert dome.state()["shown"] == 1
    np.testing.assert_array_equal(shot(dome)[at[0]], whole[0][at[0]])
    dome.page.keyboard.up(" ")


def test_wheel_keys_and_buttons_change_the_view(dome: Viewer) -> None:
    box = domed(dome)
    begin = dome.state()["look"]
    dome.page.mouse.move(box["x"] + 200, box["y"] + 200)
    dome.page.mouse.wheel(0, -300)
    dome.page.wait_for_function(f"domesimViewer.state().look.field < {begin['field'] - 10}")
    dome.page.keyboard.press("0")
    assert dome.state()["look"] == begin
    dome.find("zoom-out").click()
    assert dome.state()["look"]["field"] == pytest.approx(1.25 * begin["field"])
    assert "°" in dome.find("zoom-value").inner_text()
    assert dome.find("zoom-one").is_disabled()
    dome.page.keyboard.press("ArrowRight")
    dome.page.keyboard.press("ArrowUp")
    dome.page.keyboard.press("Shift+ArrowUp")
    look = dome.state()["look"]
    assert look["turn"] == pytest.approx(begin["turn"] + 5)
    assert look["rise"] == pytest.approx(begin["rise"] + 6)
    for _ in range(12):
        dome.page.keyboard.press("ArrowUp")
    assert dome.state()["look"]["rise"] == pytest.approx(89.9)
    dome.page.mouse.dblclick(box["x"] + 200, box["y"] + 200)
    assert dome.state()["look"] == begin
