"""Subcommands that show what may be believed: bench."""

from __future__ import annotations

import json as json_module
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from domesim.cli import Json, Quiet, SceneName
from domesim.console import Console, prepare
from domesim.errors import InputError
from domesim.scene import load_scene
from validation.benchmarks.solvers import GAPS, Cost, costs


def bench(
    out: Annotated[Path, typer.Option("--out", help="Folder for bench.json.")] = Path("out/bench"),
    scene: SceneName = "dome_imax",
    sizes: Annotated[str, typer.Option(help="Sizes of the domemaster, pixels.")] = "128,256,512",
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Count the work of each solver: FFTs of planes to a true gap, and certified gaps."""
    console = Console(quiet=quiet, json=json)
    try:
        wanted = tuple(int(size) for size in sizes.split(","))
    except ValueError:
        raise InputError(f"--sizes takes numbers such as 128,256, got {sizes!r}") from None
    if min(wanted) < 16:
        raise InputError(f"--sizes takes numbers of at least 16, got {min(wanted)}")
    load_scene(scene)
    prepare(out)
    header = " ".join(f"{gap:>8.0e}" for gap in GAPS)
    console.say(
        f"FFTs of planes to a true relative gap of, and time in FFT pairs of one plane\n"
        f"{'size':>5} {'solver':<38}{header} {'gap':>9} {'certified':>9} {'time':>7}"
    )
    found = []
    for cost in costs(wanted, scene):
        found.append(asdict(cost))
        console.say(_row(cost))
    try:
        (out / "bench.json").write_text(json_module.dumps(found, indent=1))
    except OSError as error:
        raise InputError(f"{out}: cannot write bench.json: {error.strerror}") from None
    console.figures({"scene": scene, "costs": found})


def _row(cost: Cost) -> str:
    ffts = " ".join(f"{'never' if n is None else n:>8}" for n in cost.ffts)
    certified = "-" if cost.certified_gap is None else f"{cost.certified_gap:.1e}"
    return (
        f"{cost.size:>5} {cost.solver:<38}{ffts} {cost.final_gap:>9.1e} {certified:>9} "
        f"{cost.transforms:>7.0f}"
    )
