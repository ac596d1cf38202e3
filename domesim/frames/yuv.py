"""Planes of a decoded video frame -> R, G, B code values.

Video codes luma and two colour differences, these often for every second pixel only, in a part of
the codes (limited range). ITU-R BT.709-6, 3, BT.2020-2, 4, and ITU-T H.273, 8.3, give the same
equations with the weights :math:`K_R, K_B` of their primaries:

    R = Y + 2 (1 - K_R) C_R,    B = Y + 2 (1 - K_B) C_B,    G = (Y - K_R R - K_B B) / K_G

Everything is float32: libswscale rounds to 8 bits on many of its ways, and takes BT.601 where
nothing is said. Colour differences lie where the stream says, else as MPEG-2 has it: in the column
of every second pixel, between two rows.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

MATRICES = {
    1: ("BT.709", 0.2126, 0.0722),
    5: ("BT.601", 0.299, 0.114),
    6: ("BT.601", 0.299, 0.114),
    9: ("BT.2020", 0.2627, 0.0593),
}
"""ITU-T H.273's MatrixCoefficients: name, K_R, K_B."""

_PLANAR = re.compile(r"(yuv|yuvj|yuva|gbr|gbra)(420|422|444|)p(9|10|12|14|16|)(le|)")
_PACKED = {
    "bgr0": ("u1", 4, (2, 1, 0)),
    "rgb0": ("u1", 4, (0, 1, 2)),
    "rgba": ("u1", 4, (0, 1, 2, 3)),
    "bgra": ("u1", 4, (2, 1, 0, 3)),
    "rgb24": ("u1", 3, (0, 1, 2)),
    "rgb48le": ("<u2", 3, (0, 1, 2)),
    "rgba64le": ("<u2", 4, (0, 1, 2, 3)),
    "xyz12le": ("<u2", 3, (0, 1, 2)),
}


@final
@dataclass(frozen=True)
class PixelFormat:
    """How a frame's samples lie in planes.

    Parameters
    ----------
    name
        As FFmpeg calls it.
    bits
        Bits of a sample.
    chroma
        "4:4:4", "4:2:2" or "4:2:0"; "" for R, G, B.
    alpha
        Whether there is an alpha.
    full_range
        Whether its name alone says that it uses all codes.
    xyz
        Whether it is X'Y'Z', above four bits that are 0.
    """

    name: str
    bits: int
    chroma: str
    alpha: bool
    full_range: bool
    xyz: bool = False


def pixel_format(name: str) -> PixelFormat | None:
    """The format of that name; None if it has no R, G, B or lies in planes in an unknown way."""
    if name in _PACKED:
        kind, _, order = _PACKED[name]
        if name == "xyz12le":
            return PixelFormat(name, 12, "", alpha=False, full_range=True, xyz=True)
        return PixelFormat(name, 8 * np.dtype(kind).itemsize, "", len(order) == 4, full_range=True)
    match = _PLANAR.fullmatch(name)
    if match is None or (match[1].startswith("gbr") != (match[2] == "")):
        return None
    return PixelFormat(
        name,
        int(match[3] or 8),
        ":".join(match[2]),
        match[1] in ("yuva", "gbra"),
        match[1] in ("yuvj", "gbr", "gbra"),
    )


def code_values(
    frame: Any, kind: PixelFormat, matrix: int, *, full: bool, siting: str = "left"
) -> tuple[NDArray[np.float32], NDArray[Any] | None]:
    """R, G, B and alpha of a decoded frame.

    Parameters
    ----------
    frame
        PyAV's, of that `kind`.
    kind
        Its format.
    matrix
        One of `MATRICES`, for what is not R, G, B.
    full
        Whether all codes are used, or 16 to 235 (240) of 255 and likewise of more bits.
    siting
        One of `SITINGS`.

    Returns
    -------
    (row, col, 3) float32, 0..1: what limited range can hold beyond white, and colour differences
    beyond the primaries, are clipped. (row, col) alpha as stored, if there is one.
    """
    planes = _planes(frame, kind)
    alpha = planes[3] if kind.alpha else None
    scale = 2 ** (kind.bits - 8)
    black, white = (0, 2**kind.bits - 1) if full else (16 * scale, 235 * scale)
    span = 2**kind.bits - 1 if full else 224 * scale
    pixels = np.empty((frame.height, frame.width, 3), np.float32)
    if not kind.chroma:
        for channel in range(3):
            _scaled(planes[channel], black, white - black, pixels[..., channel])
        return np.clip(pixels, 0, 1, out=pixels), alpha
    luma = np.empty(pixels.shape[:2], np.float32)
    _scaled(planes[0], black, white - black, luma)
    differences = []
    for plane in planes[1:3]:
        small = np.empty(plane.shape, np.float32)
        _scaled(plane, 128 * scale, span, small)
        differences.append(full_size(small, kind.chroma, luma.shape, siting))
    return from_luma(luma, differences[0], differences[1], matrix), alpha


def from_luma(
    luma: NDArray[np.float32], blue: NDArray[np.float32], red: NDArray[np.float32], matrix: int
) -> NDArray[np.float32]:
    """(row, col, 3) R, G, B code values within 0..1 of (row, col) Y, C_B and C_R.

    Parameters
    ----------
    luma, blue, red
        Scaled to 0..1, and to -0.5..0.5; `luma` is overwritten.
    matrix
        One of `MATRICES`.
    """
    _, of_red, of_blue = MATRICES[matrix]
    pixels = np.empty((*luma.shape, 3), np.float32)
    for channel, difference, weight in ((2, blue, of_blue), (0, red, of_red)):
        np.multiply(difference, np.float32(2 * (1 - weight)), out=pixels[..., channel])
        pixels[..., channel] += luma
    luma -= np.float32(of_red) * pixels[..., 0]
    luma -= np.float32(of_blue) * pixels[..., 2]
    np.multiply(luma, np.float32(1 / (1 - of_red - of_blue)), out=pixels[..., 1])
    return np.clip(pixels, 0, 1, out=pixels)


