"""What a video says that PyAV does not tell: cropping, and where colour differences lie.

Matroska has PixelCrop (RFC 9559, 5.1.4.1.28), MP4 a clean aperture (ISO/IEC 14496-12, 12.1.4).
"""

from __future__ import annotations

import logging
import re
import struct
import threading
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO

from domesim.errors import InputError
from domesim.frames.yuv import SITINGS
from domesim.host.files import open_plain

_HEAD = 1 << 20  # bytes in which Matroska's tracks are looked for
_LARGEST = 1 << 28  # bytes of an index: that of a day is a tenth of it
_MATROSKA = b"\x1a\x45\xdf\xa3"
_WAY = (0x18538067, 0x1654AE6B, 0xAE, 0xE0)  # Segment, Tracks, TrackEntry, Video
_CROPS = (0x54CC, 0x54BB, 0x54DD, 0x54AA)  # left, top, right, bottom
_CLAP = re.compile(rb"\0\0\0\x28clap(.{32})", re.DOTALL)  # a box of that size and kind

Crop = tuple[int, int, int, int]
"""Pixels on the left, top, right and bottom that are not shown."""


def pyav(video: Path) -> Any:
    """The library that `video` needs.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        import av  # noqa: PLC0415
    except ImportError:
        raise InputError(
            f"{video}: videos and AVIF need the extra 'video': pip install 'domesim[video]'"
        ) from None
    return av


def cropping_of(video: Path, cols: int, rows: int) -> Crop:
    """Returns what a video's container cuts off.

    Parameters
    ----------
    video
        The file, of one picture.
    cols, rows
        What is stored, pixels.
    """
    with open_plain(video) as file:
        head = file.read(_HEAD)
        if head.startswith(_MATROSKA):
            found = dict(_elements(head, 0, len(head), _WAY))
            left, top, right, bottom = (found.get(each, 0) for each in _CROPS)
            return left, top, right, bottom
        clean = _CLAP.search(_index_of(file))
    values = struct.unpack(">8i", clean[1]) if clean is not None else (0,) * 8
    if 0 in values[1::2]:
        return 0, 0, 0, 0
    # Its width and height, and the places of its middle from that of the picture, as fractions
    wide, high, across, down = (Fraction(*pair) for pair in zip(*[iter(values)] * 2, strict=True))
    left, top = round((cols - wide) / 2 + across), round((rows - high) / 2 + down)
    edges = left, top, cols - round(wide) - left, rows - round(high) - top
    return edges if min(edges) >= 0 and wide > 0 and high > 0 else (0, 0, 0, 0)


def lacks_index(video: Path) -> bool:
    """Whether a file begins as an MP4 and has no whole box moov: it broke off."""
    if not video.is_file():  # the path is of a frame
        return False
    with open_plain(video) as file:
        return file.read(8)[4:] == b"ftyp" and not _index_of(file)


def _index_of(file: BinaryIO) -> bytes:
    """The box moov of an MP4, at most `_LARGEST` of it; nothing if there is no whole one."""
    place, end = 0, file.seek(0, 2)
    while place + 8 <= end:
        file.seek(place)
        size, kind, long = struct.unpack(">I4sQ", file.read(16).ljust(16, b"\0"))
        size = long if size == 1 else size or end - place
        if kind == b"moov" and place + size <= end:
            return file.read(min(size, _LARGEST))
        place += max(size, 8)
    return b""


def _elements(data: bytes, place: int, end: int, way: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    """Name and value of Matroska's elements (RFC 8794) at the end of a `way`."""
    while place + 2 <= end and data[place]:
        named = 9 - data[place].bit_length()
        at = place + named
        sized = 9 - data[at].bit_length() if at < end else 9
        if sized > 8 or at + sized > end:
            return
        name = int.from_bytes(data[place:at])
        size = int.from_bytes(data[at : at + sized]) & ((1 << 7 * sized) - 1)
        begin = at + sized
        stop = end if size == (1 << 7 * sized) - 1 else min(end, begin + size)
        if not way:
            yield name, int.from_bytes(data[begin:stop][:8])
        elif name == way[0]:
            yield from _elements(data, begin, stop, way[1:])
        place = stop


logging.getLogger("libav").addHandler(logging.NullHandler())
_listening = threading.Lock()
"""For who sets PyAV's level: a message that comes as another has just taken it off is an error."""


def siting_of(frame: Any) -> str:
    """Returns where a decoded frame's colour differences lie: one of `SITINGS`.

    PyAV does not tell; a filter of FFmpeg says it in its log.
    """
    from av import VideoFrame  # noqa: PLC0415
    from av import logging as log  # noqa: PLC0415
    from av.filter import Graph  # noqa: PLC0415

    assert isinstance(frame, VideoFrame)
    graph = Graph()
    size = {"width": frame.width, "height": frame.height, "format": frame.format}
    source = graph.add_buffer(**size, time_base=Fraction(1, 1000))
    graph.link_nodes(source, graph.add("showinfo"), graph.add("buffersink")).configure()
    with _listening:
        level = log.get_level()
        log.set_level(log.INFO)
        try:
            with log.Capture() as said:
                graph.vpush(frame)
                graph.vpull()
        finally:
            log.set_level(level)
    found = re.search(r"\bcl:(\w+)", "".join(text for _, _, text in said))
    return found[1] if found is not None and found[1] in SITINGS else "left"
