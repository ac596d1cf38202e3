"""Beside bright things the viewer's own eyes add more light than the room does.

Rationale
    The eye scatters light over all that it sees (`compensate.vision.glare`, CIE 146:2002). What the
    room adds where the eye adds more need perhaps not be mended. Domemasters of `quality`, 256
    pixels across, are shown in `dome_dark` (by its closed form) and, for quality, in
    `dome_hemisphere` with an albedo of 0.5 and a white of 15 cd/m². Every pixel is gazed at in
    turn: the veil of the master in the eye is compared with the room's light there. `predict` says
    where pollution is seen, without and with the eye's light. Then the default's aim is made with
    the eye's light in what contrasts are relative to, lambda(y) = (y - B)/(B + V + c), V the
    master's veil in an eye of 70 years, and ColorVideoVDP compares it with the default, of light on
    the screen and of light on that eye's retina.
Expected
    At 25 years the eye exceeds the room's light at 10 to 25 % of the gazes in the mean of the
    inputs, and at more when it is older. With the eye's light less pollution is predicted to be
    visible after subtraction. The aim is within 0.02 JOD of the default's, so that it is not worth
    a setting of `compensate`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias, final

import numpy as np

from compensate.aim import Aim, Sight, lifted, with_hue
from compensate.pose import Posed, pose
from compensate.prediction import Prediction, predict
from compensate.problem import Problem
from compensate.solve import solved
from compensate.solver.baselines import clipped_subtraction
from compensate.vision.glare import StrayLight
from domesim.light import Light
from domesim.observation.lowrank import LowRankObservation
from domesim.scene import load_dome
from validation.experiment import (
    Check,
    Column,
    Finding,
    Missing,
    Table,
    Work,
    at_least,
    at_most,
    between,
)
from validation.inputs import (
    USUAL_ALBEDO,
    USUAL_LUMINANCE,
    Input,
    dome_at,
    reported_domemasters,
)
from validation.judges import colorvideovdp, luminance
from validation.pairs import no_wider

SCENE = "dome_dark"
SIZE = 256
AGES = (25, 45, 70)
OLD = StrayLight(70)
WORTH = 0.02
"""JOD that a setting would have to gain."""

Jods: TypeAlias = tuple[float, float, float]
"""JOD of subtraction, of the default, and of the aim with the eye's light."""


@final
@dataclass(frozen=True)
class Seen:
    """A domemaster in the dark dome, and its quality.

    Attributes
    ----------
    exceeded, exceeded_subtracted
        Share of the screen, by age, where the eye adds more light than the room: untouched, and
        after subtraction.
    visible
        Share of the screen where pollution is predicted to be seen after subtraction: by an eye
        that scatters nothing, and by age.
    jod
        Scene -> subtraction, the default, and the aim with the eye's light: of light on the screen.
    retinal
        The same of light on the retina.
    """

    exceeded: dict[int, float]
    exceeded_subtracted: dict[int, float]
    visible: dict[int, float]
    jod: dict[str, Jods]
    retinal: dict[str, Jods]


def measure(read: Input, size: int = SIZE) -> Seen:
    """One domemaster."""
    light = no_wider(read.read(), size).astype(np.float32)
    posed = pose(light, load_dome(SCENE), Aim())
    exceeded, after = gazes(posed, posed.desired), gazes(posed, posed.subtractive)
    eyes: Mapping[int, StrayLight | None] = {0: None, **{age: StrayLight(age) for age in AGES}}
    visible = {
        age: predict(posed, posed.subtractive, Prediction(eye=eye)).share
        for age, eye in eyes.items()
    }
    jod, retinal = {}, {}
    for scene in (load_dome(SCENE), dome_at(USUAL_ALBEDO, USUAL_LUMINANCE)):
        try:
            jod[scene.name], retinal[scene.name] = judged(pose(light, scene, Aim()))
        except Missing:
            break
    return Seen(exceeded, after, visible, jod, retinal)


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


def judged(posed: Posed) -> tuple[Jods, Jods]:
    """JOD of subtraction, the default, and the aim with the old eye's light: screen, retina."""
    ways = (posed.subtractive, solved(posed, "perceptual").light, aimed(posed, OLD))
    shown = [posed.seen(light) for light in ways]

    def compared(seen: Callable[[Light], Light]) -> Jods:
        first, second, third = (
            colorvideovdp(seen(posed.wanted), seen(each), posed.scene) for each in shown
        )
        return first, second, third

    return compared(lambda light: light), compared(partial(on_retina, posed))


def on_retina(posed: Posed, light: Light) -> Light:
    """Light as it reaches the old eye's retina; the judge does not look off the screen."""
    density = posed.scene.viewing.pixels_per_degree(*posed.screen.shape)
    found = np.moveaxis(OLD.seen(np.moveaxis(light, -1, 1), density), 1, -1)
    return np.asarray(np.where(posed.screen[..., None], found, 0))


