"""The compare page in a browser, for tests."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np


class Viewer:
    """The page in a browser, with the few questions that the tests ask."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.requests: list[str] = []
        self.complaints: list[str] = []
        page.route("**/*", self._take)
        page.on("console", self._listen)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))

    def _take(self, route: Any) -> None:
        self.requests.append(route.request.url)
        route.continue_() if route.request.url.startswith("file:") else route.abort()

    def _listen(self, message: Any) -> None:
        # These are about the tests' own reading
        if not re.search("willReadFrequently|GPU stall due to ReadPixels", message.text):
            self.complaints.append(message.text)

    def open(self, path: Path) -> Viewer:
        self.page.goto(path.as_uri())
        self.page.evaluate("domesimViewer.ready")
        return self

    def used(self, path: Path) -> Iterator[Viewer]:
        """Opens a page, which complains of nothing and asks for nothing else until it is left."""
        self.page.mouse.move(0, 0)
        self.requests.clear()
        self.complaints.clear()
        yield self.open(path)
        assert self.complaints == []
        assert len(self.requests) == 1

    def find(self, name: str) -> Any:
        return self.page.get_by_test_id(name)

    def state(self) -> dict[str, Any]:
        self.page.evaluate("new Promise(requestAnimationFrame)")
        found: dict[str, Any] = self.page.evaluate("domesimViewer.state()")
        return found

    def point(self, row: int, col: int) -> tuple[float, float]:
        """Where a pixel of the picture lies in the window."""
        self.state()
        at = self.page.evaluate("([row, col]) => domesimViewer.toWindow(row, col)", [row, col])
        return at["x"], at["y"]

    def colour(self, row: int, col: int) -> list[int]:
        """The RGBA drawn for a pixel of the picture."""
        x, y = self.point(row, col)
        box = self.find("picture").bounding_box()
        found: list[int] = self.page.evaluate(
            """([x, y]) => {
                const picture = document.getElementById("picture");
                return [...picture.getContext("2d").getImageData(x, y, 1, 1).data];
            }""",
            [int(x - box["x"]), int(y - box["y"])],
        )
        return found


def open_page(browser: Any, path: Path, **settings: Any) -> Iterator[Viewer]:
    page = browser.new_page(**({"viewport": {"width": 1440, "height": 900}} | settings))
    yield from Viewer(page).used(path)
    page.close()


def srgb(light: np.ndarray) -> np.ndarray:
    low = np.clip(light, 0, 1)
    return 255 * np.where(low <= 0.0031308, 12.92 * low, 1.055 * low ** (1 / 2.4) - 0.055)


def assert_shown(viewer: Viewer, light: np.ndarray, row: int, col: int) -> None:
    """The picture shows this light at its present exposure, to half a code and its rounding."""
    predicted = srgb(light[row, col].astype(float) * 2 ** viewer.state()["exposure"])
    np.testing.assert_allclose(viewer.colour(row, col)[:3], predicted, atol=0.6)
