"""``domesim scene``: what a scene file says, and what is wrong with it, before any work."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any

import typer

from domesim.commands.options import Json, Overwrite, Quiet
from domesim.commands.scene_exchange import export_projectors, import_projectors
from domesim.commands.scene_new import new
from domesim.commands.scene_show import show
from domesim.errors import InputError
from domesim.host.console import Console
from domesim.host.numbers import decimal, ratio
from domesim.host.writing import prepare, write_whole
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
for _entry in entry_points(group="domesim.commands.scene"):  # of the packages above
    app.command(_entry.name)(_entry.load())


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
            "their blends, and how bright white and black are. The front is at the bottom.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """List all mistakes of a scene file, and the places that no projector reaches."""
    console = Console(quiet=quiet, json=json)
    theatre = load_scene(scene)
    console.say(*(f"{heading}: {text}" for heading, text in theatre.facts().items()))
    figures: dict[str, Any] = {"scene": theatre.name, "facts": theatre.facts()}
    if not isinstance(theatre, DomeScene):
        if out is not None:
            raise InputError(f"--out {out}: {scene} has a flat screen; leave --out out")
        assert isinstance(theatre, FlatScene)
        if theatre.way is not None:
            measured = contrast(theatre)
            console.say(*measured.lines())
            figures |= measured.figures()
        console.figures(figures)
        return
    if out is not None:
        if out.suffix.lower() != ".png":
            raise InputError(f"--out {out}: the picture is a .png, name it so")
        prepare(out, inputs=[scene], overwrite=overwrite)
    lit = coverage(theatre.theatre, lightmaps.SIZE)
    light = photometry(theatre.one_eye, lightmaps.SIZE) if lit.whole else None
    figures |= _dome_figures(theatre, lit, light, console)
    if out is not None:
        write_whole(out, lightmaps.picture(lit, light))
        console.say(f"  -> {out}")
    console.figures(figures)
    require_covered(theatre, scene, out)


def _dome_figures(
    scene: DomeScene, lit: Coverage, light: Photometry | None, console: Console
) -> dict[str, Any]:
    """Prints figures of a theatre, and returns them."""
    theatre = scene.theatre
    eyes = [view.position[2] for view in theatre.seats.values()]
    figures: dict[str, Any] = {
        "screen_m2": scene.dome.screen_area,
        "projectors": max(1, len(theatre.lenses)),
        "dark_share": lit.dark,
        "blended_share": lit.blended,
        "soft_edges_least": lit.weakest,
        "holes": lit.holes_in_words() if not lit.whole else [],
        "seats": len(eyes),
        "viewpoints": len(theatre.viewpoints),
    }
    count = figures["projectors"]
    several = f", two or more {lit.blended:.1%}" if count > 1 else ""
    console.say(
        f"Coverage: {count} projector{'s light' if count > 1 else ' lights'} {1 - lit.dark:.1%} "
        f"of the screen{several}"
    )
    if lit.whole and lit.weakest < _HARD and count > 1:
        console.say(
            f"Seams: at one place soft edges add up to {lit.weakest:.2g} of one projector: the "
            f"seam will show. Widen the fields, or lower blend_deg"
        )
    if light is not None:
        figures |= light.figures()
        if count > 1:
            console.say(
                f"Overlap: {_range(lit.weakest, lit.most)} times the light of one projector, soft "
                f"edges counted in; {_range(*light.evened)} times after blending"
            )
        console.say(
            f"White frame: {decimal(light.white)} cd/m² ({decimal(light.direct)} direct, "
            f"{decimal(light.reflected)} reflected)",
            f"Evenness: the darkest place has {1 / light.uneven:.0%} of the light of the brightest",
            f"Black frame: {decimal(light.black)} cd/m²{_by_place(light)}; sequential contrast "
            f"{ratio(light.sequential)}",
            *_lifting(light),
            f"Checkerboard: white fields {decimal(light.lit)}, black fields {decimal(light.dark)} "
            f"cd/m²; contrast {ratio(light.checkerboard)}",
            f"Flux: a white frame takes {light.lumens:,.0f} lm on "
            f"{decimal(scene.dome.screen_area)} m² of screen",
        )
    if light is not None and light.albedo is not None:
        console.say(
            f"Albedo of the screen: {_range(figures['albedo_least'], figures['albedo_most'])}, by "
            f"its map, holes counted in"
        )
    if light is not None:
        for entry in entry_points(group="domesim.scene.check"):  # of the packages above
            if (found := entry.load()(scene)) is not None:
                line, figures[entry.name] = found
                console.say(line)
    if eyes:
        console.say(
            f"Seats: {len(eyes)}; heights of eyes over the dome's centre: "
            f"{_range(min(eyes), max(eyes))} m"
        )
    return figures


def _by_place(light: Photometry) -> str:
    """Says how black differs from place to place, if it does."""
    least, most = light.blackest
    if most <= least * (1 + lightmaps.UNEVEN):
        return ""
    return f" on average, {_range(least, most)} by place"


def _lifting(light: Photometry) -> list[str]:
    """Advises to hide the edges of overlaps in black, where they are seen."""
    if light.lift is None:
        return []
    return [
        f"Overlaps in black: their edges are seen. Under [projector], even_black = 'projectors' or "
        f"'frames' lifts the rest by {decimal(light.lift)} cd/m² on average, the least that hides "
        f"them"
    ]


def _range(least: float, most: float) -> str:
    low, high = decimal(least), decimal(most)
    return low if low == high else f"{low} to {high}"
