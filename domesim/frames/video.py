"""Video file -> frame, by its number.

A frame of a video has a path as if the video were a folder: ``film.mov/film.0012.mov`` is the
twelfth of ``film.mov``. So a show of a video is one of numbered files to everything that only
needs their names. A DCP of two eyes is two sequences: ``film.mxf/film.left.0012.mxf`` and
``film.mxf/film.right.0012.mxf``.

A video must have a constant rate. Frame n then belongs at the time (n - 1) / rate, whoever looks
for it, in whatever order: the frame there is decoded from the last key frame before it, or on from
where this process is. None there is an error, as a missing file of a sequence is.

FFmpeg conceals damage. Here decoders are asked not to (``err_detect``), what they say of a frame is
heard, FFV1's checksums are computed anew, and the whole file is looked through for what is missing
before its first frame is used. Damage to what has no checksum is noticed only if it does not
decode: of ProRes, one flipped bit seldom does that.

PyAV is needed (extra ``video``), and imported only when a video is named.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from itertools import islice
from math import floor
from pathlib import Path
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from domesim.advice import ADVICE
from domesim.errors import InputError, reason
from domesim.frames.alpha import shown_over_black
from domesim.frames.colour import Asked, ColourTag, colour_of_code_points, meaning_of
from domesim.frames.containers import cropping_of, lacks_index, pyav, siting_of
from domesim.frames.eyes import Eyes, of_video
from domesim.frames.ffv1 import is_whole
from domesim.frames.frame import Frame, Header
from domesim.frames.integrity import (
    EQUIRECTANGULAR,
    SQUARE,
    damaged,
    projected,
    refuse_sides,
)
from domesim.frames.messages import one_line
from domesim.frames.orientation import UPRIGHT, turned
from domesim.frames.yuv import MATRICES, PixelFormat, beyond_limits, code_values, pixel_format
from domesim.host.files import KEPT_OPEN, open_plain

SUFFIXES = (".mov", ".mp4", ".m4v", ".mkv", ".webm", ".mxf")
"""Suffixes of files that are videos."""

CODECS = {
    "prores": "ProRes",
    "ffv1": "FFV1",
    "h264": "H.264",
    "hevc": "HEVC",
    "av1": "AV1",
    "vp9": "VP9",
    "dnxhd": "DNxHR",
    "cfhd": "CineForm",
    "hap": "HAP",
    "mjpeg": "Motion JPEG",
    "v210": "v210",
}
"""FFmpeg's names and people's. Each was seen to notice what does not decode."""

_CINEMA = {"jpeg2000": "JPEG 2000"}
"""What the MXF of a DCP holds (SMPTE ST 429-4): X'Y'Z' of 12 bits."""

_CONTAINERS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,mxf"
_ENCRYPTED = bytes.fromhex("060e2b34040101070d010301020b0100")  # SMPTE ST 429-6, 6.2: of a header
_STEREOSCOPIC = re.compile(  # SMPTE ST 429-10: a set of its header
    rb"\x06\x0e\x2b\x34\x02[\x53\x7f]\x01\x01\x0d\x01\x01\x01\x01\x01\x63\x00"
)
EYES = ("left", "right")
_WIDE = 1.3  # width by height of a view that is not squeezed; squeezed 16 : 9 has 0.89
_HEADER = 1 << 16
_UNSAID = (0, 2)  # ITU-T H.273: reserved, unspecified
_HLG = 18  # its TransferCharacteristics for HLG, which is of BT.2020
_RGB = 0  # its MatrixCoefficients for R, G, B
_LIMITED, _FULL = 1, 2  # FFmpeg's color_range
_SAMPLE = 8  # frames that are asked whether they have checksums
_AHEAD = 12  # frames that are decoded on to rather than sought
_LACKING = 0.75  # of a frame: what a file may be shorter than it says, for times are rounded
_KEPT = 4  # videos that stay open
_BACK = (0, 1, 16, 64, 256, None)  # frames before the wanted one that a key frame is sought at

