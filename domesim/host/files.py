"""Reading of plain files: no pipes, no devices, none too large for memory."""

from __future__ import annotations

import stat
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from domesim.errors import InputError

LARGEST = 64 << 20
"""Bytes of a text: a thousand times what tables of readings take."""

ESCAPES = {"\\": "\\\\", "\n": "\\n", "\r": "\\r"}
"""What stands for letters of names in lines of ``sha256sum``."""

KEPT_OPEN = ExitStack()
"""What closes the files that stay open between uses; a command closes it when it ends."""


def size_of_plain(path: Path, largest: int) -> int:
    """A file's size, bytes.

    Raises
    ------
    InputError
        If it is a pipe or a device, or larger than `largest`.
    OSError
        If there is none.
    """
    status = path.stat()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
        raise InputError(f"{path}: wanted a file, got a device or pipe. Save it as a file first.")
    if status.st_size > largest:
        raise InputError(
            f"{path}: wanted a file of at most {largest >> 20} MiB, got {status.st_size >> 20}. "
            f"It is probably another one: check the path."
        )
    return status.st_size


def read_plain(path: Path, largest: int = LARGEST) -> bytes:
    """A file's content.

    Raises
    ------
    InputError
        As for `size_of_plain`.
    OSError
        If it cannot be read.
    """
    size_of_plain(path, largest)
    return path.read_bytes()


def written_sums(sums: Mapping[str, str]) -> bytes:
    """A listing of these sums by name, as ``sha256sum`` writes it and checks it (``-c``)."""
    lines = []
    for name, digest in sums.items():
        escaped = "".join(ESCAPES.get(letter, letter) for letter in name)
        mark = "" if escaped == name else "\\"
        lines.append(f"{mark}{digest}  {escaped}\n")
    return "".join(lines).encode("utf-8", "surrogateescape")
