"""Frames -> video file, whole or not at all.

FFV1 (in Matroska) is lossless: 8, 10, 12 or 16 bits of R, G, B come back bit by bit, and each has
checksums. ProRes 4444 (in QuickTime) is what theatres play and other programs take; FFmpeg encodes
it from 10 bits of Y, C_B, C_R in limited range.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError, reason
from domesim.frames.colour import ColourTag, code_points_of
from domesim.frames.containers import pyav
from domesim.frames.dithering import dither, seed_of
from domesim.frames.eyes import stereo_mode
from domesim.frames.frame import Frame
from domesim.frames.messages import one_line
from domesim.frames.sound import Sound
from domesim.frames.timing import Timing
from domesim.frames.video import frame_paths
from domesim.frames.yuv import limited_codes
from domesim.host.writing import written_to

_RGB_FORMATS = {8: "bgr0", 10: "gbrp10le", 12: "gbrp12le", 16: "gbrp16le"}
_PRORES_BITS = 10
_LIMITED, _FULL = 1, 2  # FFmpeg's color_range


@final
@dataclass(frozen=True)
class FilmFormat:
    """A kind of video that is written.

    Parameters
    ----------
    suffix
        Suffix of its file.
    codec
        FFmpeg's encoder.
    bits
        Bits of the frames that it is made of, as asked for by ``--bits``; the first if nothing is.
    options
        The encoder's.
    """

    suffix: str
    codec: str
    bits: tuple[int | None, ...]
    options: tuple[tuple[str, str], ...]


FILMS = {
    each.suffix: each
    for each in (
        FilmFormat(
            ".mkv",
            "ffv1",
            (None, 8, 10, 12, 16),
            (("level", "3"), ("slicecrc", "1"), ("g", "1"), ("slices", "16")),
        ),
        FilmFormat(
            ".mov",
            "prores_ks",
            (None, 12),
            (("profile", "4444"), ("vendor", "apl0"), ("bits_per_mb", "8000")),
        ),
    )
}
"""Formats of videos, by suffix."""


def write_film(
    path: Path,
    frames: Iterator[Frame],
    count: int,
    colour: ColourTag,
    timing: Timing,
    *,
    dithered: bool = False,
    sound: Path | None = None,
) -> list[str]:
    """Write frames of one size as a video, under a temporary name that is then changed.

    Alpha is not written: frames are pictures over black.

    Parameters
    ----------
    path
        Where to, with a suffix of `FILMS`.
    frames
        Code values of integers.
    count
        How many.
    colour
        What they mean; H.273 has no code point for some of it, of which the file then says
        nothing.
    timing
        When they are shown.
    dithered
        Round to fewer codes than the frames have with noise, as `domesim.frames.dithering` does.
    sound
        A video whose sound it gets, as it is; None for none.

    Returns
    -------
    What it lacks, for a person: "without alpha".

    Raises
    ------
    InputError
        If PyAV is missing, frames differ in size or depth, or the file cannot be written.
    """
    av = pyav(path)
    with written_to(path) as temporary:
        try:
            lacking = _encode(
                temporary, path, frames, colour, timing, dithered=dithered, sound=sound
            )
        except (OSError, av.FFmpegError) as error:
            problem = reason(error) if isinstance(error, OSError) else one_line(str(error))
            raise InputError(
                f"{path}: wanted to write it, got '{problem}'. Free some space, or choose another "
                f"folder; frames that are done stay"
            ) from error
        if len(frame_paths(temporary)) != count:
            raise InputError(f"{path}: wanted to write {count} frames, got fewer. Try again.")
    return lacking


def _encode(
    temporary: Path,
    path: Path,
    frames: Iterator[Frame],
    colour: ColourTag,
    timing: Timing,
    *,
    dithered: bool,
    sound: Path | None,
) -> list[str]:
    av, film = pyav(path), FILMS[path.suffix]
    first = next(frames)
    rows, cols = first.pixels.shape[:2]
    lacking = [] if first.header.alpha is None else ["without alpha"]
    with (
        # Without times, versions and numbers drawn by lot
        av.open(f"file:{temporary}", "w", container_options={"fflags": "+bitexact"}) as container,
        Sound(sound, container, timing.rate) as heard,
    ):
        stream: Any = container.add_stream(film.codec, rate=timing.rate, options=dict(film.options))
        stream.width, stream.height = cols, rows
        lossless = film.codec == "ffv1"
        stream.pix_fmt = _RGB_FORMATS[first.bits] if lossless else f"yuv444p{_PRORES_BITS}le"
        if timing.timecode:
            stream.metadata["timecode"] = timing.timecode
        if first.header.eyes is not None and lossless:  # FFmpeg writes none into QuickTime
            stream.metadata["stereo_mode"] = stereo_mode(first.header.eyes)
        lacking += heard.begin()
        primaries, transfer = code_points_of(colour)
        matrix = 0 if lossless else 9 if colour.primaries == "BT.2020" else 1
        context = stream.codec_context
        context.color_primaries, context.color_trc = primaries, transfer
        context.colorspace, context.color_range = matrix, _FULL if lossless else _LIMITED
        place, frame = 0, first
        while True:
            if (frame.pixels.shape, frame.bits) != (first.pixels.shape, first.bits):
                raise InputError(
                    f"{frame.path}: wanted frames of one size and depth for a video, got "
                    f"{frame.described()} after {first.described()}"
                )
            planes = (
                _rgb_planes(frame) if lossless else _yuv_planes(frame, matrix, dithered=dithered)
            )
            coded = av.VideoFrame(cols, rows, stream.pix_fmt)
            for plane, codes in zip(coded.planes, planes, strict=True):
                _fill(plane, codes)
            coded.pts, coded.time_base = place, 1 / timing.rate
            coded.color_primaries, coded.color_trc = primaries, transfer
            coded.colorspace, coded.color_range = context.colorspace, context.color_range
            container.mux(stream.encode(coded))
            heard.copy((place + 1) / timing.rate)
            following = next(frames, None)
            if following is None:
                break
            place, frame = place + 1, following
        container.mux(stream.encode(None))
        heard.copy(None)
    return lacking


def _rgb_planes(frame: Frame) -> list[NDArray[Any]]:
    codes = np.rint(frame.pixels * np.float32(2**frame.bits - 1))
    if frame.bits == 8:
        packed = np.zeros((*codes.shape[:2], 4), np.uint8)
        packed[..., :3] = codes[..., ::-1]
        return [packed.reshape(len(packed), -1)]
    return [codes[..., channel].astype("<u2") for channel in (1, 2, 0)]


def _yuv_planes(frame: Frame, matrix: int, *, dithered: bool) -> list[NDArray[Any]]:
    planes = limited_codes(frame.pixels, matrix, _PRORES_BITS)
    for view, plane in enumerate(planes):
        if dithered:
            dither(plane, 2**_PRORES_BITS - 1, seed_of(frame.path, view))
        else:
            np.rint(plane, out=plane)
    return [plane.astype("<u2") for plane in planes]


def _fill(plane: Any, codes: NDArray[Any]) -> None:
    filled = np.zeros((plane.height, plane.line_size // codes.itemsize), codes.dtype)
    filled[:, : codes.shape[1]] = codes
    plane.update(filled)
