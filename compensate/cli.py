"""Subcommands that find what to project: compensate, compare, demo."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import typer

from compensate.comparison import Comparison, compare_methods, shown_methods
from compensate.contrast import ContrastWeighting, Eye
from compensate.devices import CPU, on_device
from compensate.master import Figures, Posed, Solution, Stage, solve_frame
from compensate.methods import METHODS, Solver, perceptual, require_method
from compensate.solver.admm import ADMM
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import PerceptualWeighting
from domesim.cli import (
    Bits,
    Format,
    Frames,
    Identical,
    Json,
    Left,
    MasterName,
    OutFolder,
    PackingName,
    Quiet,
    Repair,
    Right,
    SceneName,
    SeatName,
    TransportFile,
    about_scene,
    finish,
    scene_of,
    suffix_of,
    told,
)
from domesim.console import Console, Work, Write, about, each_frame
from domesim.console import prepare as prepare_folder
from domesim.errors import InputError
from domesim.frames import Master, read_master, write_master
from domesim.scene import DomeScene, Scene, StereoScene
from domesim.shows import find_show

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
LowFrequencyGain = Annotated[
    float | None,
    typer.Option(
        help="Perceptual: how much coarse luminance errors count, 0..1 of the most visible ones; "
        "0.1 by default, 0.15 of --weighting contrast. Low values give up the black level for "
        "detail, 1 comes close to subtraction.",
        show_default=False,
    ),
]
EyeName = Annotated[
    str,
    typer.Option(
        "--weighting",
        help="Perceptual: paper, one adaptation luminance and Daly's sensitivity; or contrast, "
        "relative to the local luminance that one seat sees, with castleCSF's sensitivities.",
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


PAPER = "paper"
"""Name of the default vision model."""

INVISIBLE = 0.01
"""JND rms of rounding that is not worth a word."""


def compensate(
    scene: SceneName,
    out: OutFolder,
    master: MasterName = None,
    left: Left = None,
    right: Right = None,
    packing: PackingName = None,
    seat: SeatName = None,
    transport: TransportFile = None,
    method: Method = "perceptual",
    tolerance: Tolerance = None,
    quality: Quality = False,
    low_frequency_gain: LowFrequencyGain = None,
    eye: EyeName = PAPER,
    device: DeviceName = CPU,
    frames: Frames = None,
    file_format: Format = None,
    bits: Bits = None,
    repair: Repair = False,
    allow_identical: Identical = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Compute the frames to project, so that the audience sees the master as closely as can be."""
    console = Console(quiet=quiet, json=json)
    theatre = scene_of(scene, transport, console, seat)
    weighting = _weighting(eye, low_frequency_gain)
    wanted = goal(tolerance, quality=quality)
    solver = _solver(method, theatre, wanted, console, device, worst=seat == "worst")
    stage = Stage(theatre, weighting)

    def prepare(source: Master) -> tuple[Master, Posed, float]:
        return source, *stage.pose_frame(source)

    def solve(posed: tuple[Master, Posed, float]) -> Solution:
        return solve_frame(*posed, method, solver)

    def end(solution: Solution, write: Write) -> tuple[dict[str, Any], str]:
        outcome = solution.outcome()
        written = write(outcome.frame)
        stored = outcome.stored_error(written)
        line = f"{_line(outcome.figures)} As stored: {stored:.3g} JND rms"
        if stored > 1.1 * outcome.figures.error_after and stored > INVISIBLE:
            line += (
                f" (rounding to {written.bits} bit {written.path.suffix} shows: --format, --bits)"
            )
        return {**asdict(outcome.figures), "error_stored": stored}, line

    show = find_show(
        master, left, right, packing=packing, frames=frames, allow_identical=allow_identical
    )
    done = each_frame(
        show,
        out,
        Work(prepare, solve, end),
        console,
        what="compensating",
        repair=repair,
        suffix=suffix_of(file_format),
        bits=bits,
    )
    finish(console, {**about_scene(theatre), **told(done)}, done.failed)


