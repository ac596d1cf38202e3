"""All experiments, one after the other, and the report of what they found.

A finished step is kept in the output folder under the digest of the program that measured it, so
that a run that was killed goes on where it was, and a changed program measures anew. After each
experiment ``results.json`` and ``report.html`` are written, whole.
"""

from __future__ import annotations

import base64
import hashlib
import json
import platform
import re
import shutil
import traceback
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata, resources
from pathlib import Path
from typing import Any, Literal, Protocol, final

from jinja2 import Environment, StrictUndefined
from pydantic import Field

from domesim.errors import InputError
from domesim.frames import write_whole
from domesim.host.cores import cores
from domesim.pathtrace.llvm import told
from domesim.pathtrace.tracer import all_or_nothing
from validation.experiment import Experiment, Finding, Missing, Record, Work, load_experiment
from validation.experiments import EXPERIMENTS, GROUPS

AS_EXPECTED, NOT_AS_EXPECTED = "as expected", "not as expected"
NOT_RUN, BROKEN = "not run", "broken"
STEPS = ".domesim-steps"
"""Folder of finished steps, in the output folder."""
_OF_STEPS = re.compile(r"[0-9a-f]{16}-(quick|full)-[0-9]+")

FAILED = (NOT_AS_EXPECTED, BROKEN)
"""Statuses of experiments, one of which is enough for the run to have failed."""

_PACKAGES = ("domesim", "compensate", "validation", "scenes")
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
class Outcome(Record):
    """What became of one experiment."""

    name: str = Field(description="Module of validation.experiments.")
    claim: str
    rationale: str
    expected: str
    status: Literal["as expected", "not as expected", "not run", "broken"]
    note: str = Field(default="", description="Why it was not run, or how it broke.")
    seconds: float = Field(description="Time that its steps took, s.")
    run: str = Field(
        default="",
        description="Start and program (SHA-256) of the run that it was taken over from, if any.",
    )
    finding: Finding | None = None


@final
class Results(Record):
    """Everything that a run found; `results.json` without the drawings."""

    format: Literal["domesim validation 1"] = "domesim validation 1"
    quick: bool = Field(description="Whether minutes mattered more than accuracy.")
    seed: int
    started: str = Field(description="When it was started or resumed, ISO 8601, UTC.")
    seconds: float = Field(description="Time of all steps, those of resumed runs included, s.")
    planned: int = Field(description="How many experiments the run has, done or still to do.")
    available: int = Field(description="How many there are.")
    machine: Mapping[str, str]
    versions: Mapping[str, str]
    code: str = Field(description="SHA-256 of the program and its scenes.")
    experiments: tuple[Outcome, ...]

    @property
    def passed(self) -> bool:
        """Whether nothing was other than expected, or broke."""
        return not any(one.status in FAILED for one in self.experiments)

    def figures(self) -> dict[str, float | None]:
        """All figures to be quoted, by name."""
        found = (one.finding for one in self.experiments if one.finding is not None)
        return {name: figure for finding in found for name, figure in finding.figures.items()}

    def json_text(self) -> str:
        """What results.json holds: everything but the drawings."""
        drawings: Any = {
            "plots": {"__all__": {"svg"}},
            "pictures": {"__all__": {"panels": {"__all__": {"data"}}}},
        }
        return self.model_dump_json(
            indent=1, exclude={"experiments": {"__all__": {"finding": drawings}}}
        )


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
) -> Results:
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
    code = source_digest()
    experiments = {name: load_experiment(name) for name in names}
    steps = out / STEPS
    kept = steps / f"{code[:16]}-{'quick' if quick else 'full'}-{seed}"
    for folder in steps.glob("*"):
        if _OF_STEPS.fullmatch(folder.name) and not folder.name.startswith(code[:16]):
            shutil.rmtree(folder, ignore_errors=True)
    for name in names if fresh else ():
        shutil.rmtree(kept / name, ignore_errors=True)
    started = datetime.now(UTC).isoformat(timespec="seconds")
    machine, versions = _machine(), _versions()
    outcomes: list[Outcome] = []
    for name in names:
        listener.starts(name)
        if source_digest() != code:
            raise InputError("the program was changed while it ran; start again")
        work = Work(quick=quick, seed=seed, store=kept / name, note=listener.note)
        outcomes.append(_outcome(experiments[name], work))
        listener.ends(outcomes[-1])
        results = Results(
            quick=quick,
            seed=seed,
            started=started,
            seconds=sum(one.seconds for one in outcomes),
            planned=len(names),
            available=len(EXPERIMENTS),
            machine=machine,
            versions=versions,
            code=code,
            experiments=tuple(outcomes),
        )
        write_whole(out / "results.json", results.json_text().encode())
        write_whole(out / "report.html", report_page(results).encode())
    return results


def schema() -> dict[str, Any]:
    """JSON schema of results.json."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **Results.model_json_schema(mode="serialization"),
    }


def report_page(results: Results) -> str:
    """The report, one self-contained page."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["duration"] = duration
    environment.filters["image"] = _image
    done = {one.name: one for one in results.experiments}
    groups = {
        title: [done[name] for name in names if name in done] for title, names in GROUPS.items()
    }
    return environment.from_string(_resource("report.html.j2")).render(
        results=results,
        groups={title: outcomes for title, outcomes in groups.items() if outcomes},
        failed=[one for one in results.experiments if one.status in FAILED],
        not_run=[one for one in results.experiments if one.status == NOT_RUN],
        advice=[one for one in results.experiments if one.finding and one.finding.advice],
        style=_resource("report.css"),
    )


def duration(seconds: float) -> str:
    """A time for people, such as 3 min 20 s."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


def source_digest() -> str:
    """SHA-256 of the program, its scenes and the libraries' versions: the same figures' origin."""
    digest = hashlib.sha256(repr([told(), *sorted(_versions().items())]).encode())
    for package in _PACKAGES:
        root = Path(str(resources.files(package)))
        for path in sorted(root.rglob("*")):
            if path.suffix in (".py", ".toml", ".exr"):
                digest.update(path.relative_to(root).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()


def _outcome(experiment: Experiment, work: Work) -> Outcome:
    """One experiment; whatever goes wrong in it is its outcome."""

    def outcome(status: str, note: str = "", finding: Finding | None = None) -> Outcome:
        return Outcome.model_validate(
            {
                "name": experiment.name,
                "claim": experiment.claim,
                "rationale": experiment.rationale,
                "expected": experiment.expected,
                "status": status,
                "note": note,
                "seconds": work.seconds,
                "finding": finding,
            }
        )

    try:
        with all_or_nothing():
            finding = experiment.run(work)
    except Missing as missing:
        return outcome(NOT_RUN, str(missing))
    except Exception:
        return outcome(BROKEN, traceback.format_exc(limit=-3))
    return outcome(AS_EXPECTED if finding.passed else NOT_AS_EXPECTED, finding=finding)


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


if __name__ == "__main__":
    print(json.dumps(schema(), indent=1))
