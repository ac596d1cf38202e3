"""TIFF: whether all tags are there, compressions that OpenImageIO does not read, and DCDMs.

libtiff notices missing pixels, but drops a tag (an ICC profile at the end, say) in silence. What it
does not unpack is stored anew, as ZIP. Strips and tiles (TIFF 6.0, sections 3 and 15) are unpacked
and packed again as they are: what a predictor made of the samples stays, and all other tags. Of ZIP
with reversed bits (FillOrder 2) OpenImageIO takes the bits as they come.
"""

from __future__ import annotations

import lzma
import os
import re
import struct
import sys
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Self, final

import numpy as np
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames import icc
from domesim.frames.colour import ColourTag, primaries_of, unsupported_encoding
from domesim.frames.formats.base import Format, Target, camera_raw
from domesim.frames.integrity import DamagedError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

_COMPRESSION, _FILL_ORDER, _EXIF = 259, 266, 34665
_KIND, _PHOTOMETRIC, _SUB_DIRECTORIES, _DNG = 254, 262, 330, 50706
_REDUCED = 1  # of `_KIND`
_SENSOR = {32803, 34892}  # photometrics: a colour filter's, linear raw
_CURVE, _WHITE, _PRIMARIES = 301, 318, 319  # TransferFunction, WhitePoint, PrimaryChromaticities
_RATIONAL = 5  # a type
_MOST = 6  # numbers of a tag of rationals that is read
_COLS, _ROWS, _BITS, _ROWS_PER_STRIP, _PLANAR = 256, 257, 258, 278, 284
_TILE_COLS, _TILE_ROWS = 322, 323
_PLACES, _SIZES = (273, 324), (279, 325)  # of strips, of tiles
_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
_NAMES = {1: "B", 2: "B", 3: "H", 4: "I", 6: "b", 7: "B", 13: "I", 16: "Q", 18: "Q"}
_ZIP, _ZSTD, _LZMA = (8, 32946), 50000, 34925
_LARGEST_RATIO = 40_000
"""Unpacked bytes a byte of file: ZSTD makes a strip of one colour as small as this."""

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
_LARGEST = 1 << 27
"""Bytes of an unpacked strip: of 4096 x 4096 in half, all in one."""

_LACKING = re.compile(
    r"(\w+) compression support is not configured|Compression (scheme \d+) .*not implemented"
)
"""What libtiff says of a compression that it was built without."""
_LOSSLESS = ("none", "lzw", "packbits", "zip")
_DCDM_BITS = 12  # in 16 (DCI DCSS, 3.2.2)


@final
@dataclass(frozen=True)
class TIFF(Format):
    """Tagged Image File Format, BigTIFF too."""

    starts = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
    channels = "alpha"
    straight = "either"
    largest_ratio = 1100.0
    exif = True
    storage = ("tiff:.*",)

    primaries: str | None = None  # by PrimaryChromaticities
    curve: str | None = None  # by TransferFunction; "" for none that has a name

    def examined(self, path: Path, file: BinaryIO) -> Self:
        tiff = _File(file)
        if tiff.is_raw():
            raise camera_raw(path)
        primaries, curve = tiff.colour()
        return replace(self, stored_anew=tiff.stored_anew(), primaries=primaries, curve=curve)

    def _colour(self, path: Path, spec: Any) -> ColourTag:
        """By TIFF's own tags (TIFF 6.0, section 20), where there is no Exif."""
        found = super()._colour(path, spec)
        if not found.assumed or (self.curve, self.primaries) == (None, None):
            return found
        if self.curve == "":
            raise unsupported_encoding(path, "another TransferFunction")
        said = ["TransferFunction"] * bool(self.curve) + ["PrimaryChromaticities"] * bool(
            self.primaries
        )
        source = f"file: {', '.join(said)}" + ("" if self.curve else f"; curve {found.source}")
        curve, primaries = self.curve or found.transfer, self.primaries or found.primaries
        return ColourTag(curve, primaries, source)

    def explain(self, path: Path, problem: str) -> None:
        lacking = _LACKING.search(problem)
        if lacking is not None:
            raise InputError(
                f"{path}: wanted a TIFF of LZW, ZIP, ZSTD, LZMA, PackBits, JPEG or no compression, "
                f"got {lacking[1] or f'compression {lacking[2]}'}. It is not damaged: save it with "
                f"LZW or ZIP ({ADVICE['plain TIFF'].given()})."
            )

    def is_padded(self, path: Path, rgb: NDArray[Any], bits: int, colour: ColourTag) -> bool:
        """As a DCDM's is; ask where nobody says so: sRGB has no reason for 12 bits in 16."""
        if rgb.dtype != np.uint16 or not (colour.assumed or colour.transfer == "dcdm"):
            return False
        used = np.bitwise_or.reduce(rgb, axis=None)
        if colour.assumed and used & 0xF0 and not used & 0x0F:
            raise InputError(
                f"{path}: wanted to know what its code values are, got 12 bits in 16, as a DCDM's "
                "X'Y'Z', and no word of it. Add --encoding dcdm, or --encoding srgb (or what it "
                "is) if it is none."
            )
        return colour.transfer == "dcdm" and bits == 16 and not used & 0x0F

    def fitting_depth(self, bits: int, transfer: str, *, floating: bool) -> int:
        if transfer == "dcdm":
            return _DCDM_BITS
        # Few programs read TIFFs of 10 and 12 bits.
        return 32 if floating else 8 if bits <= 8 else 16

    def is_floating(self, bits: int) -> bool:
        return bits == 32

    def pads(self, bits: int, transfer: str) -> bool:
        return transfer == "dcdm" and bits == _DCDM_BITS

    def state_storage(self, spec: Any, target: Target) -> None:
        compression = target.said.get("compression") if target.same else None
        spec.attribute("compression", compression if compression in _LOSSLESS else "zip")
        if target.kinds[0] == "half":
            spec.attribute("tiff:half", 1)


