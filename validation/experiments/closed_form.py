"""The closed form is what path tracing finds in a bare Lambertian cap, bounce by bounce.

Rationale
    Between two points of a sphere the form factor is dA / (4 pi r²), whatever the two points
    (design section 3). So every bounce spreads light evenly and keeps g = rho A_s / (4 pi r²) of
    it; all of them together are a geometric series, g / (1 - g) of the mean direct light. The path
    tracer knows nothing of this: it meets the sphere by ray intersection.
Expected
    For a white picture and an uneven one, in every cell of half-angle x albedo: the mean indirect
    light within 1e-3 of the closed form, the ratio of successive bounces g, and z-scores that are
    standard normal: neither bias nor boasting.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from domesim.dome import Dome
from domesim.observation.spherical import bare_gain
from domesim.pathtrace.tracer import Settings, Traced, Tracer
from domesim.theatre import Theatre
from validation.statistics import FALSE_ALARM, assert_unbiased, calibration

HALF_ANGLES = tuple(range(30, 181, 15))
ALBEDOS = tuple(n / 10 for n in range(1, 10))
SIZE = 64
RUNS = 16
BOUNCES = 4
"""How many ratios of bounces are looked at."""


@dataclass(frozen=True)
class Cell:
    """One cap's indirect light, relative to the mean direct light.

    Attributes
    ----------
    half_angle, albedo
        Of the cap; the half-angle in degrees.
    truth, found, error
        By the closed form, by path tracing, and its standard error.
    ratio, ratio_z
        Expected ratio of the light of bounces k and k - 1, and what was found as z-scores.
    paths, cpu_s
        Walks, and CPU time, s.
    """

    half_angle: float
    albedo: float
    truth: float
    found: float
    error: float
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
    uneven: bool = False,
    seed: int = 0,
) -> Cell:
    """One cap, traced until the mean's relative standard error is about `error`.

    Parameters
    ----------
    half_angle, albedo
        Of the cap; the half-angle in degrees.
    error
        Relative standard error of the mean indirect light.
    uneven
        A picture of a bright patch beside the middle, instead of a white one.
    seed
        Of the random numbers.
    """
    dome = Dome(5.0, np.radians(half_angle))
    tracer = Tracer(Theatre(dome, (albedo, albedo, albedo)))
    picture = patch(SIZE) if uneven else np.ones((SIZE, SIZE, 3), np.float32)
    source = tracer.picture(picture)
    areas = dome.pixel_areas(SIZE, SIZE)
    direct = float(np.sum(picture[..., 0] * areas) / areas.sum())
    share = dome.screen_areas(SIZE, SIZE) / dome.screen_area
    pilot = _trace(tracer, source, 64, seed + RUNS)
    mean, reached = pilot.pooled_error(share)
    walks = max(16, round(64 * (reached / mean / error) ** 2 / RUNS))
    runs = [_trace(tracer, source, walks, seed + run) for run in range(RUNS)]
    pooled = np.array([run.pooled_error(share) for run in runs])
    keeps = albedo * dome.screen_area / (4 * np.pi * dome.radius**2)
    return Cell(
        half_angle,
        albedo,
        truth=bare_gain(albedo, dome),
        found=float(pooled[:, 0].mean()) / direct,
        error=float(np.sqrt(np.mean(pooled[:, 1] ** 2) / RUNS)) / direct,
        ratio=keeps,
        ratio_z=_ratio_scores(np.array([_bounces(run, share) for run in runs]), direct, keeps),
        paths=int(dome.inside(SIZE, SIZE).sum()) * walks * RUNS,
        cpu_s=sum(run.seconds for run in runs),
    )


def sweep(
    half_angles: Sequence[float] = HALF_ANGLES,
    albedos: Sequence[float] = ALBEDOS,
    *,
    error: float = 2.5e-4,
    uneven: bool = False,
) -> Iterator[Cell]:
    """All cells, one after the other."""
    cells = ((half_angle, albedo) for half_angle in half_angles for albedo in albedos)
    for number, (half_angle, albedo) in enumerate(cells):
        yield measure(half_angle, albedo, error=error, uneven=uneven, seed=100 * number)


def patch(size: int) -> NDArray[np.float32]:
    """(row, col, primary) a bright disc away from the rim, on black."""
    place = (np.arange(size) + 0.5) * (2 / size) - 1
    disc = (place[:, None] - 0.3) ** 2 + (place[None, :] + 0.4) ** 2 < 0.05
    return np.repeat(disc[..., None], 3, axis=2).astype(np.float32)


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

    Of the residual (bounce k) - expected (bounce k - 1), which is linear: its mean has no bias.
    """
    series = np.column_stack([np.full(len(bounces), direct), bounces])
    residual = series[:, 1:] - expected * series[:, :-1]
    t = residual.mean(0) / (residual.std(0, ddof=1) / np.sqrt(len(residual)))
    # Student's t to a normal score
    return tuple(float(z) for z in stats.norm.ppf(stats.t.cdf(t, len(residual) - 1)))


def line(cell: Cell) -> str:
    """A cell for a person; the interval is of 95 %."""
    return (
        f"{cell.half_angle:4.0f} deg rho {cell.albedo:.1f}: {cell.found:.6f} ± "
        f"{1.96 * cell.error:.6f}, closed form {cell.truth:.6f} ({cell.off_by:+.1e}, z "
        f"{cell.z:+.2f}); bounces keep {cell.ratio:.4f}, z "
        + " ".join(f"{z:+.1f}" for z in cell.ratio_z)
        + f"; {cell.paths / 1e6:.0f} M paths, {cell.cpu_s:.1f} CPU-s"
    )


def main() -> None:
    """Print all cells, and fail if something is not as expected."""
    print("to 1e-4, white: ", line(measure(90, 0.5, error=5e-5)), flush=True)
    print("to 2e-4, patch: ", line(measure(90, 0.5, error=1e-4, uneven=True)), flush=True)
    for uneven in (False, True):
        cells = []
        for cell in sweep(uneven=uneven):
            cells.append(cell)
            print("patch" if uneven else "white", line(cell), flush=True)
        worst = max(abs(cell.off_by) for cell in cells)
        means = calibration([cell.z for cell in cells])
        ratios = calibration([z for cell in cells for z in cell.ratio_z])
        print(
            f"worst cell {worst:.1e}; z-scores normal: p {means:.2f} (means), {ratios:.2f} "
            f"(ratios of bounces); {sum(cell.cpu_s for cell in cells):.0f} CPU-s"
        )
        found, error, truth = np.array([(c.found, c.error, c.truth) for c in cells]).T
        assert_unbiased(found, error, truth)
        if worst > 1e-3 or min(means, ratios) < FALSE_ALARM:
            raise SystemExit("not as expected")


if __name__ == "__main__":
    main()