_CINEMA_COLOUR = ColourTag("dcdm", "XYZ", "file: digital-cinema profile")

Stream: TypeAlias = Any
"""PyAV's, which is imported late."""


def is_video(path: Path) -> bool:
    """Whether there is a video of that name."""
    return path.suffix.lower() in SUFFIXES and path.is_file()


def video_of(path: Path) -> Path | None:
    """The video that `path` names a frame of; None if it names none."""
    return path.parent if is_video(path.parent) else None


def file_of(path: Path) -> Path:
    """The file that holds a frame: its video, or `path` itself."""
    return video_of(path) or path


def frame_paths(video: Path) -> tuple[Path, ...]:
    """The paths of all frames, the first with number 1; of two eyes, of the left, then the right.

    Raises
    ------
    InputError
        If the extra ``video`` is not installed; or the file is no video of `CODECS`, is not whole,
        has no constant rate, lacks frames, or is interlaced.
    """
    count, stereoscopic, _ = _looked_through(*_state(video))
    stems = [f"{video.stem}.{eye}" for eye in EYES] if stereoscopic else [video.stem]
    return tuple(
        video / f"{stem}.{number:04d}{video.suffix}"
        for stem in stems
        for number in range(1, count + 1)
    )


def eye_of(path: Path) -> str:
    """The eye whose frame of a video `path` names: one of `EYES`, "" of a flat one."""
    video = video_of(path)
    if video is None:
        return ""
    between = path.stem.removeprefix(f"{video.stem}.").rpartition(".")[0]
    return between if between in EYES else ""


def is_picture(track: Path) -> bool:
    """Whether a file of a DCP is a picture that is read."""
    try:
        with _opened(track):
            return True
    except InputError:
        return False


def container_of(start: bytes) -> str | None:
    """Returns the container that a video's first `START` bytes state; None if it is no video."""
    for begin, packet in ((0, 188), (4, 192)):  # ISO/IEC 13818-1, 2.4.3.2; cameras' have 4 more
        if start[begin::packet][:3] == b"GGG":
            return "MPEG-TS"
    return next(
        (name for name, place, mark in _MARKS if start[place : place + len(mark)] == mark), None
    )


def other_container(path: Path, container: str) -> InputError:
    """The error for a video in a container that is not read, or under a suffix that is not."""
    way = ADVICE["another container" if container == "MPEG-TS" else "another codec"]
    rename = ", or rename it if its suffix is wrong" if container in _READ else ""
    return InputError(
        f"{path}: wanted a video in {', '.join(SUFFIXES)}, got one in {container} called "
        f"'{path.suffix}'. Convert it ({way.given()}){rename}."
    )


START = 400
"""Bytes by which a container is known."""

_READ = ("QuickTime or MP4", "Matroska or WebM", "MXF")
_MARKS = (
    (_READ[0], 4, b"ftyp"),
    (_READ[0], 4, b"moov"),
    (_READ[1], 0, b"\x1a\x45\xdf\xa3"),
    ("AVI", 8, b"AVI "),
    (_READ[2], 0, b"\x06\x0e\x2b\x34\x02\x05\x01\x01\x0d\x01\x02"),
    ("MPEG", 0, b"\0\0\1\xba"),
    ("MPEG", 0, b"\0\0\1\xb3"),
    ("Windows Media", 0, b"\x30\x26\xb2\x75\x8e\x66\xcf\x11"),
    ("Flash", 0, b"FLV\1"),
    ("Ogg", 0, b"OggS"),
    ("YUV4MPEG2", 0, b"YUV4MPEG2"),
)
"""Name, and which bytes lie where."""


def read_video_frame(path: Path, *, colour: Asked | None = None, projection: str = "") -> Frame:
    """The frame that `path` names.

    Parameters
    ----------
    path
        One of `frame_paths`.
    colour
        As for `read_frame`.
    projection
        Of a panorama that is wanted; others are refused.

    Returns
    -------
    Code values of all codes, whatever the range in the file. Alpha is kept.

    Raises
    ------
    InputError
        If it is damaged or missing, or encoded in a way that is not supported.
    """
    with _decoding(path.parent) as decoder:
        return _frame(path, decoder, decoder.frame(path), colour, projection)


