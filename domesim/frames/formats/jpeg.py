"""JPEG: segments that are about the picture, and which eye is which (ITU-T T.81, annex B).

OpenImageIO reads and writes a part of them: it loses an Orientation, and comments of Exif.
"""

from __future__ import annotations

import io
import re
import struct
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Self, final

from domesim.errors import InputError
from domesim.frames.eyes import SIDE_BY_SIDE, TOP_BOTTOM, Eyes
from domesim.frames.formats.base import Format, Target

START = b"\xff\xd8\xff"
_STEREO = b"_JPSJPS_"
_LAYOUTS = {2: SIDE_BY_SIDE, 3: TOP_BOTTOM}  # of a stereoscopic JPEG
_JFIF, _FIRST, _LAST, _COMMENT, _SCAN = 0xE0, 0xE1, 0xEF, 0xFE, 0xDA  # APPn, COM, SOS
# Of APP2: ICC profiles, which are said anew; and where other pictures of the file are, which are
# not in another. APP14 tells how samples are stored.
_INDEX, _ENTRIES, _DISPARITY = b"MPF\0", 0xB002, 0x020002
_GAINS = (b"http://ns.adobe.com/hdr-gain-map/1.0/", b"urn:iso:std:iso:ts:21496:-1")
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # SOF0 to SOF15
_MARKER, _END = re.compile(rb"\xff[^\x00\x01\xd0-\xd8\xff]"), b"\xff\xd9"  # not RST, SOI; EOI
_DEPTH = 8
_OF_STORAGE = (b"ICC_PROFILE\0", _INDEX, b"Adobe", _STEREO)


@final
@dataclass(frozen=True)
class JPEG(Format):
    """JPEG, written at quality 100 without chroma subsampling.

    Re-encoding what was decoded from a JPEG then moves no sample by more than 4 codes, and 97 %
    (noise) to 99.8 % (a domemaster) of them by at most one; at quality 98 it was 10 codes and 74 %
    to 99.5 %.
    """

    metadata: bytes = b""  # segments that tell of the picture: Exif, XMP, IPTC, comments, ...

    starts = (START,)
    largest_ratio = 1100.0
    exif = True
    storage = ("jpeg:subsampling",)

    def examined(self, path: Path, file: BinaryIO) -> Self:
        """OpenImageIO does not read which eye is which, and loses some metadata."""
        content = file.read()
        if pair_of(content) is not None:
            raise InputError(
                f"{path}: wanted one picture, got an MPO of two views. Save one alone."
            )
        if (depth := _depth(content)) > _DEPTH:
            raise InputError(
                f"{path}: wanted a JPEG of {_DEPTH} bits, got one of {depth}. It is not damaged: "
                "save it as TIFF or PNG of 16 bits where it was made."
            )
        first = _first_of(content)
        notes: tuple[str, ...] = ()
        if any(gains in content for gains in _GAINS):
            notes = ("its gain map is left out",)
        elif (count := len(_pictures_of(content))) > 1:
            notes = (
                f"one of {count} pictures in its file, which are not marked as a stereo pair: "
                "--packing mpo takes two as one",
            )
        elif START in content[len(first) :]:
            notes = ("the other pictures in its file are left out",)
        # OpenImageIO would apply a gain map, and give light beyond white.
        alone = _without(first, (_INDEX, *_GAINS))
        anew: tuple[bytes, ...] = () if alone == content else (alone,)
        metadata, eyes = _metadata_of(content), _eyes_of(content)
        return replace(self, metadata=metadata, eyes=eyes, notes=notes, stored_anew=anew)

    def state_storage(self, spec: Any, target: Target) -> None:
        spec.attribute("Compression", "jpeg:100")
        spec.attribute("jpeg:subsampling", "4:4:4")

    def stated_eyes(self, eyes: Eyes | None) -> bytes:
        if eyes is None:
            return b""
        layout = next(code for code, packing in _LAYOUTS.items() if packing == eyes.packing)
        body = _STEREO + struct.pack(">H4B", 4, 0, 0 if eyes.right_first else 4, layout, 1)
        return b"\xff\xe3" + struct.pack(">H", len(body) + 2) + body

    def finished(self, content: bytes, path: Path, target: Target) -> bytes:
        if target.same and target.keeps_colour:  # Exif may tell of it
            content = _with_metadata(content, self.metadata)
        return _with_segment(content, self.stated_eyes(target.eyes))


def _segments_of(content: bytes) -> Iterator[tuple[int, bytes]]:
    """(marker, whole segment) of each before the first scan, as far as they are there."""
    position = 2
    while position + 4 <= len(content) and content[position] == 0xFF:
        marker = content[position + 1]
        if marker == 0xFF:  # fill
            position += 1
            continue
        (length,) = struct.unpack_from(">H", content, position + 2)
        end = position + 2 + length
        if marker == _SCAN or end > len(content):
            return
        yield marker, content[position:end]
        position = end


def _depth(content: bytes) -> int:
    """Bits of a sample, as a frame's header has it; 0 if there is none."""
    frames = (whole for marker, whole in _segments_of(content) if marker in _FRAMES)
    return next((whole[4] for whole in frames if len(whole) > 4), 0)


def _first_of(content: bytes) -> bytes:
    """The first picture of a file, up to its end of image (B.1.1.3); all, if there is none."""
    position = 2 + sum(len(whole) for _, whole in _segments_of(content))
    while (found := _MARKER.search(content, position)) is not None:
        position = found.end()
        if found[0] == _END:
            return content[:position]
        if position + 2 > len(content):
            break
        position += int.from_bytes(content[position : position + 2])
    return content


