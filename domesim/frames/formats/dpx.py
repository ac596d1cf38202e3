"""Fields of a DPX header that OpenImageIO loses, or believes too easily (SMPTE ST 268-1)."""

from __future__ import annotations

import os
import struct
from typing import Any

from domesim.frames.orientation import UPRIGHT

HEADER = 2048
_NAME = (36, 136)
_TURNED, _DEVICE, _INDUSTRY = 768, 1408, 1664  # where fields begin
_FIELDS = ((_NAME[1], 160), (_TURNED, _TURNED + 2), (_DEVICE, _INDUSTRY))  # time, ...
_ROWS = (1, 2, 4, 3)
_COLUMNS = range(4, 8)
_OF_INDUSTRY = (
    *("Format", "FramePosition", "SequenceLength", "HeldCount", "FrameRate", "ShutterAngle"),
    *("FrameId", "SlateInfo", "FilmEdgeCode", "Interlace", "FieldNumber", "Signal", "TimeCode"),
    *("UserBits", "HorizontalSampleRate", "VerticalSampleRate", "TemporalFrameRate", "TimeOffset"),
    *("Gamma", "BlackLevel", "BlackGain", "BreakPoint", "WhiteLevel", "IntegrationTimes"),
)
INDUSTRY = frozenset({"smpte:TimeCode", "smpte:KeyCode", *(f"dpx:{name}" for name in _OF_INDUSTRY)})
"""Attributes from behind byte 1664: of a shorter header they are the first pixels' bytes."""


def orientation_of(header: bytes, *, big_endian: bool) -> int:
    """Exif's number for a header's image orientation.

    Raises
    ------
    ValueError
        If its lines are columns: OpenImageIO makes rows of them that they are not.
    """
    field = header[_TURNED : _TURNED + 2]
    stated = int.from_bytes(field, "big" if big_endian else "little")
    if stated in _COLUMNS:
        raise ValueError(f"image orientation {stated}, lines of which are columns")
    return _ROWS[stated] if stated < len(_ROWS) else UPRIGHT


def carried_of(start: bytes, *, big_endian: bool) -> bytes:
    """The header, as far as the pixels leave room for it."""
    (offset,) = struct.unpack_from(">I" if big_endian else "<I", start, 4)
    return start[: min(offset, HEADER)]


def is_legal(spec: Any, bits: int) -> bool:
    """Whether codes lie between black and white of video, 64 to 940 of 10 bits."""
    stated = spec.getattribute("dpx:LowData"), spec.getattribute("dpx:HighData")
    return stated == tuple(level << (bits - 8) for level in (16, 235))


def with_fields(encoded: bytes, carried: bytes) -> bytes:
    """The DPX `encoded` with the fields of the one that it came from."""
    result = bytearray(encoded)
    for begin, end in (*_FIELDS, (_INDUSTRY, HEADER)):
        if len(carried) >= end:
            result[begin:end] = carried[begin:end]
    return bytes(result)


def with_name(encoded: bytes, name: str) -> bytes:
    """The DPX `encoded` under its file's name."""
    begin, end = _NAME
    padded = os.fsencode(name)[: end - begin - 1].ljust(end - begin, b"\0")
    return encoded[:begin] + padded + encoded[end:]
