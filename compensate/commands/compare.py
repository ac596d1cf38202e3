"""``domesim compare`` and ``domesim demo``: a page that compares what methods show."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from compensate.bundled import bundled_night
from compensate.commands.aiming import Aiming
from compensate.methods import Solver
from compensate.page.comparison import Comparison, compare_methods, shown_methods
from compensate.pose import Eye
from compensate.shows.compensating import line_of
from domesim.commands.options import (
    Overwrite,
    Place,
    SceneName,
    Telling,
    TransportFile,
    about_scene,
    grouped,
    scene_of,
)
from domesim.commands.shows import Masters
from domesim.errors import InputError
from domesim.frames import Master, write_master
from domesim.host.console import Console, about
from domesim.host.writing import prepare
from domesim.pathtrace.llvm import lacking
from domesim.scene import DomeScene, Scene
from domesim.scene.choice import SceneChoice


@grouped
def compare(
    place: Place,
    masters: Masters,
    aiming: Aiming,
    telling: Telling,
    out: Annotated[
        Path, typer.Option("--out", help="The page to write, an .html file.", show_default=False)
    ],
    size: Annotated[
        int, typer.Option(help="Largest side of the pictures on the page, pixels.", min=16)
    ] = 1024,
    overwrite: Overwrite = False,
) -> None:
    """Write a page that compares the master with what is seen, uncompensated and compensated."""
    console = telling.console()
    choice, scene = place.load(console)
    show = masters.find(scene)
    if len(show.moments) > 1:
        raise InputError(
            f"{masters.master or masters.left}: a page shows one frame, got {len(show.moments)}; "
            f"name one of them"
        )
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{out}: a page is an .html file; give it such a name")
    recipe = aiming.recipe(choice)
    solver, eye = recipe.solver(scene, console.note), recipe.weighting(scene)
    (moment,) = show.moments
    prepare(out, inputs=[*place.files(), *moment], overwrite=overwrite)
    with about(moment[0]):
        frame = show.read(moment, repair=masters.repair)
        console.say(f"{moment[0].name}: {frame.described()}")
        comparison = _compared(frame, scene, console, solver, eye)
    comparison.write_page(out, size=size, command=_command_line())
    console.say(f"Open {out.resolve()}")
    facts = {**place.about(scene), **frame.facts(), "page": str(out)}
    console.figures({**facts, "methods": comparison.figures(), **_unmeasured(comparison)})


@grouped
def demo(
    telling: Telling,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results.")] = Path("out/demo"),
    scene: SceneName = "dome_imax",
    transport: TransportFile = None,
) -> None:
    """Run the main job on the bundled night scene: frames to project, what is seen, the page."""
    console = telling.console()
    theatre = scene_of(SceneChoice(scene, transport), console)
    if not isinstance(theatre, DomeScene):
        raise InputError(f"--scene {scene}: the demo's master is a domemaster; use a dome theatre")
    frame = bundled_night()
    console.say(f"Master: {frame.described()}", f"Theatre: {theatre.name}. {theatre.description}")
    page = out / "compare.html"
    names = ("project", *(f"seen-{method}" for method in shown_methods(theatre)))
    prepare(page, *(out / f"{name}.exr" for name in names), inputs=[scene, transport])
    comparison = _compared(frame, theatre, console, None, None)
    files = []
    for name, written in comparison.frames():
        write_master(written, [out / f"{name}.exr"])
        files.append(str(out / f"{name}.exr"))
    comparison.write_page(page, size=1024, command=_command_line())
    if missing := lacking():
        console.say(missing)
    console.say(f"Frames: {', '.join(files)}", f"Open {page.resolve()}")
    facts = {**about_scene(theatre), **frame.facts(), "files": files, "page": str(page)}
    console.figures({**facts, "methods": comparison.figures(), **_unmeasured(comparison)})


def _compared(
    frame: Master, scene: Scene, console: Console, solver: Solver | None, eye: Eye | None
) -> Comparison:
    with console.progress("solving", len(shown_methods(scene))) as start:
        comparison = compare_methods(frame, scene, solver=solver, weighting=eye, progress=start)
    for outcome in comparison.outcomes.values():
        console.say(line_of(outcome.figures))
    if told := comparison.stars():
        console.say(told)
    console.say(*(f"{heading}: {text}" for heading, text in comparison.albedo().items()))
    return comparison


def _unmeasured(comparison: Comparison) -> dict[str, Any]:
    """What an albedo costs that nobody measured, for programs."""
    found = comparison.unmeasured
    return {} if found is None else {"unmeasured": found.figures()}


def _command_line() -> str:
    return shlex.join(["domesim", *sys.argv[1:]])
