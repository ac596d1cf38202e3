"""Subcommands for pictures that are compensated as they are shown: live, shader."""

from __future__ import annotations

import json as to_json
import os
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count, cycle, islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from compensate.aim import Aim
from compensate.live.coding import PIXEL_FORMATS, Coding, PixelFormat
from compensate.live.engines import engine_of
from compensate.live.process import (
    HELD,
    Report,
    read_exactly,
    read_into,
    read_line,
    stream,
    widen,
)
from compensate.live.y4m import FRAME, LONGEST, Y4M, header_of
from domesim.advice import ADVICE
from domesim.commands.options import Overwrite, Place, Quiet, grouped
from domesim.commands.shows import TPDF
from domesim.errors import InputError
from domesim.frames.colour import ColourTag
from domesim.frames.encodings import encoding_named
from domesim.host.console import Console
from domesim.host.writing import prepare, write_whole
from domesim.scene import Scene

Size = Annotated[
    str | None,
    typer.Option(
        metavar="WIDTHxHEIGHT",
        help="Pixels of a frame, with both views of a pair. Frames are raw then; without it they "
        "come as a Y4M stream, which says so itself.",
        show_default=False,
    ),
]
Packed = Annotated[
    str | None,
    typer.Option(
        "--packing",
        help="Pairs: side-by-side or top-bottom, of whole views; side-by-side by default.",
        show_default=False,
    ),
]
Encoded = Annotated[
    str | None,
    typer.Option(
        "--encoding",
        help="What code values are, as for 'domesim compensate'. By default the scene's response, "
        "and where it has none bt709, but srgb for raw frames; linear for rgbaf16.",
        show_default=False,
    ),
]

Lift = Annotated[
    float | None,
    typer.Option(
        help="How many times the missing light dark places are lifted, as for 'domesim "
        f"compensate'; {Aim().lift:g} by default.",
        show_default=False,
    ),
]

_INPUT, _OUTPUT = 0, 1  # file descriptors


@grouped
def live(
    place: Place,
    size: Size = None,
    pixel_format: Annotated[
        str, typer.Option(help=f"Samples of raw frames: {', '.join(PIXEL_FORMATS)}.")
    ] = "rgb24",
    fps: Annotated[
        float | None,
        typer.Option(
            help="Frames a second of the stream: latency is given in frames, too.",
            show_default=False,
        ),
    ] = None,
    packing: Packed = None,
    encoding: Encoded = None,
    lift: Lift = None,
    dither: Annotated[
        str, typer.Option(help="How codes are rounded: tpdf, with noise, or none.")
    ] = TPDF,
    device: Annotated[
        str | None,
        typer.Option(
            "--device",
            help="What computes: cpu, by compiled loops with the extra fast; cuda or cuda:1, a GPU "
            "by PyTorch (extra gpu), which is the default without fast.",
            show_default=False,
        ),
    ] = None,
    drop: Annotated[
        bool,
        typer.Option(
            "--drop", help="Leave out frames that are late, instead of letting the sender wait."
        ),
    ] = False,
    quiet: Quiet = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print figures to standard error as one JSON object.")
    ] = False,
) -> None:
    """Compensate frames from standard input to standard output, as they come."""
    theatre = place.load(Console(quiet=True))[1]  # standard output is not for text
    pixels = PIXEL_FORMATS.get(pixel_format)
    if pixels is None:
        raise InputError(
            f"--pixel-format {pixel_format!r} is not known; use {', '.join(PIXEL_FORMATS)}"
        )
    settings: Any = {"aim": Aim() if lift is None else Aim(lift=lift), "dithers": _dithers(dither)}
    if os.isatty(_INPUT) or os.isatty(_OUTPUT):
        raise InputError(
            "live: frames come by standard input and go by standard output; name both "
            "(ffmpeg ... | domesim live ... | ffplay ...)"
        )
    widen(_INPUT, _OUTPUT)
    header = None
    if size is None:
        header = header_of(read_line(_INPUT, LONGEST))
        width, height, pixels = header.width, header.height, PIXEL_FORMATS["rgb48le"]
        settings["dithers"] = False  # the planes have fewer bits
    else:
        width, height = _size(size)
    usual = "bt709" if header else "linear" if pixels.floating else "srgb"
    rows, cols, beside = _views(theatre, width, height, packing)
    coding = Coding(theatre.projector, _meaning(theatre, encoding, usual))
    name, compensated = engine_of(
        theatre, rows, cols, coding, pixels, beside=beside, device=device, **settings
    )
    compensated(np.zeros((height, width, pixels.channels), pixels.dtype), 0)  # compiles
    if not quiet:
        print(
            f"{theatre.name}: {width} x {height}, {_told(coding.colour)}, by {name}: ready",
            file=sys.stderr,
            flush=True,
        )
    room: Iterator[Any] = (
        np.empty((height, width, pixels.channels), pixels.dtype) for _ in count()
    )
    if not drop:  # they come back in turns: who drops frames cannot tell which are still in use
        room = cycle(list(islice(room, HELD)))
    frames = _raw(room, pixels) if header is None else _of_y4m(header)
    if header is not None:
        os.write(_OUTPUT, header.line + b"\n")
    report = stream(frames, compensated, _OUTPUT, drop=drop, head=_written(header))
    if json:
        facts = {**place.about(theatre), "computed_by": name, **report.figures(fps)}
        print(to_json.dumps(facts, indent=1), file=sys.stderr)
    elif not quiet:
        print(_line(report), file=sys.stderr)


