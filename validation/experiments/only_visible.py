"""Solving only where pollution is seen: what it saves, and what it costs (Table 1, section 5).

Rationale
    The paper solves only where pollution is predicted to be visible: its Table 1 times one pair
    whole, and three parts of it. Here the same four areas of one pair are solved by the paper's
    weighting, around the place where subtraction leaves most; and of several pairs and domemasters
    (these 384 pixels across, on which nothing was chosen) what `--only-visible` takes, by local
    contrast, the default. It pays if the prediction finds what is seen: ColorVideoVDP says what is
    lost, and where it sees differences. (It is in no objective; but the prediction is of its kind,
    with its constants, see `compensate.vision.differences`. Note 0009 tells how its threshold was
    tuned on one half of the inputs of `quality` and tried on the other.) FFTs are counted as shares
    of the whole picture's.
Expected
    Work falls in proportion to the area, but for the windows' margins: a part takes at most twice
    its share of the whole's FFTs. To solve only what is predicted never takes 10 % more FFTs than
    the whole, and never costs more than 0.02 JOD (full run; where ColorVideoVDP is installed). Of
    what the judge marks (1 JOD and more, locally), the mask holds 95 % at no more than twice the
    area: of each picture, if 0.01 % of it is marked.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeVar, final

import numpy as np

from compensate.pose import Posed, pose
from compensate.prediction import remaining
from compensate.solve import solved
from compensate.solver.admm import ADMM
from compensate.solver.result import Result
from compensate.solver.windows import Windows
from compensate.visible import SEEN, OnlyVisible, reach_of
from compensate.weighting import PerceptualWeighting
from domesim.light import Light
from domesim.scene import Scene
from testing.pairs import generated
from testing.places import stereo_at
from validation.data import from_data, present
from validation.experiment import (
    Check,
    Column,
    Finding,
    Missing,
    Table,
    Work,
    at_least,
    at_most,
)
from validation.inputs import (
    USUAL_CROSSTALK,
    USUAL_LUMINANCE,
    Input,
    reported_domemasters,
    words,
)
from validation.judges import colorvideovdp_map, luminance

T = TypeVar("T")

PAIRS = ("trunks", "beachball 1", "motorcycle", "fog")
PAPER: Mapping[str, tuple[float, float, int, float]] = {
    "2028 × 1080": (1.0, 1.0, 3772, 248.5557),
    "534 × 844": (844 / 2028, 534 / 1080, 3992, 128.4280),
    "435 × 505": (505 / 2028, 435 / 1080, 3684, 34.3573),
    "196 × 232": (232 / 2028, 196 / 1080, 2636, 4.1634),
}
"""Its Table 1: area -> shares of columns and rows, FFTs, seconds."""
MARKED = 1.0
"""JOD that the judge's heatmap has at least where it marks a difference."""
HELD, AREA = 0.95, 2.0
"""Least share of the marked pixels that is in the mask, and largest area of the mask over
theirs."""
FEW = 1e-4
"""Share of a picture: of fewer marks, shares say nothing."""


@final
@dataclass(frozen=True)
class Area:
    """A part of the picture that was solved.

    Attributes
    ----------
    share
        Share of the picture.
    ffts, iterations, seconds
        As the paper's columns; FFTs of the whole picture's planes, and shares of them.
    """

    share: float
    ffts: float
    iterations: int
    seconds: float


@final
@dataclass(frozen=True)
class Shown:
    """A master, solved whole and only where pollution is seen.

    Attributes
    ----------
    pixels
        Pixels of a view.
    mask, windows
        Shares of the screen that are predicted to be seen after subtraction, and that changed.
    ffts, seconds
        Whole, and only what is seen, with the prediction.
    predicting
        Seconds of the prediction alone.
    quality
        JOD of subtraction, whole, only what is seen; empty without a judge.
    marked, covered
        Share of the screen that the judge marks after subtraction, and how much of that the mask
        holds; None without a judge.
    """

    pixels: int
    mask: float
    windows: float
    ffts: tuple[int, int]
    seconds: tuple[float, float]
    predicting: float
    quality: tuple[float, ...]
    marked: float | None
    covered: float | None


def usual_pair() -> Scene:
    """Where pairs are seen: at the usual crosstalk and luminance of `quality`."""
    return stereo_at(USUAL_CROSSTALK, USUAL_LUMINANCE)


def preferably(light: Light, scene: Scene) -> Posed:
    """A master as the commands pose it."""
    return pose(light.astype(np.float32), scene, PerceptualWeighting())


def centre_of(posed: Posed) -> tuple[int, int]:
    """Row and column around which subtraction leaves most."""
    left = luminance(posed.seen(posed.subtractive) - posed.problem.desired, posed.scene)
    energy = np.sum(np.maximum(left, 0) ** 2, axis=0)
    row, col = (
        np.average(np.arange(n), weights=energy.sum(axis=1 - k)) for k, n in enumerate(energy.shape)
    )
    return round(row), round(col)


