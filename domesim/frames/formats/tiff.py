"""TIFFs that are compressed in a way that OpenImageIO does not read: stored anew, as ZIP.

Strips and tiles (TIFF 6.0, sections 3 and 15) are unpacked and packed again as they are: what a
predictor made of the samples stays, and all other tags. Of ZIP with reversed bits (FillOrder 2)
OpenImageIO takes the bits as they come.
"""

from __future__ import annotations

import lzma
import struct
import sys
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

_COMPRESSION, _FILL_ORDER = 259, 266
_COLS, _ROWS, _BITS, _ROWS_PER_STRIP, _PLANAR = 256, 257, 258, 278, 284
_TILE_COLS, _TILE_ROWS = 322, 323
_PLACES, _SIZES = (273, 324), (279, 325)  # of strips, of tiles
_NAMES = {1: "B", 2: "B", 3: "H", 4: "I", 6: "b", 7: "B", 13: "I", 16: "Q", 18: "Q"}
_ZIP, _ZSTD, _LZMA = (8, 32946), 50000, 34925
_LARGEST_RATIO = 40_000
"""Unpacked bytes a byte of file: ZSTD makes a strip of one colour as small as this."""

UNREAD = (_ZSTD, _LZMA)
"""Compressions that OpenImageIO does not read."""

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_LARGEST = 1 << 27
"""Bytes of an unpacked strip: of 4096 x 4096 in half, all in one."""


@final
@dataclass(frozen=True)
class Entry:
    """One tag of a directory.

    Parameters
    ----------
    place
        Of its twelve bytes (twenty in BigTIFF).
    kind
        Type of its values.
    values
        These, if they are integers.
    """

    place: int
    kind: int
    values: tuple[int, ...]


def stored_anew(content: bytes) -> bytes | None:
    """The TIFF with its strips as ZIP; None if it can be read as it is.

    Raises
    ------
    ValueError
        If it cannot be unpacked. The message says what was got.
    """
    try:
        file = _File(content)
        tags = file.directory()
        compression = _first(tags, _COMPRESSION, 1)
        backward = _first(tags, _FILL_ORDER, 1) == 2
        if not (compression in UNREAD or (backward and compression in _ZIP)):
            return None
        names = [pair for pair in zip(_PLACES, _SIZES, strict=True) if pair[0] in tags]
        if len(names) != 1 or names[0][1] not in tags:
            raise ValueError("one without strips")
        ((places, sizes),) = names
        if len(tags[places].values) != len(tags[sizes].values):
            raise ValueError("one without strips")
        strips = []
        for place, size in zip(tags[places].values, tags[sizes].values, strict=True):
            strip = content[place : place + size]
            if len(strip) < size:
                raise ValueError("one that ends early")
            strips.append(strip.translate(_REVERSED) if backward else strip)
        return file.with_strips(tags, (places, sizes), strips, compression)
    except struct.error as error:
        raise ValueError("one that ends early") from error


def _first(tags: Mapping[int, Entry], tag: int, usual: int) -> int:
    values = tags[tag].values if tag in tags else ()
    return values[0] if values else usual


