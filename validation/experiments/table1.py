"""Table 1, remade: on our problems far fewer FFTs do than the paper counts, with ours fewest.

Rationale
    The paper's Table 1 gives FFTs, iterations and seconds of GPCG, in CUDA, for stereo pictures
    of four sizes, of which the smaller are what its prediction leaves to be solved, and says
    that "the runtimes for smaller areas greatly reduce". Pairs and prediction are in
    only_visible; beside its rows stand here ours for square domemasters of as many pixels, a
    generated night in the giant dome (each size another picture, as the random numbers fall).
    All solvers start at exact subtraction and stop at a true relative gap of 1e-3 to the least
    cost, so that their visible errors agree to 0.05 %; the least cost is known to 1e-5,
    certified in float64. The product's solver is shown once more as it stops by itself, when it
    can certify 1e-3. One FFT is one real transform of one plane, forward or inverse; a
    domemaster has three planes. The paper says neither what it counts as one FFT nor when it
    stopped.
Expected
    To the same accuracy the product's solver needs at least three times fewer FFTs than GPCG with
    exact pollution, and fewer than 200 with its certificate, at every size. Its count changes by
    less than a factor of two between the sizes, so that its time falls with the area.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from compensate.solver.admm import ADMM
from validation.benchmarks.measuring import least_cost, traced
from validation.benchmarks.problems import Case, night_dome
from validation.benchmarks.solvers import SOLVERS
from validation.experiment import (
    Cell,
    Check,
    Column,
    Finding,
    Table,
    Work,
    at_least,
    at_most,
)

GOAL = 1e-3
SCENE = "dome_imax"


@dataclass(frozen=True)
class Row:
    """A row of the table.

    Attributes
    ----------
    ffts, iterations, seconds
        As the paper's columns.
    gap
        True relative gap; None where it is not known.
    """

    ffts: int
    iterations: int
    seconds: float
    gap: float | None = None


PAPER: Mapping[int, tuple[str, Row]] = {
    1480: ("2028 × 1080", Row(3772, 159, 248.5557)),
    671: ("534 × 844", Row(3992, 167, 128.4280)),
    469: ("435 × 505", Row(3684, 154, 34.3573)),
    213: ("196 × 232", Row(2636, 109, 4.1634)),
}
"""Its rows, by the side of the square with about as many pixels."""
OURS = ("frozen", "gpcg", "admm")
TITLES: Mapping[str, str] = {
    **{name: SOLVERS[name].title for name in OURS},
    "certified": "ADMM (the product's), stopped by its certificate",
}


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    sizes = (213, 469) if work.quick else (213, 469, 671, 1480)
    found = {size: _rows(work, size) for size in sizes}
    fewer = min(rows["gpcg"].ffts / rows["admm"].ffts for rows in found.values())
    ratio = {name: found[max(sizes)][name].seconds / found[213][name].seconds for name in TITLES}
    area = (max(sizes) / 213) ** 2
    held = "It held" if ratio["gpcg"] > area**0.5 else "It did not hold"

    def counts(name: str) -> str:
        rows = [found[size][name] for size in sizes]
        return ", ".join("never" if _missed(row) else f"{row.ffts}" for row in rows)

    def fall(small: float, large: float) -> str:
        change = 1 - small / large
        return f"by {change:.0%}" if change >= 0.01 else "not"

    largest, smallest = found[max(sizes)], found[213]
    falls = {name: fall(smallest[name].ffts, largest[name].ffts) for name in OURS}
    printed, each = PAPER[max(sizes)][1], largest["gpcg"]
    clipped = [work.step(f"{n} clipped", float, _clipped(work, n)) for n in sizes]

    return Finding(
        result=(
            f"The paper: 2636 to 3992 FFTs. Our problems are not its own, but so many are not "
            f"needed: at {', '.join(f'{size}²' for size in sizes)} its solver, with frozen "
            f"pollution, reaches the goal after {counts('frozen')}; with exact pollution after "
            f"{counts('gpcg')}; ours after {counts('admm')} if stopped at the true gap, at least "
            f"{fewer:.1f} times fewer, and {counts('certified')} as shipped, by its certificate. "
            f"These problems are easy: exact subtraction clips only {min(clipped):.1%} to "
            f"{max(clipped):.1%} of the pictures (of the bundled night about three quarters, and "
            f"ours needs more FFTs: fig9_dome). Sizes hold different pictures.\n\n"
            f'The paper: for smaller areas runtimes "greatly reduce" (60 times for an area 48 '
            f"times smaller). {held}: for an area {area:.0f} times smaller, "
            f"{ratio['gpcg']:.0f} times with GPCG and {ratio['admm']:.0f} times with ours. The "
            f"counts fall little with the area: the paper's "
            f"{fall(PAPER[213][1].ffts, printed.ffts)}, GPCG's with exact pollution "
            f"{falls['gpcg']}, ours {falls['admm']}; most of the saving is that each FFT is "
            f"cheaper.\n\n"
            f"The paper's seconds are a GPU's of 2011, ours this machine's processors': not to be "
            f"compared. Nor are iterations: one of our GPCG's takes about "
            f"{each.ffts / each.iterations:.0f} FFTs, one of the paper's about "
            f"{printed.ffts / printed.iterations:.0f}."
        ),
        checks=tuple(_checks(found)),
        tables=(_table(found),),
        figures={
            f"table1.{size}.{name}.{kind}": getattr(row, kind)
            for size, rows in found.items()
            for name, row in rows.items()
            for kind in ("ffts", "iterations", "seconds")
        },
        left_out=(
            "Stereo pairs, which the paper timed, and the areas that prediction leaves: see "
            "only_visible.",
            *(["Domemasters of 671² and 1480²: they take minutes."] if work.quick else []),
        ),
    )


def _rows(work: Work, size: int) -> dict[str, Row]:
    case = night_dome(size, SCENE, work.seed)
    least = work.step(f"{size} least", float, lambda: least_cost(case, 1e-5)[0])
    rows = {
        name: work.step(f"{size} {name}", Row, functools.partial(_row, case, name, least))
        for name in OURS
    }
    return {**rows, "certified": work.step(f"{size} certified", Row, lambda: _own(case, least))}


def _clipped(work: Work, size: int) -> Callable[[], float]:
    return lambda: night_dome(size, SCENE, work.seed).single.clipped


def _row(case: Case, name: str, least: float) -> Row:
    """To the goal, or as far as the solver comes."""
    last = traced(case, name, least, GOAL)[-1]
    return Row(last.ffts, last.iterations, last.seconds, last.gap)


def _own(case: Case, least: float) -> Row:
    """The product's solver, which stops when it can certify the goal."""
    task = case.single
    begin = time.perf_counter()
    result = ADMM(tolerance=GOAL, stop_when_invisible=False)(task.problem, task.start)
    seconds = time.perf_counter() - begin
    return Row(result.ffts, result.iterations, seconds, result.minimised / least - 1)


