"""Small JSON files that tell whether they are as they were written.

The SHA-256 of all else is kept in the file itself. A disk, a network or a hand that changes a bit
is noticed when the file is read, instead of much later and elsewhere.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from domesim.host.files import read_plain
from domesim.host.writing import write_whole

SEAL = "checksum"
"""The checksum's name in the file."""


def write_sealed(path: Path, content: dict[str, Any]) -> None:
    """Write `content`, whose keys are texts, with its checksum.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    sealed = {**content, SEAL: _checksum(content)}
    write_whole(path, json.dumps(sealed, indent=1, allow_nan=False).encode())


def read_sealed(path: Path) -> dict[str, Any]:
    """Reads what was written.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is not as it was written.
    """
    content = json.loads(read_plain(path))
    if not isinstance(content, dict) or content.pop(SEAL, None) != _checksum(content):
        raise ValueError(f"{path}: wanted a file as it was written, got another checksum")
    return content


def _checksum(content: dict[str, Any]) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
