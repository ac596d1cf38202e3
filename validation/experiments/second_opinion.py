"""The bounce loop and Mitsuba's own ``path`` integrator agree where no formula helps.

Rationale
    Our loop meets analytic quadrics, Mitsuba's integrator meets its own shapes and samples emitters
    (`domesim.pathtrace.reference`); only meshes and the lobe's BSDF are Mitsuba's in both. One
    lens, tilted and off the centre, uneven picture, floor, wall, seats with people, and a screen
    with a gain lobe: nobody knows the answer.
Expected
    The picture's mean light equal within three of its standard errors and 6e-4, and pixels'
    differences as their standard errors say. The 6e-4 are the reference's: in the bare dome, which
    has a closed form, ours is off by 1e-5 and Mitsuba's by 4e-4 (its rays start a little above the
    surface, in float32).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from domesim.dome import Dome
from domesim.furniture import seating
from domesim.observation.spherical import ClosedFormDome
from domesim.pathtrace.observation import PathTracedDome
from domesim.pathtrace.reference import path_traced
from domesim.pathtrace.tracer import Settings, Tracer
from domesim.theatre import Floor, Lens, Lobe, Theatre, Wall

DOME = Dome(5.0, np.pi / 2, np.radians(15))
LENS = Lens("lens", (0.6, -0.8, 0.5), (0.0, 1.0, 4.0), field=2 * np.pi)
FLOOR, WALL = Floor(-2.5, 5.0, (0.2, 0.25, 0.3)), Wall(5.0, -2.5, -1.3, (0.1, 0.1, 0.1))
RUNS = 4


def theatres() -> Mapping[str, Theatre]:
    """From the bare dome to one with everything."""
    seats, _ = seating(
        floor_height=-2.5, rows=4, seats_per_row=6, first_row=2.0, row_spacing=1.1,
        seat_spacing=0.7, rise=0.1, within=5.0, albedo=(0.3, 0.3, 0.3), occupied=0.5,
        audience_albedo=(0.4, 0.3, 0.2), seed=1, look_at=(0.0, 4.0, 3.0),
    )  # fmt: skip
    bare = Theatre(DOME, (0.5, 0.4, 0.6), lenses=(LENS,), corrected=False)
    room = Theatre(DOME, (0.5, 0.4, 0.6), lenses=(LENS,), corrected=False, floor=FLOOR, wall=WALL)
    full = Theatre(
        DOME, (0.5, 0.4, 0.6), lenses=(LENS,), corrected=False, floor=FLOOR, wall=WALL,
        solids=tuple(seats),
    )  # fmt: skip
    glossy = Theatre(
        DOME, (0.5, 0.4, 0.6), lenses=(LENS,), corrected=False, floor=FLOOR, wall=WALL,
        solids=tuple(seats), lobe=Lobe(0.3, 0.3),
    )  # fmt: skip
    return {"bare": bare, "floor and wall": room, "seats": full, "seats and lobe": glossy}


@dataclass(frozen=True)
class Agreement:
    """Two opinions on one theatre, of the mean light of the picture's middle, each primary.

    Attributes
    ----------
    off_by
        Ours over Mitsuba's, less 1.
    error
        Standard error of `off_by`.
    spread
        Rms over pixels of their differences in standard errors: about 1.
    known
        Ours and Mitsuba's over the closed form, less 1; None where it does not hold.
    """

    off_by: NDArray[np.float64]
    error: NDArray[np.float64]
    spread: float
    known: tuple[NDArray[np.float64], NDArray[np.float64]] | None


def measure(
    theatre: Theatre, *, size: int = 64, samples: int = 1024, error: float = 0.02
) -> Agreement:
    """Trace a theatre with both.

    Parameters
    ----------
    theatre
        One of `theatres`.
    size
        Pixels a side.
    samples
        Mitsuba's, a pixel, `RUNS` times.
    error
        Ours: relative standard error of a pixel.
    """
    shown = picture(size)
    reference = np.stack([path_traced(theatre, shown, size, samples=samples, seed=run)
                          for run in range(RUNS)])  # fmt: skip
    dome = PathTracedDome(theatre, size, size, Settings(error=error))
    seen = dome.trace(shown[None])
    place = (np.arange(size) + 0.5) * (2 / size) - 1
    middle = (
        np.hypot(place[:, None], place) < 0.93
    )  # both know pixels that the rim cuts differently
    share = theatre.dome.screen_areas(size, size) * middle
    share = share / share.sum()
    means = np.einsum("ij,nijp->np", share, reference)
    theirs, ours = means.mean(0), np.einsum("ij,ijp->p", share, seen.mean[0].astype(np.float64))
    own = np.sqrt(np.einsum("ij,ijp->p", share**2, seen.standard_error[0].astype(np.float64) ** 2))
    both = np.hypot(means.std(0, ddof=1) / np.sqrt(RUNS), own)
    known = None
    if not theatre.departures():
        gain = Tracer(theatre).gains(size, size).sum(0)
        closed = ClosedFormDome(theatre.dome, size, size, albedo=theatre.albedo, lens_gain=gain)
        truth = np.einsum("ij,ijp->p", share, closed.observe(shown[None].astype(np.float64))[0])
        known = ours / truth - 1, theirs / truth - 1
    pixel = np.hypot(reference.std(0, ddof=1) / np.sqrt(RUNS), seen.standard_error[0])
    z = ((seen.mean[0] - reference.mean(0)) / np.maximum(pixel, 1e-12))[middle]
    # A spread of four runs is wide: the rms of Student's t is sqrt(3) for three degrees of freedom.
    return Agreement(ours / theirs - 1, both / theirs, float(np.sqrt(np.mean(z**2))), known)


def picture(size: int) -> NDArray[np.float32]:
    """(row, col, primary) coloured, brighter to the front, with an edge."""
    place = (np.arange(size) + 0.5) * (2 / size) - 1
    front = np.clip(place[:, None, None], 0, 1) * np.array([1.0, 0.5, 0.2])
    return np.asarray(0.2 + front + 0.3 * (place[None, :, None] > 0.3), np.float32)


if __name__ == "__main__":
    for name, theatre in theatres().items():
        found = measure(theatre)
        print(
            f"{name}: ours over Mitsuba's - 1: "
            + ", ".join(
                f"{a:+.1e} ± {e:.0e}" for a, e in zip(found.off_by, found.error, strict=True)
            )
            + f"; pixels' z rms {found.spread:.2f}"
            + (
                ""
                if found.known is None
                else f"; closed form: ours {found.known[0].mean():+.1e}, "
                f"Mitsuba's {found.known[1].mean():+.1e}"
            ),
            flush=True,
        )
