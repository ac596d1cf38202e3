"""``domesim scene``: what a scene file says, and what is wrong with it, before any work."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from domesim.cli import Json, Quiet
from domesim.console import Console, prepare_file
from domesim.coverage import coverage, require_covered
from domesim.drafting import new
from domesim.errors import InputError
from domesim.scene import DomeScene, load_scene

app = typer.Typer(
    help="Write a scene file for a theatre of your own, and check it.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


app.command()(new)


@app.command()
def check(
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE",
            help="The scene: its name, or the path of a .toml file.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="Domes: a .png of the screen that shows which places projectors reach. Orange: "
            "none. The lighter the grey, the more. The front of the theatre is at the bottom.",
            show_default=False,
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """List all mistakes of a scene file, and the places that no projector reaches."""
    console = Console(quiet=quiet, json=json)
    found = load_scene(scene)
    console.say(*(f"{heading}: {text}" for heading, text in found.facts().items()))
    figures: dict[str, Any] = {"scene": found.name, "facts": found.facts()}
    if not isinstance(found, DomeScene):
        if out is not None:
            raise InputError(f"--out {out}: {scene} is a stereo system; leave --out out")
        console.figures(figures)
        return
    figures |= _told(found, console)
    if out is not None:
        if out.suffix.lower() != ".png":
            raise InputError(f"--out {out}: the picture is a .png, name it so")
        prepare_file(out)
        coverage(found.theatre, 1024).draw(out)
        console.say(f"  -> {out}")
    console.figures(figures)
    require_covered(found, scene, out)


def _told(scene: DomeScene, console: Console) -> dict[str, Any]:
    """Figures of a theatre, which are said, too."""
    theatre, lit = scene.theatre, coverage(scene.theatre)
    figures: dict[str, Any] = {
        "screen_m2": scene.dome.screen_area,
        "projectors": max(1, len(theatre.lenses)),
        "dark_share": lit.dark,
        "blended_share": lit.blended,
        "holes": lit.told() if not lit.whole else [],
        "viewpoints": len(theatre.viewpoints),
    }
    console.say(
        f"Coverage: {figures['projectors']} projectors light {1 - lit.dark:.1%} of the screen, two "
        f"or more {lit.blended:.1%}"
    )
    if theatre.corrected:
        reflected = float(scene.projector.luminance_weights @ np.asarray(scene.albedo))
        area = scene.dome.screen_area
        lumens = scene.projector.white * np.pi * area / reflected
        figures["lumens"] = lumens
        console.say(f"Flux: that white takes {lumens:,.0f} lm on the screen's {area:.3g} m²")
    if theatre.viewpoints:
        console.say(f"Seats: {len(theatre.viewpoints)} places to look from")
    return figures
