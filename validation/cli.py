"""Subcommands that show what may be believed: validate, bench."""

from __future__ import annotations

import platform
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Annotated, final

import typer

from domesim.commands.options import Json, Quiet
from domesim.errors import InputError
from domesim.host.console import Console
from domesim.host.cores import cores
from domesim.host.writing import prepare, prepare_folder
from validation.benchmarks import copying, passes, writing
from validation.benchmarks import files as file_costs
from validation.benchmarks.measuring import Cost, Settings, costs
from validation.benchmarks.problems import PROBLEMS
from validation.benchmarks.solvers import SOLVERS
from validation.experiments import EXPERIMENTS
from validation.report import FAILED, Outcome, duration, write_figures
from validation.report import validate as run_experiments
from validation.results import NOT_JUDGED, NOT_RUN


def validate(
    out: Annotated[
        Path, typer.Option("--out", help="Folder for report.html and results.json.")
    ] = Path("out/validation"),
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Fewer cases and larger errors: minutes instead of hours."),
    ] = False,
    only: Annotated[
        str | None,
        typer.Option(help=f"Just these experiments, by commas: {', '.join(EXPERIMENTS)}."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.", min=0)] = 0,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Measure anew what the folder already holds.")
    ] = False,
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for each plot as SVG and PDF, and its data and tables as CSV."),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run the experiments that show what may be believed, and write a report.

    A run that was killed goes on where it was. Exits with 1 if anything is not as expected.
    """
    console = Console(quiet=quiet, json=json)
    names = EXPERIMENTS if only is None else tuple(name.strip() for name in only.split(","))
    prepare(out / "report.html", out / "results.json")
    if figures is not None:
        prepare_folder(figures)
    with console.progress("validating", len(names)) as start:
        run = run_experiments(
            out, Listener(console, start), names=names, quick=quick, seed=seed, fresh=fresh
        )
    written = [] if figures is None else write_figures(run, figures)
    bad = [one.name for one in run.outcomes if one.status in FAILED]
    unjudged = [one.name for one in run.outcomes if one.status == NOT_JUDGED]
    console.figures(
        {
            "report": str(out / "report.html"),
            "passed": run.passed,
            "written": [str(path) for path in written],
            "experiments": {one.name: one.status for one in run.outcomes},
            "figures": run.results.figures,
        }
    )
    console.say(
        f"{len(names)} of {len(EXPERIMENTS)} experiments, {duration(run.seconds)}: "
        + (f"not as expected: {', '.join(bad)}" if bad else "nothing other than expected")
        + (f"; not judged: {', '.join(unjudged)}" if unjudged else "")
    )
    console.say(f"Open {(out / 'report.html').resolve()}")
    if bad:
        raise typer.Exit(1)


@final
class Listener:
    """Prints how a run gets on."""

    def __init__(self, console: Console, start: Callable[[str], None]) -> None:
        self._console, self.starts, self.note = console, start, console.note

    def ends(self, outcome: Outcome) -> None:
        """Print its status, and the checks that failed."""
        text = f"{outcome.status:<16}{outcome.name:<22}{duration(outcome.entry.seconds):>12}"
        if outcome.status == NOT_RUN:
            text += f"  {outcome.note}"
        elif outcome.finding is None:
            text += f"\n{outcome.note}"
        else:
            text += "".join(f"\n    {told}" for told in outcome.entry.failed)
            left_out = (why.partition(". ")[0] for why in outcome.finding.left_out)
            text += "".join(f"\n    left out: {what}" for what in left_out)
        self._console.say(*text.split("\n"))


def bench(
    out: Annotated[Path, typer.Option("--out", help="Folder for bench.json.")] = Path("out/bench"),
    problems: Annotated[str, typer.Option(help=f"By commas: {', '.join(PROBLEMS)}.")] = ",".join(
        PROBLEMS
    ),
    sizes: Annotated[
        str, typer.Option(help="Widths of the pictures, pixels; a domemaster is as high.")
    ] = "128",
    solvers: Annotated[str, typer.Option(help=f"By commas: {', '.join(SOLVERS)}.")] = ",".join(
        SOLVERS
    ),
    files: Annotated[
        bool,
        typer.Option("--files", help="Instead: time whole commands, single frames and sequences."),
    ] = False,
    workers: Annotated[
        str | None,
        typer.Option(
            help="With --files: time shows of so many workers each, by commas, against as many "
            "copies at once by oiiotool."
        ),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="Fewer FFTs to slow solvers, one timed run; of files, small ones.",
        ),
    ] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Count what solvers cost: FFTs of planes to a true gap, time as multiples.

    The whole matrix takes hours: --sizes 512,1024,2048, then --solvers admm --sizes
    512,1024,2048,4096,8192 (8192 needs 16 GiB and more). Photographs are of the test
    data (DOMESIM_DATA).
    """
    console = Console(quiet=quiet, json=json)
    if files:
        if workers is None:
            _bench_files(out, console, quick=quick)
        else:
            _bench_workers(out, console, _numbers("--workers", workers, 1), quick=quick)
        return
    if workers is not None:
        raise InputError("--workers is of --files; add it, or leave --workers out")
    widths = _numbers("--sizes", sizes, 16)
    wanted = _names("--problems", problems, PROBLEMS)
    tried = _names("--solvers", solvers, SOLVERS)
    settings = Settings(budget=150, repeats=1) if quick else Settings()
    prepare(out / writing.NAME)
    console.say(*writing.LEGEND.split("\n"), "", writing.HEADER)
    machine = {
        "cores": cores(),
        "processor": platform.machine(),
        "budget": settings.budget,
        "repeats": settings.repeats,
    }
    found: list[Cost] = []
    figures = writing.write_figures(out, found, machine)
    for cost in costs(wanted, widths, tried, settings):
        found.append(cost)
        console.say(writing.lines(cost))
        figures = writing.write_figures(out, found, machine)
    console.figures(figures)
    console.say(f"Written: {(out / 'bench.json').resolve()}")


