"""Frame -> image file, whole or not at all.

It is encoded in memory, because some encoders of OpenImageIO end the whole process on a full disk
(JPEG) or report success (PNG); Python then writes the bytes under a temporary name and renames the
file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)
from numpy.typing import NDArray

from domesim.errors import InputError, reason
from domesim.frames.alpha import is_opaque, straightened
from domesim.frames.colour import BT709_LUMINANCE, colour_chunks, state_colour
from domesim.frames.dithering import Seed, dither, seed_of
from domesim.frames.eyes import stated
from domesim.frames.formats import (
    DEPTHS,
    LABELS,
    LARGEST_SIDE,
    SUFFIXES,
    code_range,
    code_span,
    dpx,
    exr,
    jpeg,
    label,
)
from domesim.frames.formats.jpeg2000 import is_cinema, with_comments, with_metadata
from domesim.frames.formats.png import with_carried_chunks, with_colour_chunks, with_utf8_text
from domesim.frames.frame import Frame, Pixels
from domesim.frames.messages import problem_of
from domesim.frames.orientation import UPRIGHT, turned_back
from domesim.frames.whole import write_whole
from domesim.light.strips import converted


def write_frame(
    frame: Frame, path: str | Path, *, bits: int | None = None, dither: bool = False
) -> None:
    """Write `frame` to `path`, whole or not at all.

    The suffix names the format. The format that the frame came from keeps its bit depth, metadata
    and all channels. Another format gets the least depth that holds every code value, the metadata
    that it knows, alpha unless it is DPX or JPEG, and other channels if it is EXR. The pixels are
    turned back and divided by alpha as the file has it, and else written as they are: for another
    encoding, give `frame` other pixels *and* another `colour`.

    JPEG 2000 is written losslessly: .jp2 with boxes, others as a codestream, without a profile; but
    a .j2c of X'Y'Z' as a DCP has it: of 12 bits, with the profile of digital cinema, and no more
    bytes than 250 Mbit/s are at 24 frames a second.
    JPEG is written at quality 100 without chroma subsampling. Re-encoding what was decoded from a
    JPEG then moves no sample by more than 4 codes, and 97 % (noise) to 99.8 % (a domemaster) of
    them by at most one; at quality 98 it was 10 codes and 74 % to 99.5 %.

    Parameters
    ----------
    frame
        Integer formats need its pixels finite and in 0..1; they are rounded to the nearest code,
        ties to even.
    path
        ``.exr``, ``.png``, ``.tif``, ``.tiff``, ``.dpx``, ``.jpg``, ``.jpeg``, ``.jp2``, ``.j2k``,
        ``.j2c``, ``.jpc``.
    bits
        Of a sample: EXR 16 or 32 (float), PNG 8 or 16, TIFF 8 or 16 (integer) or 32 (float), DPX
        and JPEG 2000 8, 10, 12 or 16, JPEG 8.
    dither
        Round to integers with noise instead (`domesim.frames.dithering`), seeded by the numbers in
        the name of the file that `frame` came from.

    Raises
    ------
    InputError
        If the suffix or `bits` is not one of these, or `path` cannot be written (no such folder,
        not writable, disk full, ...). A file that was there before is then still there, unchanged.
    ValueError
        If pixels are not finite, or not what the format can hold.
    """
    path = Path(path)
    write_whole(path, encoded(frame, path, bits, seed_of(frame.path) if dither else None))


def encoded(frame: Frame, path: Path, bits: int | None, seed: Seed | None = None) -> bytes:
    """What `write_frame` puts at `path`, dithered if there is a `seed`."""
    target = target_of(frame, path, bits)
    frame = as_stored(frame, target)
    spec = specification(frame, target)
    if target.cinema:
        rows, cols = frame.pixels.shape[:2]
        profile = "Cinema2K" if cols <= 2048 and rows <= 1080 else "Cinema4K"
        spec.attribute(f"jpeg2000:{profile}", oiio.TypeDesc("uint"), 24)
    content = encode(path, target.format, [(spec, samples_of(frame, target, seed))])
    if target.cinema and not is_cinema(content):
        raise InputError(
            f"{path}: wanted at most 4096 x 2160 px for a DCP's codestream (.j2c of X'Y'Z'), got "
            f"{cols} x {rows}. Crop it, or write .tif or .j2k."
        )
    if target.same_format:
        content = _with_carried(content, frame, target)
    eyes = b"" if frame.header.eyes is None else stated(frame.header.eyes, target.format)
    if target.format == "png":
        content = with_colour_chunks(content, _png_colour(frame, target) + eyes)
    if target.format == "png" and not target.same_format:
        content = with_utf8_text(content)
    if target.format == "jpeg":
        content = jpeg.with_segment(content, eyes)
    if target.format == "dpx":
        content = dpx.with_name(content, path.name)
    if target.format == "jpeg2000" and path.suffix.lower() == ".jp2" and frame.header.boxes:
        content = with_metadata(content, frame.header.boxes, colour_holds=_keeps_colour(frame))
    return content


def _with_carried(content: bytes, frame: Frame, target: Target) -> bytes:
    """An encoded file with what the one that it came from said besides its picture."""
    header = frame.header
    if target.format == "openexr":
        return exr.with_attributes(content, [carried_attributes(frame, target)])
    if target.format == "png":
        return with_carried_chunks(content, header.carried)
    if target.format == "jpeg" and _keeps_colour(frame):  # Exif may tell of it
        return jpeg.with_metadata(content, header.carried)
    if target.format == "dpx":
        return dpx.with_fields(content, header.carried)
    return with_comments(content, header.comments) if target.format == "jpeg2000" else content


# Which file, of which samples.


@dataclass(frozen=True)
class Target:
    """What is to be written: the format, its depth, and its channels in order."""

    format: str
    bits: int
    floating: bool
    channels: tuple[str, ...]
    kinds: tuple[str, ...]
    sources: tuple[int, ...]  # 0, 1, 2: R, G, B; 3 + k: extra channel k; -1: luminance
    same_format: bool
    straight: bool  # colours are to be divided by alpha
    zero_padded: bool = False  # 12 bits in 16
    legal: bool = False  # between black and white of video
    cinema: bool = False  # with a profile of digital cinema, which is lossy


_LUMINANCE = -1
_DCDM_BITS = 12
_CINEMA_SUFFIX = ".j2c"
_LEAST_JPEG_2000_SIDE = 32  # OpenJPEG's encoder halves it five times


def target_of(frame: Frame, path: Path, bits: int | None) -> Target:
    """What to write at `path`."""
    name = SUFFIXES.get(path.suffix.lower())
    if name is None:
        raise InputError(
            f"{path}: wanted a name that ends in {', '.join(SUFFIXES)}, "
            f"got '{path.suffix}'. Choose one of these."
        )
    if bits is not None and bits not in DEPTHS[name]:
        depths = ", ".join(str(depth) for depth in DEPTHS[name])
        raise InputError(f"{path}: wanted {depths} bits for {label(name)}, got {bits}. Choose one.")
    sides = frame.pixels.shape[:2]
    if name == "jpeg2000" and min(sides) < _LEAST_JPEG_2000_SIDE:
        raise InputError(
            f"{path}: wanted {_LEAST_JPEG_2000_SIDE} px a side or more for a JPEG 2000, got "
            f"{sides[1]} x {sides[0]}. Choose another format."
        )
    same = name == frame.header.format
    cinema = path.suffix.lower() == _CINEMA_SUFFIX and frame.colour.transfer == "dcdm"
    if cinema and bits not in (None, _DCDM_BITS):
        raise InputError(f"{path}: wanted 12 bits for X'Y'Z' of a DCP, got {bits}. Leave it out.")
    kept = same and (bits is None or bits == frame.bits) and not cinema
    if kept:
        bits, floating = frame.bits, frame.floating
    else:
        bits = bits or (_DCDM_BITS if cinema else _fitting_depth(name, frame))
        floating = name == "openexr" or (name == "tiff" and bits == 32)
    channels, kinds, sources = _channels(frame, name, _kind(bits, floating), kept=kept)
    if cinema:
        channels, kinds, sources = channels[:3], kinds[:3], sources[:3]
    header = frame.header
    # What PNG and JPEG 2000 have is straight; an EXR's alpha never is.
    straight = header.straight if same or name == "tiff" else name in ("png", "jpeg2000")
    # DCI DCSS, 3.2.2: 12 bits in 16.
    is_dcdm = (name, frame.colour.transfer, bits) == ("tiff", "dcdm", _DCDM_BITS)
    padded = header.zero_padded if kept else is_dcdm
    legal = same and header.legal
    return Target(
        name, bits, floating, channels, kinds, sources, same, straight, padded, legal, cinema
    )


def as_stored(frame: Frame, target: Target) -> Frame:
    """`frame` with its samples as they lie in the file: turned, and not multiplied by alpha."""
    header, pixels = frame.header, frame.pixels
    extra, alpha = list(header.extra), header.alpha
    if target.straight and alpha is not None and not is_opaque(extra[alpha]):
        pixels, extra[alpha] = straightened(
            pixels, extra[alpha], frame.colour.transfer, floating=target.floating
        )
    if target.same_format and header.orientation != UPRIGHT:
        pixels = turned_back(pixels, header.orientation)
        extra = [turned_back(plane, header.orientation) for plane in extra]
    return replace(frame, pixels=pixels, header=replace(header, extra=tuple(extra)))


def _fitting_depth(name: str, frame: Frame) -> int:
    """The least depth that holds every code value, or else the largest there is."""
    if (name, frame.colour.transfer) == ("tiff", "dcdm"):
        return _DCDM_BITS
    if name == "openexr":
        # Half has 11 significant bits.
        return frame.bits if frame.floating else 16 if frame.bits <= 10 else 32
    if frame.floating:
        return 32 if name == "tiff" else DEPTHS[name][-1]
    # Few programs read TIFFs of 10 and 12 bits.
    depths = [depth for depth in DEPTHS[name] if name != "tiff" or depth in (8, 16)]
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
    grey = len(set(header.rgb)) == 1
    place = {channel: _LUMINANCE if grey else k for k, channel in enumerate(header.rgb)}
    others = iter(range(3, 3 + len(header.extra)))
    sources = [place[k] if k in place else next(others) for k in range(len(header.channels))]
    alpha = [channel.upper() == "A" for channel in header.channels]
    chosen = [
        (channel, header.kinds[k] if kept or (name == "openexr" and source >= 3) else kind, source)
        for k, (channel, source) in enumerate(zip(header.channels, sources, strict=True))
        if source < 3
        or name in (header.format, "openexr")
        or (alpha[k] and name in ("png", "tiff", "jpeg2000"))
    ]
    if name == "openexr" and header.format != name:
        # EXR has no integers of 8 or 16 bits.
        chosen = [(channel, kind, source) for channel, _, source in chosen]
    if name != "openexr" and grey:
        rgb = [(channel, kind, source) for source, channel in enumerate("RGB")]
        chosen = rgb + [each for each in chosen if each[2] != _LUMINANCE]
    channels, kinds, order = zip(*chosen, strict=True)
    return channels, kinds, order


# The samples.


def samples_of(frame: Frame, target: Target, seed: Seed | None = None) -> NDArray[Any]:
    """(row, col, channel) in the type that the encoder takes, dithered if there is a `seed`."""
    if target.sources == (0, 1, 2):
        return _encoded_rgb(frame.pixels, target, seed)
    return interleaved(planes_of(frame, target, seed), target.kinds)


def planes_of(frame: Frame, target: Target, seed: Seed | None = None) -> list[NDArray[Any]]:
    """(row, col) of each channel, not yet of one type; `seed` as for `samples_of`."""
    rgb = _encoded_rgb(frame.pixels, target, seed)
    return [
        _luminance(frame.pixels).astype(rgb.dtype)
        if source == _LUMINANCE
        else rgb[..., source]
        if source < 3
        else frame.header.extra[source - 3]
        for source in target.sources
    ]


def interleaved(planes: Sequence[NDArray[Any]], kinds: Sequence[str]) -> NDArray[Any]:
    """(row, col, channel) of (row, col) planes, in the type that the encoder takes."""
    kind = np.dtype(np.float32) if len(set(kinds)) > 1 else _dtype(kinds[0])
    samples = np.empty((*planes[0].shape, len(planes)), kind)
    for channel, plane in enumerate(planes):
        samples[..., channel] = plane if plane.dtype == kind else _rescaled(plane, kind)
    return samples


def _luminance(pixels: Pixels) -> NDArray[np.float64]:
    """(row, col) of BT.709; in float64, so that grey comes back to the bit."""
    luminance: NDArray[np.float64] = pixels.astype(np.float64) @ BT709_LUMINANCE
    return luminance


def _encoded_rgb(pixels: Pixels, target: Target, seed: Seed | None) -> NDArray[Any]:
    rows, cols, *last = pixels.shape
    if last != [3] or not (0 < rows <= LARGEST_SIDE and 0 < cols <= LARGEST_SIDE):
        # libjpeg ends the process above 65500.
        raise ValueError(
            f"write_frame takes (row, col, 3) with sides of 1 to {LARGEST_SIDE} px, "
            f"got {pixels.shape}"
        )
    low, high = float(pixels.min()), float(pixels.max())
    least, largest = code_range(target.bits, floating=target.floating)
    if not (least <= low and high <= largest):
        raise ValueError(
            f"write_frame takes pixels in {least:g}..{largest:g} for a {target.bits} bit "
            f"{label(target.format)}, got {low:g}..{high:g}. Clip them first."
        )
    if target.floating:
        return converted(pixels, _dtype(_kind(target.bits, floating=True)))
    black, white = code_span(target.bits, legal=target.legal)
    scaled = np.multiply(pixels, np.float32(white - black), order="C")
    if target.legal:
        scaled += np.float32(black)
    if seed is None:
        np.rint(scaled, out=scaled)
    else:
        dither(scaled, 2**target.bits - 1, seed)
    codes: NDArray[Any] = scaled.astype(_dtype(_kind(target.bits, floating=False)))
    if target.zero_padded:
        codes <<= 4
    elif target.bits in (10, 12):
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
        values = np.clip(values, *code_range(16, floating=True))
    return values.astype(kind)


def _dtype(kind: str) -> np.dtype[Any]:
    return np.dtype({"half": "float16", "float": "float32", "uint": "uint32"}.get(kind, kind))


# The header.

# What a format says of how it is stored, not of the image; it is said anew.
_STORAGE = re.compile(
    r"oiio:.*|tiff:.*|ICCProfile:.*|compression|planarconfig|jpeg:subsampling|"
    r"openexr:.*|textureformat|acesImageContainerFlag",
    re.IGNORECASE,
)
# Of an EXR, all else is written back as it is.
EXR_STRUCTURE = ("view", "multiView", "oiio:subimagename")
_COLOUR_ATTRIBUTES = ("ICCProfile", "CICP", "chromaticities", "colorInteropID", "Exif:ColorSpace")
_FORMAT_PREFIXES = tuple(f"{name}:" for name in LABELS)

# OpenImageIO does not write these by the names that it reads them by.
_WRITABLE_TYPES = {
    "vector2i": "int[2]",
    "vectori": "int[3]",
    "vector2i[2]": "box2i",
    "uint16": "int",
}


def specification(frame: Frame, target: Target) -> Any:
    """OpenImageIO's description of what is to be written."""
    rows, cols = frame.pixels.shape[:2]
    attributes = [each for each in frame.header.attributes if _survives(frame, target, each[0])]
    spec = bare_specification(target.channels, target.kinds, (cols, rows), attributes)
    spec.x, spec.y = spec.full_x, spec.full_y = frame.header.origin
    _state_storage(frame, target, spec)
    if not (target.same_format and _keeps_colour(frame)):
        state_colour(frame.colour, target.format, spec)
    return spec


