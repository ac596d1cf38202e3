"""Subcommands that find what to project: compensate, compare, demo."""

from __future__ import annotations

import shlex
import sys
from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from compensate.aim import Aim, Eye
from compensate.comparison import Comparison, compare_methods, shown_methods
from compensate.compensating import Compensating, line_of
from compensate.devices import CPU
from compensate.master import Figures
from compensate.methods import METHODS, Solver
from domesim.commands.options import (
    TPDF,
    Anew,
    Bits,
    Checksums,
    DitherName,
    DryRun,
    EncodingName,
    Format,
    Fps,
    Frames,
    FrameTimeout,
    Identical,
    Json,
    Left,
    MasterName,
    Mix,
    OutFolder,
    OutputEncoding,
    PackingName,
    Pages,
    Quiet,
    Repair,
    Right,
    SceneName,
    Scheduler,
    SeatName,
    Threads,
    TransportFile,
    Workers,
    about_scene,
    do_show,
    scene_of,
    writing_of,
)
from domesim.errors import InputError
from domesim.frames import Master, read_master, write_master
from domesim.host.console import Console, about
from domesim.host.console import prepare as prepare_folder
from domesim.scene import DomeScene, Scene
from domesim.scene.choice import SceneChoice
from domesim.shows.run import FRAME_TIMEOUT, Running
from domesim.shows.show import find_show

Method = Annotated[
    str, typer.Option(help=f"What to project: {', '.join(METHODS)}.", show_default=True)
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        help="Perceptual: certified distance from the least cost at which to stop (of the worst "
        "seat: five times that); 1e-3 by default.",
        show_default=False,
    ),
]
Quality = Annotated[
    bool,
    typer.Option("--quality", help="Perceptual: --tolerance 1e-4, for about twice the time."),
]
Lift = Annotated[
    float | None,
    typer.Option(
        help="Perceptual: from the deepest black (0, plain subtraction) to all contrast (4): how "
        f"many times the missing light dark places are lifted; {Aim().lift:g} by default.",
        show_default=False,
    ),
]
LowFrequencyGain = Annotated[
    float | None,
    typer.Option(
        help="--weighting paper: how much coarse luminance errors count, 0..1 of the most visible "
        "ones; 0.1 by default.",
        show_default=False,
    ),
]
EyeName = Annotated[
    str | None,
    typer.Option(
        "--weighting",
        help="Perceptual: contrast keeps the master's contrasts and hues over the black that is "
        "left, which is the default; paper minimises the difference of light by one adaptation "
        "luminance and Daly's sensitivity, with a certificate, which is what several seats get.",
        show_default=False,
    ),
]
DeviceName = Annotated[
    str,
    typer.Option(
        "--device",
        help="Perceptual: what computes: cpu; cuda or cuda:1, a GPU by PyTorch (extra gpu); cupy, "
        "a GPU by CuPy; torch, the processor by PyTorch.",
    ),
]

OnlyVisibleFlag = Annotated[
    bool,
    typer.Option(
        "--only-visible",
        help="Perceptual: solve only rectangles in which what subtraction leaves is predicted to "
        "be seen ('domesim predict --combination local-contrast'), and subtract elsewhere: faster "
        "where that is next to nothing. No certificate.",
    ),
]


