"""A method of one's own, entered among the project's: the same inputs, laws and judges.

    from validation.entry import enter
    print(enter("gamma", lambda master, scene: master ** 1.2))

Inputs are those of the reporting half (`validation.inputs`), on which no setting was chosen.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TypeAlias, final

from domesim.light import Light
from domesim.scene import Scene
from validation import inputs, panel
from validation.experiment import Column, Table, Work
from validation.experiments.quality import verdict
from validation.experiments.quality.measuring import DEFAULT, NOTHING, SUBTRACTION, WAYS, Case, Cell
from validation.experiments.quality.measuring import measure as measured

Method: TypeAlias = Callable[[Light, Scene], Light]
"""A master in 0..1, (view, row, col, primary), and where -> the light to project, 0..1."""


HEADINGS = (
    "kind",
    "method",
    "by",
    "cases",
    "laws broken",
    *(judge.name for judge in panel.PANEL),
    "mean rank",
)
"""Of ``validation/leaderboard.csv``."""


@final
@dataclass(frozen=True)
class Entered:
    """What is found of a method beside doing nothing, subtraction and the default.

    Parameters
    ----------
    name
        What it is called.
    tables
        By kind of input: laws broken, each judge's mean, the mean rank.
    left_out
        Inputs and judges that are missing.
    """

    name: str
    tables: tuple[Table, ...]
    left_out: tuple[str, ...]

    def __str__(self) -> str:
        """The tables in Markdown."""
        lines: list[str] = []
        for table in self.tables:
            rows = [[column.name for column in table.columns], ["---"] * len(table.columns)]
            lines += [table.caption, ""]
            lines += [f"| {' | '.join(row)} |" for row in [*rows, *table.written()]] + [""]
        return "\n".join([*lines, *self.left_out])

    def entry(self, by: str) -> str:
        """Lines of ``validation/leaderboard.csv``, one a kind of input.

        Parameters
        ----------
        by
            Who entered it, and where its code is.
        """
        memory = io.StringIO()
        rows = csv.DictWriter(memory, HEADINGS, lineterminator="\n")
        for table in self.tables:
            names = [
                column.name.removesuffix(" (+)").removesuffix(" (-)") for column in table.columns
            ]
            (found,) = (row for row in table.rows if row[0] == self.name)
            kind = table.caption.split()[1].rstrip(":")
            told = dict(zip(names[1:], found[1:], strict=True))
            rows.writerow({"kind": kind, "method": self.name, "by": by, **told})
        return memory.getvalue().rstrip("\n")


def enter(
    name: str, method: Method, *, only: Sequence[str] = (), quick: bool = False,
    store: Path | None = None,
) -> Entered:  # fmt: skip
    """Measures a method of one's own as `quality` measures the project's.

    Parameters
    ----------
    name
        What it is called.
    method
        Makes the light to project of a master.
    only
        Names of inputs; all of the reporting half by default, which takes the better part of an
        hour.
    quick
        Two small inputs, without judges: whether it works.
    store
        Folder for what judges said of light (`validation.hearing`): the project's own ways are
        then judged once.

    Returns
    -------
    entered
        Prints as tables.
    """
    work = Work(quick=quick)
    wanted, left_out = inputs.wanted(work)
    judges = () if quick else panel.PANEL
    cells: dict[inputs.Place, dict[str, Cell]] = {}
    for title, one in wanted.items():
        if title not in (only or wanted) or (title in inputs.CHOOSING and not quick):
            continue
        light = cache(one.read)
        for place in inputs.places(work, title, one):
            case = Case(one, light, one.scene(*place[1:]))
            ask = partial(measured, case, judges=judges, store=store)
            ways = {way: ask(WAYS[way]) for way in (NOTHING, SUBTRACTION, DEFAULT)}
            cells[place] = {**ways, name: ask(method)}
    missing = [
        each.name for each in judges if not all(_heard(each, ways) for ways in cells.values())
    ]
    heard = [each for each in judges if each.name not in missing]
    tables = (
        _table(kind, some, heard)
        for kind in inputs.kinds(wanted)
        if (some := verdict.of_kind(cells, wanted, kind))
    )
    return Entered(name, tuple(tables), (*left_out, *(f"{judge}: not judged" for judge in missing)))


def _heard(judge: panel.Judge, ways: dict[str, Cell]) -> bool:
    return all(judge.name in cell.judged for cell in ways.values())


def _table(kind: str, cells: verdict.Cells, judges: Sequence[panel.Judge]) -> Table:
    ways = list(next(iter(cells.values())))
    ranks = verdict.ranks(cells, judges) if judges else dict.fromkeys(ways)
    rows = [
        (
            way,
            len(cells),
            sum(len(verdict.laws_broken(each[way])) for each in cells.values()),
            *(verdict.mean_of(cells, judge, way) for judge in judges),
            ranks[way],
        )
        for way in ways
    ]
    signs = [f"{judge.name} ({'+' if judge.higher_is_better else '-'})" for judge in judges]
    return Table(
        caption=f"Reporting {kind}: laws broken, and the means of all judges (+: more is better).",
        columns=(
            Column(name="way"),
            Column(name="cases"),
            Column(name="laws broken"),
            *(Column(name=sign, digits=".4g") for sign in signs),
            Column(name="mean rank", digits=".2f"),
        ),
        rows=tuple(rows),
    )
