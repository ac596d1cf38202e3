"""SHA-256 sums of files, in the format of ``sha256sum``: of masters, and of results.

Most formats have no checksums of their own: JPEG, JPEG 2000, DPX, TIFF of LZW, EXR of PIZ or DWA,
ProRes. A changed bit makes another picture of them, and their decoders say nothing.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Sequence
from functools import cache, lru_cache
from pathlib import Path

from domesim.errors import InputError, reason
from domesim.frames.video import file_of
from domesim.host.files import ESCAPES, open_plain, read_plain

_LINE = re.compile(r"(\\?)([0-9a-fA-F]{64}) [ *](.+)", re.DOTALL)


def sha256(path: Path) -> str:
    """SHA-256 of a file's content, in hexadecimal digits.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        with open_plain(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: wanted to read it, got '{reason(error)}'") from error


def sum_of(frame: Path) -> str:
    """SHA-256 of the file that holds a frame; a video, which holds many frames, is read once.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    file = file_of(frame)
    try:
        state = file.stat()
    except OSError:
        return sha256(file)  # which says why
    return _known_sum(file, state.st_size, state.st_mtime_ns)


@lru_cache(maxsize=4)
def _known_sum(file: Path, size: int, changed: int) -> str:
    return sha256(file)


def listed_sums(listing: Path, files: Sequence[Path]) -> list[str]:
    """Reads the checksums of a listing, for files or frames of a video.

    Parameters
    ----------
    listing
        Lines of ``sha256sum``; names count from its folder.
    files
        Which.

    Raises
    ------
    InputError
        If it cannot be read, has other lines, two sums of one file, or none of one of `files`.
    """
    place = cache(os.path.realpath)  # of folders, which are few

    def known_as(path: Path) -> str:
        return os.path.join(place(path.parent), path.name)  # noqa: PTH118 - a hundred thousand

    sums: dict[str, str] = {}
    for number, line in enumerate(_lines(listing), 1):
        if not line or line.startswith("#"):
            continue
        match = _LINE.fullmatch(line)
        if match is None:
            raise InputError(
                f"{listing}: wanted lines of sha256sum (64 digits, two spaces, a name), line "
                f"{number} is none. Make it anew (sha256sum show.*.exr > SHA256SUMS)"
            )
        name = _unescaped(match[3]) if match[1] else match[3]
        if sums.setdefault(known_as(listing.parent / name), match[2].lower()) != match[2].lower():
            raise InputError(f"{listing}: wanted one sum of each file, got two of {name}. Mend it")
    missing = [path for path in files if known_as(file_of(path)) not in sums]
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise InputError(
            f"{missing[0]}{more}: wanted a sum in {listing}, got none. Add it (sha256sum NAME, in "
            f"the folder of the sums)"
        )
    return [sums[known_as(file_of(path))] for path in files]


def require_sum(path: Path, wanted: str, actual: str) -> None:
    """Refuses a file whose checksum is not the one listed for it.

    Raises
    ------
    InputError
        If it has another.
    """
    if actual != wanted:
        raise InputError(
            f"{path}: wanted SHA-256 {wanted[:8]}..., as --checksums has it, got {actual[:8]}.... "
            f"The file is damaged, or was changed: copy or render it again"
        )


def _lines(listing: Path) -> list[str]:
    try:
        content = read_plain(listing)
    except OSError as error:
        raise InputError(
            f"{listing}: wanted a file of SHA-256 sums, got '{reason(error)}'. Make it (sha256sum "
            f"show.*.exr > SHA256SUMS), or check the path"
        ) from error
    text = content.decode("utf-8", "surrogateescape")
    return [line.removesuffix("\r") for line in text.split("\n")]


def _unescaped(name: str) -> str:
    known = {escape: letter for letter, escape in ESCAPES.items()}
    return re.sub(r"\\.", lambda found: known.get(found[0], found[0]), name)
