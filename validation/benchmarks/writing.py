"""The benchmark's table, plots and JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, final

import numpy as np

from domesim.frames import write_whole
from validation.benchmarks.measuring import GAPS, TOLERANCES, Cost
from validation.benchmarks.problems import PROBLEMS
from validation.drawing import plot

HEADER = (
    f"{'problem':<14}{'size':>5} {'solver':<37}"
    + "".join(f"{gap:>7.0e}" for gap in GAPS)
    + f"{'seconds':>9}{'pairs':>7}{'passes':>7}{'planes':>7}"
)
LEGEND = """\
FFTs of planes to a true relative gap; time to 1e-3, in seconds, in FFT pairs of one plane and in
passes of subtract-and-clip of this run; peak memory in float32 planes. Below ours, as it runs with
its certificates to a tolerance: FFTs, iterations; time; certified gap, true gap, their ratio."""
_FLOOR = 1e-6  # below it the plots don't go


@final
@dataclass(frozen=True)
class Growth:
    """Seconds to a stop over n values, as a + b n log n, fitted with relative errors.

    Attributes
    ----------
    a, b
        s, and s for each n log2 n.
    r_squared
        R² of the fit.
    ratios
        Measured over fitted seconds, by size.
    """

    a: float
    b: float
    r_squared: float
    ratios: Mapping[int, float]


def lines(cost: Cost) -> str:
    """What was measured, for people; under `HEADER`."""
    head = f"{cost.problem:<14}{cost.size:>5} {cost.solver:<37}"
    if cost.failure:
        return f"{head} {cost.failure}"
    counts = "".join(f"{'-' if n is None else n:>7}" for n in cost.ffts)
    figures = (cost.seconds, cost.pairs, cost.passes, cost.memory)
    widths, digits = (9, 7, 7, 7), (3, 0, 0, 1)
    text = head + counts
    for value, width, places in zip(figures, widths, digits, strict=True):
        text += f"{'-' if value is None else format(value, f'.{places}f'):>{width}}"
    for stop in cost.stops:
        text += (
            f"\n{'':<21}to {stop.tolerance:.0e}: {stop.ffts} FFTs, {stop.iterations} iterations; "
            f"{stop.seconds:.3f} s, {stop.pairs:.0f} pairs, {stop.passes:.0f} passes; "
            f"certified {_gap(stop.certified)}, true {_gap(stop.gap)}, "
            f"{_number(stop.excess, '.1f')} times"
        )
    return text


def write_figures(out: Path, costs: Sequence[Cost], machine: Mapping[str, Any]) -> dict[str, Any]:
    """Write ``bench.json`` into a folder, and return what is in it.

    Parameters
    ----------
    out
        An existing folder.
    costs
        What was measured.
    machine
        What it was measured on, and how.
    """
    figures = {
        **machine,
        "costs": [_finite(asdict(cost)) for cost in costs],
        "growth": {name: asdict(found) for name, found in _growths(costs).items()},
    }
    write_whole(out / "bench.json", json.dumps(figures, indent=1, allow_nan=False).encode())
    return figures


def write_report(out: Path, costs: Sequence[Cost]) -> Path:
    """Write ``bench.md`` and the plots into an existing folder; the path of the first."""
    growths = _growths(costs)
    drawn = [*_gap_plots(out, costs), *_time_plot(out, costs, growths)]
    path = out / "bench.md"
    write_whole(path, _markdown(costs, growths, drawn).encode())
    return path


def growth(costs: Sequence[Cost], problem: str) -> Growth | None:
    """How the product's time to its default stop grows with the size; None below three sizes."""
    measured = _times(costs, problem)
    if len(measured) < 3:
        return None
    n = np.array([pixels for _, pixels, _ in measured], float)
    seconds = np.array([time for _, _, time in measured])
    basis = np.stack([np.ones_like(n), n * np.log2(n)], 1)
    (a, b), *_ = np.linalg.lstsq(basis / seconds[:, None], np.ones_like(n), rcond=None)
    fitted = basis @ (a, b)
    spread = np.sum((seconds - seconds.mean()) ** 2)
    return Growth(
        float(a),
        float(b),
        float(1 - np.sum((seconds - fitted) ** 2) / spread),
        {size: float(time / fit) for (size, _, time), fit in zip(measured, fitted, strict=True)},
    )


def _growths(costs: Sequence[Cost]) -> dict[str, Growth]:
    return {name: found for name in PROBLEMS if (found := growth(costs, name)) is not None}


def _times(costs: Sequence[Cost], problem: str) -> list[tuple[int, int, float]]:
    """Size, values and seconds to the default stop."""
    return sorted(
        (cost.size, cost.pixels, cost.stops[0].seconds)
        for cost in costs
        if cost.problem == problem and cost.stops
    )


