"""Options that several subcommands have, in groups; Typer sees them as options of their own."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, final, get_type_hints

import typer

from domesim.commands import BAD_INPUT
from domesim.host.console import Console
from domesim.inspection.coverage import require_covered
from domesim.scene import DomeScene, Scene, StereoScene, scene_names
from domesim.scene.choice import SceneChoice
from domesim.scene.grade import KEPT, TAKEN_OUT

OutFolder = Annotated[
    Path, typer.Option("--out", help="Folder for the results.", show_default=False)
]
SceneName = Annotated[
    str,
    typer.Option(
        "--scene",
        help=f"The theatre or stereo system: {', '.join(scene_names())}; or the path of a .toml "
        "file.",
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
SeatName = Annotated[
    str | None,
    typer.Option(
        "--seat",
        help="The seat to look from. Stereo: 'all' for the mean of all seats. Dome: figures and "
        "predictions are for that seat's pixels per degree.",
        show_default=False,
    ),
]
BlackIs = Annotated[
    str | None,
    typer.Option(
        "--black",
        help=f"What the projector's black is: {KEPT}, part of what the master was graded on (the "
        f"default on flat screens); or {TAKEN_OUT}, pollution (the default in domes).",
        show_default=False,
    ),
]
AmbientIs = Annotated[
    str | None,
    typer.Option(
        "--ambient",
        help=f"What other light in the room is, [ambient] of the scene: {KEPT} or {TAKEN_OUT}, as "
        "--black.",
        show_default=False,
    ),
]
Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        help="Replace files that domesim did not write, or that were changed since.",
    ),
]
Repair = Annotated[
    bool,
    typer.Option(help="Replace NaN and negative samples by black, infinite ones by the largest."),
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]
Json = Annotated[
    bool, typer.Option("--json", help="Print figures to standard output as one JSON object.")
]


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the fields of its parameters that are dataclasses as options of its own.

    A field without a default is an option that must be given. Typer sees the options in the order
    of parameters and fields.
    """
    groups: dict[str, Any] = {
        name: kind
        for name, kind in get_type_hints(command).items()
        if name != "return" and is_dataclass(kind)
    }

    @wraps(command)
    def run(**given: Any) -> None:
        for name, kind in groups.items():
            given[name] = kind(**{each.name: given.pop(each.name) for each in fields(kind)})
        command(**given)

    parameters: list[inspect.Parameter] = []
    hints = get_type_hints(command, include_extras=True)
    for parameter in inspect.signature(command).parameters.values():
        of = groups.get(parameter.name)
        shown = (parameter,) if of is None else inspect.signature(of).parameters.values()
        kinds = hints if of is None else get_type_hints(of, include_extras=True)
        parameters += [
            each.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=kinds[each.name])
            for each in shown
        ]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    return run


@final
@dataclass(frozen=True)
class Telling:
    """What a command says."""

    quiet: Quiet = False
    json: Json = False

    def console(self) -> Console:
        """Where it says it."""
        return Console(quiet=self.quiet, json=self.json)


@final
@dataclass(frozen=True)
class Place:
    """Which scene a command is about, and from which seat."""

    scene: SceneName
    transport: TransportFile = None
    seat: SeatName = None
    black: BlackIs = None
    ambient: AmbientIs = None

    def load(self, console: Console, gamut: str | None = None) -> tuple[SceneChoice, Scene]:
        """Loads the scene, for this process and for others; says if it is approximate, and what
        light without a picture is. Commands that write masters may choose a `gamut`, too.

        Raises
        ------
        InputError
            As for `scene_of`.
        """
        choice = SceneChoice(self.scene, self.transport, self.seat, self.black, self.ambient, gamut)
        scene = scene_of(choice, console)
        if any(part.any() for part in scene.unlit):
            console.say(f"{scene.name}: {scene.graded}")
        return choice.settled(scene), scene

    def files(self) -> tuple[str | Path | None, ...]:
        """What it reads, for `prepare`."""
        return self.scene, self.transport

    def about(self, scene: Scene) -> dict[str, Any]:
        """What a command's figures say of its scene, and of the seat that was asked for."""
        facts = about_scene(scene)
        if self.seat is not None and not scene.chosen:
            facts["seats"] = [self.seat]
        return facts


def about_scene(scene: Scene) -> dict[str, Any]:
    """What a command's figures say of its scene."""
    facts: dict[str, Any] = {"scene": scene.name, "approximation": scene.approximation}
    facts |= vars(scene.grade)
    if scene.chosen:
        facts["seats"] = list(scene.chosen)
    return facts


def scene_of(choice: SceneChoice, console: Console) -> Scene:
    """Loads the scene of a command; says if it is approximate.

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


def finish(console: Console, figures: dict[str, Any], failed: list[str]) -> None:
    """Print the figures, and exit with 2 if frames failed."""
    console.figures({**figures, "failed": failed})
    if failed:
        raise typer.Exit(BAD_INPUT)
