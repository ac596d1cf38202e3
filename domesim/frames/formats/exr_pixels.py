"""Samples of half precision as an EXR's compressed chunks, by all cores.

OpenImageIO moves their bytes one by one, which takes as long as to compress them. NumPy moves many
at once here, and libdeflate compresses: the bytes are those that OpenImageIO writes. Where
libdeflate is not installed, or a file has anything else, OpenImageIO does it.

A chunk has some lines, each of them channel after channel. Of all its samples the lower bytes come
first, then the upper ones, each as its difference from the byte before it, plus 128 (*OpenEXR File
Layout*, openexr.com; `internal_zip.c` of OpenEXRCore).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.light.strips import SAMPLES, in_strips

_LEVEL = 4  # as OpenEXR's own
_CHUNK = struct.Struct("<ii")  # its first line, and its bytes


def is_available() -> bool:
    """Says whether libdeflate is installed."""
    return find_spec("deflate") is not None


def compressed(planes: Sequence[NDArray[Any]], lines: int, top: int) -> list[bytes]:
    """Compresses all chunks of a picture.

    Parameters
    ----------
    planes
        (row, col) float16 of each channel, as they follow each other in the file.
    lines
        Of a chunk.
    top
        Number of the first line.

    Returns
    -------
    chunks
        As they stand in the file.
    """
    import deflate  # noqa: PLC0415 - it may not be there

    rows, cols = planes[0].shape

    def chunk(begin: int) -> bytes:
        halves = np.empty((2, min(lines, rows - begin), len(planes), cols), np.uint8)
        for place, plane in enumerate(planes):
            words = np.ascontiguousarray(plane[begin : begin + lines]).view(np.uint16)
            halves[0, :, place] = words
            halves[1, :, place] = words >> 8
        content = bytes(deflate.zlib_compress(_differences(halves.ravel()), _LEVEL))
        if len(content) >= halves.size:  # what does not shrink is stored as it is
            content = np.stack([*halves], -1).tobytes()
        return _CHUNK.pack(top + begin, len(content)) + content

    def work(_: int, places: slice) -> list[bytes]:
        return [chunk(place * lines) for place in range(places.start, places.stop)]

    parts = in_strips(work, (1, -(-rows // lines), lines * cols * len(planes)))
    return [each for part in parts for each in part]


def decoded(
    content: Any,
    places: Sequence[int],
    order: Sequence[int],
    lines: int,
    top: int,
    size: tuple[int, int],
) -> NDArray[np.float16] | None:
    """Decodes a picture.

    Parameters
    ----------
    content
        Bytes of the whole file.
    places
        Where each chunk is.
    order
        Which channel comes first in the file, which second, ...
    lines, top
        As for `compressed`.
    size
        Rows and columns.

    Returns
    -------
    samples
        (row, col, channel) float16, each channel's in one piece; None if any chunk is not whole.
    """
    import deflate  # noqa: PLC0415 - it may not be there

    rows, cols = size
    planes = np.empty((len(order), rows, cols), np.uint16)

    def chunk(place: int) -> bool:
        begin, start = place * lines, places[place] + _CHUNK.size
        part = planes[:, begin : begin + lines]
        if start > len(content):
            return False
        line, length = _CHUNK.unpack_from(content, start - _CHUNK.size)
        if line != top + begin or not 0 < length <= min(part.nbytes, len(content) - start):
            return False
        stored = content[start : start + length]
        if length == part.nbytes:
            halves = np.frombuffer(stored, np.uint8).reshape(-1, 2).T
        else:
            stored = deflate.zlib_decompress(stored, part.nbytes)
            if len(stored) != part.nbytes:
                return False
            halves = _sums(np.frombuffer(stored, np.uint8)).reshape(2, -1)
        low, high = halves.reshape(2, part.shape[1], len(order), cols)
        for k, channel in enumerate(order):
            np.left_shift(high[:, k], 8, out=part[channel], dtype=np.uint16)
            part[channel] |= low[:, k]
        return True

    def work(_: int, some: slice) -> bool:
        return all(chunk(place) for place in range(some.start, some.stop))

    shape = 1, len(places), min(lines * cols * len(order), SAMPLES)
    try:
        whole = all(in_strips(work, shape))
    except deflate.DeflateError:
        whole = False
    return np.moveaxis(planes.view(np.float16), 0, -1) if whole else None


def _differences(values: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Each byte's difference from the one before it, plus 128."""
    found = values.copy()
    found[1:] -= values[:-1]
    found[1:] ^= 128
    return found


def _sums(differences: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """What `_differences` were made of, by sums of 2, 4, 8, ... bytes: NumPy adds many at once."""
    sums = differences.copy()
    sums[1:] ^= 128
    other, step = np.empty_like(sums), 1
    while step < len(sums):
        np.add(sums[step:], sums[:-step], out=other[step:])
        other[:step] = sums[:step]
        sums, other = other, sums
        step *= 2
    return sums