def _missed(row: Row) -> bool:
    return row.gap is None or not row.gap <= GOAL


def _checks(found: Mapping[int, Mapping[str, Row]]) -> Iterator[Check]:
    for size, rows in found.items():
        for name in ("gpcg", "admm", "certified"):
            gap = rows[name].gap
            assert gap is not None
            yield at_most(f"{size}², {TITLES[name]}: true gap", gap, GOAL)
        yield at_least(
            f"{size}²: FFTs of GPCG with exact pollution over ours",
            rows["gpcg"].ffts / rows["admm"].ffts,
            3,
        )
    counts = [rows["certified"].ffts for rows in found.values()]
    yield at_most("our FFTs with the certificate, the most of all sizes", max(counts), 200)
    yield at_most("our FFTs: the most over the fewest, of all sizes", max(counts) / min(counts), 2)


def _table(found: Mapping[int, Mapping[str, Row]]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for size, ours in sorted(found.items(), reverse=True):
        printed, row = PAPER[size]
        rows.append((printed, "the paper's, printed", *_cells(row)))
        rows += [(f"{size} × {size}", TITLES[name], *_cells(row)) for name, row in ours.items()]
    return Table(
        caption=(
            f"To a true gap of {GOAL:g}; sizes hold different pictures. Seconds of the paper are a "
            f"GPU's of 2011."
        ),
        columns=(
            Column(name="resolution"),
            Column(name="solver"),
            Column(name="FFTs of a plane"),
            Column(name="iterations"),
            Column(name="time", unit="s"),
            Column(name="true gap", digits=".1e"),
        ),
        rows=tuple(rows),
    )


def _cells(row: Row) -> tuple[Cell, ...]:
    return row.ffts, row.iterations, row.seconds, row.gap
