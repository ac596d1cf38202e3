"""The ``domesim`` command, and those of its subcommands that only need to know what light does.

Subcommands are found through the entry-point group ``domesim.commands``, so that the packages above
add theirs without being imported here. Bad input is one line on standard error and exit code 2.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any

import typer

from domesim.console import Console, about, complain, each_frame
from domesim.errors import InputError
from domesim.frames import Frame
from domesim.frames.formats import SUFFIXES
from domesim.observation.transport import load_transport
from domesim.scene import Scene, load_scene
from domesim.screening import decoded, encoded, mean_luminance
from domesim.sequences import find_frames

BAD_INPUT = 2
INTERRUPTED = 130

Master = Annotated[
    str,
    typer.Argument(
        help="The domemaster: an EXR, PNG, TIFF, DPX or JPEG file, or a numbered sequence such as "
        "'show.####.png'.",
        show_default=False,
    ),
]
SceneName = Annotated[
    str,
    typer.Option(
        "--scene",
        help="The theatre: dome_hemisphere, dome_imax, dome_planetarium, dome_led, dome_dark, or "
        "the path of a .toml file.",
        show_default=False,
    ),
]
TransportFile = Annotated[
    Path | None,
    typer.Option(
        "--transport",
        help="The theatre's whole light transport, a .npz file of 'domesim tabulate'; without it "
        "reflections are those of the bare screen.",
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
    master: Master,
    scene: SceneName,
    out: OutFolder,
    transport: TransportFile = None,
    frames: Frames = None,
    file_format: Format = None,
    bits: Bits = None,
    repair: Repair = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Simulate what the audience sees of a frame or sequence, with all reflected light."""
    console = Console(quiet=quiet, json=json)
    theatre = theatre_of(scene, transport, console)

    def work(frame: Frame, write: Callable[[Frame], Frame]) -> tuple[dict[str, Any], str]:
        light = decoded(frame, theatre)
        observation = theatre.observation(*light.shape[1:3])
        seen = observation.observe(light)
        screen = observation.screen
        result, clipped = encoded(frame, seen, theatre, screen)
        direct = observation.direct(light)
        pollution = mean_luminance(seen - direct, theatre)
        mean = mean_luminance(direct, theatre)
        line = f"mean {mean:.3g} cd/m² direct, {pollution:.3g} cd/m² reflected and stray light"
        if clipped:
            line += (
                f"; {clipped:.1%} of the screen is brighter than the file's format can hold and "
                f"clipped (a 32 bit EXR is not)"
            )
        figures = {
            "direct_cd_m2": mean,
            "pollution_cd_m2": pollution,
            "clipped_share": clipped,
        }
        write(result)
        return figures, line

    done, failed = each_frame(
        find_frames(master, frames),
        out,
        work,
        console,
        what="observing",
        repair=repair,
        suffix=suffix_of(file_format),
        bits=bits,
    )
    facts = {"scene": theatre.name, "approximation": theatre.approximation, "frames": done}
    finish(console, facts, failed)


def theatre_of(scene: str, transport: Path | None, console: Console) -> Scene:
    """The scene of a command, with a stored transport if one is given; says what is approximate.

    Raises
    ------
    InputError
        If either cannot be read, or they do not belong together.
    """
    theatre = load_scene(scene)
    if transport is not None:
        with about(transport):
            theatre = theatre.with_transport(load_transport(transport))
    if theatre.approximation is not None:
        console.say(f"{theatre.name}: {theatre.approximation}")
    return theatre


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
        app.command(entry.name)(entry.load())
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
