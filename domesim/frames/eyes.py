"""Packing of two views in one picture, as files state it.

Image formats say it each in its way (``formats``), a video by what FFmpeg calls AVStereo3D:
Matroska's StereoMode, MP4's st3d, frame packing of H.264 and HEVC. An EXR has views, which have
names (``exr_parts.py``).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Literal, TypeAlias, final

Packed: TypeAlias = Literal["side-by-side", "top-bottom"]
SIDE_BY_SIDE: Packed = "side-by-side"
TOP_BOTTOM: Packed = "top-bottom"
_STEREO_3D = {1: SIDE_BY_SIDE, 2: TOP_BOTTOM}
_FLAT, _UNSAID = 0, 8  # AVStereo3D's types
_ONE_EYE = (1, 2)  # its view: the left, the right


@final
@dataclass(frozen=True)
class Eyes:
    """Packing of two views, and the eye that is first.

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
        """The packing as a person reads it: ``side-by-side, right first (sTER)``."""
        return f"{self.packing}, {'right' if self.right_first else 'left'} first ({self.said_by})"


def of_video(stereo_3d: bytes | None, mode: str) -> Eyes | None:
    """What FFmpeg's AVStereo3D says, or Matroska's StereoMode; None for a flat picture.

    Raises
    ------
    ValueError
        If it is another packing.
    """
    if mode.startswith(("anaglyph", "block")):  # FFmpeg states these only here
        raise ValueError(mode)
    if stereo_3d is None:
        return None
    kind, flags, view = struct.unpack_from("=3i", stereo_3d)
    if kind == _FLAT or (kind == _UNSAID and view in _ONE_EYE):
        return None
    if kind == _UNSAID:
        raise ValueError("a spatial video (MV-HEVC)")
    if kind not in _STEREO_3D:
        raise ValueError("views that are interleaved, or in turn")
    return Eyes(_STEREO_3D[kind], bool(flags & 1), "stereo mode")


def stereo_mode(eyes: Eyes) -> str:
    """Returns FFmpeg's name of this packing in Matroska."""
    names = {SIDE_BY_SIDE: ("left_right", "right_left"), TOP_BOTTOM: ("top_bottom", "bottom_top")}
    return names[eyes.packing][eyes.right_first]
