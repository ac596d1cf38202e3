"""Every bounce keeps the same share of the light: reflections are a geometric series.

Rationale
    The closed form adds up all bounces at once, each weaker by g = rho A_s / (4 pi r²) than the one
    before (design section 3). A sum can be right by accident; its terms are looked at one by one,
    as the path tracer counts them.
Expected
    In every cap the light of bounce k is g times that of bounce k - 1, k = 1 to 4, whatever the
    picture: the z-scores of all ratios are standard normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from validation.drawing import COLOURS, plot
from validation.experiment import Column, Finding, Plot, Table, Work, at_least, require_tracer
from validation.reflection import BOUNCES, Cell, measure
from validation.statistics import FALSE_ALARM, bias_p, calibration

CAPS = ((45, 0.3), (90, 0.5), (90, 0.8), (120, 0.6), (150, 0.9), (180, 0.7))
"""Half-angle, degrees, and albedo."""


def run(work: Work) -> Finding:
    """Trace the caps, bounce by bounce."""
    require_tracer()
    error = 1e-3 if work.quick else 2e-4
    cells = [
        work.step(
            f"half-angle {half_angle}°, albedo {albedo}, {'patch' if uneven else 'white'}",
            Cell,
            partial(
                measure,
                half_angle,
                albedo,
                error=error,
                uneven=uneven,
                seed=100_000 * work.seed + 100 * (2 * number + uneven),
            ),
        )
        for number, (half_angle, albedo) in enumerate(CAPS[::2] if work.quick else CAPS)
        for uneven in (False, True)
    ]
    scores = np.array([cell.ratio_z for cell in cells])
    spread, shared = bias_p(scores, 1.0, 0.0)
    return Finding(
        result=(
            f"Light of bounce k over that of bounce k - 1, k = 1 to {BOUNCES}, in {len(cells)} "
            f"pictures: each is what the screen's albedo and area say, as closely as chance allows "
            f"(largest of {scores.size} differences: {np.abs(scores).max():.1f} standard errors). "
            f"After four bounces a white hemisphere of albedo 0.5 has {0.25**4:.1%} of its direct "
            f"light left; at albedo 0.8, {0.4**4:.1%}."
        ),
        checks=(
            at_least("p-value, no bias of any ratio", spread, FALSE_ALARM / 2),
            at_least("p-value, no bias shared by all ratios", shared, FALSE_ALARM / 2),
            at_least("p-value, z-scores are standard normal", calibration(scores), FALSE_ALARM),
        ),
        plots=(_series(cells),),
        tables=(_table(cells),),
        figures={"bounces.ratios": scores.size, "bounces.p": calibration(scores)},
    )


def _series(cells: Sequence[Cell]) -> Plot:
    def draw(axes: Any) -> None:
        bounce = np.arange(1, BOUNCES + 1)
        for colour, cell in zip(COLOURS, cells[::2], strict=False):
            axes.plot(bounce, cell.ratio**bounce, color=colour, lw=1)
            label = f"{cell.half_angle:g}°, albedo {cell.albedo:g}"
            axes.plot(bounce, cell.bounces, "o", color=colour, label=label)
        axes.set(
            xlabel="bounce",
            ylabel="light of this bounce / direct light",
            yscale="log",
            xticks=bounce,
        )
        axes.legend(title="half-angle")

    return plot(
        "Light of each bounce of a white picture: traced (dots), and powers of "
        "g = rho A_s / (4 pi r²) (lines).",
        "Light against bounce on a logarithmic scale: straight lines through the dots.",
        draw,
    )


def _table(cells: Sequence[Cell]) -> Table:
    rows: list[tuple[str | float, ...]] = []
    for number, cell in enumerate(cells):
        light = np.array([1.0, *cell.bounces])
        ratios = light[1:] / light[:-1]
        rows.append(
            (
                f"{cell.half_angle:g}°, {cell.albedo:g}, {'patch' if number % 2 else 'white'}",
                cell.ratio,
                *(float(ratio) for ratio in ratios),
            )
        )
    return Table(
        caption="Light of a bounce over that of the one before.",
        columns=(
            Column(name="half-angle, albedo, picture"),
            Column(name="expected g", digits=".5f"),
            *(Column(name=f"bounce {k}", digits=".5f") for k in range(1, BOUNCES + 1)),
        ),
        rows=tuple(rows),
    )
