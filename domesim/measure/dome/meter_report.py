"""What a meter found: lines for a person, figures for a program, and a scene file."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.host.numbers import decimal, ratio
from domesim.measure.dome.fit import GAIN
from domesim.measure.dome.measured import bare_scene, measured_section
from domesim.measure.dome.meter_table import MeterTask
from domesim.measure.dome.meters import COSINE, UNEVEN, Metered
from domesim.observation.spherical import bare_gain
from domesim.observation.uncertain import SIGMAS

Floats = NDArray[np.float64]


def lines_of(task: MeterTask, found: Metered) -> list[str]:
    """What was found, for a person."""
    theatre, dome = task.scene.theatre, task.scene.dome
    q = np.array([bare_gain(rho, dome) for rho in found.albedo])
    q_error = found.albedo_error * _slope(found.albedo, task)
    lines = [
        f"{len(task.readings)} readings, noise of one {task.noise.relative:.2%} and "
        f"{decimal(task.noise.absolute, 2)} ({task.noise.origin})"
        + (f"; {task.unread} rows not filled in" if task.unread else ""),
        f"white, direct light alone: {decimal(found.white, 4)} ± "
        f"{decimal(SIGMAS * found.white_error, 2)} cd/m²",
    ]
    if found.assumed is None:
        lines.append(
            f"reflected light of a white picture, of its direct light: {_each(q, q_error, found)}"
        )
        lines.append(
            f"screen albedo, as of a bare dome: {_each(found.albedo, found.albedo_error, found)}"
        )
    if theatre.perforation > 0 and found.assumed is None:
        kept = 1 - theatre.perforation
        lines.append(
            f"  of the paint between the holes ({theatre.perforation:.0%} of the screen): "
            f"{_each(found.albedo / kept, found.albedo_error / kept, found)}"
        )
    if found.assumed is not None and found.bounds is not None:
        low, high = found.bounds
        lines.append(
            f"screen albedo: not told by these readings; taken as described, {found.assumed:.3g}, "
            f"which may be any paint's. Whatever the screen reflects, direct white is "
            f"{decimal(low)} to {decimal(high)} cd/m². Read a half of the screen that is lit and "
            f"the other one from the same place (how-to.html)"
        )
    elif not found.of_primaries:
        lines.append("  one for all primaries: these readings do not tell them apart")
    flux = np.pi * found.white / float(np.mean(found.albedo)) * dome.screen_area
    lines.append(f"flux on the screen: about {flux:.3g} lm")
    black = black_of(task, found)
    if found.black_told:
        picture = found.white * (1 + float(np.mean(q)))
        lines.append(f"black: {decimal(black)} cd/m², contrast {ratio(picture / black + 1)}")
    else:
        lines.append(
            f"black: below {decimal(found.darkest, 2)} cd/m², which the meter does not tell; taken "
            f"as described, {decimal(black)} cd/m²"
        )
    lines.append(
        f"taken: light over the screen is even within {UNEVEN:.0%}"
        + (f", the lux meter's cosine is right within {COSINE:.0%}" if _lux(task) else "")
    )
    if more := theatre.departures():
        lines.append(
            f"described, but not in the scene that is written, a bare dome: {'; '.join(more)}. "
            f"What that costs: docs/measuring-by-meter.md"
        )
    if found.degrees > 0:
        verdict = "noise alone explains the readings"
        if found.model_error > 0:
            verdict = (
                f"more than noise: each reading is off by another {found.model_error:.1%}, which "
                f"the intervals have been widened for"
            )
        lines.append(
            f"fit: chi² {found.chi2:.1f} for {found.degrees} degrees of freedom; {verdict}"
        )
    return lines


def black_of(task: MeterTask, found: Metered) -> float:
    """Light of a black picture, cd/m²; as described where the meter does not tell it."""
    return found.black if found.black_told else min(found.darkest, task.scene.projector.black)


def figures_of(found: Metered) -> dict[str, Any]:
    """The same for a program."""
    return {
        "white_cd_m2": found.white,
        "white_standard_error": found.white_error,
        "albedo": found.albedo.tolist(),
        "albedo_standard_error": found.albedo_error.tolist(),
        "of_primaries": found.of_primaries,
        "assumed_albedo": found.assumed,
        "black_cd_m2": found.black,
        "black_standard_error": found.black_error,
        "white_bounds_cd_m2": None if found.bounds is None else list(found.bounds),
        "chi2": found.chi2,
        "degrees_of_freedom": found.degrees,
        "model_error": found.model_error,
    }


def measured_scene(task: MeterTask, found: Metered, name: str) -> str:
    """A scene of the bare dome that reflects as much."""
    mine = [0, 1, 0, 2, 0, 3]  # white is one figure, which each primary has
    return bare_scene(
        task,
        name,
        task.source,
        told=f"Reflected light by a meter: {task.source.name}.",
        albedo=found.albedo,
        gain=np.full(3, found.white),
        ambient=np.full(3, black_of(task, found) / found.white),
        measured=measured_section(
            task,
            task.source,
            names=(GAIN, "screen"),
            values=np.stack([np.full(3, found.white), found.albedo]),
            errors=np.stack([np.full(3, found.white_error), found.albedo_error]),
            correlations=found.correlations[np.ix_(mine, mine)],
            chi2=found.chi2,
            degrees=found.degrees,
            model_error=found.model_error,
        ),
    )


def _slope(albedo: Floats, task: MeterTask) -> Floats:
    """(primary,) how much more a bare dome reflects of white, per albedo."""
    step = 1e-4
    ends = [[bare_gain(float(rho) + side, task.scene.dome) for rho in albedo] for side in (0, step)]
    return np.asarray(np.diff(ends, axis=0)[0] / step)


def _lux(task: MeterTask) -> bool:
    return task.readings[0].lux


def _each(values: Floats, errors: Floats, found: Metered) -> str:
    parts = [
        f"{decimal(v)} ± {decimal(SIGMAS * e, 2)}" for v, e in zip(values, errors, strict=True)
    ]
    if not found.of_primaries:
        return parts[0]
    return ", ".join(f"{p} {part}" for p, part in zip("RGB", parts, strict=True))
