"""``domesim measure patterns``: test patterns to project, and what goes with them."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from domesim.commands.options import Json, OutFolder, Quiet, finish
from domesim.commands.shows import suffix_of
from domesim.errors import InputError
from domesim.frames import LARGEST_SIDE, ColourTag, Frame, Pixels, write_frame, write_whole
from domesim.frames.encodings import encoding_named
from domesim.frames.film import FILMS
from domesim.frames.formats import SUFFIXES
from domesim.frames.frame import Header
from domesim.host.console import Console
from domesim.host.writing import prepare
from domesim.light import transfer
from domesim.measure.patterns import Codes, Pattern
from domesim.measure.patterns.dome import dome_patterns
from domesim.measure.patterns.listing import NAME as LIST
from domesim.measure.patterns.listing import Listed, PatternList
from domesim.measure.patterns.page import page
from domesim.measure.patterns.sheets import INSTRUMENTS, Sheet
from domesim.measure.patterns.stereo import stereo_patterns
from domesim.readings.meter import EYES
from domesim.room.dome import Dome
from domesim.scene import load_dome

DOME_SIZE, STEREO_SIZE = "2048", "2048x1080"
LEVELS = 10
PAGE = "how-to.html"
_LEAST = 64


def patterns(
    out: OutFolder,
    dome: Annotated[bool, typer.Option("--dome", help="For a dome: domemasters.")] = False,
    stereo: Annotated[
        bool, typer.Option("--stereo", help="For a 3D screen: left and right pictures.")
    ] = False,
    size: Annotated[
        str | None,
        typer.Option(
            help=f"Pixels: {DOME_SIZE} for a domemaster of so many a side, {STEREO_SIZE} for a "
            f"screen's width and height.",
            show_default=False,
        ),
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(
            "--scene",
            help="The dome: a scene's name or .toml file. A hemisphere if none.",
            show_default=False,
        ),
    ] = None,
    instrument: Annotated[
        str | None,
        typer.Option(
            "--with",
            metavar="|".join(INSTRUMENTS),
            help="What you measure with: only its patterns, its page, and the table that domesim "
            "measure takes. All patterns if none.",
            show_default=False,
        ),
    ] = None,
    levels: Annotated[int, typer.Option(help="Steps of each ramp from black to full.")] = LEVELS,
    file_format: Annotated[
        str, typer.Option("--format", help="exr, png, tif, dpx or jp2.")
    ] = "png",
    bits: Annotated[
        int | None, typer.Option(help="Bits of a sample; by default the format's least.")
    ] = None,
    encoding: Annotated[
        str | None,
        typer.Option(
            help="What the files say that their code values are: srgb, p3-dci, bt709, linear, ...; "
            "srgb if none, linear for float files.",
            show_default=False,
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write test patterns to project before a meter or a camera, and a page that says how."""
    console = Console(quiet=quiet, json=json)
    if dome == stereo:
        raise InputError("wanted one of --dome and --stereo; say which screen you have")
    rows, cols = _size(size, DOME_SIZE if dome else STEREO_SIZE, square=dome)
    suffix, codes, colour = _codes(file_format, bits, encoding)
    if scene is not None and stereo:
        raise InputError(f"--scene {scene} is for --dome: a 3D screen's patterns need none")
    room = None if scene is None else load_dome(scene)
    shape = Dome(1.0, np.pi / 2) if room is None else room.dome
    furnished = room is not None and bool(replace(room.theatre, lamps=()).beyond_enclosure)
    sheet = _sheet(instrument, out, scene, dome=dome, furnished=furnished)
    whole = dome_patterns(shape, codes, levels) if dome else stereo_patterns(codes, levels)
    made = tuple(each for each in whole if sheet.wants(each.name, each.kind))
    folders = (out,) if dome else tuple(out / eye for eye in EYES)
    files = {
        pattern.name: [folder / f"{number:04d}_{pattern.name}{suffix}" for folder in folders]
        for number, pattern in enumerate(made, 1)
    }
    prepare(
        *chain(*files.values()),
        *(out / name for name in (LIST, PAGE, *sheet.names)),
        inputs=[scene],
    )
    areas = shape.screen_areas(rows, cols) if dome else np.ones((rows, cols))
    listed = []
    with console.progress("drawing", len(made)) as start:
        for number, pattern in enumerate(made, 1):
            start(pattern.name)
            listed.append(
                _written(
                    number,
                    pattern,
                    files[pattern.name],
                    out,
                    areas,
                    codes,
                    colour,
                    shape if dome else None,
                )
            )
    encoded = {"transfer": colour.transfer, "primaries": colour.primaries}
    facts = PatternList(
        "dome" if dome else "stereo",
        (cols, rows),
        {**encoded, "bits": codes.bits, "floating": codes.floating},
        {"half_angle_deg": float(np.degrees(shape.half_angle)),
         "tilt_deg": float(np.degrees(shape.tilt))} if dome else None,
        tuple(listed),
    )  # fmt: skip
    written = facts.write(out)
    tables = sheet.files(facts)
    seen = {"folder": f"{out.as_posix()}/", "theatre": "mine.toml" if scene is None else scene}
    write_whole(out / PAGE, page(made, facts, sheet, tables, **seen).encode())
    for name, table in tables.items():
        write_whole(out / name, table.encode())
    count = len(made) * len(folders)
    console.say(
        f"{len(made)} patterns, {count} files of {cols} x {rows} pixels, {codes.bits} bit"
        f"{' float' if codes.floating else ''}, {colour.transfer}\n  -> {out}",
        f"Print this first: {out / PAGE}",
    )
    if tables:
        console.say(f"Fill in: {', '.join(str(out / name) for name in tables)}")
    console.say(f"Then: {sheet.command(**seen)}")
    if furnished and instrument in (None, "dslr"):
        assert room is not None
        more = replace(room.theatre, lamps=()).beyond_enclosure
        console.say(
            f"{room.name} has {', '.join(more)}: with photographs measure it with domesim measure "
            "dome --without-geometry, or describe the room without them (domesim scene new --plain)"
        )
    names = {"list": str(written), "page": str(out / PAGE), "tables": [*tables]}
    finish(console, {"output": str(out), **names, "patterns": len(made), "files": count}, [])


