"""Subcommands for pictures that are compensated as they are shown: live, shader."""

from __future__ import annotations

import json as to_json
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from itertools import count, cycle, islice
from pathlib import Path
from typing import Annotated, Any, final

import numpy as np
import typer

from compensate.aim import Aim
from compensate.live.coding import PIXEL_FORMATS, Coding, PixelFormat
from compensate.live.engines import Engine, engine_of
from compensate.live.ndi import Receiver, Sender, encoded
from compensate.live.process import (
    HELD,
    Compensate,
    Report,
    read_exactly,
    read_into,
    read_line,
    stream,
    widen,
)
from compensate.live.y4m import FRAME, LONGEST, Y4M, header_of
from compensate.shows.cue_list import CANDIDATES, CueList, read_cue_list
from domesim.advice import ADVICE
from domesim.commands.options import Overwrite, Place, Quiet, grouped
from domesim.commands.shows import TPDF
from domesim.errors import InputError
from domesim.frames.colour import ColourTag
from domesim.frames.encodings import encoding_named
from domesim.host import endings
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
Cued = Annotated[
    Path | None,
    typer.Option(
        "--cues",
        metavar="FILE",
        help="A cue list (CSV), as for 'domesim compensate'. The first frame that comes is number "
        "1.",
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
    cue_list: Cued = None,
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
    ndi_in: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Take frames by NDI, from the source of that name, instead of standard input "
            "(extra ndi). It is waited for. --ndi-out says where they go.",
            show_default=False,
        ),
    ] = None,
    ndi_out: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Send them by NDI, as a source of that name; late ones are left out.",
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
    """Compensate frames as they come, from standard input to standard output, or by NDI."""
    theatre = place.load(Console(quiet=True))[1]  # standard output is not for text
    pixels = PIXEL_FORMATS.get(pixel_format)
    if pixels is None:
        raise InputError(
            f"--pixel-format {pixel_format!r} is not known; use {', '.join(PIXEL_FORMATS)}"
        )
    usual, dithers = Aim() if lift is None else Aim(lift=lift), _dithers(dither)
    cues = None if cue_list is None else read_cue_list(cue_list)
    if (ndi_in is None) != (ndi_out is None):
        raise InputError("live: --ndi-in and --ndi-out belong together; name both")
    over, told = threading.Event(), partial(print, file=sys.stderr, flush=True)
    with endings.heard_by(over.set) if ndi_in else nullcontext(), ExitStack() as held:
        if ndi_in is not None and ndi_out is not None:
            tell = (lambda line: None) if quiet else told
            way = _by_ndi(held.enter_context(Receiver(ndi_in, over, tell)), ndi_out, held, size)
        else:
            way = _by_pipes(size, pixels, drop=drop)
        if way is None:
            return
        rows, cols, beside = _views(theatre, way.width, way.height, packing)
        coding = Coding(theatre.projector, _meaning(theatre, encoding, way.usual))
        name, engine = engine_of(
            theatre,
            rows,
            cols,
            coding,
            way.pixels,
            beside=beside,
            device=device,
            dithers=dithers and way.dithers,
        )
        first = np.zeros((way.height, way.width, way.pixels.channels), way.pixels.dtype)
        engine(first, 0, usual.lift)  # compiles
        if not quiet:
            told(
                f"{theatre.name}: {way.width} x {way.height}, {_told(coding.colour)}, by {name}: "
                f"ready"
            )
        if way.begin:
            os.write(_OUTPUT, way.begin)
        compensated = _cued(engine, cues or CueList("none", ()), usual.lift)
        report = stream(way.frames, compensated, way.sink, drop=way.drop, head=way.head)
    if json:
        facts = {**place.about(theatre), "computed_by": name, **report.figures(fps or way.rate)}
        print(to_json.dumps(facts, indent=1), file=sys.stderr)
    elif not quiet:
        print(_line(report), file=sys.stderr)


def _cued(engine: Engine, cues: CueList, usual: float) -> Compensate:
    """What makes each frame as a cue list says; `usual` is the lift of those it does not name."""

    def compensated(codes: Any, number: int) -> Any:
        at = number + 1  # as a video's frames are counted
        method = cues.method(at, CANDIDATES[0])
        if method == "none":
            return codes.copy()  # its place is read into before this has gone out
        return engine(codes, number, 0.0 if method == "subtractive" else cues.lift(at, usual))

    return compensated


@final
@dataclass(frozen=True)
class _Way:
    """How frames come and go."""

    width: int
    height: int
    pixels: PixelFormat
    usual: str  # encoding
    frames: Iterator[Any]
    sink: int | Callable[[Any], None]
    head: Callable[[Any], list[Any]]
    drop: bool
    dithers: bool  # whether frames go out with all the bits that they are made with
    begin: bytes = b""  # of the stream
    rate: float | None = None


