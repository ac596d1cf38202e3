"""HEIF: HEIC of phones by libheif (pillow-heif, extra ``heif``), AVIF by FFmpeg (extra ``video``).

Both are read in all their bits, and handed on as a PNG in memory. An ICC profile goes before code
points (ISO/IEC 23008-12:2022, 6.5.5); where a file has neither, it is sRGB (MIAF, ISO/IEC
23000-22, 7.3.6.4).
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, Self, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.frames.containers import pyav, siting_of
from domesim.frames.formats.base import Format, animated, by_pillow
from domesim.frames.formats.png import chunk
from domesim.frames.formats.png_pixels import compressed
from domesim.frames.integrity import DamagedError, refuse_sides
from domesim.frames.messages import one_line
from domesim.frames.yuv import MATRICES, code_values, pixel_format

_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"mif1", b"msf1", b"hevc", b"avif", b"avis")
_UNSAID = (0, 2)  # ITU-T H.273: reserved, unspecified
_MATRIX = 6  # where nothing is said: BT.601's
_LIMITED = 1  # FFmpeg's color_range
_MOVING = (b"msf1", b"hevc", b"avis")
_ORIENTATION = 0x112  # Exif's


@final
@dataclass(frozen=True)
class HEIF(Format):
    """HEIC and AVIF, which OpenImageIO reads as a PNG."""

    starts: ClassVar[tuple[bytes, ...]] = tuple(
        size.to_bytes(4) + b"ftyp" + brand for brand in _BRANDS for size in range(16, 128, 4)
    )
    straight = "either"

    def examined(self, path: Path, file: BinaryIO) -> Self:
        """Decode it."""
        start = file.read(128)
        brands = start[8 : int.from_bytes(start[:4])]
        if brands.startswith(_MOVING):
            raise animated(path)
        return self._of_avif(path) if b"avif" in brands else self._of_heic(path)

    def of_part(self, part: int) -> Self:
        return replace(self, name="heif")

    def _of_avif(self, path: Path) -> Self:
        """FFmpeg's codes of all bits; and what Pillow alone tells."""
        pixels, points = _decoded(path)
        try:
            with by_pillow(path) as opened:
                profile, orientation = opened.info.get("icc_profile"), opened.getexif()
                alpha, size = opened.has_transparency_data, opened.size
        except (OSError, ValueError, RuntimeError, SyntaxError) as error:
            raise DamagedError(f"one that does not decode ({one_line(str(error))})") from error
        if alpha or size != pixels.shape[1::-1]:
            got = "one that has it" if alpha else "one of several tiles"
            raise InputError(
                f"{path}: wanted an AVIF without alpha, of one tile, got {got}. Save it as PNG."
            )
        turned = orientation.get(_ORIENTATION)
        codes = np.rint(pixels * np.float32(65535)).astype(np.uint16)
        return self._as_png(codes, profile, points, turned=turned)

    def _of_heic(self, path: Path) -> Self:
        try:
            import pillow_heif  # noqa: PLC0415
        except ImportError:
            raise InputError(
                f"{path}: HEIC needs the extra 'heif': pip install 'domesim[heif]'. Or save it as "
                "PNG, JPEG or TIFF with its colours' profile where it was made."
            ) from None
        try:
            opened = pillow_heif.open_heif(path, convert_hdr_to_8bit=False)
            refuse_sides(path, *opened.size)
            samples = np.asarray(opened)
        except (
            *(OSError, ValueError, RuntimeError, SyntaxError, EOFError),
            IndexError,  # of a file without pictures
        ) as error:
            raise DamagedError(f"one that does not decode ({one_line(str(error))})") from error
        if len(opened) > 1:
            raise InputError(
                f"{path}: wanted one image, got a file of {len(opened)}. Save one alone."
            )
        bits = opened.info["bit_depth"]
        if samples.dtype == np.uint16:  # the codes are in the upper bits
            codes = (samples >> (16 - bits)).astype(np.float64) / (2**bits - 1)
            samples = np.rint(codes * 65535).astype(np.uint16)
        nclx = opened.info.get("nclx_profile") or {}
        points = nclx.get("color_primaries", 2), nclx.get("transfer_characteristics", 2)
        gain = any("gainmap" in name for name in opened.info.get("aux", ()))
        notes = ("without its gain map",) if gain else ()
        straight = not opened.premultiplied_alpha
        form = self._as_png(samples, opened.info.get("icc_profile"), points, straight=straight)
        return replace(form, notes=notes)

    def _as_png(
        self,
        codes: NDArray[Any],
        profile: bytes | None,
        points: tuple[int, int],
        *,
        turned: int | None = None,
        straight: bool = True,
    ) -> Self:
        """What OpenImageIO is to read instead."""
        codes = codes[..., None] if codes.ndim == 2 else codes
        rows, cols, channels = codes.shape
        kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
        header = struct.pack(">2I5B", cols, rows, 8 * codes.dtype.itemsize, kind, 0, 0, 0)
        colour = b""
        if profile:
            colour = chunk(b"iCCP", b"HEIF\0\0" + zlib.compress(profile))
        elif not set(points) & {*_UNSAID}:
            colour = chunk(b"cICP", bytes((*points, 0, 1)))
        content = [chunk(b"IHDR", header), colour, chunk(b"IDAT", b"".join(compressed(codes)))]
        png = b"".join([b"\x89PNG\r\n\x1a\n", *content, chunk(b"IEND", b"")])
        return replace(self, name="png", stored_anew=(png,), turned=turned, unassociated=straight)


def _decoded(path: Path) -> tuple[NDArray[np.float32], tuple[int, int]]:
    """(row, col, 3) code values of an AVIF, 0..1; and code points of primaries and transfer.

    Raises
    ------
    DamagedError
        If it does not decode.
    InputError
        If PyAV is not installed, or it is no picture in colour.
    """
    av = pyav(path)
    options = {"format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2"}
    try:
        # Else text that is not UTF-8 would leave the file open
        with av.open(f"file:{path}", options=options, metadata_errors="replace") as opened:
            stream = opened.streams.best("video")
            context = stream.codec_context
            refuse_sides(path, context.width, context.height)
            stated = context.color_primaries, context.color_trc, context.colorspace
            decoded = next(opened.decode(stream))
            found = decoded.color_primaries, decoded.color_trc, decoded.colorspace
    except (av.FFmpegError, StopIteration, AttributeError) as error:
        raise DamagedError(f"one that does not decode ({one_line(str(error)).lower()})") from error
    primaries, transfer, matrix = (
        int(one if one not in _UNSAID else other) for one, other in zip(stated, found, strict=True)
    )
    kind = pixel_format(decoded.format.name)
    matrix = _MATRIX if matrix == _UNSAID[-1] else matrix
    if kind is None or (kind.chroma and matrix not in MATRICES):
        raise InputError(
            f"{path}: wanted R, G, B, or Y'CbCr of BT.601, BT.709 or BT.2020, got "
            f"{decoded.format.name} of matrix {matrix}. Save it as PNG."
        )
    siting = siting_of(decoded) if kind.chroma in ("4:2:0", "4:2:2") else "left"
    full = int(decoded.color_range) != _LIMITED
    return code_values(decoded, kind, matrix, full=full, siting=siting)[0], (primaries, transfer)
