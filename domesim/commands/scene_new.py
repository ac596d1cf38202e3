"""``domesim scene new``: a scene file from a few figures, or from answers to questions."""

from __future__ import annotations

import re
import sys
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
import typer

from domesim.commands.options import Json, Quiet
from domesim.errors import InputError
from domesim.host.console import Console
from domesim.host.writing import prepare, write_whole
from domesim.room.layouts import LAYOUTS
from domesim.room.theatre import Lens
from domesim.scene import DomeScene
from domesim.scene.drafts import (
    ALBEDO,
    PERFORATION,
    SYSTEMS,
    WHITE,
    DomeWish,
    StereoWish,
    dome_draft,
    stereo_draft,
)
from domesim.scene.loading import scene_of_text

Wish: TypeAlias = DomeWish | StereoWish


def new(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME_OR_FILE",
            help="What to call the scene, or the .toml file to write.",
            show_default=False,
        ),
    ],
    kind: Annotated[
        str, typer.Option(metavar="dome|stereo", help="A dome theatre, or a 3D screen.")
    ] = "dome",
    radius: Annotated[
        float | None, typer.Option(help="Domes: radius, m.", show_default=False)
    ] = None,
    tilt: Annotated[
        float | None,
        typer.Option(help="Domes: lean to the front, degrees; level if none.", show_default=False),
    ] = None,
    half_angle: Annotated[
        float | None,
        typer.Option(
            help="Domes: from the zenith to the rim, degrees; a hemisphere if none.",
            show_default=False,
        ),
    ] = None,
    projectors: Annotated[
        int | None, typer.Option(help="Domes: how many; one if none.", show_default=False)
    ] = None,
    layout: Annotated[
        str | None,
        typer.Option(
            metavar="cove|ring|centre",
            help="Domes: where projectors stand. cove: under the rim, leaning as it does; ring: on "
            "a level ring under the screen; centre: one in the middle. All look across.",
            show_default=False,
        ),
    ] = None,
    seats: Annotated[
        str | None,
        typer.Option(metavar="ROWSxCOLS", help="Domes: such as 9x16.", show_default=False),
    ] = None,
    plain: Annotated[
        bool,
        typer.Option(
            "--plain", help="Domes: no seats, as domesim measure dome wants a theatre described."
        ),
    ] = False,
    albedo: Annotated[
        float | None,
        typer.Option(help="Domes: share of light that the paint sends back.", show_default=False),
    ] = None,
    gain: Annotated[
        float | None,
        typer.Option(
            help="Domes: a data sheet's gain, of the paint between the holes. Alone it is a matte "
            "screen's, which is its albedo; above --albedo it is a lobe.",
            show_default=False,
        ),
    ] = None,
    perforation: Annotated[
        float | None,
        typer.Option(help="Domes: share of the screen that is holes.", show_default=False),
    ] = None,
    white: Annotated[
        float | None,
        typer.Option(
            help="Luminance of a small white patch, cd/m²; through the glasses.",
            show_default=False,
        ),
    ] = None,
    lumens: Annotated[
        float | None,
        typer.Option(
            help="Domes: of all projectors on the screen, lm, instead of --white.",
            show_default=False,
        ),
    ] = None,
    width: Annotated[
        float | None, typer.Option(help="Stereo: of the screen, m.", show_default=False)
    ] = None,
    height: Annotated[
        float | None, typer.Option(help="Stereo: of the screen, m.", show_default=False)
    ] = None,
    distance: Annotated[
        float | None, typer.Option(help="Stereo: of the middle seat, m.", show_default=False)
    ] = None,
    system: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(SYSTEMS),
            help="Stereo: how eyes are kept apart. Crosstalk is that of a bundled scene.",
            show_default=False,
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a scene file for a theatre of your own, with projectors placed in it.

    On a terminal, with a name alone, it asks. Each figure gets a unit, a comment and a source.
    """
    console = Console(quiet=quiet, json=json)
    options = {
        "radius": radius, "tilt": tilt, "half_angle": half_angle, "projectors": projectors,
        "layout": layout, "seats": seats, "albedo": albedo, "gain": gain,
        "perforation": perforation, "white": white, "lumens": lumens, "width": width,
        "height": height, "distance": distance, "system": system, "plain": plain or None,
    }  # fmt: skip
    chosen = {key: value for key, value in options.items() if value is not None}
    file = _file(name)
    if not chosen and sys.stdin.isatty() and not (quiet or json):
        wish = _asked(console, kind)
    else:
        wish = _wish(kind, chosen)
    prepare(file)
    text = _text(wish, file.stem)
    scene = scene_of_text(text, str(file), file.parent)
    write_whole(file, text.encode())
    console.say(*(f"{heading}: {options}" for heading, options in scene.facts().items()))
    lenses = scene.theatre.lenses if isinstance(scene, DomeScene) else ()
    if lenses:
        console.say(
            f"Projectors: {len(lenses)}, each with a field of {np.degrees(lenses[0].field):.0f}° "
            f"({_shape(lenses[0])}), all alike; position_m of each is in the file"
        )
    console.say(
        f"  -> {file}",
        "What you did not say is marked as chosen in its [sources]: look it over.",
        f"Then: domesim scene check {scene.argument} --out check.png",
        f"      domesim scene show {scene.argument} --out {file.stem}.html",
    )
    console.figures({"scene": scene.name, "output": str(file), "facts": scene.facts()})


def _file(name: str) -> Path:
    file = Path(name) if name.endswith(".toml") else Path(f"{name}.toml")
    if file.exists():
        raise InputError(
            f"{file}: wanted a new file, got one that is there: its figures would be lost. Choose "
            f"another name, or remove it"
        )
    return file


def _text(wish: Wish, name: str) -> str:
    return dome_draft(wish, name) if isinstance(wish, DomeWish) else stereo_draft(wish, name)


def _shape(lens: Lens) -> str:
    if lens.kind == "equidistant":
        return "a fisheye"
    shape = f"{max(lens.aspect, 1 / lens.aspect):g} : 1"
    return f"across, {shape}{', upright' if lens.aspect < 1 else ''}"


def _wish(kind: str, options: dict[str, Any]) -> Wish:
    """The wish that the command's options state, by their names."""
    kinds = {"dome": (DomeWish, "radius"), "stereo": (StereoWish, "width")}
    if kind not in kinds:
        raise InputError(f"--kind {kind}: use dome or stereo")
    chosen, needed = kinds[kind]
    known = [each.name for each in fields(chosen)]
    for key in options:
        if key not in known:
            option = f"--{key.replace('_', '-')}"
            raise InputError(f"{option}: is not for --kind {kind}; leave it out")
    if needed not in options:
        raise InputError(
            f"--{needed}: is missing: how large is it, in m? On a terminal, with a name alone, "
            f"domesim asks"
        )
    if kind == "stereo":
        return StereoWish(**{"system": "silver", **options})
    taken = dict(options)
    if {"seats", "plain"} <= set(taken):
        raise InputError("--seats contradicts --plain, a room without: give one of the two")
    if "seats" in taken:
        taken["seats"] = _seats(taken["seats"])
    if "layout" in taken and taken["layout"] not in LAYOUTS:
        raise InputError(f"--layout {taken['layout']}: use one of {', '.join(LAYOUTS)}")
    return DomeWish(**taken)


