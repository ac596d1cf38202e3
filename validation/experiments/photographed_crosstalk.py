"""Crosstalk maps of photographs know how sure they are, though the screen's corners are read off.

Rationale
    `domesim measure crosstalk` finds where on the screen each pixel is by the screen's corners,
    which a person reads off a photograph, to half a pixel or so. A map that is laid a little beside
    the screen is off by its slope, the more so the less noise there is to hide it. Here random
    screens are photographed askew, on a dim wall, through a lens that blurs; corners are then read
    off wrongly, by normal numbers. The picture's edges on the wall tell where it ends; where they
    cannot be seen, the error that is stated must do.
Expected
    With corners found by edges, and with their error stated, 90 to 98 % of the 95 % intervals of
    all cells hold the truth, whether corners were read off exactly or wrongly by 0.25, 0.5 or 1
    pixel (standard deviation; quick: 85 to 99 %). Taken as exact, corners that are wrong by a pixel
    leave less than 75 %. Corners found by edges are right within 0.1 pixel (rms), and within 1.5 of
    their stated errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from domesim.measure.crosstalk_photographs import crosstalk_maps
from domesim.measure.photographs import Corners, Glass, Photographs, by_edges
from domesim.observation.uncertain import SIGMAS
from domesim.readings.meter import EYES
from validation.experiment import Column, Finding, Table, Work, at_least, at_most, between

Floats = NDArray[np.float64]

QUICK, FULL = 3, 40
"""Screens."""
WRONG = (0.0, 0.25, 0.5, 1.0)
"""Standard deviations of a corner's coordinates, pixels."""
CELLS = (9, 15)
"""Rows and columns of maps, as the command has them."""
SMALL, LARGE = (96, 180), (160, 300)
"""Photographs, pixels."""
READ_OUT, PHOTONS = 1.2e-4, 4e-6
"""Variance of a pixel is READ_OUT² + PHOTONS x light: 0.3 % of white, 3 % of its ghost; the mean of
some ten photographs of an ordinary camera."""
BLUR = 0.7
"""Standard deviation of the lens's blur, pixels."""
WALL = 0.01
"""Light of the wall around the screen, of white."""
LEAK, DARK = 0.015, 0.005
"""Mean crosstalk, and black, of white."""
_FINER = 4
WAYS = {
    "exact": "taken as exact",
    "stated": "error stated",
    "edges": "found by edges",
}


@final
@dataclass(frozen=True)
class Screen:
    """One screen, its corners read off with one error.

    Attributes
    ----------
    held
        Way -> share of cells of both eyes' maps whose 95 % interval holds the truth.
    off
        Way -> rms relative error of the cells.
    corners_off, corners_z
        Rms error of corners found by edges, in pixels, and in standard errors; NaN if not found.
    """

    held: dict[str, float]
    off: dict[str, float]
    corners_off: float
    corners_z: float


def photographed(
    rng: np.random.Generator, size: tuple[int, int]
) -> tuple[tuple[Glass, Glass], Corners, Floats]:
    """Photographs of a random screen, its corners, and (eye, row, col) the crosstalk of its cells.

    Crosstalk varies as on the paper's screens (1.1 % to 2.0 %).
    """
    rows, cols = size
    inset = np.array([(0.08, 0.1), (0.92, 0.1), (0.92, 0.9), (0.08, 0.9)]) * (cols, rows)
    askew = rng.uniform(-0.04, 0.04, (4, 2)) * rows
    corners = Corners(inset + askew, np.zeros((8, 8)), "as they are")
    finer = Corners(corners.at * _FINER, np.zeros((8, 8)), "as they are")
    grid = np.meshgrid(*(np.arange(count * _FINER) + 0.5 for count in (cols, rows)))
    place = finer.places(grid[0], grid[1])
    on = _covered(place)
    x, y = place[..., 0] - 0.5, place[..., 1] - 0.5
    falling = 1 - 0.4 * (4 * x**2 + 2 * y**2) / 1.5 - 0.2 * x
    finely = [(np.arange(10 * count) + 0.5) / (10 * count) - 0.5 for count in CELLS]
    middle = np.meshgrid(finely[1], finely[0])
    glasses, truth = [], []
    for eye in EYES:
        a = rng.normal(0, (0.2, 0.2, 0.6, 0.6, 0.3))

        def map_(x: Floats, y: Floats, a: Floats = a) -> Floats:
            bent = a[0] * x + a[1] * y + a[2] * x**2 + a[3] * y**2 + a[4] * x * y
            return np.asarray(LEAK * np.exp(bent))

        own = _in_pixels(WALL + on * (falling - WALL))
        other = _in_pixels(LEAK * WALL + on * (falling * map_(x, y) - LEAK * WALL))
        black = _noisy(rng, np.zeros(size))
        shown = {eye: own, EYES[1 - EYES.index(eye)]: other}
        net = {name: {"W": _noisy(rng, light) - black} for name, light in shown.items()}
        glasses.append(Glass(eye, net))
        cells = map_(middle[0], middle[1]).reshape(CELLS[0], 10, CELLS[1], 10)
        truth.append(cells.mean(axis=(1, 3)))
    return (glasses[0], glasses[1]), corners, np.array(truth)


def _covered(place: Floats) -> Floats:
    """(row, col) share of a pixel that is on the screen."""
    ends = [part for axis in (place[..., 0], place[..., 1]) for part in (axis, 1 - axis)]
    away = [end / np.hypot(*np.gradient(end)) for end in ends]
    return np.asarray(np.prod([np.clip(each + 0.5, 0, 1) for each in away], axis=0))


