"""The attributes of an EXR's headers, as they are stored.

OpenImageIO writes neither double vectors and matrices nor types that it does not know, and takes
some attributes for orders (``textureformat``: wait for MIP levels). OpenEXR's own Python bindings
(3.5) write no rational, refuse text that is not UTF-8, and print what they think of damage. So what
is not of the picture itself is carried over as bytes (*OpenEXR File Layout*, openexr.com).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from mmap import mmap
from typing import TypeAlias

import numpy as np

MAGIC = b"v/1\x01"
_MULTI_PART, _LONG_NAMES = 0x1000, 0x400  # of the version field
_BEGIN = 8

COLOUR = (b"chromaticities", b"colorInteropID")
_STRUCTURE = {
    *(b"channels", b"compression", b"dataWindow", b"displayWindow", b"lineOrder", b"type"),
    *(b"name", b"view", b"multiView", b"version", b"chunkCount", b"tiles", b"maxSamplesPerPixel"),
    *(b"dwaCompressionLevel", b"openexr:levelmode", b"openexr:roundingmode"),
}
_OF_OLD_PIXELS = {b"preview", b"textureformat", b"oiio:SHA-1", b"oiio:AverageColor"}

Attributes: TypeAlias = dict[bytes, bytes]
"""Name -> the whole attribute: name, type, size and value."""


def carried_of(content: bytes | mmap) -> tuple[bytes, ...]:
    """Of each part: its attributes that say nothing of how, or what, pixels are stored.

    Raises
    ------
    ValueError
        If the headers are not all there.
    """
    headers, _ = _headers(content)
    left_out = _STRUCTURE | _OF_OLD_PIXELS
    return tuple(
        b"".join(whole for name, whole in header.items() if name not in left_out)
        for header in headers
    )


def attributes_in(carried: bytes) -> Attributes:
    """The attributes that `carried_of` gave of a part."""
    return _attributes(carried + b"\0", 0)[0]


def with_attributes(encoded: bytes, parts: Sequence[Mapping[bytes, bytes]]) -> bytes:
    """The file `encoded` with those attributes in each of its parts, in place of its own."""
    headers, end = _headers(encoded)
    whole = [{**own, **given} for own, given in zip(headers, parts, strict=True)]
    block = b"".join(b"".join(header.values()) + b"\0" for header in whole)
    (version,) = struct.unpack_from("<I", encoded, 4)
    if version & _MULTI_PART:
        block += b"\0"
    if any(len(name) > 31 for header in whole for name in header):
        version |= _LONG_NAMES
    # Behind the headers come the places of all chunks; the first chunk follows them.
    (first,) = struct.unpack_from("<Q", encoded, end)
    places = np.frombuffer(encoded, "<u8", (first - end) // 8, end)
    moved = places + np.uint64(_BEGIN + len(block)) - np.uint64(end)
    start = MAGIC + struct.pack("<I", version)
    return b"".join([start, block, moved.astype("<u8").tobytes(), memoryview(encoded)[first:]])


def _headers(content: bytes | mmap) -> tuple[list[Attributes], int]:
    """Each part's attributes, and where the last header ends."""
    if len(content) < _BEGIN:
        raise ValueError("one that ends early")
    (version,) = struct.unpack_from("<I", content, 4)
    headers: list[Attributes] = []
    position = _BEGIN
    while not headers or (version & _MULTI_PART and content[position : position + 1] != b"\0"):
        header, position = _attributes(content, position)
        headers.append(header)
    return headers, position + bool(version & _MULTI_PART)


def _attributes(content: bytes | mmap, position: int) -> tuple[Attributes, int]:
    """Those from a place on up to the end of their header, and the place behind it."""
    found: Attributes = {}
    while (letter := content[position : position + 1]) != b"\0":
        named = content.find(b"\0", position)
        typed = content.find(b"\0", named + 1)
        if letter == b"" or min(named, typed) < 0 or typed + 5 > len(content):
            raise ValueError("one that ends early")
        (size,) = struct.unpack_from("<I", content, typed + 1)
        end = typed + 5 + size
        if end > len(content):
            raise ValueError("one that ends early")
        found[content[position:named]] = content[position:end]
        position = end
    return found, position + 1
