"""Code values of raw frames <-> light, by tables: 8, 10 or 16 bits, or half precision."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import cycle
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.live.process import HELD
from domesim.errors import InputError
from domesim.frames.colour import ColourTag
from domesim.frames.dithering import dither
from domesim.light import transfer
from domesim.observation.projector import Projector, require_primaries


@final
@dataclass(frozen=True)
class PixelFormat:
    """How a raw frame holds its pixels, as FFmpeg names it.

    Parameters
    ----------
    channels
        Of a pixel; the first three are R, G, B.
    dtype
        Of a sample, little-endian.
    """

    channels: int
    dtype: str

    @property
    def floating(self) -> bool:
        """Whether samples are of half precision."""
        return self.dtype == "<f2"

    @property
    def largest(self) -> int:
        """The largest code; 0 of half precision."""
        return 0 if self.floating else (1 << 8 * self.size) - 1

    @property
    def size(self) -> int:
        """Bytes of a sample."""
        return int(np.dtype(self.dtype).itemsize)


PIXEL_FORMATS: Mapping[str, PixelFormat] = {
    "rgb24": PixelFormat(3, "u1"),
    "rgba": PixelFormat(4, "u1"),
    "rgb48le": PixelFormat(3, "<u2"),
    "rgba64le": PixelFormat(4, "<u2"),
    "rgbaf16": PixelFormat(4, "<f2"),
}
"""Layouts of raw frames by name."""


@final
@dataclass(frozen=True)
class Coding:
    """What code values mean on a projector.

    Parameters
    ----------
    projector
        Whose light it is.
    colour
        Transfer and primaries of code values.

    Raises
    ------
    InputError
        If they are not known.
    """

    projector: Projector
    colour: ColourTag

    def __post_init__(self) -> None:
        require_primaries(self.colour.primaries)
        _ = self.curve

    @property
    def curve(self) -> transfer.Transfer:
        """The transfer function."""
        return transfer.named(self.colour.transfer, white=self.projector.white)

    @property
    def curve_of_each(self) -> transfer.Transfer:
        """The transfer function, which is of each primary by itself.

        Raises
        ------
        InputError
            If it mixes them.
        """
        if not self.curve.elementwise:
            raise InputError(
                f"{self.colour.source}: wanted a curve of each primary by itself, got "
                f"{self.colour.named}; use srgb, bt1886, gamma2.2, linear, st2084 or dcdm"
            )
        return self.curve

    @cached_property
    def mixing(self) -> NDArray[np.float64]:
        """(3, 3) from linear RGB of the codes' primaries to light."""
        linear = transfer.Linear()
        return np.asarray(self.projector.decode(np.eye(3), linear, self.colour.primaries).T)

    @property
    def mixes(self) -> bool:
        """Whether `mixing` is more than rounding away from doing nothing."""
        return bool(np.abs(self.mixing - np.eye(3)).max() > 1e-12)

    def table(self, codes: PixelFormat) -> NDArray[np.float32]:
        """Returns the (code,) linear light of each code; of half precision by its bits."""
        every = np.arange(1 << 8 * codes.size, dtype=f"<u{codes.size}")
        if codes.floating:
            values = every.view("<f2").astype(np.float32)
            values[np.isinf(values)] = np.nan
        else:
            values = (every / codes.largest).astype(np.float64)
        with np.errstate(all="ignore"):
            return np.asarray(self.curve_of_each.decode(values), np.float32)

    def decoded(self, samples: NDArray[Any]) -> NDArray[np.float32]:
        """(..., primary) light of samples (..., channel) of a raw frame, not clipped."""
        values = samples[..., :3]
        codes = values.astype(np.float32)
        if samples.dtype != np.float16:
            codes /= np.float32(np.iinfo(samples.dtype).max)
        found: NDArray[np.float32] = self.projector.decode(codes, self.curve, self.colour.primaries)
        return found

    def encoded(self, light: NDArray[np.float32]) -> NDArray[np.float32]:
        """(..., RGB) code values 0..1 of light."""
        codes = self.projector.encode(light, self.curve, self.colour.primaries)
        return np.clip(codes, 0, 1)


def views_of(codes: NDArray[Any], count: int, axis: int) -> NDArray[Any]:
    """(view, row, col, channel) of a raw frame whose views lie along an axis."""
    return np.stack(np.split(codes, count, axis)) if count > 1 else codes[None]


def room_for(rows: int, cols: int, pixels: PixelFormat) -> Iterator[NDArray[Any]]:
    """(row, col, channel) frames to write into, `HELD` in turns; of half precision as float32."""
    kind = np.float32 if pixels.floating else pixels.dtype
    return cycle([np.empty((rows, cols, pixels.channels), kind) for _ in range(HELD)])


def stored(
    found: NDArray[np.float32],
    views: NDArray[Any],
    screen: NDArray[np.bool_],
    pixels: PixelFormat,
    *,
    axis: int,
    noise: int | None,
) -> NDArray[Any]:
    """A raw frame of code values; what is off the screen, and alpha, as they were.

    Parameters
    ----------
    found
        (view, row, col, RGB) code values 0..1, which are overwritten.
    views, axis
        The frame, by `views_of`.
    screen
        (row, col) pixels that change.
    pixels
        Its layout.
    noise
        Number of the frame, of whose own noise integer codes get; None for the nearest codes.
    """
    out = np.array(views)
    if not pixels.floating:
        found *= np.float32(pixels.largest)
        if noise is None:
            np.rint(found, out=found)
        else:
            dither(found, pixels.largest, (1, noise))
    np.copyto(out[..., :3], found.astype(pixels.dtype), where=screen[None, :, :, None])
    return np.concatenate(list(out), axis) if len(out) > 1 else out[0]