class _Entry(NamedTuple):
    """One tag of a directory: its place in the file, and type, number and place of its values."""

    place: int
    kind: int
    number: int
    offset: int


_Tags = Mapping[int, _Entry]


@final
class _File:
    """A TIFF, and how its numbers are written."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._size = file, os.fstat(file.fileno()).st_size
        start = file.read(4)
        self._order = "<" if start[:2] == b"II" else ">"
        self._big = start[2:] in (b"+\0", b"\0+")
        self._word = "Q" if self._big else "I"
        self._canon = file.read(6)[4:] == b"CR"

    def _read(self, form: str, place: int) -> tuple[int, ...]:
        count = struct.calcsize(self._order + form)
        self._require(place, count)
        self._file.seek(place)
        return struct.unpack(self._order + form, self._file.read(count))

    def _require(self, place: int, count: int) -> None:
        if place + count > self._size:
            raise DamagedError(f"one that ends early, at {self._size} bytes")

    def _directories(self) -> Iterator[_Tags]:
        """All directories, the picture's first; that all their values are there is seen to."""
        head, entry = ("Q", "HHQQ") if self._big else ("H", "HHII")
        room, length = struct.calcsize(f"={self._word}"), struct.calcsize(f"={entry}")
        begins = list(self._read(self._word, 8 if self._big else 4))
        seen = {0}
        while begins:
            if (begin := begins.pop()) in seen:
                continue
            seen.add(begin)
            (count,) = self._read(head, begin)
            begin += struct.calcsize(f"={head}")
            self._require(begin, count * length)
            tags = {}
            for place in range(begin, begin + count * length, length):
                tag, *fields = self._read(entry, place)
                tags[tag] = _Entry(place, *fields)
                size = tags[tag].number * _BYTES.get(tags[tag].kind, 0)
                if size > room:
                    self._require(tags[tag].offset, size)
                elif tag == _EXIF:
                    begins.append(tags[tag].offset)
            begins += self._values(tags, _SUB_DIRECTORIES)
            begins += self._read(self._word, begin + count * length)
            yield tags

    def _values(self, tags: _Tags, tag: int) -> tuple[int, ...]:
        """Values of a tag of integers; none if there is no such tag."""
        place, kind, number, offset = tags.get(tag, (0, 0, 0, 0))
        name = _NAMES.get(kind)
        if name is None or number > self._size:
            return ()
        form, room = f"{number}{name}", struct.calcsize(f"={self._word}")
        inline = struct.calcsize(f"={form}") <= room
        return self._read(form, place + 4 + room if inline else offset)

    def colour(self) -> tuple[str | None, str | None]:
        """Primaries and curve that the picture's own tags state: see `TIFF`."""
        tags: _Tags = next(self._directories(), {})
        places = [*self._rationals(tags, _PRIMARIES), *self._rationals(tags, _WHITE)]
        table, bits = np.array(self._values(tags, _CURVE), float), self._first(tags, _BITS, 8)
        curve = None
        if len(table) in (1 << bits, 3 << bits) and bits in (8, 16):
            light = table[: 1 << bits][:: (1 << bits) // 256 + (bits > 8)] / 65535
            curve = icc.curve_of(light) or ""
        named = primaries_of(places) if len(places) == 8 else None
        return None if named == "BT.709" else named, curve

    def _rationals(self, tags: _Tags, tag: int) -> list[float]:
        """Values of a tag of rationals; none if there is no such tag."""
        _, kind, number, offset = tags.get(tag, (0, 0, 0, 0))
        if kind != _RATIONAL or number > _MOST:
            return []
        parts = self._read(f"{2 * number}I", offset)
        return [
            above / below for above, below in zip(parts[::2], parts[1::2], strict=True) if below
        ]

    def is_raw(self) -> bool:
        """Whether it is a camera's: what stands first is a preview, or has a colour filter's light.

        By DNG 1.7, TIFF/EP and Canon's marker; others have a larger picture behind the first.
        """
        each: list[_Tags] = [*self._directories(), {}]
        first = each[0]
        if _DNG in first or self._canon or self._first(first, _KIND, 0) & _REDUCED:
            return True
        sides = [self._first(tags, _COLS, 0) * self._first(tags, _ROWS, 0) for tags in each]
        light = [self._first(tags, _PHOTOMETRIC, 0) for tags in each]
        return not _SENSOR.isdisjoint(light) or (
            _SUB_DIRECTORIES in first and max(sides) > sides[0]
        )

    def stored_anew(self) -> tuple[bytes, ...]:
        """The TIFF with its strips as ZIP; nothing if it can be read as it is."""
        tags: _Tags = [*self._directories(), {}][0]
        compression = self._first(tags, _COMPRESSION, 1)
        backward = self._first(tags, _FILL_ORDER, 1) == 2
        if not (compression in (_ZSTD, _LZMA) or (backward and compression in _ZIP)):
            return ()
        names = [pair for pair in zip(_PLACES, _SIZES, strict=True) if pair[0] in tags]
        if len(names) != 1:
            raise ValueError("one without strips")
        places, sizes = (self._values(tags, each) for each in names[0])
        if len(places) != len(sizes):
            raise ValueError("one without strips")
        wanted = self._sizes(tags, len(places))
        if sum(wanted) > _LARGEST_RATIO * self._size:
            raise ValueError(f"{self._size} bytes for {sum(wanted)}")
        self._file.seek(0)
        content = self._file.read()
        made, moved, packed = bytearray(content), [], []
        for place, stored, size in zip(places, sizes, wanted, strict=True):
            strip = content[place : place + stored]
            if len(strip) < stored:
                raise ValueError("one that ends early")
            strip = strip.translate(_REVERSED) if backward else strip
            anew = zlib.compress(_unpacked(strip, size, compression), 1)
            moved.append(len(made))
            packed.append(len(anew))
            made += anew
        for name, values in zip(names[0], (moved, packed), strict=True):
            self._put(made, tags[name].place, 16 if self._big else 4, values)
        self._put(made, tags[_COMPRESSION].place, 3, [_ZIP[0]])
        if _FILL_ORDER in tags:
            self._put(made, tags[_FILL_ORDER].place, 3, [1])
        return (bytes(made),)

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

    def _first(self, tags: _Tags, tag: int, usual: int) -> int:
        return next(iter(self._values(tags, tag)), usual)

    def _sizes(self, tags: _Tags, count: int) -> list[int]:
        """Bytes of each of so many strips or tiles, unpacked."""
        cols, rows = self._first(tags, _COLS, 0), self._first(tags, _ROWS, 0)
        bits = self._values(tags, _BITS) or (1,)
        apart = self._first(tags, _PLANAR, 1) == 2
        sample = bits[0] if apart else sum(bits)
        if _TILE_COLS in tags and _TILE_ROWS in tags:
            across, down = self._first(tags, _TILE_COLS, 0), self._first(tags, _TILE_ROWS, 0)
            return [-(-across * sample // 8) * down] * count
        each = min(self._first(tags, _ROWS_PER_STRIP, rows), rows)
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
