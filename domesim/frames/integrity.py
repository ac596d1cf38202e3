"""Is a file all there? What OpenImageIO would not notice, or not say in one line."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import BinaryIO

from domesim.errors import InputError, reason
from domesim.frames import eyes
from domesim.frames.formats import LARGEST_SIDE, dpx, exr, jpeg, jpeg2000, tiff
from domesim.frames.formats.hdr import Radiance, header_of
from domesim.frames.formats.png import CARRIED_CHUNKS, COLOUR_CHUNKS, Picture, chunks_of


@dataclass(frozen=True)
class Container:
    """What the examination of a file's bytes found, for OpenImageIO does not tell it."""

    carried: tuple[bytes, ...] = (b"",)  # of each part: what is written back as it is
    colour_chunks: bytes = b""  # of a PNG
    big_endian: bool = True  # of a DPX
    boxes: bytes = b""  # of a JPEG 2000, without the codestream
    comments: bytes = b""  # of a JPEG 2000: whole marker segments
    cinema: bool = False  # of a JPEG 2000: whether it has a digital-cinema profile
    radiance: Radiance | None = None  # of an HDR
    eyes: eyes.Eyes | None = None  # how two views are packed, if it says so
    stored_anew: bytes | None = None  # of a TIFF: the file as it can be read, if it is not itself


def examine(path: Path) -> Container:
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
            f"{path}: wanted to read it, got '{reason(error)}'. Check its path and permissions."
        ) from error


def damaged(path: Path, label: str, got: str) -> InputError:
    """The error for a file of which a part is missing or wrong."""
    return InputError(f"{path}: wanted a complete {label}, got {got}. Copy or render it again.")


@contextmanager
def enough_memory(path: Path) -> Iterator[None]:
    """Memory that there is not, as an error for a person."""
    try:
        yield
    except MemoryError as error:
        raise InputError(
            f"{path}: wanted memory for a picture of this size, got none. Use a smaller one, or a "
            "machine with more."
        ) from error


def stored_otherwise(path: Path, got: str) -> InputError:
    """The error for a whole TIFF that is compressed in a way that is not read."""
    return InputError(
        f"{path}: wanted a TIFF of LZW, ZIP, ZSTD, LZMA, PackBits, JPEG or no compression, got "
        f"{got}. It is not damaged: save it with LZW or ZIP (ImageMagick: convert IN -compress zip "
        "OUT)."
    )


def refuse_sides(path: Path, cols: int, rows: int) -> None:
    """Refuse a picture of sides that no master has."""
    if not (0 < cols <= LARGEST_SIDE and 0 < rows <= LARGEST_SIDE):
        raise InputError(
            f"{path}: wanted 1 to {LARGEST_SIDE} px a side, got {cols} x {rows}. "
            "The header is probably damaged: copy or render it again."
        )


_LONG_TEXT = 1 << 16  # bytes of what HDRs tell, for which they name no limit


