"""Reading of plain files: no pipes, no devices, none too large for memory."""

from __future__ import annotations

import errno
import io
import os
import stat
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from domesim.errors import InputError
from domesim.host.system import BINARY, CLOEXEC, NONBLOCK

LARGEST = 64 << 20
"""Bytes of a text: a thousand times what tables of readings take."""

ESCAPES = {"\\": "\\\\", "\n": "\\n", "\r": "\\r"}
"""What stands for letters of names in lines of ``sha256sum``."""

KEPT_OPEN = ExitStack()
"""What closes the files that stay open between uses; a command closes it when it ends."""


def open_plain(path: Path, largest: int | None = None) -> io.BufferedReader:
    """Opens a file to be read, and nothing else: a pipe would wait for whoever writes into it.

    Parameters
    ----------
    path
        The file.
    largest
        Bytes that it may have; None for any number.

    Raises
    ------
    InputError
        If it is a pipe or a device, or larger than `largest`.
    OSError
        If there is none, or it cannot be read.
    """
    _require_plain(path, path.stat(), largest)  # devices may do something when they are opened
    handle = os.open(path, os.O_RDONLY | NONBLOCK | CLOEXEC | BINARY)
    try:
        _require_plain(path, os.fstat(handle), largest)
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def _require_plain(path: Path, status: os.stat_result, largest: int | None) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: wanted a file, got a device or pipe. Save it as a file first.")
    if largest is not None and status.st_size > largest:
        raise InputError(
            f"{path}: wanted a file of at most {largest >> 20} MiB, got {status.st_size >> 20}. "
            f"It is probably another one: check the path."
        )


def read_plain(path: Path, largest: int = LARGEST) -> bytes:
    """A file's content.

    Raises
    ------
    InputError
        As for `open_plain`.
    OSError
        If it cannot be read.
    """
    with open_plain(path, largest) as file:
        return file.read()


def written_sums(sums: Mapping[str, str]) -> bytes:
    """A listing of these sums by name, as ``sha256sum`` writes it and checks it (``-c``)."""
    lines = []
    for name, digest in sums.items():
        escaped = "".join(ESCAPES.get(letter, letter) for letter in name)
        mark = "" if escaped == name else "\\"
        lines.append(f"{mark}{digest}  {escaped}\n")
    return "".join(lines).encode("utf-8", "surrogateescape")
