"""Whoever is unsure of the pollution does best to compensate for all of it that was measured.

Rationale
    A measured room is known within errors. If too much light is taken off where the picture is
    dark, dark halos stay; if too little, ghosts. Should one of the two be worse, whoever is unsure
    had better lean to the other side: compensate for the measured pollution times 1 - k sigma, with
    sigma its relative standard error, and a caution k that is to be found here. So pictures are
    compensated by models that are off, and looked at in the room as it is, by ColorVideoVDP, FLIP
    and the vision model that the method minimises. The truth is normally distributed about the
    measured value; what may be expected of a caution is the mean over it (Gauss-Hermite nodes [1]).
    Caution would be adopted if, at an uncertainty of 10 % or less, it were worth a twentieth of a
    JOD in the mean of all pictures. [1] M. Abramowitz, I. A. Stegun, Handbook of Mathematical
    Functions, 25.4.46.
Expected
    At an uncertainty of 10 %, more than any measurement leaves, a caution of 1 is worth less than
    a twentieth of a JOD for every picture, and by FLIP less than a twentieth of the error. It never
    lowers the error that the method minimises, and where nothing clips it raises it by half.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TypeAlias, final

import numpy as np

from compensate.figures import Appraisal
from compensate.pose import Posed, pose
from compensate.solve import solved
from compensate.weighting import PerceptualWeighting
from domesim.light import Light
from domesim.observation.spherical import bare_gain
from domesim.scene import DomeScene, Scene, StereoScene
from validation import inputs, judges
from validation.experiment import Column, Finding, Table, Work, at_least, at_most
from validation.pairs import no_wider

WHITE = inputs.USUAL_LUMINANCE
SIGMAS = (0.01, 0.02, 0.05, 0.1, 0.2)
CAUTIONS = (0.0, 0.5, 1.0, 2.0)
QUICK_SIGMAS, QUICK_CAUTIONS = (0.1,), (0.0, 1.0)
USUAL = 0.1
"""Uncertainty at which something is expected."""
NODES = 3
SIZE = 192
NAMES = ("night", "generated", "full dome", "fog", "trunks")
"""Names of the inputs, as in `inputs.wanted`."""
LIFTED = ("night", "generated")
"""Which are shown as days, too."""
WORTH = 0.05
"""JOD, or share of an error."""

Case: TypeAlias = tuple[Callable[[], Light], Scene]


@final
@dataclass(frozen=True)
class Seen:
    """What is seen of one compensation in one room.

    Attributes
    ----------
    minimised
        The error that is minimised for that room, JND rms; not within its bounds, which the
        solution for another room may leave.
    visible
        The visible error, which is taken from the master, JND rms.
    quality, flip
        By ColorVideoVDP, JOD; by FLIP. None where they are not installed.
    """

    minimised: float
    visible: float
    quality: float | None
    flip: float | None


Pictured: TypeAlias = dict[str, Seen]
"""By `_key` of what the model and the truth are off by."""


def wanted(work: Work) -> dict[str, Case]:
    """Pictures, most of which clip, and where they are shown."""
    found: dict[str, Case] = {}
    given, _ = inputs.wanted(work)
    for name in NAMES:
        if name in given:
            one = given[name]
            scene = one.scene(one.usual, WHITE)
            found[name] = (partial(_read, one), scene)
            if name in LIFTED:
                found[f"{name}, as a day"] = (partial(_lifted, one, scene), scene)
    return found


def _read(one: inputs.Input) -> Light:
    return no_wider(one.read(), SIZE)


def _lifted(one: inputs.Input, scene: Scene) -> Light:
    """So bright that nothing clips."""
    light = _read(one)
    on = scene.screen(*light.shape[1:3])[None, :, :, None]
    return np.asarray((0.3 + 0.65 * light) * on, np.float32)


def scaled(scene: Scene, factor: float) -> Scene:
    """The scene with `factor` times the pollution."""
    if isinstance(scene, StereoScene):
        seats = {
            name: replace(seat, matrices=factor * seat.matrices)
            for name, seat in scene.seats.items()
        }
        return replace(scene, seats=seats)
    assert isinstance(scene, DomeScene)
    # Of a bare screen that fills a share s of the sphere, phi = rho s / (1 - rho s)
    gain = factor * bare_gain(scene.albedo[0], scene.dome)
    share = bare_gain(scene.albedo[0], scene.dome)
    share = share / (1 + share) / scene.albedo[0]
    return replace(scene, theatre=replace(scene.theatre, albedo=(gain / (1 + gain) / share,) * 3))


def measure(case: Case, sigmas: Sequence[float], cautions: Sequence[float]) -> Pictured:
    """One picture by all models in all rooms."""
    light, scene = case
    desired = light()

    @cache
    def posed(off: float) -> Posed:
        return pose(desired, scaled(scene, 1 + off), PerceptualWeighting())

    @cache
    def projected(off: float) -> Light:
        return solved(posed(off), "perceptual").light

    found: Pictured = {}
    for model, truth in _tried(sigmas, cautions):
        room, shown = posed(truth), projected(model)
        seen = room.observation.observe(shown)
        found[_key(model, truth)] = Seen(
            Appraisal(room).visible_error(shown),
            Appraisal(room).visible_error(shown),
            judges.if_installed(judges.colorvideovdp, desired, seen, scene),
            judges.if_installed(judges.flip, desired, seen, scene),
        )
    return found


def _tried(sigmas: Sequence[float], cautions: Sequence[float]) -> list[tuple[float, float]]:
    """What the model and the truth are off by."""
    expected = {(-k * s, z * s) for s in sigmas for k in cautions for z in _nodes()[0]}
    sides = {(side * s, 0.0) for s in sigmas for side in (-1, 0, 1)}
    return sorted(expected | sides)


@cache
def _nodes() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Places and weights by which means over a standard normal distribution are taken."""
    places, weights = np.polynomial.hermite_e.hermegauss(NODES)
    return tuple(places.tolist()), tuple((weights / weights.sum()).tolist())


