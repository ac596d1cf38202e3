"""Ways to a theatre's reflected light, each beside paths: one function a way.

Paths are traced twice, so that their noise takes no part in what a way is said to be off by.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.observation.radiosity import quick_radiosity, radiosity
from domesim.observation.spherical import bare_transport
from domesim.observation.transport import TabulatedDome, Transport
from domesim.pathtrace.observation import PathTracedDome
from domesim.pathtrace.reference import path_traced
from domesim.pathtrace.tabulate import tabulate
from domesim.pathtrace.tracer import Settings, Traced, Tracer
from domesim.room.lenses import lens_gains
from testing.energy import imbalance
from testing.statistics import rms_difference
from validation import radiance
from validation.reflection import PICTURES, reflected
from validation.rooms import Case

Image = NDArray[np.float64]

CLOSED, RADIOSITY, TABULATED, EIGHT = "closed form", "radiosity", "tabulated", "eight modes"
QUICK_RADIOSITY = "quick radiosity"
"""What commands take of domes that are no spheres, in seconds."""
MITSUBA, RADIANCE, ENERGY = "Mitsuba", "Radiance", "energy"
SIZE = 64
"""Pixels a side of the domemasters."""
RUNS = 4
"""Pictures of Mitsuba's, whose spread tells their error."""
BATCHES = 12
"""Batches of walks that a balance of energy takes."""


@final
@dataclass(frozen=True)
class Effort:
    """How much to do.

    Parameters
    ----------
    error
        Standard errors of paths and tabulations, over those that a case asks for.
    rings
        Resolution of radiosity.
    samples
        Mitsuba's, a pixel and picture.
    rays
        Radiance's; 0 if it is not asked.
    """

    error: float
    rings: int
    samples: int
    rays: int


@final
@dataclass(frozen=True)
class Opinion:
    """What one way says of a picture's reflected light, beside paths.

    Attributes
    ----------
    off_by, error
        Its mean over the screen over that of paths, less 1, and the standard error of that. Of
        energy: the share that is missing. Of Mitsuba: of the primary that is furthest off.
    rms, noise
        Rms of its error over the screen, relative to the mean, and what that would be by noise
        alone, at most (two standard errors); None if only its mean is known.
    cpu_s
        What it took, s.
    """

    off_by: float
    error: float
    rms: float | None = None
    noise: float = 0.0
    cpu_s: float = 0.0


@final
@dataclass(frozen=True)
class Light:
    """The reflected light of one picture in one theatre.

    Attributes
    ----------
    traced, error
        Its mean by paths, projector white = 1, and its standard error.
    unevenness
        Rms over the screen of what no even light can be, relative to the mean.
    noise
        What an rms would be by the noise of paths alone.
    by
        Way -> opinion.
    """

    traced: float
    error: float
    unevenness: float
    noise: float
    by: dict[str, Opinion]


@final
@dataclass(frozen=True)
class _Model:
    """A way that gives the whole picture, its relative standard error, and what it took, s."""

    reflected: Callable[[NDArray[np.float32]], Image]
    error: float = 0.0
    cpu_s: float = 0.0


def light_of(case: Case, effort: Effort, seed: int) -> dict[str, Light]:
    """Each picture's reflected light, by each way that is asked of a theatre.

    Parameters
    ----------
    case
        The theatre.
    effort
        How much to do.
    seed
        Seed of all random numbers.
    """
    tracer = Tracer(case.theatre)
    areas = case.theatre.dome.screen_areas(SIZE, SIZE)
    models = dict(_models(case, tracer, effort, seed))
    return {
        picture: _judged(case, tracer, picture, areas / areas.sum(), models, effort, seed)
        for picture in case.pictures
    }


def _judged(
    case: Case,
    tracer: Tracer,
    picture: str,
    share: Image,
    models: Mapping[str, _Model],
    effort: Effort,
    seed: int,
) -> Light:
    shown = PICTURES[picture](SIZE)
    source = tracer.picture(shown)
    settings = [
        Settings(error=case.error * effort.error, least=16, most=1 << 20, seed=seed + number)
        for number in range(2)
    ]
    first, second = (tracer.screen(source, SIZE, SIZE, each, eye=case.eye) for each in settings)
    pooled = np.array([each.pooled_error(share) for each in (first, second)])
    mean, error = float(pooled[:, 0].mean()), float(np.hypot(*pooled[:, 1]) / 2)
    variance = np.prod(
        [each.standard_error[..., 0].astype(np.float64) for each in (first, second)], 0
    )
    noise, by = _noise(share, variance) / mean, {}
    for way, model in models.items():
        light = model.reflected(shown)
        by[way] = Opinion(
            float(np.einsum("ij,ijp->", share, light) / 3 / mean - 1),
            float(np.hypot(error / mean, model.error)),
            rms_difference(light, first.mean, second.mean, share) / mean,
            noise,
            model.cpu_s,
        )
    if MITSUBA in case.others:
        by[MITSUBA] = _mitsuba(case, tracer, shown, (first, second), effort, seed)
    if RADIANCE in case.others and picture == "white" and effort.rays:
        other, spread = (
            float(part.mean())
            for part in radiance.reflected(case.theatre, rays=effort.rays, seed=seed)
        )
        by[RADIANCE] = Opinion(other / mean - 1, float(np.hypot(error, spread)) / mean)
    if ENERGY in case.others:
        missing, around = imbalance(case.theatre, np.inf, BATCHES, BATCHES)
        by[ENERGY] = Opinion(float(missing.mean()), float(around.mean()))
    even = np.full((SIZE, SIZE, 3), mean)
    return Light(
        mean,
        error,
        max(0.0, rms_difference(even, first.mean, second.mean, share) / mean),
        noise,
        by,
    )


