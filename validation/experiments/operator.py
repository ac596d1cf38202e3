"""Tabulated transport is what brute-force path tracing finds, at a fraction of its cost.

Rationale
    Indirect light is smooth on the screen, so a few patterns carry it (design section 3). Walks
    that know the closed form only have to find what the room changes.
Expected
    Against path-traced pictures of the same theatre, rms over the screen relative to the mean
    indirect light: of white within 1e-3 for a recessed floor of albedo 0.2 after some ten
    CPU-seconds, 5e-4 after forty; within 5e-3 for a floor at the spring line and for a gain lobe of
    share 0.3, also of a lit front, a lit rim and a small patch.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from domesim.dome import Dome
from domesim.pathtrace.tabulate import tabulate
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.theatre import Floor, Lobe, Theatre, Wall
from validation.statistics import rms_difference

DOME = Dome(5.0, np.pi / 2)
THEATRES: Mapping[str, Theatre] = {
    "recessed floor": Theatre(
        DOME,
        (0.5, 0.5, 0.5),
        floor=Floor(-1.5, 5.0, (0.2, 0.2, 0.2)),
        wall=Wall(5.0, -1.5, 0.0, (0.1, 0.1, 0.1)),
    ),
    "floor at the spring line": Theatre(
        DOME, (0.5, 0.5, 0.5), floor=Floor(0.0, 5.0, (0.2, 0.2, 0.2))
    ),
    "gain lobe of share 0.3": Theatre(DOME, (0.5, 0.5, 0.5), lobe=Lobe(0.3, 0.3)),
}


@dataclass(frozen=True)
class Comparison:
    """A picture's indirect light by the operator and by brute force.

    Attributes
    ----------
    picture
        Its name.
    mean
        Mean indirect light, mean direct light of white = 1.
    rms
        Rms error of the operator relative to `mean`; negative if the noise outweighs it.
    noise
        What `rms` would be by the brute force's noise alone, at most (two standard errors).
    cpu_s
        Of the brute force, s.
    """

    picture: str
    mean: float
    rms: float
    noise: float
    cpu_s: float


@dataclass(frozen=True)
class Outcome:
    """One theatre's operator and what it is worth.

    Attributes
    ----------
    claimed
        The operator's own relative standard error.
    rank, cpu_s, walks
        Modes, CPU time (s) and walks that it took.
    comparisons
        With brute force.
    """

    claimed: float
    rank: int
    cpu_s: float
    walks: int
    comparisons: tuple[Comparison, ...]


def measure(
    name: str,
    *,
    error: float = 5e-4,
    brute_force: float = 0.004,
    size: int = 64,
    pictures: tuple[str, ...] = ("white", "front", "rim", "patch"),
) -> Outcome:
    """Tabulate a theatre and compare it with path-traced pictures.

    Parameters
    ----------
    name
        One of `THEATRES`.
    error
        Relative standard error that the operator is to reach.
    brute_force
        Relative standard error of each path-traced pixel.
    size
        Pixels a side of the pictures.
    pictures
        Which of `light`.
    """
    theatre = THEATRES[name]
    tracer = Tracer(theatre)
    found = tabulate(theatre, error=error, tracer=tracer)
    observation = found.transport.observation(size, size)
    areas = theatre.dome.screen_areas(size, size)
    share = areas / areas.sum()
    comparisons = []
    for picture in pictures:
        shown = light(picture, size)
        source = tracer.picture(shown)
        traced = [
            tracer.screen(source, size, size, Settings(error=brute_force, most=1 << 20, seed=seed))
            for seed in (1, 2)
        ]
        given = np.asarray(shown[None], np.float64)
        model = (observation.linear(given) - observation.direct(given))[0]
        first, second = (one.mean for one in traced)
        mean = float(np.einsum("ij,ijp->p", share, (first + second) / 2).mean())
        variance = np.prod([one.standard_error[..., 0].astype(np.float64) for one in traced], 0)
        noise = np.sqrt(2 * np.sqrt(np.sum((share * variance) ** 2)))
        comparisons.append(
            Comparison(
                picture,
                mean,
                rms_difference(model, first, second, share) / mean,
                float(noise / mean),
                sum(one.seconds for one in traced),
            )
        )
    return Outcome(
        found.transport.relative_error(),
        found.transport.rank,
        found.seconds,
        found.walks,
        tuple(comparisons),
    )


def light(picture: str, size: int) -> NDArray[np.float32]:
    """(row, col, primary) white, front, rim or patch."""
    place = (np.arange(size) + 0.5) * (2 / size) - 1
    u, v = place[None, :], place[:, None]
    shapes = {
        "white": np.ones((size, size)),
        "front": (v > 0.5) & (u < 2),
        "rim": np.hypot(u, v) > 0.85,
        "patch": (u - 0.5) ** 2 + (v - 0.3) ** 2 < 0.04,
    }
    return np.repeat(shapes[picture][..., None], 3, axis=2).astype(np.float32)


def report() -> Iterator[str]:
    """Lines for a person, as they come."""
    every = ("white", "front", "rim", "patch")
    for name, error, brute_force, pictures in (
        ("recessed floor", 5e-4, 0.004, every),
        ("recessed floor", 2.5e-4, 0.0015, ("white",)),
        ("floor at the spring line", 1e-3, 0.004, every),
        ("gain lobe of share 0.3", 1e-3, 0.02, every),
    ):
        outcome = measure(name, error=error, brute_force=brute_force, pictures=pictures)
        yield (
            f"{name}: claimed {outcome.claimed:.1e} in {outcome.cpu_s:.0f} CPU-s, "
            f"{outcome.walks / 1e6:.0f} M walks, rank {outcome.rank}"
        )
        for one in outcome.comparisons:
            yield (
                f"  {one.picture:6} mean {one.mean:.6f}, rms error {one.rms:+.1e} "
                f"(noise {one.noise:.0e}), brute force {one.cpu_s:.0f} CPU-s"
            )


if __name__ == "__main__":
    for line in report():
        print(line, flush=True)