def bare_specification(
    channels: tuple[str, ...],
    kinds: tuple[str, ...],
    size: tuple[int, int],
    attributes: Sequence[tuple[str, str, Any]],
) -> Any:
    """Channels of `kinds` over `size` (cols, rows) px, and nothing of how they are stored."""
    spec = oiio.ImageSpec(*size, len(channels), kinds[0])
    spec.channelnames = channels
    if len(set(kinds)) > 1:
        spec.channelformats = tuple(oiio.TypeDesc(kind) for kind in kinds)
    upper = [name.upper() for name in channels]
    spec.alpha_channel = upper.index("A") if "A" in upper else -1
    # OpenImageIO would fill in the present time: the same input would give another output.
    spec.attribute("DateTime", "")
    for name, kind, value in attributes:
        _set(spec, name, kind, value)
    return spec


def _set(spec: Any, name: str, kind: str, value: Any) -> None:
    if kind == "string":
        # Old files hold Latin-1 as well, which OpenImageIO gives as surrogates but does not take.
        spec.attribute(name, value.encode("utf-8", "surrogateescape"))
    else:
        spec.attribute(name, oiio.TypeDesc(_WRITABLE_TYPES.get(kind, kind)), value)


def _survives(frame: Frame, target: Target, name: str) -> bool:
    if target.same_format and target.format == "openexr":
        return name in EXR_STRUCTURE
    if _STORAGE.fullmatch(name) or (name in _COLOUR_ATTRIBUTES and not _keeps_colour(frame)):
        return False
    if target.same_format:
        return True
    return name != "Orientation" and not name.startswith(_FORMAT_PREFIXES)


