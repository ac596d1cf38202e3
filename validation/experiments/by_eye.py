"""A viewer without a meter tells crosstalk, and a dome's albedo, and knows how surely.

Rationale
    `domesim measure by-eye` has viewers null what they see. Their settings scatter, stop early on
    one side more than on the other, slip, and improve; displays have 8 bits and a response that is
    not what anybody expects. Made-up viewers do all of that: they see a change where its contrast
    is above Daly's threshold at that light, times a skill. Displays are power laws of 2.2 and 2.4
    or sRGB, whose gamma is off by 0.1 (standard deviation). Rules for slips, for how much the
    sides' distance counts and for moderated variances were chosen on other seeds than these.
    Frames that are then made for what they found are seen where it is not quite so.
Expected
    Of viewers of ordinary skill (1.5 thresholds; quick: fewer runs) 93 to 97 % of the 95 %
    intervals of crosstalk, and of albedo, hold the truth; of careful and hasty ones 90 to 98.5 %.
    Who stops early on one side alone is off by half of that, and nobody can tell: at least 85 %.
    Half of the ordinary errors are below 6 %.
    Frames made for what an ordinary viewer finds lose less than 0.02 JOD more, in the mean, than
    frames made for the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.figures import Appraisal
from compensate.pose import Stage
from compensate.ruler import NO_DIFFERENCE
from compensate.solve import solved
from domesim.light import Light
from domesim.measure.by_eye.albedo import answering_levels
from domesim.measure.by_eye.result import Result
from domesim.measure.by_eye.session import Kind
from domesim.observation.uncertain import SIGMAS
from domesim.scene import DomeScene, StereoScene, load_dome, load_scene, load_stereo
from testing.masters import night_in
from testing.pairs import generated
from testing.viewers import Room, display, viewer
from validation.experiment import Check, Column, Finding, Table, Work, at_most, between

Floats = NDArray[np.float64]

SEEDS = 1_000_000
"""Seeds from here on are reported; those before it were for choosing."""
QUICK, FULL = 12, 400
"""Viewers of each kind."""
LOOKS = {True: 2, False: 12}
"""Viewers whose findings frames are made for."""
PEOPLE: Mapping[str, dict[str, Any]] = {
    "ordinary": {},
    "careful": {"skill": 0.8, "early": (0.5, 0.5), "slips": 0.01},
    "hasty": {"skill": 3.0, "slips": 0.08},
    "early on one side": {"early": (0.0, 2.0)},
}
HELD = {
    "ordinary": (0.93, 0.97),
    "careful": (0.9, 0.985),
    "hasty": (0.9, 0.985),
    "early on one side": (0.85, 0.985),
}
"""Share of intervals that are to hold the truth."""
SCREENS: Mapping[Kind, str] = {"stereo": "stereo_polarised_paper", "dome": "dome_hemisphere"}
WHAT: Mapping[Kind, str] = {"stereo": "crosstalk", "dome": "albedo"}
WIDE = {"stereo": 480, "dome": 256}
"""Pixels of the pictures that are looked at."""


@final
@dataclass(frozen=True)
class Found:
    """What one viewer found, relative to the truth.

    Attributes
    ----------
    off
        (eye and primary,) relative error.
    half
        Half of the 95 % interval, likewise.
    """

    off: list[float]
    half: list[float]

    @property
    def held(self) -> NDArray[np.bool_]:
        """Whether intervals hold the truth."""
        return np.abs(self.off) <= np.asarray(self.half)


@final
@dataclass(frozen=True)
class Cost:
    """Quality that frames lose, JOD: made for what a viewer found, and for the truth."""

    found: float
    known: float
    untouched: float


def run(work: Work) -> Finding:
    """Let viewers measure; make frames for what ordinary ones find."""
    count = QUICK if work.quick else FULL
    found = {
        (kind, people): work.step(
            f"{kind}, {people}", list[Found], partial(_measured, kind, people, count, work.seed)
        )
        for kind in SCREENS
        for people in PEOPLE
    }
    costs = {
        kind: work.step(
            f"{kind}, frames", list[Cost], partial(_costs, kind, LOOKS[work.quick], work.seed)
        )
        for kind in SCREENS
    }
    extra = {
        kind: np.array([cost.found - cost.known for cost in each]) for kind, each in costs.items()
    }
    held = {case: float(np.mean([one.held for one in each])) for case, each in found.items()}
    wide = {case: _median(each, "half") for case, each in found.items()}
    off = {case: _median(each, "off") for case, each in found.items()}
    told = "; ".join(
        f"{WHAT[kind]} within ±{wide[kind, 'ordinary']:.0%} (95 %), half of the errors below "
        f"{off[kind, 'ordinary']:.1%}; {held[kind, 'ordinary']:.1%} of the intervals hold the "
        f"truth; frames lose {extra[kind].mean():.3f} JOD more than with the truth, "
        f"{extra[kind].max():.3f} at most"
        for kind in SCREENS
    )
    return Finding(
        result=f"{count} viewers of each kind. Of ordinary skill: {told}.",
        advice="No meter? Measure by eye: the figures say how sure they are.",
        checks=tuple(_checks(held, off, extra, quick=work.quick)),
        tables=(_table(held, wide, off, found),),
        figures={
            f"{what}.{kind}.{people.replace(' ', '_')}": value
            for what, values in (("held", held), ("half", wide), ("off", off))
            for (kind, people), value in values.items()
        }
        | {f"extra_jod.{kind}": float(each.mean()) for kind, each in extra.items()},
    )


def _checks(
    held: Mapping[tuple[Kind, str], float],
    off: Mapping[tuple[Kind, str], float],
    extra: Mapping[Kind, Floats],
    *,
    quick: bool,
) -> list[Check]:
    checks = []
    for (kind, people), share in held.items():
        low, high = (0.8, 1.0) if quick else HELD[people]
        checks.append(
            between(f"{WHAT[kind]}, {people}: intervals that hold the truth", share, low, high)
        )
    for kind in SCREENS:
        checks += [
            at_most(f"{WHAT[kind]}, ordinary: median error", off[kind, "ordinary"], 0.06),
            at_most(
                f"{WHAT[kind]}, ordinary: quality lost for it",
                float(extra[kind].mean()),
                NO_DIFFERENCE,
                "JOD",
            ),
        ]
    return checks


def _table(
    held: Mapping[tuple[Kind, str], float],
    wide: Mapping[tuple[Kind, str], float],
    off: Mapping[tuple[Kind, str], float],
    found: Mapping[tuple[Kind, str], list[Found]],
) -> Table:
    return Table(
        "95 % intervals by eye, and errors relative to the truth.",
        (
            Column("what"),
            Column("viewers"),
            Column("intervals that hold the truth", "%", ".1f"),
            Column("median half interval", "%", ".1f"),
            Column("median error", "%", ".1f"),
            Column("rms error", "%", ".1f"),
        ),
        tuple(
            (
                WHAT[kind],
                people,
                100 * held[kind, people],
                100 * wide[kind, people],
                100 * off[kind, people],
                100 * float(np.sqrt(np.mean(np.square([one.off for one in each])))),
            )
            for (kind, people), each in found.items()
        ),
    )


def _median(found: list[Found], what: str) -> float:
    return float(np.median(np.abs([getattr(one, what) for one in found])))


def _measured(kind: Kind, people: str, count: int, seed: int) -> list[Found]:
    start = SEEDS * (1 + seed)
    return [_one(kind, people, start + number)[0] for number in range(count)]


def _one(kind: Kind, people: str, seed: int) -> tuple[Found, dict[str, Floats], dict[str, Floats]]:
    """What a viewer found of a random screen; the truth, and the values, of each eye."""
    random = np.random.default_rng([seed, *people.encode()])
    who = viewer(random, **PEOPLE[people])
    scene = _scene(kind)
    truth = _truth(kind, random)
    seen = {
        eye: value if isinstance(scene, StereoScene) else answering_levels(scene, value)
        for eye, value in truth.items()
    }
    room = Room(
        kind,
        {eye: display(random) for eye in truth},
        {eye: dict(zip("RGB", map(float, value), strict=True)) for eye, value in seen.items()},
        scene.projector.white,
    )
    eyes = Result(scene, room.session(who)).figures()["eyes"]
    values = {eye: np.array(eyes[eye]["value"]) for eye in truth}
    errors = np.concatenate([eyes[eye]["standard_error"] for eye in truth])
    true, value = (np.concatenate(list(each.values())) for each in (truth, values))
    found = Found((value / true - 1).tolist(), (SIGMAS * errors / true).tolist())
    return found, truth, values


def _truth(kind: Kind, random: np.random.Generator) -> dict[str, Floats]:
    """Crosstalk of 0.4 to 5 %, or a screen of albedo 0.15 to 0.7."""
    if kind == "stereo":
        low, high = np.log(0.004), np.log(0.05)
        return {eye: np.exp(random.uniform(low, high, 3)) for eye in ("left", "right")}
    return {"both": random.uniform(0.15, 0.7) * np.array([1.05, 1.0, 0.93])}


def _scene(kind: Kind) -> DomeScene | StereoScene:
    name = SCREENS[kind]
    return load_dome(name) if kind == "dome" else load_stereo(name)


def _costs(kind: Kind, count: int, seed: int) -> list[Cost]:
    return [_cost(kind, SEEDS * (1 + seed) + number) for number in range(count)]


def _cost(kind: Kind, seed: int) -> Cost:
    _, truth, values = _one(kind, "ordinary", seed)
    true, found = (_as_scene(kind, each) for each in (truth, values))
    light = _picture(kind, true)
    posed = Stage(true).pose(light)
    seen = Appraisal(posed)
    return Cost(
        seen.loss(solved(Stage(found).pose(light), "perceptual").light),
        seen.loss(solved(posed, "perceptual").light),
        seen.loss_before,
    )


def _as_scene(kind: Kind, values: Mapping[str, Floats]) -> DomeScene | StereoScene:
    """The scene with these values."""
    if kind == "dome":
        made = load_scene(SCREENS[kind], screen={"albedo": values["both"].tolist()})
    else:
        leaks = {f"to_{eye}": np.maximum(value, 0).tolist() for eye, value in values.items()}
        made = load_scene(SCREENS[kind], crosstalk={"share": None, **leaks})
    assert isinstance(made, DomeScene | StereoScene)
    return made


def _picture(kind: Kind, scene: DomeScene | StereoScene) -> Light:
    return night_in(scene, WIDE[kind]) if isinstance(scene, DomeScene) else generated(WIDE[kind])
