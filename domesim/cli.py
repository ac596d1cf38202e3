"""The ``domesim`` command, and those of its subcommands that only need to know what light does.

Subcommands are found through the entry-point group ``domesim.commands``, so that the packages above
add theirs without being imported here. Bad input is one line on standard error and exit code 2.
"""

from __future__ import annotations

import io
import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any

import typer

from domesim.console import Console, Done, Work, Write, about, complain, each_frame
from domesim.errors import InputError
from domesim.frames import Master
from domesim.frames.formats import SUFFIXES
from domesim.light import Light
from domesim.observation.transport import load_transport
from domesim.scene import DomeScene, Scene, StereoScene, load_scene
from domesim.scene.crosstalk_maps import load_maps
from domesim.screening import decoded, encoded, mean_luminance
from domesim.shows import PACKINGS, find_show

BAD_INPUT = 2
INTERRUPTED = 130

MasterName = Annotated[
    str | None,
    typer.Argument(
        metavar="MASTER",
        help="The domemaster, or a file of two views: an EXR, PNG, TIFF, DPX or JPEG file, or a "
        "numbered sequence such as 'show.####.png'.",
        show_default=False,
    ),
]
Left = Annotated[
    str | None,
    typer.Option(
        "--left",
        help="Stereo: the left eye's file or numbered sequence, instead of a master.",
        show_default=False,
    ),
]
Right = Annotated[
    str | None, typer.Option("--right", help="Stereo: the right eye's.", show_default=False)
]
PackingName = Annotated[
    str | None,
    typer.Option(
        "--packing",
        help=f"Stereo, in one file: {', '.join(PACKINGS)}. EXR files say so themselves.",
        show_default=False,
    ),
]
Identical = Annotated[
    bool, typer.Option("--allow-identical", help="Stereo: take left and right that are the same.")
]
SeatName = Annotated[
    str | None,
    typer.Option(
        "--seat",
        help="Stereo: the seat to look from; 'all' for the weighted mean of all seats, 'worst' for "
        "the one that is worst off.",
        show_default=False,
    ),
]
SceneName = Annotated[
    str,
    typer.Option(
        "--scene",
        help="The theatre: dome_hemisphere, dome_imax, dome_planetarium, dome_led, dome_dark; the "
        "stereo system: stereo_cinema_silver, stereo_polarised_paper, stereo_shutter, "
        "stereo_spectral; or the path of a .toml file.",
        show_default=False,
    ),
]
TransportFile = Annotated[
    Path | None,
    typer.Option(
        "--transport",
        help="The theatre's whole light transport, or the stereo system's crosstalk maps: a .npz "
        "file of 'domesim tabulate'. Without it reflections are those of the bare screen, and "
        "crosstalk is estimated.",
    ),
]
OutFolder = Annotated[
    Path, typer.Option("--out", help="Folder for the results.", show_default=False)
]
Frames = Annotated[str | None, typer.Option(help="Frames of a sequence to do, such as '1-100x10'.")]
Repair = Annotated[
    bool,
    typer.Option(help="Replace NaN and negative samples by black, infinite ones by the largest."),
]
Format = Annotated[
    str | None,
    typer.Option(
        "--format",
        help="Write exr, png, tif, dpx or jpg instead of the master's format.",
        show_default=False,
    ),
]
Bits = Annotated[
    int | None,
    typer.Option(
        help="Bits a sample instead of the master's, as the format allows.", show_default=False
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]
Json = Annotated[
    bool, typer.Option("--json", help="Print figures to standard output as one JSON object.")
]


def observe(
    scene: SceneName,
    out: OutFolder,
    master: MasterName = None,
    left: Left = None,
    right: Right = None,
    packing: PackingName = None,
    seat: SeatName = None,
    transport: TransportFile = None,
    frames: Frames = None,
    file_format: Format = None,
    bits: Bits = None,
    repair: Repair = False,
    allow_identical: Identical = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Simulate what the audience sees of a frame or sequence: reflected light, or crosstalk."""
    console = Console(quiet=quiet, json=json)
    theatre = scene_of(scene, transport, console, seat)
    if isinstance(theatre, StereoScene) and len(theatre.chosen) > 1:
        raise InputError(
            f"--seat {seat}: what is seen is seen from one seat; name one of "
            f"{', '.join(theatre.chosen)}"
        )

    def prepare(source: Master) -> tuple[Master, Light]:
        return source, decoded(source, theatre)

    def solve(prepared: tuple[Master, Light]) -> tuple[Master, dict[str, Any]]:
        source, light = prepared
        observation = theatre.observation(*light.shape[1:3])
        seen = observation.observe(light)
        result, clipped = encoded(source, seen, theatre, theatre.screen(*light.shape[1:3]))
        direct = observation.direct(light)
        figures = {
            "direct_cd_m2": mean_luminance(direct, theatre),
            "pollution_cd_m2": mean_luminance(seen - direct, theatre),
            "clipped_share": clipped,
        }
        return result, figures

    def end(solved: tuple[Master, dict[str, Any]], write: Write) -> tuple[dict[str, Any], str]:
        result, figures = solved
        other = "reflected" if theatre.views == 1 else "the other eye's"
        line = (
            f"mean {figures['direct_cd_m2']:.3g} cd/m² direct, "
            f"{figures['pollution_cd_m2']:.3g} cd/m² {other} and stray light"
        )
        if clipped := figures["clipped_share"]:
            line += (
                f"; {clipped:.1%} of the screen is brighter than the file's format can hold and "
                f"clipped (a 32 bit EXR is not)"
            )
        write(result)
        return figures, line

    show = find_show(
        master, left, right, packing=packing, frames=frames, allow_identical=allow_identical
    )
    done = each_frame(
        show,
        out,
        Work(prepare, solve, end),
        console,
        what="observing",
        repair=repair,
        suffix=suffix_of(file_format),
        bits=bits,
    )
    finish(console, {**about_scene(theatre), **told(done)}, done.failed)


def about_scene(scene: Scene) -> dict[str, Any]:
    """What a command's figures say of its scene."""
    facts: dict[str, Any] = {"scene": scene.name, "approximation": scene.approximation}
    if isinstance(scene, StereoScene):
        facts["seats"] = list(scene.chosen)
    return facts


def scene_of(name: str, transport: Path | None, console: Console, seat: str | None = None) -> Scene:
    """The scene of a command, with stored light transport and seats if given.

    What is approximate is said.

    Raises
    ------
    InputError
        If a file cannot be read, they do not belong together, or there is no such seat.
    """
    scene = load_scene(name)
    if transport is not None:
        with about(transport):
            if isinstance(scene, StereoScene):
                scene = scene.with_maps(load_maps(transport))
            elif isinstance(scene, DomeScene):
                scene = scene.with_transport(load_transport(transport))
    if isinstance(scene, StereoScene):
        if seat in ("all", "worst"):
            scene = scene.seen_from(*scene.seats)
        elif seat is not None:
            scene = scene.seen_from(seat)
        console.say(f"{scene.name}: crosstalk {scene.facts()['Crosstalk']}")
    elif seat is not None:
        raise InputError(f"--seat {seat}: {scene.name} is a dome theatre; leave --seat out")
    if scene.approximation is not None:
        console.say(f"{scene.name}: {scene.approximation}")
    return scene


def suffix_of(file_format: str | None) -> str | None:
    """The suffix of files in that format, for `each_frame`.

    Raises
    ------
    InputError
        If frames cannot be written in it.
    """
    if file_format is None:
        return None
    suffix = f".{file_format.lower().removeprefix('.')}"
    if suffix not in SUFFIXES:
        raise InputError(f"--format {file_format!r} is not known; use exr, png, tif, dpx or jpg")
    return suffix


def told(done: Done) -> dict[str, Any]:
    """What a command's figures say of its frames."""
    seconds = {f"seconds_{step}": value for step, value in done.seconds.items()}
    return {"frames": done.frames, **seconds}


def finish(console: Console, figures: dict[str, Any], failed: list[str]) -> None:
    """Print the figures, and exit with 2 if frames failed."""
    console.figures({**figures, "failed": failed})
    if failed:
        raise typer.Exit(BAD_INPUT)


def build() -> typer.Typer:
    """The command with all subcommands that the installed packages offer."""
    app = typer.Typer(
        name="domesim",
        help="Simulate and compensate light pollution in dome theatres and 3D cinema.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    for entry in sorted(entry_points(group="domesim.commands"), key=lambda entry: entry.name):
        found = entry.load()
        if isinstance(found, typer.Typer):  # a command with subcommands of its own
            app.add_typer(found, name=entry.name)
        else:
            app.command(entry.name)(found)
    # With one command alone typer would drop its name.
    app.callback()(lambda: None)
    return app


def run() -> None:
    """Run the command; the process's exit code says whether all went well."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A name that the terminal cannot show is no reason to stop.
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        build()()
    except InputError as error:
        complain(error)
        sys.exit(BAD_INPUT)
    except MemoryError:
        complain("not enough memory for frames of this size")
        sys.exit(BAD_INPUT)
    except (KeyboardInterrupt, SystemExit) as end:
        # typer turns Ctrl-C into an exit, and says nothing.
        if isinstance(end, SystemExit) and end.code != INTERRUPTED:
            raise
        complain("interrupted; what was written is complete")
        sys.exit(INTERRUPTED)
