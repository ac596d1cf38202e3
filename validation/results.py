"""Figures of experiments, and which of them are older than the code that they are of.

A run writes its figures to ``results.json`` beside its report. ``validation/results.json`` is of
the same kind: it has what README and docs quote, each experiment's with the digest of the modules
that it was measured with (`validation.origin`), the machine and the date.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Final, Literal, final

from pydantic import Field, ValidationError

from domesim.errors import InputError
from domesim.frames import write_whole
from validation.experiment import Number, Record
from validation.experiments import EXPERIMENTS
from validation.origin import ROOT, digest

Status = Literal["as expected", "not as expected", "not judged", "not run", "broken"]
AS_EXPECTED: Final = "as expected"
NOT_AS_EXPECTED: Final = "not as expected"
NOT_JUDGED: Final = "not judged"
NOT_RUN: Final = "not run"
BROKEN: Final = "broken"
MEASURED = (AS_EXPECTED, NOT_AS_EXPECTED)
PUBLISHED = ROOT / "validation" / "results.json"


@final
class Entry(Record):
    """What became of one experiment."""

    status: Status
    date: str = Field(description="When it ended, ISO 8601, UTC.")
    machine: str
    code: str = Field(description="SHA-256 of the modules and files that it rests on.")
    seconds: float = Field(description="Time that its steps took, s.")
    failed: tuple[str, ...] = Field(default=(), description="Checks that are not as expected.")
    figures: Mapping[str, Number] = Field(default={}, description="By name.")


@final
class Results(Record):
    """Figures of a run, or those that are published."""

    format: Literal["domesim figures 1"] = "domesim figures 1"
    quick: bool = Field(default=False, description="Whether minutes mattered more than accuracy.")
    seed: int = 0
    experiments: Mapping[str, Entry] = {}

    @property
    def figures(self) -> dict[str, float | None]:
        """Figures of all experiments, by name."""
        return {
            name: value
            for entry in self.experiments.values()
            for name, value in entry.figures.items()
        }

    @classmethod
    def read(cls, path: Path) -> Results:
        """Read a ``results.json``.

        Raises
        ------
        InputError
            If there is none, or it is something else.
        """
        try:
            return cls.model_validate_json(path.read_bytes())
        except (OSError, ValidationError) as fault:
            raise InputError(f"{path}: wanted results of domesim validate, got {fault}") from None

    def write(self, path: Path) -> None:
        """Write them, whole."""
        write_whole(path, (self.model_dump_json(indent=1) + "\n").encode())


def merged(published: Results, new: Results, quoted: Collection[str]) -> Results:
    """The newer of what is published and what a run found, experiment by experiment.

    Parameters
    ----------
    published
        Published results. Those of experiments that there are no more are left out.
    new
        A full run's. What was not run, is broken or lacks a quoted figure is left out.
    quoted
        Names of the figures to keep.

    Raises
    ------
    InputError
        If the run was quick or of another seed.
    """
    if new.quick or new.seed:
        raise InputError(
            f"wanted a full run of seed 0 to publish, got quick {new.quick}, seed {new.seed}"
        )
    found = dict(published.experiments)
    for name, entry in new.experiments.items():
        kept = found.get(name)
        if entry.status in MEASURED and (kept is None or _replaces(entry, kept, quoted)):
            found[name] = entry
    return Results(
        experiments={
            name: found[name].model_copy(update={"figures": _only(quoted, found[name].figures)})
            for name in EXPERIMENTS
            if name in found
        }
    )


def _replaces(new: Entry, kept: Entry, quoted: Collection[str]) -> bool:
    """Whether it is newer, and lacks no figure that is quoted, as for want of a package."""
    return new.date > kept.date and _only(quoted, kept.figures).keys() <= new.figures.keys()


def _only(names: Collection[str], figures: Mapping[str, Number]) -> dict[str, Number]:
    return {name: value for name, value in figures.items() if name in names}


def old(published: Results) -> list[str]:
    """Names of experiments whose code is not that which the published figures are of."""
    entries = published.experiments
    return [
        name for name in EXPERIMENTS if name not in entries or entries[name].code != digest(name)
    ]
