"""Files that are whole or not there."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path

from domesim.errors import InputError
from domesim.frames.messages import reason


def write_whole(path: Path, content: bytes) -> None:
    """Put `content` at `path`: under a temporary name beside it, then renamed.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    temporary = path.with_name(f".{path.stem}.tmp-{os.getpid()}{path.suffix}")
    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink()
        if not isinstance(error, OSError):
            raise
        ways = {
            errno.ENOSPC: "Free some space, or write elsewhere",
            errno.EDQUOT: "Free some space, or write elsewhere",
            errno.ENOENT: "Create the folder first",
            errno.EISDIR: "Name a file",
        }
        way = ways.get(error.errno or 0, "Choose a folder that can be written to")
        raise InputError(f"{path}: wanted to write it, got '{reason(error)}'. {way}.") from error
