"""The README and pages of the docs, with their figures from ``results.json`` of a full run.

``python -m validation.readme [RESULTS]`` takes new results (kept as ``validation/results.json``)
and writes each page of `PAGES` from its template in ``validation/templates``; ``make readme``.
Results of some experiments only replace those experiments' in what is kept; the others are marked
with the run that they are of.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined

from domesim.errors import InputError
from domesim.frames import write_whole
from validation.experiments import EXPERIMENTS

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "validation" / "results.json"
TEMPLATES = ROOT / "validation" / "templates"
PAGES = ("README.md", "docs/evidence.md", "docs/limits.md")
"""From the repository's root; a template is named as its page is."""


def written(page: str, results: Mapping[str, Any]) -> str:
    """The text of a page.

    Parameters
    ----------
    page
        One of `PAGES`.
    results
        What results.json holds.

    Raises
    ------
    InputError
        If they are of a quick run, not as expected, or lack a figure.
    """
    if results["quick"]:
        raise InputError("the pages quote full runs, got the results of a quick one")
    bad = [one["name"] for one in results["experiments"] if one["status"] != "as expected"]
    if bad:
        raise InputError(f"the pages quote what is as expected, got others: {', '.join(bad)}")
    figures = {
        name: figure
        for one in results["experiments"]
        for name, figure in one["finding"]["figures"].items()
    }

    def quoted(name: str, form: str) -> str:
        if name not in figures:
            raise InputError(f"{page} quotes {name}, which the results do not have")
        return "never" if figures[name] is None else form.format(figures[name])

    environment = Environment(
        undefined=StrictUndefined, keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["figure"] = quoted
    facts = {"machine": results["machine"], "seconds": results["seconds"]}
    template = TEMPLATES / f"{Path(page).name}.j2"
    return environment.from_string(template.read_text(encoding="utf-8")).render(facts)


def brought_up_to_date(kept: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Results of a run of some experiments, with the others taken over from those kept.

    Raises
    ------
    InputError
        If they are of other machines, seeds or accuracies.
    """
    for key in ("quick", "seed", "machine"):
        if kept[key] != new[key]:
            raise InputError(
                f"wanted results of one machine, seed and accuracy, got {key} {kept[key]} and "
                f"{new[key]}; run all experiments anew"
            )
    fresh = {one["name"]: one for one in new["experiments"]}
    origin = f"{kept['started']}, {kept['code'][:16]}"
    old = {one["name"]: {**one, "run": one.get("run") or origin} for one in kept["experiments"]}
    found = {**old, **fresh}
    experiments = [found[name] for name in EXPERIMENTS if name in found]
    return {
        **new,
        "planned": len(experiments),
        "seconds": sum(one["seconds"] for one in experiments),
        "versions": {**kept["versions"], **new["versions"]},
        "experiments": experiments,
    }


def main(source: Path) -> None:
    """Write the pages, and keep the results that they quote."""
    results = json.loads(source.read_text(encoding="utf-8"))
    if source != RESULTS and results["planned"] < results["available"]:
        kept = json.loads(RESULTS.read_text(encoding="utf-8"))
        results = brought_up_to_date(kept, results)
    pages = {page: written(page, results) for page in PAGES}
    text = json.dumps(results, indent=1, ensure_ascii=False) + "\n"
    write_whole(RESULTS, text.encode())
    for page, body in pages.items():
        write_whole(ROOT / page, body.encode())


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS)
