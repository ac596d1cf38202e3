"""Reflected light of bare caps, path traced and by the closed form.

``python -m validation.reflection [WALKS]`` traces so many walks (1e8 by default) in each of two
white caps, tells how far the light is off the closed form, and walks a second.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from domesim.observation.base import AdjointObservation
from domesim.observation.spherical import ClosedFormDome, bare_gain
from domesim.pathtrace.llvm import told
from domesim.pathtrace.tracer import Settings, Traced, Tracer
from domesim.room.dome import Dome
from domesim.room.theatre import Theatre

SIZE = 64

RUNS = 16

BOUNCES = 4
"""How many ratios of bounces are looked at."""

CAPS = ((90.0, 0.5), (150.0, 0.8))
"""Half-angle, degrees, and albedo of the caps in which many walks are traced."""


@dataclass(frozen=True)
class Cell:
    """One cap's indirect light, relative to the mean direct light.

    Attributes
    ----------
    half_angle, albedo
        Half-angle (degrees) and albedo of the cap.
    truth, found, error
        By the closed form, by path tracing, and its standard error.
    bounces, ratio
        Light of each bounce, and the expected ratio of that of bounces k and k - 1.
    ratio_z
        The ratios that were found, as z-scores.
    paths, cpu_s
        Walks, and CPU time, s.
    """

    half_angle: float
    albedo: float
    truth: float
    found: float
    error: float
    bounces: tuple[float, ...]
    ratio: float
    ratio_z: tuple[float, ...]
    paths: int
    cpu_s: float

    @property
    def z(self) -> float:
        """Difference over its standard error."""
        return (self.found - self.truth) / self.error

    @property
    def off_by(self) -> float:
        """Relative difference."""
        return self.found / self.truth - 1


def measure(
    half_angle: float,
    albedo: float,
    *,
    error: float = 2.5e-4,
    picture: str = "white",
    seed: int = 0,
) -> Cell:
    """One cap, traced until the mean's relative standard error is about `error`.

    Parameters
    ----------
    half_angle, albedo
        Half-angle (degrees) and albedo of the cap.
    error
        Relative standard error of the mean indirect light.
    picture
        One of `PICTURES`.
    seed
        Seed of the random numbers.
    """
    dome = Dome(5.0, np.radians(half_angle))
    tracer = Tracer(Theatre(dome, (albedo, albedo, albedo)))
    shown = PICTURES[picture](SIZE)
    source = tracer.picture(shown)
    share = dome.screen_areas(SIZE, SIZE) / dome.screen_area
    observation = ClosedFormDome(dome, SIZE, SIZE, albedo=albedo)
    areas = dome.pixel_areas(SIZE, SIZE)
    direct = float(np.sum(shown[..., 0] * areas) / areas.sum())
    pilot = _trace(tracer, source, 64, seed + RUNS)
    mean, reached = pilot.pooled_error(share)
    walks = max(16, round(64 * (reached / mean / error) ** 2 / RUNS))
    runs = [_trace(tracer, source, walks, seed + run) for run in range(RUNS)]
    pooled = np.array([run.pooled_error(share) for run in runs])
    keeps = albedo * dome.screen_area / (4 * np.pi * dome.radius**2)
    bounces = np.array([_bounces(run, share) for run in runs])
    return Cell(
        half_angle,
        albedo,
        truth=float(np.sum(share * reflected(observation, shown)[..., 0])) / direct,
        found=float(pooled[:, 0].mean()) / direct,
        error=float(np.sqrt(np.mean(pooled[:, 1] ** 2) / RUNS)) / direct,
        bounces=tuple(float(light) / direct for light in bounces.mean(0)),
        ratio=keeps,
        ratio_z=_ratio_scores(bounces, direct, keeps),
        paths=int(dome.inside(SIZE, SIZE).sum()) * walks * RUNS,
        cpu_s=sum(run.seconds for run in runs),
    )


def white(half_angle: float, albedo: float, walks: float, seed: int = 0) -> str:
    """Traces a white picture in one cap, in one go.

    Parameters
    ----------
    half_angle, albedo
        Half-angle (degrees) and albedo of the cap.
    walks
        Walks in all.
    seed
        Seed of the random numbers.

    Returns
    -------
    str
        A line of the table that `main` prints.
    """
    dome = Dome(5.0, np.radians(half_angle))
    tracer = Tracer(Theatre(dome, (albedo, albedo, albedo)))
    source = tracer.picture(PICTURES["white"](SIZE))
    pixels = int(dome.inside(SIZE, SIZE).sum())
    each = max(2, round(walks / pixels))
    # No bounce is left out that would show
    settings = Settings(least=each, most=each, tolerance=1e-9, seed=seed)
    started = time.perf_counter()
    traced = tracer.screen(source, SIZE, SIZE, settings)
    seconds = time.perf_counter() - started
    found, error = traced.pooled_error(dome.screen_areas(SIZE, SIZE))
    truth = bare_gain(albedo, dome)
    return (
        f"{half_angle:>8g}° {albedo:>7g} {each * pixels:>10.3g} {found:>11.7f} {truth:>12.7f} "
        f"{error:>10.1e} {(found - truth) / error:>+6.2f} {each * pixels / seconds / 1e6:>10.1f}"
    )


def main(walks: float = 1e8) -> None:
    """Prints the closed form beside what so many walks find, for each of `CAPS`."""
    print(told())
    print("half-angle albedo      walks      traced  closed form  std. error     z  M walks/s")
    for half_angle, albedo in CAPS:
        white(half_angle, albedo, 1e6)  # which compiles
        print(white(half_angle, albedo, walks), flush=True)


def reflected(
    observation: AdjointObservation, picture: NDArray[np.floating[Any]]
) -> NDArray[np.float64]:
    """(row, col, primary): what an observation adds to the direct light of a domemaster."""
    shown = picture[None].astype(np.float64)
    return np.asarray((observation.linear(shown) - observation.direct(shown))[0])


def _grey(light: NDArray[np.generic]) -> NDArray[np.float32]:
    return np.repeat(light[..., None], 3, axis=2).astype(np.float32)


def patch(size: int) -> NDArray[np.float32]:
    """(row, col, primary) a bright disc away from the rim, on black."""
    place = (np.arange(size) + 0.5) * (2 / size) - 1
    return _grey((place[:, None] - 0.3) ** 2 + (place[None, :] + 0.4) ** 2 < 0.05)


def coloured(size: int) -> NDArray[np.float32]:
    """(row, col, primary) coloured, brighter to the front, with an edge."""
    place = (np.arange(size) + 0.5) * (2 / size) - 1
    front = np.clip(place[:, None, None], 0, 1) * np.array([1.0, 0.5, 0.2])
    return np.asarray(0.2 + front + 0.3 * (place[None, :, None] > 0.3), np.float32)


PICTURES: Mapping[str, Callable[[int], NDArray[np.float32]]] = {
    "white": lambda size: _grey(np.ones((size, size))),
    "patch": patch,
    "half": lambda size: _grey(np.repeat(np.arange(size)[:, None] >= size // 2, size, 1)),
    "coloured": coloured,
}
"""Name -> (row, col, primary) domemaster of a size."""


def _trace(tracer: Tracer, source: object, walks: int, seed: int) -> Traced:
    settings = Settings(least=walks, most=walks, seed=seed, per_bounce=True, tolerance=1e-6)
    return tracer.screen(source, SIZE, SIZE, settings)  # type: ignore[arg-type]


def _bounces(traced: Traced, share: NDArray[np.float64]) -> NDArray[np.float64]:
    """(bounce,) mean light of bounces 1 to `BOUNCES`."""
    assert traced.bounces is not None
    planes = traced.bounces[1 : BOUNCES + 1, ..., 0].astype(np.float64)
    return np.asarray(np.einsum("ij,kij->k", share, planes) / share.sum())


def _ratio_scores(
    bounces: NDArray[np.float64], direct: float, expected: float
) -> tuple[float, ...]:
    """z-scores of the ratios of successive bounces, by the spread of (run, bounce).

    The spread is that of the residual (bounce k) - expected (bounce k - 1), which is linear: its
    mean has no bias.
    """
    series = np.column_stack([np.full(len(bounces), direct), bounces])
    residual = series[:, 1:] - expected * series[:, :-1]
    t = residual.mean(0) / (residual.std(0, ddof=1) / np.sqrt(len(residual)))
    # Student's t to a normal score
    return tuple(float(z) for z in stats.norm.ppf(stats.t.cdf(t, len(residual) - 1)))


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
