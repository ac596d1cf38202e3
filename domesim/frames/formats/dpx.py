"""DPX: fields of its header that OpenImageIO loses, or believes too easily (SMPTE ST 268-1)."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Self, final

from domesim.errors import InputError
from domesim.frames.colour import ColourTag, unsupported_encoding
from domesim.frames.formats.base import Format, Target
from domesim.frames.integrity import DamagedError
from domesim.frames.orientation import UPRIGHT

_HEADER = 2048
_NAME = (36, 136)
_TURNED, _DEVICE, _INDUSTRY = 768, 1408, 1664  # where fields begin
_FIELDS = ((136, 160), (_TURNED, _TURNED + 2), (_DEVICE, _INDUSTRY), (_INDUSTRY, _HEADER))
_DESCRIPTOR = 800
_LUMA_AND_CHROMA = (b"\7", b"d", b"e", b"f", b"g")  # 7: chroma alone; 100 to 103
_EXIF = (1, 2, 4, 3, 5, 6, 8, 7)  # number of its orientation, by that of DPX
_COLUMNS = range(4, 8)  # whose lines are columns
_OF_INDUSTRY = (
    *("Format", "FramePosition", "SequenceLength", "HeldCount", "FrameRate", "ShutterAngle"),
    *("FrameId", "SlateInfo", "FilmEdgeCode", "Interlace", "FieldNumber", "Signal", "TimeCode"),
    *("UserBits", "HorizontalSampleRate", "VerticalSampleRate", "TemporalFrameRate", "TimeOffset"),
    *("Gamma", "BlackLevel", "BlackGain", "BreakPoint", "WhiteLevel", "IntegrationTimes"),
)
_BEHIND = frozenset({"smpte:TimeCode", "smpte:KeyCode", *(f"dpx:{name}" for name in _OF_INDUSTRY)})
"""Attributes from behind byte 1664: of a shorter header they are the first pixels' bytes."""

# Transfer characteristic, by OpenImageIO's names. Video is decoded as a monitor does; nothing more
# than sRGB can be assumed of the rest; film densities are not light at all.
_TRANSFERS = {
    "Linear": "linear",
    "SMPTE 274M": "bt1886",
    "ITU-R 709-4": "bt1886",
    "ITU-R 601-5 system B or G": "bt1886",
    "ITU-R 601-5 system M": "bt1886",
    "User defined": None,
    "Unspecified video": None,
    "Undefined": None,
}


@final
@dataclass(frozen=True)
class DPX(Format):
    """Digital Picture Exchange."""

    header: bytes = b""  # as far as the pixels leave room for it
    big_endian: bool = True

    starts = (b"SDPX", b"XPDS")
    shaped = True

    def examined(self, path: Path, file: BinaryIO) -> Self:
        """The pixels need no check (OpenImageIO misses them), but what follows them does."""
        start, size = file.read(_HEADER), os.fstat(file.fileno()).st_size
        order = ">" if start[:4] == b"SDPX" else "<"
        if len(start) < 20:
            raise DamagedError("one that ends early")
        (stated,) = struct.unpack_from(order + "I", start, 16)
        if size < stated != 0xFFFFFFFF:  # all ones: not stated
            raise DamagedError(f"one that ends early, at {size} of {stated} bytes")
        (offset,) = struct.unpack_from(order + "I", start, 4)
        header = start[: min(offset, _HEADER)]
        if header[_DESCRIPTOR : _DESCRIPTOR + 1] in _LUMA_AND_CHROMA:
            raise InputError(
                f"{path}: wanted R, G, B, got Y'CbCr (descriptor {header[_DESCRIPTOR]}). Export it "
                "as R, G, B."
            )
        turned = int.from_bytes(header[_TURNED : _TURNED + 2], "big" if order == ">" else "little")
        shown = _EXIF[turned] if turned < len(_EXIF) else UPRIGHT
        anew: tuple[bytes, ...] = ()
        if turned in _COLUMNS:  # OpenImageIO makes rows of them
            file.seek(0)
            content = bytearray(file.read())
            content[_TURNED : _TURNED + 2] = bytes(2)
            anew = (bytes(content),)
        big = order == ">"
        return replace(self, header=header, big_endian=big, turned=shown, stored_anew=anew)

    def _colour(self, path: Path, spec: Any) -> ColourTag:
        stated = spec.get_string_attribute("dpx:Transfer") or "Undefined"
        if stated not in _TRANSFERS:
            raise unsupported_encoding(path, stated)
        transfer = _TRANSFERS[stated]
        # FFmpeg says so of all it writes (libavcodec/dpxenc.c), and converts nothing.
        if stated == "Linear" and spec.get_string_attribute("Software").startswith("Lavc"):
            source = "assumed for DPX by FFmpeg, which always says 'Linear'"
            return ColourTag("srgb", "BT.709", source)
        if transfer is None:
            return ColourTag("srgb", "BT.709", f"assumed for DPX with transfer '{stated}'")
        return ColourTag(transfer, "BT.709", f"file: transfer '{stated}'")

    def is_legal(self, spec: Any, bits: int) -> bool:
        """64 to 940 of 10 bits."""
        stated = spec.getattribute("dpx:LowData"), spec.getattribute("dpx:HighData")
        return stated == tuple(level << (bits - 8) for level in (16, 235))

    def invented(self) -> frozenset[str]:
        return _BEHIND if len(self.header) < _HEADER else frozenset()

    def state_storage(self, spec: Any, target: Target) -> None:
        spec.attribute("oiio:Endian", "big" if self.big_endian else "little")

    def state_colour(self, spec: Any, colour: ColourTag) -> None:
        names = {"linear": "Linear", "bt1886": "ITU-R 709-4"}
        spec.attribute("dpx:Transfer", names.get(colour.transfer, "User defined"))
        known = colour.primaries == "BT.709"
        spec.attribute("dpx:Colorimetric", "ITU-R 709-4" if known else "User defined")

    def finished(self, content: bytes, path: Path, target: Target) -> bytes:
        result = bytearray(content)
        for begin, end in _FIELDS:
            if len(self.header) >= end:
                result[begin:end] = self.header[begin:end]
        begin, end = _NAME
        result[begin:end] = os.fsencode(path.name)[: end - begin - 1].ljust(end - begin, b"\0")
        return bytes(result)