def aimed(posed: Posed, eye: StrayLight | None) -> Light:
    """The light of the default's aim, with an eye's light in what contrasts are relative to.

    Without an eye it is the product's default.
    """
    observation, projector, settings = posed.observation, posed.scene.projector, Aim()
    assert isinstance(observation, LowRankObservation)
    density = posed.scene.viewing.pixels_per_degree(*posed.screen.shape)
    sight = Sight(posed.screen, projector.luminance_weights, projector.white, density)
    veil: Light = np.zeros_like(posed.wanted)
    if eye is not None:
        veil = np.moveaxis(eye.veil(np.moveaxis(posed.wanted, -1, 1), density), 1, -1)
    white = observation.direct(np.ones_like(posed.desired))
    floor = posed.shown - observation.direct(posed.subtractive)
    # The veil is in the base alone: what is missing, floor less wanted, stays as it is
    base, plain = posed.wanted + veil, replace(settings, hue=0.0)
    gain = lifted(plain, sight, base, floor + veil, white + veil) / np.maximum(base, 1e-9)
    raised = np.minimum(posed.wanted * gain, white)
    planes = (np.moveaxis(light, -1, 0) for light in (posed.wanted, raised, floor))
    return _showing(posed, np.stack(with_hue(settings, *planes), axis=-1))


def _showing(posed: Posed, seen: Light) -> Light:
    """Exact clipped subtraction of what should be seen."""
    given = posed.single
    problem = Problem(given.observation, given.weighting, seen, (given.lower, given.upper))
    return clipped_subtraction(problem)[0]


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    inputs, left_out = reported_domemasters(work)
    found = work.each(inputs, Seen, partial(measure, size=SIZE))
    mean = _means(found)
    young, old = AGES[0], AGES[-1]
    judged = all(each.jod for each in found.values())
    if not judged:
        left_out.append("ColorVideoVDP: it needs pip install 'domesim[metrics]'")
    return Finding(
        result=_told(found, mean, judged=judged),
        checks=tuple(_checks(work, found, mean, judged=judged)),
        tables=tuple(_tables(found, judged=judged)),
        figures={
            "stray_light.exceeded_young": mean.exceeded[young],
            "stray_light.exceeded_old": mean.exceeded[old],
            "stray_light.visible": mean.visible[0],
            "stray_light.visible_old": mean.visible[old],
            **({"stray_light.gain": _gain(mean.retinal)} if judged else {}),
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

    def by_scene(name: str) -> dict[str, Jods]:
        every: dict[str, Jods] = {}
        for scene in getattr(seen[0], name):
            subtracted, default, veiled = np.mean(
                [getattr(each, name)[scene] for each in seen], axis=0
            )
            every[scene] = (float(subtracted), float(default), float(veiled))
        return every

    return Seen(
        by_age("exceeded"),
        by_age("exceeded_subtracted"),
        by_age("visible"),
        by_scene("jod"),
        by_scene("retinal"),
    )


def _gain(jod: Mapping[str, Jods]) -> float:
    """What the eye's light in the aim gains over the default, mean of the scenes."""
    return float(np.mean([veiled - default for _, default, veiled in jod.values()]))


def _told(found: Mapping[str, Seen], mean: Seen, *, judged: bool) -> str:
    shares = {age: [each.exceeded[age] for each in found.values()] for age in AGES}
    text = (
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
    if judged:
        text += (
            f" An aim that counts the light of an eye of {OLD.age:g} years gains "
            f"{_gain(mean.jod):+.3f} JOD on the screen and {_gain(mean.retinal):+.3f} JOD on that "
            f"eye's retina: it is no setting of `compensate`, and `predict --age` has it."
        )
    return text


def _checks(work: Work, found: Mapping[str, Seen], mean: Seen, *, judged: bool) -> Iterator[Check]:
    young, middle, old = AGES
    if not work.quick:
        yield between("gazes with more light of the eye, 25 years", mean.exceeded[young], 0.1, 0.25)
    yield at_least(
        "the same at 70 years over 25 years, least of all",
        min(each.exceeded[old] - each.exceeded[young] for each in found.values()),
        0.0,
    )
    yield at_most(
        "screen with visible pollution at 45 years over no stray light",
        mean.visible[middle] / mean.visible[0],
        1.0,
    )
    if judged:
        for where, jod in (("screen", mean.jod), ("retina", mean.retinal)):
            yield between(
                f"gain of an aim with the eye's light, on the {where}",
                _gain(jod),
                -WORTH,
                WORTH,
                "JOD",
            )


def _tables(found: Mapping[str, Seen], *, judged: bool) -> Iterator[Table]:
    yield Table(
        caption=f"Share of the gazes at which the eye adds more light than the room of {SCENE}, "
        f"and share of the screen where `predict` sees pollution after subtraction, by age.",
        columns=(
            Column(name="input"),
            *(Column(name=f"untouched, {age} years", unit="%", digits=".1f") for age in AGES),
            *(Column(name=f"subtracted, {age} years", unit="%", digits=".1f") for age in AGES),
            Column(name="visible, no stray light", unit="%", digits=".1f"),
            *(Column(name=f"visible, {age} years", unit="%", digits=".1f") for age in AGES),
        ),
        rows=tuple(
            (
                name,
                *(100 * each.exceeded[age] for age in AGES),
                *(100 * each.exceeded_subtracted[age] for age in AGES),
                *(100 * each.visible[age] for age in (0, *AGES)),
            )
            for name, each in found.items()
        ),
    )
    if not judged:
        return
    yield Table(
        caption="ColorVideoVDP's JOD, 10 is the master, of subtraction, of the default, and of its "
        f"aim with the light of an eye of {OLD.age:g} years: of light on the screen, and on that "
        "eye's retina.",
        columns=(
            Column(name="input"),
            Column(name="scene"),
            *(
                Column(name=f"{way}, {where}", digits=".3f")
                for where in ("screen", "retina")
                for way in ("subtraction", "default", "with the eye's light")
            ),
        ),
        rows=tuple(
            (name, scene, *each.jod[scene], *each.retinal[scene])
            for name, each in found.items()
            for scene in each.jod
        ),
    )
