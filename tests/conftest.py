"""What holds for all tests."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# Before NumPy loads: threads that wait for each other on busy cores make small matrices ten times
# slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# PyTorch's would spin where every core has a test to run.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# The product must work without the extra `fast`; tests of it turn it on.
os.environ["DOMESIM_FAST"] = "0"

# A test fails for everybody or for nobody; `--hypothesis-profile default` looks at other examples.
settings.register_profile("same", derandomize=True, deadline=None)  # nor by a clock
settings.load_profile("same")

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


def pytest_configure() -> None:
    """Stop where no path can be traced: many tests do."""
    from domesim.pathtrace.llvm import lacking  # noqa: PLC0415 - after the settings above

    if fault := lacking():
        raise pytest.UsageError(fault)


@pytest.fixture
def hangup() -> Iterator[None]:
    """A lost terminal ends what is started, though it be under nohup, which has it ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str]) -> Callable[..., Any]:
    """The command in this process."""
    from command_line import outcome_of  # noqa: PLC0415 - loads NumPy

    return lambda *arguments: outcome_of(capfd, *arguments)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Where its results go; not there yet."""
    return tmp_path / "results"


@pytest.fixture
def small_disk(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path]:
    """A file system of 64 KiB, or of the parameter; with an open file it cannot be unmounted."""
    place = tmp_path / "disk"
    place.mkdir()
    size = getattr(request, "param", "64k")
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("may not mount a file system")
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    if not CHROMIUM:
        reason = "no chromium, chromium-browser or google-chrome on the PATH"
        if os.environ.get("DOMESIM_REQUIRE_BROWSER") == "1":
            pytest.fail(f"{reason}, and DOMESIM_REQUIRE_BROWSER=1")
        pytest.skip(reason)
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - only where a browser is

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield chromium
        chromium.close()


@pytest.fixture(scope="session")
def window(browser: Any) -> Iterator[Any]:
    """One window for all tests of the page: a new one takes longer than to load the page anew."""
    from viewer import Viewer  # noqa: PLC0415 - NumPy comes with it

    page = browser.new_page(viewport={"width": 1440, "height": 900})
    yield Viewer(page)
    page.close()
