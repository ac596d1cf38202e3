"""Subcommands that show what may be believed: validate, bench."""

from __future__ import annotations

import json as json_module
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, final

import typer

from domesim.cli import Json, Quiet, SceneName
from domesim.console import Console, prepare
from domesim.errors import InputError
from domesim.frames import write_whole
from domesim.scene import load_scene
from validation.benchmarks.solvers import GAPS, Cost, costs
from validation.experiments import EXPERIMENTS
from validation.report import FAILED, NOT_RUN, Outcome, duration
from validation.report import validate as run_experiments


def validate(
    out: Annotated[
        Path, typer.Option("--out", help="Folder for report.html and results.json.")
    ] = Path("out/validation"),
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Fewer cases and larger errors: minutes instead of an hour."),
    ] = False,
    only: Annotated[
        str | None,
        typer.Option(help=f"Just these experiments, by commas: {', '.join(EXPERIMENTS)}."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of all random numbers.", min=0)] = 0,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Measure anew what the folder already holds.")
    ] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run the experiments that show what may be believed, and write a report.

    A run that was killed goes on where it was. Exits with 1 if anything is not as expected.
    """
    console = Console(quiet=quiet, json=json)
    names = EXPERIMENTS if only is None else tuple(name.strip() for name in only.split(","))
    prepare(out)
    with console.progress("validating", len(names)) as start:
        results = run_experiments(
            out, _Listener(console, start), names=names, quick=quick, seed=seed, fresh=fresh
        )
    bad = [one.name for one in results.experiments if one.status in FAILED]
    console.figures(
        {
            "report": str(out / "report.html"),
            "passed": results.passed,
            "experiments": {one.name: one.status for one in results.experiments},
            "figures": results.figures(),
        }
    )
    console.say(
        f"{len(names)} of {len(EXPERIMENTS)} experiments, {duration(results.seconds)}: "
        + (f"not as expected: {', '.join(bad)}" if bad else "nothing other than expected")
    )
    console.say(f"Open {(out / 'report.html').resolve()}")
    if bad:
        raise typer.Exit(1)


@final
class _Listener:
    def __init__(self, console: Console, start: Callable[[str], None]) -> None:
        self._console, self.starts, self.note = console, start, console.note

    def ends(self, outcome: Outcome) -> None:
        text = f"{outcome.status:<16}{outcome.name:<22}{duration(outcome.seconds):>12}"
        if outcome.status == NOT_RUN:
            text += f"  {outcome.note}"
        elif outcome.finding is None:
            text += f"\n{outcome.note}"
        else:
            text += "".join(
                f"\n    {check.what}: {check.written}, expected {check.expected}"
                for check in outcome.finding.checks
                if not check.passed
            )
            left_out = (why.partition(". ")[0] for why in outcome.finding.left_out)
            text += "".join(f"\n    left out: {what}" for what in left_out)
        self._console.say(text)


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
    write_whole(out / "bench.json", json_module.dumps(found, indent=1).encode())
    console.figures({"scene": scene, "costs": found})


def _row(cost: Cost) -> str:
    ffts = " ".join(f"{'never' if n is None else n:>8}" for n in cost.ffts)
    certified = "-" if cost.certified_gap is None else f"{cost.certified_gap:.1e}"
    return (
        f"{cost.size:>5} {cost.solver:<38}{ffts} {cost.final_gap:>9.1e} {certified:>9} "
        f"{cost.transforms:>7.0f}"
    )