def rate_and_timecode(path: Path) -> tuple[Fraction, str]:
    """Frames a second of the video of frame `path`; and its timecode if that is the first frame."""
    with _decoding(path.parent) as decoder:
        timecode = decoder.timecode if _number(path) == 1 else ""
        return Fraction(decoder.stream.guessed_rate), timecode


def _number(path: Path) -> int:
    return int(path.stem.rpartition(".")[2])


def video_size(path: Path) -> tuple[int, int]:
    """Rows and columns of the frame that `path` names."""
    with _decoding(path.parent) as decoder:
        context, (left, top, right, bottom) = decoder.stream.codec_context, decoder.crop
        return context.height - top - bottom, context.width - left - right


def _state(video: Path) -> tuple[Path, int, int]:
    """The file, its size and time, by which what is known of it is kept."""
    try:
        state = video.stat()
    except OSError as error:
        raise InputError(f"{video}: wanted to read it, got '{reason(error)}'") from error
    return video, state.st_size, state.st_mtime_ns


# The file.

_WITHOUT = "an MP4 without its index (moov), or with half of it"


@contextmanager
def _refused(path: Path) -> Iterator[None]:
    """FFmpeg's complaints, in one line."""
    import av  # noqa: PLC0415

    try:
        yield
    except (av.FFmpegError, UnicodeError) as error:
        problem = error.strerror if isinstance(error, av.FFmpegError) else str(error)
        got = f"one that does not decode ({one_line(problem or '').lower()})"
        raise damaged(path, "video", _WITHOUT if lacks_index(path) else got) from None


@contextmanager
def _opened(video: Path) -> Iterator[tuple[Any, Stream]]:
    """The container and the picture of a video."""
    av = pyav(video)
    with open_plain(video) as file:
        container = container_of(file.read(START))
    if container is not None and container not in _READ:
        raise other_container(video, container)
    with _refused(video):
        opened = av.open(
            f"file:{video}",
            # No playlists and the like, which name other files
            options={"format_whitelist": _CONTAINERS},
            # Of a title that is not UTF-8 PyAV would make an error, and leave the file open.
            metadata_errors="replace",
        )
    with opened:
        yield opened, _picture_of(video, opened)


def _picture_of(video: Path, container: Any) -> Stream:
    av = pyav(video)
    covers = av.stream.Disposition.attached_pic
    streams = [each for each in container.streams.video if not each.disposition & covers]
    if not streams and lacks_index(video):
        raise damaged(video, "video", _WITHOUT)
    if not streams:
        got = "sound alone" if container.streams.audio else "a file that has none"
        raise InputError(f"{video}: wanted pictures, got {got}. Name the film.")
    if len(streams) != 1:
        raise InputError(f"{video}: wanted one picture, got {len(streams)}. Export one alone.")
    stream = streams[0]
    context = stream.codec_context
    _require_codec(video, context)
    if context.name == "vp9" and stream.metadata.get("alpha_mode") == "1":
        raise InputError(
            f"{video}: wanted a film whose alpha is in its frames, got VP9 with one beside them. "
            f"Convert it ({ADVICE['alpha of VP9'].given()})."
        )
    refuse_sides(video, context.width, context.height)
    if stream.guessed_rate is None or not stream.time_base:
        raise InputError(f"{video}: wanted a frame rate, got none. Convert it to ProRes or FFV1.")
    aspect = stream.sample_aspect_ratio or context.sample_aspect_ratio or 1
    if abs(aspect - 1) > SQUARE and not _both_views(video, stream, Fraction(aspect)):
        raise InputError(
            f"{video}: wanted square pixels, got ones of {aspect.numerator} : {aspect.denominator} "
            "(sample aspect ratio). Resize it to square ones first "
            f"({ADVICE['square pixels of a film'].given()})."
        )
    context.options = {"err_detect": "crccheck+bitstream+buffer+explode"}
    return stream


