"""Radiance HDR: what its header says besides the size (G. Ward, *File Formats*, 1991).

OpenImageIO keeps the last of several exposures, knows no primaries, and turns two of the eight
orders of pixels the wrong way.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any, BinaryIO, Self, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames.colour import ColourTag, primaries_of
from domesim.frames.formats.base import Format
from domesim.frames.messages import one_line

_FORMAT = "32-bit_rle_rgbe"
_LONG_TEXT = 1 << 16  # bytes of a header, for which no limit is published
# Exif's orientation by signs of the outer and the inner axis: rows first, and columns first.
_ROWS = {"-+": 1, "--": 2, "+-": 3, "++": 4}
_COLS = {"+-": 5, "--": 6, "-+": 7, "++": 8}


@final
@dataclass(frozen=True)
class HDR(Format):
    """Radiance's pictures."""

    exposure: tuple[float, ...] = (1.0, 1.0, 1.0)  # by which R, G and B were multiplied
    chromaticities: tuple[float, ...] | None = None  # x, y of red, green, blue and white

    starts = (b"#?",)
    shaped = True

    def examined(self, path: Path, file: BinaryIO) -> Self:
        head, _, rest = file.read(_LONG_TEXT).partition(b"\n\n")
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
        return replace(
            self,
            exposure=tuple(exposure),
            chromaticities=chromaticities,
            aspect=aspect,
            turned=orders.get(signs, 1),
        )

    def _colour(self, path: Path, spec: Any) -> ColourTag:
        if self.chromaticities is None:
            return ColourTag("linear", "BT.709", "assumed for HDR")
        primaries = primaries_of(self.chromaticities)
        if primaries is None:
            raise InputError(
                f"{path}: wanted PRIMARIES of three colours, got "
                f"{' '.join(f'{value:g}' for value in self.chromaticities)}. Correct it, or say "
                "what it is (--encoding)."
            )
        return ColourTag("linear", primaries, "file: PRIMARIES")

    def exposed(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        pixels /= np.array(self.exposure, np.float32)
        return pixels


def _numbers(name: str, value: str, count: int) -> list[float]:
    try:
        numbers = [float(word) for word in value.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(isfinite, numbers)):
        raise ValueError(f"{name} '{one_line(value)}'")
    return numbers
