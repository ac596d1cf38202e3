"""Eq. 15 of the paper is wrong as printed, and right once corrected.

Rationale
    Eq. 15 prints the pollution of a dome as rho pi r² / (4 - Omega rho pi r²) (a·x), with "areas"
    whose unit is not said and the area Omega of "the entire image". Note 0001 derives
    rho / (4 pi r² - rho A_s) (a·x) with the area A_s of the whole screen instead: all of it
    reflects, lit or not. Path tracing decides.
Expected
    The corrected form (as the program computes it) is what is traced, for white and for half-lit
    domes of any size. The printed form is wrong with areas in m² and with solid angles, even
    negative; right with areas over (pi r²)², or with rho / (pi r²) in place of rho pi r². With the
    image's area in place of the screen's, a half-lit hemisphere of albedo 0.5 gets 14 % too little.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from domesim.observation.spherical import ClosedFormDome, closed_form_gain
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.room.dome import Dome
from domesim.room.theatre import Theatre
from validation.drawing import plot
from validation.experiment import (
    Column,
    Finding,
    Plot,
    Table,
    Work,
    at_least,
    at_most,
    between,
    require_tracer,
)
from validation.reflection import reflected

SIZE = 64
ALBEDO = 0.5
CASES = ((90, 1.0), (60, 2.5), (135, 10.0))
"""Half-angle, degrees, and radius, m."""


@final
@dataclass(frozen=True)
class Case:
    """One dome, white and half-lit: mean reflected light, projector white = 1.

    Attributes
    ----------
    traced, error
        By path tracing of the white picture, and its standard error.
    half_traced, half_error
        The same of the half-lit picture.
    corrected, half_corrected
        By the program's closed form.
    readings
        Eq. 15 for the white picture, by reading of its units.
    image_area
        The corrected form of the half-lit picture with the image's area in place of the screen's.
    """

    traced: float
    error: float
    half_traced: float
    half_error: float
    corrected: float
    half_corrected: float
    readings: dict[str, float]
    image_area: float


def measure(half_angle: float, radius: float, *, error: float, seed: int) -> Case:
    """Trace one dome; half-angle in degrees, radius in m, `error` relative."""
    dome = Dome(radius, np.radians(half_angle))
    tracer = Tracer(Theatre(dome, (ALBEDO,) * 3))
    observation = ClosedFormDome(dome, SIZE, SIZE, albedo=ALBEDO)
    areas = dome.screen_areas(SIZE, SIZE)
    half = np.ones((SIZE, SIZE, 3), np.float32)
    half[: SIZE // 2] = 0
    found = []
    for number, picture in enumerate((np.ones_like(half), half)):
        # A pixel's error averages out over thousands of them
        walks = max(64, round(0.3 / error**2 / SIZE**2))
        settings = Settings(least=walks, most=walks, seed=seed + number)
        traced = tracer.screen(tracer.picture(picture), SIZE, SIZE, settings)
        light = reflected(observation, picture)
        model = float(np.sum(areas[..., None] * light) / areas.sum() / 3)
        found.append((*traced.pooled_error(areas), model))
    (white, white_error, white_model), (dim, dim_error, dim_model) = found
    lit = float(areas[half[..., 0] > 0].sum())
    return Case(
        traced=white,
        error=white_error,
        half_traced=dim,
        half_error=dim_error,
        corrected=white_model,
        half_corrected=dim_model,
        readings=_readings(radius, dome.screen_area),
        image_area=closed_form_gain(ALBEDO, radius, lit) * lit,
    )


def _readings(r: float, area: float) -> dict[str, float]:
    """Eq. 15 of a white picture, whose a·x is its whole area."""

    def printed(factor: float, unit: float) -> float:
        omega = area / unit
        return factor / (4 - omega * factor) * omega

    disc = np.pi * r**2
    return {
        "as printed, areas in m²": printed(ALBEDO * disc, 1),
        "as printed, solid angles": printed(ALBEDO * disc, r**2),
        "as printed, areas / (pi r²)²": printed(ALBEDO * disc, disc**2),
        "rho / (pi r²) for rho pi r², m²": printed(ALBEDO / disc, 1),
    }


def run(work: Work) -> Finding:
    """Compare eq. 15 in each reading with path tracing."""
    require_tracer()
    error = 1e-3 if work.quick else 2e-4
    cases = work.each(
        {f"{a}°, r {r:g} m": (a, r, n) for n, (a, r) in enumerate(CASES)},
        Case,
        lambda case: measure(*case[:2], error=error, seed=7 + 10 * case[2] + 1000 * work.seed),
    )
    checks = []
    for name, case in cases.items():
        for what, traced, deviation, model in (
            ("white", case.traced, case.error, case.corrected),
            ("half-lit", case.half_traced, case.half_error, case.half_corrected),
        ):
            checks.append(
                at_most(
                    f"{name}, {what}: corrected form over traced, less 1",
                    abs(model / traced - 1),
                    4 * deviation / traced,
                )
            )
            checks.append(
                at_most(f"{name}, {what}: standard error", deviation / traced, 1.5 * error)
            )
        wrong = [abs(value / case.traced - 1) for value in list(case.readings.values())[:2]]
        checks.append(
            at_least(f"{name}: the printed form with plain areas is off", min(wrong), 0.5)
        )
        right = [abs(value / case.corrected - 1) for value in list(case.readings.values())[2:]]
        checks.append(at_most(f"{name}: other readings over corrected, less 1", max(right), 1e-9))
    hemisphere = next(iter(cases.values()))
    short = hemisphere.image_area / hemisphere.half_traced - 1
    checks.append(
        between(
            "half-lit hemisphere: the image's area instead of the screen's", short, -0.16, -0.12
        )
    )
    values = [value for case in cases.values() for value in list(case.readings.values())[:2]]
    checks.append(at_most("printed form with plain areas: largest", max(values), 0))
    worst = max(abs(c.half_corrected / c.half_traced - 1) for c in cases.values())
    return Finding(
        result=(
            f"As printed, with areas in m² or as solid angles, eq. 15 is wrong in all {len(cases)} "
            f"domes, and even negative: reflections would take light away. It is right only if "
            f"areas are divided by (pi r²)², which the paper does not mention; most likely "
            f"rho / (pi r²) was meant. With the image's area, as the paper says, in place of the "
            f"whole screen's, a half-lit hemisphere gets {-short:.1%} too little. The corrected "
            f"form is within {worst:.1e} of the traced light, half-lit."
        ),
        checks=tuple(checks),
        plots=(_plot(cases),),
        tables=(_table(cases),),
        figures={"eq15.image_area": short, "eq15.worst": worst},
    )


def _table(cases: dict[str, Case]) -> Table:
    rows: list[tuple[str | float | None, ...]] = [
        ("path tracing", *(case.traced for case in cases.values())),
        ("± standard error", *(case.error for case in cases.values())),
        ("corrected (note 0001)", *(case.corrected for case in cases.values())),
    ]
    rows += [
        (reading, *(case.readings[reading] for case in cases.values()))
        for reading in next(iter(cases.values())).readings
    ]
    rows += [
        ("half-lit: path tracing", *(case.half_traced for case in cases.values())),
        ("half-lit: corrected", *(case.half_corrected for case in cases.values())),
        ("half-lit: with the image's area", *(case.image_area for case in cases.values())),
    ]
    return Table(
        caption=f"Mean reflected light of a white picture, projector white = 1, albedo {ALBEDO}, "
        "by half-angle and radius.",
        columns=(Column(name="by"), *(Column(name=name, digits=".4f") for name in cases)),
        rows=tuple(rows),
    )


def _plot(cases: dict[str, Case]) -> Plot:
    def draw(axes: Any) -> None:
        across = np.arange(len(cases))
        series = {"corrected": [case.corrected / case.traced for case in cases.values()]}
        for reading in next(iter(cases.values())).readings:
            series[reading] = [case.readings[reading] / case.traced for case in cases.values()]
        for number, (name, values) in enumerate(series.items()):
            axes.bar(across + 0.16 * (number - 2), values, 0.15, label=name)
        axes.axhline(1, color="black", lw=1)
        axes.annotate("1 = traced", (len(cases) - 0.55, 1), va="bottom", ha="right", fontsize=8.5)
        axes.set(ylabel="reflected light / traced light", xticks=across)
        axes.set_xticklabels([name.replace(", ", "\n") for name in cases])
        axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)

    return plot(
        "Eq. 15 for a white picture over the traced light: 1 is right, below 0 is impossible.",
        "Bars for each reading of the equation; only three of five reach 1.",
        draw,
        size=(5.6, 4.2),
    )
