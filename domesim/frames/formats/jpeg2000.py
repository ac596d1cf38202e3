"""JPEG 2000: what OpenImageIO does not check, read or keep (ITU-T T.800, annexes A and I).

A file is a codestream (.j2k), or boxes around one (.jp2). A codestream tells its meaning only by a
digital-cinema profile: then it is X'Y'Z' (SMPTE ST 429-4). Boxes hold the colour, and metadata.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Self, final

import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)

from domesim.errors import InputError
from domesim.frames.colour import ColourTag
from domesim.frames.formats.base import Format, Target

_SIGNATURE = bytes.fromhex("0000000c6a5020200d0a870a")
_CODESTREAM = b"\xff\x4f\xff\x51"  # SOC, and SIZ
_COMMENT, _TILE, _END = b"\xff\x64", b"\xff\x90", b"\xff\xd9"  # COM, SOT, EOC
_CINEMA = (3, 4)  # Rsiz of the 2K and the 4K profile
_HIGH_THROUGHPUT = 0x4000  # of Rsiz (ITU-T T.814, A.2)
_SRGB, _GREY = 16, 17  # EnumCS
_PREMULTIPLIED = 2  # of cdef's types
_DEPTHS = (8, 10, 12, 16)
_CINEMA_BITS, _CINEMA_SUFFIX = 12, ".j2c"
_LEAST_SIDE = 32  # OpenJPEG's encoder halves it five times


@final
@dataclass(frozen=True)
class JPEG2000(Format):
    """JPEG 2000, written losslessly: .jp2 with boxes, others as a codestream without a profile.

    But a .j2c of X'Y'Z' as a DCP has it: of 12 bits, with the profile of digital cinema, and no
    more bytes than 250 Mbit/s are at 24 frames a second.
    """

    boxes: bytes = b""  # without that of the codestream
    comments: bytes = b""  # whole marker segments
    cinema: bool = False  # with a profile of digital cinema, which is lossy

    starts = (_SIGNATURE, _CODESTREAM)
    wanted = "R, G, B at 8, 10, 12 or 16 bits"
    channels = "alpha"
    straight = "always"

    def examined(self, path: Path, file: BinaryIO) -> Self:
        """OpenImageIO decodes it when it is opened: what is wrong must be found before."""
        content = file.read()
        cinema, comments = is_cinema(content), comments_of(content)
        boxes = _metadata_of(content)
        # cdef: channel, type, association.
        channels = _inside(_inside(boxes, b"jp2h"), b"cdef")[2:]
        kinds = [
            kind for _, kind, _ in struct.iter_unpack(">3H", channels[: len(channels) // 6 * 6])
        ]
        straight = _PREMULTIPLIED not in kinds
        return replace(self, cinema=cinema, comments=comments, boxes=boxes, unassociated=straight)

    def _colour(self, path: Path, spec: Any) -> ColourTag:
        if self.cinema:
            return ColourTag("dcdm", "XYZ", "file: digital-cinema profile")
        stated = _enumerated(self.boxes) == _SRGB
        return ColourTag("srgb", "BT.709", "file: sRGB" if stated else "assumed for JPEG 2000")

    def aimed_at(
        self, path: Path, colour: ColourTag, sides: tuple[int, ...], bits: int | None
    ) -> Self:
        if min(sides) < _LEAST_SIDE:
            raise InputError(
                f"{path}: wanted {_LEAST_SIDE} px a side or more for a JPEG 2000, got "
                f"{sides[1]} x {sides[0]}. Choose another format."
            )
        cinema = path.suffix.lower() == _CINEMA_SUFFIX and colour.transfer == "dcdm"
        if cinema and bits not in (None, _CINEMA_BITS):
            raise InputError(
                f"{path}: wanted 12 bits for X'Y'Z' of a DCP, got {bits}. Leave it out."
            )
        return replace(self, cinema=cinema, depths=(_CINEMA_BITS,) if cinema else self.depths)

    def is_reduced(self) -> bool:
        return self.cinema

    def state_storage(self, spec: Any, target: Target) -> None:
        if self.cinema:
            profile = "Cinema2K" if spec.width <= 2048 and spec.height <= 1080 else "Cinema4K"
            spec.attribute(f"jpeg2000:{profile}", oiio.TypeDesc("uint"), 24)

    def encoder_suffix(self, path: Path) -> str:
        """By it the encoder chooses between boxes and a codestream."""
        return ".jp2" if path.suffix.lower() == ".jp2" else ".j2k"

    def finished(self, content: bytes, path: Path, target: Target) -> bytes:
        if self.cinema and not is_cinema(content):
            cols, rows = struct.unpack_from(">2I", content, 8)
            raise InputError(
                f"{path}: wanted at most 4096 x 2160 px for a DCP's codestream (.j2c of X'Y'Z'), "
                f"got {cols} x {rows}. Crop it, or write .tif or .j2k."
            )
        if target.same:
            content = with_comments(content, self.comments)
        if path.suffix.lower() == ".jp2" and self.boxes:
            content = _with_metadata(content, self.boxes, colour_holds=target.keeps_colour)
        return content


def is_cinema(content: bytes) -> bool:
    """Whether the codestream in a file has a digital-cinema profile.

    Raises
    ------
    ValueError
        If the codestream is not all there; or OpenImageIO would make something else of it: it
        stretches subsampled channels, shifts signed ones, loses what has an offset, and makes an
        RGB of its own of YCbCr. Or if it is HTJ2K, whose decoder prints what it thinks of damage.
        The message says what was got.
    """
    codestream = _codestream_of(content)
    if not codestream.startswith(_CODESTREAM) or len(codestream) < 42:
        raise ValueError("one without a picture")
    if not codestream.rstrip(b"\0").endswith(_END):
        raise ValueError("one that ends early")
    profile, _, _, left, top = struct.unpack_from(">H4I", codestream, 6)
    (count,) = struct.unpack_from(">H", codestream, 40)
    if len(codestream) < 42 + 3 * count:
        raise ValueError("one that ends early")
    channels = set(struct.iter_unpack("3B", codestream[42 : 42 + 3 * count]))
    if profile & _HIGH_THROUGHPUT:
        raise ValueError("HTJ2K")
    if len(channels) != 1 or (left, top) != (0, 0):
        raise ValueError("channels of several kinds, or an offset")
    ((depth, *steps),) = channels
    if depth + 1 not in _DEPTHS or steps != [1, 1]:
        raise ValueError(f"channels of {depth % 128 + 1} bits, signed, or subsampled")
    model = _enumerated(_metadata_of(content))
    if model not in (None, _SRGB, _GREY):
        raise ValueError(f"colour space {model}")
    return profile in _CINEMA


def boxes_of(content: bytes) -> Iterator[tuple[bytes, bytes, bytes]]:
    """(type, whole box, what is in it) of each box that is entirely there."""
    position = 0
    while position + 8 <= len(content):
        length, kind = struct.unpack_from(">I4s", content, position)
        header = 8
        if length == 1 and position + 16 <= len(content):
            (length,) = struct.unpack_from(">Q", content, position + 8)
            header = 16
        end = position + length if length else len(content)
        if not position + header <= end <= len(content):
            return
        yield kind, content[position:end], content[position + header : end]
        position = end


def _metadata_of(content: bytes) -> bytes:
    """All boxes of a .jp2 but the codestream; nothing of a .j2k."""
    if not content.startswith(_SIGNATURE):
        return b""
    return b"".join(whole for kind, whole, _ in boxes_of(content) if kind != b"jp2c")


def comments_of(content: bytes) -> bytes:
    """The comments of a codestream's main header: whole marker segments, one after the other."""
    comments, _ = _main_header(_codestream_of(content))
    return b"".join(comments)


