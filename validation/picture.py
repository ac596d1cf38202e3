"""The README's picture: the demo's compare page in a dark room, photographed by Chromium.

``python -m validation.picture out/demo/compare.html validation/picture.png``
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

_QUIET = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")


def photograph(page: Path, picture: Path) -> None:
    """Split view of untouched and perceptual, two stops up; the Milky Way is perceptual."""
    browser_path = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path, args=list(_QUIET))
        view = browser.new_page(viewport={"width": 1440, "height": 900}, color_scheme="dark")
        view.goto(page.resolve().as_uri())
        view.wait_for_function("window.domesimViewer && window.domesimViewer.ready")
        view.wait_for_timeout(1500)
        view.get_by_test_id("exposure").fill("2")
        view.mouse.move(653, 450)
        view.mouse.down()
        view.mouse.move(455, 450, steps=8)
        view.mouse.up()
        view.mouse.move(690, 330)
        view.mouse.down()
        view.mouse.up()
        view.wait_for_timeout(500)
        view.screenshot(path=picture)
        browser.close()


if __name__ == "__main__":
    photograph(Path(sys.argv[1]), Path(sys.argv[2]))
