"""Whole pictures: which method shows them best, by a judge that no objective knows.

Rationale
    `quality` looks at pictures of 512 pixels at many pollutions and luminances. Here they are as
    large as they are, at its usual ones: stereo pairs with 5 % of crosstalk, domemasters in a
    hemisphere of albedo 0.5, white 15 cd/m². Those of other scenes or other random numbers than
    `quality`'s are marked *new*: no setting was chosen by them. What is seen is compared with the
    master by ColorVideoVDP.
Expected
    On every picture the default, weighting local contrast, is better than the paper's weighting and
    at most 0.02 JOD below the better of subtraction and nothing; its mean gain over subtraction is
    above 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias, final

import numpy as np

from compensate.contrast import ContrastWeighting, Eye
from compensate.master import pose, solved
from compensate.weighting import PerceptualWeighting
from domesim.frames import read_master
from domesim.light import Light
from domesim.scene import Scene
from validation import judges, masters, pairs
from validation.experiment import Column, Finding, Table, Work, at_least, at_most
from validation.experiments.only_visible import timed
from validation.experiments.quality.gains import SHORT
from validation.experiments.quality.inputs import (
    DOMES,
    PAIRS,
    USUAL_ALBEDO,
    USUAL_CROSSTALK,
    USUAL_LUMINANCE,
    dome_at,
    domemaster,
    stereo_at,
)
from validation.hue import shift_in_the_dark

SIZE = 1024
"""Of what is generated, pixels."""
QUICK_SIZE = 64

WAYS: Mapping[str, tuple[str, Eye]] = {
    "nothing": ("none", PerceptualWeighting()),
    "subtraction": ("subtractive", PerceptualWeighting()),
    "the paper's weighting": ("perceptual", PerceptualWeighting()),
    "local contrast": ("perceptual", ContrastWeighting()),
}
OURS, PAPER, PLAIN = "local contrast", "the paper's weighting", ("nothing", "subtraction")

Read: TypeAlias = Callable[[], Light]


@final
@dataclass(frozen=True)
class Shown:
    """What one way shows of one picture.

    Attributes
    ----------
    quality
        JOD, mean of both eyes.
    hue
        Shift of hue of the darker half of a domemaster, degrees; None of a pair.
    seconds
        Of the solution, once things have been made ready.
    """

    quality: float
    hue: float | None
    seconds: float


def run(work: Work) -> Finding:
    """Every way for every picture."""
    size = QUICK_SIZE if work.quick else SIZE
    read, left_out = _pictures(work, size)
    found = {
        name: work.each(
            {f"{name}: {way}": settings for way, settings in WAYS.items()},
            Shown,
            partial(_measured, picture, scene),
        )
        for name, (picture, scene) in read.items()
    }
    shown = {name: dict(zip(WAYS, ways.values(), strict=True)) for name, ways in found.items()}
    over_paper = {name: one[OURS].quality - one[PAPER].quality for name, one in shown.items()}
    over_plain = {
        name: one[OURS].quality - max(one[way].quality for way in PLAIN)
        for name, one in shown.items()
    }
    gains = [one[OURS].quality - one["subtraction"].quality for one in shown.values()]
    worst, least = (min(gain, key=gain.__getitem__) for gain in (over_plain, over_paper))
    checks = [
        at_least("gain over subtraction, mean", float(np.mean(gains)), 0, "JOD"),
        at_least(
            f"gain over the paper's weighting, the least ({least})", over_paper[least], 0, "JOD"
        ),
    ]
    if work.quick:
        left_out.append("The largest shortfall, and the test data: with a full run")
    else:
        short = f"shortfall from the better of subtraction and nothing, the largest ({worst})"
        checks.append(at_most(short, -over_plain[worst], SHORT, "JOD"))
    return Finding(
        result=(
            f"On {len(shown)} whole pictures local contrast gains {np.mean(gains):+.3f} JOD over "
            f"subtraction ({min(gains):+.3f} to {max(gains):+.3f}), {over_paper[least]:+.3f} or "
            f"more over the paper's weighting ({least}), and {over_plain[worst]:+.3f} or more over "
            f"the better of subtraction and nothing ({worst})."
        ),
        checks=tuple(checks),
        tables=(_table(shown),),
        figures={
            f"whole.{name}.{way}.quality": one.quality
            for name, ways in shown.items()
            for way, one in ways.items()
        },
        left_out=tuple(left_out),
    )


def _pictures(work: Work, size: int) -> tuple[dict[str, tuple[Read, Scene]], list[str]]:
    """Pictures and scenes by name, and why others are not measured."""
    stereo = stereo_at(USUAL_CROSSTALK, USUAL_LUMINANCE)
    dome = dome_at(USUAL_ALBEDO, USUAL_LUMINANCE)
    left_out: list[str] = []
    present: list[str] = []
    if not work.quick:
        present, left_out = pairs.present((*PAIRS, pairs.SEQUENCE[-1]))
    new = {pairs.SEQUENCE[-1]}
    named = {name: partial(_of_data, name, stereo) for name in present}
    found: dict[str, tuple[Read, Scene]] = {
        f"{name} (new)" if name in new else name: (read, stereo) for name, read in named.items()
    }
    found["generated (new)"] = (partial(pairs.generated, size, work.seed + 1), stereo)
    found["night"] = (partial(domemaster, masters.bundled_night, size), dome)
    found["generated dome (new)"] = (partial(masters.night, size, work.seed + 1), dome)
    for name, file in {} if work.quick else DOMES.items():
        path = pairs.data_folder() / "dome" / file
        if path.is_file():
            read = partial(read_master, [path], repair=True)
            found[name] = (partial(domemaster, read, size), dome)
        else:
            left_out.append(f"{name}: needs {path}; set {pairs.FOLDER}")
    return found, left_out


def _of_data(name: str, scene: Scene) -> Light:
    return pairs.from_data(name, scene)[0]


def _measured(read: Read, scene: Scene, way: tuple[str, Eye]) -> Shown:
    method, eye = way
    posed = pose(read(), scene, eye)
    result, seconds = timed(lambda: solved(posed, method))
    desired, seen = posed.problem.desired, posed.seen(result.light)
    hue = shift_in_the_dark(desired, seen, scene) if scene.views == 1 else None
    return Shown(judges.colorvideovdp(desired, seen, scene), hue, seconds)


def _table(shown: Mapping[str, Mapping[str, Shown]]) -> Table:
    return Table(
        caption=(
            "ColorVideoVDP, JOD; shift of hue of the darker half of domemasters; seconds of the "
            "solution."
        ),
        columns=(
            Column(name="picture"),
            *(Column(name=way, unit="JOD", digits=".3f") for way in WAYS),
            *(Column(name=f"hue, {way}", unit="°", digits=".0f") for way in WAYS),
            *(Column(name=f"time, {way}", unit="s", digits=".1f") for way in (PAPER, OURS)),
        ),
        rows=tuple(
            (
                name,
                *(ways[way].quality for way in WAYS),
                *(ways[way].hue for way in WAYS),
                *(ways[way].seconds for way in (PAPER, OURS)),
            )
            for name, ways in shown.items()
        ),
    )
