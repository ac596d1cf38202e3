"""Experiments whose published figures are older than their code, run in full: ``make full``.

``python -m validation.renew [NAME,...]`` runs these, or those named. Each one's figures are
published (``validation/results.json``) as soon as it ends, so that a run that was stopped goes on
where it was. ``make readme`` writes them into the pages.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import final

from domesim.errors import InputError
from domesim.host.console import Console
from domesim.host.writing import prepare_folder
from validation.cli import Listener
from validation.readme import quoted
from validation.report import Outcome, validate
from validation.results import PUBLISHED, Results, merged, old

OUT = Path("out/full")


@final
class Publisher:
    """Publishes what a run finds, and says how it gets on.

    Parameters
    ----------
    listener
        Prints.
    published
        File of the published results.
    """

    def __init__(self, listener: Listener, published: Path = PUBLISHED) -> None:
        self._listener, self._published = listener, published
        self.starts, self.note = listener.starts, listener.note

    def ends(self, outcome: Outcome) -> None:
        """Publish an experiment's figures, if it was run."""
        self._listener.ends(outcome)
        found = Results(experiments={outcome.name: outcome.entry})
        merged(Results.read(self._published), found, quoted()).write(self._published)


def main(names: list[str]) -> bool:
    """Run experiments and publish their figures; whether all are as expected."""
    console = Console()
    names = names or old(Results.read(PUBLISHED))
    console.say(f"To run: {', '.join(names) or 'nothing is older than its code'}")
    prepare_folder(OUT)
    with console.progress("renewing", len(names)) as start:
        run = validate(OUT, Publisher(Listener(console, start)), names=names)
    console.say(f"Open {(OUT / 'report.html').resolve()}. Then: make readme")
    return run.passed


if __name__ == "__main__":
    try:
        sys.exit(0 if main([name for name in ",".join(sys.argv[1:]).split(",") if name]) else 1)
    except InputError as fault:
        sys.exit(f"validation.renew: {fault}")