@final
class _File:
    """A TIFF's bytes, and how its numbers are written."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._order = "<" if content[:2] == b"II" else ">"
        self._big = content[2:4] in (b"+\0", b"\0+")
        self._word = "Q" if self._big else "I"

    def _read(self, form: str, place: int) -> tuple[int, ...]:
        return struct.unpack_from(self._order + form, self._content, place)

    def directory(self) -> dict[int, Entry]:
        """The first directory."""
        (begin,) = self._read(self._word, 8 if self._big else 4)
        (count,) = self._read("Q" if self._big else "H", begin)
        head, length = (8, 20) if self._big else (2, 12)
        tags = {}
        for place in range(begin + head, begin + head + count * length, length):
            tag, kind = self._read("HH", place)
            (number,) = self._read(self._word, place + 4)
            name = _NAMES.get(kind)
            values: tuple[int, ...] = ()
            if name is not None and number <= len(self._content):
                size = struct.calcsize(f"={number}{name}")
                inline = place + 4 + struct.calcsize(f"={self._word}")
                fits = size <= struct.calcsize(f"={self._word}")
                values = self._read(
                    f"{number}{name}", inline if fits else self._read(self._word, inline)[0]
                )
            tags[tag] = Entry(place, kind, values)
        return tags

    def with_strips(
        self, tags: Mapping[int, Entry], names: tuple[int, int], strips: list[bytes], how: int
    ) -> bytes:
        """The file with these strips, of compression `how`, as ZIP behind all that it had."""
        made = bytearray(self._content)
        places, sizes = [], []
        wanted = _sizes(tags, len(strips))
        if sum(wanted) > _LARGEST_RATIO * len(self._content):
            raise ValueError(f"{len(self._content)} bytes for {sum(wanted)}")
        for strip, size in zip(strips, wanted, strict=True):
            packed = zlib.compress(_unpacked(strip, size, how), 1)
            places.append(len(made))
            sizes.append(len(packed))
            made += packed
        for name, values in zip(names, (places, sizes), strict=True):
            self._put(made, tags[name].place, 16 if self._big else 4, values)
        self._put(made, tags[_COMPRESSION].place, 3, [_ZIP[0]])
        if _FILL_ORDER in tags:
            self._put(made, tags[_FILL_ORDER].place, 3, [1])
        return bytes(made)

    def _put(self, made: bytearray, place: int, kind: int, values: list[int]) -> None:
        """Give the tag at `place` other values, behind the file if they do not fit."""
        packed = struct.pack(f"{self._order}{len(values)}{_NAMES[kind]}", *values)
        room = struct.calcsize(f"={self._word}")
        if len(packed) > room:
            made += bytes(len(made) % 2)
            at = len(made)
            made += packed
            packed = struct.pack(self._order + self._word, at)
        struct.pack_into(f"{self._order}H{self._word}", made, place + 2, kind, len(values))
        inline = place + 4 + room
        made[inline : inline + room] = packed.ljust(room, b"\0")


def _sizes(tags: Mapping[int, Entry], count: int) -> list[int]:
    """Bytes of each of so many strips or tiles, unpacked."""
    cols, rows = _first(tags, _COLS, 0), _first(tags, _ROWS, 0)
    bits = tags[_BITS].values if _BITS in tags else (1,)
    apart = _first(tags, _PLANAR, 1) == 2
    sample = bits[0] if apart else sum(bits)
    if _TILE_COLS in tags and _TILE_ROWS in tags:
        across, down = _first(tags, _TILE_COLS, 0), _first(tags, _TILE_ROWS, 0)
        return [-(-across * sample // 8) * down] * count
    each = min(_first(tags, _ROWS_PER_STRIP, rows), rows)
    if not each:
        raise ValueError("one without strips")
    plane = -(-rows // each)
    line = -(-cols * sample // 8)
    return [line * min(each, rows - each * (k % plane)) for k in range(count)]


def _unpacked(strip: bytes, size: int, how: int) -> bytes:
    """The `size` bytes that a strip becomes."""
    if not 0 < size <= _LARGEST:
        raise ValueError(f"strips of {size} bytes")
    each: Any = zlib.decompressobj()
    if how == _LZMA:
        each = lzma.LZMADecompressor(memlimit=_LARGEST * 2)
    if how == _ZSTD:
        each = zstd.ZstdDecompressor(options={zstd.DecompressionParameter.window_log_max: 27})
    try:
        unpacked: bytes = each.decompress(strip, size)
    except (lzma.LZMAError, zlib.error, zstd.ZstdError, EOFError) as error:
        raise ValueError("strips that do not decode") from error
    if len(unpacked) < size:
        raise ValueError("strips that end early")
    return unpacked
