"""A survey of a dome knows how sure it is of what nobody told it: walls, noise, the camera's place.

Rationale
    `domesim measure dome` says what a theatre's screen and floor reflect, and how sure that is. Its
    file may be silent, or wrong. Nobody may know the wall's paint, and a wall that photographs do
    not show is told by little else. Noise may have heavy tails, as that of few photons, or of a
    rendering, has. A camera may be where it is not said to be, which must not be taken for a turn.
    Random theatres are photographed, by radiosity and pixel by pixel. All that is stated within an
    error is off by it: camera, vignetting, the floor's height, reflected light as modelled. Three
    cases add one surprise each: a wall of any albedo from 0.03 to 0.6 that is described as another;
    log-normal noise of 20 % a pixel; and none, with the ordinary noise of 1 % a pixel, to see where
    the camera is found. Both noises are met without geometry, too, in fewer theatres.
Expected
    90 to 98 % of the 95 % intervals hold the truth: of the albedo of walls not seen; of gain,
    screen and floor under heavy-tailed noise; of the camera's place and direction (quick: 80 % or
    more). A wall's primaries are drawn apart, so that each tells something.
    Intervals are no wider than they need be, either: the errors' root-mean-square, in standard
    errors as they are stated, is 0.7 to 1.4 for every figure, whatever the noise.
    Under heavy-tailed noise no figure is off in one direction by more than half of its standard
    error, on average. Without geometry white and its reflected light are off by less than 1 % in
    the mean.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar, final

import numpy as np
from numpy.typing import NDArray

from domesim.measure.dome.camera import SURFACES, Camera, looked_at, places_in
from domesim.measure.dome.fit import Survey
from domesim.measure.dome.model import Interreflection, Places, nominal_albedos, surfaces_of
from domesim.measure.dome.nuisances import Errors
from domesim.measure.dome.photographs import Photographs, direct_light
from domesim.measure.dome.responses import responses_of
from domesim.measure.dome.run import survey_of
from domesim.measure.dome.without_geometry import DEGREE, found_in
from domesim.observation.uncertain import SIGMAS
from domesim.room.dome import Dome
from domesim.room.theatre import Floor, Theatre, Wall
from domesim.scene.fields import three
from testing.laboratory import patterns_for, sectors_for
from validation.experiment import Check, Column, Finding, Table, Work, at_most, between

Floats = NDArray[np.float64]
T = TypeVar("T")
Noise = Callable[[np.random.Generator, Floats], Floats]

QUICK, FULL = 2, 40
"""Theatres a case."""
QUICK_ALONE, FULL_ALONE = 1, 12
"""Theatres without geometry."""
RESOLUTION = 6
"""Resolution of radiosity, in which photographs are computed and explained: what differs is
nobody's error."""
PATTERN, PHOTOGRAPH = 128, 96
GAIN = (0.6, 0.8, 1.0)
AMBIENT = 0.003
STATED = Errors()
LOWER, HIGHER = 0.03, 0.6
"""Albedos of walls."""


@final
@dataclass(frozen=True)
class Misplaced:
    """How photographs differ from what is described, in stated errors.

    Parameters
    ----------
    place, turn, vignetting
        The camera's.
    model
        Reflected light on screen, floor and wall.
    """

    place: Floats
    turn: Floats
    vignetting: Floats
    model: Floats


def even(rng: np.random.Generator, light: Floats) -> Floats:
    """Noise of an ordinary camera: 1 % of the light, and some in the dark."""
    return np.asarray(np.hypot(0.01 * light, 1e-4) * rng.standard_normal(light.shape))


def heavy(rng: np.random.Generator, light: Floats) -> Floats:
    """Log-normal noise of 20 %: mostly a little too dark, now and then far too bright."""
    drawn = np.exp(rng.standard_normal(light.shape))
    standard = (drawn - np.exp(0.5)) / np.sqrt((np.e - 1) * np.e)
    return np.asarray(0.2 * light * standard + 1e-4 * rng.standard_normal(light.shape))