def carried_attributes(frame: Frame, target: Target) -> exr.Attributes:
    """What an EXR's header said that still holds."""
    found = exr.attributes_in(frame.header.carried)
    if not _keeps_colour(frame):
        for name in exr.COLOUR:
            found.pop(name, None)
    if not _is_aces(frame, target):
        found.pop(_ACES_FLAG, None)
    return found


_ACES_FLAG = b"acesImageContainerFlag"


def _is_aces(frame: Frame, target: Target) -> bool:
    """Whether it is to be a container of SMPTE ST 2065-4: half, of ACES AP0, not compressed."""
    said = target.same_format and _ACES_FLAG in exr.attributes_in(frame.header.carried)
    return said and set(target.kinds) == {"half"} and _keeps_colour(frame)


def _keeps_colour(frame: Frame) -> bool:
    """Whether what the file said of its colour still holds, and is all that there is to say."""
    read = frame.header.colour
    if read is None or not frame.colour.means_the_same_as(read):
        return False
    return frame.colour.assumed or not read.assumed


def _stated(frame: Frame, name: str) -> Any:
    return next((value for key, _, value in frame.header.attributes if key == name), None)


def state_exr_compression(spec: Any, compression: str | None) -> None:
    """ZIP: others do not notice damage (zlib has a checksum), or lose precision."""
    spec.attribute("compression", compression if compression == "zips" else "zip")