def with_comments(encoded: bytes, comments: bytes) -> bytes:
    """The file `encoded` with those comments instead of its encoder's."""
    codestream = _codestream_of(encoded)
    old, others = _main_header(codestream)
    tiles = codestream[2 + sum(map(len, [*old, *others])) :]
    codestream = codestream[:2] + b"".join(others) + comments + tiles
    if not encoded.startswith(_SIGNATURE):
        return codestream
    size = 8 + len(codestream)
    box = struct.pack(">I4s", size, b"jp2c")
    if size >= 2**32:
        box = struct.pack(">I4sQ", 1, b"jp2c", size + 8)
    box += codestream
    return b"".join(box if kind == b"jp2c" else whole for kind, whole, _ in boxes_of(encoded))


def _main_header(codestream: bytes) -> tuple[list[bytes], list[bytes]]:
    """Marker segments of the codestream after SOC: comments, and others."""
    comments: list[bytes] = []
    others: list[bytes] = []
    position = 2
    while (marker := codestream[position : position + 2]) != _TILE:
        if position + 4 > len(codestream):
            raise ValueError("one that ends early")
        (length,) = struct.unpack_from(">H", codestream, position + 2)
        segment = codestream[position : position + 2 + length]
        (comments if marker == _COMMENT else others).append(segment)
        position += 2 + length
    return comments, others


def _codestream_of(content: bytes) -> bytes:
    if not content.startswith(_SIGNATURE):
        return content
    return next((inner for kind, _, inner in boxes_of(content) if kind == b"jp2c"), b"")


def _with_metadata(encoded: bytes, metadata: bytes, *, colour_holds: bool) -> bytes:
    """The .jp2 `encoded` with the boxes that another one had, as far as they hold.

    Its header's box is taken only if it describes such samples, without a palette, and if
    `colour_holds`: what it says of their colour.
    """
    old, new = _inside(metadata, b"jp2h"), _inside(encoded, b"jp2h")
    sizes = [_inside(header, b"ihdr")[:11] for header in (old, new)]
    kept = colour_holds and sizes[0] == sizes[1] and not _inside(old, b"pclr")
    boxes = {kind: whole for kind, whole, _ in boxes_of(encoded)}
    parts = [
        boxes[kind] if kind == b"jp2h" and not kept else whole
        for kind, whole, _ in boxes_of(metadata)
    ]
    return b"".join([*parts, boxes[b"jp2c"]])


def _inside(boxes: bytes, wanted: bytes) -> bytes:
    return next((inner for kind, _, inner in boxes_of(boxes) if kind == wanted), b"")


def _enumerated(metadata: bytes) -> int | None:
    """EnumCS, if a box states the colour so: method, precedence, approximation, EnumCS."""
    colour = _inside(_inside(metadata, b"jp2h"), b"colr")
    return int.from_bytes(colour[3:7]) if colour[:1] == b"\1" else None