def _key(model: float, truth: float) -> str:
    return " ".join(f"{round(off, 6) + 0.0:.6f}" for off in (model, truth))


def expected(found: Pictured, judge: str, sigma: float, caution: float) -> float | None:
    """What a judge may be expected to say; None if it is not installed."""
    said = [getattr(found[_key(-caution * sigma, z * sigma)], judge) for z in _nodes()[0]]
    return None if None in said else float(np.dot(_nodes()[1], said))


def run(work: Work) -> Finding:
    """Compensate for what may be wrong."""
    sigmas = QUICK_SIGMAS if work.quick else SIGMAS
    cautions = QUICK_CAUTIONS if work.quick else CAUTIONS
    found = work.each(wanted(work), Pictured, lambda case: measure(case, sigmas, cautions))
    errors = _over(found, "minimised", lambda with_it, without: with_it / without)
    flips = _over(found, "flip", lambda with_it, without: with_it / without)
    worth = _over(found, "quality", lambda with_it, without: with_it - without)
    days = [error for name, error in errors.items() if "day" in name]
    checks = [
        at_least("least error of caution 1, over that of 0", min(errors.values()), 1),
        at_least("days: least error of caution 1, over that of 0", min(days), 1.5),
    ]
    said = [
        f"the error that is minimised is {min(errors.values()):.3f} to {max(errors.values()):.3f} "
        f"times that of compensating for all"
    ]
    if flips:
        checks.append(
            at_least("least FLIP of caution 1, over that of 0", min(flips.values()), 1 - WORTH)
        )
        said.append(f"FLIP's {min(flips.values()):.3f} to {max(flips.values()):.3f} times")
    if worth:
        most, mean = max(worth.values()), float(np.mean(list(worth.values())))
        checks.append(at_most("most that caution 1 is worth", most, WORTH, "JOD"))
        said.append(f"ColorVideoVDP gives it {mean:+.3f} JOD in the mean, at most {most:+.3f}")
    return Finding(
        result=(
            f"If the pollution is known within {USUAL:.0%}, and one standard error less is "
            f"compensated for, {'; '.join(said)}. So there is no caution by default."
        ),
        advice="Compensate for what was measured. Where a judge likes less compensation better, "
        "it does so however sure the measurement is.",
        checks=tuple(checks),
        tables=(_sides(found, sigmas), _expectations(found, sigmas, cautions)),
        figures={"error_least": min(errors.values()), "error_most": max(errors.values())},
        left_out=tuple(
            judges.left_out(
                {
                    _COLUMNS[judge].name: [
                        getattr(seen, judge) for one in found.values() for seen in one.values()
                    ]
                    for judge in ("quality", "flip")
                }
            )
        ),
    )


def _over(
    found: Mapping[str, Pictured], judge: str, compared: Callable[[float, float], float]
) -> dict[str, float]:
    """What caution 1 is, compared with 0; of pictures that were judged."""
    result = {}
    for name, one in found.items():
        with_it, without = (expected(one, judge, USUAL, k) for k in (1.0, 0.0))
        if with_it is not None and without is not None:
            result[name] = compared(with_it, without)
    return result


def _sides(found: Mapping[str, Pictured], sigmas: Sequence[float]) -> Table:
    """What too little and too much cost in one room."""
    sides = {"too little": -1, "right": 0, "too much": 1}
    rows: list[tuple[str | float | None, ...]] = [
        (
            name,
            100 * sigma,
            *(
                getattr(one[_key(side * sigma, 0.0)], judge)
                for judge in _COLUMNS
                for side in sides.values()
            ),
        )
        for name, one in found.items()
        for sigma in sigmas
    ]
    return Table(
        caption="One room, compensated for too little, for all, and for too much pollution.",
        columns=(
            Column(name="picture"),
            Column(name="off by", unit="%"),
            *(
                column.model_copy(update={"name": f"{column.name}, {side}"})
                for column in _COLUMNS.values()
                for side in sides
            ),
        ),
        rows=tuple(rows),
    )


def _expectations(
    found: Mapping[str, Pictured], sigmas: Sequence[float], cautions: Sequence[float]
) -> Table:
    rows: list[tuple[str | float | None, ...]] = [
        (name, 100 * sigma, k, *(expected(one, judge, sigma, k) for judge in _COLUMNS))
        for name, one in found.items()
        for sigma in sigmas
        for k in cautions
    ]
    return Table(
        caption="What may be expected of a caution, if the pollution is known within an error.",
        columns=(
            Column(name="picture"),
            Column(name="standard error", unit="%"),
            Column(name="caution"),
            *_COLUMNS.values(),
        ),
        rows=tuple(rows),
    )


_COLUMNS = {
    "quality": Column(name="ColorVideoVDP", unit="JOD", digits=".4f"),
    "flip": Column(name="FLIP", digits=".4f"),
    "minimised": Column(name="minimised error", unit="JND rms", digits=".4g"),
    "visible": Column(name="visible error", unit="JND rms", digits=".4g"),
}
"""Columns of tables, by the attribute of `Seen` that they show."""
