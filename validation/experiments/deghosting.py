"""Ghosts of stereo pairs: what each method leaves of them, by our measures and by two judges.

Rationale
    Photographs, renderings and a sequence in `stereo_polarised_paper`, with crosstalk of 1, 2, 5
    and 10 % of light, the same everywhere and for all colours. Every method knows the crosstalk
    exactly. What the left and right eye see is compared with the master by what compensation
    minimises (the visible error), by how much of the ghost's edges is left (`compensate.ghosts`),
    and by FLIP and ColorVideoVDP, for which nothing here was tuned. Two perceptual methods take
    part: ours (`--weighting paper`), and the paper's own, kept faithful. The default minimises no
    such error: `quality` and `two_eyes` judge it. Pictures are averaged down by whole numbers of
    pixels, for all methods alike, and seen as wide as the scene's screen.
Expected
    These laws: untouched, the residual is crosstalk times the other eye's picture, plus black;
    where nothing clips, nothing is left; subtraction leaves each pixel a residual between none and
    the untouched one; range compression shows its compressed picture exactly; and what minimises
    the visible error has the least of all methods, within the certified gap of 1e-3. Which method
    the judges prefer is told, and not expected.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, TypeAlias, final

import numpy as np

from compensate.figures import Appraisal
from compensate.ghosts import ghost_left
from compensate.methods import STEREO
from compensate.pose import Posed, pose
from compensate.solve import solved
from compensate.solver.gpcg import GPCG
from compensate.solver.paper import PaperMethod
from compensate.solver.result import Status
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import PerceptualWeighting
from domesim.light import Light
from domesim.scene import Scene, StereoScene, load_scene
from testing import pairs
from testing.places import STEREO_SCENE, scene_at
from validation import crops, data, drawing, judges
from validation.experiment import (
    Check,
    Column,
    Finding,
    Panel,
    Pictures,
    Plot,
    Table,
    Work,
    at_most,
    equal,
)

LEVELS = (0.01, 0.02, 0.05, 0.1)
"""Shares of light that reach the other eye."""
QUICK_LEVELS = (0.01, 0.05)
STILL = 0.05
"""Crosstalk of the pictures on the page."""
PAIRS = ("fog", "trunks", "motorcycle", *data.SEQUENCE)
"""Pairs of the test data."""
WIDEST, QUICK_WIDTH = 512, 96
"""Pixels."""
PAPER_ITERATIONS, PAPER_PHASES = 60, 5
"""Most of the paper's solver, each channel. The generated pair takes 33, and more phases change its
visible error by less than 1e-3."""
GAINS = (0.3, 1.0)
"""Low-frequency gains beside the usual one."""

TITLES: Mapping[str, str] = {
    "perceptual": "perceptual (ours)",
    "paper": "perceptual (the paper's)",
    "subtractive": "subtraction",
    "lab-subtractive": "subtraction in CIELab",
    "raised-black": "range compression",
    "raised-black-local": "locally raised black",
    "player-shader": "player's shader",
    "none": "nothing",
}
SHOWN = ("none", "subtractive", "paper", "perceptual")
"""In pictures, beside the master."""

Place: TypeAlias = tuple[str, float]
"""A pair's name, and the crosstalk."""
Shape: TypeAlias = tuple[int, int]
"""Rows, cols."""
Wanted: TypeAlias = tuple[Callable[[], Light], tuple[float, ...]]
"""How to get a pair, and the levels."""


@final
@dataclass(frozen=True)
class Cell:
    """One method for one pair at one level.

    Attributes
    ----------
    clipped
        Share of pixels where exact subtraction needs negative light.
    error
        Visible error, JND rms.
    rms
        Residual luminance, cd/m², rms of both eyes.
    edges, left
        Ghost edge energy, and ghost left.
    flip, quality
        FLIP, and ColorVideoVDP in JOD: means of both eyes; None if not installed.
    seconds, ffts
        Seconds and FFTs of the solution.
    status
        Name of the solver's `Status`.
    gap
        Certified.
    lawless
        How far what is seen is from the law of this method, in units of white; 0 if it has none.
    panel
        What the left eye sees of the dark crop.
    """

    clipped: float
    error: float
    rms: float
    edges: float
    left: float
    flip: float | None
    quality: float | None
    seconds: float
    ffts: int
    status: str
    gap: float | None
    lawless: float
    panel: Panel | None


