"""All experiments, one after the other, and the report of what they found.

A finished step is kept in the output folder under the digest of the code that measured it, so that
a run that was killed goes on where it was, and changed code measures anew. After each experiment
``results.json`` and ``report.html`` are written, whole.
"""

from __future__ import annotations

import base64
import hashlib
import platform
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib import metadata, resources
from pathlib import Path
from typing import Protocol, final

from jinja2 import Environment, StrictUndefined

from domesim.errors import InputError
from domesim.frames import write_whole
from domesim.host.cores import cores
from domesim.host.writing import is_own, prepare, remove_own, require_own
from domesim.pathtrace.llvm import told
from domesim.pathtrace.tracer import all_or_nothing
from validation.experiment import Experiment, Finding, Missing, Work, load_experiment
from validation.experiments import EXPERIMENTS, GROUPS
from validation.origin import digest
from validation.results import (
    AS_EXPECTED,
    BROKEN,
    NOT_AS_EXPECTED,
    NOT_JUDGED,
    NOT_RUN,
    Entry,
    Results,
    Status,
)

STEPS, HEARD = ".domesim-steps", "heard"
"""Folder of finished steps, in the output folder, and of what judges said, in that."""

FAILED = (NOT_AS_EXPECTED, BROKEN)
"""Statuses of experiments, one of which is enough for the run to have failed."""

_VERSIONS = (
    "domesim",
    "numpy",
    "scipy",
    "mitsuba",
    "drjit",
    "statsmodels",
    "flip-evaluator",
    "cvvdp",
    "pyradiance",
)


@final
@dataclass(frozen=True)
class Outcome:
    """What became of one experiment.

    Attributes
    ----------
    experiment
        Which one.
    entry
        Its figures.
    note
        Why it was not run, or how it broke.
    finding
        What it found, if anything.
    """

    experiment: Experiment
    entry: Entry
    note: str = ""
    finding: Finding | None = None

    @property
    def name(self) -> str:
        """Module of `validation.experiments`."""
        return self.experiment.name

    @property
    def status(self) -> str:
        """As expected, or not; not judged; not run; broken."""
        return self.entry.status


