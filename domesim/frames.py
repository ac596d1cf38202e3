"""Frames: image files <-> code values and their colour.

`read_frame` takes an image file to R, G, B code values, a `ColourTag` that says what they mean,
and a header that keeps everything else the file holds; `write_frame` takes them back. What a user
did not ask to change survives: bit depth, metadata, channel order, alpha and other channels.

Two promises shape the code. A damaged file is an error, never a picture with a black or grey part.
And an output is whole or not there: it is encoded in memory, because some encoders of OpenImageIO
end the whole process on a full disk (JPEG) or report success (PNG); Python then writes the bytes
under a temporary name and renames them.

Code values are as stored: nothing here linearises, premultiplies or rotates (an ``Orientation`` is
carried along). An EXR is read over its display window.
"""

from __future__ import annotations

import errno
import os
import re
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError

Pixels: TypeAlias = NDArray[np.float32]
"""(row, col, 3) float32: R, G, B code values; 1.0 is the largest code of an integer format."""

LARGEST_SIDE = 32768
"""Pixels; a header that claims more is taken for damaged, before memory is asked for."""


@dataclass(frozen=True)
class ColourTag:
    """What code values mean, and where that is known from.

    Attributes
    ----------
    transfer
        "srgb", "linear", "gamma2.2", "gamma2.4", "gamma2.6", "bt1886", "st2084" or "dcdm".
    primaries
        "BT.709", "P3-D65", "P3-DCI", "BT.2020", "XYZ", "ACES AP0" or "ACES AP1".
    source
        For a person: "file: chromaticities", "assumed for JPEG", ...
    """

    transfer: str
    primaries: str
    source: str

    def means_the_same_as(self, other: ColourTag) -> bool:
        """Whether transfer and primaries agree, wherever they are known from."""
        return (self.transfer, self.primaries) == (other.transfer, other.primaries)


@dataclass(frozen=True)
class _Header:
    """What a file holds besides R, G, B; plain Python, so that a frame can be pickled."""

    format: str = ""  # as OpenImageIO calls it; "" for a frame that came from no file
    attributes: tuple[tuple[str, str, Any], ...] = ()  # name, type, value
    channels: tuple[str, ...] = ("R", "G", "B")
    kinds: tuple[str, ...] = ("float", "float", "float")  # each channel's type in the file
    rgb: tuple[int, int, int] = (0, 1, 2)  # which channels R, G, B are
    extra: tuple[NDArray[Any], ...] = ()  # (row, col) as stored, one for each other channel
    origin: tuple[int, int] = (0, 0)  # of the display window: col, row
    colour: ColourTag | None = None  # as read
    colour_chunks: bytes = b""  # PNG: see _COLOUR_CHUNKS
    big_endian: bool = True  # DPX


