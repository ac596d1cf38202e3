"""A frame: code values, what they mean, and all else that its file holds."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.frames.colour import ColourTag
from domesim.frames.depths import code_range
from domesim.frames.eyes import Eyes
from domesim.frames.formats.base import Format
from domesim.frames.formats.exr import Part
from domesim.frames.halves import are_sound
from domesim.frames.orientation import UPRIGHT

Pixels: TypeAlias = NDArray[np.float32]
"""(row, col, 3) float32: R, G, B code values; 1.0 is the largest code of an integer format."""


def as_codes(pixels: ArrayLike) -> Pixels:
    """Pixels as float32; halves stay half."""
    found = np.asarray(pixels)
    return found if found.dtype == np.float16 else found.astype(np.float32, copy=False)


@dataclass(frozen=True)
class Header:
    """What a file holds besides R, G, B; plain Python, so that a frame can be pickled."""

    format: str = ""  # for a person; "" for a frame that came from no file
    file: Format | None = None  # what else an image file states; None for videos
    attributes: tuple[tuple[str, str, Any], ...] = ()  # name, type, value
    channels: tuple[str, ...] = ("R", "G", "B")
    kinds: tuple[str, ...] = ("float", "float", "float")  # each channel's type in the file
    rgb: tuple[int, int, int] = (0, 1, 2)  # which channels R, G, B are
    extra: tuple[NDArray[Any], ...] = ()  # (row, col) as stored, one for each other channel
    origin: tuple[int, int] = (0, 0)  # of the display window: col, row
    colour: ColourTag | None = None  # as the file has it; None if that is not supported
    zero_padded: bool = False  # 12 bits in 16, the lower four 0
    legal: bool = False  # black and white are 64 and 940 of 10 bits
    straight: bool = False  # its colours are not multiplied by alpha
    orientation: int = UPRIGHT  # Exif's number
    eyes: Eyes | None = None  # how two views are packed, if it says so
    notes: tuple[str, ...] = ()  # what a person should know of how it was read
    parts: tuple[int | Part, ...] = (0,)  # of its EXR: 0 is its own

    @property
    def alpha(self) -> int | None:
        """Which of `extra` is alpha, of the same layer as R, G, B; None if none is."""
        layer = self.channels[self.rgb[0]].rpartition(".")[0]
        wanted = f"{layer}.A" if layer else "A"
        others = [name for k, name in enumerate(self.channels) if k not in self.rgb]
        return next((k for k, name in enumerate(others) if name.upper() == wanted.upper()), None)


@dataclass(frozen=True, eq=False)
class Frame:
    """One image: its code values, what they mean, and all else its file holds.

    Attributes
    ----------
    pixels
        (row, col, 3) float32, R, G, B code values of the picture as it is shown: upright, and over
        black if it has an alpha. Integer formats are scaled so that 1.0 is the largest code;
        floating formats are as stored. In frames of shows, halves may stay half (`read_master`).
    path
        Where it was read.
    colour
        What the code values mean.
    bits
        Bits of a sample in the file: 8, 10, 12, 16 or 32.
    floating
        Whether the format is floating: not quantised, values outside 0..1 possible.
    repaired
        How many samples were NaN, infinite or negative and were replaced.
    """

    pixels: Pixels
    path: Path
    colour: ColourTag
    bits: int
    floating: bool
    repaired: int = 0
    header: Header = field(default_factory=Header, repr=False)

    def with_pixels(self, pixels: ArrayLike) -> Frame:
        """The same file with other R, G, B.

        Raises
        ------
        InputError
            If `pixels` has not this frame's shape.
        """
        new = as_codes(pixels)
        if new.shape != self.pixels.shape:
            raise InputError(f"Frame.with_pixels takes {self.pixels.shape}, got {new.shape}")
        return replace(self, pixels=new)

    @property
    def code_range(self) -> tuple[float, float]:
        """The least and the largest code value that its format can hold at its depth."""
        return code_range(self.bits, floating=self.floating)

    @cached_property
    def brightest_half(self) -> float | None:
        """The largest code value, if all are halves that `are_sound`; else None."""
        halves: NDArray[Any] = np.asarray(self.pixels)
        if halves.dtype != np.float16 or not are_sound(halves):
            return None
        return float(halves.view(np.uint16).max().view(np.float16))

    def described(self) -> str:
        """One phrase for a person: ``2048 x 2048 JPEG, 8 bit, sRGB (assumed for JPEG)``."""
        rows, cols = self.pixels.shape[:2]
        kind = f"{self.bits} bit float" if self.floating else f"{self.bits} bit"
        name = self.header.format or "frame"
        meaning = f"{self.colour.named} ({self.colour.source})"
        if self.colour.primaries == "P3-DCI":
            meaning += ", its white kept (p3-d65 would make it the projector's)"
        return "; ".join([f"{cols} x {rows} {name}, {kind}, {meaning}", *self.header.notes])
