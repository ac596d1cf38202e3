"""What image formats differ in, and what holds where a format says nothing else.

OpenImageIO decodes and encodes. What it does not tell of a file, does not check or does not keep is
a format's own, in its module.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, Literal, Self, TypeAlias, final

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import InputError, reason
from domesim.frames.colour import (
    ColourTag,
    colour_of_cicp,
    colour_of_profile,
    interop_named,
    is_srgb,
)
from domesim.frames.depths import FLOATING
from domesim.frames.eyes import Eyes
from domesim.frames.messages import problem_of
from domesim.host.system import in_memory

Window: TypeAlias = tuple[int, int, int, int]
"""Left, top, cols, rows."""

Piece: TypeAlias = "bytes | memoryview[int]"
"""Of a file's bytes."""


@dataclass(frozen=True)
class Format:
    """An image format; and what a file of it says that OpenImageIO does not tell. Abstract.

    The table's formats are of no file yet. Plain Python, so that it can be pickled.
    """

    name: str  # as OpenImageIO calls it
    label: str  # as people call it
    suffixes: tuple[str, ...] = ()  # of files that are written in it; none if it is only read
    depths: tuple[int, ...] = ()  # bits of a sample, as they are written
    eyes: Eyes | None = None  # how two views are packed, if the file says so
    # None where OpenImageIO reads it:
    turned: int | None = None  # Exif's number for its orientation
    aspect: float | None = None  # width of a pixel by its height
    unassociated: bool | None = None  # whether colours are not multiplied by alpha
    stored_anew: Sequence[Piece] = ()  # the file as OpenImageIO can read it, piece by piece
    stored: int = 0  # bytes of that, which is let go when it is open
    notes: tuple[str, ...] = ()  # for a person

    starts: ClassVar[tuple[bytes, ...]] = ()  # what files begin with that `examined` is to see
    wanted: ClassVar[str] = "R, G, B"  # what they must hold
    channels: ClassVar[Literal["rgb", "alpha", "any"]] = "rgb"
    """What it takes of another format's channels; "any" have names, types and a data window."""
    straight: ClassVar[Literal["never", "always", "either"]] = "never"
    """Whether colours are stored that are not multiplied by alpha."""
    shaped: ClassVar[bool] = False  # its pixel aspect is meant: others tell how densely to print
    largest_ratio: ClassVar[float] = np.inf
    """Decoded bytes a byte of file. zlib reaches 1032; flat JPEGs stay below it."""
    layered: ClassVar[bool] = False  # its other images are layers of the first
    exif: ClassVar[bool] = False  # by which it says "sRGB"; of others it can merely not say it
    storage: ClassVar[tuple[str, ...]] = ()  # attributes of how it is stored: regular expressions

    # Reading.

    def examined(self, path: Path, file: BinaryIO) -> Self:
        """Add what the file says, and check what OpenImageIO would not.

        Parameters
        ----------
        path
            The file's name, for messages.
        file
            Its bytes.

        Returns
        -------
        format
            This one, with what the file says.

        Raises
        ------
        DamagedError, ValueError
            If it is not all there; or not `wanted`. Says what was got.
        """
        return self

    def introduced(self, path: Path, file: BinaryIO) -> Self:
        """Do what `examined` does, as far as the samples.

        Parameters
        ----------
        path, file
            As for `examined`.

        Returns
        -------
        format
            This one, with what the header says.
        """
        return self.examined(path, file)

    def explain(self, path: Path, problem: str) -> None:
        """Raise an `InputError` if a decoder failed for another reason than damage.

        Parameters
        ----------
        path
            The file's name, for messages.
        problem
            What the decoder said.
        """

    def windows(self, path: Path, spec: Any) -> tuple[Window, Window]:
        """Where the samples lie in the picture.

        Parameters
        ----------
        path
            The file's name, for messages.
        spec
            OpenImageIO's, of the file.

        Returns
        -------
        data, display
            The data and the display window.
        """
        # What PNG (oFFs) and TIFF (XPosition) tell is a place on a sheet of paper.
        return (0, 0, spec.width, spec.height), (0, 0, spec.width, spec.height)

    def colour(self, path: Path, spec: Any) -> ColourTag:
        """What the file says of its colour, or else what is usual for its format.

        Parameters
        ----------
        path, spec
            As for `windows`.

        Returns
        -------
        colour
            Transfer function and primaries.

        Raises
        ------
        InputError
            If that is not supported.
        """
        own = self._colour(path, spec)
        return colour_of_cicp(path, spec) or colour_of_profile(path, spec) or own

    def _colour(self, path: Path, spec: Any) -> ColourTag:
        space = spec.get_int_attribute("Exif:ColorSpace")
        found = colour_of_exif(space, _interoperability(path) if space == UNCALIBRATED else "")
        if found is not None:
            return found
        stated = spec.get_string_attribute("oiio:ColorSpace")
        named = interop_named(path, stated)
        if named and named[0] != "srgb":  # sRGB is OpenImageIO's own guess
            return ColourTag(*named, f"file: {stated}")
        if str(spec.format) in FLOATING:
            return ColourTag("linear", "BT.709", f"assumed for floating {self.label}")
        return ColourTag("srgb", "BT.709", f"assumed for {self.label}")

    def is_legal(self, spec: Any, bits: int) -> bool:
        """Whether integer codes lie between black and white of video.

        Parameters
        ----------
        spec
            OpenImageIO's, of the file.
        bits
            Bits a sample.

        Returns
        -------
        legal
            False for full range.
        """
        return False

    def is_padded(self, path: Path, rgb: NDArray[Any], bits: int, colour: ColourTag) -> bool:
        """Whether samples of 16 bits have 12, and four that are 0.

        Parameters
        ----------
        path
            The file's name, for messages.
        rgb
            (row, col, RGB) codes.
        bits
            Bits a sample, as stored.
        colour
            What the codes mean.

        Returns
        -------
        padded
            False if all 16 bits count.
        """
        return False

    def invented(self) -> frozenset[str]:
        """Attributes that OpenImageIO invents: the file has none of them."""
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
        """The format as it is to be written to a file.

        Parameters
        ----------
        path
            The file to write.
        colour
            What its codes will mean.
        sides
            Rows and cols, pixels.
        bits
            The depth that was asked for, if any.

        Returns
        -------
        format
            This one, or a variant that the file needs.

        Raises
        ------
        InputError
            If it cannot hold that.
        """
        return self

    def is_reduced(self) -> bool:
        """Whether it takes less than the format can hold: R, G, B alone, at its own depth."""
        return False

    def fitting_depth(self, bits: int, transfer: str, *, floating: bool) -> int:
        """The least depth that holds every code value, or else the largest there is.

        Parameters
        ----------
        bits
            Bits a sample of the master.
        transfer
            Name of its transfer function.
        floating
            Whether its samples are.

        Returns
        -------
        depth
            Bits a sample.
        """
        fitting = (depth for depth in self.depths if depth >= bits and not floating)
        return next(fitting, self.depths[-1])

    def is_floating(self, bits: int) -> bool:
        """Whether it has floating samples at that depth."""
        return False

    def pads(self, bits: int, transfer: str) -> bool:
        """Whether samples of 12 bits go into 16, with four that are 0.

        Parameters
        ----------
        bits
            Bits a sample.
        transfer
            Name of the transfer function.

        Returns
        -------
        pads
            False if 12 bits are stored as 12, or scaled.
        """
        return False

    def state_storage(self, spec: Any, target: Target) -> None:
        """Tell the encoder of compression and the like.

        Parameters
        ----------
        spec
            OpenImageIO's, of the file to write; it is changed.
        target
            What is to be written.
        """

    def state_colour(self, spec: Any, colour: ColourTag) -> None:
        """Name the encoding, where the format can and would otherwise be taken for another.

        Parameters
        ----------
        spec
            OpenImageIO's, of the file to write; it is changed.
        colour
            What the codes mean.
        """
        if self.exif and is_srgb(colour) and not colour.assumed:
            spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")

    def encoded(self, path: Path, spec: Any, samples: NDArray[Any]) -> bytes:
        """Encode a picture.

        Parameters
        ----------
        path
            The file to write, for messages.
        spec
            OpenImageIO's, of the picture.
        samples
            (row, col, channel) codes.

        Returns
        -------
        content
            The file's bytes.
        """
        return encode(path, self, spec, samples)

    def encoder_suffix(self, path: Path) -> str:
        """What its encoder must see at the end of the file's name, if it looks."""
        return ""

    def stated_eyes(self, eyes: Eyes | None) -> bytes:
        """What says in such a file how two views are packed; nothing if nothing can."""
        return b""

    def finished(self, content: bytes, path: Path, target: Target) -> bytes:
        """Add what OpenImageIO does not write.

        Parameters
        ----------
        content
            The encoded file.
        path
            The file to write.
        target
            What is to be written.

        Returns
        -------
        content
            The file's bytes.
        """
        return content