def computed(
    theatre: Theatre,
    camera: Camera,
    patterns: Floats,
    rng: np.random.Generator,
    noise: Noise = even,
    moved: Camera | None = None,
    vignetting: Sequence[float] | Floats = (0.0, 0.0),
    model: Sequence[float] | Floats = (0.0, 0.0, 0.0),
) -> Photographs:
    """Photographs of patterns, one each, by radiosity at each pixel.

    Parameters
    ----------
    theatre
        As it is.
    camera
        As it is described.
    patterns
        (pattern, row, col, primary) light of projected domemasters.
    rng, noise
        What is added to a pixel's light.
    moved
        The camera as it is, if it is not as described.
    vignetting
        Light at the rim of the view over that in the middle, less 1: by what grows with the square
        of the distance from the middle, and by what grows with its fourth power.
    model
        Reflected light on screen, floor and wall over that of the model, less 1.
    """
    moved = camera if moved is None else moved
    u, v = places_in(PHOTOGRAPH)
    surface, points = looked_at(theatre, moved, u, v)
    numbers = {SURFACES[name]: number for number, name in enumerate(surfaces_of(theatre))}
    on = np.isin(surface, list(numbers))
    kinds = np.array([numbers[int(kind)] for kind in surface[on]])
    lit = direct_light(theatre, patterns)
    direct = np.zeros((len(patterns), len(kinds), 3))
    screen = kinds == 0
    rays = theatre.dome.toward(points[on][screen])
    row, col = theatre.dome.pixel_of(rays, lit.shape[1])
    direct[:, screen] = lit[:, row, col]
    places = Places(kinds, points[on][:, None], direct)
    room = Interreflection(theatre, patterns, RESOLUTION)
    seen, albedos = room.seen_from(places), nominal_albedos(theatre)
    light = np.zeros((len(patterns), *u.shape, 3))
    for p in range(3):
        shown = room.shown(p, albedos[:, p], places, seen)[0]
        reflected = (shown - direct[..., p]) * (1 + np.asarray(model)[kinds])
        light[:, on, p] = GAIN[p] * (direct[..., p] + reflected + AMBIENT)
    away = (u**2 + v**2)[..., None]
    light *= (1 + vignetting[0] * away) * (1 + vignetting[1] * away**2)
    light += noise(rng, light)
    light[:, ~on] = 0
    return Photographs(camera, light, np.arange(len(patterns)), np.ones(len(patterns)))


def theatre(rng: np.random.Generator, *, wall: bool = False) -> tuple[Theatre, Camera]:
    """A random one and its camera; its wall, if any, is too narrow to be seen away from edges."""
    radius = float(rng.uniform(3, 10))
    dome = Dome(radius, np.radians(rng.uniform(80, 90)), np.radians(rng.uniform(0, 12)))
    drop = rng.uniform(0.05, 0.09) if wall else rng.uniform(0.15, 0.3)
    height = min(dome.lowest, 0.0) - float(drop) * radius
    screen, floor = (three(rng.uniform(*ends, 3)) for ends in ((0.3, 0.75), (0.05, 0.3)))
    x, y = (float(part) for part in rng.uniform((-0.1, -0.2), (0.1, 0.0)) * radius)
    # Above the floor by a tripod's height, or in its lower half
    z = height + min(1.6, 0.6 * abs(height))
    walls = Wall(dome.widest, height, dome.lowest, three(rng.uniform(LOWER, HIGHER, 3)))
    camera = Camera((x, y, z), (x, y + 1.5, z + 1.0), np.radians(220.0))
    real = Theatre(dome, screen, floor=Floor(height, dome.widest, floor))
    return (replace(real, wall=walls) if wall else real), camera


def misplaced(
    theatre: Theatre, camera: Camera, rng: np.random.Generator
) -> tuple[Theatre, Camera, Misplaced]:
    """Both as they are if they are described within `STATED`, and by how many of its errors."""
    off, turn, edge, model = (rng.standard_normal(count) for count in (3, 3, 2, 3))
    sunk = float(rng.standard_normal())
    step = STATED.camera_m * off
    moved = replace(
        camera,
        position=three(np.add(camera.position, step)),
        look_at=three(np.add(camera.look_at, step)),
        turn=three(np.radians(STATED.pointing_deg * turn)),
    )
    floor, wall = theatre.floor, theatre.wall
    assert floor is not None
    floor = replace(floor, height=floor.height - STATED.floor_m * sunk)
    if wall is not None:
        wall = replace(wall, bottom=floor.height)
    return replace(theatre, floor=floor, wall=wall), moved, Misplaced(off, turn, edge, model)


def described(real: Theatre, rng: np.random.Generator) -> Theatre:
    """The same of other paints."""
    floor, wall = real.floor, real.wall
    assert floor is not None
    if wall is not None:
        wall = replace(wall, albedo=three(rng.uniform(LOWER, HIGHER, 3)))
    return replace(real, albedo=(0.5,) * 3, floor=replace(floor, albedo=(0.15,) * 3), wall=wall)


@final
@dataclass(frozen=True)
class Trial:
    """What was found, less the truth, in standard errors, by name; and whether all was answered."""

    z: dict[str, tuple[float, ...]]
    complete: bool


def wall_of_any_paint(seed: int) -> Trial:
    """Photograph a theatre whose wall is described wrongly."""
    return _tried(seed, wall=True)


def heavy_tails(seed: int) -> Trial:
    """Photograph a theatre with noise that is now and then very large."""
    return _tried(seed, noise=heavy)