@final
@dataclass(frozen=True)
class Run:
    """A run of experiments, or what is done of it.

    Attributes
    ----------
    quick
        Whether minutes mattered more than accuracy.
    seed
        Seed of all random numbers.
    started
        When it was started or resumed, ISO 8601, UTC.
    planned
        How many experiments it has, done or still to do.
    machine, versions
        What it ran on.
    outcomes
        Experiments that are done.
    """

    quick: bool
    seed: int
    started: str
    planned: int
    machine: Mapping[str, str]
    versions: Mapping[str, str]
    outcomes: tuple[Outcome, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether nothing was other than expected, or broke."""
        return not any(one.status in FAILED for one in self.outcomes)

    @property
    def seconds(self) -> float:
        """Time of all steps, those of resumed runs included, s."""
        return sum(one.entry.seconds for one in self.outcomes)

    @property
    def results(self) -> Results:
        """Its figures."""
        entries = {one.name: one.entry for one in self.outcomes}
        return Results(quick=self.quick, seed=self.seed, experiments=entries)


class Listener(Protocol):
    """Told how a run gets on."""

    def starts(self, name: str) -> None:
        """An experiment begins."""

    def note(self, text: str) -> None:
        """A step of it begins."""

    def ends(self, outcome: Outcome) -> None:
        """It is done."""


def validate(
    out: Path,
    listener: Listener,
    *,
    names: Sequence[str] = EXPERIMENTS,
    quick: bool = False,
    seed: int = 0,
    fresh: bool = False,
) -> Run:
    """Run experiments, and write ``results.json`` and ``report.html`` after each.

    Parameters
    ----------
    out
        Folder for the results and for the finished steps; it exists.
    listener
        Told how it gets on.
    names
        Which of `EXPERIMENTS`.
    quick
        Whether minutes matter more than accuracy.
    seed
        Seed of all random numbers.
    fresh
        Measure everything anew.

    Raises
    ------
    InputError
        If there is no such experiment, the folder cannot be written, or the program changes while
        it runs.
    """
    if unknown := [name for name in names if name not in EXPERIMENTS]:
        raise InputError(
            f"no experiment is called {', '.join(unknown)}; there are {', '.join(EXPERIMENTS)}"
        )
    experiments = {name: load_experiment(name) for name in names}
    code = {name: digest(name) for name in names}
    started = datetime.now(UTC).isoformat(timespec="seconds")
    run = Run(quick, seed, started, len(names), _machine(), _versions())
    stores = {name: _store(out / STEPS / name, run, code[name]) for name in names}
    for store in stores.values():
        require_own(store)
    for name in names:
        listener.starts(name)
        if digest(name) != code[name]:
            raise InputError("the program was changed while it ran; start again")
        store = stores[name]
        _remove_others(store)
        if fresh:
            remove_own(store)
        heard = None if fresh else out / STEPS / HEARD
        work = Work(quick=quick, seed=seed, store=store, note=listener.note, heard=heard)
        outcome = _outcome(experiments[name], work, run.machine, code[name])
        run = replace(run, outcomes=(*run.outcomes, outcome))
        run.results.write(out / "results.json")
        write_whole(out / "report.html", report_page(run).encode())
        listener.ends(outcome)
    return run


def report_page(run: Run) -> str:
    """The report, one self-contained page."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["duration"] = duration
    environment.filters["image"] = _image
    done = {one.name: one for one in run.outcomes}
    groups = {
        title: [done[name] for name in names if name in done] for title, names in GROUPS.items()
    }
    return environment.from_string(_resource("report.html.j2")).render(
        run=run,
        available=len(EXPERIMENTS),
        groups={title: outcomes for title, outcomes in groups.items() if outcomes},
        failed=[one for one in run.outcomes if one.status in FAILED],
        not_judged=[one for one in run.outcomes if one.status == NOT_JUDGED],
        not_run=[one for one in run.outcomes if one.status == NOT_RUN],
        advice=[one for one in run.outcomes if one.finding and one.finding.advice],
        style=_resource("report.css"),
    )


def write_figures(run: Run, folder: Path) -> list[Path]:
    """Write what a run drew and counted, for a paper.

    Parameters
    ----------
    run
        Its outcomes.
    folder
        Where to.

    Returns
    -------
    written
        Of each plot EXPERIMENT-plot-N.svg, .pdf and .csv; of each table EXPERIMENT-table-N.csv.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    files: dict[str, bytes] = {}
    for one in run.outcomes:
        if one.finding is None:
            continue
        for number, plot in enumerate(one.finding.plots, 1):
            stem = f"{one.name}-plot-{number}"
            files |= {f"{stem}.svg": plot.svg.encode(), f"{stem}.pdf": plot.pdf}
            files[f"{stem}.csv"] = plot.data.encode()
        for number, table in enumerate(one.finding.tables, 1):
            files[f"{one.name}-table-{number}.csv"] = table.csv.encode()
    prepare(*(folder / name for name in files))
    for name, content in files.items():
        write_whole(folder / name, content)
    return [folder / name for name in files]


def duration(seconds: float) -> str:
    """A time for people, such as 3 min 20 s."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


def _store(folder: Path, run: Run, code: str) -> Path:
    """Folder of an experiment's steps: of this code, machine and packages."""
    origin = hashlib.sha256(repr((code, run.machine, run.versions)).encode()).hexdigest()[:16]
    return folder / f"{origin}-{'quick' if run.quick else 'full'}-{run.seed}"


def _remove_others(store: Path) -> None:
    """Remove an experiment's steps of other code."""
    origin, _, _ = store.name.partition("-")
    for other in store.parent.glob("*"):
        if not other.name.startswith(origin) and is_own(other):
            remove_own(other)


def _outcome(experiment: Experiment, work: Work, machine: Mapping[str, str], code: str) -> Outcome:
    """One experiment; whatever goes wrong in it is its outcome."""
    finding, note = None, ""
    status: Status
    try:
        with all_or_nothing():
            finding = experiment.run(work)
        status = AS_EXPECTED if finding.judged else NOT_JUDGED
        if not finding.passed:
            status = NOT_AS_EXPECTED
    except Missing as missing:
        status, note = NOT_RUN, str(missing)
    except Exception:
        status, note = BROKEN, traceback.format_exc(limit=-3)
    entry = Entry(
        status=status,
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        machine=f"{machine['processor']}, {machine['cores']} cores",
        code=code,
        seconds=work.seconds,
        failed=finding.failed if finding else (),
        figures=finding.figures if finding else {},
    )
    return Outcome(experiment, entry, note, finding)


def _machine() -> dict[str, str]:
    return {
        "processor": _processor(),
        "cores": str(cores()),
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "paths are traced by": told(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _versions() -> dict[str, str]:
    found = {}
    for package in _VERSIONS:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def _image(svg: str) -> str:
    """A drawing as a data URI: its names cannot clash with another's."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode()).decode()


def _resource(name: str) -> str:
    return resources.files("validation").joinpath("templates", name).read_text(encoding="utf-8")
