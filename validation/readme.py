"""README and pages of the docs, with their figures from ``validation/results.json``.

``python -m validation.readme [RESULTS ...]`` takes over results of full runs, also of other
machines, and writes each page of `PAGES` from its template in ``validation/templates``; ``make
readme``. A figure that is older than its code is refused: ``make full`` renews it.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable
from pathlib import Path

from jinja2 import Environment, StrictUndefined

from domesim.errors import InputError
from domesim.frames import write_whole
from validation.origin import ROOT
from validation.results import PUBLISHED, Results, merged, old

TEMPLATES = ROOT / "validation" / "templates"
PAGES = ("README.md", "docs/evidence.md", "docs/leaderboard.md", "docs/limits.md")
"""From the repository's root; a template is named as its page is."""


ENTRIES = ROOT / "validation" / "leaderboard.csv"
"""Methods of others, as `validation.entry.Entered.entry` writes them."""


def written(page: str, results: Results) -> str:
    """The text of a page.

    Parameters
    ----------
    page
        One of `PAGES`.
    results
        Published results.

    Raises
    ------
    InputError
        If they lack a figure.
    """
    figures = results.figures

    def figure(name: str, form: str) -> str:
        if name not in figures:
            raise InputError(f"{page} quotes {name}, which the results do not have")
        return "never" if figures[name] is None else form.format(figures[name]).replace("%", " %")

    return _rendered(page, figure, results)


def quoted() -> set[str]:
    """Names of the figures that the pages quote."""
    names: set[str] = set()

    def figure(name: str, form: str) -> str:
        names.add(name)
        return form

    for page in PAGES:
        _rendered(page, figure, Results())
    return names


def _rendered(page: str, figure: Callable[[str, str], str], results: Results) -> str:
    environment = Environment(
        undefined=StrictUndefined, keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["figure"] = figure
    environment.filters["machine"] = lambda name: _machine(results, name)
    template = TEMPLATES / f"{Path(page).name}.j2"
    text = template.read_text(encoding="utf-8")
    with ENTRIES.open(encoding="utf-8", newline="") as file:
        entries = list(csv.DictReader(file))
    return environment.from_string(text).render(experiments=results.experiments, entries=entries)


def _machine(results: Results, experiment: str) -> str:
    return results.experiments[experiment].machine if experiment in results.experiments else ""


def refuse_old(results: Results) -> None:
    """See that each experiment that is quoted is as old as its code.

    Raises
    ------
    InputError
        If not; with the command that renews it.
    """
    names = [
        name
        for name in old(results)
        if name in results.experiments and results.experiments[name].figures
    ]
    if names:
        raise InputError(
            f"wanted figures of today's code, got older ones of {', '.join(names)}; "
            f"renew them: make full ONLY={','.join(names)}"
        )


def main(*sources: Path) -> None:
    """Take over results, and write the pages that quote them."""
    results = Results.read(PUBLISHED)
    for source in sources:
        results = merged(results, Results.read(source), quoted())
    pages = {page: written(page, results) for page in PAGES}
    results.write(PUBLISHED)
    refuse_old(results)
    for page, body in pages.items():
        write_whole(ROOT / page, body.encode())


if __name__ == "__main__":
    try:
        main(*map(Path, sys.argv[1:]))
    except InputError as fault:
        sys.exit(f"validation.readme: {fault}")