def _bench_files(out: Path, console: Console, *, quick: bool) -> None:
    prepare(out / file_costs.NAME)
    console.say(file_costs.HEADER)
    found = []
    for cost in file_costs.file_costs(quick=quick):
        found.append(cost)
        console.say(file_costs.line(cost))
    parts, gb_per_s = file_costs.frame_passes(quick=quick), file_costs.bandwidth()
    for one in (passes.HEADER, *map(passes.line, parts)):
        console.say(one)
    console.say(f"A core moves {gb_per_s:.1f} GB/s.")
    path = file_costs.write(out, found, parts, gb_per_s)
    console.figures({"files": file_costs.figures(found)})
    console.say(f"Written: {path.resolve()}")


def _bench_workers(out: Path, console: Console, workers: tuple[int, ...], *, quick: bool) -> None:
    prepare(out / copying.NAME)
    console.say(copying.HEADER)
    found = []
    for one in copying.comparisons(workers, quick=quick):
        found.append(one)
        console.say(copying.line(one))
    path = copying.write(out, found)
    console.figures({"shows": [each.figures() for each in found]})
    console.say(f"Written: {path.resolve()}")


def _numbers(option: str, given: str, least: int) -> tuple[int, ...]:
    try:
        numbers = tuple(int(text) for text in given.split(","))
    except ValueError:
        raise InputError(f"{option} takes numbers by commas, got {given!r}") from None
    if min(numbers) < least:
        raise InputError(f"{option} takes numbers of at least {least}, got {min(numbers)}")
    return numbers


def _names(option: str, given: str, known: Collection[str]) -> tuple[str, ...]:
    names = tuple(name.strip() for name in given.split(","))
    for name in names:
        if name not in known:
            raise InputError(f"{option} takes some of {', '.join(known)}, got {name!r}")
    return names