def limited_codes(pixels: NDArray[np.float32], matrix: int, bits: int) -> list[NDArray[np.float32]]:
    """(row, col) codes of Y, C_B and C_R in limited range, not rounded.

    Parameters
    ----------
    pixels
        (row, col, 3) R, G, B code values, 0..1.
    matrix
        One of `MATRICES`.
    bits
        Bits of a code.
    """
    _, of_red, of_blue = MATRICES[matrix]
    weights = np.array([of_red, 1 - of_red - of_blue, of_blue], np.float32)
    scale = np.float32(2 ** (bits - 8))
    luma = pixels @ weights
    blue, red = (
        (pixels[..., channel] - luma) * (112 * scale / np.float32(1 - weight)) + 128 * scale
        for channel, weight in ((2, of_blue), (0, of_red))
    )
    return [luma * (219 * scale) + 16 * scale, blue, red]


def _planes(frame: Any, kind: PixelFormat) -> list[NDArray[Any]]:
    """(row, col) of Y, Cb, Cr or R, G, B, and of alpha."""
    if kind.name in _PACKED:
        dtype, count, order = _PACKED[kind.name]
        (plane,) = frame.planes
        rows = _rows(plane, dtype, frame.width * count)
        planes = [rows[:, place::count] for place in order]
        return [plane >> 4 for plane in planes] if kind.xyz else planes
    dtype = "u1" if kind.bits == 8 else "<u2"
    planes = [_rows(plane, dtype, plane.width) for plane in frame.planes]
    if not kind.chroma:
        planes[:3] = planes[2], planes[0], planes[1]
    return planes


def _rows(plane: Any, dtype: str, width: int) -> NDArray[Any]:
    """Without what fills up its rows."""
    whole: NDArray[Any] = np.frombuffer(plane, dtype).reshape(plane.height, -1)
    return whole[:, :width]


def _scaled(plane: NDArray[Any], zero: int, span: int, into: NDArray[np.float32]) -> None:
    """Into where `zero` is 0 and `span` codes above it is 1."""
    np.subtract(plane, np.float32(zero), out=into, dtype=np.float32)
    into /= np.float32(span)


def small_size(plane: NDArray[np.float32], chroma: str) -> NDArray[np.float32]:
    """Colour differences of every pixel as a video of that `chroma` keeps them: smoothed first."""
    if chroma in ("4:2:0", "4:2:2"):
        edged = np.pad(plane, ((0, 0), (1, 1)), "edge")
        before, here, after = edged[:, :-2:2], edged[:, 1:-1:2], edged[:, 2::2]
        plane = np.asarray((before + 2 * here + after[:, : here.shape[1]]) / 4, np.float32)
    if chroma == "4:2:0":
        below = np.minimum(np.arange(0, len(plane), 2) + 1, len(plane) - 1)
        plane = np.asarray((plane[0::2] + plane[below]) / 2, np.float32)
    return plane


SITINGS = {
    "left": (0.0, 0.5),
    "center": (0.5, 0.5),
    "topleft": (0.0, 0.0),
    "top": (0.5, 0.0),
    "bottomleft": (0.0, 1.0),
    "bottom": (0.5, 1.0),
}
"""Where a colour difference lies from the first of its two columns, and of its two rows, by the
names that FFmpeg has for ITU-T H.273's ChromaLocType."""


def full_size(
    small: NDArray[np.float32], chroma: str, shape: Sequence[int], siting: str = "left"
) -> NDArray[np.float32]:
    """Colour differences at each of `shape` pixels, linear between those that there are."""
    across, down = SITINGS[siting]
    if chroma == "4:2:0":
        small = _twice(small, shape[0], down)
    if chroma in ("4:2:0", "4:2:2"):
        small = _twice(small.T, shape[1], across).T
    return small


def _twice(small: NDArray[np.float32], rows: int, place: float) -> NDArray[np.float32]:
    """Two rows for each of `small`, which lies at `place` of them: 0 the first, 1 the second."""
    near = np.float32(1 - place / 2), np.float32((1 + place) / 2)
    order: Any = "C" if small.flags.c_contiguous else "F"  # columns' are written as they are read
    twice = np.empty((2 * len(small), small.shape[1]), np.float32, order)
    twice[0::2], twice[1::2] = near[0] * small, near[1] * small
    twice[2::2] += (1 - near[0]) * small[:-1]
    twice[1:-1:2] += (1 - near[1]) * small[1:]
    twice[0] += (1 - near[0]) * small[0]
    twice[-1] += (1 - near[1]) * small[-1]
    return twice[:rows]


def beyond_limits(frame: Any, kind: PixelFormat) -> bool:
    """Whether a decoded frame's R, G, B go farther than limited range's black and white."""
    scale = 2 ** (kind.bits - 8)
    planes = _planes(frame, kind)[:3]
    return any(
        plane.min() < _BLACKEST * scale or plane.max() > _WHITEST * scale for plane in planes
    )


_BLACKEST, _WHITEST = 4, 251  # of 8 bits: what overshoots stays within
