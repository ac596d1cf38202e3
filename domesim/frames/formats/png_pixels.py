"""The samples of a PNG as its compressed lines, by all cores.

libpng and zlib take one core six times as long as this takes all together: lines are filtered by
NumPy, and compressed by ISA-L. Of the PNG specification, third edition (W3C, 2025): 7.2 lines, 9.4
the Paeth filter, 10 compression.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

from domesim.light.strips import in_strips

_LEVEL = 2  # of 0..3: files are a fiftieth larger than by zlib's 4
_PAETH = 4
_HEADER = b"\x78\x5e"  # of a zlib stream: deflate, 32 kB of window, fast (RFC 1950, 2.2)
_PIECE = 1 << 20
"""Bytes of lines that are compressed alone: the more, the smaller the file, the fewer the cores."""
_FILTERED = 1 << 16
"""Bytes of lines that are filtered at once: a core's cache holds them."""


def compressed(samples: NDArray[Any]) -> list[bytes]:
    """The zlib stream of a picture's filtered lines, in pieces.

    Pieces do not look back on those before them, and have the same bytes whoever compresses them.

    Parameters
    ----------
    samples
        (row, col, channel) uint8 or uint16.
    """
    rows, cols, channels = samples.shape
    pixel = channels * samples.dtype.itemsize
    step = max(1, _PIECE // (cols * pixel))
    pieces = -(-rows // step)

    def work(_: int, places: slice) -> list[tuple[bytes, NDArray[np.uint8]]]:
        return [piece(place) for place in range(places.start, places.stop)]

    def piece(place: int) -> tuple[bytes, NDArray[np.uint8]]:
        lines = _filtered(samples, slice(place * step, min((place + 1) * step, rows)), pixel)
        end = isal_zlib.Z_FINISH if place == pieces - 1 else isal_zlib.Z_FULL_FLUSH
        stream = isal_zlib.compressobj(_LEVEL, isal_zlib.DEFLATED, -15)
        return stream.compress(lines.data) + stream.flush(end), lines

    parts = [each for strip in in_strips(work, (1, pieces, _PIECE)) for each in strip]
    checksum = 1
    for _, lines in parts:
        checksum = zlib.adler32(lines.data, checksum)
    return [_HEADER, *(stream for stream, _ in parts), checksum.to_bytes(4)]


def _filtered(samples: NDArray[Any], rows: slice, pixel: int) -> NDArray[np.uint8]:
    """(row, 1 + byte) of the file's lines: each begins with its filter."""
    length = samples.shape[1] * pixel
    lines = np.empty((rows.stop - rows.start, 1 + length), np.uint8)
    lines[:, 0] = _PAETH
    step = max(1, _FILTERED // length)
    for begin in range(rows.start, rows.stop, step):
        part = slice(begin, min(begin + step, rows.stop))
        first = max(begin - 1, 0)
        values = np.zeros((1 + part.stop - begin, pixel + length), np.int16)
        stored = samples[first : part.stop]
        stored = stored.astype(stored.dtype.newbyteorder(">"), order="C")
        stored = stored.view(np.uint8).reshape(len(stored), length)
        values[len(values) - len(stored) :, pixel:] = stored
        lines[begin - rows.start : part.stop - rows.start, 1:] = _less_predicted(values, pixel)
    return lines


def _less_predicted(values: NDArray[np.int16], pixel: int) -> NDArray[np.uint8]:
    """What is left of bytes less Paeth's prediction: the neighbour nearest to left + up - corner.

    `values` has a line above and a pixel to the left, which are 0 outside the picture.
    """
    left, up, corner = values[1:, :-pixel], values[:-1, pixel:], values[:-1, :-pixel]
    to_left, to_up = up - corner, left - corner
    to_corner = np.abs(to_left + to_up)
    np.abs(to_left, out=to_left)
    np.abs(to_up, out=to_up)
    predicted = np.where(to_up <= to_corner, up, corner)
    np.copyto(predicted, left, where=to_left <= np.minimum(to_up, to_corner))
    return (values[1:, pixel:] - predicted).astype(np.uint8)
