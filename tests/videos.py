"""Videos whose frames tell which they are: for tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROWS, COLS = 48, 64
BITS = 6
"""Of a number, each a bar of the picture."""

UNSAID = 2


@dataclass(frozen=True)
class Kind:
    """How a video is made."""

    suffix: str
    codec: str
    pixels: str
    options: dict[str, str] = field(default_factory=dict)
    primaries: int = 1
    transfer: int = 1
    matrix: int = 1
    full: bool = False


def x265(options: str) -> dict[str, str]:
    """With B-frames only if `options` say so: x265 invents times for films that are too short."""
    options = options if "bframes=" in options else f"{options}:bframes=0"
    return {"x265-params": f"{options}:scenecut=0:pools=1:frame-threads=1:log-level=none"}


def x264(options: str) -> dict[str, str]:
    return {"x264-params": f"{options}:scenecut=0:threads=1"}


FFV1 = {"level": "3", "slicecrc": "1"}
KINDS = {
    "H.264": Kind(".mp4", "libx264", "yuv420p", x264("keyint=12:bframes=3")),
    "H.264 of open groups": Kind(
        ".mkv", "libx264", "yuv420p10le", x264("keyint=12:bframes=3:open-gop=1")
    ),
    "H.264 without key frames": Kind(
        ".mp4", "libx264", "yuv420p", x264("keyint=12:bframes=0:intra-refresh=1")
    ),
    "HEVC of open groups": Kind(
        ".mp4", "libx265", "yuv420p10le", x265("keyint=12:bframes=4:open-gop=1")
    ),
    "HEVC without B": Kind(".mp4", "libx265", "yuv420p10le", x265("keyint=99:bframes=0")),
    "HEVC": Kind(".mkv", "libx265", "yuv422p10le", x265("keyint=9:bframes=2:open-gop=0")),
    "ProRes 422": Kind(".mov", "prores_ks", "yuv422p10le", {"profile": "hq"}),
    "ProRes 4444": Kind(".mov", "prores_ks", "yuv444p10le", {"profile": "4444"}),
    "FFV1": Kind(".mkv", "ffv1", "gbrp12le", {**FFV1, "g": "1"}, matrix=0, full=True),
    "FFV1 of groups": Kind(".mkv", "ffv1", "gbrp16le", {**FFV1, "g": "10"}, matrix=0, full=True),
}

Planes = Sequence[NDArray[Any]]
"""Of codes, as the pixel format has them: (row, col), or (row, col, channel) of packed ones."""


def numbered(number: int, kind: str) -> list[NDArray[Any]]:
    """The planes of a grey picture that tells its number."""
    import av  # noqa: PLC0415

    grey = np.full((ROWS, COLS), 0.3)
    across = COLS // BITS
    for bit in range(BITS):
        if number >> bit & 1:
            grey[:, bit * across : (bit + 1) * across] = 0.7
    planes = []
    for each in av.VideoFormat(kind, COLS, ROWS).components:
        values = np.full((each.height, each.width), 0.5) if each.is_chroma else grey
        planes.append(np.rint(values * (2**each.bits - 1)))
    return planes


def number_of(pixels: NDArray[Any]) -> int:
    """Which frame it is."""
    across = COLS // BITS
    middles = [
        pixels[ROWS // 4 : -ROWS // 4, bit * across + 3 : (bit + 1) * across - 3, 1]
        for bit in range(BITS)
    ]
    return sum(int(middle.mean() > 0.5) << bit for bit, middle in enumerate(middles))


def write_video(
    path: Path,
    kind: Kind,
    frames: Iterable[Planes],
    *,
    rate: Fraction = Fraction(24),
    times: Callable[[int], int] = lambda place: place,
    frames_say: bool = True,
    metadata: dict[str, str] | None = None,
    prepare: Callable[[Any], None] = lambda stream: None,
) -> Path:
    """Write planes of codes as a video; at `times`, in frames."""
    import av  # noqa: PLC0415

    frames = [list(planes) for planes in frames]
    rows, cols = frames[0][0].shape[:2]
    with av.open(str(path), "w") as container:
        stream = container.add_stream(kind.codec, rate=rate, options=kind.options)
        stream.width, stream.height, stream.pix_fmt = cols, rows, kind.pixels
        stream.metadata.update(metadata or {})
        prepare(stream)
        context = stream.codec_context
        context.color_primaries, context.color_trc = kind.primaries, kind.transfer
        context.colorspace, context.color_range = kind.matrix, 2 if kind.full else 1
        for place, planes in enumerate(frames):
            frame = av.VideoFrame(cols, rows, kind.pixels)
            dtype = np.dtype("u1" if frame.format.components[0].bits == 8 else "<u2")
            for plane, codes in zip(frame.planes, planes, strict=True):
                filled = np.zeros((plane.height, plane.line_size // dtype.itemsize), dtype)
                flat = codes.reshape(plane.height, -1)
                filled[:, : flat.shape[1]] = flat
                plane.update(filled.tobytes())
            frame.pts, frame.time_base = times(place), 1 / rate
            if frames_say:
                frame.color_primaries, frame.color_trc = kind.primaries, kind.transfer
            frame.colorspace, frame.color_range = context.colorspace, context.color_range
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def write_numbered(path: Path, kind: Kind, count: int, **options: Any) -> Path:
    frames = [numbered(number, kind.pixels) for number in range(1, count + 1)]
    return write_video(path, kind, frames, **options)


def rewritten(source: Path, path: Path, keep: Callable[[int], bool]) -> Path:
    """The packets of `source` that are to be kept, as they are, in a container of their own."""
    import av  # noqa: PLC0415

    with av.open(str(source)) as old, av.open(str(path), "w") as new:
        stream = new.add_stream_from_template(old.streams.video[0])
        for place, packet in enumerate(old.demux(video=0)):
            if packet.size and keep(place):
                packet.stream = stream
                new.mux(packet)
    return path
