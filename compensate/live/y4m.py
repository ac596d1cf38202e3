"""YUV4MPEG2 streams (Y4M): what FFmpeg, mplayer and x264 hand on by pipes.

A header says size, rate and sampling, then each frame has a line of its own and its planes. Colour
is BT.709 in limited range, of 8 to 16 bits; where a stream says its range (``XCOLORRANGE=FULL``) it
has to be limited.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames import yuv

MAGIC = b"YUV4MPEG2"
FRAME = b"FRAME"
LONGEST = 256
"""Bytes of a line."""

_MATRIX = 1  # BT.709
_SAMPLING = re.compile(r"(420|422|444)(jpeg|paldv|mpeg2|)(?:p(9|10|12|14|16))?")


@final
@dataclass(frozen=True)
class Y4M:
    """What a stream's header says.

    Parameters
    ----------
    line
        The header, without its end.
    width, height
        Pixels.
    chroma
        "4:2:0", "4:2:2" or "4:4:4".
    bits
        Of a sample.
    """

    line: bytes
    width: int
    height: int
    chroma: str
    bits: int

    @property
    def dtype(self) -> str:
        """Bits of a sample."""
        return "u1" if self.bits == 8 else "<u2"

    @property
    def planes(self) -> tuple[tuple[int, int], ...]:
        """(row, col) of luma and of both colour differences."""
        across = 1 if self.chroma == "4:4:4" else 2
        down = 2 if self.chroma == "4:2:0" else 1
        small = (-(-self.height // down), -(-self.width // across))
        return (self.height, self.width), small, small

    @property
    def size(self) -> int:
        """Bytes of a frame's planes."""
        return sum(rows * cols for rows, cols in self.planes) * np.dtype(self.dtype).itemsize

    def decoded(self, data: bytearray) -> NDArray[np.uint16]:
        """(row, col, RGB) code values of 16 bits."""
        scale = 1 << (self.bits - 8)
        values = np.frombuffer(data, self.dtype).astype(np.float32)
        parts, begin = [], 0
        for shape in self.planes:
            count = shape[0] * shape[1]
            parts.append(values[begin : begin + count].reshape(shape))
            begin += count
        luma = (parts[0] - 16 * scale) / np.float32(219 * scale)
        differences = [
            yuv.full_size((part - 128 * scale) / np.float32(224 * scale), self.chroma, luma.shape)
            for part in parts[1:]
        ]
        pixels = yuv.from_luma(luma, differences[0], differences[1], _MATRIX)
        return np.asarray(np.rint(pixels * 65535), np.uint16)

    def encoded(self, pixels: NDArray[np.uint16]) -> bytes:
        """Planes of (row, col, RGB) code values of 16 bits."""
        codes = yuv.limited_codes(pixels.astype(np.float32) / np.float32(65535), _MATRIX, self.bits)
        planes = [codes[0], *(yuv.small_size(plane, self.chroma) for plane in codes[1:])]
        largest = (1 << self.bits) - 1
        return b"".join(
            np.clip(np.rint(plane), 0, largest).astype(self.dtype).tobytes() for plane in planes
        )


def header_of(line: bytes) -> Y4M:
    """Reads what a header says.

    Raises
    ------
    InputError
        If it is none, or of a sampling that is not known.
    """
    words = line.decode("latin-1").split(" ")
    fields = {word[:1]: word[1:] for word in words[1:] if word}
    if not line.startswith(MAGIC) or not (fields.get("W", "") + fields.get("H", "")).isdecimal():
        raise InputError(
            f"standard input: wanted a Y4M stream, got {line[:24]!r}; write one "
            f"({ADVICE['Y4M'].given()}), or give --size for raw frames"
        )
    if fields.get("I", "p") not in ("p", "?", ""):
        raise InputError(
            f"standard input: wanted whole frames, got interlaced ones (I{fields['I']}); "
            f"deinterlace them first ({ADVICE['whole frames'].given()})"
        )
    sampling = _SAMPLING.fullmatch(fields.get("C", "420jpeg"))
    if sampling is None or any(word == "XCOLORRANGE=FULL" for word in words):
        what = "full range" if sampling else f"C{fields['C']}"
        raise InputError(
            f"standard input: wanted a Y4M stream of 4:2:0, 4:2:2 or 4:4:4 in limited range, got "
            f"{what}; convert it ({ADVICE['Y4M in limited range'].given()})"
        )
    return Y4M(
        line,
        int(fields["W"]),
        int(fields["H"]),
        ":".join(sampling[1]),
        int(sampling[3] or 8),
    )
