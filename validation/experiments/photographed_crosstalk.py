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
from functools import partial

import numpy as np

from testing.screens import LARGE, SMALL, Screen, screen
from validation.experiment import Column, Finding, Table, Work, at_least, at_most, between

QUICK, FULL = 3, 40
"""Screens."""
WRONG = (0.0, 0.25, 0.5, 1.0)
"""Standard deviations of a corner's coordinates, pixels."""
WAYS = {
    "exact": "taken as exact",
    "stated": "error stated",
    "edges": "found by edges",
}


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
