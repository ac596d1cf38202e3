"""In a bare spherical screen, the closed form gives the reflected light that path tracing finds.

Rationale
    Between two points of a sphere the form factor is dA / (4 pi r²), whatever the two points
    (design section 3). So every bounce spreads light evenly and keeps the share
    g = rho A_s / (4 pi r²) of it; all of them together add rho A_s / (4 pi r² - rho A_s) of the
    mean direct light (eq. 15 of the paper, corrected: note 0001). As printed, eq. 15 is
    rho pi r² / (4 - Omega rho pi r²) (a·x), with "areas" whose unit is not said and the area Omega
    of "the entire image". The path tracer knows nothing of this: it meets the sphere by ray
    intersection. A sum can be right by accident, so its terms are looked at one by one, too.
Expected
    For a white picture and a bright patch, in every cell of half-angle x albedo: the mean reflected
    light within 1e-3 of the closed form (quick: 5e-3), and z-scores that are standard normal, those
    of the ratios of bounces included: neither bias nor boasting. Eq. 15 as printed is wrong with
    areas in m² and with solid angles, even negative; right with areas over (pi r²)², or with
    rho / (pi r²) in place of rho pi r². With the image's area in place of the screen's, a half-lit
    hemisphere of albedo 0.5 gets 14 % too little.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from domesim.observation.spherical import bare_gain, closed_form_gain
from domesim.room.dome import Dome
from testing.statistics import FALSE_ALARM, bias_p, calibration
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
    between,
    require_tracer,
)
from validation.reflection import BOUNCES, Cell, measure

HALF_ANGLES = tuple(range(30, 181, 15))
ALBEDOS = tuple(n / 10 for n in range(1, 10))
READ = 0.5
"""Albedo of the caps for which eq. 15 is read, and their bounces told."""
RADII = (1.0, 2.5, 10.0)


def run(work: Work) -> Finding:
    """Sweep the caps with both pictures."""
    require_tracer()
    error = 1.2e-3 if work.quick else 2.5e-4
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
                    picture=picture,
                    # Another one for the patch: the same walks would err the same way
                    seed=100_000 * work.seed + 100 * number + 50 * (picture == "patch"),
                ),
            )
            for number, (half_angle, albedo) in enumerate(product(half_angles, albedos))
        )
        for picture in ("white", "patch")
    }
    half = work.step(
        "a half-lit hemisphere",
        Cell,
        lambda: measure(90, READ, error=error, picture="half", seed=work.seed),
    )
    white, every = cells["white"], [cell for group in cells.values() for cell in group]
    # Where walks leave soon, few of them bounce four times
    ratios = np.array(
        [cell.ratio_z for cell in every if cell.half_angle >= 45 and cell.albedo >= 0.3]
    )
    read = [cell for cell in white if cell.albedo == READ]
    dome = Dome(1.0, np.pi / 2)
    short = closed_form_gain(READ, 1.0, dome.screen_area / 2) * dome.screen_area / half.found - 1
    worst, cost = max(abs(cell.off_by) for cell in every), sum(cell.cpu_s for cell in every)
    hemisphere = next(cell for cell in read if cell.half_angle == 90)
    return Finding(
        result=(
            f"{len(white)} caps, half-angle {half_angles[0]}° to {half_angles[-1]}°, "
            f"albedo {albedos[0]} to {albedos[-1]}, each with a white picture and a bright patch: "
            f"the closed form and path tracing differ by at most {worst:.1e} of the reflected "
            f"light, as their standard errors say ({sum(cell.paths for cell in every) / 1e6:.0f} "
            f"million paths, {cost:.0f} CPU-s). A white hemisphere of albedo {READ} reflects "
            f"{hemisphere.truth:.5f} of its direct light by the closed form; traced: "
            f"{hemisphere.found:.5f} ± {hemisphere.error:.5f}. Light of bounce k over that of "
            f"bounce k - 1, k = 1 to {BOUNCES}, is what the screen's albedo and area say: the "
            f"largest of {ratios.size} differences is {np.abs(ratios).max():.1f} standard "
            f"errors.\n\n"
            f"As printed, with areas in m² or as solid angles, eq. 15 is wrong in every dome, and "
            f"even negative: reflections would take light away. It is right only if areas are "
            f"divided by (pi r²)², which the paper does not mention; most likely rho / (pi r²) was "
            f"meant. With the image's area, as the paper says, in place of the whole screen's, a "
            f"half-lit hemisphere gets {-short:.1%} too little."
        ),
        checks=(
            *(
                check
                for picture, group in cells.items()
                for check in _unbiased(picture, group, 5e-3 if work.quick else 1e-3)
            ),
            *_scores("ratios of bounces", ratios),
            at_most("half-lit hemisphere: standard errors off", abs(half.z), 3.5),
            between("half-lit hemisphere: with the image's area, less 1", short, -0.16, -0.12),
            *_reading_checks(read),
        ),
        plots=(_against_albedo(white),),
        tables=(
            *(_table(picture, group) for picture, group in cells.items()),
            _bounces(read),
            _readings_table(read),
        ),
        figures={
            "closed_form.cells": len(white),
            "closed_form.worst": worst,
            "closed_form.cpu_s": cost,
            "closed_form.image_area": short,
        },
    )


def _unbiased(picture: str, cells: Sequence[Cell], allowed: float) -> list[Check]:
    found, deviation, truth = np.array([(c.found, c.error, c.truth) for c in cells]).T
    worst = max(abs(cell.off_by) for cell in cells)
    return [
        at_most(f"{picture}: worst of {len(cells)} cells", worst, allowed),
        *_scores(picture, (found - truth) / deviation),
    ]


def _scores(what: str, z: np.ndarray[Any, Any]) -> list[Check]:
    spread, shared = bias_p(z, 1.0, 0.0)
    return [
        at_least(f"{what}: p-value, no bias of any", spread, FALSE_ALARM / 2),
        at_least(f"{what}: p-value, no bias shared by all", shared, FALSE_ALARM / 2),
        at_least(f"{what}: p-value, z-scores are standard normal", calibration(z), FALSE_ALARM),
    ]


def readings(half_angle: float, albedo: float, radius: float) -> dict[str, float]:
    """Eq. 15 of a white picture, whose a·x is the screen's whole area, by reading of its units."""
    area, disc = Dome(radius, np.radians(half_angle)).screen_area, np.pi * radius**2

    def printed(factor: float, unit: float) -> float:
        omega = area / unit
        return factor / (4 - omega * factor) * omega

    return {
        "as printed, areas in m²": printed(albedo * disc, 1),
        "as printed, solid angles": printed(albedo * disc, radius**2),
        "as printed, areas / (pi r²)²": printed(albedo * disc, disc**2),
        "rho / (pi r²) for rho pi r², m²": printed(albedo / disc, 1),
    }