def _examine_bytes(path: Path, file: BinaryIO) -> Container:  # noqa: PLR0911 - a format each
    size = os.fstat(file.fileno()).st_size
    if size == 0:
        raise InputError(f"{path}: wanted an image, got an empty file. Copy or render it again.")
    start = file.read(dpx.HEADER)
    if start.startswith(b"\x89PNG\r\n\x1a\n"):
        return _examine_png(path, start + file.read())
    if start[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return _examine_tiff(path, file, size, start)
    if start.startswith((jpeg2000.SIGNATURE, jpeg2000.CODESTREAM)):
        return _examine_jpeg2000(path, start + file.read())
    if start[:4] in (b"SDPX", b"XPDS"):
        big_endian = _examine_dpx(path, size, start)
        return Container((dpx.carried_of(start, big_endian=big_endian),), big_endian=big_endian)
    if start.startswith(exr.MAGIC):
        return _examine_exr(path, file)
    if start.startswith(jpeg.START):
        with _understood(path, "JPEG"):
            return _examine_jpeg(path, start + file.read())
    if start.startswith(b"#?"):
        with _understood(path, "HDR"):
            return Container(radiance=header_of(start + file.read(_LONG_TEXT)))
    return Container()


_KINDS = {"JPEG 2000": " at 8, 10, 12 or 16 bits"}


@contextmanager
def _understood(path: Path, label: str) -> Iterator[None]:
    """What cannot be, as an error for a person."""
    try:
        yield
    except ValueError as error:
        raise InputError(
            f"{path}: wanted a complete {label} of R, G, B{_KINDS.get(label, '')}, got {error}. "
            "Copy or render it again, or convert it."
        ) from error


def _examine_png(path: Path, png: bytes) -> Container:
    """Check all that there is up to IEND.

    libpng would notice most damage, too, but it prints to stderr, does not miss an IEND, and only
    skips a damaged colour chunk.
    """
    colour, carried, picture, packed = b"", b"", Picture(), None
    for kind, chunk in chunks_of(png):
        if zlib.crc32(chunk[4:-4]) != int.from_bytes(chunk[-4:]):
            name = kind.decode("ascii", "replace")
            raise damaged(path, "PNG", f"a wrong checksum in chunk {name!r}")
        try:
            picture.add(kind, chunk[8:-4])
        except ValueError as error:
            raise damaged(path, "PNG", str(error)) from error
        if kind == b"sTER":
            with _understood(path, "PNG"):
                packed = eyes.of_png(chunk[8:-4])
        if kind == b"IHDR":
            refuse_sides(path, *picture.sides)
        if kind in COLOUR_CHUNKS:
            colour += chunk
        if kind in CARRIED_CHUNKS:
            carried += chunk
        if kind == b"IEND":
            return Container((carried,), colour, eyes=packed)
    raise damaged(path, "PNG", "one that ends early")


def _examine_exr(path: Path, file: BinaryIO) -> Container:
    try:
        with mmap(file.fileno(), 0, access=ACCESS_READ) as content:
            return Container(exr.carried_of(content))
    except ValueError as error:
        raise damaged(path, "EXR", str(error)) from error


def _examine_jpeg(path: Path, content: bytes) -> Container:
    """OpenImageIO does not tell which eye is which, and loses some of what is told."""
    if jpeg.pair_of(content) is not None:
        raise InputError(f"{path}: wanted one picture, got an MPO of two views. Save one alone.")
    stereo = jpeg.stereo_of(content)
    packed = None if stereo is None else eyes.of_jps(stereo[0], left_first=stereo[1])
    return Container((jpeg.metadata_of(content),), eyes=packed)


_TIFF_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
_TIFF_EXIF = 34665
_TIFF_COMPRESSION, _TIFF_FILL_ORDER = 259, 266


def _examine_tiff(path: Path, file: BinaryIO, size: int, start: bytes) -> Container:
    """Check that all tags lie within the file; store it anew if its compression is not read.

    libtiff notices missing pixels, but drops a tag (an ICC profile at the end, say) in silence.
    """
    order = "<" if start[:2] == b"II" else ">"
    big = start[2:4] in (b"+\0", b"\0+")
    count_format, entry_format = ("Q", "HHQQ") if big else ("H", "HHII")
    word = struct.Struct(order + ("Q" if big else "I"))
    counter, entry = struct.Struct(order + count_format), struct.Struct(order + entry_format)

    def read(position: int, wanted: int) -> bytes:
        if position + wanted > size:
            raise damaged(path, "TIFF", f"one that ends early, at {size} bytes")
        file.seek(position)
        return file.read(wanted)

    shorts: dict[int, int] = {}
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
            else:  # on the left of its field
                shorts[tag] = offset & 0xFFFF if order == "<" else offset >> 8 * word.size - 16
        directories += word.unpack(read(position + count * entry.size, word.size))
    compression = shorts.get(_TIFF_COMPRESSION, 1)
    if compression in tiff.UNREAD or shorts.get(_TIFF_FILL_ORDER) == 2:
        file.seek(0)
        with _understood(path, "TIFF"):
            return Container(stored_anew=tiff.stored_anew(file.read()))
    return Container()


def _examine_jpeg2000(path: Path, content: bytes) -> Container:
    """OpenImageIO decodes it when it is opened: what is wrong must be found before."""
    with _understood(path, "JPEG 2000"):
        cinema, comments = jpeg2000.is_cinema(content), jpeg2000.comments_of(content)
    return Container(boxes=jpeg2000.metadata_of(content), comments=comments, cinema=cinema)


def _examine_dpx(path: Path, size: int, start: bytes) -> bool:
    """Check the size that a DPX header states, and return whether it is big-endian.

    The pixels need no check (OpenImageIO misses them), but what follows them does.
    """
    order = ">" if start[:4] == b"SDPX" else "<"
    if len(start) < 20:
        raise damaged(path, "DPX", "one that ends early")
    (stated,) = struct.unpack_from(order + "I", start, 16)
    if size < stated != 0xFFFFFFFF:  # all ones: not stated
        raise damaged(path, "DPX", f"one that ends early, at {size} of {stated} bytes")
    return order == ">"
