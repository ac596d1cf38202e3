"""One window for all tests of the page: a new one takes longer than to load the page anew."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from viewer import Viewer


@pytest.fixture(scope="session")
def window(browser: Any) -> Iterator[Viewer]:
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    yield Viewer(page)
    page.close()
