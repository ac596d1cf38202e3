"""Frames that are solved alone do not flicker.

Rationale
    Each frame of a show is made without its neighbours: so a cut cannot bleed, and a frame is the
    same whoever makes it. The default aims by what is missing in the darkest tenth of the screen,
    and by means that keep edges: both change from frame to frame. The paper's weighting has a
    solver, which stops somewhere within a relative gap of 1e-3, after other iterations for one
    frame than for the next, and where nothing clips there is no solver at all. Such steps would be
    seen as flicker. Films in `stereo_polarised_paper` at 5 % of crosstalk and in `dome_hemisphere`,
    both at 15 cd/m² with a black of 1/2000: a picture that stands still; linear fades of it from
    black, and from a grey of which all pollution can be subtracted; a disc that moves before it.
    The *jump* of a fade is its largest step over its own slope there (the median step of the seven
    around), of the mean luminance that is projected, and that is seen. Of regions, squares of 1/16
    of the width, the slope is at least a tenth of the median of all steps, for some stand still.
    *Flicker* is what the solver adds: how the difference of what is seen from what the optimum
    shows (solved to 1e-6) changes from one frame to the next, weighted as errors are, in
    just-noticeable differences of a picture that stands still. ColorVideoVDP compares films at 24
    frames a second with their masters. It has been calibrated for stills and for films apart: a
    still frame shown as a film has 1.7 times the loss of a still. So a film is compared with the
    mean of its frames, each *standing still as a film*.
Expected
    What stands still does not change at all; frames are the same to the bit in any order and alone.
    By default no fade's mean jumps above 1.5 times its slope, nor do regions in 95 % of all steps;
    where a picture stands still beside what moves, its mean bends from frame to frame by at most
    0.5 % of its luminance; a film's JOD is at most 0.05 below the mean of its frames', standing
    still. The same is expected of the paper's weighting, of regions and of what stands still beside
    the optimum's. Its flicker is below 0.3 JND in 999 of 1000 places, and its films are at most
    0.05 JOD below the optimum's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any, final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from compensate.aim import Aim
from compensate.methods import Solver, perceptual
from compensate.pose import Eye, Posed, Stage
from compensate.solve import solved
from compensate.solver.result import Result, Status
from compensate.weighting import PerceptualWeighting
from domesim.light import Light
from domesim.scene import Scene, load_scene
from domesim.scene.screening import decoded, within_range
from validation import drawing, films, judges, masters, pairs
from validation.experiment import (
    Check,
    Column,
    Finding,
    Missing,
    Plot,
    Table,
    Work,
    at_most,
    equal,
)
from validation.inputs import dome_at, stereo_at

Floats = NDArray[np.float64]

CROSSTALK, ALBEDO, WHITE = 0.05, 0.5, 15.0
WIDTH, SIZE, QUICK_WIDTH, QUICK_SIZE = 256, 192, 96, 64
"""Pixels of a pair's width and of a domemaster."""
FADE, QUICK_FADE = 48, 16
MOVES, QUICK_MOVES = 12, 6
"""Frames."""
BEST = 1e-6
"""Gap of what stands for the optimum."""
AROUND = 7
"""Steps of which the slope is the median."""
REGIONS = 16
"""To the width."""
PAIR, DOME = "pair", "dome"
JUMP, FLICKER, STILL, LOSS = 1.5, 0.3, 5e-3, 0.05
"""What is allowed: see Expected."""
DARK = 0.1
"""Luminance, cd/m², below which less counts as this much."""
GREYS = {PAIR: 0.1, DOME: 0.03}
"""Light of an even grey from which all pollution can be subtracted, and of which the mean goes one
way."""
PLACES = 99.9
"""Per cent of them in which flicker is not larger than what is told."""
RATE = 24.0
"""Frames a second."""
STANDING = 6
"""Frames of what stands still: a quarter of a second, as long as ColorVideoVDP looks back."""
START, END = (0.7, 0.3), (0.9, 0.3)
"""Way of the disc."""
STANDS = 0.4
"""Share of the width, from the left, that stands still, far from the disc."""

ALONE, TIGHTER, WARM, WARM_TIGHTER = (
    "alone, 1e-3 (the product's)",
    "alone, 1e-4",
    "from the frame before, 1e-3",
    "from the frame before, 1e-4",
)
WAYS = (ALONE, TIGHTER, WARM, WARM_TIGHTER)
DEFAULT = "the default"


