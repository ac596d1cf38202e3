"""Files that say themselves how two views are packed in one picture, and which eye is first.

A PNG says it by its chunk sTER (*Extensions to the PNG Specification* 1.4, 2.2), a JPEG as JPS
does (``jpeg.py``), a video by what FFmpeg calls AVStereo3D: Matroska's StereoMode, MP4's st3d,
frame packing of H.264 and HEVC. An EXR has views, which have names (``stereo_exr.py``).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Literal, TypeAlias, final

from domesim.frames.formats.png import chunk

Packed: TypeAlias = Literal["side-by-side", "top-bottom"]
SIDE_BY_SIDE: Packed = "side-by-side"
TOP_BOTTOM: Packed = "top-bottom"
_JPS_LAYOUTS = {2: SIDE_BY_SIDE, 3: TOP_BOTTOM}
_STEREO_3D = {1: SIDE_BY_SIDE, 2: TOP_BOTTOM}
_FLAT = 0  # AVStereo3D's type


@final
@dataclass(frozen=True)
class Eyes:
    """How two views are packed, as a file says it.

    Parameters
    ----------
    packing
        Where.
    right_first
        Whether the right eye's view is on the left, or on top.
    said_by
        For a person: "sTER".
    """

    packing: Packed
    right_first: bool
    said_by: str

    def __str__(self) -> str:
        """For a person: ``side-by-side, right first (sTER)``."""
        return f"{self.packing}, {'right' if self.right_first else 'left'} first ({self.said_by})"


def of_png(content: bytes) -> Eyes:
    """What a chunk sTER says: 0 is for crossed eyes.

    Raises
    ------
    ValueError
        If it is neither way.
    """
    if content not in (b"\0", b"\1"):
        raise ValueError("a chunk sTER of an unknown mode")
    return Eyes(SIDE_BY_SIDE, content == b"\0", "sTER")


def of_jps(layout: int, *, left_first: bool) -> Eyes:
    """What a stereoscopic JPEG says.

    Raises
    ------
    ValueError
        If views are interleaved, or in colours.
    """
    if layout not in _JPS_LAYOUTS:
        raise ValueError(f"a JPS of layout {layout} (interleaved, or an anaglyph)")
    return Eyes(_JPS_LAYOUTS[layout], not left_first, "JPS marker")


def of_video(stereo_3d: bytes | None, mode: str) -> Eyes | None:
    """What FFmpeg's AVStereo3D says, or Matroska's StereoMode; None for a flat picture.

    Raises
    ------
    ValueError
        If it is another packing.
    """
    if mode.startswith(("anaglyph", "block")):  # which FFmpeg tells only so
        raise ValueError(mode)
    if stereo_3d is None:
        return None
    kind, flags = struct.unpack_from("=2i", stereo_3d)
    if kind == _FLAT:
        return None
    if kind not in _STEREO_3D:
        raise ValueError("views that are interleaved, or in turn")
    return Eyes(_STEREO_3D[kind], bool(flags & 1), "stereo mode")


def stated(eyes: Eyes, name: str) -> bytes:
    """The chunk or segment that says it in a format of that name; nothing if none can."""
    if name == "png" and eyes.packing == SIDE_BY_SIDE:
        return chunk(b"sTER", bytes([not eyes.right_first]))
    if name == "jpeg":
        layout = next(code for code, packing in _JPS_LAYOUTS.items() if packing == eyes.packing)
        flags = 0 if eyes.right_first else 4
        body = b"_JPSJPS_" + struct.pack(">H4B", 4, 0, flags, layout, 1)
        return b"\xff\xe3" + struct.pack(">H", len(body) + 2) + body
    return b""


def stereo_mode(eyes: Eyes) -> str:
    """What FFmpeg calls it in Matroska."""
    names = {SIDE_BY_SIDE: ("left_right", "right_left"), TOP_BOTTOM: ("top_bottom", "bottom_top")}
    return names[eyes.packing][eyes.right_first]