def compensate(
    scene: SceneName,
    out: OutFolder,
    master: MasterName = None,
    left: Left = None,
    right: Right = None,
    packing: PackingName = None,
    encoding: EncodingName = None,
    seat: SeatName = None,
    transport: TransportFile = None,
    method: Method = "perceptual",
    tolerance: Tolerance = None,
    quality: Quality = False,
    lift: Lift = None,
    low_frequency_gain: LowFrequencyGain = None,
    eye: EyeName = None,
    device: DeviceName = CPU,
    only_visible: OnlyVisibleFlag = False,
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
    pages: Pages = 3,
    dry_run: DryRun = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compute the frames to project, so that the audience sees the master as closely as can be."""
    console = Console(quiet=quiet, json=json)
    choice = SceneChoice(scene, transport, seat)
    theatre = scene_of(choice, console)
    wanted = goal(tolerance, quality=quality)
    recipe = Compensating(
        choice.settled(theatre),
        method,
        wanted,
        eye,
        lift,
        low_frequency_gain,
        device,
        only_visible,
    )
    recipe.require_sense(theatre)
    if scheduler is None:  # whose workers may have a device that this machine has not
        recipe.solver(theatre, console.note)
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
        recipe,
        console,
        what="compensating",
        writing=writing_of(file_format, bits, dither, output_encoding, repair=repair, fps=fps),
        running=Running(workers, threads, scheduler, anew, mix, pages, frame_timeout),
        facts=about_scene(theatre, seat),
        dry_run=dry_run,
    )


def compare(
    scene: SceneName,
    out: Annotated[
        Path, typer.Option("--out", help="The page to write, an .html file.", show_default=False)
    ],
    master: MasterName = None,
    left: Left = None,
    right: Right = None,
    packing: PackingName = None,
    encoding: EncodingName = None,
    seat: SeatName = None,
    transport: TransportFile = None,
    tolerance: Tolerance = None,
    quality: Quality = False,
    lift: Lift = None,
    low_frequency_gain: LowFrequencyGain = None,
    eye: EyeName = None,
    device: DeviceName = CPU,
    size: Annotated[
        int, typer.Option(help="Largest side of the pictures on the page, pixels.", min=16)
    ] = 1024,
    checksums: Checksums = None,
    repair: Repair = False,
    allow_identical: Identical = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a page that compares the master with what is seen, uncompensated and compensated."""
    console = Console(quiet=quiet, json=json)
    choice = SceneChoice(scene, transport, seat)
    theatre = scene_of(choice, console)
    show = find_show(
        master,
        left,
        right,
        packing=packing,
        allow_identical=allow_identical,
        encoding=encoding,
    ).listed_in(checksums)
    if len(show.moments) > 1:
        raise InputError(
            f"{master or left}: a page shows one frame, got {len(show.moments)}; name one of them"
        )
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{out}: a page is an .html file; give it such a name")
    wanted = goal(tolerance, quality=quality)
    recipe = Compensating(
        choice,
        tolerance=wanted,
        eye=eye,
        lift=lift,
        low_frequency_gain=low_frequency_gain,
        device=device,
    )
    solver = recipe.solver(theatre, console.note)
    weighting = recipe.weighting(theatre)
    prepare_folder(out.parent)
    (moment,) = show.moments
    with about(moment[0]):
        frame = show.read(moment, repair=repair)
        console.say(f"{moment[0].name}: {frame.described()}")
        comparison = _compared(frame, theatre, console, solver, weighting)
    comparison.write_page(out, size=size, command=_command_line())
    console.say(f"Open {out.resolve()}")
    facts = {**about_scene(theatre, seat), **frame.facts(), "page": str(out)}
    console.figures({**facts, "methods": comparison.figures()})


def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder for the results.")] = Path("out/demo"),
    scene: SceneName = "dome_imax",
    transport: TransportFile = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run the main job on the bundled night scene: frames to project, what is seen, the page."""
    console = Console(quiet=quiet, json=json)
    theatre = scene_of(SceneChoice(scene, transport), console)
    if not isinstance(theatre, DomeScene):
        raise InputError(f"--scene {scene}: the demo's master is a domemaster; use a dome theatre")
    with resources.as_file(resources.files("scenes") / "masters" / "night.exr") as path:
        frame = read_master([path])
    console.say(f"Master: {frame.described()}", f"Theatre: {theatre.name}. {theatre.description}")
    prepare_folder(out)
    comparison = _compared(frame, theatre, console, None, None)
    files = []
    for name, written in comparison.frames():
        write_master(written, [out / f"{name}.exr"])
        files.append(str(out / f"{name}.exr"))
    page = out / "compare.html"
    comparison.write_page(page, size=1024, command=_command_line())
    console.say(f"Frames: {', '.join(files)}", f"Open {page.resolve()}")
    console.figures(
        {
            **about_scene(theatre),
            **frame.facts(),
            "files": files,
            "page": str(page),
            "methods": comparison.figures(),
        }
    )


def _compared(
    frame: Master,
    theatre: Scene,
    console: Console,
    solver: Solver | None,
    weighting: Eye | None,
) -> Comparison:
    with console.progress("solving", len(shown_methods(theatre))) as start:
        comparison = compare_methods(
            frame,
            theatre,
            solver=solver,
            weighting=weighting,
            progress=start,
        )
    for figures in comparison.figures().values():
        console.say(line_of(Figures(**figures)))
    return comparison


def goal(tolerance: float | None, *, quality: bool) -> float:
    """The tolerance that was asked for."""
    if quality and tolerance is not None:
        raise InputError(f"--quality is --tolerance 1e-4, got --tolerance {tolerance:g}, too")
    if quality:
        return 1e-4
    return 1e-3 if tolerance is None else tolerance


def _command_line() -> str:
    return shlex.join(["domesim", *sys.argv[1:]])
