"""What there is to know of image formats, by the names that OpenImageIO has for them."""

from __future__ import annotations

import numpy as np

LABELS = {
    "openexr": "EXR",
    "png": "PNG",
    "tiff": "TIFF",
    "dpx": "DPX",
    "jpeg": "JPEG",
    "jpeg2000": "JPEG 2000",
    # Read only. Each of these was seen to notice truncation; OpenImageIO also has formats that
    # do not (and one, "null", that makes images up), hence a list.
    "bmp": "BMP",
    "hdr": "HDR",
    "iff": "IFF",
    "jpegxl": "JPEG XL",
    "pnm": "PNM",
    "rla": "RLA",
    "sgi": "SGI",
    "targa": "TGA",
    "webp": "WebP",
}
SUFFIXES = {
    ".exr": "openexr",
    ".png": "png",
    ".tif": "tiff",
    ".tiff": "tiff",
    ".dpx": "dpx",
    ".jpg": "jpeg",
    ".jpeg": "jpeg",
    ".jpe": "jpeg",
    ".jps": "jpeg",  # stereo pairs, which say so: see eyes.py
    ".mpo": "jpeg",
    ".pns": "png",
    ".jp2": "jpeg2000",
    ".j2k": "jpeg2000",
    ".j2c": "jpeg2000",
    ".jpc": "jpeg2000",
}
DEPTHS = {
    "openexr": (16, 32),
    "png": (8, 16),
    "tiff": (8, 10, 12, 16, 32),
    "dpx": (8, 10, 12, 16),
    "jpeg": (8,),
    "jpeg2000": (8, 10, 12, 16),
}
LARGEST_SIDE = 32768
"""Pixels; a header that claims more is taken for damaged, before memory is asked for."""
SQUARE = 0.01
"""By how much a pixel's sides may differ, of 1: ratios are told in few digits."""
INTEGER = {"uint8": 8, "uint16": 16}
FLOATING = {"half": 16, "float": 32}
_LARGEST_HALF = 65504.0
_LARGEST_FLOAT = float(np.finfo(np.float32).max)


def label(name: str) -> str:
    """What people call the format."""
    return LABELS.get(name, name)


def code_range(bits: int, *, floating: bool) -> tuple[float, float]:
    """The least and the largest code value that a sample of this depth can hold."""
    if not floating:
        return 0.0, 1.0
    largest = _LARGEST_HALF if bits == 16 else _LARGEST_FLOAT
    return -largest, largest


def code_span(bits: int, *, legal: bool) -> tuple[int, int]:
    """Integer codes of black and white: all of them, or those of video (ITU-R BT.709-6, 5.6)."""
    return (16 << (bits - 8), 235 << (bits - 8)) if legal else (0, 2**bits - 1)