def _metadata_of(content: bytes) -> bytes:
    """The segments that tell of the picture: Exif, XMP, IPTC, comments, ..."""
    return b"".join(
        whole
        for marker, whole in _segments_of(content)
        if _is_metadata(marker)
        and not whole[4:].startswith(_OF_STORAGE)
        and not any(gains in whole for gains in _GAINS)
    )


def _with_metadata(encoded: bytes, metadata: bytes) -> bytes:
    """The JPEG `encoded` with those segments in place of its own of that kind."""
    segments, rest = _taken_apart(encoded)
    others = [
        (marker, whole)
        for marker, whole in segments
        if not _is_metadata(marker) or whole[4:].startswith(_OF_STORAGE)
    ]
    return _joined(others, metadata, rest)


def _with_segment(encoded: bytes, segment: bytes) -> bytes:
    """The JPEG `encoded` with one more."""
    segments, rest = _taken_apart(encoded)
    return _joined(segments, segment, rest)


def _taken_apart(content: bytes) -> tuple[list[tuple[int, bytes]], bytes]:
    """Segments before the first scan, and the rest."""
    segments = list(_segments_of(content))
    return segments, content[2 + sum(len(whole) for _, whole in segments) :]


def _joined(segments: list[tuple[int, bytes]], more: bytes, rest: bytes) -> bytes:
    """A JPEG; JFIF's segment, APP0, comes first."""
    first = b"".join(whole for marker, whole in segments if marker == _JFIF)
    others = b"".join(whole for marker, whole in segments if marker != _JFIF)
    return b"".join([START[:2], first, more, others, rest])


def _eyes_of(content: bytes) -> Eyes | None:
    """What a stereoscopic JPEG says (VRex, *JPS*, 1997); None if it is none."""
    for marker, whole in _segments_of(content):
        if marker == 0xE3 and whole[4:12] == _STEREO and len(whole) >= 18:
            _, flags, layout, media = whole[14:18]
            if media != 1:
                return None
            if layout not in _LAYOUTS:
                raise ValueError(f"a JPS of layout {layout} (interleaved, or an anaglyph)")
            return Eyes(_LAYOUTS[layout], not flags & 4, "JPS marker")
    return None


def pair_of(content: bytes, *, taken: bool = False) -> tuple[bytes, bytes] | None:
    """Left and right of an MPO of two views (CIPA DC-007, 5.2.3.3: disparity); None if it is none.

    A panorama, or a picture with a preview, is one picture. If it is `taken` for a pair, two
    pictures that are no previews are one.

    Raises
    ------
    ValueError
        If there are more views, or less in the file than its index says. The message says what was
        got.
    """
    views = [
        entry
        for entry in _pictures_of(content)
        if taken or "Disparity" in entry["Attribute"]["MPType"]
    ]
    if len(views) < 2:
        return None
    if len(views) > 2:
        raise ValueError(f"an MPO of {len(views)} views")
    # The leftmost comes first (6.2.2.2). Places count from behind the index's name.
    origin = content.index(_INDEX) + len(_INDEX)
    begins = [origin + view["DataOffset"] if view["DataOffset"] else 0 for view in views]
    left, right = (
        content[begin : begin + view["Size"]] for begin, view in zip(begins, views, strict=True)
    )
    if not (left.startswith(START) and right.startswith(START)):
        raise ValueError("an MPO that ends early")
    return _without(left, (_INDEX,)), _without(right, (_INDEX,))


def _pictures_of(content: bytes) -> list[Any]:
    """Entries of an MPO's index, of pictures that are no previews; none if there is no index."""
    if not any(whole[4:].startswith(_INDEX) for _, whole in _segments_of(content)):
        return []
    from PIL import Image  # noqa: PLC0415 - few JPEGs have an index

    try:
        # A panorama may be large: nothing of it is decoded here.
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(content)) as opened:
            entries = getattr(opened, "mpinfo", {}).get(_ENTRIES, [])
    except (OSError, ValueError, SyntaxError, KeyError, Image.DecompressionBombError):
        return []
    return [each for each in entries if "Thumbnail" not in each["Attribute"]["MPType"]]


def joined_pair(left: bytes, right: bytes) -> bytes:
    """The MPO of two JPEGs: an index in the first says where both are (CIPA DC-007, 5.2)."""
    size = len(left) + len(_index_segment(0, 0, 0))
    # Places count from behind the segment's marker, length and name; JFIF's segment is before it.
    marker, first = next(_segments_of(left), (0, b""))
    origin = 2 + (len(first) if marker == _JFIF else 0) + 8
    return _with_segment(left, _index_segment(size, size - origin, len(right))) + right


def _index_segment(first: int, place: int, second: int) -> bytes:
    """Sizes of two views, and the place of the second."""
    entries = struct.pack(">IIIHH", 0x20000000 | _DISPARITY, first, 0, 0, 0)
    entries += struct.pack(">IIIHH", _DISPARITY, second, place, 0, 0)
    table = struct.pack(">H", 3)
    table += struct.pack(">HHI4s", 0xB000, 7, 4, b"0100")
    table += struct.pack(">HHII", 0xB001, 4, 1, 2)
    table += struct.pack(">HHII", _ENTRIES, 7, len(entries), 8 + 2 + 3 * 12 + 4)
    body = _INDEX + b"MM\0*" + struct.pack(">I", 8) + table + bytes(4) + entries
    return b"\xff\xe2" + struct.pack(">H", len(body) + 2) + body


def _without(content: bytes, kinds: tuple[bytes, ...]) -> bytes:
    """A JPEG without the segments that speak of one of these."""
    segments, rest = _taken_apart(content)
    kept = [whole for _, whole in segments if not any(kind in whole for kind in kinds)]
    return START[:2] + b"".join(kept) + rest


def _is_metadata(marker: int) -> bool:
    return _FIRST <= marker <= _LAST or marker == _COMMENT
