"""What a way is worth beside others, by input or by place.

Inputs are the sample: what is averaged over inputs is first averaged over each one's pollutions and
luminances, which weigh alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from validation.experiments.quality.inputs import Place
from validation.experiments.quality.judging import Cell, Cells

VISIBLE = 9.9
"""JOD of subtraction below which something is left to gain."""
SHORT = 0.02
"""JOD that a frame may fall short of the better of subtraction and nothing."""


def gains(cells: Cells, way: str, other: str = "subtractive") -> dict[str, float]:
    """Mean gain over another way, JOD, by input: where subtraction leaves what is seen."""
    found: dict[str, list[float]] = {}
    for (name, _, _), ways in cells.items():
        if way in ways and quality(ways["subtractive"]) < VISIBLE:
            found.setdefault(name, []).append(quality(ways[way]) - quality(ways[other]))
    return {name: float(np.mean(values)) for name, values in found.items()}


def shortfalls(cells: Cells, way: str) -> dict[Place, float]:
    """JOD below the better of subtraction and nothing, by place: negative if it is above."""
    return {
        place: max(quality(ways[name]) for name in ("none", "subtractive")) - quality(ways[way])
        for place, ways in cells.items()
        if way in ways
    }


def alike(cells: Cells, way: str) -> tuple[int, int]:
    """How often a way is compared with nothing or subtraction, and ranked as its errors rank them.

    Only where ColorVideoVDP sees more than `SHORT` between them.
    """
    compared = agreed = 0
    for ways in cells.values():
        for other in ("none", "subtractive"):
            gain = quality(ways[way]) - quality(ways[other])
            if abs(gain) > SHORT:
                compared += 1
                agreed += (gain > 0) == (ways[way].error < ways[other].error)
    return compared, agreed


def falling_back(cells: Cells, way: str, times: float) -> tuple[int, float, float]:
    """A way that falls back on subtraction unless its visible error is so many `times` less.

    Returns
    -------
    cases
        In how many cases it does.
    gain
        Mean over all cases, JOD over subtraction.
    shortfall
        The largest, JOD.
    """
    cases, gain, shortfall = 0, [], []
    for ways in cells.values():
        plain, ours = ways["subtractive"], ways[way]
        back = ours.error * times > plain.error
        chosen = plain if back else ours
        cases += back
        gain.append(quality(chosen) - quality(plain))
        shortfall.append(max(quality(plain), quality(ways["none"])) - quality(chosen))
    return cases, float(np.mean(gain)), max(shortfall)


def falls(
    cells: Cells, way: str, of: Callable[[Cell], float | None] = lambda cell: cell.contour
) -> dict[Place, float]:
    """How many times less ghost contour than with subtraction, by place."""
    found = {}
    for place, ways in cells.items():
        if way in ways:
            ours, plain = of(ways[way]), of(ways["subtractive"])
            if ours is not None and plain is not None and plain > 0:
                found[place] = plain / max(ours, 1e-9)
    return found


def news(cells: Cells, way: str) -> dict[Place, float]:
    """Share of the screen that is a new artefact, by place."""
    found = {place: ways[way].new for place, ways in cells.items() if way in ways}
    return {place: new for place, new in found.items() if new is not None}


def geometric(by_place: Mapping[Place, float]) -> float:
    """Geometric mean over inputs of those over their places; NaN without any."""
    by_input: dict[str, list[float]] = {}
    for (name, _, _), value in by_place.items():
        by_input.setdefault(name, []).append(np.log(value))
    if not by_input:
        return np.nan
    return float(np.exp(np.mean([np.mean(values) for values in by_input.values()])))


def quality(cell: Cell) -> float:
    """JOD; NaN if ColorVideoVDP is not installed."""
    return np.nan if cell.quality is None else cell.quality


def of_contrast(cell: Cell) -> float | None:
    """The ghost contour of contrast, for `falls`."""
    return cell.contrast_contour
