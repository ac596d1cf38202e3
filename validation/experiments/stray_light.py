"""Beside bright things the viewer's own eyes add more light than the room does.

Rationale
    The eye scatters light over all that it sees (`compensate.vision.glare`, CIE 146:2002). What the
    room adds where the eye adds more need perhaps not be mended. Domemasters of `quality`, 256
    pixels across, are shown in `dome_dark` (by its closed form). Every pixel is gazed at in turn:
    the veil of the master in the eye is compared with the room's light there. `predict` says where
    pollution is seen, without and with the eye's light.
Expected
    At 25 years the eye exceeds the room's light at 10 to 25 % of the gazes in the mean of the
    inputs, and at more when it is older. With the eye's light less pollution is predicted to be
    visible after subtraction, but at least half of it: a dark place far from all bright things has
    a small veil.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import final

import numpy as np

from compensate.pose import Posed, pose
from compensate.prediction import Prediction, predict
from compensate.vision.glare import StrayLight
from domesim.light import Light
from domesim.scene import load_dome
from testing.pairs import no_wider
from validation.experiment import (
    Check,
    Column,
    Finding,
    Table,
    Work,
    at_least,
    between,
)
from validation.inputs import Input, reported_domemasters
from validation.judges import luminance

SCENE = "dome_dark"
SIZE = 256
AGES = (25, 45, 70)


@final
@dataclass(frozen=True)
class Seen:
    """A domemaster in the dark dome, and its quality.

    Attributes
    ----------
    exceeded
        Share of the screen, by age, where the eye adds more light than the room, untouched.
    visible
        Share of the screen where pollution is predicted to be seen after subtraction: by an eye
        that scatters nothing, and by age.
    """

    exceeded: dict[int, float]
    visible: dict[int, float]


def measure(read: Input, size: int = SIZE) -> Seen:
    """One domemaster."""
    light = no_wider(read.read(), size).astype(np.float32)
    posed = pose(light, load_dome(SCENE))
    eyes: Mapping[int, StrayLight | None] = {0: None, **{age: StrayLight(age) for age in AGES}}
    visible = {
        age: predict(posed, posed.subtractive, Prediction(eye=eye)).share
        for age, eye in eyes.items()
    }
    return Seen(gazes(posed, posed.desired), visible)


def gazes(posed: Posed, light: Light) -> dict[int, float]:
    """Share of the screen where the eye adds more light to the master than the room, by age."""
    scene = posed.scene
    density = scene.viewing.pixels_per_degree(*posed.screen.shape)
    master = luminance(posed.wanted, scene)
    room = np.abs(luminance(posed.seen(light), scene) - master)
    return {
        age: float(np.mean((StrayLight(age).veil(master, density) > room)[:, posed.screen]))
        for age in AGES
    }


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    inputs, left_out = reported_domemasters(work)
    found = work.each(inputs, Seen, partial(measure, size=SIZE))
    mean = _means(found)
    young, old = AGES[0], AGES[-1]
    return Finding(
        result=_told(found, mean),
        checks=tuple(_checks(work, found, mean)),
        tables=(_table(found),),
        figures={
            "stray_light.exceeded_young": mean.exceeded[young],
            "stray_light.exceeded_old": mean.exceeded[old],
            "stray_light.visible": mean.visible[0],
            "stray_light.visible_old": mean.visible[old],
        },
        left_out=tuple(left_out),
    )


def _means(found: Mapping[str, Seen]) -> Seen:
    """Means of all inputs."""
    seen = list(found.values())

    def by_age(name: str) -> dict[int, float]:
        return {
            age: float(np.mean([getattr(each, name)[age] for each in seen]))
            for age in getattr(seen[0], name)
        }

    return Seen(by_age("exceeded"), by_age("visible"))


def _told(found: Mapping[str, Seen], mean: Seen) -> str:
    shares = {age: [each.exceeded[age] for each in found.values()] for age in AGES}
    return (
        f"In {SCENE} the eye adds more light to the master than the room at "
        + ", ".join(
            f"{mean.exceeded[age]:.0%} of the gazes at {age} years "
            f"({min(shares[age]):.0%} to {max(shares[age]):.0%})"
            for age in AGES
        )
        + f". After subtraction pollution is predicted to be visible on {mean.visible[0]:.1%} of "
        f"the screen for an eye that scatters nothing, and on "
        + ", ".join(f"{mean.visible[age]:.1%} at {age} years" for age in AGES)
        + "."
    )


def _checks(work: Work, found: Mapping[str, Seen], mean: Seen) -> Iterator[Check]:
    young, middle, old = AGES
    if not work.quick:
        yield between("gazes with more light of the eye, 25 years", mean.exceeded[young], 0.1, 0.25)
    yield at_least(
        "the same at 70 years over 25 years, least of all",
        min(each.exceeded[old] - each.exceeded[young] for each in found.values()),
        0.0,
    )
    yield between(
        "screen with visible pollution at 45 years over no stray light",
        mean.visible[middle] / mean.visible[0],
        0.5,
        1.0,
    )


def _table(found: Mapping[str, Seen]) -> Table:
    return Table(
        caption=f"Share of the gazes at which the eye adds more light than the room of {SCENE}, "
        f"and share of the screen where `predict` sees pollution after subtraction, by age.",
        columns=(
            Column(name="input"),
            *(Column(name=f"untouched, {age} years", unit="%", digits=".1f") for age in AGES),
            Column(name="visible, no stray light", unit="%", digits=".1f"),
            *(Column(name=f"visible, {age} years", unit="%", digits=".1f") for age in AGES),
        ),
        rows=tuple(
            (
                name,
                *(100 * each.exceeded[age] for age in AGES),
                *(100 * each.visible[age] for age in (0, *AGES)),
            )
            for name, each in found.items()
        ),
    )