def _gap_plots(out: Path, costs: Sequence[Cost]) -> list[str]:
    """Plots each problem's gaps at the largest size that was traced; returns the names."""
    names = []
    for problem in PROBLEMS:
        traced = [cost for cost in costs if cost.problem == problem and cost.seen]
        if not traced:
            continue
        size = max(cost.size for cost in traced)
        shown = [cost for cost in traced if cost.size == size]

        def draw(axes: Any, shown: Sequence[Cost] = shown) -> None:
            for cost in shown:
                gaps = np.minimum.accumulate([seen.gap for seen in cost.seen])
                ffts = [max(1, seen.ffts) for seen in cost.seen]
                axes.loglog(ffts, np.maximum(gaps, _FLOOR), label=cost.solver)
            axes.set(xlabel="FFTs of a plane", ylabel="true relative gap")
            axes.legend(fontsize=8)

        names.append(f"gap-{problem}.svg")
        drawn = plot("", "", draw, (6.4, 4.2))
        write_whole(out / names[-1], drawn.svg.encode())
    return names


def _time_plot(out: Path, costs: Sequence[Cost], growths: Mapping[str, Growth]) -> list[str]:
    measured = {name: times for name in PROBLEMS if (times := _times(costs, name))}
    if not measured:
        return []

    def draw(axes: Any) -> None:
        for number, (name, times) in enumerate(measured.items()):
            pixels, seconds = [n for _, n, _ in times], [time for _, _, time in times]
            axes.loglog(pixels, seconds, "o", color=f"C{number % 7}", label=name)
            if name in growths:
                n = np.geomspace(pixels[0], pixels[-1])
                fit = growths[name].a + growths[name].b * n * np.log2(n)
                axes.loglog(n, fit, color=f"C{number % 7}", linewidth=0.9)
        axes.set(
            xlabel="pixels x planes, padded",
            ylabel=f"seconds to a certified gap of {TOLERANCES[0]:g}",
        )
        axes.legend(fontsize=8)

    write_whole(out / "time.svg", plot("", "", draw, (6.4, 4.2)).svg.encode())
    return ["time.svg"]


def _markdown(costs: Sequence[Cost], growths: Mapping[str, Growth], drawn: Sequence[str]) -> str:
    parts = ["# Cost of the solvers\n", LEGEND, ""]
    head = ("solver", *(f"FFTs to {gap:.0e}" for gap in GAPS), "s", "pairs", "passes", "planes")
    own = (
        *("tolerance", "FFTs", "iterations", "s", "pairs", "passes"),
        *("certified", "true", "ratio"),
    )
    for (problem, size), group in groupby(costs, lambda cost: (cost.problem, cost.size)):
        rows = list(group)
        clipped = max(cost.clipped for cost in rows)
        share = f"; subtraction clips {clipped:.1%}" if clipped else ""
        parts.append(f"## {problem}, {size}: {PROBLEMS[problem][0]}{share}\n")
        parts += _table(head, [_cells(cost) for cost in rows])
        stops = [stop for cost in rows for stop in cost.stops]
        if stops:
            cells = [
                (
                    *(f"{stop.tolerance:.0e}", f"{stop.ffts}", f"{stop.iterations}"),
                    *(f"{stop.seconds:.3f}", f"{stop.pairs:.0f}", f"{stop.passes:.0f}"),
                    *(_gap(stop.certified), _gap(stop.gap), _number(stop.excess, ".1f")),
                )
                for stop in stops
            ]
            parts += _table(own, cells)
    if growths:
        parts.append("## Time over pixels: a + b n log2 n\n")
        fits = [
            (
                *(name, f"{fit.a:.3g}", f"{fit.b:.3g}", f"{fit.r_squared:.4f}"),
                ", ".join(f"{size}: {ratio:.2f}" for size, ratio in fit.ratios.items()),
            )
            for name, fit in growths.items()
        ]
        parts += _table(("problem", "a, s", "b, s", "R²", "measured over fitted"), fits)
    parts += [f"![{name}]({name})" for name in drawn]
    return "\n".join(parts) + "\n"


def _cells(cost: Cost) -> tuple[str, ...]:
    if cost.failure:
        return (cost.solver, cost.failure, *[""] * (len(GAPS) + 3))
    return (
        cost.solver,
        *("-" if n is None else f"{n}" for n in cost.ffts),
        _number(cost.seconds, ".3f"),
        *(_number(value, ".0f") for value in (cost.pairs, cost.passes)),
        _number(cost.memory, ".1f"),
    )


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    ruled = [head, ["---"] * len(head), *rows]
    return [*("| " + " | ".join(row) + " |" for row in ruled), ""]


def _number(value: float | None, digits: str) -> str:
    return "-" if value is None else format(value, digits)


def _gap(value: float | None) -> str:
    return _number(value, ".1e")


def _finite(value: Any) -> Any:
    """JSON knows no infinity."""
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
