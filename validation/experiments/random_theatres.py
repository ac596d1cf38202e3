"""In theatres drawn at random, energy balances, and three ways to the reflected light agree.

Rationale
    Theatres of tests are chosen, and a fault may be just where nobody thought of one. Here radius,
    half-angle, tilt, albedos, floor, wall, lenses and boxes that stand anywhere, beams included,
    are drawn. Four things are asked of each. What projectors emit is what all surfaces absorb and
    what leaves the theatre. And the mean reflected light of a white picture is the same by pictures
    (`domesim render`), by the tabulated transport (`domesim tabulate`), and by Radiance where the
    lens is in the centre. The differences' own standard errors are stated, and have to be honest.
Expected
    95 % of the differences within two of their standard errors, and none beyond four and a half.
    Where Radiance is not installed, it is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.pathtrace.tabulate import tabulate
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.room.dome import Dome
from domesim.room.furniture import box
from domesim.room.theatre import Albedo, Floor, Lens, Solid, Theatre, Wall
from testing.energy import imbalance
from validation import radiance
from validation.experiment import (
    Check,
    Column,
    Finding,
    Table,
    Work,
    at_least,
    at_most,
    require_tracer,
)

Floats = NDArray[np.float64]

ENERGY, TABULATED, OTHER = "energy", "render and tabulate", "render and Radiance"
SIZE = 32
"""Pixels a side of the pictures."""
BATCHES = 12
"""Batches of walks that an energy balance takes."""


@final
@dataclass(frozen=True)
class Opinions:
    """Four opinions on one theatre; means over primaries.

    Attributes
    ----------
    stopped
        Share of the projectors' light that does not reach the screen.
    missing, missing_error
        Share of the emitted light that the balance of energy misses, and its standard error.
    rendered, rendered_error
        Mean reflected light of white by pictures, projector white = 1, and its standard error.
    tabulated, tabulated_error
        By the tabulated transport, likewise.
    other, other_error
        By Radiance, likewise; None if it was not asked.
    """

    stopped: float
    missing: float
    missing_error: float
    rendered: float
    rendered_error: float
    tabulated: float
    tabulated_error: float
    other: float | None
    other_error: float | None


def drawn(number: int, seed: int) -> Theatre:
    """A theatre; half of them have their only lens in the centre."""
    rng = np.random.default_rng([seed, number])
    radius = float(rng.uniform(3, 12))
    tilt = float(np.radians(rng.uniform(0, 20))) if rng.random() < 0.5 else 0.0
    dome = Dome(radius, float(np.radians(rng.uniform(70, 125))), tilt)
    height = -radius * float(rng.uniform(0.1, 0.5))
    floor = wall = None
    if rng.random() < 0.75:
        floor = Floor(height, radius * float(rng.uniform(0.3, 0.95)), _albedo(rng, 0.0, 0.6))
    if rng.random() < 0.3:
        top = height + radius * float(rng.uniform(0.1, 0.6))
        wall = Wall(radius * float(rng.uniform(0.75, 1.0)), height, top, _albedo(rng, 0.0, 0.6))
    lenses: tuple[Lens, ...] = ()
    if number % 2:
        lenses = tuple(
            Lens(
                f"lens {each}",
                _point(rng.uniform(-0.15, 0.15, 3) * radius),
                (0.0, 0.0, radius),
                field=2 * np.pi,
            )
            for each in range(rng.integers(1, 3))
        )
    places = [lens.position for lens in lenses] or [(0.0, 0.0, 0.0)]
    solids: list[Solid] = []
    wanted = int(rng.integers(0 if floor else 1, 3))
    while len(solids) < wanted:
        middle = rng.uniform([-0.6, -0.6, -0.3], 0.6, 3) * radius
        half = rng.uniform(0.03, 0.15, 3) * radius
        # No lens is in a box, or touches one.
        if not any(np.all(np.abs(middle - place) < half * 1.2) for place in places):
            corners = _point(middle - half), _point(middle + half)
            solids.append(box(f"box {len(solids)}", *corners, _albedo(rng, 0.05, 0.8)))
    return Theatre(
        dome, _albedo(rng, 0.2, 0.75), floor=floor, wall=wall, solids=tuple(solids), lenses=lenses
    )


def measure(theatre: Theatre, *, error: float, rays: int, seed: int) -> Opinions:
    """Ask all four.

    Parameters
    ----------
    theatre
        One that was drawn.
    error
        Relative standard error to reach by pictures (of all of them) and by tabulation.
    rays
        Rays of Radiance; 0 if it is not asked.
    seed
        Seed of all random numbers.
    """
    tracer = Tracer(theatre)
    areas = theatre.dome.screen_areas(SIZE, SIZE)
    white = tracer.picture(np.ones((SIZE, SIZE, 3), np.float32))
    pixels = float(np.count_nonzero(areas))
    wanted = Settings(error=error * np.sqrt(pixels), seed=seed)
    rendered = tracer.screen(white, SIZE, SIZE, wanted).pooled_error(areas)
    # The mean over the screen is the same with any patterns, by walks alone and with fewer sums.
    found = tabulate(
        theatre, error=error, most=1e8, degree=0, seed=seed, explicit=False, tracer=tracer
    ).transport
    off, spread = imbalance(theatre, np.inf, BATCHES, BATCHES)
    other: tuple[float, float] | tuple[None, None] = None, None
    if rays and not theatre.lenses:
        mean, around = radiance.reflected(theatre, rays=rays, seed=seed)
        other = float(mean.mean()), float(around.mean())
    return Opinions(
        float(1 - np.average(tracer.gains(SIZE, SIZE).sum(0), weights=areas)),
        float(off.mean()),
        float(spread.mean()),
        *rendered,
        float(found.mean_gain().mean()),
        # Other modes than the first have no mean.
        float(found.core_error[:, 0, 0].mean()),
        *other,
    )


def run(work: Work) -> Finding:
    """Draw theatres and compare."""
    require_tracer()
    count, error, rays = (2, 6e-3, 20_000) if work.quick else (30, 2e-3, 100_000)
    seed, rays = 7 + work.seed, rays if radiance.installed() else 0
    found = work.each(
        {f"theatre {number}": drawn(number, seed) for number in range(count)},
        Opinions,
        lambda theatre: measure(theatre, error=error, rays=rays, seed=seed),
    )
    return finding(found, quick=work.quick)


def finding(found: Mapping[str, Opinions], *, quick: bool) -> Finding:
    """What opinions on theatres, by name, amount to."""
    all_of = {name: np.array(part) for name, part in _differences(found.values()).items()}
    stopped = sum(one.stopped > 1e-3 for one in found.values())
    spread = {name: np.sqrt(np.mean(part**2)) for name, part in all_of.items() if len(part)}
    everything = np.concatenate(list(all_of.values()))
    share = float(np.mean(np.abs(everything) <= 2))
    return Finding(
        result=(
            f"{len(found)} theatres, in {stopped} of which something stands in a beam: "
            f"{share:.0%} of {len(everything)} differences are within two standard errors, and the "
            f"largest is {np.abs(everything).max():.1f}. Their rms, 1 where errors are just: "
            + "; ".join(f"{name} {part:.2f}" for name, part in spread.items())
            + "."
        ),
        checks=tuple(_checks(all_of, quick=quick)),
        tables=(_table(found),),
        figures={
            "random_theatres.within": share,
            "random_theatres.largest": float(np.abs(everything).max()),
        },
        left_out=() if radiance.installed() else (f"Radiance. {radiance.MISSING}.",),
    )


def _albedo(rng: np.random.Generator, low: float, high: float) -> Albedo:
    return _point(rng.uniform(low, high, 3))


def _point(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _differences(found: Iterable[Opinions]) -> Mapping[str, list[float]]:
    """By what is compared: differences in their standard errors."""
    result: dict[str, list[float]] = {ENERGY: [], TABULATED: [], OTHER: []}
    for one in found:
        result[ENERGY].append(one.missing / one.missing_error)
        apart = float(np.hypot(one.rendered_error, one.tabulated_error))
        result[TABULATED].append((one.rendered - one.tabulated) / apart)
        if one.other is not None and one.other_error is not None:
            apart = float(np.hypot(one.rendered_error, one.other_error))
            result[OTHER].append((one.rendered - one.other) / apart)
    return result


def _checks(all_of: Mapping[str, Floats], *, quick: bool) -> list[Check]:
    everything = np.concatenate(list(all_of.values()))
    # Of few differences, chance decides what share lies within two.
    least = 0.5 if quick else 0.88
    checks = [at_least("share within two standard errors", np.mean(np.abs(everything) <= 2), least)]
    for name, part in all_of.items():
        if len(part):
            checks.append(at_most(f"{name}: the largest", np.abs(part).max(), 4.5))
            mean = abs(part.mean()) * np.sqrt(len(part))
            checks.append(at_most(f"{name}: their mean, in its standard errors", mean, 3.5))
    return checks


def _table(found: Mapping[str, Opinions]) -> Table:
    return Table(
        caption="Reflected light of white (projector white = 1), and light that is missing.",
        columns=(
            Column(name="theatre"), Column(name="light stopped", unit="%", digits=".1f"),
            Column(name="missing", unit="%", digits="+.2f"),
            Column(name="its error", unit="%", digits=".2f"),
            Column(name="render", digits=".5f"), Column(name="its error", digits=".5f"),
            Column(name="tabulate", digits=".5f"), Column(name="its error", digits=".5f"),
            Column(name="Radiance", digits=".5f"), Column(name="its error", digits=".5f"),
        ),
        rows=tuple(
            (
                name, 100 * one.stopped, 100 * one.missing, 100 * one.missing_error, one.rendered,
                one.rendered_error, one.tabulated, one.tabulated_error, one.other, one.other_error,
            )
            for name, one in found.items()
        ),
    )  # fmt: skip
