"""What subcommands share, options above all; and the one that needs only what light does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from domesim.commands import BAD_INPUT
from domesim.errors import InputError
from domesim.frames.encodings import ENCODINGS, encoding_named
from domesim.frames.film import FILMS
from domesim.frames.formats import SUFFIXES
from domesim.host.console import Console
from domesim.inspection.coverage import require_covered
from domesim.scene import DomeScene, Scene, StereoScene, scene_names
from domesim.scene.choice import SceneChoice
from domesim.shows.cinema import SUFFIX as CINEMA
from domesim.shows.estimate import estimate
from domesim.shows.observing import Observing
from domesim.shows.run import FRAME_TIMEOUT, Done, Running, each_frame
from domesim.shows.show import PACKINGS, Show, find_show
from domesim.shows.work import Recipe, Writing

MasterName = Annotated[
    str | None,
    typer.Argument(
        metavar="MASTER",
        help="The domemaster, or a file of two views: an EXR, PNG, TIFF, DPX, JPEG or JPEG 2000 "
        "file, a numbered sequence such as 'show.####.png', or a video.",
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
EncodingName = Annotated[
    str | None,
    typer.Option(
        "--encoding",
        help="What the master's code values are, whatever its files say: "
        f"{', '.join(ENCODINGS)}; or transfer and primaries, such as st2084:p3-d65; or a space of "
        "OpenColorIO's configuration in $OCIO, such as ocio:ACEScct.",
        show_default=False,
    ),
]
OutputEncoding = Annotated[
    str | None,
    typer.Option(
        "--output-encoding",
        help="What the results' code values are, instead of the master's encoding: names as for "
        "--encoding, such as dcdm for X'Y'Z' (TIFFs then have 12 bits in 16).",
        show_default=False,
    ),
]
SeatName = Annotated[
    str | None,
    typer.Option(
        "--seat",
        help="The seat to look from. Stereo: 'all' for the weighted mean of all seats, 'worst' for "
        "the one that is worst off. Dome: figures and predictions are for that seat's pixels per "
        "degree.",
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
        autocompletion=scene_names,
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
Checksums = Annotated[
    Path | None,
    typer.Option(
        "--checksums",
        metavar="FILE",
        help="Refuse masters that have not the SHA-256 that FILE lists, as sha256sum writes it.",
        show_default=False,
    ),
]
Repair = Annotated[
    bool,
    typer.Option(help="Replace NaN and negative samples by black, infinite ones by the largest."),
]
Format = Annotated[
    str | None,
    typer.Option(
        "--format",
        help="Write exr, png, tif, dpx, jpg, jp2 or j2k instead of the master's format; or, of a "
        "sequence, besides its frames a video: mov (ProRes 4444) or mkv (FFV1, lossless).",
        show_default=False,
    ),
]
Bits = Annotated[
    int | None,
    typer.Option(
        "--output-bits",
        "--bits",
        help="Bits a sample instead of the master's, as the format allows.",
        show_default=False,
    ),
]
DitherName = Annotated[
    str,
    typer.Option(
        "--dither",
        help="How light between two codes of an integer format is rounded: tpdf, with noise that "
        "keeps gradients free of bands; or none, to the nearest code.",
    ),
]
TPDF = "tpdf"
Fps = Annotated[
    float | None,
    typer.Option(
        help="Videos: frames a second, instead of the master's, or 24 where it says nothing.",
        show_default=False,
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        help="Sequences: processes that do the frames, on this machine; 0 for none but the "
        "command's own. As many as cores and memory allow by default.",
        show_default=False,
    ),
]
Threads = Annotated[
    int | None,
    typer.Option(help="Of each worker; they share the cores by default.", show_default=False),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Sequences: let the workers of this Dask scheduler do the frames, such as "
        "tcp://node1:8786. All must see the files under the same names.",
        show_default=False,
    ),
]
Anew = Annotated[
    bool, typer.Option("--anew", help="Sequences: do frames that are done already once more.")
]
Mix = Annotated[
    bool,
    typer.Option("--mix", help="Sequences: keep frames that were done with other settings."),
]
Pages = Annotated[
    int,
    typer.Option(
        help="Sequences: for how many of the worst frames to write a page that compares methods.",
        min=0,
    ),
]
DryRun = Annotated[
    bool,
    typer.Option(
        "--dry-run",
        help="Do a few frames, throw them away, and tell what time, memory and disk all will take.",
    ),
]
FrameTimeout = Annotated[
    float,
    typer.Option(
        help="Sequences: seconds after which a worker that is not done with a frame is ended, and "
        "the frame tried by another, three times in all; 0 for never.",
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
    encoding: EncodingName = None,
    seat: SeatName = None,
    transport: TransportFile = None,
    frames: Frames = None,
    file_format: Format = None,
    output_encoding: OutputEncoding = None,
    bits: Bits = None,
    dither: DitherName = TPDF,
    fps: Fps = None,
    checksums: Checksums = None,
    repair: Repair = False,
    allow_identical: Identical = False,
    workers: Workers = None,
    threads: Threads = None,
    scheduler: Scheduler = None,
    anew: Anew = False,
    mix: Mix = False,
    frame_timeout: FrameTimeout = FRAME_TIMEOUT,
    dry_run: DryRun = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Simulate what the audience sees of a frame or sequence: reflected light, or crosstalk."""
    console = Console(quiet=quiet, json=json)
    choice = SceneChoice(scene, transport, seat)
    theatre = scene_of(choice, console)
    require_one_seat(theatre, seat, "what is seen is seen from one seat")
    if theatre.viewing.seat is not None:
        raise InputError(f"--seat {seat}: a dome shows all seats the same light; leave --seat out")
    show = find_show(
        master,
        left,
        right,
        packing=packing,
        frames=frames,
        allow_identical=allow_identical,
        encoding=encoding,
    ).listed_in(checksums)
    do_show(
        show,
        out,
        Observing(choice.settled(theatre)),
        console,
        what="observing",
        writing=writing_of(file_format, bits, dither, output_encoding, repair=repair, fps=fps),
        running=Running(workers, threads, scheduler, anew, mix, frame_timeout=frame_timeout),
        facts=about_scene(theatre),
        dry_run=dry_run,
    )