def area(posed: Posed, cols: float, rows: float) -> Area:
    """Solve the part with these shares of columns and rows."""
    box = tuple(
        slice(
            start := max(0, min(round(at - share * size / 2), size - round(share * size))),
            start + round(share * size),
        )
        for at, share, size in zip(centre_of(posed), (rows, cols), posed.screen.shape, strict=True)
    )
    solver = Windows(((box[0], box[1]),), reach_of(posed), ADMM())
    fourier = posed.problem.weighting.fourier

    def counted() -> tuple[Result, float]:
        before = fourier.count
        return solver(posed.problem, posed.subtractive), fourier.count - before

    (result, ffts), seconds = timed(counted)
    return Area(rows * cols, ffts, result.iterations, seconds)


def timed(solve: Callable[[], T]) -> tuple[T, float]:
    """What it gives, and the seconds of its second run: in the first, things are made ready."""
    solve()
    begin = time.perf_counter()
    return solve(), time.perf_counter() - begin


def measure(posed_as: Callable[[], Posed]) -> Shown:
    """One master."""
    posed = posed_as()
    begin = time.perf_counter()
    mask = remaining(posed, SEEN).mask
    predicting = time.perf_counter() - begin
    whole, seconds = timed(lambda: solved(posed, "perceptual"))
    part, faster = timed(lambda: solved(posed, "perceptual", OnlyVisible(posed, ADMM())))
    changed = np.any(part.light != posed.subtractive, axis=(0, 3))
    room = posed.seen(np.zeros_like(posed.desired))
    quality: tuple[float, ...] = ()
    marked = covered = None
    try:
        judged = [
            colorvideovdp_map(posed.problem.desired + room, posed.seen(light), posed.scene)
            for light in (posed.subtractive, whole.light, part.light)
        ]
        quality = tuple(jod for jod, _ in judged)
        found = (judged[0][1] >= MARKED) & posed.screen
        marked, covered = float(found.mean()), float(mask[found].mean()) if found.any() else 1.0
    except Missing:
        pass
    return Shown(
        pixels=posed.screen.size,
        mask=float(mask.mean()),
        windows=float(changed.mean()),
        ffts=(whole.ffts, part.ffts),
        seconds=(seconds, faster),
        predicting=predicting,
        quality=quality,
        marked=marked,
        covered=covered,
    )


def run(work: Work) -> Finding:
    """Measure, and say whether it is as expected."""
    width = 256 if work.quick else 2048
    drawn = partial(generated, width, work.seed)
    domes, left_out = reported_domemasters(work)
    there, absent = ([], []) if work.quick else present(PAIRS)
    left_out += [each for each in absent if each not in left_out]
    pairs: dict[str, Callable[[], Light]] = {"generated": drawn}
    pairs |= {name: partial(_read, name) for name in there}
    timed_pair = pairs.get("trunks", drawn)
    inputs = {name: partial(_pair, read) for name, read in pairs.items()}
    inputs |= {name: partial(_dome, one) for name, one in domes.items()}
    areas = {
        name: work.step(f"area {name}", Area, partial(_area, timed_pair, *paper[:2]))
        for name, paper in PAPER.items()
    }
    found = {name: work.step(name, Shown, partial(measure, read)) for name, read in inputs.items()}
    judged = {name: shown for name, shown in found.items() if shown.quality}
    if not judged:
        left_out.append("What the judge says: it needs pip install 'domesim[metrics]'")
    return Finding(
        result=_result(areas, found, judged),
        checks=tuple(_checks(areas, found, judged, quick=work.quick)),
        tables=(_table1(areas), _table(found)),
        figures={
            **{f"only_visible.{name}.area_ffts": a.ffts for name, a in areas.items()},
            **{
                f"only_visible.{name}.faster": s.seconds[0] / s.seconds[1]
                for name, s in found.items()
            },
            **{
                f"only_visible.{name}.jod": s.quality[2] - s.quality[1]
                for name, s in judged.items()
            },
        },
        left_out=tuple(left_out),
    )


def _area(read: Callable[[], Light], cols: float, rows: float) -> Area:
    """By the paper's weighting."""
    return area(pose(read().astype(np.float32), usual_pair()), cols, rows)


def _pair(read: Callable[[], Light]) -> Posed:
    return preferably(read(), usual_pair())


def _dome(one: Input) -> Posed:
    """At the usual albedo and luminance of `quality`."""
    return preferably(one.read(), one.scene(one.usual, USUAL_LUMINANCE))


def _read(name: str) -> Light:
    return from_data(name, usual_pair())[0]


