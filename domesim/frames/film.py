"""Frames -> video file, whole or not at all.

FFV1 (in Matroska) is lossless: 8, 10, 12 or 16 bits of R, G, B come back bit by bit, and each has
checksums. ProRes 4444 (in QuickTime) is what theatres play and other programs take; FFmpeg encodes
it from 10 bits of Y, C_B, C_R in limited range. H.264 of 8 bits and HEVC of 10 (in MP4) are for
previews: colour differences lie at every second column and row.
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
from domesim.frames.yuv import PixelFormat, limited_codes, pixel_format, small_size
from domesim.host.writing import written_to

_RGB_FORMATS = {8: "bgr0", 10: "gbrp10le", 12: "gbrp12le", 16: "gbrp16le"}
_LEAST = 16  # pixels a side that HEVC has
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
        What ``--bits`` may ask for; None for nothing.
    options
        The encoder's.
    pixels
        FFmpeg's pixel format of Y, C_B and C_R; "" for R, G, B of the frames' depth.
    tag
        The sample entry that players know; "" for the container's usual.
    """

    suffix: str
    codec: str
    bits: tuple[int | None, ...]
    options: tuple[tuple[str, str], ...]
    pixels: str = ""
    tag: str = ""


_FFV1 = FilmFormat(
    ".mkv",
    "ffv1",
    (None, 8, 10, 12, 16),
    (("level", "3"), ("slicecrc", "1"), ("g", "1"), ("slices", "16")),
)
_PRORES = FilmFormat(
    ".mov",
    "prores_ks",
    (None, 12),
    (("profile", "4444"), ("vendor", "apl0"), ("bits_per_mb", "8000")),
    "yuv444p10le",
)
# The same bytes whatever the processor and its cores
_H264 = FilmFormat(
    ".mp4",
    "libx264",
    (None, 8),
    (("crf", "16"), ("x264-params", "cpu-independent=1:threads=4:keyint=24")),
    "yuv420p",
)
# x265 invents times for short films with B-frames
_HEVC = FilmFormat(
    ".mp4",
    "libx265",
    (10,),
    (("crf", "16"), ("x265-params", "frame-threads=1:bframes=0:keyint=24:log-level=none")),
    "yuv420p10le",
    "hvc1",
)
FILMS = {".mkv": (_FFV1,), ".mov": (_PRORES,), ".mp4": (_H264, _HEVC)}
"""Formats of videos, by suffix: the first is made if no depth is asked for."""


def write_film(
    path: Path,
    frames: Iterator[Frame],
    count: int,
    colour: ColourTag,
    timing: Timing,
    *,
    film: FilmFormat | None = None,
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
    film
        Which of `FILMS`; the suffix's first if None.
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
    av, film = pyav(path), film or FILMS[path.suffix][0]
    with written_to(path) as temporary:
        try:
            lacking = _encode(
                temporary, path, film, frames, colour, timing, dithered=dithered, sound=sound
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
    film: FilmFormat,
    frames: Iterator[Frame],
    colour: ColourTag,
    timing: Timing,
    *,
    dithered: bool,
    sound: Path | None,
) -> list[str]:
    av, first, kind = pyav(path), next(frames), pixel_format(film.pixels)
    rows, cols = first.pixels.shape[:2]
    small = rows % 2 or cols % 2 or min(rows, cols) < _LEAST
    if kind is not None and kind.chroma == "4:2:0" and small:
        raise InputError(
            f"{path}: wanted frames of even width and height, {_LEAST} at least, for MP4, got "
            f"{cols} x {rows}. Choose --format mkv or mov"
        )
    lacking = [] if first.header.alpha is None else ["without alpha"]
    with (
        # Without times, versions and numbers drawn by lot
        av.open(f"file:{temporary}", "w", container_options={"fflags": "+bitexact"}) as container,
        Sound(sound, container, timing.rate) as heard,
    ):
        stream: Any = container.add_stream(film.codec, rate=timing.rate, options=dict(film.options))
        stream.width, stream.height = cols, rows
        lossless = kind is None
        stream.pix_fmt = film.pixels or _RGB_FORMATS[first.bits]
        if timing.timecode:
            stream.metadata["timecode"] = timing.timecode
        if first.header.eyes is not None and lossless:  # FFmpeg writes none into QuickTime
            stream.metadata["stereo_mode"] = stereo_mode(first.header.eyes)
        lacking += heard.begin()
        primaries, transfer = code_points_of(colour)
        matrix = 0 if lossless else 9 if colour.primaries == "BT.2020" else 1
        context = stream.codec_context
        if film.tag:
            context.codec_tag = film.tag
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
                _rgb_planes(frame)
                if kind is None
                else _yuv_planes(frame, matrix, kind, dithered=dithered)
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


def _yuv_planes(
    frame: Frame, matrix: int, kind: PixelFormat, *, dithered: bool
) -> list[NDArray[Any]]:
    luma, *differences = limited_codes(frame.pixels, matrix, kind.bits)
    planes = [luma, *(small_size(each, kind.chroma) for each in differences)]
    for view, plane in enumerate(planes):
        if dithered:
            dither(plane, 2**kind.bits - 1, seed_of(frame.path, view))
        else:
            np.rint(plane, out=plane)
    return [plane.astype("u1" if kind.bits == 8 else "<u2") for plane in planes]


def _fill(plane: Any, codes: NDArray[Any]) -> None:
    filled = np.zeros((plane.height, plane.line_size // codes.itemsize), codes.dtype)
    filled[:, : codes.shape[1]] = codes
    plane.update(filled)
