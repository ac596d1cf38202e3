"""A session by eye in a browser: a made-up viewer sees the page's pixels on a made-up display."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from conftest import CHROMIUM

from domesim.measure.by_eye.albedo import answering_levels
from domesim.measure.by_eye.page import server
from domesim.measure.by_eye.session import (
    SETTINGS,
    read_session,
    trials_of,
)
from domesim.scene import load_scene

pytestmark = pytest.mark.skipif(not CHROMIUM, reason="no browser")

PAIR, DOME = "stereo_polarised_paper", "dome_hemisphere"
GAMMA = 2.35
LEAKS = {"left": {"R": 0.011, "G": 0.008, "B": 0.02}, "right": {"R": 0.13, "G": 0.015, "B": 0.012}}
ALBEDO = {"R": 0.45, "G": 0.42, "B": 0.38}

LOOK = """([gamma, share]) => {
    const {block, phase} = shown;
    const c = {W: 1, R: 0, G: 1, B: 2}[block.primary];
    // Mean light of a place of a canvas, left, top, width and height of its size
    const light = (eye, place) => {
        const canvas = eyes[eye].querySelector("canvas");
        const {width, height} = canvas;
        const box = place.map((part, k) => Math.round(part * (k % 2 ? height : width)));
        const size = box.slice(2).map((side) => Math.max(side, 8));
        const {data} = canvas.getContext("2d").getImageData(box[0], box[1], ...size);
        let sum = 0;
        for (let k = c; k < data.length; k += 4) sum += (data[k] / 255) ** gamma;
        return sum / (data.length / 4);
    };
    const both = (one) => [0, 1].map((which) => { shown.phase = which; draw(); return one(); });
    let wrong;
    if (stereo && block.task === "match") {
        const eye = block.eye === "left" ? 0 : 1;
        wrong = light(eye, [0.4, 0.4, 0.2, 0.2]) - light(eye, [0.05, 0.05, 0.2, 0.2]);
    } else if (stereo) {
        const eye = block.eye === "left" ? 0 : 1;
        const bar = [0.2 + 0.6 * 6.22 / 12, 0.4, 0.6 * 0.06 / 12, 0.2];
        const gap = [0.2 + 0.6 * 6.72 / 12, 0.4, 0.6 * 0.06 / 12, 0.2];
        shown.phase = 0;
        draw();
        const [on, off] = [bar, gap].map((one) => light(eye, one) + share * light(1 - eye, one));
        wrong = off - on;
    } else {
        // The whole rear, and the front at its middle; the disc fills pi / 4 of the canvas
        const rear = both(() => light(0, [0, 0, 1, 0.5]) / (Math.PI / 4));
        const front = both(() => light(0, [0.45, 0.7, 0.1, 0.1]));
        const whole = share * 2; // reflected, of a whole white dome
        const seen = [0, 1].map((k) => front[k] + whole * (rear[k] + front[k]) / 2);
        wrong = block.task === "match" ? seen[0] - seen[1] : seen[1] - seen[0];
    }
    shown.phase = phase;
    draw();
    return wrong;
}"""
"""Too much light that answers, or too little, as the viewer sees it."""


@pytest.fixture
def start(tmp_path):
    """Begins a server of a scene in the same folder: its address, and how to end it."""
    running = []

    def begin(kind, name):
        found = server(tmp_path / "out", kind, name, load_scene(name).digest)
        thread = threading.Thread(target=found.serve_forever, args=(0.05,))
        thread.start()
        running.append(found)

        def end():
            found.shutdown()
            thread.join()
            found.server_close()

        return f"http://127.0.0.1:{found.server_address[1]}/", end

    (tmp_path / "out").mkdir()
    yield begin
    for each in running:
        each.shutdown()
        each.server_close()


def until(page, expression):
    """Wait for it; the page's policy keeps Playwright's own way, which is `eval`, out."""
    end = time.monotonic() + 20
    while not page.evaluate(expression):
        assert time.monotonic() < end, expression
        page.wait_for_timeout(3)


def begun(page, address):
    page.add_init_script(
        "{const slow = window.setTimeout; window.setTimeout = (f, ms) => slow(f, ms / 50);}"
    )
    page.goto(address)
    page.wait_for_selector("#begin:not([disabled])")
    page.click("#begin")
    page.wait_for_selector("#stage:not([hidden])")


def press(page, count):
    """Turn by so many small steps, with large ones as far as they go."""
    large, small = ("ArrowUp", "ArrowRight") if count > 0 else ("ArrowDown", "ArrowLeft")
    for _ in range(abs(count) // 8):
        page.keyboard.press(large)
    for _ in range(abs(count) % 8):
        page.keyboard.press(small)


def settle(page, share):
    """Turn until the sign of what is seen changes."""
    step = 128
    before = page.evaluate(LOOK, [GAMMA, share])
    while step:
        press(page, -step if before > 0 else step)
        now = page.evaluate(LOOK, [GAMMA, share])
        if now == 0 or page.evaluate("shown.code") == 0:
            return
        if (now > 0) != (before > 0):
            step //= 4
        before = now


def play(page, total, shares):
    """Set so many trials in all, each where nothing is seen any more."""
    end = time.monotonic() + 240
    while page.evaluate("place()") < total:
        assert time.monotonic() < end
        if page.evaluate("shown === null || listener === null"):
            if page.evaluate("listener !== null"):
                page.keyboard.press(" ")
            page.wait_for_timeout(3)
            continue
        block, done = page.evaluate("[shown.block, session.settings.length]")
        if block["task"] == "match":
            share = shares.get("both", {}).get("G", 0.0)
        else:
            share = shares[block["eye"]][block["primary"]]
        settle(page, share)
        page.keyboard.press(" ")
        until(page, f"session.settings.length > {done}")


def light_of(page, eye, place):
    """Mean codes of R, G, B in a place of a canvas: left, top, width, height of its size."""
    return np.array(
        page.evaluate(
            """([eye, place]) => {
                const canvas = eyes[eye].querySelector("canvas");
                const sizes = [canvas.width, canvas.height];
                const box = place.map((part, k) => Math.round(part * sizes[k % 2]));
                const {data} = canvas.getContext("2d").getImageData(...box);
                const sums = [0, 0, 0];
                for (let k = 0; k < data.length; k += 1) if (k % 4 < 3) sums[k % 4] += data[k];
                return sums.map((sum) => (4 * sum) / data.length / 255);
            }""",
            [eye, place],
        )
    )


def show(page, task, eye, primary, base, code, phase):
    """Draw one trial as it would be."""
    block = {"task": task, "eye": eye, "primary": primary, "level": int(task == "match")}
    page.evaluate("one => { shown = one; draw(); }", {
        "block": block, "base": base, "code": code, "phase": phase
    })  # fmt: skip


STILL = "window.setInterval = () => 0"
"""Pictures do not take turns."""
BAR, GAP, AROUND = (
    (0.2 + 0.6 * 6.22 / 12, 0.3, 0.6 * 0.05 / 12, 0.4),
    (0.2 + 0.6 * 6.72 / 12, 0.3, 0.6 * 0.05 / 12, 0.4),
    (0.02, 0.3, 0.1, 0.4),
)


@pytest.mark.parametrize("layout", ["sbs", "sbs-half", "tb-half", "windows"])
def test_each_eye_has_its_picture(browser, start, layout):
    address, _ = start("stereo", PAIR)
    context = browser.new_context(viewport={"width": 1920, "height": 1200})
    page = context.new_page()
    page.add_init_script(STILL)
    page.goto(address)
    if layout == "windows":
        with page.expect_popup() as second:
            page.select_option("#layout", layout)
        assert second.value.locator(".eye.right canvas").count() == 1
    else:
        page.select_option("#layout", layout)
    page.evaluate("at('stage').hidden = false; at('desk').hidden = true")
    for swapped, looks in ((False, 1), (True, 0)):
        page.evaluate(f"at('swap').checked = {str(swapped).lower()}")
        for phase, (bar, gap) in enumerate(((BAR, GAP), (GAP, BAR))):
            show(page, "null", "right", "G", 0.2, 0.1503, phase)
            np.testing.assert_allclose(light_of(page, looks, bar), [0, 0.1503, 0], atol=2e-4)
            np.testing.assert_allclose(light_of(page, looks, gap), [0, 0.2, 0], atol=2e-4)
            np.testing.assert_allclose(light_of(page, looks, AROUND), [0, 0.2, 0], atol=2e-4)
            np.testing.assert_allclose(light_of(page, 1 - looks, bar), [0, 1, 0], atol=2e-4)
            assert not light_of(page, 1 - looks, gap).any()
            assert not light_of(page, 1 - looks, AROUND).any()
    # A quarter of the lines is lit, across what the display squeezes
    show(page, "match", "left", "W", 0.8, 0.4402, 0)
    np.testing.assert_allclose(light_of(page, 1, (0, 0, 0.3, 0.32)), 0.2, atol=0.01)
    np.testing.assert_allclose(light_of(page, 1, (0.4, 0.4, 0.2, 0.2)), 0.4402, atol=2e-4)
    assert not light_of(page, 0, (0, 0, 1, 1)).any()
    row, column = (light_of(page, 1, (0, 0, *size)) for size in ((0.3, 1e-3), (1e-3, 0.3)))
    alike, striped = (column, row) if layout == "tb-half" else (row, column)
    assert alike.max() == pytest.approx(0.8, abs=3e-3)
    assert striped.max() < 0.22
    context.close()


def test_a_domes_half_and_its_wedges_have_their_areas(browser, start):
    address, _ = start("dome", DOME)
    page = browser.new_page(viewport={"width": 1280, "height": 801})
    page.add_init_script(STILL)
    page.goto(address)
    page.evaluate("at('stage').hidden = false; at('desk').hidden = true")
    rear, front = (0, 0, 1, 0.5), (0, 0.501, 1, 0.499)
    disc = np.pi / 4
    for task, phase, (above, below) in (
        ("null", 0, (0.9, 0)),
        ("null", 1, (0, 0.3)),
        ("match", 0, (0.3, 0)),
        ("match", 1, (0.9 / 4, 0)),
    ):
        primary, colour = ("B", [0, 0, 1]) if task == "null" else ("W", [1, 1, 1])
        show(page, task, "both", primary, 0.9, 0.3, phase)
        for place, code in ((rear, above), (front, below)):
            wanted = code * disc * np.array(colour)
            np.testing.assert_allclose(light_of(page, 0, place), wanted, rtol=4e-3, atol=1e-3)
    page.close()


def test_a_gamepad_turns_and_nobody_is_done_before_turning(browser, start, tmp_path):
    address, _ = start("dome", DOME)
    page = browser.new_page(viewport={"width": 400, "height": 400})
    begun(page, address)
    page.keyboard.press(" ")
    until(page, "shown !== null")
    first = page.evaluate("shown.code")
    page.keyboard.press(" ")
    assert page.evaluate("session.settings.length") == 0

    def pressed(*buttons):
        page.evaluate(
            "buttons => { navigator.getGamepads = () => [{buttons: Array.from({length: 17}, "
            "(_, k) => ({pressed: buttons.includes(k)}))}]; }",
            list(buttons),
        )

    pressed(12)
    until(page, f"shown.code > {first} * 1.05")
    pressed(14)
    high = page.evaluate("shown.code")
    until(page, f"shown.code < {high}")
    pressed()
    set_ = page.evaluate("shown.code")
    pressed(0)
    until(page, "session.settings.length === 1")
    pressed()
    until(page, "shown !== null")
    page.close()
    (kept,) = read_session(tmp_path / "out" / SETTINGS, "dome", load_scene(DOME).digest).settings
    assert (kept.code, kept.base, kept.trial) == (set_, 1, 0)


def level_of(albedo):
    """Reflected light of a rear half, as the page's viewer has it, of this albedo."""
    scene = load_scene(DOME)
    answer = answering_levels(scene, np.full(3, albedo))[0]
    return answer / (1 - answer)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["stereo", "dome"])