def _noise(share: Image, variance: Image) -> float:
    """Two standard errors of an rms of differences of such a variance, each of two being one."""
    return float(np.sqrt(2 * np.sqrt(np.sum((share * variance) ** 2))))


def _models(case: Case, tracer: Tracer, effort: Effort, seed: int) -> Iterator[tuple[str, _Model]]:
    theatre = case.theatre
    gain = lens_gains(theatre, SIZE, SIZE).sum(0) if theatre.lenses else None
    paint = None if theatre.paint is None else theatre.paint.on(SIZE, SIZE)

    def seen(transport: Transport) -> TabulatedDome:
        return transport.observation(SIZE, SIZE, lens_gain=gain, paint=paint)

    closed = seen(bare_transport(theatre))
    yield CLOSED, _Model(partial(reflected, closed))
    enclosed = theatre.floor is not None or theatre.dome.height_ratio != 1
    if enclosed and not theatre.beyond_enclosure and not case.even:
        started = time.process_time()
        transport = radiosity(theatre, resolution=effort.rings)
        seconds = time.process_time() - started
        yield RADIOSITY, _Model(partial(reflected, seen(transport)), cpu_s=seconds)
        if theatre.dome.height_ratio != 1:
            yield QUICK_RADIOSITY, _Model(partial(reflected, seen(quick_radiosity(theatre))))
    if case.tabulated:
        # The mean over the screen is the same with any patterns, and found sooner with one.
        alone = {"degree": 0, "explicit": False, "most": 1e8} if case.even else {}
        error = case.tabulated * effort.error
        found = tabulate(theatre, error=error, tracer=tracer, seed=seed, **alone)  # type: ignore[arg-type]
        for way, transport in (
            (TABULATED, found.transport),
            (EIGHT, found.transport.reduced(0.0, 8)),
        ):
            claimed = transport.core_error[:, 0, 0].mean() / transport.mean_gain().mean()
            yield way, _Model(partial(reflected, seen(transport)), float(claimed), found.seconds)


def _mitsuba(
    case: Case,
    tracer: Tracer,
    shown: NDArray[np.float32],
    traced: tuple[Traced, Traced],
    effort: Effort,
    seed: int,
) -> Opinion:
    """Mitsuba's own integrator, in the picture's middle: both know pixels at the rim otherwise."""
    theatre = case.theatre
    direct = PathTracedDome(theatre, SIZE, SIZE, tracer=tracer).direct(shown[None])[0]
    started = time.process_time()
    theirs = np.stack(
        [
            path_traced(theatre, shown, SIZE, samples=effort.samples, seed=RUNS * seed + run)
            for run in range(RUNS)
        ]
    ) - np.asarray(direct, np.float64)
    seconds = time.process_time() - started
    place = (np.arange(SIZE) + 0.5) * (2 / SIZE) - 1
    share = theatre.dome.screen_areas(SIZE, SIZE) * (np.hypot(place[:, None], place) < 0.93)
    share = share / share.sum()
    means = np.einsum("ij,nijp->np", share, theirs)
    pair = np.stack([each.mean.astype(np.float64) for each in traced])
    spread = np.stack([each.standard_error.astype(np.float64) for each in traced])
    ours = np.einsum("ij,nijp->p", share, pair) / 2
    own = np.sqrt(np.einsum("ij,nijp->p", share**2, spread**2)) / 2
    off = means.mean(0) / ours - 1
    error = np.hypot(own, means.std(0, ddof=1) / np.sqrt(RUNS)) / ours
    worst = int(np.argmax(np.abs(off)))
    halves = [theirs[::2].mean(0) - pair[0], theirs[1::2].mean(0) - pair[1]]
    square = float(np.einsum("ij,ijp->", share, halves[0] * halves[1]) / 3)
    rms = float(np.sign(square) * np.sqrt(abs(square)) / ours.mean())
    variance = (spread[0] * spread[1] + theirs.var(0, ddof=1) / (RUNS / 2)).mean(-1)
    noise = _noise(share, variance) / float(ours.mean())
    return Opinion(float(off[worst]), float(error[worst]), rms, noise, seconds)
