"""JPEG XL: whether it moves, and how its colours and alpha go together (ISO/IEC 18181-1, annex D).

OpenImageIO tells neither: of an animation it gives the last frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, Self, final

from domesim.frames.formats.base import Format, animated
from domesim.frames.integrity import DamagedError

_CODESTREAM, _BOXES = b"\xff\x0a", b"\0\0\0\x0cJXL \r\n\x87\n"
_HEAD = 1 << 16
_SIZE = ((0, 1, 9), (0, 1, 13), (0, 1, 18), (0, 1, 30))  # how `_Bits.number` reads a number
_DEPTH = ((8,), (10,), (12,), (0, 1, 6))
_FLOATING = ((32,), (16,), (24,), (0, 1, 6))
_COUNT = ((0,), (1,), (0, 2, 4), (0, 1, 12))
_KIND = ((0,), (1,), (0, 2, 4), (0, 18, 6))
_SHIFT = ((0,), (3,), (4,), (0, 1, 3))
_NAME = ((0,), (0, 0, 4), (0, 16, 5), (0, 48, 10))
_ALPHA = 0


@final
@dataclass(frozen=True)
class JPEGXL(Format):
    """JPEG XL; its alpha is straight unless it says otherwise."""

    starts = (_CODESTREAM, _BOXES)

    def examined(self, path: Path, file: BinaryIO) -> Self:
        moves, associated = _told(_codestream(file.read(_HEAD)))
        if moves:
            raise animated(path)
        return replace(self, unassociated=not associated)


def _codestream(content: bytes) -> bytes:
    """The codestream, or its first part, as far as it is there."""
    place = 0
    while not content.startswith(_CODESTREAM) and place + 8 <= len(content):
        size, kind = int.from_bytes(content[place : place + 4]), content[place + 4 : place + 8]
        long = 8 if size == 1 else 0
        size = int.from_bytes(content[place + 8 : place + 16]) if long else size
        if kind in (b"jxlc", b"jxlp"):
            content = content[place + 8 + long + (4 if kind == b"jxlp" else 0) :]
            break
        place += max(size, 8) if size else len(content)
    if not content.startswith(_CODESTREAM):
        raise DamagedError("one without a picture")
    return content


class _Bits:
    """Numbers of a header, bit by bit."""

    def __init__(self, content: bytes) -> None:
        self._left, self._bits = 8 * len(content), int.from_bytes(content, "little")

    def take(self, count: int) -> int:
        self._left -= count
        if self._left < 0:
            raise DamagedError("one that ends early")
        value, self._bits = self._bits & ((1 << count) - 1), self._bits >> count
        return value

    def number(self, ways: tuple[tuple[int, ...], ...]) -> int:
        """Two bits choose a constant, or what is added to some bits."""
        way = ways[self.take(2)]
        return way[0] if len(way) == 1 else way[1] + self.take(way[2])

    def size(self) -> None:
        small = self.take(1)
        _ = self.take(5) if small else self.number(_SIZE)
        if not self.take(3):
            _ = self.take(5) if small else self.number(_SIZE)

    def depth(self) -> None:
        floating = self.take(1)
        self.number(_FLOATING if floating else _DEPTH)
        if floating:
            self.take(4)


def _told(codestream: bytes) -> tuple[bool, bool]:
    """Whether it is an animation; and whether colours are multiplied by alpha."""
    bits = _Bits(codestream[2:4096])
    bits.size()
    if bits.take(1):  # all as usual
        return False, False
    if bits.take(1):  # more fields
        bits.take(3)  # orientation
        if bits.take(1):  # size as it is meant
            bits.size()
        if bits.take(1):
            raise ValueError("one with a preview")
        if bits.take(1):
            return True, False
    bits.depth()
    bits.take(1)
    for _ in range(bits.number(_COUNT)):
        if bits.take(1):  # straight alpha of 8 bits
            return False, False
        kind = bits.number(_KIND)
        bits.depth()
        bits.number(_SHIFT)
        bits.take(8 * bits.number(_NAME))
        if kind == _ALPHA:
            return False, bool(bits.take(1))
        break  # others have fields of their own
    return False, False
