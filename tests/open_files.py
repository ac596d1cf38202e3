"""The files that this process has open."""

from __future__ import annotations

import gc
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest


@contextmanager
def nothing_left_open() -> Iterator[None]:
    """Files that are opened meanwhile are closed, though an error holds the frames that did it."""
    before = open_files()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gc, "enable", gc.disable)  # which the command calls
        gc.disable()
        try:
            yield
        finally:
            left = open_files() - before
            patch.undo()
            gc.enable()
            assert not left, left


def open_files() -> set[str]:
    """Descriptors with their files: no pipes and devices, and no fonts that Matplotlib keeps."""
    found = set()
    for each in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # that of this very look
            target = str(each.readlink())
            if re.match("/(?!dev/|proc/)", target) and "/site-packages/" not in target:
                found.add(f"{each.name}: {target}")
    return found