def _state_storage(frame: Frame, target: Target, spec: Any) -> None:
    """Compression and the like."""
    compression = _stated(frame, "compression") if target.same_format else None
    if target.format == "openexr":
        state_exr_compression(spec, compression)
        if _is_aces(frame, target):
            spec.attribute("compression", "none")
    if target.format == "tiff":
        lossless = compression in ("none", "lzw", "packbits", "zip")
        spec.attribute("compression", compression if lossless else "zip")
        if target.kinds[0] == "half":
            spec.attribute("tiff:half", 1)
    if target.format == "png":
        # zlib's usual 6 takes two and a half times as long, for files that are 3 % smaller
        spec.attribute("png:compressionLevel", 4)
    if target.format == "jpeg":
        spec.attribute("Compression", "jpeg:100")
        spec.attribute("jpeg:subsampling", "4:4:4")
    if target.format == "dpx":
        spec.attribute("oiio:Endian", "big" if frame.header.big_endian else "little")
    if target.bits in (10, 12) and not target.zero_padded:
        spec.attribute("oiio:BitsPerSample", target.bits)
    # See `as_stored`: no encoder may divide R, G, B by alpha.
    if (target.format in ("png", "jpeg2000") or target.straight) and not target.cinema:
        spec.attribute("oiio:UnassociatedAlpha", 1)