def misplaced_camera(seed: int) -> Trial:
    """Photograph a theatre from beside the stated place."""
    return _tried(seed)


def _tried(seed: int, *, wall: bool = False, noise: Noise = even) -> Trial:
    rng = np.random.default_rng(seed)
    stated, camera = theatre(rng, wall=wall)
    real, moved, off = misplaced(stated, camera, rng)
    patterns = patterns_for(real.dome, PATTERN)
    shots = computed(
        real,
        camera,
        patterns,
        rng,
        noise,
        moved,
        STATED.vignetting * off.vignetting,
        np.array([STATED.model_screen, STATED.model_others, STATED.model_others]) * off.model,
    )
    found = _surveyed(described(stated, rng), patterns, shots)
    z = _z(real, found)
    for kind, true in (("camera", off.place), ("turn about", off.turn)):
        pairs = [found.nuisances[f"{kind} {axis}"] for axis in "xyz"]
        z[kind] = tuple(
            (value - one) / error for (value, error), one in zip(pairs, true.tolist(), strict=True)
        )
    return Trial(z, found.complete)


@final
@dataclass(frozen=True)
class Alone:
    """What a survey without geometry finds, by primary.

    Parameters
    ----------
    white, reflected
        Light found over the truth, less 1.
    z
        Error of the reflected light in standard errors, as stated.
    """

    white: tuple[float, ...]
    reflected: tuple[float, ...]
    z: tuple[float, ...]


def even_alone(seed: int) -> Alone:
    """Photograph a theatre with ordinary noise; nothing else is told."""
    return _alone(seed, even)


def heavy_tails_alone(seed: int) -> Alone:
    """Photograph a theatre with noise that is now and then very large; nothing else is told."""
    return _alone(seed, heavy)


def _alone(seed: int, noise: Noise) -> Alone:
    rng = np.random.default_rng(seed)
    real, camera = theatre(rng)
    patterns = sectors_for(real.dome, PATTERN)
    found = found_in(
        responses_of(real, patterns, computed(real, camera, patterns, rng, noise), DEGREE), real
    )
    reflected = _reflected(real, patterns[1:2])
    return Alone(
        tuple((found.gain / GAIN - 1).tolist()),
        tuple((found.white / reflected - 1).tolist()),
        tuple(((found.white - reflected) / found.white_error).tolist()),
    )


def _reflected(theatre: Theatre, white: Floats) -> Floats:
    """(primary,) mean light over the screen that a white picture has beyond its direct light."""
    dome, size = theatre.dome, 24
    inside = dome.inside(size, size)
    points, areas = dome.points(size, size)[inside], dome.screen_areas(size, size)[inside]
    lit = direct_light(theatre, white)
    row, col = dome.pixel_of(dome.toward(points), lit.shape[1])
    places = Places(np.zeros(len(points), np.int64), points[:, None], lit[:, row, col])
    model, albedos = Interreflection(theatre, white, RESOLUTION), nominal_albedos(theatre)
    seen = model.seen_from(places)
    light = [model.shown(p, albedos[:, p], places, seen)[0][0] for p in range(3)]
    return np.asarray((np.stack(light) - places.direct[0].T) @ areas / areas.sum())


CASES: Mapping[str, Callable[[int], Trial]] = {
    "a wall of any paint": wall_of_any_paint,
    "heavy-tailed noise": heavy_tails,
    "a misplaced camera": misplaced_camera,
}
FIGURES = {
    "a wall of any paint": ("screen", "floor", "wall"),
    "heavy-tailed noise": ("gain", "screen", "floor"),
    "a misplaced camera": ("gain", "screen", "floor", "camera", "turn about"),
}
TOLD = {
    "a wall of any paint": ("wall",),
    "heavy-tailed noise": ("gain", "screen", "floor"),
    "a misplaced camera": ("camera", "turn about"),
}
"""Figures of each case whose intervals are counted together."""
HEAVY_ALONE = "without geometry, heavy-tailed noise"
ALONE: Mapping[str, Callable[[int], Alone]] = {
    "without geometry, ordinary noise": even_alone,
    HEAVY_ALONE: heavy_tails_alone,
}


def _surveyed(told: Theatre, patterns: Floats, shots: Photographs) -> Survey:
    return survey_of(
        told, patterns, shots, {}, STATED, profile=False, resolution=RESOLUTION
    )[1]  # fmt: skip


def _z(real: Theatre, found: Survey) -> dict[str, tuple[float, ...]]:
    truth = np.concatenate([[GAIN], nominal_albedos(real)])
    z = (found.value - truth) / found.error
    return {name: tuple(row.tolist()) for name, row in zip(found.names, z, strict=True)}


