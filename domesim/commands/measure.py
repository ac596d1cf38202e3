"""``domesim measure``: from readings and photographs to figures, and to a scene file.

Each subcommand reads one kind of file that a person made, says what it shows and how sure that is,
and refuses what does not fit together: ``domesim.measure`` and ``domesim.measure.dome`` tell how.
"""

from __future__ import annotations

import io
import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast, final

import numpy as np
import typer
from numpy.typing import ArrayLike, NDArray

from domesim.commands.measure_by_eye import by_eye
from domesim.commands.measure_patterns import patterns
from domesim.commands.measure_reflected import reflected
from domesim.commands.options import Json, Overwrite, Quiet, finish
from domesim.errors import InputError
from domesim.frames.colour import chromaticities_of
from domesim.host.console import Console, about, complain
from domesim.host.numbers import decimal
from domesim.host.writing import prepare, write_whole
from domesim.light.transfer import Gamma
from domesim.observation.projector import NAMES
from domesim.observation.stereo import VIEWS
from domesim.scene import DomeScene, StereoScene, load_dome
from domesim.scene.loading import scene_content, scene_of_text

if TYPE_CHECKING:
    from domesim.measure.crosstalk_photographs import CrosstalkMap
    from domesim.measure.dome.fit import Known
    from domesim.readings.colorimetry import Colours
    from domesim.readings.crosstalk import MeasuredCrosstalk
    from domesim.readings.grey_to_grey import MeasuredGreyToGrey
    from domesim.readings.meter import Black
    from domesim.readings.pair import MeasuredPair
    from domesim.readings.response import Display, Response
    from domesim.readings.tables import Table

