"""PNG: chunks that speak of colour or of eyes, and whether those of the picture are whole.

Of the PNG specification, third edition (W3C, 2025): 5.4 chunk types, 8.1 interlacing, 9.1 filters,
11.2.1 IHDR.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Self, TypeAlias, final

from isal import isal_zlib
from isal.igzip_lib import IsalError
from numpy.typing import NDArray

from domesim.frames.colour import (
    ColourTag,
    chromaticities_of,
    code_points_of,
    interop_named,
    is_sayable,
    is_srgb,
    primaries_of,
)
from domesim.frames.eyes import SIDE_BY_SIDE, Eyes
from domesim.frames.formats.base import (
    Format,
    Piece,
    Target,
    animated,
    colour_of_exif,
    encode,
    index_of,
)
from domesim.frames.formats.png_pixels import compressed
from domesim.frames.integrity import DamagedError, refuse_sides

_START = b"\x89PNG\r\n\x1a\n"
# What libpng knows of colour; OpenImageIO writes its own in their place and loses cHRM.
_COLOUR = (b"cICP", b"sRGB", b"gAMA", b"cHRM", b"mDCV", b"cLLI")
_CARRIED = (b"tEXt", b"zTXt", b"iTXt", b"eXIf", b"tIME", b"pHYs", b"oFFs", b"sCAL")
_EXIF, _SPACE = 0x8769, 0xA001  # Exif's directory, and its ColorSpace
_KEPT = (b"IHDR", b"PLTE", b"iCCP", b"IDAT", b"IEND")


@final
@dataclass(frozen=True)
class PNG(Format):
    """Portable Network Graphics; .pns is a stereo pair, which says so."""

    colour_chunks: bytes = b""  # whole ones
    carried: bytes = b""  # others that tell of the picture what is true of another in its place

    starts = (_START,)
    channels = "alpha"
    straight = "always"
    largest_ratio = 1100.0

    def examined(self, path: Path, file: BinaryIO) -> Self:
        """Check all that there is up to IEND.

        libpng would notice most damage, too, but it prints to stderr, does not miss an IEND, and
        only skips a damaged colour chunk.
        """
        return self._followed(path, file)

    def introduced(self, path: Path, file: BinaryIO) -> Self:
        """Not inflated, which takes most of the time."""
        return self._followed(path, file, until=b"IDAT")

    def _followed(self, path: Path, file: BinaryIO, until: bytes = b"") -> Self:
        """Check all chunks up to IEND, or before the first of a kind."""
        colour, carried, picture, eyes = b"", b"", _Picture(), None
        others = [_START]  # than those of pixels
        for kind, content, checksum in _read_chunks(file, until):
            if kind == until:
                break
            if isal_zlib.crc32(content, isal_zlib.crc32(kind)) != checksum:
                name = kind.decode("ascii", "replace")
                raise DamagedError(f"a wrong checksum in chunk {name!r}")
            picture.add(kind, content)
            if kind == b"acTL":
                raise animated(path)
            if kind == b"sTER":
                eyes = _eyes_of(bytes(content))
            if kind == b"IHDR":
                refuse_sides(path, *picture.sides)
            if kind not in (b"IDAT", b"IEND"):
                others.append(chunk(kind, content))
            if kind in _COLOUR:
                colour += others[-1]
            if kind in _CARRIED:
                carried += others[-1]
            if kind == b"IEND":
                break
        else:
            raise DamagedError("one that ends early")
        said = replace(self, colour_chunks=colour, carried=carried, eyes=eyes)
        return said if until else replace(said, stored_anew=picture.anew(others))

    def _colour(self, path: Path, spec: Any) -> ColourTag:
        chunks = dict(chunks_of(_START + self.colour_chunks))
        if b"sRGB" in chunks:  # overrides gAMA and cHRM (PNG specification, third edition, 4.3)
            return ColourTag("srgb", "BT.709", "file: sRGB")
        gamma = spec.get_string_attribute("oiio:ColorSpace")
        # 0 means nothing (PNG specification, 11.3.2.2).
        known = interop_named(path, gamma) if any(chunks.get(b"gAMA", b"")[8:-4]) else None
        transfer = known[0] if known else "srgb"
        sources = ["gAMA"] if known else []
        primaries = "BT.709"
        if b"cHRM" in chunks:
            white_first = [
                value / 100000 for value in struct.unpack_from(">8I", chunks[b"cHRM"], 8)
            ]
            named = primaries_of(white_first[2:] + white_first[:2])
            if named is None:
                sources.append("primaries assumed, its chromaticities are no colours")
            else:
                primaries = named
                sources.append("cHRM")
        if not sources and (found := self._of_exif()) is not None:
            return found
        source = f"file: {', '.join(sources)}" if sources else "assumed for PNG"
        return ColourTag(transfer, primaries, source)

    def _of_exif(self) -> ColourTag | None:
        """What Exif says, which OpenImageIO does not tell."""
        from PIL import Image  # noqa: PLC0415 - few files have it

        chunks = dict(chunks_of(_START + self.carried))
        if b"eXIf" not in chunks:
            return None
        exif = Image.Exif()
        try:
            exif.load(bytes(chunks[b"eXIf"][8:-4]))
            return colour_of_exif(exif.get_ifd(_EXIF).get(_SPACE, 0), index_of(exif))
        except (ValueError, SyntaxError, OSError, struct.error):  # of damage
            return None

    def encoded(self, path: Path, spec: Any, samples: NDArray[Any]) -> bytes:
        """One line by OpenImageIO, for the header, and all compressed by all cores."""
        spec.height = spec.full_height = 1
        chunks = list(chunks_of(encode(path, self, spec, samples[:1])))
        first = next(k for k, (kind, _) in enumerate(chunks) if kind == b"IDAT")
        cols, _, kinds = struct.unpack(">2I5s", chunks[0][1][8:-4])
        header = chunk(b"IHDR", struct.pack(">2I5s", cols, len(samples), kinds))
        before = [whole for _, whole in chunks[1:first]]
        after = [whole for kind, whole in chunks[first:] if kind != b"IDAT"]
        picture = _of_pieces(b"IDAT", compressed(samples))
        return b"".join([_START, header, *before, *picture, *after])

    def stated_eyes(self, eyes: Eyes | None) -> bytes:
        """Chunk sTER, which knows one packing."""
        if eyes is None or eyes.packing != SIDE_BY_SIDE:
            return b""
        return chunk(b"sTER", bytes([not eyes.right_first]))

    def finished(self, content: bytes, path: Path, target: Target) -> bytes:
        colour = colour_chunks(target.colour)
        if target.keeps_colour and (target.same or target.said.get("ICCProfile") is not None):
            colour = self.colour_chunks
        chunks: _Chunks = list(chunks_of(content))
        if target.same:
            chunks = _with_carried(chunks, self.carried)
        else:
            chunks = [(kind, _as_utf8(kind, each)) for kind, each in chunks]
        return _joined(_with_colour(chunks, colour + self.stated_eyes(target.eyes)))


def colour_chunks(colour: ColourTag) -> bytes:
    """What a PNG says of its colour."""
    if is_srgb(colour):
        return b"" if colour.assumed else chunk(b"sRGB", b"\0")
    chunks = b""
    if colour.managed:
        return chunks
    if is_sayable(colour):
        chunks += chunk(b"cICP", bytes((*code_points_of(colour), 0, 1)))
    gamma = {"linear": "1", "dcdm": "2.6"}.get(colour.transfer)
    if gamma is None and colour.transfer.startswith("gamma"):
        gamma = colour.transfer.removeprefix("gamma")
    if gamma is not None:
        chunks += chunk(b"gAMA", struct.pack(">I", round(100000 / float(gamma))))
    xy = chromaticities_of(colour.primaries)
    if xy is not None and min(xy) >= 0:  # cHRM has no sign, and so not AP0
        white_first = [round(100000 * value) for value in (*xy[6:], *xy[:6])]
        chunks += chunk(b"cHRM", struct.pack(">8I", *white_first))
    return chunks


def _eyes_of(content: bytes) -> Eyes:
    """What a chunk sTER says (*Extensions to the PNG Specification* 1.4, 2.2); 0: crossed eyes."""
    if content not in (b"\0", b"\1"):
        raise ValueError("a chunk sTER of an unknown mode")
    return Eyes(SIDE_BY_SIDE, content == b"\0", "sTER")


# Chunks.


def chunks_of(png: bytes) -> Iterator[tuple[bytes, memoryview[int]]]:
    """(type, whole chunk) of each chunk that is entirely there."""
    position, view = len(_START), memoryview(png)
    while position + 12 <= len(png):
        (length,) = struct.unpack_from(">I", png, position)
        end = position + 12 + length
        if end > len(png):
            return
        yield png[position + 4 : position + 8], view[position:end]
        position = end


def _read_chunks(file: BinaryIO, until: bytes) -> Iterator[tuple[bytes, memoryview[int], int]]:
    """(type, content, checksum) of chunks that are entirely there; `until` one, without content."""
    end = file.seek(0, os.SEEK_END)
    file.seek(len(_START))
    while len(head := file.read(8)) == 8:
        length, kind = struct.unpack(">I4s", head)
        if file.tell() + length + 4 > end:
            return
        if kind == until:
            yield kind, memoryview(b""), 0
        content = memoryview(file.read(length + 4))
        yield kind, content[:-4], int.from_bytes(content[-4:])


def chunk(kind: bytes, content: Piece) -> bytes:
    """A whole chunk: length, type, content, checksum."""
    return b"".join(_of_pieces(kind, [content]))


def _of_pieces(kind: bytes, pieces: Sequence[Piece]) -> list[Piece]:
    """A whole chunk, in pieces."""
    length, checksum = 0, isal_zlib.crc32(kind)
    for piece in pieces:
        length += len(piece)
        checksum = isal_zlib.crc32(piece, checksum)
    return [length.to_bytes(4), kind, *pieces, checksum.to_bytes(4)]


_Chunks: TypeAlias = "list[tuple[bytes, Piece]]"


def with_colour_chunks(png: bytes, colour: bytes) -> bytes:
    """`png` with the colour chunks `colour` instead of its own."""
    return _joined(_with_colour(list(chunks_of(png)), colour))


def _with_colour(chunks: _Chunks, colour: bytes) -> _Chunks:
    """The chunks with those of `colour` (after IHDR, where they must be) instead of their own."""
    header, *others = [each for each in chunks if each[0] not in _COLOUR]
    return [header, (b"", colour), *others]


def _with_carried(chunks: _Chunks, carried: bytes) -> _Chunks:
    """The chunks with those, as they were, instead of what they say besides the picture."""
    chunks = [each for each in chunks if each[0] in (*_KEPT, *_COLOUR)]
    first = next(k for k, (kind, _) in enumerate(chunks) if kind in (b"PLTE", b"IDAT"))
    return [*chunks[:first], (b"", carried), *chunks[first:]]


def _joined(chunks: _Chunks) -> bytes:
    return b"".join([_START, *(whole for _, whole in chunks)])


def _as_utf8(kind: bytes, text: Piece) -> Piece:
    """A chunk, tEXt as iTXt if it must be: OpenImageIO writes UTF-8 in it (PNG, 11.3.3)."""
    if kind != b"tEXt":
        return text
    keyword, _, value = bytes(text)[8:-4].partition(b"\0")
    return text if value.isascii() else chunk(b"iTXt", keyword + b"\0\0\0\0\0" + value)


# The picture.

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
_MOST_KEPT = 1 << 29  # bytes of pixels
_DEFLATED, _LONGEST = b"\x78\x01", 0xFFFF  # begin of a stream, bytes of a block (RFC 1950, 1951)
_NO_MORE = b"\x01\x00\x00\xff\xff"  # a last block, of nothing
_WHOLE_WINDOW = 7  # in a stream's first byte: 32 kB (RFC 1950, 2.2)


@final
class _Picture:
    """Whether a PNG's chunks, given one by one, hold all of its picture."""

    def __init__(self) -> None:
        self.sides = (0, 0)  # cols, rows
        self._missing: list[tuple[int, int]] = []  # of passes: bytes of a line, bytes to come
        self._pixels: Any = None
        self._step = _LONGEST
        self._inflated: list[bytes] | None = []

    def add(self, kind: bytes, content: memoryview[int]) -> None:
        """Take the next chunk: not if it is impossible, or too little came before the last one."""
        if kind == b"IHDR":
            self._begin(content)
        elif not any(self.sides):
            raise DamagedError("one that does not begin with IHDR")
        elif not (kind.isalpha() and kind[2:3].isupper()):
            raise DamagedError("a chunk of an impossible kind")
        elif kind[:1].isupper() and kind not in _CRITICAL:
            raise DamagedError("a chunk that must be understood, of an unknown kind")
        elif kind == b"IDAT":
            for begin in range(0, len(content), _LONGEST):
                self._inflate(content[begin : begin + _LONGEST])
        elif kind == b"IEND" and (self._missing or not self._pixels.eof):
            raise DamagedError("one with too few pixels")

    def _begin(self, header: memoryview[int]) -> None:
        if len(header) != 13 or any(self.sides):
            raise DamagedError("an impossible header")
        cols, rows, depth, colour, compression, filtering, interlacing = struct.unpack(
            ">2I5B", header
        )
        known = depth in _DEPTHS.get(colour, ()) and (compression, filtering) == (0, 0)
        if not known or interlacing not in (0, 1):
            raise DamagedError("an impossible header")
        self.sides = cols, rows
        for left, top, across, down in _PASSES if interlacing else ((0, 0, 1, 1),):
            width, height = -(-(cols - left) // across), -(-(rows - top) // down)
            if width > 0 and height > 0:
                line = 1 + (width * depth * _CHANNELS[colour] + 7) // 8
                self._missing.append((line, line * height))
        if sum(missing for _, missing in self._missing) > _MOST_KEPT:
            self._inflated = None

    def anew(self, others: Sequence[bytes]) -> tuple[Piece, ...]:
        """The whole PNG, its pixels not compressed: libpng inflates three times as slowly.

        Nothing of a large one.
        """
        if self._inflated is None:
            return ()
        blocks: list[Piece] = [_DEFLATED]
        summed = 1
        for piece in self._inflated:
            summed = isal_zlib.adler32(piece, summed)
            for begin in range(0, len(piece), _LONGEST):
                block = memoryview(piece)[begin : begin + _LONGEST]
                blocks += (struct.pack("<BHH", 0, len(block), len(block) ^ _LONGEST), block)
        blocks += (_NO_MORE, summed.to_bytes(4))
        return (*others, *_of_pieces(b"IDAT", blocks), chunk(b"IEND", b""))

    def _inflate(self, content: Piece) -> None:
        """Look at what libpng will see."""
        if self._pixels is None:
            self._pixels = isal_zlib.decompressobj()
            if content[0] >> 4 < _WHOLE_WINDOW:
                # ISA-L would not mind what reaches back too far. Nor would zlib, if it were not
                # given a line at a time, as by libpng
                self._pixels, self._step = zlib.decompressobj(wbits=0), self._missing[0][0]
        inflated = b"."
        while inflated and not self._pixels.eof:
            try:
                inflated = self._pixels.decompress(content, self._step)
            except (zlib.error, IsalError) as error:  # type: ignore[misc]  # as its stub has it
                raise DamagedError("pixels that do not decode") from error
            content, left = self._pixels.unconsumed_tail, inflated
            if self._inflated is not None:
                self._inflated.append(inflated)
            while left and self._missing:
                left = self._follow(left)

    def _follow(self, inflated: bytes) -> bytes:
        """Take what is the present pass's, and give the rest."""
        line, missing = self._missing.pop(0)
        present = inflated[:missing]
        if max(present[missing % line :: line], default=0) > _LAST_FILTER:
            raise DamagedError("a line with an impossible filter")
        if len(present) < missing:
            self._missing.insert(0, (line, missing - len(present)))
        return inflated[len(present) :]