def _reading_checks(cells: Sequence[Cell]) -> list[Check]:
    wrong, right, hemispheres = [], [], []
    for cell, radius in product(cells, RADII):
        metres, angles, *others = readings(cell.half_angle, cell.albedo, radius).values()
        wrong += [abs(metres / cell.found - 1), abs(angles / cell.found - 1)]
        right += [abs(other / cell.truth - 1) for other in others]
        hemispheres += [metres, angles] if cell.half_angle >= 90 else []
    return [
        at_least("eq. 15 as printed, plain areas: off by", min(wrong), 0.5),
        at_most("eq. 15 as printed, plain areas: hemispheres and more", max(hemispheres), 0),
        at_most("eq. 15, other readings: off by", max(right), 1e-9),
    ]


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


def _table(picture: str, cells: Sequence[Cell]) -> Table:
    albedos = list(dict.fromkeys(cell.albedo for cell in cells))
    return Table(
        caption=f"{picture.capitalize()} picture: path tracing over closed form less 1, in units "
        f"of 1e-4, by half-angle and albedo. One standard error is about "
        f"{1e4 * np.median([c.error / c.truth for c in cells]):.1f}.",
        columns=(
            Column(name="half-angle"),
            *(Column(name=f"albedo {albedo:g}", digits="+.1f") for albedo in albedos),
        ),
        rows=tuple(
            (f"{half_angle:g}°", *(1e4 * c.off_by for c in cells if c.half_angle == half_angle))
            for half_angle in dict.fromkeys(cell.half_angle for cell in cells)
        ),
    )


def _bounces(cells: Sequence[Cell]) -> Table:
    return Table(
        caption=f"Light of a bounce over that of the one before: white picture, albedo {READ}.",
        columns=(
            Column(name="half-angle"),
            Column(name="expected g", digits=".5f"),
            *(Column(name=f"bounce {k}", digits=".5f") for k in range(1, BOUNCES + 1)),
        ),
        rows=tuple(
            (
                f"{cell.half_angle:g}°",
                cell.ratio,
                *(
                    after / before
                    for before, after in zip((1.0, *cell.bounces), cell.bounces, strict=False)
                ),
            )
            for cell in cells
        ),
    )


def _readings_table(cells: Sequence[Cell]) -> Table:
    rows: list[tuple[str | float, ...]] = []
    for cell, radius in product(cells, RADII):
        read = readings(cell.half_angle, cell.albedo, radius).values()
        rows.append((f"{cell.half_angle:g}°", radius, cell.found, cell.truth, *read))
    return Table(
        caption="Mean reflected light of a white picture, projector white = 1, albedo "
        f"{READ}, by reading of eq. 15.",
        columns=(
            Column(name="half-angle"),
            Column(name="radius", unit="m"),
            Column(name="path tracing", digits=".4f"),
            Column(name="corrected (note 0001)", digits=".4f"),
            *(Column(name=name, digits=".4f") for name in readings(90, READ, 1.0)),
        ),
        rows=tuple(rows),
    )
