"""Frames that are made alone do not flicker.

Rationale
    Each frame of a show is made without its neighbours: so a cut cannot bleed, and a frame is the
    same whoever makes it. The default aims by what is missing in the darkest tenth of the screen,
    and by means that keep edges: both change from frame to frame. Such steps would be seen as
    flicker. Films in `stereo_polarised_paper` at 5 % of crosstalk and in `dome_hemisphere`, both at
    15 cd/m² with a black of 1/2000: a picture that stands still; linear fades of it from black,
    and from a grey of which all pollution can be subtracted; a disc that moves before it. The
    *jump* of a fade is its largest step over its own slope there (the median step of the seven
    around), of the mean luminance that is projected, and that is seen. Of regions, squares of 1/16
    of the width, the slope is at least a tenth of the median of all steps, for some stand still.
Expected
    What stands still does not change at all; frames are the same to the bit in any order and alone.
    No fade's mean jumps above 1.5 times its slope, nor do regions in 95 % of all steps; where a
    picture stands still beside what moves, its mean bends from frame to frame by at most 0.5 % of
    its luminance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from compensate.bundled import bundled_night
from compensate.pose import Posed, Stage
from compensate.solve import solved
from domesim.light import Light
from domesim.scene import Scene, load_scene
from domesim.scene.screening import decoded, within_range
from testing import pairs
from testing.places import dome_at, stereo_at
from validation import data, films, judges
from validation.experiment import (
    Check,
    Column,
    Finding,
    Table,
    Work,
    at_most,
    equal,
)

Floats = NDArray[np.float64]

CROSSTALK, ALBEDO, WHITE = 0.05, 0.5, 15.0
WIDTH, SIZE, QUICK_WIDTH, QUICK_SIZE = 256, 192, 96, 64
"""Pixels of a pair's width and of a domemaster."""
FADE = 48
MOVES, QUICK_MOVES = 12, 6
"""Frames. A fade has all in quick runs, too: where a region's light turns, steps of a few are no
slope."""
AROUND = 7
"""Steps of which the slope is the median."""
REGIONS = 16
"""To the width."""
PAIR, DOME = "pair", "dome"
JUMP, STILL = 1.5, 5e-3
"""What is allowed: see Expected."""
GREYS = {PAIR: 0.1, DOME: 0.03}
"""Light of an even grey from which all pollution can be subtracted, and of which the mean goes one
way."""
START, END = (0.7, 0.3), (0.9, 0.3)
"""Way of the disc."""
STANDS = 0.4
"""Share of the width, from the left, that stands still, far from the disc."""


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
    """

    frames: Callable[[], Iterable[Light]]
    scene: Scene


@final
@dataclass(frozen=True)
class Shown:
    """A film as it is made: what is posed, projected and seen of each frame."""

    posed: list[Posed]
    projected: list[Light]
    seen: list[Light]


@final
@dataclass(frozen=True)
class Fade:
    """A fade.

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
class Disc:
    """A disc that moves.

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


def run(work: Work) -> Finding:
    """Films that stand still, fade and move."""
    size = (QUICK_WIDTH, QUICK_SIZE) if work.quick else (WIDTH, SIZE)
    moves = QUICK_MOVES if work.quick else MOVES
    pair, dome = partial(pairs.generated, size[0], work.seed), partial(_domemaster, size[1])
    stereo, theatre = stereo_at(CROSSTALK, WHITE), dome_at(ALBEDO, WHITE)
    moving = {
        PAIR: Film(partial(with_disc, pair, moves), stereo),
        DOME: Film(partial(with_disc, dome, moves), theatre),
    }
    fades = {
        f"{name} from {first}": Film(partial(_fade, picture, scene, first, FADE), scene)
        for name, picture, scene in ((PAIR, pair, stereo), (DOME, dome, theatre))
        for first in ("black", "grey")
    }
    cuts = dict(moving)
    if work.quick:
        left_out = ["Maps and tables, and the test data: with a full run"]
    else:
        present, left_out = data.present(data.SEQUENCE)
        if len(present) == len(data.SEQUENCE):
            cuts["beachball"] = Film(partial(_sequence, stereo), stereo)
        small = partial(pairs.generated, WIDTH // 2, work.seed)
        for title, name in (("map", "stereo_cinema_silver"), ("table", "stereo_shutter")):
            scene = load_scene(name)
            frames = partial(_fade, small, scene, "black", FADE // 2)
            fades[f"pair from black, a {title}"] = Film(frames, scene)
    repeats = work.each(
        {f"{name}: in any order": Film(partial(_cut, f), f.scene) for name, f in cuts.items()},
        float,
        differences,
    )
    faded = work.each({f"fade, {name}": film for name, film in fades.items()}, Fade, fade)
    discs = work.each(moving, Disc, disc)
    return Finding(
        result=_result(faded, discs),
        checks=tuple(_checks(repeats, faded, discs)),
        tables=tuple(_tables(faded, discs)),
        figures={
            **{f"flicker.{name}.regions": found.regions for name, found in faded.items()},
        },
        left_out=tuple(left_out),
    )


# Films


def _domemaster(size: int) -> Light:
    scene = dome_at(ALBEDO, WHITE)
    light = pairs.no_wider(decoded(bundled_night(), scene), size)
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
    return [pairs.no_wider(data.from_data(name, scene)[0], WIDTH) for name in data.SEQUENCE]


# Measuring


def shown(film: Film) -> Shown:
    """A film, made frame by frame."""
    stage = Stage(film.scene)
    found = Shown([], [], [])
    for frame in film.frames():
        posed = stage.pose(frame)
        light = solved(posed, "perceptual").light
        found.posed.append(posed)
        found.projected.append(light)
        found.seen.append(posed.seen(light))
    return found


def differences(film: Film) -> float:
    """Largest difference of the light of a frame that comes twice, and of all from those alone."""
    together = shown(film).projected
    alone = [
        shown(Film(lambda: [frame], film.scene)).projected[0]  # noqa: B023
        for frame in reversed(list(film.frames()))
    ]
    both = [*zip(together, reversed(alone), strict=True), (together[0], together[1])]
    return max(float(np.abs(one - other).max()) for one, other in both)


def fade(film: Film) -> Fade:
    """A fade."""
    found = shown(film)
    return Fade(
        projected=_means(found.projected, film.scene),
        seen=_means(found.seen, film.scene),
        regions=float(np.percentile(jumps(_regions(found, film.scene)), 95)),
    )


def disc(film: Film) -> Disc:
    """A moving disc."""
    found = shown(film)
    standing = Film(lambda: [found.posed[0].desired] * 2, film.scene)
    first, second = shown(standing).projected
    return Disc(
        standing=float(np.abs(second - first).max()),
        level=_means(found.seen, film.scene, _stands(found)),
    )


def _stands(found: Shown) -> NDArray[np.bool_]:
    """(row, col) of the screen that is far from the disc."""
    stands = found.posed[0].screen.copy()
    stands[:, round(STANDS * stands.shape[1]) :] = False
    return stands


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


def bend(levels: Sequence[float]) -> float:
    """Largest second difference."""
    return float(np.abs(np.diff(levels, 2)).max())


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


def _checks(
    repeats: Mapping[str, float],
    faded: Mapping[str, Fade],
    discs: Mapping[str, Disc],
) -> Iterator[Check]:
    for name, difference in repeats.items():
        yield equal(f"{name}, after a cut, and alone: largest difference of light", difference, 0)
    for name, found in faded.items():
        for what, jump in zip(("projected", "seen"), found.jumps, strict=True):
            yield at_most(f"{name}: largest step of the mean {what} over its slope", jump, JUMP)
        yield at_most(f"{name}: steps of 95 % of regions over their slope", found.regions, JUMP)
    for name, moved in discs.items():
        yield equal(f"{name}: largest change of what stands still", moved.standing, 0)
        yield at_most(f"{name}: bend of what stands still beside the disc", moved.rough, STILL)


def _result(faded: Mapping[str, Fade], discs: Mapping[str, Disc]) -> str:
    step = max(max(found.jumps) for found in faded.values())
    return (
        f"What stands still is the same to the bit. Of {len(faded)} fades, the largest step of the "
        f"mean is {step:.3f} of its slope. What stands still beside a disc bends by "
        f"{max(moved.rough for moved in discs.values()):.1e} of its luminance."
    )


def _tables(faded: Mapping[str, Fade], discs: Mapping[str, Disc]) -> Iterator[Table]:
    yield Table(
        caption="Of fades, steps over the slope around; of a disc, how what stands still far from "
        "it bends, over its luminance.",
        columns=(
            Column(name="film"),
            Column(name="frames"),
            Column(name="largest step, projected", digits=".3f"),
            Column(name="seen", digits=".3f"),
            Column(name="regions, 95 %", digits=".3f"),
            Column(name="bend of what stands still", digits=".1e"),
        ),
        rows=(
            *(
                (n, len(found.seen), *found.jumps, found.regions, None)
                for n, found in faded.items()
            ),
            *((n, len(moved.level), None, None, None, moved.rough) for n, moved in discs.items()),
        ),
    )