def measure(posed: Posed, method: str, *, panel: bool = False, gain: float | None = None) -> Cell:
    """One method for a posed pair.

    Parameters
    ----------
    posed
        The pair in the scene.
    method
        One of `STEREO`.
    panel
        Whether a picture of it is wanted.
    gain
        Another low-frequency gain to solve with; the visible error is `posed`'s in any case.
    """
    scene, asked = posed.scene, posed
    if gain is not None:
        weighting = PerceptualWeighting(LowFrequencyFloor(gain))
        asked = pose(posed.desired, scene, weighting)
    solver = _paper(scene) if method == "paper" else None
    begin = time.perf_counter()
    result = solved(asked, method, solver)
    seconds = time.perf_counter() - begin
    seen, desired = posed.seen(result.light), posed.problem.desired
    edges = Appraisal(posed).ghost_edges(result.light)
    assert edges is not None
    residual, ghost = (
        judges.luminance(light - desired, scene) for light in (seen, posed.seen(desired))
    )
    return Cell(
        clipped=Appraisal(posed).clipped,
        error=Appraisal(posed).visible_error(result.light),
        rms=scene.projector.white * float(np.sqrt(np.mean(residual**2))),
        edges=edges,
        left=ghost_left(residual, ghost, scene.viewing.pixels_per_degree(*desired.shape[1:3])),
        flip=judges.if_installed(judges.flip, desired, seen, scene),
        quality=judges.if_installed(judges.colorvideovdp, desired, seen, scene),
        seconds=seconds,
        ffts=result.ffts,
        status=result.status.name,
        gap=result.gap,
        lawless=_lawless(posed, method, seen),
        panel=crops.Crop(posed).panel(TITLES[method], seen) if panel else None,
    )


def unclipped(width: int, seed: int) -> tuple[float, float, float]:
    """A generated pair that is nowhere dark: its clipped share, and what is left by two methods.

    That is the largest residual, in units of white, of subtraction and of ours.
    """
    light = np.float32(0.2) + np.float32(0.8) * pairs.generated(width, seed)
    posed = pose(light, scene_at(STILL), PerceptualWeighting())
    left = [
        float(np.abs(posed.residual(solved(posed, method).light)).max())
        for method in ("subtractive", "perceptual")
    ]
    return Appraisal(posed).clipped, left[0], left[1]


def run(work: Work) -> Finding:
    """Measure every method for every pair and level."""
    wanted, left_out = _wanted(work)
    exact = work.step(
        "unclipped", tuple[float, float, float], lambda: unclipped(QUICK_WIDTH, work.seed)
    )
    cells: dict[Place, dict[str, Cell]] = {}
    gained: dict[Place, Cell] = {}
    pictures: list[Pictures] = []
    shapes: dict[str, Shape] = {}
    for name, (read, levels) in wanted.items():
        light = cache(read)
        shapes[name] = work.step(f"{name}: size", tuple[int, int], partial(_shape, light))
        for level in levels:
            posed = cache(partial(_posed, light, level))
            cells[name, level] = _measured(work, name, level, posed)
            if level == STILL and name not in data.SEQUENCE[1:]:
                for gain in GAINS:
                    gained[name, gain] = work.step(
                        f"{name} at {level:.0%}: low-frequency gain {gain:g}",
                        Cell,
                        partial(_with_gain, posed, gain),
                    )
                master, brighter = work.step(
                    f"{name}: dark crop", tuple[Panel, int], partial(_master, posed)
                )
                pictures.append(_pictures(name, master, brighter, cells[name, level]))
    every = [cell for methods in cells.values() for cell in methods.values()]
    left_out += judges.left_out(
        {
            "FLIP": [cell.flip for cell in every],
            "ColorVideoVDP": [cell.quality for cell in every],
        }
    )
    return Finding(
        result=_result(cells),
        checks=tuple(_checks(cells, exact)),
        advice=(
            "With --weighting paper, where pictures are mostly black and veils disturb, raise "
            "--low-frequency-gain (0.3 instead of 0.1): veils shrink, and more of the ghosts' "
            "edges stays."
        ),
        tables=(*(_table(name, shapes[name], cells) for name in wanted), _gains(cells, gained)),
        plots=tuple(_plots(cells)),
        pictures=tuple(pictures),
        figures=_figures(cells),
        left_out=tuple(left_out),
    )