def _in_pixels(light: Floats) -> Floats:
    """Through the lens, on a sensor."""
    rows, cols = (count // _FINER for count in light.shape)
    blurred = gaussian_filter(light, BLUR * _FINER, mode="nearest")
    return np.asarray(blurred.reshape(rows, _FINER, cols, _FINER).mean(axis=(1, 3)))


def _noisy(rng: np.random.Generator, light: Floats) -> NDArray[np.float32]:
    seen = (light + DARK)[..., None] * np.array([0.45, 0.5, 0.35])
    spread = np.sqrt(READ_OUT**2 + PHOTONS * seen)
    return np.asarray(seen + spread * rng.standard_normal(seen.shape), np.float32)


def screen(seed: int, wrong: float, size: tuple[int, int]) -> Screen:
    """Photograph a screen, read its corners off with an error, and measure."""
    rng = np.random.default_rng(seed)
    glasses, corners, truth = photographed(rng, size)
    read = corners.at + wrong * rng.standard_normal((4, 2))
    ways = {
        "exact": Corners(read, np.zeros((8, 8)), "read off"),
        "stated": Corners(read, wrong**2 * np.eye(8), "read off"),
    }
    ways["edges"] = found = by_edges(glasses, replace(ways["exact"], origin="not found"))
    off = (found.at - corners.at).ravel()
    seen = found.origin != "not found"
    held, errors = {}, {}
    for way, placed in ways.items():
        values, spread = _measured(glasses, placed, size)
        held[way] = float(np.mean(np.abs(values - truth) < SIGMAS * spread))
        errors[way] = float(np.sqrt(np.mean((values / truth - 1) ** 2)))
    return Screen(
        held,
        errors,
        float(np.sqrt(np.mean(off**2))) if seen else np.nan,
        float(np.sqrt(np.mean(off**2 / np.diag(found.covariance)))) if seen else np.nan,
    )


def _measured(
    glasses: tuple[Glass, Glass], corners: Corners, size: tuple[int, int]
) -> tuple[Floats, Floats]:
    """(eye, row, col) crosstalk as it is found, and standard errors."""
    rows, cols = size
    place = corners.places(*np.meshgrid(np.arange(cols) + 0.5, np.arange(rows) + 0.5))
    shots = Photographs("screen", glasses, place, corners, 15.0, 0.01, None, "")
    maps = crosstalk_maps(shots, CELLS, cols / rows)
    values = [each.system * each.share for each in maps]
    errors = [each.system * each.share_error for each in maps]
    return np.array(values), np.array(errors)


def run(work: Work) -> Finding:
    """Measure screens, for each error of their corners."""
    count, size = (QUICK, SMALL) if work.quick else (FULL, LARGE)
    found = {
        wrong: [
            work.step(
                f"{wrong} px, screen {number}",
                Screen,
                partial(screen, 1000 * work.seed + number, wrong, size),
            )
            for number in range(count)
        ]
        for wrong in WRONG
    }
    held = {(way, wrong): _mean(found[wrong], "held", way) for way in WAYS for wrong in WRONG}
    seen = np.array([(one.corners_off, one.corners_z) for each in found.values() for one in each])
    corners_off, corners_z = (float(np.sqrt(np.mean(part**2))) for part in seen.T)
    low, high = (0.85, 0.99) if work.quick else (0.9, 0.98)
    return Finding(
        result=(
            f"{count} random screens of {size[1]} x {size[0]} pixels. With corners that were read "
            f"off wrongly by a pixel, {held['exact', 1.0]:.0%} of the cells' 95 % intervals held "
            f"the truth if corners were taken as exact (half a pixel: {held['exact', 0.5]:.0%}), "
            f"{held['stated', 1.0]:.0%} with their error stated, and {held['edges', 1.0]:.0%} with "
            f"corners found by the picture's edges, which are right within {corners_off:.3f} "
            f"pixels (rms)."
        ),
        advice="Photograph the screen with some of its dark surroundings, so that its edges tell "
        "the corners; else state `corners_error`.",
        checks=(
            *(
                between(f"{WAYS[way]}, corners off by {wrong} px: intervals that hold the truth",
                        held[way, wrong], low, high)
                for way in ("stated", "edges")
                for wrong in WRONG
            ),
            at_most("taken as exact, corners off by 1 px: intervals that hold the truth",
                    held["exact", 1.0], 0.85 if work.quick else 0.75),
            at_most("corners found by edges: rms error", corners_off, 0.1, "px"),
            at_most("corners found by edges: rms error over the stated one", corners_z, 1.5),
            at_least("share of screens whose corners were found",
                     float(np.mean(np.isfinite(seen[:, 0]))), 1.0),
        ),
        tables=(_table(found, held),),
        figures={
            f"held.{way}.{wrong:g}": share for (way, wrong), share in held.items()
        } | {"corners_rms_px": corners_off},
    )  # fmt: skip


def _mean(screens: Sequence[Screen], what: str, way: str) -> float:
    return float(np.mean([getattr(one, what)[way] for one in screens]))


def _table(found: dict[float, list[Screen]], held: dict[tuple[str, float], float]) -> Table:
    return Table(
        caption=(
            "Cells whose 95 % interval holds the truth, and (rms error of cells), in %, by how "
            "corners that were read off wrongly are used."
        ),
        columns=(
            Column(name="corners off by", unit="px"),
            *(
                column
                for told in WAYS.values()
                for column in (
                    Column(name=told, unit="%", digits=".1f"),
                    Column(name=f"rms error, {told}", unit="%", digits=".2f"),
                )
            ),
        ),
        rows=tuple(
            (
                wrong,
                *(
                    cell
                    for way in WAYS
                    for cell in (100 * held[way, wrong], 100 * _mean(found[wrong], "off", way))
                ),
            )
            for wrong in WRONG
        ),
    )
