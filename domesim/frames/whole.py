"""Writes files whole or not at all."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import secrets
import socket
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

import psutil

from domesim.errors import InputError, NoPlaceError, reason


def write_whole(path: Path, content: bytes) -> None:
    """Put `content` at `path`: under a temporary name beside it, then renamed.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    write_together([(path, content)])


def temporary_of(path: Path) -> Path:
    """A name beside `path` that no other process has, on any machine, while it is written."""
    mark = f"{_machine()}-{os.getpid()}-{secrets.token_hex(2)}"
    return path.with_name(f".{path.stem}.tmp-{mark}{path.suffix}")


def sweep(folder: Path) -> None:
    """Remove what processes of this machine that are gone left half-written in `folder`."""
    for path in folder.glob(".*.tmp-*"):
        match = _TEMPORARY.search(path.name)
        if match and match[1] == _machine() and not psutil.pid_exists(int(match[2])):
            with suppress(OSError):
                path.unlink()


_FULL = (errno.ENOSPC, errno.EDQUOT)
_OF_ONE = (errno.EISDIR, errno.ENAMETOOLONG)

_TEMPORARY = re.compile(r"\.tmp-([0-9a-f]{4})-([0-9]+)-[0-9a-f]{4}(?:\.[^.]*)?$")


@cache
def _machine() -> str:
    return hashlib.sha256(socket.gethostname().encode()).hexdigest()[:4]


def write_together(contents: Sequence[tuple[Path, bytes]]) -> None:
    """Put each content at its path: all under temporary names first, then renamed.

    A full disk or an interruption thus leaves all the old files or, from the first renaming on,
    which takes no space and next to no time, some new ones beside old ones; never half a file.

    Raises
    ------
    InputError
        If one of them cannot be written: `NoPlaceError` if others could not be, either.
    """
    temporaries = [temporary_of(path) for path, _ in contents]
    try:
        for (path, content), temporary in zip(contents, temporaries, strict=True):  # noqa: B007
            with temporary.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        for path, _ in contents:
            # Found by the renaming itself, it would come after others' renaming.
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        for (path, _), temporary in zip(contents, temporaries, strict=True):
            temporary.replace(path)
    except BaseException as error:
        for temporary in temporaries:
            with suppress(OSError):
                temporary.unlink()
        if not isinstance(error, OSError):
            raise
        ways = {
            **dict.fromkeys(_FULL, "Free some space, or write elsewhere"),
            errno.ENOENT: "Create the folder first",
            errno.EISDIR: "Name a file",
        }
        way = ways.get(error.errno or 0, "Choose a folder that can be written to")
        kind = InputError if error.errno in _OF_ONE else NoPlaceError
        raise kind(f"{path}: wanted to write it, got '{reason(error)}'. {way}.") from error