# The bytes.


def _png_colour(frame: Frame, target: Target) -> bytes:
    """The colour chunks that the frame was read with, if they still hold."""
    if _keeps_colour(frame) and (target.same_format or _stated(frame, "ICCProfile") is not None):
        return frame.header.colour_chunks
    return colour_chunks(frame.colour)


def encode(path: Path, name: str, parts: Sequence[tuple[Any, NDArray[Any]]]) -> bytes:
    """The file's bytes; several `parts` (specification, samples) only of an EXR."""
    with os.fdopen(os.memfd_create("frame"), "rb+") as memory, ExitStack() as stack:
        place = f"/proc/self/fd/{memory.fileno()}"
        if name == "jpeg2000":
            place = stack.enter_context(_named(place, path))
        writer: Any = oiio.ImageOutput.create(name)
        specs = tuple(spec for spec, _ in parts)
        written = all(
            (writer.open(place, spec, "AppendSubimage") if k else _begin(writer, place, specs))
            and writer.write_image(np.ascontiguousarray(samples))
            # A close that succeeds may still leave an error here: TIFF complains of empty Exif.
            and not writer.has_error
            for k, (spec, samples) in enumerate(parts)
        )
        problem = problem_of(writer)
        closed = writer.close()
        problem = problem or problem_of(writer)
        if not (written and closed):
            raise InputError(
                f"{path}: wanted to encode a {label(name)}, got '{problem}'. Write another format."
            )
        memory.seek(0)
        return memory.read()


@contextmanager
def _named(place: str, path: Path) -> Iterator[str]:
    """`place` under a name whose suffix tells the JPEG 2000 encoder boxes from a codestream."""
    try:
        folder = TemporaryDirectory(prefix="domesim-")
        suffix = ".jp2" if path.suffix.lower() == ".jp2" else ".j2k"
        link = Path(folder.name) / f"frame{suffix}"
        link.symlink_to(place)
    except OSError as error:
        raise InputError(
            f"{path}: wanted a folder for temporary files, got '{reason(error)}'. Free some space "
            "there, or set TMPDIR."
        ) from error
    with folder:
        yield str(link)


def _begin(writer: Any, place: str, specs: tuple[Any, ...]) -> bool:
    # An EXR's header tells of all parts.
    return bool(writer.open(place, specs[0] if len(specs) == 1 else specs))
