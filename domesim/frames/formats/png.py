"""The chunks of a PNG file: those that speak of colour, and whether those of the picture are whole.

Of the PNG specification, third edition (W3C, 2025): 5.4 chunk types, 8.1 interlacing, 9.1 filters,
11.2.1 IHDR.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any, final

# What libpng knows of colour; OpenImageIO writes its own in their place and loses cHRM.
COLOUR_CHUNKS = (b"cICP", b"sRGB", b"gAMA", b"cHRM", b"mDCV", b"cLLI")
CARRIED_CHUNKS = (b"tEXt", b"zTXt", b"iTXt", b"eXIf", b"tIME", b"pHYs", b"oFFs", b"sCAL")
"""Those that tell of the picture what is true of another one in its place."""
_KEPT = (b"IHDR", b"PLTE", b"iCCP", b"IDAT", b"IEND")


def chunks_of(png: bytes) -> Iterator[tuple[bytes, bytes]]:
    """(type, whole chunk) of each chunk that is entirely there."""
    position = 8
    while position + 12 <= len(png):
        (length,) = struct.unpack_from(">I", png, position)
        end = position + 12 + length
        if end > len(png):
            return
        yield png[position + 4 : position + 8], png[position:end]
        position = end


_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by colour type
_DEPTHS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
# Of Adam7's passes: first column and row, and steps between them.
_PASSES = (
    (0, 0, 8, 8),
    (4, 0, 8, 8),
    (0, 4, 4, 8),
    (2, 0, 4, 4),
    (0, 2, 2, 4),
    (1, 0, 2, 2),
    (0, 1, 1, 2),
)
_CRITICAL = (b"PLTE", b"IDAT", b"IEND")  # and IHDR
_LAST_FILTER = 4
_BLOCK = 1 << 16


@final
class Picture:
    """Whether a PNG's chunks, given one by one, hold all of its picture."""

    def __init__(self) -> None:
        self.sides = (0, 0)  # cols, rows
        self._missing: list[tuple[int, int]] = []  # of passes: bytes of a line, bytes to come
        self._pixels: Any = zlib.decompressobj(wbits=0)  # as large a window as the stream says

    def add(self, kind: bytes, content: bytes) -> None:
        """Take the next chunk.

        Raises
        ------
        ValueError
            If it is impossible, or too little came before the last one. The message says what was
            got.
        """
        if kind == b"IHDR":
            self._begin(content)
        elif not any(self.sides):
            raise ValueError("one that does not begin with IHDR")
        elif not (kind.isalpha() and kind[2:3].isupper()):
            raise ValueError("a chunk of an impossible kind")
        elif kind[:1].isupper() and kind not in _CRITICAL:
            raise ValueError("a chunk that must be understood, of an unknown kind")
        elif kind == b"IDAT":
            for begin in range(0, len(content), _BLOCK):
                self._inflate(content[begin : begin + _BLOCK])
        elif kind == b"IEND" and (self._missing or not self._pixels.eof):
            raise ValueError("one with too few pixels")

    def _begin(self, header: bytes) -> None:
        if len(header) != 13 or any(self.sides):
            raise ValueError("an impossible header")
        cols, rows, depth, colour, compression, filtering, interlacing = struct.unpack(
            ">2I5B", header
        )
        known = depth in _DEPTHS.get(colour, ()) and (compression, filtering) == (0, 0)
        if not known or interlacing not in (0, 1):
            raise ValueError("an impossible header")
        self.sides = cols, rows
        for left, top, across, down in _PASSES if interlacing else ((0, 0, 1, 1),):
            width, height = -(-(cols - left) // across), -(-(rows - top) // down)
            if width > 0 and height > 0:
                line = 1 + (width * depth * _CHANNELS[colour] + 7) // 8
                self._missing.append((line, line * height))

    def _inflate(self, content: bytes) -> None:
        """Look, and forget: libpng will do it again.

        A line at a time, as libpng: else zlib would know what lies behind the window.
        """
        while content and not self._pixels.eof:
            line = self._missing[0][0] if self._missing else _BLOCK
            try:
                inflated = self._pixels.decompress(content, line)
            except zlib.error as error:
                raise ValueError("pixels that do not decode") from error
            while inflated and self._missing:
                inflated = self._follow(inflated)
            content = self._pixels.unconsumed_tail

    def _follow(self, inflated: bytes) -> bytes:
        """Take what is the present pass's, and give the rest."""
        line, missing = self._missing.pop(0)
        present = inflated[:missing]
        if max(present[missing % line :: line], default=0) > _LAST_FILTER:
            raise ValueError("a line with an impossible filter")
        if len(present) < missing:
            self._missing.insert(0, (line, missing - len(present)))
        return inflated[len(present) :]


def chunk(kind: bytes, content: bytes) -> bytes:
    """A whole chunk: length, type, content, checksum."""
    checksum = struct.pack(">I", zlib.crc32(kind + content))
    return struct.pack(">I", len(content)) + kind + content + checksum


def with_colour_chunks(png: bytes, colour: bytes) -> bytes:
    """`png` with the colour chunks `colour` (after IHDR, where they must be) instead of its own."""
    header, *others = [whole for kind, whole in chunks_of(png) if kind not in COLOUR_CHUNKS]
    return b"".join([png[:8], header, colour, *others])


def with_utf8_text(png: bytes) -> bytes:
    """`png` with the text that OpenImageIO writes as UTF-8, but as if it were Latin-1, told so."""
    return png[:8] + b"".join(
        _as_utf8(whole) if kind == b"tEXt" else whole for kind, whole in chunks_of(png)
    )


def with_carried_chunks(png: bytes, carried: bytes) -> bytes:
    """`png` with those chunks, as they were, instead of what it says besides its picture."""
    chunks = [
        (kind, content) for kind, content in chunks_of(png) if kind in (*_KEPT, *COLOUR_CHUNKS)
    ]
    first = next(k for k, (kind, _) in enumerate(chunks) if kind in (b"PLTE", b"IDAT"))
    whole = [content for _, content in chunks]
    return b"".join([png[:8], *whole[:first], carried, *whole[first:]])


def _as_utf8(text: bytes) -> bytes:
    """A chunk tEXt, or iTXt if it must be (PNG specification, 11.3.3)."""
    keyword, _, said = text[8:-4].partition(b"\0")
    return text if said.isascii() else chunk(b"iTXt", keyword + b"\0\0\0\0\0" + said)
