"""The README, with its figures from ``results.json`` of a full run.

``python -m validation.readme [RESULTS]`` takes new results (kept as ``validation/results.json``)
and writes README.md from ``validation/templates/README.md.j2``; ``make readme``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined

from domesim.errors import InputError

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "validation" / "results.json"
TEMPLATE = ROOT / "validation" / "templates" / "README.md.j2"


def readme(results: Mapping[str, Any]) -> str:
    """The README's text.

    Parameters
    ----------
    results
        What results.json holds.

    Raises
    ------
    InputError
        If they are of a quick run, not as expected, or lack a figure.
    """
    if results["quick"]:
        raise InputError("the README quotes full runs, got the results of a quick one")
    bad = [one["name"] for one in results["experiments"] if one["status"] != "as expected"]
    if bad:
        raise InputError(f"the README quotes what is as expected, got others: {', '.join(bad)}")
    figures = {
        name: figure
        for one in results["experiments"]
        for name, figure in one["finding"]["figures"].items()
    }

    def quoted(name: str, form: str) -> str:
        if name not in figures:
            raise InputError(f"the README quotes {name}, which the results do not have")
        return "never" if figures[name] is None else form.format(figures[name])

    environment = Environment(
        undefined=StrictUndefined, keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["figure"] = quoted
    facts = {"machine": results["machine"], "seconds": results["seconds"]}
    return environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(facts)


def main(source: Path) -> None:
    """Write README.md, and keep the results that it quotes."""
    text = source.read_text(encoding="utf-8")
    page = readme(json.loads(text))
    RESULTS.write_text(text.rstrip() + "\n", encoding="utf-8")
    (ROOT / "README.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS)