# What is measured.


def _measured(work: Work, name: str, level: float, posed: Callable[[], Posed]) -> dict[str, Cell]:
    """Every method, a step each."""

    def one(method: str) -> Cell:
        return measure(posed(), method, panel=level == STILL and method in SHOWN)

    return {
        method: work.step(f"{name} at {level:.0%}: {method}", Cell, partial(one, method))
        for method in STEREO
    }


def _with_gain(posed: Callable[[], Posed], gain: float) -> Cell:
    return measure(posed(), "perceptual", gain=gain)


def _shape(light: Callable[[], Light]) -> Shape:
    rows, cols = light().shape[1:3]
    return rows, cols


def _posed(light: Callable[[], Light], level: float) -> Posed:
    return pose(light(), scene_at(level), PerceptualWeighting())


def _wanted(work: Work) -> tuple[Mapping[str, Wanted], list[str]]:
    """Pairs to measure by name, and why others are not."""
    width, levels = (QUICK_WIDTH, QUICK_LEVELS) if work.quick else (WIDEST, LEVELS)
    generated = {"generated": (partial(pairs.generated, width, work.seed), levels)}
    if work.quick:
        return generated, ["The test data: with a full run"]
    present, left_out = data.present(PAIRS)
    return {name: (partial(_read, name), LEVELS) for name in present} or generated, left_out


def _read(name: str) -> Light:
    """The pair, no wider than `WIDEST`."""
    light, _ = data.from_data(name, load_scene(STEREO_SCENE))
    return pairs.no_wider(light, WIDEST)


def _lawless(posed: Posed, method: str, seen: Light) -> float:
    """Largest error of a method whose outcome is known without a solver; 0 for other methods."""
    desired = np.asarray(posed.problem.desired, np.float64)
    error = seen - desired
    if method == "none":
        assert isinstance(posed.scene, StereoScene)
        seat = posed.scene.seats[posed.scene.chosen[0]]
        ghosts = [desired[1 - eye] @ seat.matrices[eye].T for eye in range(2)]
        error = error - np.stack(ghosts) - posed.seen(np.zeros_like(posed.desired))
    elif method == "raised-black":
        short = 1 - desired
        error = error - float(np.sum(error * short) / np.sum(short**2)) * short
    elif method == "subtractive":
        error = error - np.clip(error, 0, posed.seen(posed.desired) - desired)
    else:
        return 0.0
    return float(np.abs(error).max())


def _paper(scene: Scene) -> PaperMethod:
    solver = GPCG(frozen=True, max_iterations=PAPER_ITERATIONS, max_phases=PAPER_PHASES)
    return PaperMethod(scene.viewing, scene.projector.luminance_weights, solver)


def _master(posed: Callable[[], Posed]) -> tuple[Panel, int]:
    return crops.Crop(posed()).master


def _pictures(name: str, master: Panel, brighter: int, cells: Mapping[str, Cell]) -> Pictures:
    panels = [cells[method].panel for method in SHOWN]
    return Pictures(
        caption=crops.caption(f"The {name} pair, crosstalk {STILL:.0%}", brighter, views=2),
        panels=(master, *(panel for panel in panels if panel is not None)),
    )


# What is said of it.


def _checks(
    cells: Mapping[Place, Mapping[str, Cell]], exact: tuple[float, float, float]
) -> Iterator[Check]:
    places = list(cells.values())
    yield equal("a pair without dark places: share clipped", exact[0], 0)
    yield at_most("a pair without dark places: residual of subtraction, of white", exact[1], 1e-5)
    yield at_most("a pair without dark places: residual of ours, of white", exact[2], 1e-5)
    yield at_most(
        "untouched: difference to crosstalk times the other eye's picture, of white",
        max(methods["none"].lawless for methods in places),
        1e-5,
    )
    yield at_most(
        "range compression: difference to the compressed picture, of white",
        max(methods["raised-black"].lawless for methods in places),
        1e-5,
    )
    yield at_most(
        "subtraction: residual below none or above the untouched one, of white",
        max(methods["subtractive"].lawless for methods in places),
        1e-5,
    )
    yield at_most(
        "ours: visible error over the least of all other methods, the largest",
        max(
            methods["perceptual"].error
            / min(cell.error for name, cell in methods.items() if name != "perceptual")
            for methods in places
        ),
        1,
    )
    yield at_most(
        "ours: certified gap where it is visible, the largest",
        max(
            (
                np.inf if ours.gap is None else ours.gap
                for ours in (methods["perceptual"] for methods in places)
                if ours.status != Status.INVISIBLE.name
            ),
            default=0.0,
        ),
        1e-3,
    )