def test_a_session_breaks_off_goes_on_and_is_read(browser, start, tmp_path, run, kind):
    name = PAIR if kind == "stereo" else DOME
    shares = LEAKS if kind == "stereo" else {"both": {p: level_of(a) for p, a in ALBEDO.items()}}
    total = len(trials_of(kind))
    address, end = start(kind, name)
    page = browser.new_page(viewport={"width": 1280, "height": 640})
    begun(page, address)
    play(page, total // 2, shares)
    until(page, "listener !== null")
    page.close()
    end()
    kept = read_session(tmp_path / "out" / SETTINGS, kind, load_scene(name).digest)
    assert len(kept.settings) == total // 2
    address, end = start(kind, name)
    page = browser.new_page(viewport={"width": 1280, "height": 640})
    page.goto(address)
    page.get_by_text(f"{total // 2} of {total} settings are kept. We go on there.").wait_for()
    begun(page, address)
    play(page, total, shares)
    page.get_by_text("That was all. Thank you!").first.wait_for()
    page.close()
    end()
    said = run("measure", "by-eye", "--scene", name, "--out", tmp_path / "out", "--json").figures()
    measured = load_scene(tmp_path / "out" / "measured.toml")
    whole = read_session(tmp_path / "out" / SETTINGS, kind, load_scene(name).digest)
    # A ghost that is brighter than the first grey is asked for on a brighter one
    assert any(each.limit for each in whole.settings) == (kind == "stereo")
    assert said["slips"] == 0
    for eye, found in said["eyes"].items():
        truth = list((LEAKS[eye] if kind == "stereo" else ALBEDO).values())
        np.testing.assert_allclose(found["value"], truth, rtol=0.06)
        assert (
            np.abs(np.subtract(found["value"], truth)) < 1.96 * np.array(found["standard_error"])
        ).all()
        np.testing.assert_allclose(found["gammas"], GAMMA, atol=0.03)
    if kind == "dome":
        np.testing.assert_allclose(measured.albedo, said["eyes"]["both"]["value"], rtol=1e-4)
        assert min(measured.reflected_error) > 0
