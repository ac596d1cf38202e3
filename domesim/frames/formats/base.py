"""What image formats differ in, and what holds where a format says nothing else.

OpenImageIO decodes and encodes. What it does not tell of a file, does not check or does not keep is
a format's own, in its module.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, Literal, Self, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from domesim.frames.colour import (
    ColourTag,
    colour_of_cicp,
    colour_of_profile,
    interop_named,
    is_srgb,
)
from domesim.frames.depths import FLOATING
from domesim.frames.eyes import Eyes

Window: TypeAlias = tuple[int, int, int, int]
"""Left, top, cols, rows."""


@dataclass(frozen=True)
class Format:
    """An image format; and what a file of it says that OpenImageIO does not tell. Abstract.

    The table has one that no file said anything to. Plain Python, so that it can be pickled.
    """

    name: str  # as OpenImageIO calls it
    label: str  # as people call it
    suffixes: tuple[str, ...] = ()  # of files that are written in it; none if it is only read
    depths: tuple[int, ...] = ()  # bits of a sample, as they are written
    eyes: Eyes | None = None  # how two views are packed, if the file says so
    # None where OpenImageIO tells:
    turned: int | None = None  # Exif's number for its orientation
    aspect: float | None = None  # width of a pixel by its height
    unassociated: bool | None = None  # whether colours are not multiplied by alpha
    stored_anew: bytes | None = None  # the file as OpenImageIO can read it

    starts: ClassVar[tuple[bytes, ...]] = ()  # what files begin with that `examined` is to see
    wanted: ClassVar[str] = "R, G, B"  # what they must hold
    channels: ClassVar[Literal["rgb", "alpha", "any"]] = "rgb"
    """What it takes of another format's channels; "any" have names, types and a data window."""
    straight: ClassVar[Literal["never", "always", "either"]] = "never"
    """Whether colours are stored that are not multiplied by alpha."""
    shaped: ClassVar[bool] = False  # its pixel aspect is meant: others tell how densely to print
    largest_ratio: ClassVar[float] = np.inf
    """Decoded bytes a byte of file. zlib reaches 1032; flat JPEGs stay below it."""
    exif: ClassVar[bool] = False  # by which it says "sRGB"; of others it can merely not say it
    storage: ClassVar[tuple[str, ...]] = ()  # attributes of how it is stored: regular expressions
    kept: ClassVar[tuple[str, ...] | None] = None
    """Its attributes that OpenImageIO is to write back, if not all but `storage`."""

    # Reading.

    def examined(self, path: Path, file: BinaryIO) -> Self:
        """With what the file says, which is checked as far as OpenImageIO would not.

        Raises
        ------
        DamagedError, ValueError
            If it is not all there; or not `wanted`. Says what was got.
        """
        return self

    def introduced(self, path: Path, file: BinaryIO) -> Self:
        """`examined` as far as the samples; raises as that does."""
        return self.examined(path, file)

    def explain(self, path: Path, problem: str) -> None:
        """Raise an `InputError` if a decoder's problem is none of damage."""

    def windows(self, path: Path, spec: Any) -> tuple[Window, Window]:
        """The data and the display window."""
        # What PNG (oFFs) and TIFF (XPosition) tell is a place on a sheet of paper.
        return (0, 0, spec.width, spec.height), (0, 0, spec.width, spec.height)

    def colour(self, path: Path, spec: Any) -> ColourTag:
        """What the file says of its colour, or else what is usual for its format.

        Raises
        ------
        InputError
            If that is not supported.
        """
        own = self._colour(path, spec)
        return colour_of_cicp(path, spec) or colour_of_profile(path, spec) or own

    def _colour(self, path: Path, spec: Any) -> ColourTag:
        if spec.get_int_attribute("Exif:ColorSpace") == 1:
            return ColourTag("srgb", "BT.709", "file: Exif")
        stated = spec.get_string_attribute("oiio:ColorSpace")
        named = interop_named(path, stated)
        if named and named[0] != "srgb":  # sRGB is OpenImageIO's own guess
            return ColourTag(*named, f"file: {stated}")
        if str(spec.format) in FLOATING:
            return ColourTag("linear", "BT.709", f"assumed for floating {self.label}")
        return ColourTag("srgb", "BT.709", f"assumed for {self.label}")

    def is_legal(self, spec: Any, bits: int) -> bool:
        """Whether integer codes lie between black and white of video."""
        return False

    def is_padded(self, path: Path, rgb: NDArray[Any], bits: int, colour: ColourTag) -> bool:
        """Whether samples of 16 bits have 12, and four that are 0."""
        return False

    def invented(self) -> frozenset[str]:
        """Attributes that OpenImageIO tells, and the file does not."""
        return frozenset()

    def exposed(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """(row, col, 3) as stored -> code values."""
        return pixels

    def of_part(self, part: int) -> Self:
        """What a frame keeps of the file it is from."""
        return self

    # Writing.

    def aimed_at(
        self, path: Path, colour: ColourTag, sides: tuple[int, ...], bits: int | None
    ) -> Self:
        """As it is to be written there: `sides` are rows and cols, `bits` those asked for.

        Raises
        ------
        InputError
            If it cannot be.
        """
        return self

    def is_reduced(self) -> bool:
        """Whether it takes less than the format can hold: R, G, B alone, at its own depth."""
        return False

    def fitting_depth(self, bits: int, transfer: str, *, floating: bool) -> int:
        """The least depth that holds every code value, or else the largest there is."""
        fitting = (depth for depth in self.depths if depth >= bits and not floating)
        return next(fitting, self.depths[-1])

    def is_floating(self, bits: int) -> bool:
        """Whether it has floating samples at that depth."""
        return False

    def pads(self, bits: int, transfer: str) -> bool:
        """Whether those of 12 bits go into 16, with four that are 0."""
        return False

    def state_storage(self, spec: Any, target: Target) -> None:
        """Tell the encoder of compression and the like."""

    def state_colour(self, spec: Any, colour: ColourTag) -> None:
        """Name the encoding, where the format can and would otherwise be taken for another."""
        if self.exif and is_srgb(colour) and not colour.assumed:
            spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")

    def headed(self, spec: Any, samples: NDArray[Any]) -> tuple[Any, NDArray[Any]]:
        """What OpenImageIO is to encode: all, or so little that the header comes of it."""
        return spec, samples

    def filled(self, content: bytes, samples: NDArray[Any]) -> bytes:
        """What OpenImageIO made of `headed`, with all samples."""
        return content

    def encoder_suffix(self, path: Path) -> str:
        """What its encoder must see at the end of the file's name, if it looks."""
        return ""

    def stated_eyes(self, eyes: Eyes | None) -> bytes:
        """What says in such a file how two views are packed; nothing if nothing can."""
        return b""

    def finished(self, content: bytes, path: Path, target: Target) -> bytes:
        """What an encoder made, with what OpenImageIO does not write."""
        return content


@final
@dataclass(frozen=True)
class Plain(Format):
    """A format that OpenImageIO reads, writes and tells everything of."""


@dataclass(frozen=True)
class Target:
    """What is to be written: the format, its depth, and its channels in order."""

    format: Format  # that which the frame came from, if `same`
    same: bool
    colour: ColourTag
    keeps_colour: bool  # what the frame's file said of it still holds, and is all there is to say
    bits: int
    floating: bool
    channels: tuple[str, ...]
    kinds: tuple[str, ...]
    sources: tuple[int, ...]  # 0, 1, 2: R, G, B; 3 + k: extra channel k; -1: luminance
    straight: bool  # colours are to be divided by alpha
    zero_padded: bool  # 12 bits in 16
    legal: bool  # between black and white of video
    said: Mapping[str, Any]  # attributes of the file that the frame came from
    eyes: Eyes | None