def run(work: Work) -> Finding:
    """Measure theatres in each case."""
    count, few = (QUICK, QUICK_ALONE) if work.quick else (FULL, FULL_ALONE)

    def each(case: str, trials: int, kind: type[T], measure: Callable[[int], T]) -> list[T]:
        seeds = {f"{case} {number}": 1000 * work.seed + number for number in range(trials)}
        return list(work.each(seeds, kind, measure).values())

    trials = {case: each(case, count, Trial, measure) for case, measure in CASES.items()}
    alone = {case: each(case, few, Alone, measure) for case, measure in ALONE.items()}
    z = {
        (case, name): np.array([one.z[name] for one in trials[case]])
        for case, names in FIGURES.items()
        for name in names
    }
    z |= {(case, "reflected"): np.array([one.z for one in found]) for case, found in alone.items()}
    off = {
        name: np.array([getattr(one, name) for one in alone[HEAVY_ALONE]])
        for name in ("white", "reflected")
    }
    held = {key: _held(part) for key, part in z.items()}
    wall = held["a wall of any paint", "wall"]
    noisy, placed = (
        float(np.mean([held[case, name] for name in TOLD[case]]))
        for case in ("heavy-tailed noise", "a misplaced camera")
    )
    rms = {key: _rms(part) for key, part in z.items()}
    return Finding(
        result=(
            f"{count} random theatres a case. Of walls that photographs do not show, whose paint "
            f"was described wrongly, {wall:.0%} of the 95 % intervals hold the albedo. Under "
            f"log-normal noise of 20 % a pixel {noisy:.0%} of those of gain, screen and floor do; "
            f"of the camera's place and direction, {placed:.0%}. Errors are "
            f"{min(rms.values()):.2f} to {max(rms.values()):.2f} of those stated "
            f"(root-mean-square of each figure). Without geometry, white is off by "
            f"{off['white'].mean():+.1%} under heavy-tailed noise and its reflected light by "
            f"{off['reflected'].mean():+.1%}, mean of {few} theatres."
        ),
        advice="State what you know of the wall (`--hold wall=0.1,0.03`) if the survey says that "
        "the photographs tell little of it.",
        checks=(
            *_checks(z, trials, quick=work.quick),
            *(
                between(
                    f"{HEAVY_ALONE}: mean error of {name}", 100 * float(part.mean()), -1.0, 1.0, "%"
                )
                for name, part in off.items()
            ),
        ),
        tables=(_table(z, held),),
        figures={
            **{f"held.{name}.{case}": share for (case, name), share in held.items()},
            **{f"error_over_stated.{name}.{case}": value for (case, name), value in rms.items()},
            **{f"without_geometry.{name}": float(part.mean()) for name, part in off.items()},
        },
    )


def _held(z: Floats) -> float:
    return float(np.mean(np.abs(z) < SIGMAS))


def _rms(z: Floats) -> float:
    return float(np.sqrt(np.mean(z**2)))


def _checks(
    z: Mapping[tuple[str, str], Floats],
    trials: Mapping[str, Sequence[Trial]],
    *,
    quick: bool,
) -> tuple[Check, ...]:
    checks = []
    low, high = (0.8, 1.0) if quick else (0.9, 0.98)
    for case, names in TOLD.items():
        share = _held(np.concatenate([z[case, name].ravel() for name in names]))
        checks.append(between(f"{case}: intervals that hold the truth", share, low, high))
        missing = sum(not one.complete for one in trials[case])
        checks.append(at_most(f"{case}: theatres not answered", missing, 0.1 * len(trials[case])))
    least, most = (0.2, 2.5) if quick else (0.7, 1.4)
    for (case, name), part in z.items():
        checks.append(
            between(f"{case}: rms error of {name}, in standard errors", _rms(part), least, most)
        )
    for name in TOLD["heavy-tailed noise"]:
        part = z["heavy-tailed noise", name]
        allowed = 0.5 + (2.0 if quick else 0.0)
        checks.append(
            between(f"heavy-tailed noise: mean error of {name}, in standard errors",
                    float(part.mean()), -allowed, allowed)
        )  # fmt: skip
    return tuple(checks)


def _table(z: Mapping[tuple[str, str], Floats], held: Mapping[tuple[str, str], float]) -> Table:
    return Table(
        caption="Errors in standard errors, and 95 % intervals that hold the truth.",
        columns=(
            Column(name="case"),
            Column(name="figure"),
            Column(name="mean error", digits="+.2f"),
            Column(name="rms error", digits=".2f"),
            Column(name="intervals that hold the truth", unit="%", digits=".0f"),
        ),
        rows=tuple(
            (case, name, float(part.mean()), _rms(part),
             100 * held[case, name])
            for (case, name), part in z.items()
        ),
    )  # fmt: skip