def _seats(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"\s*(\d{1,4})\s*[xX×]\s*(\d{1,4})\s*", text)
    if not match:
        raise InputError(f"--seats {text}: wanted rows x seats in a row, such as 9x16")
    return int(match[1]), int(match[2])


class _Question(NamedTuple):
    """What is asked, the key of the answer, and what is proposed."""

    key: str
    text: str
    proposed: Any


_OF_A_DOME = (
    _Question("radius", "Radius of the dome, m (half of its width)", 7.5),
    _Question("tilt", "How far does it lean to the front, degrees", 0.0),
    _Question("projectors", "How many projectors", 1),
    _Question("seats", "Rows of seats x seats in a row", "9x16"),
    _Question(
        "albedo",
        "Albedo of the paint: the share of light that it sends back; a matte screen's gain",
        ALBEDO,
    ),
    _Question("perforation", "Share of the screen that is holes (0 if it has none)", PERFORATION),
    _Question("white", "Luminance of a small white patch, cd/m² (1 fL is 3.43)", WHITE),
)
_PLACE = _Question(
    "layout", "Where are the projectors: cove (under the rim) or ring (level)", "cove"
)
_OF_A_SCREEN = (
    _Question("system", f"How are the eyes kept apart: {', '.join(SYSTEMS)}", "silver"),
    _Question("width", "Width of the screen, m", 10.0),
    _Question("distance", "Distance of the seat in the middle, m", 20.0),
)


_LEFT = ("tilt", "albedo", "perforation", "white")
"""What the draft chooses just as it is proposed."""


def _asked(console: Console, kind: str) -> Wish:
    """The wish that answers on the terminal state; a bad answer is asked for again."""
    console.say("Enter takes what stands in brackets.")
    answers: dict[str, Any] = {}
    questions = list(_OF_A_SCREEN if kind == "stereo" else _OF_A_DOME)
    needed: dict[str, Any] = {"width": 10.0} if kind == "stereo" else {"radius": 7.5}
    while questions:
        key, text, proposed = questions.pop(0)
        answers[key] = typer.prompt(f"{text}?", default=proposed, type=type(proposed))
        try:
            _wish(kind, needed | answers)
        except InputError as error:
            console.say(f"  {error}")
            del answers[key]
            questions.insert(0, _Question(key, text, proposed))
        if key == "projectors" and answers.get(key, 1) > 1:
            questions.insert(0, _PLACE)
        if key in _LEFT and answers.get(key) == proposed:  # the draft's own choice, and told as one
            del answers[key]
    return _wish(kind, answers)
