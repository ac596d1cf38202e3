"""BMP: of 32 bits, the fourth byte is an alpha only by an alpha mask (BITMAPV4HEADER, Windows).

OpenImageIO takes any fourth byte for alpha, and knows no masks but of 16 bits; Pillow knows both.
"""

from __future__ import annotations

import io
import struct
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, Self, final

from domesim.frames.formats.base import Format
from domesim.frames.integrity import DamagedError, refuse_sides

_HEADER = 30  # bytes, as far as the bits of a pixel


@final
@dataclass(frozen=True)
class BMP(Format):
    """Windows' bitmaps."""

    starts = (b"BM",)

    def examined(self, path: Path, file: BinaryIO) -> Self:
        """Stored anew by Pillow, if it is of 32 bits."""
        content = file.read()
        if len(content) < _HEADER or struct.unpack_from("<H", content, 28) != (32,):
            return self
        cols, rows = struct.unpack_from("<2i", content, 18)
        refuse_sides(path, cols, abs(rows))
        from PIL import Image  # noqa: PLC0415 - few masters are BMPs

        anew = io.BytesIO()
        try:
            with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(content)) as old:
                old.save(anew, "BMP")
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            raise DamagedError("one that does not decode") from error
        return replace(self, stored_anew=(anew.getvalue(),))