@final
@dataclass(frozen=True)
class Film:
    """Frames, and where they are shown.

    Parameters
    ----------
    frames
        Light (view, row, col, primary) of each.
    scene
        The theatre, or stereo system.
    eye
        What the frames are made for: by default the paper's weighting, which takes a solver.
    """

    frames: Callable[[], Iterable[Light]]
    scene: Scene
    eye: Eye = field(default_factory=PerceptualWeighting)


@final
@dataclass(frozen=True)
class Shown:
    """A film as it was solved: the problem, the result and what is seen of each frame."""

    posed: list[Posed]
    results: list[Result]
    seen: list[Light]

    @property
    def ffts(self) -> float:
        """Mean number of FFTs of planes a frame."""
        return float(np.mean([result.ffts for result in self.results]))


@final
@dataclass(frozen=True)
class Flicker:
    """What the solver adds to a film's changes, in JND: of all views, steps and places."""

    rms: float
    most: float
    largest: float


@final
@dataclass(frozen=True)
class Fade:
    """A fade, frame by frame.

    Attributes
    ----------
    wanted, projected, seen, best
        Mean luminance of the master, of what is projected, of what is seen, and would be seen of
        the optimum; white = 1.
    exact
        Frames that needed no solver.
    regions, regions_best
        The jump of regions that 95 % of all steps do not exceed, and the optimum's.
    beyond
        Largest difference of a region's step from the optimum's, over the luminance there and
        `DARK`.
    flicker
        In it.
    ffts
        FFTs of planes, a frame.
    """

    wanted: list[float]
    projected: list[float]
    seen: list[float]
    best: list[float]
    exact: list[bool]
    regions: float
    regions_best: float
    beyond: float
    flicker: Flicker
    ffts: float


@final
@dataclass(frozen=True)
class AimedFade:
    """A fade as the default shows it: no solver, and no optimum beside it.

    Attributes
    ----------
    projected, seen
        Mean luminance of what is projected and seen, frame by frame; white = 1.
    regions
        The jump of regions that 95 % of all steps do not exceed.
    """

    projected: list[float]
    seen: list[float]
    regions: float

    @property
    def jumps(self) -> list[float]:
        """Largest jump of the mean that is projected, and that is seen."""
        return [float(jumps(np.array(levels)).max()) for levels in (self.projected, self.seen)]


@final
@dataclass(frozen=True)
class AimedDisc:
    """A disc that moves, as the default shows it.

    Attributes
    ----------
    standing
        In a master that stands still, the largest change of projected light.
    level
        Mean luminance that is seen far from the disc, frame by frame; white = 1.
    """

    standing: float
    level: list[float]

    @property
    def rough(self) -> float:
        """Largest second difference of the level, over the level."""
        return bend(self.level) / float(np.mean(self.level))


@final
@dataclass(frozen=True)
class Way:
    """A moving film, solved in one way.

    Attributes
    ----------
    ffts
        FFTs of planes, a frame.
    flicker
        In the whole picture.
    standing
        In a master that stands still, the largest change of projected light.
    change, change_best
        JND that 99.9 % of the changes of what is seen in the part that stands still do not exceed,
        and the optimum's.
    codes
        Change of what is seen in that part, in 10 bit codes (gamma 2.4) and in 12 bit codes (gamma
        2.6), that 99.9 % do not exceed, and the optimum's.
    level, level_best
        Mean luminance that is seen there, frame by frame; white = 1.
    """

    ffts: float
    flicker: Flicker
    standing: float
    change: float
    change_best: float
    codes: dict[str, float]
    level: list[float]
    level_best: list[float]

    @property
    def rough(self) -> float:
        """Largest second difference of the level's distance from the optimum's, over the level."""
        return bend(np.subtract(self.level, self.level_best)) / float(np.mean(self.level))


@final
@dataclass(frozen=True)
class Judged:
    """ColorVideoVDP's JOD of a film.

    Attributes
    ----------
    film, best
        JOD of what is seen, and of what would be seen of the optimum; None for the default.
    standing
        Mean of its frames, each standing still as a film.
    stills
        Mean of its frames as stills.
    """

    film: float
    best: float | None
    standing: float
    stills: float


