"""The files that this process has open."""

from __future__ import annotations

import gc
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

_KEPT = r"/site-packages/|/\.drjit$"


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
    """Descriptors with their files: no pipes, no devices, and nothing that libraries keep.

    Matplotlib keeps fonts, Dr.Jit the folder of its kernels, whoever was the first to need it.
    """
    found = set()
    for each in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # that of this very look
            target = str(each.readlink())
            if re.match("/(?!dev/|proc/)", target) and not re.search(_KEPT, target):
                found.add(f"{each.name}: {target}")
    return found