def do_show(
    show: Show,
    out: Path,
    recipe: Recipe,
    console: Console,
    *,
    what: str,
    writing: Writing,
    running: Running,
    facts: dict[str, Any],
    summary: Callable[[Done], dict[str, Any]] | None = None,
    dry_run: bool = False,
) -> None:
    """Do each frame of a command's show, or only estimate it, print the figures, and end.

    Parameters
    ----------
    show, out, recipe, console, what, writing, running
        As for `each_frame`.
    facts
        What the command's figures say besides.
    summary
        Called with what became of all frames; what the figures say of them together.
    dry_run
        Only estimate what it will take.
    """
    if dry_run:
        console.figures(
            {**facts, "estimate": estimate(show, out, recipe, console, writing, running)}
        )
        return
    done = each_frame(show, out, recipe, console, what=what, writing=writing, running=running)
    found = {} if summary is None else summary(done)
    finish(console, {**facts, **found, **_told(done)}, done.failed)


def about_scene(scene: Scene, seat: str | None = None) -> dict[str, Any]:
    """What a command's figures say of its scene, and of the seat that was asked for."""
    facts: dict[str, Any] = {"scene": scene.name, "approximation": scene.approximation}
    if isinstance(scene, StereoScene):
        facts["seats"] = list(scene.chosen)
    elif seat is not None:
        facts["seats"] = [seat]
    return facts


def scene_of(choice: SceneChoice, console: Console) -> Scene:
    """The scene of a command; what is approximate is said.

    Raises
    ------
    InputError
        As for `SceneChoice.load`, and if projectors leave a part of a dome's screen dark.
    """
    scene = choice.load()
    if isinstance(scene, DomeScene):
        require_covered(scene, choice.name)
    if isinstance(scene, StereoScene):
        console.say(f"{scene.name}: crosstalk {scene.facts()['Crosstalk']}")
    if scene.approximation is not None:
        console.say(f"{scene.name}: {scene.approximation}")
    return scene


def require_one_seat(scene: Scene, seat: str | None, why: str) -> None:
    """See that a scene is looked at from one seat.

    Raises
    ------
    InputError
        If it is looked at from several, by ``--seat SEAT``; it says why not.
    """
    if isinstance(scene, StereoScene) and scene.several_seats:
        raise InputError(f"--seat {seat}: {why}; name one of {', '.join(scene.chosen)}")


def suffix_of(file_format: str | None) -> str | None:
    """The suffix of files in that format, for `Writing`.

    Raises
    ------
    InputError
        If frames cannot be written in it.
    """
    if file_format is None:
        return None
    suffix = f".{file_format.lower().removeprefix('.')}"
    if suffix not in (*SUFFIXES, *FILMS, CINEMA):
        raise InputError(
            f"--format {file_format!r} is not known; use exr, png, tif, dpx, jpg, jp2, j2k, j2c; "
            f"mov or mkv; or mxf"
        )
    return suffix


def writing_of(
    file_format: str | None,
    bits: int | None,
    dither: str,
    output: str | None,
    *,
    repair: bool,
    fps: float | None,
) -> Writing:
    """How a command's results are written.

    Raises
    ------
    InputError
        If an option has no such value.
    """
    colour = None if output is None else encoding_named(output, "--output-encoding")
    return Writing(suffix_of(file_format), bits, dithered(dither), repair, fps, colour)


def dithered(name: str) -> bool:
    """Whether ``--dither`` asks for it, for `Writing`.

    Raises
    ------
    InputError
        If there is no such way.
    """
    if name not in (TPDF, "none"):
        raise InputError(f"--dither {name!r} is not known; use {TPDF} or none")
    return name == TPDF


def _told(done: Done) -> dict[str, Any]:
    """What a command's figures say of its frames."""
    seconds = {f"seconds_{step}": value for step, value in done.seconds.items()}
    report = None if done.report is None else str(done.report)
    films = {"films": [str(path) for path in done.films]} if done.films else {}
    return {"frames": done.frames, "kept": done.kept, "report": report, **films, **seconds}


def finish(console: Console, figures: dict[str, Any], failed: list[str]) -> None:
    """Print the figures, and exit with 2 if frames failed."""
    console.figures({**figures, "failed": failed})
    if failed:
        raise typer.Exit(BAD_INPUT)
