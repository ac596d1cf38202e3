"""The study's page in a browser: whole sessions, and what is left when the browser is killed."""

from __future__ import annotations

import json
import socket
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import psutil
import pytest
from conftest import ARGUMENTS, CHROMIUM
from playwright.sync_api import Error

from domesim.frames import ColourTag, Frame, write_frame
from validation.audience.files import Answers, read_answers, read_study
from validation.audience.playing import server
from validation.audience.rehearsal import attentive

FASTER = "{const slow = window.setTimeout; window.setTimeout = (f, ms) => slow(f, ms / 30);}"
SCENE = "stereo_polarised_paper"


@pytest.fixture
def folder(run, tmp_path):
    """A study of one pair and two methods: 14 trials."""
    colour = ColourTag("srgb", "BT.709", "test")
    for eye, at in (("L", 3), ("R", 7)):
        pixels = np.full((12, 20, 3), 0.1, np.float32)
        pixels[:, at : at + 4] = 0.8
        path = tmp_path / f"bar_{eye}.png"
        write_frame(Frame(pixels, path, colour, 8, floating=False), path)
    out = tmp_path / "study"
    eyes = ("--left", tmp_path / "bar_L.png", "--right", tmp_path / "bar_R.png")
    more = ("--methods", "none,subtractive", "--side-by-side", "--viewers", 3, "--json")
    run("study", "new", *eyes, "--scene", SCENE, "--out", out, *more).figures()
    return out


@pytest.fixture
def address(folder):
    with server(folder, read_study(folder)) as running:
        thread = threading.Thread(target=running.serve_forever, args=(0.05,))
        thread.start()
        yield f"http://127.0.0.1:{running.server_address[1]}/"
        running.shutdown()
        thread.join()


def begin(page, viewer, url):
    page.add_init_script(FASTER)
    page.goto(url)
    page.fill("#viewer", str(viewer))
    page.check("#agreed")
    page.wait_for_selector("#begin:not([disabled])")
    page.click("#begin")
    page.wait_for_selector("#stage.rest")
    page.keyboard.press(" ")


def answered(page):
    return page.evaluate("session.answers.length")


def answer(page, until, keys=("ArrowLeft",)):
    """Press the keys in turn until so many trials are answered."""
    end = time.monotonic() + 20
    while (done := answered(page)) < until:
        assert time.monotonic() < end
        if page.evaluate("listener && listener.actions.includes('go')"):
            page.keyboard.press(" ")
        elif page.evaluate("listener && listener.actions.includes('first')"):
            page.keyboard.press(keys[done % len(keys)])
        page.wait_for_timeout(3)


def kept_before(page):
    """Wait for the next question, which comes when the answer before is kept."""
    while page.evaluate("listener === null"):
        page.wait_for_timeout(3)


@pytest.mark.long
def test_a_session_that_is_killed_goes_on_where_it_was(browser, folder, address, tmp_path):
    study = read_study(folder)
    kind = browser.browser_type
    settings = {"executable_path": CHROMIUM, "args": ARGUMENTS}
    context = kind.launch_persistent_context(tmp_path / "profile", **settings)
    page = context.pages[0]
    begin(page, 2, address)
    answer(page, 7, ("ArrowLeft", "2"))
    kept_before(page)
    (kept,) = read_answers(folder, study)
    assert len(kept.answers) == 7
    ours = [
        one
        for one in psutil.Process().children(recursive=True)
        if str(tmp_path / "profile") in " ".join(one.cmdline()) and "--type=" not in one.cmdline()
    ]
    assert ours
    for one in ours:
        one.kill()
    psutil.wait_procs(ours)
    with pytest.raises(Error, match="closed"):
        context.close()
    # Another profile: what the browser kept is lost, too
    context = kind.launch_persistent_context(tmp_path / "other", **settings)
    page = context.pages[0]
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    page.add_init_script(FASTER)
    page.goto(address)
    page.fill("#viewer", "2")
    page.get_by_text("Viewer 2 has answered 7 of 14 and goes on there.").wait_for()
    begin(page, 2, address)
    assert answered(page) == 7
    answer(page, 14, ("ArrowLeft", "2"))
    page.get_by_text("That was all. Thank you!").first.wait_for()
    page.goto(address)
    page.fill("#viewer", "2")
    page.get_by_text("Viewer 2 is done. Take the next number.").wait_for()
    assert page.is_disabled("#begin")
    context.close()
    assert all(url.startswith((address, "data:")) for url in requests)
    (kept,) = read_answers(folder, study)
    assert [one.choice for one in kept.answers] == [1, 2] * 7
    assert kept.resumed == 1
    assert all(one.seconds is not None for one in kept.answers)


@pytest.mark.long
def test_without_a_server_the_browser_keeps_answers_and_gives_a_file(browser, folder, tmp_path):
    context = browser.new_context()
    page = context.new_page()
    url = (folder / "index.html").as_uri()
    begin(page, 1, url)
    answer(page, 4)
    kept_before(page)
    page.close()
    page = context.new_page()
    begin(page, 1, url)
    assert answered(page) == 4
    with page.expect_download() as download:
        answer(page, 14)
    given = tmp_path / "given.json"
    download.value.save_as(given)
    assert download.value.suggested_filename == "viewer-001.json"
    found = Answers.model_validate_json(given.read_bytes())
    assert [one.choice for one in found.answers] == [1] * 14
    context.close()