def _both_views(video: Path, stream: Stream, aspect: Fraction) -> bool:
    """Whether square pixels are twice as wide (or high) by Matroska's display size alone.

    It is of one view (RFC 9559, 18.10), and mkvmerge writes that of both. Which of them was meant,
    shows in the views: squeezed ones are higher than wide, and others are not.
    """
    mode = stream.metadata.get("stereo_mode", "")
    beside = mode in ("left_right", "right_left")
    if not (beside or mode in ("top_bottom", "bottom_top")) or aspect != (2 if beside else 0.5):
        return False
    context = stream.codec_context
    view = context.width / context.height * (0.5 if beside else 2)
    if view > _WIDE if beside else view < 2 * _WIDE:
        return True
    side, pixels = ("width", context.width // 2) if beside else ("height", context.height // 2)
    raise InputError(
        f"{video}: wanted views of square pixels, got ones of {view:.3g} : 1 at {aspect} : 1. If "
        f"they are whole, say the size of one "
        f"({ADVICE['size of one view'].given(side=side, pixels=pixels)}). If they are squeezed, "
        f"stretch them ({ADVICE['square pixels of a film'].given()})."
    )


def _require_codec(video: Path, context: Any) -> None:
    name = "none" if context is None else context.codec.canonical_name
    if video.suffix.lower() != ".mxf":
        if name not in CODECS:
            raise InputError(
                f"{video}: wanted {', '.join(CODECS.values())}, got {name}. Convert it to one of "
                "them."
            )
        return
    with open_plain(video) as file:
        if _ENCRYPTED in file.read(_HEADER):
            raise InputError(
                f"{video}: wanted a DCP's picture, got an encrypted one. Ask for one that is not, "
                "or for its DCDM."
            )
    if name not in _CINEMA or not str(context.pix_fmt).startswith("xyz12"):
        kind = f"{name} of {context.pix_fmt}" if name != "none" else "another"
        raise InputError(
            f"{video}: wanted a DCP's picture in MXF (JPEG 2000 of X'Y'Z'), got {kind}. Convert it "
            f"to a video in {', '.join(SUFFIXES[:-1])} ({ADVICE['another codec'].given()})."
        )


def _step(stream: Stream) -> Fraction:
    """Duration of one frame, in the stream's unit of time."""
    return 1 / (Fraction(stream.guessed_rate) * Fraction(stream.time_base))


@lru_cache(maxsize=8)
def _looked_through(video: Path, size: int, changed: int) -> tuple[int, bool, int]:
    """How many frames there are, none missing; whether each is two, for left and right; first time.

    Of a Matroska of two or three frames FFmpeg tells no first time.
    """
    with _opened(video) as (container, stream):
        shown = []
        with _refused(video):
            for packet in container.demux(stream):  # none is kept: together they are the file
                if packet.size and packet.is_corrupt:
                    raise damaged(video, "video", "one that ends early")
                if packet.size and not packet.is_discard:
                    shown.append(packet.pts)
            stated = _stated_seconds(container, stream) * stream.guessed_rate
        if not shown or None in shown:
            raise InputError(f"{video}: wanted frames with times, got none. Convert it to FFV1.")
        step = _step(stream)
        start = min(shown) if stream.start_time is None else stream.start_time
        for place, time in enumerate(sorted(shown)):
            if abs(time - start - place * step) >= step / 2:
                raise InputError(
                    f"{video}: wanted {float(stream.guessed_rate):.6g} frames a second, all there, "
                    f"got none for frame {place + 1}. Export it again, at a constant rate."
                )
        # Interop DCPs do not say so, but have two for each that they state.
        count, twice = len(shown), video.suffix.lower() == ".mxf" and len(shown) == 2 * stated
        if stereoscopic := twice or _says_stereoscopic(video):
            if count % 2:
                raise damaged(video, "video", "one that lacks its last right frame")
            count //= 2
        if stated - count > _LACKING:
            raise damaged(video, "video", f"one that lacks its last {round(stated - count)} frames")
    return count, stereoscopic, start


def _says_stereoscopic(video: Path) -> bool:
    if video.suffix.lower() != ".mxf":
        return False
    with open_plain(video) as file:
        return _STEREOSCOPIC.search(file.read(_HEADER)) is not None


def _stated_seconds(container: Any, stream: Stream) -> Fraction:
    """How long the header says that the picture is; 0 if it does not."""
    if stream.duration is not None:
        return Fraction(stream.duration * stream.time_base)
    stated = stream.metadata.get("DURATION", "")
    try:
        hours, minutes, seconds = stated.split(":")
        return 3600 * int(hours) + 60 * int(minutes) + Fraction(seconds)
    except ValueError:
        alone = len(container.streams) == 1 and container.duration
        return Fraction(container.duration, 1_000_000) if alone else Fraction(0)


# The frames.


@dataclass(frozen=True)
class _Tags:
    """What the file says of its colours, in the code points of ITU-T H.273."""

    primaries: int
    transfer: int
    matrix: int
    range: int


@final
class _Decoder:
    """A video that stays open between frames, until it is closed.

    Parameters
    ----------
    video
        The file.
    """

    def __init__(self, video: Path) -> None:
        self.lock, self.closed = threading.Lock(), False
        with ExitStack() as opened:
            self._container, self.stream = opened.enter_context(_opened(video))
            self._begin(video)
            self._opened = opened.pop_all()

    def _begin(self, video: Path) -> None:
        context = self.stream.codec_context
        start = self.stream.start_time
        self._start = _looked_through(*_state(video))[2] if start is None else start
        self.crop = cropping_of(video, context.width, context.height)
        self.siting = ""  # of colour differences, as soon as a frame tells
        metadata = [self._container.metadata, *(each.metadata for each in self._container.streams)]
        timecodes = (each.get("timecode") or each.get("TIMECODE") for each in metadata)
        self.timecode = next(filter(None, timecodes), "")
        # Before the decoder knows better, or worse: ProRes has tags of its own, often empty
        self.tags = _tags(context)
        self._step = _step(self.stream)
        self._frames: Iterator[Any] = iter(())
        self._at: Fraction | None = None
        self._pair: tuple[int, list[Any]] = (0, [])  # a number, and its frames of two eyes
        self._only_keys = True
        self._has_sums = context.name == "ffv1" and self._any_right_sum()

    def close(self) -> None:
        """Close the file."""
        with self.lock:
            self.closed = True
            self._opened.close()

    def frame(self, path: Path) -> Any:
        """Decode the frame that `path` names.

        Raises
        ------
        InputError
            If there is none, or it is damaged.
        """
        if eye_of(path):
            return self._pair_of(path)[EYES.index(eye_of(path))]
        wanted = self._start + (_number(path) - 1) * self._step
        before, self._at = self._at, None
        ahead = None if before is None else (wanted - before) / self._step
        with _refused(path):
            if ahead is not None and 0.5 < ahead < 0.5 + (1 if self._only_keys else _AHEAD):
                decoded = self._reached(wanted)
            else:
                decoded = self._sought(wanted)
        if decoded is None or abs(decoded.pts - wanted) >= self._step / 2:
            raise damaged(path, "video", "no frame of that number")
        self._at = wanted
        return decoded

    def _pair_of(self, path: Path) -> list[Any]:
        """Left and right, which follow each other: the container counts and seeks them as one."""
        number = _number(path)
        before, pair = self._pair
        if number == before:
            return pair
        self._pair = (0, [])
        place = floor(self._start + (number - 1) * self._step)
        skipped, sought = 0, number != before + 1 or not before
        with _refused(path):
            if sought and not self._seek(place):
                skipped, place = 2 * (number - 1), place + number - 1
            pair = list(islice(self._frames, skipped, skipped + 2))
        if len(pair) < 2 or (sought and pair[0].pts != place):
            raise damaged(path, "video", "no frame of that number")
        self._pair = number, pair
        return pair

    def _seek(self, place: int) -> bool:
        """Go on from there, or from the first frame where FFmpeg cannot: it takes some MXFs for a
        single clip.
        """
        import av  # noqa: PLC0415

        try:
            self._container.seek(place, stream=self.stream, backward=True)
        except av.FFmpegError:
            self._container.seek(self._start, stream=self.stream, backward=True)
            return False
        finally:
            self._frames = self._decoded()
        return True

    def _reached(self, wanted: Fraction) -> Any:
        """Decode on to the first frame not before `wanted`; None at the end."""
        for frame in self._frames:
            self._only_keys &= bool(frame.key_frame)
            if frame.pts > wanted - self._step / 2:
                return frame
        return None

    def _sought(self, wanted: Fraction) -> Any:
        """Decode from a key frame before `wanted`; None if there is no way to it.

        Where a container says that a decoder can begin, it may need what is before for some frames
        (open groups), or give the first only when the picture has recovered by and by.
        """
        import av  # noqa: PLC0415

        first = Fraction(self._start)
        failure = None
        for back in _BACK:
            earlier = first if back is None else max(first, wanted - back * self._step)
            # Times may be rounded to milliseconds.
            place = floor(earlier + self._step / 2)
            self._seek(place)
            try:
                key = next(self._frames, None)
            except av.FFmpegError as error:
                key, failure = None, error
            # Of what was trimmed off in front, the key frame itself is not given.
            if key is not None and (key.key_frame or earlier == first):
                if abs(key.pts - wanted) < self._step / 2:
                    return key
                if key.pts < wanted:
                    return self._reached(wanted)
            if earlier == first:
                break
        if failure is not None:
            raise failure
        return None

    def _any_right_sum(self) -> bool:
        """Whether the encoder made checksums; a damaged frame cannot tell."""
        with _refused(Path(self._container.name)):
            packets = islice(self._container.demux(self.stream), _SAMPLE)
            return any(is_whole(bytes(packet)) for packet in packets if packet.size)

    def _decoded(self) -> Iterator[Any]:
        """Frames from here on, each whole as far as can be seen."""
        import av  # noqa: PLC0415

        for packet in self._container.demux(self.stream):
            if self._has_sums and packet.size and not is_whole(bytes(packet)):
                raise av.InvalidDataError(0, "wrong checksum")
            for frame in packet.decode():
                if frame.pts is None or frame.is_corrupt:
                    raise av.InvalidDataError(0, "damaged")
                yield frame


_decoders: dict[tuple[Path, int, int], _Decoder] = {}
"""Those that stay open, the latest last."""
_choosing = threading.Lock()


@contextmanager
def _decoding(video: Path) -> Iterator[_Decoder]:
    """A video's decoder, for one thread at a time."""
    while True:
        decoder = _decoder(*_state(video))
        with decoder.lock:
            if not decoder.closed:  # by a thread that opened others
                yield decoder
                return


def _decoder(*state: *tuple[Path, int, int]) -> _Decoder:
    with _choosing:
        if not _decoders:
            KEPT_OPEN.callback(_close_all)
        decoder = _decoders.pop(state, None) or _Decoder(state[0])
        _decoders[state] = decoder
        surplus = [_decoders.pop(each) for each in [*_decoders][:-_KEPT]]
    for each in surplus:
        each.close()
    return decoder


def _close_all() -> None:
    while _decoders:
        _decoders.popitem()[1].close()


def _tags(source: Any) -> _Tags:
    values = source.color_primaries, source.color_trc, source.colorspace, source.color_range
    return _Tags(*(int(value) for value in values))


def _frame(
    path: Path, decoder: _Decoder, decoded: Any, colour: Asked | None, projection: str
) -> Frame:
    name = {**CODECS, **_CINEMA}[decoder.stream.codec_context.codec.canonical_name]
    kind = pixel_format(decoded.format.name)
    if kind is None:
        raise InputError(
            f"{path}: wanted R, G, B, or Y, Cb, Cr of 8 to 16 bits, got "
            f"{decoded.format.name}. Convert it to ProRes 4444 or FFV1."
        )
    if decoded.interlaced_frame:
        raise InputError(
            f"{path}: wanted whole frames, got interlaced ones. De-interlace it "
            f"({ADVICE['whole frames'].given()})."
        )
    tags = _completed(decoder.tags, _tags(decoded))
    if decoded.color_range in (_LIMITED, _FULL) and name not in _SILENT:
        tags = replace(tags, range=int(decoded.color_range))
    meant, stated = meaning_of(
        colour, lambda: _CINEMA_COLOUR if kind.xyz else _stated_colour(path, tags)
    )
    matrix, told = _matrix(path, tags, kind, meant)
    full = kind.full_range if tags.range not in (_LIMITED, _FULL) else tags.range == _FULL
    if not decoder.siting:
        decoder.siting = siting_of(decoded) if kind.chroma in ("4:2:0", "4:2:2") else "left"
    pixels, alpha = code_values(decoded, kind, matrix, full=full, siting=decoder.siting)
    pixels = _cropped(pixels, decoder.crop)
    alpha = None if alpha is None else _cropped(alpha, decoder.crop)
    ways = [told, "" if full else "limited range", _doubt(decoder.tags, decoded, kind, full=full)]
    ways = [each for each in ways if each]
    meant = replace(meant, source="; ".join([meant.source, *ways]))
    sample = "uint8" if kind.bits == 8 else "uint16"
    names = ("R", "G", "B") if alpha is None else ("R", "G", "B", "A")
    orientation, eyes = _shown(path, decoder.stream.metadata, decoded, projection)
    rate = decoder.stream.guessed_rate
    view = (("view", "string", eye_of(path)),) if eye_of(path) else ()
    header = Header(
        format=f"{name} {kind.chroma or 'RGB'}",
        attributes=(("FramesPerSecond", "rational", (rate.numerator, rate.denominator)), *view),
        channels=names,
        kinds=(sample,) * len(names),
        extra=() if alpha is None else (turned(_widened(alpha, kind.bits), orientation),),
        colour=stated,
        straight=True,
        eyes=eyes,
        notes=() if orientation == UPRIGHT else ("turned upright by its display matrix",),
    )
    pixels = turned(pixels, orientation) if orientation != UPRIGHT else pixels
    return shown_over_black(Frame(pixels, path, meant, kind.bits, floating=False, header=header))


_SILENT = ("ProRes", "FFV1")  # codecs whose frames say nothing of their own


def _cropped(samples: NDArray[Any], crop: tuple[int, int, int, int]) -> NDArray[Any]:
    left, top, right, bottom = crop
    rows, cols = samples.shape[:2]
    return samples[top : rows - bottom, left : cols - right]


def _doubt(tags: _Tags, decoded: Any, kind: PixelFormat, *, full: bool) -> str:
    """What speaks against the range that was taken; "" if nothing does."""
    if tags.range in (_LIMITED, _FULL) and (tags.range == _FULL) != full:
        return f"its container says {'limited' if full else 'full'}"
    if not full and not kind.chroma and beyond_limits(decoded, kind):
        return "as it says, but its codes are those of full range: is it?"
    return ""


_ONE = 65536  # of a display matrix: 16 bits below the point
_TURNS = {
    (1, 0, 0, 1): 1,
    (-1, 0, 0, 1): 2,
    (-1, 0, 0, -1): 3,
    (1, 0, 0, -1): 4,
    (0, 1, 1, 0): 5,
    (0, 1, -1, 0): 6,
    (0, -1, -1, 0): 7,
    (0, -1, 1, 0): 8,
}
"""Exif's number by where a display matrix (ISO/IEC 14496-12, 8.3.2) takes columns and rows."""


_FLAT = (4, 5)  # of AVSphericalProjection: rectilinear, and a fisheye's


def _shown(
    path: Path, metadata: Mapping[str, str], decoded: Any, projection: str
) -> tuple[int, Eyes | None]:
    """How a frame is turned when it is shown, and how two views are packed in it."""
    side_data = {each.type.name: bytes(each) for each in decoded.side_data}
    mapping = np.frombuffer(side_data.get("SPHERICAL", b"")[:4], np.int32)
    if mapping.size and int(mapping[0]) not in _FLAT:
        names = dict(enumerate((EQUIRECTANGULAR, "a cube", "a tile", "half equirectangular")))
        name = names.get(int(mapping[0]), "a sphere's surface")
        if name != projection:
            raise projected(path, name)
    matrix = np.frombuffer(side_data.get("DISPLAYMATRIX", b""), np.int32)
    orientation: int | None = UPRIGHT
    if matrix.size:
        orientation = _TURNS.get(tuple((matrix[[0, 1, 3, 4]] / _ONE).tolist()))
    if orientation is None:
        raise InputError(
            f"{path}: wanted a picture turned by quarters, got a display matrix of "
            f"{', '.join(f'{value:.3g}' for value in matrix[[0, 1, 3, 4]] / _ONE)}. Export it "
            "upright."
        )
    try:
        return orientation, of_video(side_data.get("STEREO3D"), metadata.get("stereo_mode", ""))
    except ValueError as error:
        raise InputError(
            f"{path}: wanted views side by side or one above the other, got {error}. Export "
            "it so, or left and right as two files."
        ) from error


def _completed(tags: _Tags, others: _Tags) -> _Tags:
    """`tags`, and where they say nothing, `others`."""
    return _Tags(
        tags.primaries if tags.primaries not in _UNSAID else others.primaries,
        tags.transfer if tags.transfer not in _UNSAID else others.transfer,
        tags.matrix if tags.matrix != _UNSAID[-1] else others.matrix,
        tags.range or others.range,
    )


def _matrix(
    video: Path, tags: _Tags, kind: PixelFormat, colour: ColourTag | None
) -> tuple[int, str]:
    """How R, G, B follow from luma: of `MATRICES`, and for a person."""
    if not kind.chroma:
        return _RGB, ""
    if tags.matrix in MATRICES:
        return tags.matrix, f"{MATRICES[tags.matrix][0]} matrix"
    if tags.matrix in (_RGB, *_UNSAID):
        wide = "BT.2020" if colour is None else colour.primaries
        matrix = 9 if wide == "BT.2020" else 1
        return matrix, f"{MATRICES[matrix][0]} matrix assumed"
    raise InputError(
        f"{video}: wanted the matrix of BT.601, BT.709 or BT.2020, got {tags.matrix} of ITU-T "
        f"H.273. Convert it to R, G, B (FFV1)."
    )


def _stated_colour(video: Path, tags: _Tags) -> ColourTag:
    """What the file says of its encoding; where it says nothing, what video is."""
    unsaid = [
        name
        for name, value in (("primaries", tags.primaries), ("transfer", tags.transfer))
        if value in _UNSAID
    ]
    usual = 9 if tags.transfer == _HLG else 1
    primaries = usual if tags.primaries in _UNSAID else tags.primaries
    transfer = 1 if tags.transfer in _UNSAID else tags.transfer
    tag = colour_of_code_points(video, primaries, transfer, "stream's tags")
    if len(unsaid) == 2:
        return replace(tag, source="assumed for video")
    return replace(tag, source=f"{tag.source}; {unsaid[0]} assumed") if unsaid else tag


def _widened(alpha: NDArray[Any], bits: int) -> NDArray[Any]:
    """Codes of 8 or 16 bits; those of other depths become 16, their upper bits repeated."""
    if bits in (8, 16):
        return alpha.copy()
    return (alpha << (16 - bits) | alpha >> (2 * bits - 16)).astype(np.uint16)