@dataclass(frozen=True, eq=False)
class Frame:
    """One image: its code values, what they mean, and all else its file holds.

    Attributes
    ----------
    pixels
        (row, col, 3) float32, R, G, B code values. Integer formats are scaled so that 1.0 is the
        largest code; floating formats are as stored.
    path
        Where it was read.
    colour
        What the code values mean.
    bits
        Of a sample in the file: 8, 10, 12, 16 or 32.
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
    header: _Header = field(default_factory=_Header, repr=False)

    def with_pixels(self, pixels: ArrayLike) -> Frame:
        """The same file with other R, G, B.

        Raises
        ------
        ValueError
            If `pixels` has not this frame's shape.
        """
        new = np.asarray(pixels, dtype=np.float32)
        if new.shape != self.pixels.shape:
            raise ValueError(f"Frame.with_pixels takes {self.pixels.shape}, got {new.shape}")
        return replace(self, pixels=new)

    def described(self) -> str:
        """One phrase for a person: ``2048 x 2048 JPEG, 8 bit, sRGB (assumed for JPEG)``."""
        rows, cols = self.pixels.shape[:2]
        kind = f"{self.bits} bit float" if self.floating else f"{self.bits} bit"
        transfer = _TRANSFER_NAMES.get(self.colour.transfer, self.colour.transfer)
        primaries = "" if self.colour.primaries == "BT.709" else f" {self.colour.primaries}"
        label = _label(self.header.format) or "frame"
        return f"{cols} x {rows} {label}, {kind}, {transfer}{primaries} ({self.colour.source})"


def read_frame(path: str | Path, *, repair: bool = False) -> Frame:
    """Read an image file: EXR, PNG, TIFF, DPX, JPEG, and what else is in `_LABELS`.

    Parameters
    ----------
    path
        The file. Its content decides what it is, not its suffix.
    repair
        Replace NaN and negative samples by 0 and +Inf by the channel's largest finite value,
        instead of refusing them.

    Raises
    ------
    InputError
        If the file is missing, damaged or truncated, not an image, of several images, not RGB,
        encoded in a way that is not supported, larger than its display window (overscan), or
        holds NaN, Inf or negative samples and `repair` is off.
    """
    path = Path(path)
    container = _examine(path)
    reader = _open(path)
    try:
        layout = _layout(path, reader)
        colour = _colour(path, reader.spec(), layout.format, container.colour_chunks)
        rgb, extra = _read_channels(path, reader, layout)
        _refuse_several_images(path, reader)
    finally:
        reader.close()

    pixels = _code_values(rgb, layout.bits)
    repaired = 0
    if layout.floating:
        pixels, repaired = _without_impossible_samples(path, pixels, repair=repair)
    header = _Header(
        format=layout.format,
        attributes=layout.attributes,
        channels=layout.channels,
        kinds=layout.kinds,
        rgb=layout.rgb,
        extra=tuple(_over_display_window(plane, layout) for plane in extra),
        origin=layout.display[:2],
        colour=colour,
        colour_chunks=container.colour_chunks,
        big_endian=container.big_endian,
    )
    return Frame(
        pixels=_over_display_window(pixels, layout),
        path=path,
        colour=colour,
        bits=layout.bits,
        floating=layout.floating,
        repaired=repaired,
        header=header,
    )


def write_frame(frame: Frame, path: str | Path, *, bits: int | None = None) -> None:
    """Write `frame` to `path`, whole or not at all.

    The suffix names the format. The format that the frame came from keeps its bit depth, metadata
    and all channels. Another format gets the least depth that holds every code value, the metadata
    that it knows, alpha unless it is DPX or JPEG, and other channels if it is EXR. The pixels are
    written as they are: for another encoding, give `frame` other pixels *and* another `colour`.

    JPEG is written at quality 100 without chroma subsampling. Re-encoding what was decoded from a
    JPEG then moves no sample by more than 4 codes, and 97 % (noise) to 99.8 % (a domemaster) of
    them by at most one; at quality 98 it was 10 codes and 74 % to 99.5 %.

    Parameters
    ----------
    frame
        Integer formats need its pixels finite and in 0..1; they are rounded to the nearest code,
        ties to even.
    path
        ``.exr``, ``.png``, ``.tif``, ``.tiff``, ``.dpx``, ``.jpg``, ``.jpeg``.
    bits
        Of a sample: EXR 16 or 32 (float), PNG 8 or 16, TIFF 8 or 16 (integer) or 32 (float), DPX
        8, 10, 12 or 16, JPEG 8.

    Raises
    ------
    InputError
        If the suffix or `bits` is not one of these, or `path` cannot be written (no such folder,
        not writable, disk full, ...). A file that was there before is then still there, unchanged.
    ValueError
        If pixels are not finite, or not what the format can hold.
    """
    path = Path(path)
    target = _target(frame, path, bits)
    spec, samples = _specification(frame, target), _samples(frame, target)
    encoded = _encode(path, target.format, spec, samples)
    if target.format == "png":
        encoded = _with_colour_chunks(encoded, _colour_chunks(frame, target))
    if target.format == "dpx":
        encoded = _with_dpx_name(encoded, path.name)
    _replace(path, encoded)


# What there is to know of formats.

_LABELS = {
    "openexr": "EXR",
    "png": "PNG",
    "tiff": "TIFF",
    "dpx": "DPX",
    "jpeg": "JPEG",
    # Read only. Each of these was seen to notice truncation; OpenImageIO also has formats that
    # do not (and one, "null", that makes images up), hence a list.
    "bmp": "BMP",
    "hdr": "HDR",
    "iff": "IFF",
    "jpeg2000": "JPEG 2000",
    "jpegxl": "JPEG XL",
    "pnm": "PNM",
    "rla": "RLA",
    "sgi": "SGI",
    "targa": "TGA",
    "webp": "WebP",
}
_FORMATS = {
    ".exr": "openexr",
    ".png": "png",
    ".tif": "tiff",
    ".tiff": "tiff",
    ".dpx": "dpx",
    ".jpg": "jpeg",
    ".jpeg": "jpeg",
    ".jpe": "jpeg",
}
_DEPTHS = {
    "openexr": (16, 32),
    "png": (8, 16),
    "tiff": (8, 10, 12, 16, 32),
    "dpx": (8, 10, 12, 16),
    "jpeg": (8,),
}
_INTEGER = {"uint8": 8, "uint16": 16}
_FLOATING = {"half": 16, "float": 32}
_LARGEST_HALF = 65504.0

# Decoded bytes a byte of file. zlib reaches 1032; flat JPEGs stay below it; PIZ and DWA know no
# useful limit, and of DPX OpenImageIO checks it itself.
_LARGEST_RATIO = {"openexr": 1100.0, "png": 1100.0, "tiff": 1100.0, "jpeg": 1100.0}
_UNLIMITED_COMPRESSION = ("piz", "dwaa", "dwab", "htj2k")


def _label(name: str) -> str:
    return _LABELS.get(name, name)


# What there is to know of colour.

_TRANSFER_NAMES = {
    "srgb": "sRGB",
    "gamma2.2": "gamma 2.2",
    "gamma2.4": "gamma 2.4",
    "gamma2.6": "gamma 2.6",
    "bt1886": "BT.1886",
    "st2084": "ST 2084",
    "dcdm": "DCDM",
}

# x, y of red, green, blue and white: ITU-R BT.709-6 and BT.2020-2, SMPTE RP 431-2 (DCI white and
# D65), SMPTE ST 2065-1 (AP0), ACES TB-2014-004 via AMPAS S-2014-004 (AP1); XYZ with white E.
_CHROMATICITIES = {
    "BT.709": (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3127, 0.3290),
    "P3-D65": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
    "P3-DCI": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3140, 0.3510),
    "BT.2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    "XYZ": (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3),
    "ACES AP0": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, 0.32168, 0.33767),
    "ACES AP1": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
}

# Identifiers of the Color Interop Forum, which OpenImageIO and EXR's colorInteropID use:
# transfer_primaries_state, such as "g24_rec709_display".
_INTEROP = re.compile(r"(lin|srgbe?|g\d\d|pq|hlg)_(\w+)_(scene|display)")
_INTEROP_TRANSFERS = {
    "lin": "linear",
    "srgb": "srgb",
    "g22": "gamma2.2",
    "g24": "gamma2.4",
    "g26": "gamma2.6",
    "pq": "st2084",
}
_INTEROP_PRIMARIES = {
    "rec709": "BT.709",
    "p3d65": "P3-D65",
    "rec2020": "BT.2020",
    "ciexyzd65": "XYZ",
    "xyzd65": "XYZ",
    "ap0": "ACES AP0",
    "ap1": "ACES AP1",
}

# ITU-T H.273 code points. 1, 6, 14 and 15 are one camera curve, which displays decode by BT.1886.
_CICP_TRANSFERS = {
    1: "bt1886",
    4: "gamma2.2",
    6: "bt1886",
    8: "linear",
    13: "srgb",
    14: "bt1886",
    15: "bt1886",
    16: "st2084",
    17: "dcdm",
}
_CICP_PRIMARIES = {1: "BT.709", 9: "BT.2020", 10: "XYZ", 11: "P3-DCI", 12: "P3-D65"}

# SMPTE ST 268-1, transfer characteristic, by OpenImageIO's names. Video is decoded as a monitor
# does; nothing more than sRGB can be assumed of the rest; film densities are not light at all.
_DPX_TRANSFERS = {
    "Linear": "linear",
    "SMPTE 274M": "bt1886",
    "ITU-R 709-4": "bt1886",
    "ITU-R 601-5 system B or G": "bt1886",
    "ITU-R 601-5 system M": "bt1886",
    "User defined": None,
    "Unspecified video": None,
    "Undefined": None,
}


# Reading: is it all there?


@dataclass(frozen=True)
class _Container:
    """What the examination of a file's bytes found, for OpenImageIO does not tell it."""

    colour_chunks: bytes = b""
    big_endian: bool = True