def test_pictures_are_the_eyes_own_and_readings_are_compared(browser, folder, address):
    page = browser.new_page()
    page.add_init_script(FASTER)
    page.goto(address)
    white = read_study(folder).white
    page.fill("#white", str(2 * white))
    assert "100 % too bright" in page.inner_text("#reading")
    page.select_option("#meter", "light meter")
    page.fill("#white", str(3.1416 * white))
    page.fill("#black", "0")
    assert "as it should be" in page.inner_text("#reading")
    page.select_option("#layout", "tb-half")
    page.check("#agreed")
    page.wait_for_selector("#begin:not([disabled])")
    page.click("#begin")
    page.wait_for_selector("#stage.rest")
    page.keyboard.press(" ")
    page.wait_for_selector(".eye.right .words.low .sides")
    for eye, end in (("left", "_L.png"), ("right", "_R.png")):
        sources = page.eval_on_selector_all(
            f".eye.{eye} img", "images => images.map(image => image.src)"
        )
        assert len(sources) == 2
        assert all(source.endswith(end) for source in sources)
    first = page.evaluate("STUDY.viewers[0][0].first")
    assert f"{first}_R.png" in sources[0]
    # In both halves of the screen
    boxes = [page.locator(f".eye.{eye}").bounding_box() for eye in ("left", "right")]
    assert boxes[0]["y"] + boxes[0]["height"] == boxes[1]["y"]
    page.evaluate(
        "navigator.getGamepads = () => [{buttons: Array.from({length: 17}, (_, k) => "
        "({pressed: k === 15}))}]"
    )
    answer(page, 1, ("x",))
    kept_before(page)
    page.close()
    (kept,) = read_answers(folder, read_study(folder))
    assert kept.answers[0].choice == 2
    assert kept.white == pytest.approx(white, rel=1e-4)
    assert (kept.layout, kept.black) == ("tb-half", 0)


def test_answers_are_never_lost_to_others(folder, address):
    study = read_study(folder)
    whole = attentive(study, 1, [0, 1], np.random.default_rng(0))

    def post(viewer, answers, **headers):
        request = urllib.request.Request(
            f"{address}answers/{viewer}",
            data=answers.model_dump_json().encode(),
            headers={"Content-Type": "application/json", **headers},
        )
        try:
            with urllib.request.urlopen(request) as reply:
                return reply.status
        except urllib.error.HTTPError as error:
            error.close()
            return error.code

    shorter = whole.model_copy(update={"answers": whole.answers[:5]})
    assert post(1, shorter) == 204
    assert post(1, whole) == 204
    assert post(1, shorter) == 409
    assert post(2, whole) == 409
    assert post(1, whole.model_copy(update={"study": "another"})) == 409
    assert post(1, whole, Origin="http://elsewhere.example") == 400
    with urllib.request.urlopen(f"{address}answers/1") as reply:
        assert len(json.loads(reply.read())["answers"]) == len(whole.answers)
    for path in ("study.json", "pictures/../study.json", "answers/viewer-001.json"):
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(address + path)
        refused.value.close()
        assert refused.value.code == 404


def spoken(address, *lines):
    """What the server says to the lines of a request."""
    host, port = address.removeprefix("http://").rstrip("/").split(":")
    with socket.create_connection((host, int(port)), timeout=20) as line:
        line.sendall("\r\n".join([*lines, "Connection: close", "", ""]).encode())
        reply = b""
        while more := line.recv(4096):
            reply += more
    return reply.decode()


def test_another_sites_page_can_neither_read_nor_write(folder, address):
    """Its own name may lead to this machine (DNS rebinding): the browser then says that name."""
    own = address.removeprefix("http://").rstrip("/")
    assert spoken(address, "GET / HTTP/1.1", f"Host: {own}").startswith("HTTP/1.0 200")
    port = own.partition(":")[2]
    local = spoken(address, "GET / HTTP/1.1", f"Host: localhost:{port}")
    assert local.startswith("HTTP/1.0 200")
    for host in (f"rebound.example:{port}", "127.0.0.1", f"{own}.example", ""):
        said = spoken(address, "GET /answers/1 HTTP/1.1", f"Host: {host}")
        assert said.startswith("HTTP/1.0 400"), host
    said = spoken(address, "GET / HTTP/1.1", f"Host: {own}", "Host: rebound.example")
    assert said.startswith("HTTP/1.0 400")
    said = spoken(address, "GET / HTTP/1.1", f"Host: {own}", "Origin: http://rebound.example")
    assert said.startswith("HTTP/1.0 400")
    # Tags of such a page ask without an origin: the browser keeps what comes from them
    said = spoken(address, "GET / HTTP/1.1", f"Host: {own}")
    for told in ("Resource-Policy: same-origin", "frame-ancestors 'none'", "nosniff"):
        assert told in said


@pytest.mark.parametrize("length", ["-1", "٣", "9" * 30, ""])
def test_a_length_that_is_none_is_refused(folder, address, capfd, length):
    own = address.removeprefix("http://").rstrip("/")
    post = ("POST /answers/1 HTTP/1.1", f"Host: {own}", f"Content-Length: {length}")
    assert spoken(address, *post).startswith("HTTP/1.0 400")
    assert capfd.readouterr().err == ""


def test_only_the_pages_own_script_runs(browser, folder, address):
    """A script that somebody put into a page, by a name or a question, does not run."""
    page = browser.new_page()
    for where in (address, (folder / "index.html").as_uri()):
        page.goto(where)
        assert page.evaluate("typeof STUDY") == "object"
        page.evaluate(
            "{const more = document.createElement('script'); more.textContent = 'injected = 1';"
            "document.body.append(more);}"
        )
        assert page.evaluate("typeof injected") == "undefined"
    page.close()
