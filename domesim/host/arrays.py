"""Arrays in a .npz file with its format's name and a checksum."""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from domesim.errors import InputError
from domesim.host.files import open_plain
from domesim.host.writing import write_whole


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write `arrays`, one of which is called "format", and their checksum; whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **arrays, sha256=_digest(arrays))
    write_whole(path, content.getvalue())


def read_arrays(path: Path, wanted: str, kind: str, names: tuple[str, ...]) -> dict[str, Any]:
    """Reads the arrays that `write_arrays` wrote.

    Parameters
    ----------
    path
        The file.
    wanted
        The "format" that it must have.
    kind
        What such a file is called: "transport".
    names
        Names of the arrays that it must have, besides "format".

    Raises
    ------
    InputError
        If it cannot be read, is of another format, or damaged.
    """
    none = f"{path}: wanted a {kind} stored by 'domesim tabulate', this is none or damaged"
    try:
        # Of a damaged file NumPy would leave its own handle open.
        with open_plain(path, _LARGEST) as file:
            _require_sizes(path, file)
            with np.load(file, allow_pickle=False) as stored:
                if "format" not in stored.files:
                    raise InputError(none)
                if (written := str(stored["format"])) != wanted:
                    raise InputError(f"{path}: wanted format {wanted!r}, got {written:.40}")
                if not {"sha256", *names} <= set(stored.files):
                    raise InputError(none)
                arrays = {name: stored[name] for name in stored.files}
        digest = str(arrays.pop("sha256"))
    except InputError:
        raise
    except OSError as error:
        reason = error.strerror or "not a .npz file"
        raise InputError(f"{path}: wanted a stored {kind}, got '{reason}'") from error
    except Exception as error:  # whatever NumPy, zipfile and zlib run into
        raise InputError(none) from error
    if digest != _digest(arrays):
        raise InputError(f"{path}: is damaged (its checksum does not fit); tabulate it again")
    return arrays


_LARGEST = 256 << 30  # bytes of a transport that memory might hold
_FEWEST = 1 << 12  # bytes of a short text
_FEW = 1 << 27  # bytes that any machine has
_PACKED = 16  # times that numbers of a transport are packed, at most; zeros are a thousand times


def _require_sizes(path: Path, file: BinaryIO) -> None:
    """Refuse a file whose directory says that it becomes much more than it is."""
    with zipfile.ZipFile(file) as package:
        sizes = {entry.filename: entry.file_size for entry in package.infolist()}
    if max(sizes.get(f"{name}.npy", 0) for name in ("format", "sha256")) > _FEWEST:
        raise ValueError("a long text")
    size = sum(sizes.values())
    packed = file.seek(0, os.SEEK_END)
    file.seek(0)
    if size > max(_FEW, _PACKED * packed):
        raise InputError(
            f"{path}: wanted arrays of at most {max(_FEW, _PACKED * packed) >> 20} MiB in a file "
            f"of {packed >> 20}, got {size >> 20}. It is damaged, or none of domesim's."
        )


def _digest(arrays: Mapping[str, Any]) -> str:
    digest = hashlib.sha256()
    for name in arrays:
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return digest.hexdigest()
