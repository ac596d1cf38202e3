"""Blend masks of projectors: PNGs of 16 bits of grey, whose codes are shares of light."""

from __future__ import annotations

import io
import warnings
from math import ceil, sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError, reason
from domesim.host.files import read_plain
from domesim.room.theatre import Mask

LARGEST = 1 << 27
"""Bytes of a file that is read."""
_PIXELS = 1 << 25  # those of 8K
_FINEST = 1 << 20
"""Pixels of a mask or warp that are kept: of more some are left out, for a blend is smooth."""
_CODES = 65535
UPLIFT_GAMMA = 2.2
"""Codes of an uplift, which is far below white, are to the power of its inverse."""


def read_mask(path: Path) -> Mask:
    """The mask in a file.

    Raises
    ------
    InputError
        If it cannot be read, or is no grey picture.
    """
    try:
        content = read_plain(path, LARGEST)
    except OSError as error:
        raise InputError(f"{path}: wanted a blend mask, got '{reason(error)}'") from error
    return Mask(grey_of(content, str(path)))


def grey_of(content: bytes, where: str) -> NDArray[np.float64]:
    """(row, col) 0..1: codes of a grey PNG, or of one whose R, G, B are alike; as of `thinned`.

    Raises
    ------
    InputError
        If it is damaged, or in colour.
    """
    shares = shares_of(content, where)
    if shares.ndim == 3:
        if not (shares == shares[..., :1]).all():
            raise InputError(f"{where}: wanted a mask of grey, got colours. Save it as grey")
        shares = shares[..., 0]
    return shares


def shares_of(content: bytes, where: str) -> NDArray[np.float64]:
    """(row, col) or (row, col, 3) 0..1: codes of a PNG as of `thinned`, without any curve.

    Raises
    ------
    InputError
        If it is damaged.
    """
    from PIL import Image  # noqa: PLC0415 - few scenes have masks

    try:
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(content)) as opened:
            if opened.width * opened.height > _PIXELS:
                raise InputError(f"{where}: wanted a mask, got {opened.width} x {opened.height} px")
            # Pillow has 16 bits of grey only
            deep = opened.mode.startswith("I")
            plain = deep or opened.mode in ("L", "1", "RGB", "RGBA")
            codes = thinned(np.asarray(opened if plain else opened.convert("RGB")))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(f"{where}: wanted a PNG of grey, got one that does not read") from error
    codes = codes[..., :3] if codes.ndim == 3 else codes
    return np.asarray(codes / (_CODES if deep else 1 if codes.dtype == bool else 255), np.float64)


def thinned(values: NDArray[Any]) -> NDArray[Any]:
    """At most a million of (row, col, ...) values, evenly spread, in memory of their own."""
    step = ceil(sqrt(max(1, values.shape[0] * values.shape[1] / _FINEST)))
    return values[step // 2 :: step, step // 2 :: step].copy()


def written_mask(weights: NDArray[np.float64]) -> bytes:
    """A PNG of (row, col) weights, 0..1."""
    from PIL import Image  # noqa: PLC0415

    made = io.BytesIO()
    Image.fromarray(np.rint(weights * _CODES).astype(np.uint16)).save(made, "PNG")
    return made.getvalue()
