"""The chunks of a PNG file, among them those that speak of colour."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

# What libpng knows of colour; OpenImageIO writes its own in their place and loses cHRM.
COLOUR_CHUNKS = (b"cICP", b"sRGB", b"gAMA", b"cHRM", b"mDCV", b"cLLI")


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


def chunk(kind: bytes, content: bytes) -> bytes:
    """A whole chunk: length, type, content, checksum."""
    checksum = struct.pack(">I", zlib.crc32(kind + content))
    return struct.pack(">I", len(content)) + kind + content + checksum


def with_colour_chunks(png: bytes, colour: bytes) -> bytes:
    """`png` with the colour chunks `colour` (after IHDR, where they must be) instead of its own."""
    header, *others = [whole for kind, whole in chunks_of(png) if kind not in COLOUR_CHUNKS]
    return b"".join([png[:8], header, colour, *others])