def encode(path: Path, form: Format, spec: Any, samples: NDArray[Any]) -> bytes:
    """A file's bytes, by OpenImageIO.

    Parameters
    ----------
    path
        The file to write, for messages.
    form
        Its format.
    spec
        OpenImageIO's specification.
    samples
        (row, col, channel).

    Returns
    -------
    content
        All of the file.

    Raises
    ------
    InputError
        If there is no room, or OpenImageIO does not write that.
    """
    with ExitStack() as stack:
        try:
            memory, place = stack.enter_context(in_memory(form.encoder_suffix(path)))
        except OSError as error:
            raise InputError(
                f"{path}: wanted room for temporary files, got '{reason(error)}'. Free some space "
                "there, or set TMPDIR."
            ) from error
        writer = stack.enter_context(writer_of(form.name))
        # A close that succeeds may still leave an error behind: TIFF complains of empty Exif.
        written = (
            writer.open(place, spec)
            and writer.write_image(np.ascontiguousarray(samples))
            and not writer.has_error
        )
        problem = problem_of(writer)
        closed = writer.close()
        problem = problem or problem_of(writer)
        if not (written and closed):
            raise InputError(
                f"{path}: wanted to encode a {form.label}, got '{problem}'. Write another format."
            )
        memory.seek(0)
        return memory.read()