def run(work: Work) -> Finding:
    """Films that stand still, fade and move."""
    size = (QUICK_WIDTH, QUICK_SIZE) if work.quick else (WIDTH, SIZE)
    count, moves = (QUICK_FADE, QUICK_MOVES) if work.quick else (FADE, MOVES)
    pair, dome = partial(pairs.generated, size[0], work.seed), partial(_domemaster, size[1])
    stereo, theatre = stereo_at(CROSSTALK, WHITE), dome_at(ALBEDO, WHITE)
    moving = {
        PAIR: Film(partial(with_disc, pair, moves), stereo),
        DOME: Film(partial(with_disc, dome, moves), theatre),
    }
    left_out: list[str] = []
    cuts = {name: Film(partial(_cut, film), film.scene) for name, film in moving.items()}

    def fading(frames: int) -> dict[str, Film]:
        return {
            f"{name} from {first}": Film(partial(_fade, picture, scene, first, frames), scene)
            for name, picture, scene in ((PAIR, pair, stereo), (DOME, dome, theatre))
            for first in ("black", "grey")
        }

    # By default all frames: where a region's light turns, steps of a few are no slope
    fades, slow = fading(count), fading(FADE)
    judged = dict(moving)
    if work.quick:
        left_out.append("Maps and tables, and the test data: with a full run")
    else:
        present, left_out = pairs.present(pairs.SEQUENCE)
        if len(present) == len(pairs.SEQUENCE):
            sequence = Film(partial(_sequence, stereo), stereo)
            cuts["beachball"] = Film(partial(_cut, sequence), stereo)
            judged["beachball"] = sequence
        small = partial(pairs.generated, WIDTH // 2, work.seed)
        for title, name in (("map", "stereo_cinema_silver"), ("table", "stereo_shutter")):
            scene = load_scene(name)
            frames = partial(_fade, small, scene, "black", count // 2)
            fades[f"pair from black, a {title}"] = Film(frames, scene)
        slow = fades
    cuts |= {f"{name}, {DEFAULT}": replace(film, eye=Aim()) for name, film in cuts.items()}
    repeats = work.each(
        {f"{name}: in any order": film for name, film in cuts.items()}, float, differences
    )
    aimed_fades = work.each(
        {f"fade, {name}, {DEFAULT}": replace(film, eye=Aim()) for name, film in slow.items()},
        AimedFade,
        aimed_fade,
    )
    aimed_discs = work.each(
        {f"{name}, {DEFAULT}": replace(film, eye=Aim()) for name, film in moving.items()},
        AimedDisc,
        aimed_disc,
    )
    faded = work.each({f"fade, {name}": film for name, film in fades.items()}, Fade, fade)
    optima = {name: cache(partial(shown, film, BEST)) for name, film in moving.items()}
    ways = {
        f"{name}, {way}": work.step(f"{name}, {way}", Way, partial(_way, film, way, optima[name]))
        for name, film in moving.items()
        for way in WAYS
    }
    judged |= {f"{name}, {DEFAULT}": replace(film, eye=Aim()) for name, film in judged.items()}
    jods: dict[str, Judged] = {}
    for name, film in judged.items():
        try:
            jods[name] = work.step(f"judged, {name}", Judged, partial(judge, film))
        except Missing:
            left_out.append("ColorVideoVDP: it needs pip install 'domesim[metrics]'")
            break
    return Finding(
        result=_result(aimed_fades, aimed_discs, faded, ways, jods),
        checks=(
            *_checks_aimed(aimed_fades, aimed_discs),
            *_checks(repeats, faded, ways, jods),
        ),
        tables=(_table_aimed(aimed_fades, aimed_discs), *_tables(faded, ways, jods)),
        plots=tuple(_plots(faded, ways)),
        figures={
            **dict(_figures(faded, ways, jods)),
            **{f"flicker.{name}.regions": found.regions for name, found in aimed_fades.items()},
        },
        left_out=tuple(left_out),
    )


# Films


def _domemaster(size: int) -> Light:
    scene = dome_at(ALBEDO, WHITE)
    light = pairs.no_wider(decoded(masters.bundled_night(), scene), size)
    return within_range(light, scene.screen(*light.shape[1:3]))[0]


def with_disc(picture: Callable[[], Light], count: int) -> Iterable[Light]:
    """A disc that moves on the right of a picture."""
    return films.moving_disc(picture(), START, END, count)


def _cut(film: Film) -> Iterable[Light]:
    """A frame twice, and then the last one."""
    frames = list(film.frames())
    return [frames[0], frames[0], frames[-1]]


def _fade(picture: Callable[[], Light], scene: Scene, first: str, count: int) -> Iterable[Light]:
    last = picture()
    grey = 0.0 if first == "black" else GREYS[PAIR if len(last) > 1 else DOME]
    begin = films.even_grey(last, scene, grey)
    return films.faded(begin, last, count)


def _sequence(scene: Scene) -> Iterable[Light]:
    return [pairs.no_wider(pairs.from_data(name, scene)[0], WIDTH) for name in pairs.SEQUENCE]


# Measuring


def shown(film: Film, tolerance: float | None = None, *, warm: bool = False) -> Shown:
    """A film, solved.

    Parameters
    ----------
    film
        The film.
    tolerance
        Gap to which it is solved; None for the product's way.
    warm
        Start at the solution of the frame before, as far as that was from its subtraction.
    """
    stage = Stage(film.scene, film.eye)
    solver = None if tolerance is None else perceptual(film.scene, tolerance)
    found = Shown([], [], [])
    for frame in film.frames():
        posed = stage.pose(frame)
        if warm and found.results and not posed.exact:
            assert solver is not None
            result = _from_before(solver, posed, found)
        else:
            result = solved(posed, "perceptual", solver)
        found.posed.append(posed)
        found.results.append(result)
        found.seen.append(posed.seen(result.light))
    return found


def _from_before(solver: Solver, posed: Posed, found: Shown) -> Result:
    before = found.results[-1].light - found.posed[-1].subtractive
    return solver(posed.problem, posed.problem.project(posed.subtractive + before))


def differences(film: Film) -> float:
    """Largest difference of the light of a frame that comes twice, and of all from those alone."""
    together = [result.light for result in shown(film).results]
    alone = [
        shown(Film(lambda: [frame], film.scene, film.eye)).results[0].light  # noqa: B023
        for frame in reversed(list(film.frames()))
    ]
    both = [*zip(together, reversed(alone), strict=True), (together[0], together[1])]
    return max(float(np.abs(one - other).max()) for one, other in both)


def aimed_fade(film: Film) -> AimedFade:
    """A fade by default."""
    found = shown(film)
    return AimedFade(
        projected=_means([result.light for result in found.results], film.scene),
        seen=_means(found.seen, film.scene),
        regions=float(np.percentile(jumps(_regions(found, film.scene)), 95)),
    )


def aimed_disc(film: Film) -> AimedDisc:
    """A moving disc by default."""
    found = shown(film)
    standing = replace(film, frames=lambda: [found.posed[0].desired] * 2)
    first, second = (result.light for result in shown(standing).results)
    return AimedDisc(
        standing=float(np.abs(second - first).max()),
        level=_means(found.seen, film.scene, _stands(found)),
    )


def fade(film: Film) -> Fade:
    """A fade, and the optimum's."""
    product, best = shown(film), shown(film, BEST)
    regions, regions_best = (_regions(found, film.scene) for found in (product, best))
    around = regions_best[1:] + DARK / film.scene.projector.white
    beyond = np.abs(np.diff(regions - regions_best, axis=0)) / around
    return Fade(
        wanted=_means([posed.desired for posed in product.posed], film.scene),
        projected=_means([result.light for result in product.results], film.scene),
        seen=_means(product.seen, film.scene),
        best=_means(best.seen, film.scene),
        exact=[result.status is Status.EXACT for result in product.results],
        regions=float(np.percentile(jumps(regions), 95)),
        regions_best=float(np.percentile(jumps(regions_best), 95)),
        beyond=float(beyond.max()),
        flicker=flicker(product, best),
        ffts=product.ffts,
    )


def flicker(product: Shown, best: Shown) -> Flicker:
    """What a solver adds to a film's changes."""
    beyond = [one - other for one, other in zip(product.seen, best.seen, strict=True)]
    on = product.posed[0].screen
    fields = np.stack(
        [
            _noticed(posed, now - before)[:, on]
            for posed, now, before in zip(product.posed[1:], beyond[1:], beyond[:-1], strict=True)
        ]
    )
    rms = float(np.sqrt(np.mean(fields.astype(float) ** 2)))
    return Flicker(rms, float(np.percentile(fields, PLACES)), float(fields.max()))


def _noticed(posed: Posed, change: Light) -> NDArray[np.floating[Any]]:
    """(view, row, col) of a change of what is seen: its weighted size in each place, in JND."""
    rows, cols = posed.screen.shape
    weighted = np.asarray(posed.setting.judge.apply(change))[..., :rows, :cols]
    thresholds = posed.scene.projector.white / posed.scene.viewing.adaptation
    size: NDArray[np.floating[Any]] = np.sqrt(np.sum(weighted**2, axis=1))
    return size * (thresholds * posed.problem.weighting.peak)


def _way(film: Film, name: str, optimum: Callable[[], Shown]) -> Way:
    tolerance = {TIGHTER: 1e-4, WARM: 1e-3, WARM_TIGHTER: 1e-4}.get(name)
    warm = name in (WARM, WARM_TIGHTER)
    found, best = shown(film, tolerance, warm=warm), optimum()
    standing = Film(lambda: [found.posed[0].desired] * 3, film.scene, film.eye)
    lights = [result.light for result in shown(standing, tolerance, warm=warm).results]
    stands = _stands(found)
    changes, changes_best = _changes(found, stands), _changes(best, stands)
    codes: dict[str, float] = {}
    for bits, gamma in ((10, 2.4), (12, 2.6)):
        codes[f"{bits} bit"] = _code_change(found.seen, stands, bits, gamma)
        codes[f"{bits} bit, optimum"] = _code_change(best.seen, stands, bits, gamma)
    return Way(
        ffts=found.ffts,
        flicker=flicker(found, best),
        standing=max(float(np.abs(light - lights[0]).max()) for light in lights),
        change=float(np.percentile(changes, PLACES)),
        change_best=float(np.percentile(changes_best, PLACES)),
        codes=codes,
        level=_means(found.seen, film.scene, stands),
        level_best=_means(best.seen, film.scene, stands),
    )


def _stands(found: Shown) -> NDArray[np.bool_]:
    """(row, col) of the screen that is far from the disc."""
    stands = found.posed[0].screen.copy()
    stands[:, round(STANDS * stands.shape[1]) :] = False
    return stands


def _changes(found: Shown, stands: NDArray[np.bool_]) -> NDArray[np.floating[Any]]:
    """What is seen to change where the master stands still, JND."""
    on = stands[None, :, :, None]
    steps = zip(found.posed[1:], found.seen[1:], found.seen[:-1], strict=True)
    return np.stack([_noticed(posed, on * (now - old))[:, stands] for posed, now, old in steps])


def _code_change(
    seen: Sequence[Light], stands: NDArray[np.bool_], bits: int, gamma: float
) -> float:
    """Codes that all but one in a thousand of what stands still changes by, at most."""
    codes = np.rint((2**bits - 1) * np.clip(np.stack(seen), 0, 1)[:, :, stands] ** (1 / gamma))
    return float(np.percentile(np.abs(np.diff(codes, axis=0)), PLACES))


def judge(film: Film) -> Judged:
    """What ColorVideoVDP says of a film, and of its frames.

    Raises
    ------
    Missing
        If it is not installed.
    """
    frames, scene = list(film.frames()), film.scene
    seen, best = shown(film).seen, None
    if not isinstance(film.eye, Aim):
        best = judges.colorvideovdp_video(frames, shown(film, BEST).seen, scene, RATE)
    stills = [
        judges.colorvideovdp(frame, one, scene) for frame, one in zip(frames, seen, strict=True)
    ]
    standing = [
        judges.colorvideovdp_video([frame] * STANDING, [one] * STANDING, scene, RATE)
        for frame, one in zip(frames, seen, strict=True)
    ]
    return Judged(
        film=judges.colorvideovdp_video(frames, seen, scene, RATE),
        best=best,
        standing=float(np.mean(standing)),
        stills=float(np.mean(stills)),
    )


def jumps(levels: Floats) -> Floats:
    """(step, ...) size of each step of (frame, ...) levels over the slope there."""
    least = _floor(levels) if levels.ndim > 1 else 0.0
    slopes = np.maximum(_slopes(levels), max(least, float(np.finfo(float).tiny)))
    return np.asarray(np.abs(np.diff(levels, axis=0)) / slopes)


def _slopes(levels: Floats) -> Floats:
    """(step, ...) size of the median of the steps around each; at the ends, of the nearest so many.

    Raises
    ------
    ValueError
        If there are fewer steps than that.
    """
    steps = np.diff(levels, axis=0)
    medians = np.abs(np.median(sliding_window_view(steps, AROUND, axis=0), axis=-1))
    half = AROUND // 2
    return np.concatenate([medians[:1].repeat(half, 0), medians, medians[-1:].repeat(half, 0)])


def _floor(levels: Floats) -> float:
    """The least slope of regions: some stand still in a fade."""
    return 0.1 * float(np.median(np.abs(np.diff(levels, axis=0))))


def bend(levels: Sequence[float] | Floats) -> float:
    """Largest second difference."""
    return float(np.abs(np.diff(levels, 2)).max())


def beyond(levels: Sequence[float], best: Sequence[float]) -> float:
    """Largest difference of a step from the optimum's, over the optimum's slope there."""
    return float((np.abs(np.diff(np.subtract(levels, best))) / _slopes(np.array(best))).max())


def _means(
    lights: Iterable[Light], scene: Scene, part: NDArray[np.bool_] | None = None
) -> list[float]:
    """Mean luminance of each over the screen's area, or a part of it, and all views."""
    found = []
    for light in lights:
        areas = scene.pixel_areas(*light.shape[1:3])
        if part is not None:
            areas = areas * part
        planes = judges.luminance(light, scene)
        found.append(float(np.sum(areas * planes) / (areas.sum() * len(planes))))
    return found


def _regions(found: Shown, scene: Scene) -> Floats:
    """(frame, region) mean luminance of squares that lie on the screen, of all views."""
    on = found.posed[0].screen
    side = on.shape[1] // REGIONS
    whole = pairs.averaged(on[None, :, :, None].astype(np.float64), side)[0, ..., 0] == 1
    planes = (judges.luminance(light, scene)[..., None] for light in found.seen)
    return np.stack([pairs.averaged(plane, side)[:, whole, 0].ravel() for plane in planes])


# Telling


def _checks_aimed(
    fades: Mapping[str, AimedFade], discs: Mapping[str, AimedDisc]
) -> Iterator[Check]:
    for name, fade in fades.items():
        for what, jump in zip(("projected", "seen"), fade.jumps, strict=True):
            yield at_most(f"{name}: largest step of the mean {what} over its slope", jump, JUMP)
        yield at_most(f"{name}: steps of 95 % of regions over their slope", fade.regions, JUMP)
    for name, disc in discs.items():
        yield equal(f"{name}: largest change of what stands still", disc.standing, 0)
        yield at_most(f"{name}: bend of what stands still beside the disc", disc.rough, STILL)


def _checks(
    repeats: Mapping[str, float],
    faded: Mapping[str, Fade],
    ways: Mapping[str, Way],
    jods: Mapping[str, Judged],
) -> Iterator[Check]:
    for name, difference in repeats.items():
        yield equal(f"{name}, after a cut, and alone: largest difference of light", difference, 0)
    for name, found in faded.items():
        for what, levels in (("projected", found.projected), ("seen", found.seen)):
            jump = float(jumps(np.array(levels)).max())
            yield at_most(f"{name}: largest step of the mean {what} over its slope", jump, JUMP)
        jump = beyond(found.seen, found.best)
        yield at_most(f"{name}: step of the mean seen beyond the optimum's", jump, JUMP - 1)
        jump = found.regions - found.regions_best
        yield at_most(f"{name}: steps of 95 % of regions beyond the optimum's", jump, JUMP - 1)
        yield at_most(f"{name}: flicker", found.flicker.most, FLICKER, "JND")
    for name, way in ways.items():
        if name.endswith(ALONE):
            yield equal(f"{name}: largest change of what stands still", way.standing, 0)
            yield at_most(f"{name}: flicker", way.flicker.most, FLICKER, "JND")
            yield at_most(f"{name}: bend of what stands still beyond the disc", way.rough, STILL)
    for name, jod in jods.items():
        loss = jod.standing - jod.film
        yield at_most(f"{name}: JOD that the film loses to its frames", loss, LOSS, "JOD")
        if jod.best is not None:
            loss = jod.best - jod.film
            yield at_most(f"{name}: JOD that the film loses to the optimum's", loss, LOSS, "JOD")


def _result(
    fades: Mapping[str, AimedFade],
    discs: Mapping[str, AimedDisc],
    faded: Mapping[str, Fade],
    ways: Mapping[str, Way],
    jods: Mapping[str, Judged],
) -> str:
    step = max(max(fade.jumps) for fade in fades.values())
    largest = max(
        float(jumps(np.array(levels)).max())
        for found in faded.values()
        for levels in (found.projected, found.seen)
    )
    flickers = [way.flicker.most for name, way in ways.items() if name.endswith(ALONE)]
    text = (
        f"What stands still is the same to the bit. Of {len(faded)} fades, the largest step of the "
        f"mean is {step:.3f} of its slope by default, and {largest:.3f} by the paper's "
        f"weighting. What stands still beside a disc bends by "
        f"{max(disc.rough for disc in discs.values()):.1e} of its luminance by default.\n\n"
        f"Of the paper's weighting, beside what moves, flicker is at most "
        f"{max(flickers):.2f} JND in {PLACES:g} % of all places."
    )
    for name in (PAIR, DOME):
        alone, tight, warm, both = (ways[f"{name}, {way}"] for way in WAYS)
        text += (
            f"\n\nThe {name}: {alone.ffts:.0f} FFTs a frame alone, flicker {alone.flicker.rms:.2g} "
            f"JND rms. Started from the frame before it takes {warm.ffts:.0f}, and flickers by "
            f"{warm.flicker.rms:.2g}; solved to 1e-4, {both.ffts:.0f} and {both.flicker.rms:.2g} "
            f"(alone {tight.ffts:.0f} and {tight.flicker.rms:.2g}). A picture that stands still "
            f"then changes, by up to {warm.standing:.1g} of white."
        )
    for name, jod in jods.items():
        text += (
            f"\n\nColorVideoVDP, {name}: the film {jod.film:.3f} JOD, its frames standing still as "
            f"films {jod.standing:.3f}, as stills {jod.stills:.3f}"
            + ("." if jod.best is None else f"; the optimum's film {jod.best:.3f}.")
        )
    return text


def _table_aimed(fades: Mapping[str, AimedFade], discs: Mapping[str, AimedDisc]) -> Table:
    return Table(
        caption="The default: of fades, steps over the slope around; of a disc, how what stands "
        "still far from it bends, over its luminance.",
        columns=(
            Column(name="film"),
            Column(name="frames"),
            Column(name="largest step, projected", digits=".3f"),
            Column(name="seen", digits=".3f"),
            Column(name="regions, 95 %", digits=".3f"),
            Column(name="bend of what stands still", digits=".1e"),
        ),
        rows=(
            *((n, len(fade.seen), *fade.jumps, fade.regions, None) for n, fade in fades.items()),
            *((n, len(disc.level), None, None, None, disc.rough) for n, disc in discs.items()),
        ),
    )


def _tables(
    faded: Mapping[str, Fade], ways: Mapping[str, Way], jods: Mapping[str, Judged]
) -> Iterator[Table]:
    yield Table(
        caption=(
            "Fades: steps over the slope around; flicker is what the solver adds to the optimum's "
            "changes (of contrasts, in thresholds that read several times 1). A region's step "
            f"beyond the optimum's is in shares of its luminance plus {DARK:g} cd/m²."
        ),
        columns=(
            Column(name="fade"),
            Column(name="frames"),
            Column(name="without a solver"),
            Column(name="largest step, projected", digits=".3f"),
            Column(name="seen", digits=".3f"),
            Column(name="regions, 95 %", digits=".3f"),
            Column(name="the optimum's", digits=".3f"),
            Column(name="a region's step beyond the optimum's", digits=".1e"),
            Column(name="flicker, 99.9 %", unit="JND", digits=".2g"),
            Column(name="largest", unit="JND", digits=".2g"),
            Column(name="FFTs a frame", digits=".0f"),
        ),
        rows=tuple(
            (
                name,
                len(found.seen),
                sum(found.exact),
                float(jumps(np.array(found.projected)).max()),
                float(jumps(np.array(found.seen)).max()),
                found.regions,
                found.regions_best,
                found.beyond,
                found.flicker.most,
                found.flicker.largest,
                found.ffts,
            )
            for name, found in faded.items()
        ),
    )
    yield Table(
        caption=(
            "A disc moves in the right part of the picture. Flicker is of the whole picture; "
            "changes are of what is seen of the left part, which stands still, at most in 99.9 % "
            "of its places. Last: a picture that stands still as a whole."
        ),
        columns=(
            Column(name="solved"),
            Column(name="FFTs a frame", digits=".0f"),
            Column(name="flicker, rms", unit="JND", digits=".2g"),
            Column(name="99.9 %", unit="JND", digits=".2g"),
            Column(name="largest", unit="JND", digits=".2g"),
            Column(name="left part changes", unit="JND", digits=".2g"),
            Column(name="the optimum's", unit="JND", digits=".2g"),
            Column(name="in 10 bit codes (optimum)"),
            Column(name="in 12 bit codes (optimum)"),
            Column(name="left part, bend over its luminance", digits=".1e"),
            Column(name="standing still, largest change", unit="white", digits=".1e"),
        ),
        rows=tuple(
            (
                name,
                way.ffts,
                way.flicker.rms,
                way.flicker.most,
                way.flicker.largest,
                way.change,
                way.change_best,
                *(
                    f"{way.codes[bits]:.0f} ({way.codes[f'{bits}, optimum']:.0f})"
                    for bits in ("10 bit", "12 bit")
                ),
                way.rough,
                way.standing,
            )
            for name, way in ways.items()
        ),
    )
    if jods:
        yield Table(
            caption=f"ColorVideoVDP of what is seen, JOD; films at {RATE:g} frames a second.",
            columns=(
                Column(name="film"),
                Column(name="film", unit="JOD", digits=".3f"),
                Column(name="mean of its frames as films", unit="JOD", digits=".3f"),
                Column(name="the optimum's film", unit="JOD", digits=".3f"),
                Column(name="mean of its frames as stills", unit="JOD", digits=".3f"),
            ),
            rows=tuple(
                (name, jod.film, jod.standing, jod.best, jod.stills) for name, jod in jods.items()
            ),
        )


def _plots(faded: Mapping[str, Fade], ways: Mapping[str, Way]) -> Iterator[Plot]:
    def draw_fades(axes: Any) -> None:
        for name, found in faded.items():
            shares = np.linspace(0, 1, len(found.seen) - 1)
            axes.plot(shares, jumps(np.array(found.seen)), label=name.removeprefix("fade, "))
        axes.axhline(JUMP, color="black", linewidth=0.8, linestyle=":")
        axes.set(xlabel="share of the fade", ylabel="step of the mean seen, over its slope")
        axes.set_ylim(0, None)
        drawing.legend_beside(axes)

    yield drawing.plot(
        "Steps of the mean luminance that is seen, over the slope around; dotted: what is allowed.",
        "Steps of fades over their slopes: near 1 throughout.",
        draw_fades,
        (7.4, 3.4),
    )

    def draw_ways(axes: Any) -> None:
        for number, name in enumerate((PAIR, DOME)):
            for way, marker in zip(WAYS, "os^v", strict=True):
                found = ways[f"{name}, {way}"]
                axes.loglog(
                    [found.ffts],
                    [found.flicker.rms],
                    marker=marker,
                    linestyle="",
                    color=drawing.COLOURS[number],
                    label=f"{name}, {way}",
                )
        axes.set(xlabel="FFTs a frame", ylabel="flicker, JND rms")
        drawing.legend_beside(axes)

    yield drawing.plot(
        "What flicker costs: frames solved alone, and started from the frame before.",
        "Flicker against FFTs: starting from the frame before saves FFTs, and adds flicker.",
        draw_ways,
        (7.4, 3.4),
    )


def _figures(
    faded: Mapping[str, Fade], ways: Mapping[str, Way], jods: Mapping[str, Judged]
) -> Iterator[tuple[str, float]]:
    for name, found in faded.items():
        key = f"flicker.{name.removeprefix('fade, ')}"
        yield f"{key}.jump_seen", float(jumps(np.array(found.seen)).max())
        yield f"{key}.jump_projected", float(jumps(np.array(found.projected)).max())
        yield f"{key}.flicker", found.flicker.most
    for name, way in ways.items():
        yield f"flicker.{name}.ffts", way.ffts
        yield f"flicker.{name}.rms", way.flicker.rms
        yield f"flicker.{name}.most", way.flicker.most
        yield f"flicker.{name}.standing", way.standing
    for name, jod in jods.items():
        yield f"flicker.{name}.film", jod.film
        yield f"flicker.{name}.standing_still", jod.standing
        yield f"flicker.{name}.stills", jod.stills
