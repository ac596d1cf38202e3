"""OpenEXR: windows, channels of any name, and the attributes of its headers, as they are stored.

OpenImageIO writes neither double vectors and matrices nor types that it does not know, and takes
some attributes for orders (``textureformat``: wait for MIP levels). OpenEXR's own Python bindings
(3.5) write no rational, refuse text that is not UTF-8, and print what they think of damage. So what
is not of the picture itself is carried over as bytes (*OpenEXR File Layout*, openexr.com).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, BinaryIO, Self, TypeAlias, final

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import InputError
from domesim.frames.colour import (
    ColourTag,
    chromaticities_of,
    interop_identifier,
    interop_named,
    primaries_of,
)
from domesim.frames.formats.base import Format, Target, Window
from domesim.frames.formats.exr_pixels import CODES, LINES, compressed, decoded, is_available
from domesim.frames.integrity import DamagedError
from domesim.frames.messages import one_line

MAGIC = b"v/1\x01"
_MULTI_PART, _DEEP, _LONG_NAMES, _TILED = 0x1000, 0x800, 0x400, 0x200  # of the version field
_BEGIN = 8
_HALF = 1  # a channel's type

_COLOUR = (b"chromaticities", b"colorInteropID")
_ACES_FLAG = b"acesImageContainerFlag"
_STRUCTURE = {
    *(b"channels", b"compression", b"dataWindow", b"displayWindow", b"lineOrder", b"type"),
    *(b"name", b"view", b"multiView", b"version", b"chunkCount", b"tiles", b"maxSamplesPerPixel"),
    *(b"dwaCompressionLevel", b"openexr:levelmode", b"openexr:roundingmode"),
}
_OF_OLD_PIXELS = {b"preview", b"textureformat", b"oiio:SHA-1", b"oiio:AverageColor"}

_SUBSAMPLED = re.compile(r"Subsampled channels are not supported \(channel \"([^\"]*)\"")

Attributes: TypeAlias = dict[bytes, bytes]
"""Name -> the whole attribute: name, type, size and value."""


@final
@dataclass(frozen=True)
class EXR(Format):
    """OpenEXR."""

    carried: tuple[bytes, ...] = (b"",)  # of each part: attributes that do not tell of storage

    starts = (MAGIC,)
    channels = "any"
    shaped = True
    largest_ratio = 1100.0  # PIZ and DWA know no useful limit
    storage = ("openexr:.*", "textureformat", "acesImageContainerFlag")
    kept = ("view", "multiView", "oiio:subimagename")  # all else is carried

    def examined(self, path: Path, file: BinaryIO) -> Self:
        with mmap(file.fileno(), 0, access=ACCESS_READ) as content:
            return replace(self, carried=_carried_of(content))

    def windows(self, path: Path, spec: Any) -> tuple[Window, Window]:
        data = (spec.x, spec.y, spec.width, spec.height)
        display = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
        inside = all(
            display[axis] <= data[axis]
            and data[axis] + data[axis + 2] <= display[axis] + display[axis + 2]
            for axis in (0, 1)
        )
        if not inside:
            # Light from beyond the edge of the screen is on no screen, and cutting it off unasked
            # would break the promise that a file keeps what it holds.
            raise InputError(
                f"{path}: wanted pixels within the display window {_window(display)}, got overscan "
                f"{_window(data)}. Crop it first "
                f"({ADVICE['crop'].given(window=_window(display))})."
            )
        return data, display

    def _colour(self, path: Path, spec: Any) -> ColourTag:
        """The identifier goes first (OpenEXR, *Color Interop*, 2026)."""
        identifier = spec.get_string_attribute("colorInteropID")
        if identifier == "data":
            raise InputError(
                f"{path}: wanted a picture, got numbers that are none (colorInteropID 'data'). "
                "Name another file, or say what it is (--encoding)."
            )
        known = interop_named(path, identifier)
        odd = f"; colorInteropID {one_line(identifier)!r} is not known"
        odd = "" if known or identifier in ("", "unknown") else odd
        chromaticities = spec.getattribute("chromaticities")
        named = None if chromaticities is None else primaries_of(chromaticities)
        if known:
            source = f"file: {identifier}"
            # P3-DCI has no identifier: see `interop_identifier`.
            if {named, known[1]} == {"P3-DCI", "P3-D65"} or named in (None, known[1]):
                return ColourTag(known[0], named or known[1], source)
            return ColourTag(*known, f"{source}; its chromaticities say {named}, and are not used")
        if chromaticities is None:
            return ColourTag("linear", "BT.709", f"assumed for EXR{odd}")
        if named is None:
            source = f"assumed for EXR; the file's chromaticities are no colours{odd}"
            return ColourTag("linear", "BT.709", source)
        return ColourTag("linear", named, f"file: chromaticities{odd}")

    def explain(self, path: Path, problem: str) -> None:
        """Luminance and chroma, and subsampled channels (*OpenEXR Technical Introduction*)."""
        subsampled = _SUBSAMPLED.search(problem)
        if subsampled is None:
            return
        if subsampled[1].upper().rpartition(".")[2] in ("RY", "BY"):
            raise InputError(
                f"{path}: wanted R, G, B, got an EXR of luminance and chroma (Y, RY, BY). It is "
                "not damaged: save it as R, G, B where it was made."
            )
        raise InputError(
            f"{path}: wanted channels of one size, got {one_line(subsampled[1])}, which is "
            "subsampled. It is not damaged: save it without that channel where it was made."
        )

    def of_part(self, part: int) -> Self:
        return replace(self, carried=(self.carried[part],))

    def fitting_depth(self, bits: int, transfer: str, *, floating: bool) -> int:
        # Half has 11 significant bits.
        return bits if floating else 16 if bits <= 10 else 32

    def is_floating(self, bits: int) -> bool:
        return True

    def state_storage(self, spec: Any, target: Target) -> None:
        state_compression(spec, target.said.get("compression") if target.same else None)
        if _ACES_FLAG in said(target):
            spec.attribute("compression", "none")

    def state_colour(self, spec: Any, colour: ColourTag) -> None:
        if colour.managed:
            return
        if colour.transfer != "linear":
            spec.attribute("colorInteropID", interop_identifier(colour))
        if colour.primaries != "BT.709":
            kind, value = oiio.TypeDesc("float[8]"), chromaticities_of(colour.primaries)
            spec.attribute("chromaticities", kind, value)

    def headed(self, spec: Any, samples: NDArray[Any]) -> tuple[Any, NDArray[Any]]:
        """One chunk: see `filled`."""
        lines = LINES.get(spec.get_string_attribute("compression"), len(samples))
        halves = samples.dtype == np.float16 and not spec.channelformats
        if halves and is_available() and "".join(spec.channelnames).isascii():
            spec.height = min(lines, len(samples))
        return spec, samples[: spec.height]

    def filled(self, content: bytes, spec: Any, samples: NDArray[Any]) -> bytes:
        """With the chunks of all samples."""
        if spec.height == len(samples):
            return content
        header = _headers(content)[0][0]
        left, top, right, _ = struct.unpack("<4i", header[b"dataWindow"][-16:])
        window = struct.pack("<4i", left, top, right, top + len(samples) - 1)
        header[b"dataWindow"] = header[b"dataWindow"][:-16] + window
        order = [spec.channelnames.index(name) for name in _halves_in(header)]
        chunks = compressed(samples, order, spec.height, top)
        before = [content[:_BEGIN], *header.values(), b"\0"]
        first = sum(map(len, before)) + 8 * len(chunks)
        ends = first + np.cumsum([0, *map(len, chunks[:-1])])
        return b"".join([*before, ends.astype("<u8").tobytes(), *chunks])

    def finished(self, content: bytes, path: Path, target: Target) -> bytes:
        return with_attributes(content, [said(target)]) if target.same else content


def said(target: Target) -> Attributes:
    """Attributes of the header that still hold for the part to be written."""
    assert isinstance(target.format, EXR)
    attributes = attributes_in(target.format.carried[0])
    if not target.keeps_colour:
        for name in _COLOUR:
            attributes.pop(name, None)
    # A container of SMPTE ST 2065-4 is half, of ACES AP0, and not compressed.
    if set(target.kinds) != {"half"} or not target.keeps_colour:
        attributes.pop(_ACES_FLAG, None)
    return attributes


def state_compression(spec: Any, compression: str | None) -> None:
    """ZIP: others do not notice damage (zlib has a checksum), or lose precision."""
    spec.attribute("compression", compression if compression == "zips" else "zip")


def halves_of(path: Path, channels: Sequence[str]) -> NDArray[np.float16] | None:
    """Reads an EXR of halves that ZIP has compressed, faster than OpenImageIO does.

    Parameters
    ----------
    path
        The file.
    channels
        All of its channels.

    Returns
    -------
    samples
        (row, col, channel) of the data window; None if it is another kind of EXR, or damaged.
    """
    if not is_available():
        return None
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        try:
            (header,), end = _headers(content)
            order = [channels.index(name) for name in _halves_in(header)]
            lines = CODES[header[b"compression"][-1:]]
            left, top, right, bottom = struct.unpack("<4i", header[b"dataWindow"][-16:])
            (version,) = struct.unpack_from("<I", content, 4)
            rows, cols = bottom - top + 1, right - left + 1
            places = np.frombuffer(content[end : end + 8 * -(-rows // lines)], "<u8").tolist()
        except (KeyError, ValueError, struct.error):
            return None
        if version & (_TILED | _DEEP | _MULTI_PART) or sorted(order) != [*range(len(channels))]:
            return None
        if (len(places) - 1) * lines >= rows or len(places) * lines < rows:
            return None
        return decoded(content, places, order, lines, top, (rows, cols))


def _halves_in(header: Attributes) -> list[str]:
    """Names of the channels, as they follow each other; refuses all but halves of each pixel."""
    _, _, listed = header[b"channels"].split(b"\0", 2)
    names, position = [], 4
    while listed[position : position + 1] != b"\0":
        end = listed.index(b"\0", position)
        names.append(listed[position:end].decode("latin-1"))
        kind, _, across, down = struct.unpack_from("<4i", listed, end + 1)
        if (kind, across, down) != (_HALF, 1, 1):
            raise ValueError("channels of another kind")
        position = end + 17
    return names


def _window(window: Window) -> str:
    left, top, cols, rows = window
    return f"{cols}x{rows}{left:+d}{top:+d}"


# Attributes.


def _carried_of(content: bytes | mmap) -> tuple[bytes, ...]:
    """Attributes of each part, less those that say how, or what, pixels are stored."""
    headers, _ = _headers(content)
    left_out = _STRUCTURE | _OF_OLD_PIXELS
    return tuple(
        b"".join(whole for name, whole in header.items() if name not in left_out)
        for header in headers
    )


def attributes_in(carried: bytes) -> Attributes:
    """The attributes that `EXR.carried` has of a part."""
    return _attributes(carried + b"\0", 0)[0]


def with_attributes(encoded: bytes, parts: Sequence[Mapping[bytes, bytes]]) -> bytes:
    """The file `encoded` with those attributes in each of its parts, in place of its own."""
    headers, end = _headers(encoded)
    whole = [{**own, **carried} for own, carried in zip(headers, parts, strict=True)]
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
        raise DamagedError("one that ends early")
    (version,) = struct.unpack_from("<I", content, 4)
    headers: list[Attributes] = []
    position = _BEGIN
    while not headers or (version & _MULTI_PART and content[position : position + 1] != b"\0"):
        header, position = _attributes(content, position)
        headers.append(header)
    return headers, position + bool(version & _MULTI_PART)


def _attributes(content: bytes | mmap, position: int) -> tuple[Attributes, int]:
    """Attributes from a place on up to the end of their header, and the place behind it."""
    attributes: Attributes = {}
    while (letter := content[position : position + 1]) != b"\0":
        named = content.find(b"\0", position)
        typed = content.find(b"\0", named + 1)
        if letter == b"" or min(named, typed) < 0 or typed + 5 > len(content):
            raise DamagedError("one that ends early")
        (size,) = struct.unpack_from("<I", content, typed + 1)
        end = typed + 5 + size
        if end > len(content):
            raise DamagedError("one that ends early")
        attributes[content[position:named]] = content[position:end]
        position = end
    return attributes, position + 1
