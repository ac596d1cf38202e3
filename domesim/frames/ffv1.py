"""Checksums of FFV1 (RFC 9043, 4.9): FFmpeg computes them, and goes on with what is damaged.

A frame of version 3 is a row of slices, each with its size (24 bits), a status byte and a CRC-32
behind it, over which its own CRC is 0.
"""

from __future__ import annotations

import zlib

_TRAILER = 8
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def is_whole(frame: bytes) -> bool:
    """Whether a coded frame is slices with right checksums, and nothing else.

    False of a whole frame, too, if the encoder made it without (``-slicecrc 0``, version 1).
    """
    end = len(frame)
    while end > _TRAILER:
        begin = end - _TRAILER - int.from_bytes(frame[end - _TRAILER : end - _TRAILER + 3])
        if begin < 0 or not _has_right_sum(frame[begin:end]):
            return False
        end = begin
    return end == 0


def _has_right_sum(part: bytes) -> bool:
    # The specification's CRC has the bits of a byte the other way round, and begins with 0.
    return zlib.crc32(part.translate(_REVERSED), 0xFFFFFFFF) == 0xFFFFFFFF