def _sheet(
    instrument: str | None, out: Path, scene: str | None, *, dome: bool, furnished: bool
) -> Sheet:
    if instrument is not None and instrument not in INSTRUMENTS:
        raise InputError(f"--with {instrument}: use one of {', '.join(INSTRUMENTS)}")
    if instrument == "lux" and not dome:
        raise InputError(
            "--with lux is for --dome: a lux meter sees the whole room and not the screen; use "
            "luminance, colorimeter, spectroradiometer, dslr or eye"
        )
    theatre = scene
    if scene is not None and scene.endswith(".toml"):
        theatre = Path(os.path.relpath(Path(scene).resolve(), out.resolve())).as_posix()
    return Sheet(instrument, dome, theatre, furnished)


def _written(
    number: int,
    pattern: Pattern,
    files: list[Path],
    folder: Path,
    areas: NDArray[np.float64],
    codes: Codes,
    colour: ColourTag,
    dome: Dome | None,
) -> Listed:
    rows, cols = areas.shape
    mask = pattern.mask(rows, cols)
    for path, view in zip(files, pattern.painted(mask), strict=True):
        _write(view, path, pattern, codes, colour)
    parameters = dict(pattern.parameters)
    if dome is not None and "markers" in parameters:
        parameters["markers"] = [_placed(marker, dome, rows) for marker in parameters["markers"]]
    return Listed(
        number,
        pattern.name,
        pattern.kind,
        pattern.lit,
        tuple(path.relative_to(folder).as_posix() for path in files),
        pattern.colours,
        tuple(pattern.lit_share(mask, areas)),
        parameters,
    )


def _write(view: Pixels, path: Path, pattern: Pattern, codes: Codes, colour: ColourTag) -> None:
    description = (
        "ImageDescription",
        "string",
        f"domesim test pattern {pattern.name}: {pattern.lit}",
    )
    header = Header(attributes=(description,), colour=colour)
    frame = Frame(view, path, colour, codes.bits, floating=codes.floating, header=header)
    write_frame(frame, path, bits=codes.bits)


def _placed(marker: dict[str, float], dome: Dome, size: int) -> dict[str, float]:
    """With the place of its middle in the picture, pixels from the top left corner."""
    away = marker["angle_deg"] / np.degrees(dome.half_angle)
    azimuth = np.radians(marker["azimuth_deg"])
    return {
        **marker,
        "row": float((1 + away * np.sin(azimuth)) * size / 2),
        "col": float((1 + away * np.cos(azimuth)) * size / 2),
    }


def _size(text: str | None, usual: str, *, square: bool) -> tuple[int, int]:
    """Rows and cols."""
    match = re.fullmatch(r"(\d{1,6})" if square else r"(\d{1,6})x(\d{1,6})", text or usual)
    if match is None:
        wanted = "a number of pixels" if square else "width x height"
        raise InputError(f"--size must be {wanted}, such as {usual}, got {text!r}")
    cols, rows = int(match[1]), int(match[1 if square else 2])
    for side in (cols, rows):
        if side % 2 or not _LEAST <= side <= LARGEST_SIDE:
            raise InputError(
                f"--size must be even numbers from {_LEAST} to {LARGEST_SIDE}, got {side}; both "
                f"halves of a picture then have as many pixels"
            )
    return rows, cols


def _codes(name: str, bits: int | None, encoding: str | None) -> tuple[str, Codes, ColourTag]:
    """Suffix, code values and what they mean."""
    suffix = suffix_of(name)
    if suffix in FILMS or suffix in (".jpg", ".j2c", ".mxf", None):
        raise InputError(f"--format {name!r} does not keep codes exactly, or is a video; use png")
    assert suffix is not None
    form = SUFFIXES[suffix]
    chosen = form.depths[0] if bits is None else bits
    if chosen not in form.depths:
        depths = " or ".join(map(str, form.depths))
        raise InputError(f"--bits must be {depths} for {name}, got {chosen}")
    floating = form.is_floating(chosen)
    colour = encoding_named(encoding or ("linear" if floating else "srgb"))
    absolute = colour.transfer in ("dcdm", "st2084")
    mixed = not transfer.named(colour.transfer, white=1.0).elementwise
    if absolute or mixed or colour.primaries in ("XYZ", "ACES AP0", "ACES AP1"):
        raise InputError(
            f"--encoding {encoding} is not the projector's own: code 1 of R, G, B must be its full "
            f"primaries; use p3-dci, p3-d65, bt709, srgb, gamma2.6 or linear"
        )
    return suffix, Codes(chosen, floating, colour.transfer), colour