def _result(cells: Mapping[Place, Mapping[str, Cell]]) -> str:
    by_method = {name: [methods[name] for methods in cells.values()] for name in TITLES}
    ours, plain, paper = (by_method[name] for name in ("perceptual", "subtractive", "paper"))
    ratios = [mine.error / other.error for mine, other in zip(ours, plain, strict=True)]
    text = (
        f"{len(cells)} cases (a pair at a level), of which subtraction clips "
        f"{min(c.clipped for c in ours):.0%} to {max(c.clipped for c in ours):.0%} of the pixels. "
        f"Our visible error is {min(ratios):.0%} to {max(ratios):.0%} of subtraction's. The edge "
        f"energy of the ghost is {_range(c.edges for c in ours)} (subtraction "
        f"{_range(c.edges for c in plain)}, the paper's method {_range(c.edges for c in paper)}); "
        f"of the ghost itself {_range(c.left for c in ours)} is left (subtraction "
        f"{_range(c.left for c in plain)}, the paper's {_range(c.left for c in paper)}). Both "
        f"perceptual methods pay with veils of light around what they hide: the residual is "
        f"{_range(c.rms for c in ours)} cd/m² rms (subtraction {_range(c.rms for c in plain)}, the "
        f"paper's {_range(c.rms for c in paper)})."
    )
    if max(c.edges for c in plain) > 1:
        text += (
            " Subtraction can have more edges than the untouched ghost: where it takes even light, "
            "of the scene's black or the inside of a ghost, from lit pixels and cannot from dark "
            "ones beside them."
        )
    for judge, badness in (("FLIP", _flip), ("ColorVideoVDP", _lost_quality)):
        if preferred := _preferred(cells, badness):
            text += f"\n\n{judge} {preferred}"
    return text


def _flip(cell: Cell) -> float | None:
    return cell.flip


def _lost_quality(cell: Cell) -> float | None:
    return None if cell.quality is None else -cell.quality


def _preferred(
    cells: Mapping[Place, Mapping[str, Cell]], badness: Callable[[Cell], float | None]
) -> str:
    """What a judge prefers, in words; nothing if it was not there."""
    judged: list[tuple[str, dict[str, float]]] = []
    for (name, _), methods in cells.items():
        found = {method: badness(cell) for method, cell in methods.items()}
        known = {method: value for method, value in found.items() if value is not None}
        if known:
            judged.append((name, known))
    if not judged:
        return ""
    best = Counter(min(found, key=found.__getitem__) for _, found in judged)
    ranked = ", ".join(f"{TITLES[method]} in {times}" for method, times in best.most_common())
    sentences = [f"finds best, of {len(judged)} cases: {ranked}."]
    for other in ("subtractive", "paper", "none"):
        names = Counter(name for name, found in judged if found["perceptual"] < found[other])
        where = ", ".join(f"{times} of {name}" for name, times in names.items())
        sentences.append(
            f"It prefers ours to {TITLES[other]} in {names.total()}"
            + (f" ({where})." if where else ".")
        )
    return " ".join(sentences)


def _range(values: Iterable[float]) -> str:
    found = sorted(round(value, 2) + 0.0 for value in values)
    return f"{found[0]:.2f} to {found[-1]:.2f}"


_SEEN = (
    Column(name="visible error", unit="JND rms", digits=".3f"),
    Column(name="residual", unit="cd/m² rms", digits=".3f"),
    Column(name="edge energy", digits=".3f"),
    Column(name="ghost left", digits=".3f"),
    Column(name="FLIP", digits=".4f"),
    Column(name="ColorVideoVDP", unit="JOD", digits=".2f"),
)


def _seen(cell: Cell) -> tuple[float | None, ...]:
    """A row of the columns `_SEEN`."""
    return cell.error, cell.rms, cell.edges, cell.left, cell.flip, cell.quality


