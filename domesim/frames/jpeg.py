"""The segments of a JPEG that are about its picture, and which eye is which (ITU-T T.81, annex B).

OpenImageIO reads and writes a part of them: it loses an Orientation, and comments of Exif.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

START = b"\xff\xd8\xff"
_STEREO = b"_JPSJPS_"
_FIRST, _LAST, _COMMENT, _SCAN = 0xE1, 0xEF, 0xFE, 0xDA  # APP1, APP15, COM, SOS
# Of APP2: ICC profiles, which are said anew; and where other pictures of the file are, which are
# not in another. APP14 tells how samples are stored.
_OF_STORAGE = (b"ICC_PROFILE\0", b"MPF\0", b"Adobe")


def segments_of(content: bytes) -> Iterator[tuple[int, bytes]]:
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


def metadata_of(content: bytes) -> bytes:
    """The segments that tell of the picture: Exif, XMP, IPTC, comments, ..."""
    return b"".join(
        whole
        for marker, whole in segments_of(content)
        if _is_metadata(marker) and not whole[4:].startswith(_OF_STORAGE)
    )


def with_metadata(encoded: bytes, metadata: bytes) -> bytes:
    """The JPEG `encoded` with those segments in place of its own."""
    # JFIF's comes first.
    parts, place = [encoded[:2]], 2
    others = []
    for marker, whole in segments_of(encoded):
        place += len(whole)
        if marker < _FIRST and marker >= 0xE0:
            parts.append(whole)
        elif not _is_metadata(marker) or whole[4:].startswith(_OF_STORAGE):
            others.append(whole)
    return b"".join([*parts, metadata, *others, encoded[place:]])


def stereo_of(content: bytes) -> tuple[int, bool] | None:
    """Layout and "left first" of a stereoscopic JPEG (VRex, *JPS*, 1997); None if it is none."""
    for marker, whole in segments_of(content):
        if marker == 0xE3 and whole[4:12] == _STEREO and len(whole) >= 18:
            _, flags, layout, media = whole[14:18]
            return (layout, bool(flags & 4)) if media == 1 else None
    return None


def _is_metadata(marker: int) -> bool:
    return _FIRST <= marker <= _LAST or marker == _COMMENT
