"""``domesim scene``: what a scene file says, and what is wrong with it, before any work."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from domesim.commands.options import Json, Quiet
from domesim.commands.scene_exchange import export_projectors, import_projectors
from domesim.commands.scene_new import new
from domesim.commands.scene_show import show
from domesim.errors import InputError
from domesim.frames.whole import write_whole
from domesim.host.console import Console, prepare_file
from domesim.inspection import lightmaps
from domesim.inspection.contrast import contrast
from domesim.inspection.coverage import Coverage, coverage, require_covered
from domesim.inspection.photometry import Photometry, photometry
from domesim.scene import DomeScene, FlatScene, load_scene

_HARD = 0.25
"""Least sum of soft edges of a seam that is blended: in its middle each of two is a half."""

app = typer.Typer(
    help="Write a scene file for a theatre of your own, check it, and show the theatre.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


app.command()(new)
app.command()(show)
app.command("import")(import_projectors)
app.command("export")(export_projectors)


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
            help="Domes: a .png of the screen: how many projectors reach a place (orange: none), "
            "their blends, and how bright white is. The front of the theatre is at the bottom.",
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
            raise InputError(f"--out {out}: {scene} has a flat screen; leave --out out")
        assert isinstance(found, FlatScene)
        if found.way is not None:
            told = contrast(found)
            console.say(*told.lines())
            figures |= told.figures()
        console.figures(figures)
        return
    if out is not None:
        if out.suffix.lower() != ".png":
            raise InputError(f"--out {out}: the picture is a .png, name it so")
        prepare_file(out)
    lit = coverage(found.theatre, lightmaps.SIZE)
    light = photometry(found.one_eye, lightmaps.SIZE) if lit.whole else None
    figures |= _told(found, lit, light, console)
    if out is not None:
        write_whole(out, lightmaps.picture(lit, light))
        console.say(f"  -> {out}")
    console.figures(figures)
    require_covered(found, scene, out)


def _told(
    scene: DomeScene, lit: Coverage, light: Photometry | None, console: Console
) -> dict[str, Any]:
    """Figures of a theatre, which are said, too."""
    theatre = scene.theatre
    eyes = [view.position[2] for view in theatre.seats.values()]
    figures: dict[str, Any] = {
        "screen_m2": scene.dome.screen_area,
        "projectors": max(1, len(theatre.lenses)),
        "dark_share": lit.dark,
        "blended_share": lit.blended,
        "soft_edges_least": lit.weakest,
        "holes": lit.told() if not lit.whole else [],
        "seats": len(eyes),
        "viewpoints": len(theatre.viewpoints),
    }
    count = figures["projectors"]
    console.say(
        f"Coverage: {count} projector{' lights' if count == 1 else 's light'} {1 - lit.dark:.1%} "
        f"of the screen, two or more {lit.blended:.1%}"
    )
    if lit.whole and lit.weakest < _HARD and count > 1:
        console.say(
            f"Seams: somewhere soft edges add up to {lit.weakest:.2g} only: fields overlap by less "
            f"than their soft edges, and the seam will show. Widen the fields, or lower blend_deg"
        )
    if light is not None:
        figures |= light.figures()
        console.say(
            f"Blends: soft edges add up to {_range(lit.weakest, lit.most)} of one projector, "
            f"evened out {_range(*light.evened)}",
            f"Brightness: a white frame {light.white:.3g} cd/m² ({light.direct:.3g} direct, "
            f"{light.reflected:.3g} reflected), brightest over darkest place {light.uneven:.3g}",
            f"Black: {light.black:.3g} cd/m² (a white frame over it: {_ratio(light.sequential)})",
            f"Checkerboard: {light.lit:.3g} and {light.dark:.3g} cd/m² "
            f"({_ratio(light.checkerboard)})",
            f"Flux: that white takes {light.lumens:,.0f} lm on the screen's "
            f"{scene.dome.screen_area:.3g} m²",
        )
    if eyes:
        console.say(f"Seats: {len(eyes)}, eyes at {min(eyes):.2f} to {max(eyes):.2f} m")
    return figures


def _range(least: float, most: float) -> str:
    low, high = f"{least:.3g}", f"{most:.3g}"
    return low if low == high else f"{low} to {high}"


def _ratio(contrast: float | None) -> str:
    return "infinite" if contrast is None else f"{contrast:.3g} : 1"