@contextmanager
def writer_of(name: str) -> Iterator[Any]:
    """OpenImageIO's writer of a format, by its name or a file's; closed in the end."""
    writer: Any = oiio.ImageOutput.create(name)
    with closing(writer):
        yield writer


_SRGB, _ADOBE_RGB, UNCALIBRATED = 1, 2, 65535  # of Exif's ColorSpace; 2 as cameras write it
_INTEROPERABILITY = 0xA005  # Exif's directory


@contextmanager
def by_pillow(path: Path) -> Iterator[Any]:
    """Pillow's picture, of any size: `refuse_sides` looks at that."""
    from PIL import Image  # noqa: PLC0415 - few files need it

    most, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        with Image.open(path) as opened:
            yield opened
    finally:
        Image.MAX_IMAGE_PIXELS = most


def colour_of_exif(space: int, index: str) -> ColourTag | None:
    """The colour that Exif states.

    Parameters
    ----------
    space
        Its ColorSpace.
    index
        Its InteroperabilityIndex: R03 is Adobe RGB (CIPA DC-009, 4.2).

    Returns
    -------
    colour
        None if it states none.
    """
    if space == _SRGB:
        return ColourTag("srgb", "BT.709", "file: Exif")
    if space == _ADOBE_RGB or (space == UNCALIBRATED and index.strip("\0 ") == "R03"):
        return ColourTag("gamma2.2", "Adobe RGB", "file: Exif, Adobe RGB")
    return None


def index_of(exif: Any) -> str:
    """InteroperabilityIndex of Pillow's Exif; "" if there is none."""
    return str(exif.get_ifd(_INTEROPERABILITY).get(1, ""))


def _interoperability(path: Path) -> str:
    try:
        with by_pillow(path) as opened:
            return index_of(opened.getexif())
    except (OSError, ValueError, SyntaxError):  # damaged, or of no format of Pillow's
        return ""


class CameraRawError(InputError):
    """A file is what a camera's sensor gave, no picture."""


def camera_raw(path: Path) -> CameraRawError:
    """The error for what a camera's sensor gave."""
    return CameraRawError(
        f"{path}: wanted a picture, got a camera's raw file. Develop it first, in linear light for "
        f"measurements ({ADVICE['develop'].given()})."
    )


def animated(path: Path) -> InputError:
    """The error for a picture of several frames."""
    return InputError(
        f"{path}: wanted one picture, got an animation. Save each of its frames as a picture."
    )


@final
@dataclass(frozen=True)
class Plain(Format):
    """A format that OpenImageIO reads and writes in full."""


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
