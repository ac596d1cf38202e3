"""What the header of a Radiance HDR says besides its size (G. Ward, *File Formats*, 1991).

OpenImageIO keeps the last of several exposures, knows no primaries, and turns two of the eight
orders of pixels the wrong way.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import isfinite
from typing import final

from domesim.frames.messages import one_line

_FORMAT = "32-bit_rle_rgbe"
# Exif's orientation by signs of the outer and the inner axis: rows first, and columns first.
_ROWS = {"-+": 1, "--": 2, "+-": 3, "++": 4}
_COLS = {"+-": 5, "--": 6, "-+": 7, "++": 8}


@final
@dataclass(frozen=True)
class Radiance:
    """What a header says.

    Parameters
    ----------
    exposure
        By which R, G and B were multiplied.
    chromaticities
        x, y of red, green, blue and white; None if it does not say.
    pixel_aspect
        Width of a pixel by its height.
    orientation
        Exif's number.
    """

    exposure: tuple[float, float, float]
    chromaticities: tuple[float, ...] | None
    pixel_aspect: float
    orientation: int


def header_of(start: bytes) -> Radiance:
    """What is said up to the picture.

    Raises
    ------
    ValueError
        If it is not of R, G, B, or a number is none. The message says what was got.
    """
    head, _, rest = start.partition(b"\n\n")
    exposure, chromaticities, aspect = [1.0, 1.0, 1.0], None, 1.0
    for line in head.decode("latin-1").splitlines():
        name, _, value = line.partition("=")
        if name.strip() == "FORMAT" and value.strip() != _FORMAT:
            raise ValueError(f"one of {one_line(value)}")
        if name in ("EXPOSURE", "COLORCORR"):
            factors = _numbers(name, value, 1 if name == "EXPOSURE" else 3) * 3
            exposure = [old * new for old, new in zip(exposure, factors, strict=False)]
        if name == "PIXASPECT":  # height by width
            aspect /= _numbers(name, value, 1)[0]
        if name == "PRIMARIES":
            chromaticities = tuple(_numbers(name, value, 8))
    if not all(0 < factor < float("inf") for factor in (*exposure, aspect)):
        raise ValueError("an exposure that is not above 0")
    size = re.match(rb"([-+])([XY]) +\d+ +([-+])[XY]", rest)
    signs = "" if size is None else (size[1] + size[3]).decode()
    orders = _COLS if size is not None and size[2] == b"X" else _ROWS
    red, green, blue = exposure
    return Radiance((red, green, blue), chromaticities, aspect, orders.get(signs, 1))


def _numbers(name: str, value: str, count: int) -> list[float]:
    try:
        numbers = [float(word) for word in value.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(isfinite, numbers)):
        raise ValueError(f"{name} '{one_line(value)}'")
    return numbers
