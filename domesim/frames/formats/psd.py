"""PSD and PSB: the flattened picture that Photoshop stores beside layers.

Of Adobe's *Photoshop File Formats Specification* (2019): file header, image resources, layer and
mask information. OpenImageIO makes its own R, G, B of CMYK, and does not tell whether there is a
flattened picture, or whether it is transparent.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Self, final

from domesim.errors import InputError
from domesim.frames.formats.base import Format
from domesim.frames.integrity import DamagedError, refuse_sides

_MODES = {0: "a bitmap", 2: "indexed colours", 4: "CMYK", 7: "several inks", 8: "duotone", 9: "Lab"}
_VERSION = 1057  # the resource that says whether the flattened picture is one
_LARGE = 2  # the header's version of a PSB
_TRANSPARENT = (b"Mtrn", b"Mt16", b"Mt32")
_WIDE = (b"LMsk", b"Lr16", b"Lr32", b"Layr", b"Alph", b"FMsk", b"lnk2", b"FEid", *_TRANSPARENT)
"""Blocks whose sizes have eight bytes in a PSB."""


@final
@dataclass(frozen=True)
class PSD(Format):
    """Photoshop's; its layers are parts of one picture."""

    starts = (b"8BPS",)
    layered = True

    def examined(self, path: Path, file: BinaryIO) -> Self:
        """Whether there is a flattened picture in R, G, B, without alpha.

        Raises
        ------
        DamagedError, InputError
            If it is cut short; or has none, or one that is transparent or of other colours.
        """
        _, version, _, _, rows, cols, _, mode = _numbers(file, ">4sH6sHIIHH")
        refuse_sides(path, cols, rows)
        got = f"one of {_MODES[mode]}. Save it as RGB" if mode in _MODES else ""
        file.seek(_numbers(file, ">I")[0], 1)
        end = _numbers(file, ">I")[0] + file.tell()
        while file.tell() < end:
            _, kind, name = _numbers(file, ">4sHB")
            file.seek(name | 1, 1)  # the name and its length are even together
            (size,) = _numbers(file, ">I")
            place = file.tell() + size + size % 2
            if kind == _VERSION and not _numbers(file, ">IB")[1]:
                got = "layers alone. Flatten it, or save it with 'Maximize Compatibility'"
            file.seek(place)
        length = ">Q" if version == _LARGE else ">I"
        (size,) = _numbers(file, length)
        if size and not got and _is_transparent(file, file.tell() + size, length):
            got = "a transparent one. Flatten it, or save it as PNG or TIFF"
        if got:
            raise InputError(f"{path}: wanted a flattened picture of R, G, B, got {got}.")
        return replace(self, notes=("flattened, as it was saved",)) if size else self


def _is_transparent(file: BinaryIO, end: int, length: str) -> bool:
    """Whether the flattened picture has an alpha: layers say so, or a block behind them."""
    (size,) = _numbers(file, length)
    layers = file.tell() + size
    if size and _numbers(file, ">h")[0] < 0:
        return True
    file.seek(layers)
    if layers + 4 <= end:
        file.seek(_numbers(file, ">I")[0], 1)  # the global mask
    while file.tell() + 12 <= end:
        _, key = _numbers(file, ">4s4s")
        if key in _TRANSPARENT:
            return True
        (size,) = _numbers(file, length if key in _WIDE else ">I")
        file.seek(size + -size % 4, 1)
    return False


def _numbers(file: BinaryIO, form: str) -> tuple[Any, ...]:
    content = file.read(struct.calcsize(form))
    if len(content) < struct.calcsize(form):
        raise DamagedError("one that ends early")
    return struct.unpack(form, content)