def _table(name: str, shape: Shape, cells: Mapping[Place, Mapping[str, Cell]]) -> Table:
    here = {level: methods for (pair, level), methods in cells.items() if pair == name}
    clipped = ", ".join(
        f"{next(iter(methods.values())).clipped:.1%} at {level:.0%}"
        for level, methods in here.items()
    )
    return Table(
        caption=(
            f"The {name} pair, {shape[1]} x {shape[0]} pixels. Share of pixels that subtraction "
            f"clips: {clipped}. Seconds are of a machine with other work."
        ),
        columns=(
            Column(name="crosstalk"),
            Column(name="method"),
            *_SEEN,
            Column(name="time", unit="s", digits=".1f"),
            Column(name="FFTs"),
        ),
        rows=tuple(
            (
                f"{level:.0%}",
                TITLES[method],
                *_seen(cell),
                cell.seconds,
                cell.ffts,
            )
            for level, methods in here.items()
            for method, cell in methods.items()
        ),
    )


def _gains(cells: Mapping[Place, Mapping[str, Cell]], gained: Mapping[Place, Cell]) -> Table:
    """Ours, by the weight of what is even."""
    names = dict.fromkeys(name for name, _ in gained)
    usual = {(name, LowFrequencyFloor().gain): cells[name, STILL]["perceptual"] for name in names}
    plain = {(name, np.inf): cells[name, STILL]["subtractive"] for name in names}
    rows = [
        (name, f"ours, {gain:g}" if np.isfinite(gain) else TITLES["subtractive"], cell)
        for (name, gain), cell in sorted({**usual, **gained, **plain}.items())
    ]
    return Table(
        caption=(
            f"What the low-frequency gain decides: crosstalk {STILL:.0%}, ours with several, and "
            f"subtraction. The visible error is counted with the usual gain."
        ),
        columns=(
            Column(name="pair"),
            Column(name="low-frequency gain"),
            *_SEEN,
        ),
        rows=tuple((name, title, *_seen(one)) for name, title, one in rows),
    )


def _plots(cells: Mapping[Place, Mapping[str, Cell]]) -> Iterator[Plot]:
    for title, figure in (
        ("Ghost edge energy", lambda cell: cell.edges),
        ("Ghost left", lambda cell: cell.left),
    ):
        yield _plot(title, figure, cells)


def _plot(
    title: str, figure: Callable[[Cell], float], cells: Mapping[Place, Mapping[str, Cell]]
) -> Plot:
    """A mean over the pairs that were measured at all levels."""
    levels = sorted({level for _, level in cells})
    names = [
        name
        for name in dict.fromkeys(name for name, _ in cells)
        if all((name, level) in cells for level in levels)
    ]

    def draw(axes: Any) -> None:
        for method, label in TITLES.items():
            means = [
                np.mean([figure(cells[name, level][method]) for name in names]) for level in levels
            ]
            ours = method == "perceptual"
            axes.plot(
                [100 * level for level in levels],
                means,
                marker="o",
                linewidth=2.5 if ours else 1.2,
                linestyle="-" if method in SHOWN else "--",
                color="#999999" if method == "none" else None,
                label=label,
            )
        axes.set_xscale("log")
        axes.set_xticks([100 * level for level in levels], [f"{level:.0%}" for level in levels])
        axes.minorticks_off()
        axes.set_xlabel("crosstalk")
        axes.set_ylabel(title.lower())
        drawing.legend_beside(axes)

    return drawing.plot(
        f"{title} against crosstalk: {'mean of ' if names[1:] else ''}{_listed(names)}.",
        f"{title} of each method over crosstalk from {levels[0]:.0%} to {levels[-1]:.0%}.",
        draw,
        size=(7.0, 3.5),
    )


def _listed(names: Sequence[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last


def _figures(cells: Mapping[Place, Mapping[str, Cell]]) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for (name, level), methods in cells.items():
        for method, cell in methods.items():
            start = f"deghosting.{name}.{level:.0%}.{method}"
            found |= {
                f"{start}.visible": cell.error,
                f"{start}.edges": cell.edges,
                f"{start}.left": cell.left,
                f"{start}.flip": cell.flip,
                f"{start}.quality": cell.quality,
            }
        found[f"deghosting.{name}.{level:.0%}.clipped"] = methods["none"].clipped
    return found
