"""In a bare spherical screen, the closed form gives the reflected light that path tracing finds.

Rationale
    Between two points of a sphere the form factor is dA / (4 pi r²), whatever the two points
    (design section 3). So every bounce spreads light evenly, and all of them together add
    rho A_s / (4 pi r² - rho A_s) of the mean direct light (eq. 15 of the paper, corrected). The
    path tracer knows nothing of this: it meets the sphere by ray intersection.
Expected
    For a white picture and a bright patch, in every cell of half-angle x albedo: the mean reflected
    light within 1e-3 of the closed form (quick: 5e-3), and z-scores that are standard normal:
    neither bias nor boasting. The test that says so gives a false alarm as rarely as promised, and
    hardly ever misses a bias of 2 % or 0.2 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from scipy import stats

from domesim.observation.spherical import bare_gain
from domesim.room.dome import Dome
from validation.drawing import plot
from validation.experiment import (
    Check,
    Column,
    Finding,
    Plot,
    Table,
    Work,
    at_least,
    at_most,
    require_tracer,
)
from validation.reflection import Cell, measure
from validation.statistics import FALSE_ALARM, alarm_rate, bias_p, calibration

HALF_ANGLES = tuple(range(30, 181, 15))
ALBEDOS = tuple(n / 10 for n in range(1, 10))


def run(work: Work) -> Finding:
    """Sweep the caps with both pictures, and test the test."""
    require_tracer()
    error = 8e-4 if work.quick else 2.5e-4
    half_angles = (30, 90, 180) if work.quick else HALF_ANGLES
    albedos = (0.1, 0.5, 0.9) if work.quick else ALBEDOS
    cells = {
        picture: tuple(
            work.step(
                f"{picture}, half-angle {half_angle}°, albedo {albedo}",
                Cell,
                partial(
                    measure,
                    half_angle,
                    albedo,
                    error=error,
                    uneven=picture == "patch",
                    # Another one for the patch: the same walks would err the same way
                    seed=100_000 * work.seed + 100 * number + 50 * (picture == "patch"),
                ),
            )
            for number, (half_angle, albedo) in enumerate(product(half_angles, albedos))
        )
        for picture in ("white", "patch")
    }
    headline = work.step(
        "a white hemisphere of albedo 0.5",
        Cell,
        lambda: measure(90, 0.5, error=3e-4 if work.quick else 5e-5, seed=work.seed),
    )
    checks, every = [], [cell for group in cells.values() for cell in group]
    for picture, group in cells.items():
        found, deviation, truth = np.array([(c.found, c.error, c.truth) for c in group]).T
        spread, shared = bias_p(found, deviation, truth)
        worst = max(abs(cell.off_by) for cell in group)
        checks += [
            at_most(f"{picture}: worst of {len(group)} cells", worst, 5e-3 if work.quick else 1e-3),
            at_least(f"{picture}: p-value, no bias in any cell", spread, FALSE_ALARM / 2),
            at_least(f"{picture}: p-value, no bias shared by all", shared, FALSE_ALARM / 2),
            at_least(
                f"{picture}: p-value, z-scores are standard normal",
                calibration([cell.z for cell in group]),
                FALSE_ALARM,
            ),
        ]
    checks.append(
        at_most(
            "white hemisphere of albedo 0.5: difference in standard errors", abs(headline.z), 3.3
        )
    )
    rates, more = _test_of_the_test(work, cells["white"])
    cost = sum(cell.cpu_s for cell in every)
    return Finding(
        result=(
            f"{len(cells['white'])} caps, half-angle {half_angles[0]}° to {half_angles[-1]}°, "
            f"albedo {albedos[0]} to {albedos[-1]}, each with a white picture and a bright patch: "
            f"the closed form and path tracing differ by at most "
            f"{max(abs(c.off_by) for c in every):.1e} of the reflected light, as their standard "
            f"errors say ({sum(cell.paths for cell in every) / 1e6:.0f} million paths, "
            f"{cost:.0f} CPU-s). "
            f"A white hemisphere of albedo 0.5 reflects {headline.truth:.6f} of its direct light "
            f"by the closed form; traced: {headline.found:.6f} ± {headline.error:.6f}.\n\n"
            f"{rates}"
        ),
        checks=(*checks, *more),
        plots=(_against_albedo(cells["white"]), _deviations(every)),
        tables=tuple(_table(picture, group) for picture, group in cells.items()),
        figures={
            "closed_form.cells": len(cells["white"]),
            "closed_form.worst": max(abs(cell.off_by) for cell in every),
            "closed_form.cpu_s": cost,
            "closed_form.hemisphere_off_by": headline.off_by,
            "closed_form.hemisphere_error": headline.error / headline.truth,
            "closed_form.hemisphere_cpu_s": headline.cpu_s,
        },
    )


def _test_of_the_test(work: Work, cells: Sequence[Cell]) -> tuple[str, tuple[Check, ...]]:
    """How often the assertion cries wolf, and what it catches, by simulation of these cells."""
    trials, often = 1000, 0.05
    error = np.array([cell.error / cell.truth for cell in cells])
    one = np.eye(len(cells))[len(cells) // 2]
    alarms = alarm_rate(0.0, error, false_alarm=often, trials=trials, seed=work.seed)
    power = {
        "2 % in one cell alone": alarm_rate(0.02 * one, error, trials=trials, seed=work.seed),
        "0.2 % in all cells": alarm_rate(0.002, error, trials=trials, seed=work.seed),
    }
    bound = float(stats.binom.isf(1e-4, trials, often)) / trials
    text = (
        f"Can the test be trusted? Set to {often:.0%} false alarms it gave {alarms:.1%} in "
        f"{trials} simulated sweeps without a bias. Set to {FALSE_ALARM:.1%}, as here, it caught "
        + ", ".join(
            f"{caught:.1%} of sweeps with a bias of {bias}" for bias, caught in power.items()
        )
        + "."
    )
    return text, (
        at_most(f"false alarms when {often:.0%} are promised", alarms, bound),
        *(at_least(f"share caught of biases of {bias}", power[bias], 0.99) for bias in power),
    )


def _against_albedo(cells: Sequence[Cell]) -> Plot:
    def draw(axes: Any) -> None:
        albedo = np.linspace(0, 1, 200)[:-1]
        for number, half_angle in enumerate(dict.fromkeys(cell.half_angle for cell in cells)):
            if number % 2 and len(cells) > 40:
                continue
            dome = Dome(5.0, np.radians(half_angle))
            (line,) = axes.plot(albedo, [bare_gain(rho, dome) for rho in albedo], lw=1)
            mine = [cell for cell in cells if cell.half_angle == half_angle]
            axes.plot(
                [cell.albedo for cell in mine],
                [cell.found for cell in mine],
                "o",
                color=line.get_color(),
                label=f"{half_angle:g}°",
            )
        axes.set(
            xlabel="albedo of the screen",
            ylabel="reflected light / direct light",
            yscale="log",
            ylim=(1e-3, 20),
        )
        axes.legend(title="half-angle", ncols=2)

    return plot(
        "What a white picture adds to itself by reflection: closed form (lines) and path tracing "
        "(dots; errors are smaller than the dots). A hemisphere has a half-angle of 90°.",
        "Reflected over direct light against albedo: dots lie on the lines.",
        draw,
    )


def _deviations(cells: Sequence[Cell]) -> Plot:
    def draw(axes: Any) -> None:
        z = np.sort([cell.z for cell in cells])
        axes.plot(stats.norm.ppf((np.arange(len(z)) + 0.5) / len(z)), z, "o")
        axes.axline((0, 0), slope=1, color="#888888", lw=1)
        axes.set(xlim=(-3.5, 3.5), ylim=(-3.5, 3.5), aspect="equal")
        axes.set(
            xlabel="expected by chance (standard normal)",
            ylabel="(traced - closed form)\n/ standard error",
        )

    return plot(
        "All differences in units of their standard errors, in order, against what pure chance "
        f"would give: on the line there is nothing but noise. On average they lie "
        f"{np.mean([cell.z for cell in cells]):+.2f} standard errors off; whether that is chance, "
        "the p-values among the checks say.",
        "A quantile plot: dots near the diagonal.",
        draw,
        size=(4.2, 4.0),
    )


def _table(picture: str, cells: Sequence[Cell]) -> Table:
    albedos = list(dict.fromkeys(cell.albedo for cell in cells))
    rows: list[tuple[str | float, ...]] = [
        (f"{half_angle:g}°", *(1e4 * c.off_by for c in cells if c.half_angle == half_angle))
        for half_angle in dict.fromkeys(cell.half_angle for cell in cells)
    ]
    return Table(
        caption=f"{picture.capitalize()} picture: path tracing over closed form less 1, in units "
        f"of 1e-4, by half-angle and albedo. One standard error is about "
        f"{1e4 * np.median([c.error / c.truth for c in cells]):.1f}.",
        columns=(
            Column(name="half-angle"),
            *(Column(name=f"albedo {albedo:g}", digits="+.1f") for albedo in albedos),
        ),
        rows=tuple(rows),
    )