app = typer.Typer(
    help="Turn a colorimeter's readings, or photographs, into figures and scene files.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.command()(patterns)
app.command()(by_eye)
app.command()(reflected)

WIDTH, DISTANCE, ADAPTATION = 2.5, 3.0, 5.0
"""Width of the screen (m), distance to it (m) and adaptation (cd/m²) in van Baar et al. 2011,
section 4."""
WHITE = 15.4
"""White through glasses, cd/m²: 4.5 fL, at which DCI's addendum on stereoscopic cinema aims."""
COLOURS = "BT.709"
"""Primaries of a display with shutters, unless others are named: most are televisions."""

_GRID = 128  # of a domemaster, for means over the dome
_OF_ROOMS = 4  # width, height, distance and adaptation
_LEAKS_OF = ("stereo.share", "stereo.to_")

ReadingsFile = Annotated[
    Path,
    typer.Argument(
        metavar="READINGS",
        help="A .csv or .toml file with columns channel (R, G, B, W, K), level (0..1), X, Y, Z "
        "(cd/m²) and, for a stereo pair, projector and filter (left, right, none); or a .ti3 file "
        "of ArgyllCMS; or a .toml file that names a table for each pair of these. Crosstalk also: "
        "a .toml file that lists photographs (docs/measuring.md).",
        show_default=False,
    ),
]
Width = Annotated[float | None, typer.Option(help=f"Width of the screen, m; by default {WIDTH:g}.")]
Height = Annotated[
    float | None, typer.Option(help="Height of the screen, m; by default 9/16 of the width.")
]
Distance = Annotated[
    float | None, typer.Option(help=f"Distance of the audience, m; by default {DISTANCE:g}.")
]
Adaptation = Annotated[
    float | None,
    typer.Option(help=f"Luminance that eyes are adapted to, cd/m²; by default {ADAPTATION:g}."),
]
SceneOut = Annotated[
    Path, typer.Option("--out", help="The scene file to write, .toml.", show_default=False)
]
BlackName = Annotated[
    str | None,
    typer.Option(
        "--black",
        help="Whether readings of colours hold the black: included (usual) or subtracted.",
        show_default=False,
    ),
]


@app.command()
def crosstalk(
    readings: ReadingsFile,
    out: SceneOut,
    black: BlackName = None,
    allow_negative: Annotated[
        bool,
        typer.Option(
            "--allow-negative",
            help="Keep crosstalk that is negative beyond its uncertainty, as of ghosts more "
            "saturated than the eye's own picture; within 4 standard errors it is set to 0.",
        ),
    ] = False,
    width: Width = None,
    height: Height = None,
    distance: Distance = None,
    adaptation: Adaptation = None,
    dome: Annotated[
        str | None,
        typer.Option(
            help="The 3D dome in which pictures that fill it were read: its scene, to be written "
            "with crosstalk of direct light.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compute crosstalk of two projectors and eyewear: figures, and a scene file.

    Photographs through the eyewear give a map of it, too, for --transport.
    """
    from domesim.measure.photographs import lists_photographs  # noqa: PLC0415
    from domesim.readings.luminance import luminance_alone  # noqa: PLC0415
    from domesim.readings.meter import EYES, read_readings  # noqa: PLC0415
    from domesim.readings.pair import measured_pair  # noqa: PLC0415

    console = Console(quiet=quiet, json=json)
    _require_toml(out)
    room = _room(width, height, distance, adaptation)
    taken = _black(black)
    if lists_photographs(readings):
        if taken is not None:
            raise InputError(
                f"--black {taken} is for readings; photographs have their own of black"
            )
        if dome is not None:
            raise InputError(f"--dome {dome} is for a meter's readings, got photographs")
        _photographed(
            readings, out, room, console, allow_negative=allow_negative, overwrite=overwrite
        )
        return
    if (table := luminance_alone(readings)) is not None:
        for option, value in (("--black", black), ("--dome", dome)):
            if value is not None:
                raise InputError(f"{option} {value} needs X, Y and Z, got luminance alone")
        _by_luminance(table, readings, out, room, console, overwrite=overwrite)
        return
    read = read_readings(readings, black=taken)
    pair = measured_pair(read, allow_negative=allow_negative)
    prepare(out, inputs=[readings, dome], overwrite=overwrite)
    if dome is not None:
        if len(room.assumed) < _OF_ROOMS:
            raise InputError(
                f"--dome {dome} has a screen and viewers: leave out those of flat ones"
            )
        _in_dome(pair, dome, readings, out, console)
        return
    scene = _SCENE.format(
        name=_quoted(out.stem),
        description=_quoted(f"A stereo system as measured: {readings.name}."),
        readings=_quoted(_from(out, readings)),
        black="" if taken is None else f"black = {_quoted(taken)}\n",
        negative="allow_negative = true\n" if allow_negative else "",
        **room.figures(),
    )
    write_whole(out, scene.encode())
    _say_unread(console, read.unread)
    for line in [*pair.report(), *_colours_of(pair)]:
        console.say(line)
    for eye, matrix in zip(EYES, pair.gamut.matrices, strict=True):
        rows = ", ".join(" ".join(f"{value:.4f}" for value in row) for row in matrix)
        console.say(f"  linear RGB of the {eye} projector of common RGB: rows {rows}")
    _say_where(console, out, room)
    finish(console, {"output": str(out), "assumed": room.assumed, **_of_pair(pair)}, [])


@app.command()
def grey_to_grey(
    readings: Annotated[
        Path,
        typer.Argument(
            metavar="READINGS",
            help="A .csv or .toml file with columns filter (left, right), own_level and "
            "other_level (0..1), and Y (cd/m²): all combinations of the levels, with 0 and 1.",
            show_default=False,
        ),
    ],
    out: SceneOut,
    primaries: Annotated[
        str | None,
        typer.Option(help=f"Primaries of the display: BT.709, P3-D65, ...; by default {COLOURS}."),
    ] = None,
    width: Width = None,
    height: Height = None,
    distance: Distance = None,
    adaptation: Adaptation = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compute crosstalk that depends on both eyes' pictures: figures, and a scene file."""
    from domesim.observation.grey_to_grey import GreyToGrey  # noqa: PLC0415
    from domesim.readings.grey_to_grey import in_light, read_grey_to_grey  # noqa: PLC0415
    from domesim.readings.meter import EYES  # noqa: PLC0415

    console = Console(quiet=quiet, json=json)
    _require_toml(out)
    room = _room(width, height, distance, adaptation)
    colours = _primaries(COLOURS if primaries is None else primaries)
    tables = read_grey_to_grey(readings)
    for eye in EYES:
        if eye not in tables:
            raise InputError(
                f"{readings}: wanted readings through both filters, got none through the {eye} "
                f"one; measure these too"
            )
    left, right = (tables[eye] for eye in EYES)
    prepare(out, inputs=[readings], overwrite=overwrite)
    levels, extra = in_light(left, right)
    with about(readings):
        GreyToGrey(1, 1, levels, extra[:, None])  # refuses what no eye can have seen
    text = _GREY_SCENE.format(
        name=_quoted(out.stem),
        description=_quoted(f"A stereo display as measured, grey to grey: {readings.name}."),
        primaries=_quoted(colours),
        white=(left.white + right.white) / 2,
        black=(left.black + right.black) / 2,
        levels=_numbers(levels),
        to_left=_rows(extra[0]),
        to_right=_rows(extra[1]),
        source=_quoted(f"measured: {readings.name}"),
        colours=f"assumed: {COLOURS}" if primaries is None else "given to domesim measure",
        **room.figures(),
    )
    scene_of_text(text, str(readings), out.parent)
    write_whole(out, text.encode())
    for table in (left, right):
        for line in table.report():
            console.say(line)
        console.say(
            f"  white {decimal(table.white, 4)} cd/m² above black, "
            f"black {decimal(table.black)} cd/m²"
        )
    if primaries is None:
        console.say(f"Assumed, as --primaries was not given: {COLOURS}")
    _say_where(console, out, room)
    assumed = [*(["primaries"] if primaries is None else []), *room.assumed]
    eyes = {table.eye: _of_table(table) for table in (left, right)}
    arrays = {"levels": _plain(levels), "to_left": _plain(extra[0]), "to_right": _plain(extra[1])}
    figures = {"readings": str(readings), "eyes": eyes, "table": arrays}
    finish(console, {"output": str(out), "assumed": assumed, **figures}, [])


@app.command()
def response(
    readings: ReadingsFile,
    black: BlackName = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compute primaries, black and response (code value to light) of one display."""
    from domesim.readings.meter import NO_FILTER, read_readings  # noqa: PLC0415
    from domesim.readings.response import measured_display  # noqa: PLC0415

    console = Console(quiet=quiet, json=json)
    read = read_readings(readings, black=_black(black))
    crossed = [(one, other) for one, other in read.sessions if other not in (one, NO_FILTER)]
    if crossed:
        raise InputError(
            f"{readings}: wanted readings of a display, got those of the {crossed[0][0]} projector "
            f"through the {crossed[0][1]} filter; use domesim measure crosstalk"
        )
    displays = [measured_display(read.session(*session)) for session in read.sessions]
    for display in displays:
        for line in display.report():
            console.say(line)
        for line in _colours(display.primaries).lines():
            console.say(f"  {line}")
    _say_unread(console, read.unread)
    if read.left_out:
        console.say(f"left out: {read.left_out} readings of mixed colours")
    figures = {display.name: _of_display(display) for display in displays}
    facts = {"readings": str(readings), "left_out": read.left_out}
    finish(console, {**facts, "displays": figures}, [])


def _say_unread(console: Console, rows: int) -> None:
    if rows:
        console.say(f"not filled in: {rows} rows")


def _by_luminance(
    table: Table, readings: Path, out: Path, room: _Room, console: Console, *, overwrite: bool
) -> None:
    """Crosstalk of white alone: a scene file."""
    from domesim.readings.luminance import measured_shares  # noqa: PLC0415

    found = measured_shares(table)
    prepare(out, inputs=[readings], overwrite=overwrite)
    left, right = found.shares
    text = _BY_LUMINANCE.format(
        name=_quoted(out.stem),
        description=_quoted(f"A stereo system as measured, white alone: {readings.name}."),
        primaries=_quoted(COLOURS),
        white=(left.white + right.white) / 2,
        black=(left.black + right.black) / 2,
        to_left=_rows(left.share * np.eye(3)),
        to_right=_rows(right.share * np.eye(3)),
        to_left_error=f"{left.error:.4g}",
        to_right_error=f"{right.error:.4g}",
        source=_quoted(f"measured: {readings.name}; white alone, taken to hold for each primary"),
        **room.figures(),
    )
    scene_of_text(text, str(readings), out.parent)
    write_whole(out, text.encode())
    _say_unread(console, found.unread)
    noise = found.noise
    console.say(
        f"noise of a reading {noise.relative:.2%} and {decimal(noise.absolute, 2)} cd/m² "
        f"({noise.origin})"
    )
    for share in found.shares:
        console.say(share.report())
    console.say("one share for all primaries: luminance of white does not tell them apart")
    console.say(f"Assumed, as luminance does not tell them: primaries {COLOURS}")
    _say_where(console, out, room)
    eyes = {
        each.eye: {"system_crosstalk": each.share, "system_crosstalk_error": each.error}
        for each in found.shares
    }
    assumed = ["primaries", *room.assumed]
    finish(
        console,
        {"output": str(out), "readings": str(readings), "assumed": assumed, "eyes": eyes},
        [],
    )


def _in_dome(pair: MeasuredPair, dome: str, readings: Path, out: Path, console: Console) -> None:
    """A dome's scene with crosstalk of direct light, from pictures that filled it."""
    from domesim.observation.dome_pair import direct_crosstalk  # noqa: PLC0415
    from domesim.scene.writing import as_toml  # noqa: PLC0415

    scene = load_dome(dome)
    if scene.stereo is None:
        raise InputError(f"--dome {dome}: wanted a 3D dome, this one has no [stereo]")
    content = scene_content(dome)
    measured = pair.common_matrices
    direct = direct_crosstalk(measured, *scene.reflected_by_views(_GRID))
    content["stereo"].pop("share", None)
    for eye, matrix in zip(VIEWS, direct, strict=True):
        content["stereo"][f"to_{eye}"] = np.round(matrix, 6).tolist()
    told = (
        f"measured: {readings.name}, pictures that filled the dome; its reflected light taken out"
    )
    sources = content.get("sources", {})
    kept = {key: text for key, text in sources.items() if not key.startswith(_LEAKS_OF)}
    content["sources"] = {**kept, "stereo.to_left, stereo.to_right": told}
    written = as_toml(content)
    try:
        scene_of_text(written, str(out), out.parent)
    except InputError as error:
        raise InputError(
            f"{readings}: less the light that {scene.name} reflects, no crosstalk is left that can "
            f"be ({error}). Did the pictures fill the dome? Is its albedo right, and "
            f"kept_by_reflection?"
        ) from None
    write_whole(out, written.encode("utf-8", "surrogateescape"))
    for line in [*pair.report(), *_colours_of(pair)]:
        console.say(line)
    for eye, before, after in zip(VIEWS, measured, direct, strict=True):
        console.say(
            f"to the {eye} eye: {_percent(before)} as read, {_percent(after)} of direct light"
        )
    console.say(f"  -> {out}")
    figures = {"output": str(out), "dome": scene.name, "direct": _plain(direct)}
    finish(console, {**figures, **_of_pair(pair)}, [])


def _percent(matrix: NDArray[np.float64]) -> str:
    """Shares of each primary, by the matrix's diagonal."""
    return " / ".join(f"{value:.2%}" for value in np.diag(matrix))


def _photographed(
    listed: Path,
    out: Path,
    room: _Room,
    console: Console,
    *,
    allow_negative: bool,
    overwrite: bool,
) -> None:
    """Crosstalk of photographs: a scene file, and the map beside it."""
    from domesim.measure.crosstalk_photographs import crosstalk_maps  # noqa: PLC0415
    from domesim.measure.photographs import read_photographs  # noqa: PLC0415
    from domesim.scene.crosstalk_maps import CrosstalkMaps  # noqa: PLC0415
    from domesim.scene.stereo import MAP_CELLS, SWEET_SPOT  # noqa: PLC0415

    stored = out.with_suffix(".npz")
    prepare(out, stored, inputs=[listed], overwrite=overwrite)
    photographs = read_photographs(listed)
    colours = _primaries(photographs.primaries or COLOURS)
    aspect = room.width / room.height
    maps = crosstalk_maps(photographs, MAP_CELLS, aspect, allow_negative=allow_negative)
    text = _PHOTOGRAPHED.format(
        name=_quoted(out.stem),
        description=_quoted(f"A stereo system as photographed: {listed.name}. Map: {stored.name}."),
        primaries=_quoted(colours),
        white=WHITE if photographs.white is None else photographs.white,
        black=photographs.black,
        to_left=_rows(maps[0].matrix),
        to_right=_rows(maps[1].matrix),
        to_left_error=_error(maps[0]),
        to_right_error=_error(maps[1]),
        seat=_quoted(SWEET_SPOT),
        source=_quoted(f"measured: {listed.name}, SHA-256 {photographs.digest[:16]}"),
        colours="assumed" if photographs.primaries is None else "given to domesim measure",
        lights="assumed" if photographs.white is None else "given to domesim measure",
        **room.figures(),
    )
    scene = scene_of_text(text, str(listed), out.parent)
    assert isinstance(scene, StereoScene)
    write_whole(out, text.encode())
    CrosstalkMaps(
        (SWEET_SPOT,),
        np.stack([each.share for each in maps])[None],
        np.stack([each.share_error for each in maps])[None],
        {
            "scene": scene.name,
            "digest": scene.digest,
            "measured": listed.name,
            "photographs": photographs.digest,
        },
        _of_both([each.changes for each in maps])[None],
        _of_both([each.matrix_changes for each in maps]),
    ).save(stored)
    corners = photographs.corners
    console.say(corners.in_words())
    for each in maps:
        for line in each.report():
            console.say(line)
    if photographs.primaries is None:
        console.say(f"Assumed, as projector.primaries was not given: {COLOURS}")
    if photographs.white is None:
        console.say(
            f"Assumed, as projector.white_cd_m2 was not given: {WHITE} cd/m², as 3D cinemas"
        )
    if room.assumed:
        options = ", ".join(f"--{name}" for name in room.assumed)
        console.say(f"Assumed, as {options} were not given: {_RIG}")
    console.say(
        f"  -> {out}, {stored}",
        f"Use them: domesim compensate --left L.####.exr --right R.####.exr --scene {out} "
        f"--transport {stored}",
    )
    eyes = {
        each.eye: {
            "system_crosstalk": each.system,
            "system_crosstalk_error": each.system_error,
            "matrix": _plain(each.matrix),
            "standard_error": _plain(each.matrix_error),
            "share": _plain(each.share),
            "share_standard_error": _plain(each.share_error),
            "notes": list(each.notes),
        }
        for each in maps
    }
    unsaid = {"primaries": photographs.primaries, "white_cd_m2": photographs.white}
    assumed = [*(name for name, said in unsaid.items() if said is None), *room.assumed]
    figures = {
        "photographs": str(listed),
        "corners": {"at": _plain(corners.at), "error": corners.error, "origin": corners.origin},
        "eyes": eyes,
    }
    finish(console, {"output": str(out), "maps": str(stored), "assumed": assumed, **figures}, [])


@app.command()
def dome(
    survey: Annotated[
        Path,
        typer.Argument(
            metavar="SURVEY",
            help="A .toml file that names the theatre's scene file, the camera, the photographs "
            "and their patterns (docs/measuring.md); or the .csv table of a meter, as domesim "
            "measure patterns --with wrote it, with --scene.",
            show_default=False,
        ),
    ],
    out: SceneOut,
    theatre: Annotated[
        str | None,
        typer.Option(
            "--scene",
            metavar="SCENE",
            help="The dome that a meter read: a scene's name or .toml file.",
            show_default=False,
        ),
    ] = None,
    hold: Annotated[
        list[str] | None,
        typer.Option(
            help="What is known from elsewhere: gain, screen, floor or wall, such as floor=0.1, or "
            "floor=0.1,0.02 with its standard error. May be repeated.",
            show_default=False,
        ),
    ] = None,
    residual: Annotated[
        Path | None,
        typer.Option(help="Write a picture (.png) of the residuals.", show_default=False),
    ] = None,
    without_geometry: Annotated[
        bool,
        typer.Option(
            "--without-geometry",
            help="Measure how the room as it is reflects, whatever is in it: a transport (.npz "
            "beside --out) instead of albedos. Of the theatre's file only dome, projector and "
            "viewing are used.",
        ),
    ] = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compute albedos, white and black of a dome from photographs or a meter: a scene file."""
    console = Console(quiet=quiet, json=json)
    _require_toml(out)
    photographs = {
        "--hold": hold, "--residual": residual, "--without-geometry": without_geometry
    }  # fmt: skip
    if _is_meters(survey, theatre, [name for name, value in photographs.items() if value]):
        _dome_by_meter(survey, theatre, out, console, overwrite=overwrite)
        return
    from domesim.measure.dome.file import read_survey  # noqa: PLC0415
    from domesim.measure.dome.report import (  # noqa: PLC0415
        figures_of,
        lines_of,
        measured_scene,
        residual_picture,
    )
    from domesim.measure.dome.run import surveyed  # noqa: PLC0415

    if residual is not None and residual.suffix != ".png":
        raise InputError(f"--residual {residual}: is stored as .png, name it so")
    known = dict(_held(text) for text in hold or ())
    if without_geometry:
        for option, value in (("--hold", hold), ("--residual", residual)):
            if value:
                raise InputError(f"{option} is of albedos; leave it out, or --without-geometry")
        _dome_without_geometry(survey, out, console, overwrite=overwrite)
        return
    task = read_survey(survey, plain=True)
    targets = [out] if residual is None else [out, residual]
    prepare(*targets, inputs=[survey, task.scene.file], overwrite=overwrite)
    with about(survey):
        cells, fit = surveyed(task, known)
    for line in lines_of(task, fit):
        console.say(line)
    if residual is not None:
        if cells is None:
            raise InputError(f"--residual {residual}: readings have no picture; leave it out")
        write_whole(residual, _png(residual_picture(cells, fit)))
        console.say(f"  -> {residual}")
    figures = {"survey": str(survey), **figures_of(fit)}
    if not fit.complete:
        complain(
            f"{survey}: not everything is determined, so no scene was written; photograph more "
            f"patterns and the floor, or hold what is known (--hold floor=0.1)"
        )
        finish(console, {"output": None, **figures}, [str(survey)])
    _say_measured(measured_scene(task, fit, out.stem, survey), out, console)
    finish(console, {"output": str(out), **figures}, [])


def _say_measured(text: str, out: Path, console: Console) -> None:
    """Write a dome's scene, and say what it is."""
    written = scene_of_text(text, str(out), out.parent)
    write_whole(out, text.encode())
    console.say(f"{written.facts()['Measured']}\n  -> {out}")
    console.say(f"Use it: domesim compensate MASTER --scene {out}")


def _is_meters(survey: Path, scene: str | None, of_photographs: list[str]) -> bool:
    """Whether a survey is the table of a meter, with the options that this needs."""
    if survey.suffix.lower() != ".csv":
        if scene is not None:
            raise InputError(
                f"--scene {scene} is for a meter's table (.csv): {survey} names its theatre itself"
            )
        return False
    if of_photographs:
        raise InputError(f"{of_photographs[0]} is for photographs; leave it out with {survey}")
    if scene is None:
        raise InputError(
            f"{survey}: a meter's table needs the dome that it is of: --scene THEATRE.toml; "
            "domesim scene new writes one"
        )
    return True


def _dome_by_meter(
    table: Path, described: str | None, out: Path, console: Console, *, overwrite: bool
) -> None:
    from domesim.measure.dome.meter_report import (  # noqa: PLC0415
        figures_of,
        lines_of,
        measured_scene,
    )
    from domesim.measure.dome.meter_table import read_meter_task  # noqa: PLC0415
    from domesim.measure.dome.meters import metered  # noqa: PLC0415

    assert described is not None
    scene = load_dome(described)
    prepare(out, inputs=[table, described], overwrite=overwrite)
    task = read_meter_task(table, scene, scene_content(described))
    with about(table):
        found = metered(task)
    for line in lines_of(task, found):
        console.say(line)
    _say_measured(measured_scene(task, found, out.stem), out, console)
    finish(console, {"output": str(out), "readings": str(table), **figures_of(found)}, [])


def _dome_without_geometry(survey: Path, out: Path, console: Console, *, overwrite: bool) -> None:
    from domesim.measure.dome.file import read_survey  # noqa: PLC0415
    from domesim.measure.dome.without_geometry import (  # noqa: PLC0415
        figures_of,
        lines_of,
        measured_scene,
        stored,
        surveyed_alone,
    )

    task = read_survey(survey)
    transport = out.with_suffix(".npz")
    prepare(out, transport, inputs=[survey, task.scene.file], overwrite=overwrite)
    with about(survey):
        fit = surveyed_alone(task)
    for line in lines_of(task, fit):
        console.say(line)
    text = measured_scene(task, fit, out.stem, survey)
    scene = scene_of_text(text, str(out), out.parent)
    assert isinstance(scene, DomeScene)
    stored(fit, scene, survey).save(transport)
    write_whole(out, text.encode())
    console.say(
        f"  -> {out}, {transport}",
        f"Use them: domesim compensate MASTER --scene {out} --transport {transport}",
    )
    figures = {"survey": str(survey), **figures_of(fit)}
    finish(console, {"output": str(out), "transport": str(transport), **figures}, [])


def _held(text: str) -> tuple[str, Known]:
    """Name and value of ``floor=0.1,0.02``."""
    from domesim.measure.dome.fit import Known  # noqa: PLC0415

    match = re.fullmatch(r"(gain|screen|floor|wall)=([0-9.eE+-]+)(?:,([0-9.eE+-]+))?", text)
    try:
        name, value, error = match.groups(default="0") if match else ("", "", "")
        number, spread = float(value), float(error)
        if not (number > 0 and spread >= 0 and np.isfinite([number, spread]).all()):
            raise ValueError
    except ValueError:
        raise InputError(
            f"--hold {text!r}: wanted gain, screen, floor or wall, =, a value above 0 and perhaps "
            f"its standard error, such as floor=0.1,0.02"
        ) from None
    return name, Known((number,) * 3, (spread,) * 3)


def _png(pixels: NDArray[np.uint8]) -> bytes:
    from matplotlib.image import imsave  # noqa: PLC0415

    buffer = io.BytesIO()
    imsave(buffer, pixels, format="png")
    return buffer.getvalue()


# The scene file.

_RIG = "what van Baar et al. 2011 have"


def _scene_text(middle: str, sources: str) -> str:
    """The template of a scene file: its projector and crosstalk, and where they are from."""
    return f"""name = {{name}}
description = {{description}}

[screen]
width_m = {{width!r}}
height_m = {{height!r}}

[projector]
{middle}[viewing]
distance_m = {{distance!r}}
adaptation_cd_m2 = {{adaptation!r}}

[sources]
"screen" = "{{screen}}"
{sources}"viewing" = "{{viewing}}"
"""


_SCENE = _scene_text(
    """\
primaries = "measured"

[crosstalk]
readings = {readings}
{black}{negative}
""",
    """\
"projector, crosstalk" = "measured, see the readings"
""",
)


_GREY_SCENE = _scene_text(
    """\
primaries = {primaries}
white_cd_m2 = {white:.6g}
black_cd_m2 = {black:.6g}

[crosstalk.table]
levels = {levels}
to_left = {to_left}
to_right = {to_right}

""",
    """\
"projector.primaries" = "{colours}"
"projector.white_cd_m2, projector.black_cd_m2, crosstalk" = {source}
""",
)


_LEAKS = """\
primaries = {primaries}
white_cd_m2 = {white!r}
black_cd_m2 = {black!r}

[crosstalk]
to_left = {to_left}
to_right = {to_right}
to_left_error = {to_left_error}
to_right_error = {to_right_error}

"""

_BY_LUMINANCE = _scene_text(
    _LEAKS,
    f"""\
"projector.primaries" = "assumed: {COLOURS}"
"projector.white_cd_m2, projector.black_cd_m2, crosstalk" = {{source}}
""",
)

_PHOTOGRAPHED = _scene_text(
    _LEAKS
    + """\
[[seats]]
name = {seat}

""",
    """\
"projector.primaries" = "{colours}"
"projector.white_cd_m2, projector.black_cd_m2" = "{lights}"
"crosstalk" = {source}
""",
)


def _error(map_: CrosstalkMap) -> str:
    """Standard errors of a matrix for the scene file; one if primaries were not measured."""
    if not map_.of_primaries:
        return f"{map_.system_error:.4g}"
    return _rows(map_.matrix_error)


def _of_both(changes: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """(change, view, ...) of each view's own (change, ...)."""
    count = sum(len(each) for each in changes)
    result = np.zeros((count, 2, *changes[0].shape[1:]))
    start = 0
    for view, each in enumerate(changes):
        result[start : start + len(each), view] = each
        start += len(each)
    return result


def _numbers(values: ArrayLike) -> str:
    """A TOML array, fine enough for the slopes between levels that are close."""
    return f"[{', '.join(f'{value + 0.0:.10g}' for value in np.asarray(values))}]"


def _rows(values: NDArray[np.float64]) -> str:
    return "[\n" + "".join(f"    {_numbers(row)},\n" for row in values) + "]"


@final
@dataclass(frozen=True)
class _Room:
    """Screen and audience, m and cd/m², and which of them nobody gave."""

    width: float
    height: float
    distance: float
    adaptation: float
    assumed: list[str]

    def figures(self) -> dict[str, Any]:
        """What the scene file's text takes."""
        return {
            "width": self.width,
            "height": self.height,
            "distance": self.distance,
            "adaptation": self.adaptation,
            "screen": _origin(self.assumed, "width", "height"),
            "viewing": _origin(self.assumed, "distance", "adaptation"),
        }


def _room(
    width: float | None, height: float | None, distance: float | None, adaptation: float | None
) -> _Room:
    stated = {"width": width, "height": height, "distance": distance, "adaptation": adaptation}
    wide = _length("--width", WIDTH if width is None else width)
    high = _length("--height", round(wide * 9 / 16, 9) if height is None else height)
    away = _length("--distance", DISTANCE if distance is None else distance)
    adapted = ADAPTATION if adaptation is None else adaptation
    if not 1e-6 <= adapted <= 1e6:
        raise InputError(f"--adaptation must be 0.000001 to 1000000 cd/m², got {adapted:g}")
    return _Room(
        wide, high, away, adapted, [name for name, value in stated.items() if value is None]
    )


def _require_toml(out: Path) -> None:
    if out.suffix != ".toml":
        raise InputError(f"--out {out}: a scene is stored as .toml, name it so")


def _say_where(console: Console, out: Path, room: _Room) -> None:
    """Say what is assumed, and what the scene file is for."""
    if room.assumed:
        options = ", ".join(f"--{name}" for name in room.assumed)
        console.say(f"Assumed, as {options} were not given: {_RIG}")
    console.say(
        f"  -> {out}",
        f"Use it: domesim compensate --left L.####.exr --right R.####.exr --scene {out}",
    )


def _origin(assumed: list[str], *names: str) -> str:
    """Where these figures are from, for the scene file."""
    missing = [name for name in names if name in assumed]
    if not missing:
        return "given to domesim measure"
    return f"assumed, {_RIG}, section 4: {', '.join(missing)}"


def _length(option: str, value: float) -> float:
    if not 0 < value <= 1000:
        raise InputError(f"{option} must be above 0 and at most 1000 m, got {value:g}")
    return value


def _primaries(name: str) -> str:
    if name == "XYZ" or chromaticities_of(name) is None:
        raise InputError(f"--primaries {name!r} are not known; use {NAMES}")
    return name


def _black(name: str | None) -> Black | None:
    if name not in (None, "included", "subtracted"):
        raise InputError(f"--black {name!r} is not known; use included or subtracted")
    return cast("Literal['included', 'subtracted'] | None", name)


def _from(scene: Path, readings: Path) -> str:
    """Where the readings are, seen from the scene's folder."""
    return os.path.relpath(readings.resolve(), scene.parent.resolve())


def _quoted(text: str) -> str:
    """A TOML string."""
    try:
        text.encode()
    except UnicodeEncodeError:
        shown = text.encode(errors="backslashreplace").decode()
        raise InputError(
            f"{shown}: wanted a path in UTF-8, got other bytes. Rename the file or its folder."
        ) from None
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007F")


def _colours(primaries: NDArray[np.float64]) -> Colours:
    from domesim.readings.colorimetry import Colours  # noqa: PLC0415

    return Colours(primaries)


def _colours_of(pair: MeasuredPair) -> list[str]:
    """Lines about the common gamut, and how far the eyes' own whites are apart."""
    from domesim.readings.colorimetry import difference  # noqa: PLC0415

    two_thousand, itp = difference(*(display.white for display in pair.displays))
    return [
        *(f"  {line}" for line in _colours(pair.gamut.primaries).lines()),
        f"  left's own white from right's: Delta E 2000 {two_thousand:.1f}, ITP {itp:.1f}",
    ]


# Figures for programs.


def _of_pair(pair: MeasuredPair) -> dict[str, Any]:
    gamut = pair.gamut
    eyes = zip(pair.crosstalk, pair.displays, pair.responses, strict=True)
    return {
        "readings": pair.source,
        "noise": pair.noise,
        "eyes": {
            leak.eye: {
                **_of_crosstalk(leak),
                "projector": _of_display(display),
                "response": _of_response(response),
            }
            for leak, display, response in eyes
        },
        "common_gamut": {
            "primaries_xyz": _plain(gamut.primaries),
            "chromaticities_xy": _plain(gamut.chromaticities),
            "white_cd_m2": float(gamut.white[1]),
            **_colours(gamut.primaries).figures(),
            "matrices": _plain(gamut.matrices),
            "light_lost": _plain(gamut.lost),
            "crosstalk": _plain(pair.common_matrices),
        },
    }


def _of_table(table: MeasuredGreyToGrey) -> dict[str, Any]:
    return {
        "system_crosstalk": table.system,
        "own_levels": _plain(table.own_levels),
        "other_levels": _plain(table.other_levels),
        "light": _plain(table.light),
        "extra": _plain(table.extra),
        "white_cd_m2": table.white,
        "black_cd_m2": table.black,
    }


def _of_crosstalk(leak: MeasuredCrosstalk) -> dict[str, Any]:
    return {
        "matrix": _plain(leak.matrix),
        "measured": _plain(leak.measured),
        "standard_error": _plain(leak.error),
        "system_crosstalk": leak.system,
        "system_crosstalk_error": leak.system_error,
        "extinction": leak.extinction if np.isfinite(leak.extinction) else None,
        "viewer_crosstalk_white_on_half": leak.viewer((0.5, 0.5, 0.5), (1, 1, 1)),
        "black_xyz": None if leak.black is None else _plain(leak.black),
        "notes": list(leak.notes),
    }


def _of_display(display: Display) -> dict[str, Any]:
    return {
        "primaries_xyz": _plain(display.primaries),
        "chromaticities_xy": _plain(display.chromaticities),
        "white_cd_m2": float(display.white[1]),
        **_colours(display.primaries).figures(),
        "black_xyz": None if display.black is None else _plain(display.black),
        "additivity": _plain_or_none(display.additivity),
        "additivity_error": _plain_or_none(display.additivity_error),
        "chromaticity_drift": _plain(display.drift),
        "response": _of_response(display.response),
        "scene_key": display.scene_key,
        "notes": list(display.notes),
    }


def _of_response(response: Response | None) -> dict[str, Any] | None:
    if response is None:
        return None
    transfer = response.transfer
    curve: dict[str, Any] = (
        {"gamma": transfer.exponent}
        if isinstance(transfer, Gamma)
        else {
            "codes": _plain(getattr(transfer, "codes", ())),
            "light": _plain(getattr(transfer, "light", ())),
        }
    )
    return {
        **curve,
        "gammas": _plain(response.exponents),
        "gamma_errors": _plain(response.errors),
        "gamma_rms": _plain(response.rms),
        "gamma_misfit_lightness": _plain(response.misfit),
    }


def _plain(values: ArrayLike) -> Any:
    return np.asarray(values, np.float64).tolist()


def _plain_or_none(values: ArrayLike | None) -> Any:
    return None if values is None else _plain(values)
