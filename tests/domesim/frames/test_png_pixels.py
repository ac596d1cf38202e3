"""A PNG's lines: what libpng reads of them, in pieces, of any depth and number of channels."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from domesim.frames.formats import png_pixels
from domesim.frames.formats.png_pixels import compressed


def unfiltered(stream: bytes, rows: int, pixel: int) -> np.ndarray:
    """(row, byte) of a zlib stream of lines, byte by byte as the specification has it (9.2)."""
    lines = np.frombuffer(zlib.decompress(stream), np.uint8).reshape(rows, -1)
    assert (lines[:, 0] == 4).all()  # Paeth's
    found = np.zeros((rows + 1, lines.shape[1] - 1 + pixel), int)
    for row, line in enumerate(lines[:, 1:], 1):
        for k, value in enumerate(line, pixel):
            left, up = found[row, k - pixel], found[row - 1, k]
            corner = found[row - 1, k - pixel]
            near = min((left, up, corner), key=lambda each: abs(left + up - corner - each))
            found[row, k] = (value + near) % 256
    return found[1:, pixel:]


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_lines_are_those_of_the_specification(
    kind: type[np.unsignedinteger], channels: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    shape, most = (9, 7, channels), np.iinfo(kind).max
    rng = np.random.default_rng(channels)
    samples = (rng.random(shape) ** 3 * most).astype(kind)
    samples[4:, :, 0] = most
    expected = samples.astype(samples.dtype.newbyteorder(">")).view(np.uint8).reshape(9, -1)
    pixel = channels * samples.itemsize
    for piece in (1 << 20, 2 * 7 * pixel):  # all at once, two lines at a time
        monkeypatch.setattr(png_pixels, "_PIECE", piece)
        monkeypatch.setattr(png_pixels, "_FILTERED", piece // 2)
        np.testing.assert_array_equal(unfiltered(b"".join(compressed(samples)), 9, pixel), expected)


def test_pieces_have_the_same_bytes_whoever_compresses_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    samples = np.random.default_rng(0).integers(0, 500, (900, 700, 3), np.uint16)
    expected = compressed(samples)
    monkeypatch.setattr(png_pixels, "in_strips", lambda work, shape: [work(0, slice(0, shape[1]))])
    assert compressed(samples) == expected