def compare(
    scene: SceneName,
    out: Annotated[
        Path, typer.Option("--out", help="The page to write, an .html file.", show_default=False)
    ],
    master: MasterName = None,
    left: Left = None,
    right: Right = None,
    packing: PackingName = None,
    seat: SeatName = None,
    transport: TransportFile = None,
    tolerance: Tolerance = None,
    quality: Quality = False,
    low_frequency_gain: LowFrequencyGain = None,
    eye: EyeName = PAPER,
    device: DeviceName = CPU,
    size: Annotated[
        int, typer.Option(help="Largest side of the pictures on the page, pixels.", min=16)
    ] = 1024,
    repair: Repair = False,
    allow_identical: Identical = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a page that compares the master with what is seen, uncompensated and compensated."""
    console = Console(quiet=quiet, json=json)
    theatre = scene_of(scene, transport, console, seat)
    show = find_show(master, left, right, packing=packing, allow_identical=allow_identical)
    if len(show.moments) > 1:
        raise InputError(
            f"{master or left}: a page shows one frame, got {len(show.moments)}; name one of them"
        )
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{out}: a page is an .html file; give it such a name")
    wanted = goal(tolerance, quality=quality)
    solver = _solver("perceptual", theatre, wanted, console, device, worst=seat == "worst")
    weighting = _weighting(eye, low_frequency_gain)
    prepare_folder(out.parent)
    (moment,) = show.moments
    with about(moment[0]):
        frame = show.read(moment, repair=repair)
        comparison = _compared(frame, theatre, console, solver, weighting)
    comparison.write_page(out, size=size, command=_command_line())
    console.say(f"Open {out.resolve()}")
    console.figures({**about_scene(theatre), "page": str(out), "methods": comparison.figures()})


def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder for the results.")] = Path("out/demo"),
    scene: SceneName = "dome_imax",
    transport: TransportFile = None,
    device: DeviceName = CPU,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run the main job on the bundled night scene: frames to project, what is seen, the page."""
    console = Console(quiet=quiet, json=json)
    theatre = scene_of(scene, transport, console)
    solver = on_device(ADMM(), device)
    if not isinstance(theatre, DomeScene):
        raise InputError(f"--scene {scene}: the demo's master is a domemaster; use a dome theatre")
    with resources.as_file(resources.files("scenes") / "masters" / "night.exr") as path:
        frame = read_master([path])
    console.say(f"Master: {frame.described()}\nTheatre: {theatre.name}. {theatre.description}")
    prepare_folder(out)
    comparison = _compared(frame, theatre, console, solver, PerceptualWeighting())
    files = []
    for name, written in comparison.frames():
        write_master(written, [out / f"{name}.exr"])
        files.append(str(out / f"{name}.exr"))
    page = out / "compare.html"
    comparison.write_page(page, size=1024, command=_command_line())
    console.say(f"Frames: {', '.join(files)}\nOpen {page.resolve()}")
    console.figures(
        {
            **about_scene(theatre),
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
    weighting: Eye,
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
        console.say(_line(Figures(**figures)))
    return comparison


def _solver(
    method: str,
    scene: Scene,
    tolerance: float,
    console: Console,
    device: str,
    *,
    worst: bool = False,
) -> Solver | None:
    """The perceptual method's solver, or None for the others' own."""
    require_method(method, scene)
    if not 0 < tolerance < 1:
        raise InputError(f"tolerance must lie between 0 and 1, got {tolerance:g}")
    if method != "perceptual":
        if device != CPU:
            raise InputError(f"--device {device}: {method} is computed on the processor only")
        if worst and isinstance(scene, StereoScene) and len(scene.chosen) > 1:
            raise InputError(
                f"--seat worst: {method} knows one seat or the mean of all; use --seat all, name "
                f"one, or leave --method out"
            )
        return None

    def note(iteration: int, gap: float) -> None:
        console.note(f"iteration {iteration}, within {gap:.1e} of the optimum")

    return on_device(perceptual(scene, tolerance, worst=worst, progress=note), device)


def goal(tolerance: float | None, *, quality: bool) -> float:
    """The tolerance that was asked for."""
    if quality and tolerance is not None:
        raise InputError(f"--quality is --tolerance 1e-4, got --tolerance {tolerance:g}, too")
    if quality:
        return 1e-4
    return 1e-3 if tolerance is None else tolerance


def _weighting(name: str, low_frequency_gain: float | None) -> Eye:
    settings: dict[str, type[Eye]] = {PAPER: PerceptualWeighting, "contrast": ContrastWeighting}
    if name not in settings:
        raise InputError(f"--weighting {name!r} is not known; use one of {', '.join(settings)}")
    if low_frequency_gain is None:
        return settings[name]()
    return settings[name](LowFrequencyFloor(low_frequency_gain))


def _line(f: Figures) -> str:
    """What was done and how good it is, for a person."""
    parts = [
        f"{f.method}: visible error {f.error_before:.3g} -> {f.error_after:.3g} JND rms "
        f"(subtractive {f.error_subtractive:.3g})",
        f"{f.clipped:.1%} of the screen too dark for exact subtraction",
    ]
    if f.error_by_seat:
        seats = ", ".join(f"{name} {error:.3g}" for name, error in f.error_by_seat.items())
        parts.append(f"by seat: {seats}")
    if f.out_of_range:
        parts.append(f"{f.out_of_range:.1%} out of the projector's range")
    if f.file_clipped:
        parts.append(f"{f.file_clipped:.1%} out of the file's colour range and clipped")
    if f.gap is not None:
        line = f"within {f.gap:.1e} of the optimum after {f.iterations} iterations"
        if f.distance:
            line += f" (what is seen, within {f.distance:.2g} JND rms)"
        parts.append(line)
    parts.append(f"{f.seconds:.1f} s. {f.status}")
    return "; ".join(parts)


def _command_line() -> str:
    return shlex.join(["domesim", *sys.argv[1:]])