def _checks(
    areas: Mapping[str, Area],
    found: Mapping[str, Shown],
    judged: Mapping[str, Shown],
    *,
    quick: bool,
) -> list[Check]:
    whole, *_ = areas.values()
    checks = []
    if not quick:  # small windows are mostly margin
        checks += [
            at_most(
                f"{name}: its share of FFTs over its area's", one.ffts / whole.ffts / one.share, 2
            )
            for name, one in areas.items()
        ]
    checks += [
        at_most(f"{name}: FFTs over those of the whole", s.ffts[1] / s.ffts[0], 1.1)
        for name, s in found.items()
    ]
    checks += [
        at_least(
            f"{name}: JOD, only what is seen less the whole",
            s.quality[2] - s.quality[1],
            -0.02,
            "JOD",
        )
        for name, s in judged.items()
        if not quick
    ]
    if quick:
        return checks
    for name, s in judged.items():
        if s.covered is not None and s.marked is not None and s.marked >= FEW:
            larger = s.mask / s.marked
            checks.append(at_least(f"{name}: of what is marked in the mask", s.covered, HELD))
            checks.append(at_most(f"{name}: the mask over what is marked", larger, AREA))
    return checks


def _result(
    areas: Mapping[str, Area],
    found: Mapping[str, Shown],
    judged: Mapping[str, Shown],
) -> str:
    whole, *_, least = areas.values()
    faster = {name: shown.seconds[0] / shown.seconds[1] for name, shown in found.items()}
    told = (
        f"The paper's smallest part, {1 / least.share:.0f} times smaller, took it 60 times less "
        f"time; ours takes {whole.ffts / least.ffts:.0f} times fewer FFTs and "
        f"{whole.seconds / least.seconds:.0f} times less time. To solve only what is "
        f"predicted to be seen, prediction included, was "
        f"{', '.join(f'{gain:.1f}' for gain in faster.values())} times as fast "
        f"({', '.join(faster)}): a whole frame takes so few transforms that little is left to "
        f"save, unless next to nothing is seen."
    )
    if judged:
        changes = [s.quality[2] - s.quality[1] for s in judged.values()]
        held = [s for s in judged.values() if s.marked is not None and s.marked >= FEW]
        covered = ", ".join(f"{s.covered:.0%}" for s in held)
        larger = ", ".join(f"{s.mask / s.marked:.1f}" for s in held if s.marked)
        told += (
            f" Quality changes by {min(changes):+.3f} to {max(changes):+.3f} JOD. Of what "
            f"ColorVideoVDP marks after subtraction the mask holds {covered}, at {larger} times "
            f"the area."
        )
    return told


def _table1(areas: Mapping[str, Area]) -> Table:
    return Table(
        caption=(
            "Table 1: the paper's, on its GPU of 2011, and ours, on this machine's processors: "
            f"{words(('a pair', USUAL_CROSSTALK, USUAL_LUMINANCE))}, to a certified 1e-3 of each "
            "part. An FFT is one of a whole picture's plane; ours has six."
        ),
        columns=(
            Column(name="the paper's area"),
            Column(name="share", unit="%", digits=".1f"),
            Column(name="its FFTs"),
            Column(name="its time", unit="s", digits=".1f"),
            Column(name="our FFTs", digits=".1f"),
            Column(name="iterations"),
            Column(name="our time", unit="s", digits=".2f"),
        ),
        rows=tuple(
            (name, 100 * a.share, PAPER[name][2], PAPER[name][3], a.ffts, a.iterations, a.seconds)
            for name, a in areas.items()
        ),
    )


def _table(found: Mapping[str, Shown]) -> Table:
    def jod(shown: Shown, k: int) -> float | str:
        return shown.quality[k] if shown.quality else ""

    return Table(
        caption=(
            "By local contrast: whole, and only what is predicted to be seen after subtraction."
        ),
        columns=(
            Column(name="master"),
            Column(name="seen", unit="%", digits=".2f"),
            Column(name="changed", unit="%", digits=".1f"),
            Column(name="FFTs, whole"),
            Column(name="only seen"),
            Column(name="time, whole", unit="s", digits=".2f"),
            Column(name="only seen", unit="s", digits=".2f"),
            Column(name="of it prediction", unit="s", digits=".2f"),
            Column(name="subtraction", unit="JOD", digits=".3f"),
            Column(name="whole", unit="JOD", digits=".3f"),
            Column(name="only seen", unit="JOD", digits=".3f"),
            Column(name="marked by the judge", unit="%", digits=".2f"),
            Column(name="of it in the mask", unit="%", digits=".0f"),
        ),
        rows=tuple(
            (
                name,
                100 * s.mask,
                100 * s.windows,
                *s.ffts,
                *s.seconds,
                s.predicting,
                *(jod(s, k) for k in range(3)),
                "" if s.marked is None else 100 * s.marked,
                "" if s.covered is None else 100 * s.covered,
            )
            for name, s in found.items()
        ),
    )