@grouped
def shader(
    place: Place,
    out: Annotated[
        Path, typer.Option("--out", help="The shader to write, a .glsl file.", show_default=False)
    ],
    size: Annotated[
        str,
        typer.Option(
            metavar="WIDTHxHEIGHT",
            help="Pixels of the video, with both views of a pair.",
            show_default=False,
        ),
    ],
    packing: Packed = None,
    encoding: Encoded = None,
    lift: Lift = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write a user shader for mpv and FFmpeg's libplacebo that compensates a video as it plays."""
    from compensate.live.shader import shader_of  # noqa: PLC0415 - not for live

    theatre = place.load(Console(quiet=True))[1]  # standard output is not for text
    width, height = _size(size)
    aim = Aim() if lift is None else Aim(lift=lift)
    rows, cols, beside = _views(theatre, width, height, packing)
    colour = _meaning(theatre, encoding, "bt709")
    prepare(out, inputs=place.files(), overwrite=overwrite)
    write_whole(out, shader_of(theatre, rows, cols, colour, beside=beside, aim=aim).encode())
    Console(quiet=quiet).say(
        f"{theatre.name}: {width} x {height}, {_told(colour)}",
        ADVICE["a film in a player"].given(shader=out, film="VIDEO"),
    )


def _meaning(theatre: Scene, encoding: str | None, usual: str) -> ColourTag:
    """What code values are: as asked for, by the projector's response, or what is usual."""
    if encoding is not None:
        return encoding_named(encoding)
    assumed = replace(encoding_named(usual), source="assumed for live frames")
    response = theatre.projector.response
    return assumed if response is None else response.instead_of(assumed)


def _told(colour: ColourTag) -> str:
    """A curve, and why it was taken."""
    return f"{colour.named} ({colour.source})"


def _dithers(name: str) -> bool:
    """Whether codes are rounded with noise."""
    if name not in (TPDF, "none"):
        raise InputError(f"--dither {name!r} is not known; use {TPDF} or none")
    return name == TPDF


def _size(text: str) -> tuple[int, int]:
    """Width and height."""
    match = re.fullmatch(r"([1-9][0-9]{0,5})x([1-9][0-9]{0,5})", text)
    if match is None:
        raise InputError(f"--size {text!r} is no size; say WIDTHxHEIGHT, such as 2048x2048")
    return int(match[1]), int(match[2])


def _views(theatre: Scene, width: int, height: int, packing: str | None) -> tuple[int, int, bool]:
    """(row, col) of each view, and whether they lie side by side."""
    if theatre.views == 1:
        if packing is not None:
            raise InputError(f"{theatre.name} is a dome, with one view; leave out --packing")
        return height, width, False
    if packing not in (None, "side-by-side", "top-bottom"):
        raise InputError(f"--packing {packing!r}: live, it is side-by-side or top-bottom")
    beside = packing != "top-bottom"
    across, down = (2, 1) if beside else (1, 2)
    if width % across or height % down:
        raise InputError(
            f"two views {packing or 'side-by-side'} have an even "
            f"{'width' if beside else 'height'}, got {width} x {height}"
        )
    return height // down, width // across, beside


def _raw(room: Iterator[Any], pixels: PixelFormat) -> Iterator[Any]:
    """Raw frames of standard input, read into `room`."""
    for number, frame in enumerate(room):
        got = read_into(_INPUT, memoryview(frame).cast("B"), _OUTPUT)
        if not got:
            return
        _require_whole(got, frame.nbytes, number, "are --size and --pixel-format right?")
        if pixels.floating and ((frame[..., :3].view("<u2") & 0x7C00) == 0x7C00).any():
            raise InputError(
                f"standard input, frame {number}: got NaN or infinite samples; mend what renders "
                f"them"
            )
        yield frame


def _of_y4m(header: Y4M) -> Iterator[Any]:
    """Frames of a Y4M stream on standard input."""
    number = 0
    while line := read_line(_INPUT, LONGEST, _OUTPUT):
        if not line.startswith(FRAME):
            raise InputError(
                f"standard input, frame {number}: wanted FRAME, got {line[:16]!r}; the stream is "
                f"damaged"
            )
        data = read_exactly(_INPUT, header.size, _OUTPUT)
        _require_whole(len(data), header.size, number, "was its sender stopped?")
        yield header.decoded(data)
        number += 1


def _require_whole(got: int, wanted: int, number: int, question: str) -> None:
    if got < wanted:
        raise InputError(
            f"standard input ended within frame {number}: wanted {wanted} bytes, got {got}; "
            f"{question}"
        )


def _written(header: Y4M | None) -> Callable[[Any], list[Any]]:
    """What to write of a frame."""
    if header is None:
        return lambda frame: [frame]
    return lambda frame: [FRAME + b"\n", header.encoded(frame)]


def _line(report: Report) -> str:
    """For a person."""
    figures = report.figures(None)
    if not report.frames:
        return "no frames"
    dropped = f", {report.dropped} dropped" if report.dropped else ""
    latency = figures["latency_ms"]
    return (
        f"{report.frames} frames{dropped}, {figures['fps']:.1f} a second, latency "
        f"{latency['median']:.0f} ms (slowest hundredth {latency['p99']:.0f} ms)"
    )