def _by_pipes(size: str | None, pixels: PixelFormat, *, drop: bool) -> _Way:
    if os.isatty(_INPUT) or os.isatty(_OUTPUT):
        raise InputError(
            "live: frames come by standard input and go by standard output; name both "
            "(ffmpeg ... | domesim live ... | ffplay ...)"
        )
    widen(_INPUT, _OUTPUT)
    if size is None:
        header = header_of(read_line(_INPUT, LONGEST))
        return _Way(
            header.width,
            header.height,
            PIXEL_FORMATS["rgb48le"],
            "bt709",
            _of_y4m(header),
            _OUTPUT,
            _written(header),
            drop,
            dithers=False,  # the planes have fewer bits
            begin=header.line + b"\n",
        )
    width, height = _size(size)
    room: Iterator[Any] = (
        np.empty((height, width, pixels.channels), pixels.dtype) for _ in count()
    )
    if not drop:  # they come back in turns: who drops frames cannot tell which are still in use
        room = cycle(list(islice(room, HELD)))
    return _Way(
        width,
        height,
        pixels,
        "linear" if pixels.floating else "srgb",
        _raw(room, pixels),
        _OUTPUT,
        lambda frame: [frame],
        drop,
        dithers=True,
    )


def _by_ndi(source: Receiver, out: str, held: ExitStack, size: str | None) -> _Way | None:
    """None if it is over before the source is there."""
    if size is not None:
        raise InputError("--size: frames of NDI say their size themselves; leave it out")
    if not source.connect():
        return None
    height, width = source.shape
    return _Way(
        width,
        height,
        PIXEL_FORMATS["rgba64le" if source.alpha else "rgb48le"],
        "bt709",
        source.pictures(),
        held.enter_context(Sender(out, source)).send,
        lambda frame: [encoded(frame)],
        drop=True,  # its sender does not wait
        dithers=False,
        rate=float(source.rate),
    )


@grouped
def shader(
    place: Place,
    out: Annotated[
        Path,
        typer.Option("--out", help="The shader to write: .glsl; .fs of ISF.", show_default=False),
    ],
    size: Annotated[
        str,
        typer.Option(
            metavar="WIDTHxHEIGHT",
            help="Pixels of the video, with both views of a pair.",
            show_default=False,
        ),
    ],
    player: Annotated[
        str,
        typer.Option(
            "--for",
            help="Who runs it: mpv, any of them, and FFmpeg's libplacebo; gpu-next, mpv with that "
            "output (libplacebo 6), whose options are its lift and its switch; isf, hosts of the "
            "Interactive Shader Format (VDMX, MadMapper), which have them as inputs; "
            "touchdesigner, the text of a GLSL TOP for each of its passes.",
        ),
    ] = "mpv",
    packing: Packed = None,
    encoding: Encoded = None,
    lift: Lift = None,
    cue_list: Annotated[
        Path | None,
        typer.Option(
            "--cues",
            metavar="FILE",
            help="--for gpu-next: a cue list (CSV), as for 'domesim compensate'. A script for mpv "
            "is written beside the shader (.lua), which sets its options frame by frame.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write a shader that compensates a video as it plays, for mpv, FFmpeg and ISF hosts."""
    from compensate.live.isf import isf_of  # noqa: PLC0415 - not for live
    from compensate.live.shader import script_of, shader_of  # noqa: PLC0415

    writers: dict[str, Callable[..., str]] = {
        "mpv": shader_of,
        "gpu-next": partial(shader_of, uniforms=True),
        "isf": isf_of,
        "touchdesigner": partial(isf_of, touch=True),
    }
    if player not in writers:
        raise InputError(f"--for {player!r} is not known; use one of {', '.join(writers)}")

    theatre = place.load(Console(quiet=True))[1]  # standard output is not for text
    width, height = _size(size)
    aim = Aim() if lift is None else Aim(lift=lift)
    rows, cols, beside = _views(theatre, width, height, packing)
    colour = _meaning(theatre, encoding, "bt709")
    texts = {out: writers[player](theatre, rows, cols, colour, beside=beside, aim=aim)}
    if cue_list is not None:
        if player != "gpu-next":
            raise InputError(f"--cues belongs to --for gpu-next, got --for {player}")
        script = out.with_suffix(".lua")
        texts[script] = script_of(read_cue_list(cue_list), aim.lift, script.name)
    inputs = [*place.files(), *([] if cue_list is None else [cue_list])]
    prepare(*texts, inputs=inputs, overwrite=overwrite)
    for path, text in texts.items():
        write_whole(path, text.encode())
    advice = {
        "mpv": ADVICE["a film in a player"].given(shader=out, film="VIDEO"),
        "gpu-next": ADVICE["a film in gpu-next"].given(shader=out, film="VIDEO"),
        "isf": f"-> {out}",
        "touchdesigner": f"-> {out} (its first lines say how TOPs are connected)",
    }
    scripts = [f"and, for the cues, --script={path}" for path in texts if path != out]
    Console(quiet=quiet).say(
        f"{theatre.name}: {width} x {height}, {_told(colour)}", advice[player], *scripts
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


def _written(header: Y4M) -> Callable[[Any], list[Any]]:
    """What to write of a frame."""
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
