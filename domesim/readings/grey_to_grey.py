"""Grey-to-grey crosstalk from readings of several levels of both eyes' pictures.

Where a display's leak depends on the own picture too (liquid crystals that still turn when the
shutter opens), one figure is not enough. Columns of the file (CSV or TOML):

    filter        left, right   the eye that sees
    own_level     0..1          code value of its own picture
    other_level   0..1          code value of the other eye's picture
    Y             cd/m²         luminance through the filter
    note                        anything

All combinations of the levels are needed, black (0) and white (1) among them.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from domesim.light.ties import ascending
from domesim.readings.meter import BRIGHTEST, CONFLICT, CONFLICT_FLOOR, EYES, NOT_LIGHT
from domesim.readings.tables import Mistakes, read_table

Floats = NDArray[np.float64]

CLOSEST = 1e-5
"""Least distance of levels in light, white = 1: closer levels of both eyes are one; float32 has no
slopes between them."""


@final
@dataclass(frozen=True, eq=False)
class MeasuredGreyToGrey:
    """Light that leaks to one eye, for each pair of levels.

    Parameters
    ----------
    eye
        The eye that sees.
    own_levels, other_levels
        (own,) and (other,) code values, rising from 0 to 1.
    light
        (own,) linear light of the own picture while the other one is black, 1.0 = white.
    extra
        (own, other) light that the other picture adds, in units of white: the entry (0, 1) is the
        system crosstalk. Liquid crystals have negative ones too.
    black
        Luminance of two black pictures, cd/m².
    white
        Luminance that a white picture adds to that while the other one is black, cd/m².
    """

    eye: str
    own_levels: Floats
    other_levels: Floats
    light: Floats
    extra: Floats
    black: float
    white: float

    @property
    def system(self) -> float:
        """(L_KW - L_KK)/(L_WK - L_KK), see ``crosstalk``."""
        return float(self.extra[0, -1])

    def report(self) -> list[str]:
        """Lines for a person."""
        i, j = np.unravel_index(ascending(-np.abs(self.extra.ravel()))[0], self.extra.shape)
        return [
            f"grey-to-grey crosstalk to the {self.eye} eye: system {self.system:.2%}; largest "
            f"{self.extra[i, j]:+.2%} of white, own level {self.own_levels[i]:g}, other level "
            f"{self.other_levels[j]:g}"
        ]


def read_grey_to_grey(path: str | Path) -> dict[str, MeasuredGreyToGrey]:
    """The tables of a file, by eye.

    Raises
    ------
    InputError
        If the file cannot be read, or with all its mistakes: cells that are no numbers, missing
        or contradictory combinations, a picture that does not get brighter with its level.
    """
    table = read_table(path)
    mistakes = table.mistakes
    wanted = ("filter", "own_level", "other_level", "Y")
    table.require((*wanted, "note"), wanted)
    remedy = "divide codes by the largest, 2^bits - 1"
    readings: dict[str, dict[tuple[float, float], list[tuple[float, int]]]] = defaultdict(
        lambda: defaultdict(list)
    )
    for row in table.filled(("Y",)):
        eye = table.word(row, "filter", EYES)
        own = table.number(row, "own_level", above=0, below=1, remedy=remedy)
        other = table.number(row, "other_level", above=0, below=1, remedy=remedy)
        light = table.number(row, "Y", above=0, below=BRIGHTEST, remedy=NOT_LIGHT)
        if eye is not None and own is not None and other is not None and light is not None:
            readings[eye][own, other].append((light, row.line))
    if not table.rows:
        mistakes.add(0, "wanted rows of readings, got none")
    mistakes.raise_any()
    tables = {eye: _table(eye, cells, mistakes) for eye, cells in readings.items()}
    mistakes.raise_any()
    return {eye: measured for eye, measured in tables.items() if measured is not None}


def in_light(left: MeasuredGreyToGrey, right: MeasuredGreyToGrey) -> tuple[Floats, Floats]:
    """Both eyes' tables over light instead of code values, as models take them.

    The other picture's light is that which its own eye was measured to see at that code value.

    Parameters
    ----------
    left, right
        The tables of both eyes.

    Returns
    -------
    levels, extra
        (level,) light rising from 0 to 1, and (view, own level, other level) light that the other
        picture adds, in units of white; bilinear between what was measured.
    """
    grids = []
    for seen, other in ((left, right), (right, left)):
        roots = np.interp(seen.other_levels, other.own_levels, other.light ** (1 / 2.2))
        grids.append((seen.light, roots**2.2))
    ends = np.array([0.0, 1.0])
    levels = np.unique(np.concatenate([ends, *(axis for grid in grids for axis in grid)]).round(9))
    apart = np.append(np.diff(levels) > CLOSEST, True)
    apart[0] = True
    levels = levels[apart]
    points = np.stack(np.meshgrid(levels, levels, indexing="ij"), axis=-1)
    extra = [
        RegularGridInterpolator(grid, table.extra, bounds_error=False, fill_value=None)(points)
        for grid, table in zip(grids, (left, right), strict=True)
    ]
    return levels, np.stack(extra)


def _table(
    eye: str, cells: dict[tuple[float, float], list[tuple[float, int]]], mistakes: Mistakes
) -> MeasuredGreyToGrey | None:
    own = np.unique([pair[0] for pair in cells])
    other = np.unique([pair[1] for pair in cells])
    before = len(mistakes.found)
    for name, levels in (("own_level", own), ("other_level", other)):
        if levels[0] != 0 or levels[-1] != 1:
            mistakes.add(0, f"{eye} filter: {name} must go from 0 to 1, got {levels.tolist()}")
    for pair in ((float(a), float(b)) for a in own for b in other):
        if pair not in cells:
            mistakes.add(
                0, f"{eye} filter: no reading of own_level {pair[0]:g}, other_level {pair[1]:g}"
            )
            continue
        (first, line), *others = cells[pair]
        for light, again in others:
            if abs(light - first) > max(CONFLICT * max(light, first), CONFLICT_FLOOR):
                mistakes.add(again, f"must repeat line {line}, got Y {light:g} after {first:g}")
    if len(mistakes.found) > before:
        return None
    seen = np.array([[np.mean([y for y, _ in cells[a, b]]) for b in other] for a in own])
    falls = np.flatnonzero(np.diff(seen[:, 0]) <= 0)
    for i in falls:
        line = cells[float(own[i + 1]), float(other[0])][0][1]
        mistakes.add(
            line,
            f"{eye} filter: light must rise with own_level while the other picture is black, got "
            f"{seen[i, 0]:g} then {seen[i + 1, 0]:g}; is a row wrong or exchanged?",
        )
    if len(falls):
        return None
    white = seen[-1, 0] - seen[0, 0]
    return MeasuredGreyToGrey(
        eye=eye,
        own_levels=own,
        other_levels=other,
        light=(seen[:, 0] - seen[0, 0]) / white,
        extra=(seen - seen[:, :1]) / white,
        black=float(seen[0, 0]),
        white=float(white),
    )
