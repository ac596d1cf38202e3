"""Samples of a picture: their types, and what they can hold."""

from __future__ import annotations

from typing import Any

import numpy as np

INTEGER = {"uint8": 8, "uint16": 16}
FLOATING = {"half": 16, "float": 32}
"""Types, as OpenImageIO calls them -> bits."""


def kind_of(bits: int, *, floating: bool) -> str:
    """The type that holds samples of this depth."""
    if floating:
        return "half" if bits == 16 else "float"
    return "uint8" if bits == 8 else "uint16"


def dtype_of(kind: str) -> np.dtype[Any]:
    """NumPy's type for one of OpenImageIO's."""
    return np.dtype({"half": "float16", "float": "float32", "uint": "uint32"}.get(kind, kind))


def code_range(bits: int, *, floating: bool) -> tuple[float, float]:
    """The least and the largest code value that a sample of this depth can hold."""
    if not floating:
        return 0.0, 1.0
    largest = float(np.finfo(np.float16 if bits == 16 else np.float32).max)
    return -largest, largest


def code_span(bits: int, *, legal: bool) -> tuple[int, int]:
    """Integer codes of black and white: all of them, or those of video (ITU-R BT.709-6, 5.6)."""
    return (16 << (bits - 8), 235 << (bits - 8)) if legal else (0, 2**bits - 1)