def _examine(path: Path) -> _Container:
    """Check that `path` is a file and, as far as OpenImageIO would not, that it is complete."""
    try:
        if path.is_dir():
            raise InputError(f"{path}: wanted an image file, got a folder. Name a file in it.")
        if not path.exists():
            raise InputError(f"{path}: wanted an image file, there is none. Check the path.")
        if not path.is_file():
            raise InputError(f"{path}: wanted an image file, got a device or pipe. Name a file.")
        with path.open("rb") as file:
            return _examine_bytes(path, file)
    except OSError as error:
        raise InputError(
            f"{path}: wanted to read it, got '{_reason(error)}'. Check its path and permissions."
        ) from error


def _examine_bytes(path: Path, file: BinaryIO) -> _Container:
    size = os.fstat(file.fileno()).st_size
    if size == 0:
        raise InputError(f"{path}: wanted an image, got an empty file. Copy or render it again.")
    start = file.read(20)
    if start.startswith(b"\x89PNG\r\n\x1a\n"):
        return _Container(colour_chunks=_examine_png(path, start + file.read()))
    if start[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        _examine_tiff(path, file, size, start)
    if start[:4] in (b"SDPX", b"XPDS"):
        return _Container(big_endian=_examine_dpx(path, size, start))
    return _Container()


# What libpng knows of colour; OpenImageIO writes its own in their place and loses cHRM.
_COLOUR_CHUNKS = (b"cICP", b"sRGB", b"gAMA", b"cHRM", b"mDCV", b"cLLI")


def _chunks(png: bytes) -> Iterator[tuple[bytes, bytes]]:
    """(type, whole chunk) of each chunk that is entirely there."""
    position = 8
    while position + 12 <= len(png):
        (length,) = struct.unpack_from(">I", png, position)
        end = position + 12 + length
        if end > len(png):
            return
        yield png[position + 4 : position + 8], png[position:end]
        position = end


def _examine_png(path: Path, png: bytes) -> bytes:
    """Check all checksums up to IEND, and return the chunks that speak of colour.

    libpng would notice most damage, too, but it prints to stderr, does not miss an IEND, and only
    skips a damaged colour chunk.
    """
    colour = b""
    for kind, chunk in _chunks(png):
        if zlib.crc32(chunk[4:-4]) != int.from_bytes(chunk[-4:]):
            name = kind.decode("ascii", "replace")
            raise _damaged(path, "PNG", f"a wrong checksum in chunk {name!r}")
        if kind in _COLOUR_CHUNKS:
            colour += chunk
        if kind == b"IEND":
            return colour
    raise _damaged(path, "PNG", "one that ends early")


_TIFF_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
_TIFF_SIZES |= {16: 8, 17: 8, 18: 8}
_TIFF_EXIF = 34665


def _examine_tiff(path: Path, file: BinaryIO, size: int, start: bytes) -> None:
    """Check that all tags lie within the file.

    libtiff notices missing pixels, but drops a tag (an ICC profile at the end, say) in silence.
    """
    order = "<" if start[:2] == b"II" else ">"
    big = start[2:4] in (b"+\0", b"\0+")
    count_format, entry_format = ("Q", "HHQQ") if big else ("H", "HHII")
    word = struct.Struct(order + ("Q" if big else "I"))
    counter, entry = struct.Struct(order + count_format), struct.Struct(order + entry_format)

    def read(position: int, wanted: int) -> bytes:
        if position + wanted > size:
            raise _damaged(path, "TIFF", f"one that ends early, at {size} bytes")
        file.seek(position)
        return file.read(wanted)

    directories = list(word.unpack(read(8 if big else 4, word.size)))
    seen: set[int] = set()
    while directories:
        position = directories.pop()
        if position == 0 or position in seen:
            continue
        seen.add(position)
        (count,) = counter.unpack(read(position, counter.size))
        position += counter.size
        table = read(position, count * entry.size)
        for tag, kind, values, offset in entry.iter_unpack(table):
            if values * _TIFF_SIZES.get(kind, 0) > word.size:
                read(offset + values * _TIFF_SIZES[kind] - 1, 1)
            elif tag == _TIFF_EXIF:
                directories.append(offset)
        directories += word.unpack(read(position + count * entry.size, word.size))


def _examine_dpx(path: Path, size: int, start: bytes) -> bool:
    """Check the size that a DPX header states, and return whether it is big-endian.

    The pixels need no check (OpenImageIO misses them), but what follows them does.
    """
    order = ">" if start[:4] == b"SDPX" else "<"
    if len(start) < 20:
        raise _damaged(path, "DPX", "one that ends early")
    (stated,) = struct.unpack_from(order + "I", start, 16)
    if size < stated != 0xFFFFFFFF:  # all ones: not stated
        raise _damaged(path, "DPX", f"one that ends early, at {size} of {stated} bytes")
    return order == ">"


def _damaged(path: Path, label: str, got: str) -> InputError:
    return InputError(f"{path}: wanted a complete {label}, got {got}. Copy or render it again.")


# Reading: through OpenImageIO.


def _open(path: Path) -> Any:
    # Without UnassociatedAlpha, R, G, B of PNG and TIFF come multiplied by alpha.
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    reader = oiio.ImageInput.open(str(path), config)
    # An error that is not fetched is printed when the process ends.
    problem = _problem(oiio)
    if reader is None:
        raise InputError(
            f"{path}: wanted an image, got something that does not open as one "
            f"({problem}). Copy or render it again, or convert it to EXR or PNG."
        )
    return reader


@dataclass(frozen=True)
class _Layout:
    """What a header says of where the samples are."""

    format: str
    channels: tuple[str, ...]
    kinds: tuple[str, ...]
    rgb: tuple[int, int, int]
    bits: int
    floating: bool
    data: tuple[int, int, int, int]  # window: left, top, cols, rows
    display: tuple[int, int, int, int]
    attributes: tuple[tuple[str, str, Any], ...]


def _layout(path: Path, reader: Any) -> _Layout:
    spec = reader.spec()
    name = reader.format_name()
    if name not in _LABELS:
        raise InputError(
            f"{path}: wanted {', '.join(_LABELS.values())}, got {name}. Convert it to EXR or PNG."
        )
    if spec.deep:
        raise InputError(f"{path}: wanted a flat image, got deep samples. Flatten it first.")
    channels = tuple(spec.channelnames)
    kinds = tuple(str(kind) for kind in spec.channelformats) or (str(spec.format),) * len(channels)
    data, display = _windows(path, spec, name)
    _refuse_implausible_size(path, spec, name, data, display)
    rgb = _find_rgb(path, spec, channels)
    bits, floating = _depth(path, spec, {kinds[channel] for channel in rgb})
    attributes = tuple(
        (attribute.name, str(attribute.type), attribute.value) for attribute in spec.extra_attribs
    )
    return _Layout(name, channels, kinds, rgb, bits, floating, data, display, attributes)


def _windows(
    path: Path, spec: Any, name: str
) -> tuple[tuple[int, int, int, int], tuple[int, int, int, int]]:
    """The data and the display window: left, top, cols, rows."""
    data = (spec.x, spec.y, spec.width, spec.height)
    # Only EXR means it: what PNG (oFFs) and TIFF (XPosition) tell is a place on a sheet of paper.
    if name != "openexr":
        return (0, 0, *data[2:]), (0, 0, *data[2:])
    display = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    inside = all(
        display[axis] <= data[axis]
        and data[axis] + data[axis + 2] <= display[axis] + display[axis + 2]
        for axis in (0, 1)
    )
    if not inside:
        # Light from beyond the edge of the screen is on no screen, and cutting it off unasked
        # would break the promise that a file keeps what it holds.
        raise InputError(
            f"{path}: wanted pixels within the display window {_window(display)}, got overscan "
            f"{_window(data)}. Crop it first (oiiotool IN --crop {_window(display)} -o OUT)."
        )
    return data, display


def _window(window: tuple[int, int, int, int]) -> str:
    left, top, cols, rows = window
    return f"{cols}x{rows}{left:+d}{top:+d}"


def _refuse_implausible_size(
    path: Path,
    spec: Any,
    name: str,
    data: tuple[int, int, int, int],
    display: tuple[int, int, int, int],
) -> None:
    for cols, rows in (data[2:], display[2:]):
        if not (0 < cols <= LARGEST_SIDE and 0 < rows <= LARGEST_SIDE):
            raise InputError(
                f"{path}: wanted 1 to {LARGEST_SIDE} px a side, got {cols} x {rows}. "
                "The header is probably damaged: copy or render it again."
            )
    if spec.depth > 1:
        raise InputError(f"{path}: wanted an image, got a volume of depth {spec.depth}. Slice it.")
    if spec.get_string_attribute("compression") in _UNLIMITED_COMPRESSION:
        return
    decoded, stored = spec.image_bytes(True), path.stat().st_size
    if decoded > _LARGEST_RATIO.get(name, np.inf) * stored:
        raise InputError(
            f"{path}: wanted a whole {_label(name)}, got {stored} bytes for {data[2]} x {data[3]} "
            f"px of {spec.nchannels} channels. It is probably damaged: copy or render it again."
        )


def _find_rgb(path: Path, spec: Any, channels: tuple[str, ...]) -> tuple[int, int, int]:
    """Which channels are R, G, B."""
    # OpenImageIO turns these into an RGB of its own making.
    for attribute in ("jpeg:ColorSpace", "tiff:ColorSpace"):
        model = spec.get_string_attribute(attribute)
        if model not in ("", "RGB", "YCbCr", "palette"):
            raise InputError(f"{path}: wanted channels R, G, B, got {model}. Convert it to RGB.")
    found = [[k for k, name in enumerate(channels) if name.lower() == wanted] for wanted in "rgb"]
    if all(len(matches) == 1 for matches in found):
        red, green, blue = (matches[0] for matches in found)
        return red, green, blue
    grey = next((name for name in channels if name.upper() in ("Y", "L", "I")), None)
    way = "R=Y,G=Y,B=Y".replace("Y", grey) if grey else "R=...,G=...,B=..."
    names = _one_line(", ".join(channels[:8])) + (", ..." if len(channels) > 8 else "")
    raise InputError(
        f"{path}: wanted one each of channels R, G, B, got {names}. "
        f"Convert it to RGB first (oiiotool IN --ch {way} -o OUT)."
    )


def _depth(path: Path, spec: Any, kinds: set[str]) -> tuple[int, bool]:
    """Bits of a sample of R, G, B, and whether they are floating."""
    if kinds <= set(_FLOATING):
        return max(_FLOATING[kind] for kind in kinds), True
    kind = min(kinds)
    if len(kinds) > 1 or kind not in _INTEGER:
        raise InputError(
            f"{path}: wanted R, G, B of 8 to 16 bit integers or 16 or 32 bit floats, "
            f"got {', '.join(sorted(kinds))}. Convert it (oiiotool IN -d float -o OUT)."
        )
    stated = spec.get_int_attribute("oiio:BitsPerSample")
    return (stated if kind == "uint16" and stated in (10, 12) else _INTEGER[kind]), False


def _read_channels(
    path: Path, reader: Any, layout: _Layout
) -> tuple[NDArray[Any], list[NDArray[Any]]]:
    """(row, col, 3) R, G, B and (row, col) others, as they are stored (R, G, B may be widened)."""
    others = [k for k in range(len(layout.channels)) if k not in layout.rgb]
    if len(set(layout.kinds)) == 1:
        # One pass, in the file's own type: OpenImageIO converts half to float 4 times slower
        # than NumPy does.
        samples = _read(path, reader, layout, range(len(layout.channels)), layout.kinds[0])
        plain = layout.rgb == (0, 1, 2) and not others
        rgb = samples if plain else samples[..., list(layout.rgb)]
        return rgb, [np.ascontiguousarray(samples[..., k]) for k in others]
    span = range(min(layout.rgb), max(layout.rgb) + 1)
    rgb = _read(path, reader, layout, span, "float")[..., [span.index(k) for k in layout.rgb]]
    extra = []
    for k in others:
        plane = _read(path, reader, layout, range(k, k + 1), layout.kinds[k])[..., 0]
        _refuse_large_integers(path, layout, k, plane)
        extra.append(plane)
    return rgb, extra


def _read(path: Path, reader: Any, layout: _Layout, channels: range, kind: str) -> NDArray[Any]:
    try:
        samples = reader.read_image(0, 0, channels.start, channels.stop, kind)
    except MemoryError as error:
        raise InputError(
            f"{path}: wanted memory for {_window(layout.data)} px, got none. Use a smaller image."
        ) from error
    problem = _problem(reader)
    if samples is None or problem:
        got = f"one that does not decode ({problem})"
        raise _damaged(path, _label(layout.format), got)
    result: NDArray[Any] = samples
    return result


def _refuse_large_integers(path: Path, layout: _Layout, channel: int, plane: NDArray[Any]) -> None:
    # Channels of several types can only be written through float32, which scales integers to
    # 0..1: below 2^22 each comes back exactly (tried), above it does not.
    if layout.kinds[channel] == "uint" and plane.max() >= 2**22:
        raise InputError(
            f"{path}: wanted integers below {2**22} in channel {layout.channels[channel]}, got "
            f"{plane.max()}. Remove the channel (oiiotool IN --ch R,G,B -o OUT)."
        )


def _refuse_several_images(path: Path, reader: Any) -> None:
    """Last, for a reader may not find its way back from a second image."""
    several = bool(reader.seek_subimage(1, 0))
    _problem(reader)
    if several:
        raise InputError(
            f"{path}: wanted one image, got a file of several parts or pages. "
            "Split it first (oiiotool IN --sisplit -o OUT)."
        )


def _code_values(samples: NDArray[Any], bits: int) -> Pixels:
    """(row, col, 3) float32, integers scaled so that 1.0 is the largest code."""
    if not np.issubdtype(samples.dtype, np.integer):
        return samples.astype(np.float32, copy=False)
    # OpenImageIO widens 10 and 12 bits to 16 by repeating the upper bits below.
    unused = 8 * samples.dtype.itemsize - bits
    codes = samples >> unused if unused else samples
    pixels = codes.astype(np.float32)
    pixels /= np.float32(2**bits - 1)
    return pixels


def _over_display_window(samples: NDArray[Any], layout: _Layout) -> NDArray[Any]:
    """`samples` of the data window, with 0 around them up to the display window."""
    if layout.data == layout.display:
        return samples
    (left, top, cols, rows), (display_left, display_top, *size) = layout.data, layout.display
    whole = np.zeros((size[1], size[0], *samples.shape[2:]), samples.dtype)
    row, col = top - display_top, left - display_left
    whole[row : row + rows, col : col + cols] = samples
    return whole


def _without_impossible_samples(path: Path, pixels: Pixels, *, repair: bool) -> tuple[Pixels, int]:
    """`pixels` without NaN, Inf and negative samples, and how many of them were replaced."""
    # NaN makes a minimum NaN, and so fails the first comparison.
    if pixels.min() >= 0 and pixels.max() < np.inf:
        return pixels, 0
    nan, infinite, negative = np.isnan(pixels), np.isposinf(pixels), pixels < 0
    bad = nan | infinite | negative
    if not repair:
        kinds = {"NaN": nan, "Inf": infinite, "negative": negative}
        counts = ", ".join(f"{mask.sum()} {kind}" for kind, mask in kinds.items() if mask.any())
        row, col, channel = np.unravel_index(bad.argmax(), bad.shape)
        raise InputError(
            f"{path}: wanted finite samples >= 0, got {counts}, the first at row {row}, col {col}, "
            f"channel {'RGB'[channel]}. Add --repair to replace them."
        )
    largest = np.where(bad, np.float32(0), pixels).max(axis=(0, 1))
    repaired = np.where(infinite, largest, np.where(bad, np.float32(0), pixels))
    return repaired, int(bad.sum())


# Reading: what the code values mean.


def _colour(path: Path, spec: Any, name: str, chunks: bytes) -> ColourTag:
    """What the file says of its colour, or else what is usual for its format."""
    if name == "openexr":
        by_format = _colour_of_exr(path, spec)
    elif name == "dpx":
        by_format = _colour_of_dpx(path, spec)
    elif name == "png":
        by_format = _colour_of_png(path, spec, chunks)
    else:
        by_format = _colour_of_others(path, spec, name)
    return _colour_of_cicp(path, spec) or _colour_of_profile(spec) or by_format


def _colour_of_cicp(path: Path, spec: Any) -> ColourTag | None:
    code_points = spec.getattribute("CICP")
    if code_points is None:
        return None
    primaries, transfer, _, full_range = code_points
    if transfer not in _CICP_TRANSFERS:
        raise _unsupported_encoding(path, f"transfer {transfer} of ITU-T H.273")
    if not full_range:
        raise _unsupported_encoding(path, "narrow-range video codes")
    if primaries not in _CICP_PRIMARIES:
        source = f"file: cICP; primaries assumed, {primaries} is not known"
        return ColourTag(_CICP_TRANSFERS[transfer], "BT.709", source)
    return ColourTag(_CICP_TRANSFERS[transfer], _CICP_PRIMARIES[primaries], "file: cICP")


def _colour_of_profile(spec: Any) -> ColourTag | None:
    if spec.getattribute("ICCProfile") is None:
        return None
    # By name only: an ICC profile can be any function, and these two are what is found in masters.
    description = _one_line(spec.get_string_attribute("ICCProfile:profile_description"))
    if "srgb" in description.lower():
        return ColourTag("srgb", "BT.709", f"file: ICC profile '{description}'")
    if "display p3" in description.lower():
        return ColourTag("srgb", "P3-D65", f"file: ICC profile '{description}'")
    return ColourTag("srgb", "BT.709", f"assumed: ICC profile '{description}' is not known")


def _colour_of_exr(path: Path, spec: Any) -> ColourTag:
    stated = spec.get_string_attribute("colorInteropID")
    stated = stated or spec.get_string_attribute("oiio:ColorSpace")
    transfer, primaries, source = "linear", "BT.709", "assumed for EXR"
    known = _interop(path, stated)
    if known:
        (transfer, primaries), source = known, f"file: {stated}"
    chromaticities = spec.getattribute("chromaticities")
    if chromaticities is None:
        return ColourTag(transfer, primaries, source)
    named = _primaries(chromaticities)
    if named is None:
        source = f"{source}; primaries assumed, the file's chromaticities are not known ones"
        return ColourTag(transfer, primaries, source)
    return ColourTag(transfer, named, "file: chromaticities")


def _colour_of_dpx(path: Path, spec: Any) -> ColourTag:
    stated = spec.get_string_attribute("dpx:Transfer") or "Undefined"
    if stated not in _DPX_TRANSFERS:
        raise _unsupported_encoding(path, stated)
    transfer = _DPX_TRANSFERS[stated]
    if transfer is None:
        return ColourTag("srgb", "BT.709", f"assumed for DPX with transfer '{stated}'")
    return ColourTag(transfer, "BT.709", f"file: transfer '{stated}'")


def _colour_of_png(path: Path, spec: Any, chunks: bytes) -> ColourTag:
    found = dict(_chunks(b"\x89PNG\r\n\x1a\n" + chunks))
    if b"sRGB" in found:  # overrides gAMA and cHRM (PNG specification, third edition, 4.3)
        return ColourTag("srgb", "BT.709", "file: sRGB")
    gamma = spec.get_string_attribute("oiio:ColorSpace")
    known = _interop(path, gamma) if b"gAMA" in found else None
    transfer = known[0] if known else "srgb"
    sources = ["gAMA"] if known else []
    primaries = "BT.709"
    if b"cHRM" in found:
        white_first = [value / 100000 for value in struct.unpack_from(">8I", found[b"cHRM"], 8)]
        named = _primaries(white_first[2:] + white_first[:2])
        if named is None:
            sources.append("primaries assumed, its chromaticities are not known ones")
        else:
            primaries = named
            sources.append("cHRM")
    source = f"file: {', '.join(sources)}" if sources else "assumed for PNG"
    return ColourTag(transfer, primaries, source)


def _colour_of_others(path: Path, spec: Any, name: str) -> ColourTag:
    if spec.get_int_attribute("Exif:ColorSpace") == 1:
        return ColourTag("srgb", "BT.709", "file: Exif")
    stated = spec.get_string_attribute("oiio:ColorSpace")
    known = _interop(path, stated)
    if known and known[0] != "srgb":  # sRGB is OpenImageIO's own guess
        return ColourTag(*known, f"file: {stated}")
    if str(spec.format) in _FLOATING:
        return ColourTag("linear", "BT.709", f"assumed for floating {_label(name)}")
    return ColourTag("srgb", "BT.709", f"assumed for {_label(name)}")


def _interop(path: Path, identifier: str) -> tuple[str, str] | None:
    """(transfer, primaries) of a Color Interop identifier; None if it is none."""
    match = _INTEROP.fullmatch(identifier)
    if match is None:
        return None
    curve, gamut, state = match.groups()
    primaries = _INTEROP_PRIMARIES.get(gamut)
    if curve not in _INTEROP_TRANSFERS or primaries is None:
        raise _unsupported_encoding(path, identifier)
    if (curve, primaries) == ("g26", "XYZ"):
        return "dcdm", primaries
    if (curve, state) == ("g24", "display"):
        return "bt1886", primaries
    return _INTEROP_TRANSFERS[curve], primaries


def _primaries(chromaticities: Sequence[float]) -> str | None:
    """The known primaries within 0.001 of x, y of red, green, blue and white."""
    for name, known in _CHROMATICITIES.items():
        if np.allclose(chromaticities, known, rtol=0, atol=1e-3):
            return name
    return None


def _unsupported_encoding(path: Path, got: str) -> InputError:
    wanted = ", ".join(_TRANSFER_NAMES.values())
    return InputError(
        f"{path}: wanted code values that are linear, {wanted}, got {got}. "
        "Convert it first (oiiotool IN --colorconvert FROM TO -o OUT)."
    )


# Writing: which file, of which samples.


@dataclass(frozen=True)
class _Target:
    """What is to be written: the format, its depth, and its channels in order."""

    format: str
    bits: int
    floating: bool
    channels: tuple[str, ...]
    kinds: tuple[str, ...]
    sources: tuple[int, ...]  # 0, 1, 2: R, G, B; 3 + k: extra channel k
    same_format: bool


def _target(frame: Frame, path: Path, bits: int | None) -> _Target:
    name = _FORMATS.get(path.suffix.lower())
    if name is None:
        raise InputError(
            f"{path}: wanted a name that ends in {', '.join(_FORMATS)}, "
            f"got '{path.suffix}'. Choose one of these."
        )
    if bits is not None and bits not in _DEPTHS[name]:
        depths = ", ".join(str(depth) for depth in _DEPTHS[name])
        raise InputError(
            f"{path}: wanted {depths} bits for {_label(name)}, got {bits}. Choose one."
        )
    same = name == frame.header.format
    kept = same and (bits is None or bits == frame.bits)
    if kept:
        bits, floating = frame.bits, frame.floating
    else:
        bits = bits or _fitting_depth(name, frame)
        floating = name == "openexr" or (name == "tiff" and bits == 32)
    channels, kinds, sources = _channels(frame, name, _kind(bits, floating), kept=kept)
    return _Target(name, bits, floating, channels, kinds, sources, same)


def _fitting_depth(name: str, frame: Frame) -> int:
    """The least depth that holds every code value, or else the largest there is."""
    if name == "openexr":
        # Half has 11 significant bits.
        return frame.bits if frame.floating else 16 if frame.bits <= 10 else 32
    if frame.floating:
        return 32 if name == "tiff" else _DEPTHS[name][-1]
    # Few programs read TIFFs of 10 and 12 bits.
    depths = [depth for depth in _DEPTHS[name] if name != "tiff" or depth in (8, 16)]
    return next((depth for depth in depths if depth >= frame.bits), depths[-1])


def _kind(bits: int, floating: bool) -> str:
    if floating:
        return "half" if bits == 16 else "float"
    return "uint8" if bits == 8 else "uint16"


def _channels(
    frame: Frame, name: str, kind: str, *, kept: bool
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[int, ...]]:
    """Names, types and sources of the channels that are written."""
    header = frame.header
    place = {channel: k for k, channel in enumerate(header.rgb)}
    others = iter(range(3, 3 + len(header.extra)))
    sources = [place[k] if k in place else next(others) for k in range(len(header.channels))]
    alpha = [channel.upper() == "A" for channel in header.channels]
    chosen = [
        (channel, header.kinds[k] if kept or (name == "openexr" and source >= 3) else kind, source)
        for k, (channel, source) in enumerate(zip(header.channels, sources, strict=True))
        if source < 3
        or name in (header.format, "openexr")
        or (alpha[k] and name in ("png", "tiff"))
    ]
    if name == "openexr" and header.format != name:
        # EXR has no integers of 8 or 16 bits.
        chosen = [(channel, kind, source) for channel, _, source in chosen]
    channels, kinds, order = zip(*chosen, strict=True)
    return channels, kinds, order


def _samples(frame: Frame, target: _Target) -> NDArray[Any]:
    """(row, col, channel) in the type that the encoder takes."""
    rgb = _encoded_rgb(frame.pixels, target)
    if target.sources == (0, 1, 2):
        return rgb
    mixed = len(set(target.kinds)) > 1
    kind = np.dtype(np.float32) if mixed else _dtype(target.kinds[0])
    samples = np.empty((*rgb.shape[:2], len(target.sources)), kind)
    for channel, source in enumerate(target.sources):
        plane = rgb[..., source] if source < 3 else frame.header.extra[source - 3]
        samples[..., channel] = plane if plane.dtype == kind else _rescaled(plane, kind)
    return samples


def _encoded_rgb(pixels: Pixels, target: _Target) -> NDArray[Any]:
    rows, cols, *last = pixels.shape
    if last != [3] or not (0 < rows <= LARGEST_SIDE and 0 < cols <= LARGEST_SIDE):
        # libjpeg ends the process above 65500.
        raise ValueError(
            f"write_frame takes (row, col, 3) with sides of 1 to {LARGEST_SIDE} px, "
            f"got {pixels.shape}"
        )
    low, high = float(pixels.min()), float(pixels.max())
    if target.floating:
        limit = _LARGEST_HALF if target.bits == 16 else float(np.finfo(np.float32).max)
        low_limit = -limit
    else:
        low_limit, limit = 0.0, 1.0
    if not (low_limit <= low and high <= limit):
        raise ValueError(
            f"write_frame takes pixels in {low_limit:g}..{limit:g} for a {target.bits} bit "
            f"{_label(target.format)}, got {low:g}..{high:g}. Clip them first."
        )
    if target.floating:
        return pixels.astype(_dtype(_kind(target.bits, floating=True)), copy=False)
    scaled = pixels * np.float32(2**target.bits - 1)
    kind = _dtype(_kind(target.bits, floating=False))
    codes: NDArray[Any] = np.rint(scaled, out=scaled).astype(kind)
    if target.bits in (10, 12):
        # Repeated below, the upper bits are exact whether OpenImageIO cuts (it does) or rounds.
        codes = codes << (16 - target.bits) | codes >> (2 * target.bits - 16)
    return codes


def _rescaled(plane: NDArray[Any], kind: np.dtype[Any]) -> NDArray[Any]:
    """`plane` as `kind`, integers standing for 0..1."""
    values = plane.astype(np.float64)
    if np.issubdtype(plane.dtype, np.integer):
        values /= np.iinfo(plane.dtype).max
    if np.issubdtype(kind, np.integer):
        values = np.rint(np.clip(np.nan_to_num(values), 0, 1) * np.iinfo(kind).max)
    elif kind == np.float16:
        values = np.clip(values, -_LARGEST_HALF, _LARGEST_HALF)
    return values.astype(kind)


def _dtype(kind: str) -> np.dtype[Any]:
    return np.dtype({"half": "float16", "float": "float32", "uint": "uint32"}.get(kind, kind))


# Writing: the header.

# What a format says of how it is stored, not of the image; it is said anew.
_STORAGE = re.compile(
    r"oiio:.*|tiff:.*|ICCProfile:.*|compression|planarconfig|openexr:lineOrder|jpeg:subsampling",
    re.IGNORECASE,
)
_COLOUR_ATTRIBUTES = ("ICCProfile", "CICP", "chromaticities", "colorInteropID", "Exif:ColorSpace")
_FORMAT_PREFIXES = tuple(f"{name}:" for name in _LABELS)

# OpenImageIO does not write integer vectors by the names that it reads them by.
_WRITABLE_TYPES = {"vector2i": "int[2]", "vectori": "int[3]", "vector2i[2]": "box2i"}


def _specification(frame: Frame, target: _Target) -> Any:
    rows, cols = frame.pixels.shape[:2]
    spec = oiio.ImageSpec(cols, rows, len(target.channels), target.kinds[0])
    spec.channelnames = target.channels
    if len(set(target.kinds)) > 1:
        spec.channelformats = tuple(oiio.TypeDesc(kind) for kind in target.kinds)
    upper = [name.upper() for name in target.channels]
    spec.alpha_channel = upper.index("A") if "A" in upper else -1
    spec.x, spec.y = spec.full_x, spec.full_y = frame.header.origin
    # OpenImageIO would fill in the present time: the same input would give another output.
    spec.attribute("DateTime", "")
    for name, kind, value in frame.header.attributes:
        if _survives(frame, target, name):
            _set(spec, name, kind, value)
    _state_storage(frame, target, spec)
    _state_colour(frame, target, spec)
    return spec


def _set(spec: Any, name: str, kind: str, value: Any) -> None:
    if kind == "string":
        # Old files hold Latin-1 as well, which OpenImageIO gives as surrogates but does not take.
        spec.attribute(name, value.encode("utf-8", "surrogateescape"))
    else:
        spec.attribute(name, oiio.TypeDesc(_WRITABLE_TYPES.get(kind, kind)), value)


def _survives(frame: Frame, target: _Target, name: str) -> bool:
    if name == "oiio:subimagename":
        return True
    if _STORAGE.fullmatch(name) or (name in _COLOUR_ATTRIBUTES and not _keeps_colour(frame)):
        return False
    return target.same_format or not name.startswith((*_FORMAT_PREFIXES, "openexr:"))


def _keeps_colour(frame: Frame) -> bool:
    read = frame.header.colour
    return read is not None and frame.colour.means_the_same_as(read)


def _stated(frame: Frame, name: str) -> Any:
    return next((value for key, _, value in frame.header.attributes if key == name), None)


def _state_storage(frame: Frame, target: _Target, spec: Any) -> None:
    """Compression and the like."""
    compression = _stated(frame, "compression") if target.same_format else None
    if target.format == "openexr":
        # Other compressions do not notice damage (zlib has a checksum), or lose precision.
        spec.attribute("compression", compression if compression == "zips" else "zip")
    if target.format == "tiff":
        lossless = compression in ("none", "lzw", "packbits", "zip")
        spec.attribute("compression", compression if lossless else "zip")
        if target.kinds[0] == "half":
            spec.attribute("tiff:half", 1)
    if target.format == "jpeg":
        spec.attribute("Compression", "jpeg:100")
        spec.attribute("jpeg:subsampling", "4:4:4")
    if target.format == "dpx":
        spec.attribute("oiio:Endian", "big" if frame.header.big_endian else "little")
    if target.bits in (10, 12):
        spec.attribute("oiio:BitsPerSample", target.bits)
    # As it was read: no encoder may divide R, G, B by alpha.
    if target.format == "png" or _stated(frame, "oiio:UnassociatedAlpha"):
        spec.attribute("oiio:UnassociatedAlpha", 1)


def _state_colour(frame: Frame, target: _Target, spec: Any) -> None:
    """Name the encoding, where the format can and would otherwise be taken for another."""
    colour = frame.colour
    if target.same_format and _keeps_colour(frame):
        return
    if target.format == "openexr":
        if colour.transfer != "linear":
            spec.attribute("colorInteropID", _interop_identifier(colour))
        if colour.primaries != "BT.709":
            kind, value = oiio.TypeDesc("float[8]"), _CHROMATICITIES[colour.primaries]
            spec.attribute("chromaticities", kind, value)
    if target.format == "dpx":
        names = {"linear": "Linear", "bt1886": "ITU-R 709-4"}
        spec.attribute("dpx:Transfer", names.get(colour.transfer, "User defined"))
    # JPEG and TIFF can only say "sRGB" (Exif); to others they can merely not say it.
    known_srgb = (colour.transfer, colour.primaries) == ("srgb", "BT.709")
    if target.format in ("jpeg", "tiff") and known_srgb and not colour.source.startswith("assumed"):
        spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")


def _interop_identifier(colour: ColourTag) -> str:
    curve = {"bt1886": "g24", "dcdm": "g26"}.get(colour.transfer)
    curves = {transfer: name for name, transfer in _INTEROP_TRANSFERS.items()}
    gamuts = {primaries: name for name, primaries in _INTEROP_PRIMARIES.items()}
    # P3-DCI has no identifier; the chromaticities name its white.
    gamut = gamuts.get(colour.primaries, "p3d65")
    shown = colour.transfer in ("bt1886", "dcdm", "st2084")
    return f"{curve or curves[colour.transfer]}_{gamut}_{'display' if shown else 'scene'}"


def _colour_chunks(frame: Frame, target: _Target) -> bytes:
    """What a PNG says of its colour: what it said when it was read, if that still holds."""
    if _keeps_colour(frame) and (target.same_format or _stated(frame, "ICCProfile") is not None):
        return frame.header.colour_chunks
    colour = frame.colour
    if colour.transfer == "srgb" and colour.primaries == "BT.709":
        known = not colour.source.startswith("assumed")
        return _chunk(b"sRGB", b"\0") if known else b""
    transfers = {name: code for code, name in reversed(_CICP_TRANSFERS.items())}
    primaries = {name: code for code, name in _CICP_PRIMARIES.items()}
    chunks = b""
    if colour.transfer in transfers and colour.primaries in primaries:
        code_points = (primaries[colour.primaries], transfers[colour.transfer], 0, 1)
        chunks += _chunk(b"cICP", bytes(code_points))
    exponents = {"linear": 1.0, "gamma2.2": 2.2, "gamma2.4": 2.4, "gamma2.6": 2.6, "dcdm": 2.6}
    if colour.transfer in exponents:
        chunks += _chunk(b"gAMA", struct.pack(">I", round(100000 / exponents[colour.transfer])))
    xy = _CHROMATICITIES[colour.primaries]
    if min(xy) >= 0:  # cHRM has no sign, and so not AP0
        white_first = [round(100000 * value) for value in (*xy[6:], *xy[:6])]
        chunks += _chunk(b"cHRM", struct.pack(">8I", *white_first))
    return chunks


def _chunk(kind: bytes, content: bytes) -> bytes:
    checksum = struct.pack(">I", zlib.crc32(kind + content))
    return struct.pack(">I", len(content)) + kind + content + checksum


def _with_colour_chunks(png: bytes, colour: bytes) -> bytes:
    """`png` with the colour chunks `colour` (after IHDR, where they must be) instead of its own."""
    chunks = [chunk for kind, chunk in _chunks(png) if kind not in _COLOUR_CHUNKS]
    return b"".join([png[:8], chunks[0], colour, *chunks[1:]])


def _with_dpx_name(dpx: bytes, name: str) -> bytes:
    """`dpx` with the file's name in its header (100 bytes at 36) instead of the encoder's."""
    field_ = os.fsencode(name)[:99].ljust(100, b"\0")
    return dpx[:36] + field_ + dpx[136:]


# Writing: bytes.


def _encode(path: Path, name: str, spec: Any, samples: NDArray[Any]) -> bytes:
    """The file's bytes."""
    with os.fdopen(os.memfd_create("frame"), "rb+") as memory:
        place = f"/proc/self/fd/{memory.fileno()}"
        writer: Any = oiio.ImageOutput.create(name)
        written = (
            writer.open(place, spec)
            and writer.write_image(np.ascontiguousarray(samples))
            # A close that succeeds may still leave an error here: TIFF complains of empty Exif.
            and not writer.has_error
        )
        problem = _problem(writer)
        closed = writer.close()
        problem = problem or _problem(writer)
        if not (written and closed):
            raise InputError(
                f"{path}: wanted to encode a {_label(name)}, got '{problem}'. Write another format."
            )
        memory.seek(0)
        return memory.read()


def _replace(path: Path, content: bytes) -> None:
    """Put `content` at `path`, whole or not at all."""
    temporary = path.with_name(f".{path.stem}.tmp-{os.getpid()}{path.suffix}")
    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink()
        if not isinstance(error, OSError):
            raise
        ways = {
            errno.ENOSPC: "Free some space, or write elsewhere",
            errno.EDQUOT: "Free some space, or write elsewhere",
            errno.ENOENT: "Create the folder first",
            errno.EISDIR: "Name a file",
        }
        way = ways.get(error.errno or 0, "Choose a folder that can be written to")
        raise InputError(f"{path}: wanted to write it, got '{_reason(error)}'. {way}.") from error


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def _problem(source: Any) -> str:
    """The pending error of a reader, a writer or all of OpenImageIO; "" if there is none."""
    try:
        return _one_line(source.geterror())
    except UnicodeDecodeError as error:  # it quotes what it found in a damaged file
        return _one_line(error.object.decode("utf-8", "replace"))


def _one_line(text: str) -> str:
    """What `text`, of a library or a file, can add to a message: one line, printable, not long."""
    first = next((line.strip() for line in text.splitlines() if line.strip()), "")
    printable = "".join(letter if letter.isprintable() else "?" for letter in first)
    return printable[:160]
