"""The benchmark's lines for people, and its JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from domesim.frames import write_whole
from validation.benchmarks.measuring import GAPS, Cost

NAME = "bench.json"
"""Name of the file of figures."""

HEADER = (
    f"{'problem':<14}{'size':>5} {'solver':<37}"
    + "".join(f"{gap:>7.0e}" for gap in GAPS)
    + f"{'seconds':>9}{'pairs':>7}"
)
LEGEND = """\
FFTs of planes to a true relative gap; time to 1e-3, in seconds, and in FFT pairs of one plane of
this run. Below ours, as it runs with its certificates to a tolerance: FFTs, iterations; time;
certified gap, true gap, their ratio."""


def lines(cost: Cost) -> str:
    """What was measured, for people; under `HEADER`."""
    head = f"{cost.problem:<14}{cost.size:>5} {cost.solver:<37}"
    if cost.failure:
        return f"{head} {cost.failure}"
    counts = "".join(f"{'-' if n is None else n:>7}" for n in cost.ffts)
    figures, widths, digits = (cost.seconds, cost.pairs), (9, 7), (3, 0)
    text = head + counts
    for value, width, places in zip(figures, widths, digits, strict=True):
        text += f"{'-' if value is None else format(value, f'.{places}f'):>{width}}"
    for stop in cost.stops:
        text += (
            f"\n{'':<21}to {stop.tolerance:.0e}: {stop.ffts} FFTs, {stop.iterations} iterations; "
            f"{stop.seconds:.3f} s, {stop.pairs:.0f} pairs; "
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
    figures = {**machine, "costs": [_finite(asdict(cost)) for cost in costs]}
    write_whole(out / NAME, json.dumps(figures, indent=1, allow_nan=False).encode())
    return figures


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
