"""One gamut that two projectors share, so that both eyes see the same colours.

The idea is that of Stone, Cowan and Beatty (*Color gamut mapping and the printing of digital color
images*, ACM Transactions on Graphics 7, 249, 1988), which the paper cites: where devices differ,
show what all of them can. The construction here is this project's:

1. A colour is shown by both projectors if its chromaticity lies in both triangles. Their
   intersection is a convex polygon of at most six corners; the common primaries are the three
   corners that span the largest area in CIE 1976 u'v' (the largest triangle inside a convex polygon
   has its corners at corners of the polygon).
2. The common white is the brightest light that both reach of all mixtures of their two whites (a
   linear program), or of the chromaticity that is asked for.
3. Primaries P (XYZ, RGB) of these chromaticities that add up to this white, P 1 = w, fix a matrix
   for each projector, T = M^-1 P.

T has no negative entries, for P's columns are within M's triangle, and rows that sum to at most 1,
for T 1 = M^-1 w is within its cube: common RGB in 0..1 stays within 0..1, and no other light of
these chromaticities and of this white's could be brighter.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, permutations
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linprog

from domesim.errors import InputError
from domesim.host.numbers import decimal
from domesim.readings.response import uv

Floats = NDArray[np.float64]

_ROUNDING = 1e-9
_SMALLEST = 1e-4
"""Area of a triangle in u'v' below which there is no gamut; BT.709's is 0.065."""


@final
@dataclass(frozen=True, eq=False)
class CommonGamut:
    """What two projectors can both show.

    Parameters
    ----------
    primaries
        (XYZ, RGB) P of the common gamut, cd/m², black not included.
    matrices
        (projector, own primary, common primary) T: common linear RGB -> the projector's own.
    whites
        (projector,) luminance of the projectors' own whites, cd/m², for comparison.
    blacks
        (projector,) luminance of their blacks, cd/m²; NaN where not read.
    """

    primaries: Floats
    matrices: Floats
    whites: Floats
    blacks: Floats

    @property
    def white(self) -> Floats:
        """(XYZ,) of common white, cd/m²."""
        return np.asarray(self.primaries.sum(axis=1))

    @property
    def chromaticities(self) -> Floats:
        """(RGBW, xy) CIE 1931."""
        colours = np.vstack([self.primaries.T, self.white])
        return np.asarray(colours[:, :2] / colours.sum(axis=1, keepdims=True))

    @property
    def lost(self) -> Floats:
        """Share of its white's luminance that a projector gives up: (projector,)."""
        return np.asarray(np.maximum(1 - self.white[1] / self.whites, 0))

    def report(self) -> list[str]:
        """Lines for a person."""
        places = zip("RGBW", self.chromaticities, strict=True)
        told_places = ", ".join(f"{n} {x:.4f} {y:.4f}" for n, (x, y) in places)
        lines = [
            f"common gamut: white {decimal(self.white[1], 4)} cd/m²; luminance lost: left "
            f"{self.lost[0]:.1%}, right {self.lost[1]:.1%}",
            f"  chromaticities xy: {told_places}",
        ]
        left, right = self.blacks
        if np.isfinite(self.blacks).all():
            lines.append(
                f"  black stays as it is: left {decimal(left)}, right {decimal(right)} cd/m² "
                f"({left / self.white[1]:.2%} and {right / self.white[1]:.2%} of common white)"
            )
        return lines


def common_gamut(
    left: ArrayLike,
    right: ArrayLike,
    *,
    white: tuple[float, float] | None = None,
    blacks: tuple[float, float] = (np.nan, np.nan),
) -> CommonGamut:
    """The common gamut of two projectors.

    Parameters
    ----------
    left, right
        (XYZ, RGB) primaries at full light without black, cd/m².
    white
        xy chromaticity of common white; if None, the brightest between the projectors' whites.
    blacks
        Luminance of their blacks, cd/m²; matrices do not change it.

    Raises
    ------
    InputError
        If the projectors share no colours, or not this white.
    ValueError
        If shapes disagree.
    """
    own = np.stack([np.asarray(left, np.float64), np.asarray(right, np.float64)])
    if own.shape != (2, 3, 3):
        raise ValueError(f"common_gamut takes primaries (3, 3) twice, got {own.shape[1:]}")
    inverses = np.asarray(np.linalg.inv(own), np.float64)
    mixed = own.sum(axis=2).T if white is None else _light_of(white)[:, None]
    common_white = _brightest(inverses, mixed)
    corners = intersection(triangle(own[0]), triangle(own[1]))
    chosen = _largest_triangle(corners, uv(common_white))
    directions = _xyz_of(chosen[_order(chosen, own)])
    gains = np.linalg.solve(directions, common_white)
    matrices = inverses @ (directions * gains)
    # Corners on an edge, and a white on a face, leave rounding errors beyond the cube.
    matrices = np.maximum(matrices, 0)
    matrices /= np.maximum(matrices.sum(axis=2).max(), 1)
    return CommonGamut(directions * gains, matrices, own.sum(axis=2)[:, 1], np.array(blacks))


def _light_of(xy: tuple[float, float]) -> Floats:
    x, y = xy
    if not (x >= 0 and y > 0 and x + y <= 1):
        raise InputError(
            f"common white must have a chromaticity with x >= 0, y > 0, x + y <= 1, "
            f"got ({x:g}, {y:g})"
        )
    return np.array([x / y, 1, (1 - x - y) / y])


def _brightest(inverses: Floats, mixed: Floats) -> Floats:
    """(XYZ,) the brightest sum of the lights (XYZ, light) in `mixed` within both cubes."""
    shown = np.concatenate([inverse @ mixed for inverse in inverses])
    scale = np.abs(shown).max()
    limits = np.concatenate([shown, -shown]) / scale
    ends = np.concatenate([np.ones(6), np.zeros(6)])
    solution = linprog(-mixed[1] / mixed[1].max(), A_ub=limits, b_ub=ends, method="highs")
    light = np.zeros(3) if solution.x is None else mixed @ solution.x / scale
    if not light[1] > _ROUNDING * mixed[1].max():
        raise InputError(
            "common gamut: both projectors must be able to show the same white, got none; give "
            "another white, or check which readings are whose"
        )
    return np.asarray(light)


def triangle(primaries: Floats) -> Floats:
    """(3, u'v') corners, counter-clockwise."""
    corners = uv(primaries.T)
    return corners if area_of(corners) > 0 else corners[::-1]


def area_of(corners: Floats) -> float:
    """Area of a polygon (corner, 2); below 0 if it is clockwise, 0 of none."""
    if len(corners) < 3:
        return 0.0
    x, y = (corners - corners[0]).T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2


def intersection(subject: Floats, clip: Floats) -> Floats:
    """(corner, 2) of two convex polygons, counter-clockwise (Sutherland and Hodgman 1974)."""
    for start, end in zip(clip, np.roll(clip, -1, axis=0), strict=True):
        along = end - start
        # Distance from the edge, positive inside
        inside = (along[0] * (subject[:, 1] - start[1]) - along[1] * (subject[:, 0] - start[0])) / (
            np.linalg.norm(along)
        )
        inside[np.abs(inside) < _ROUNDING] = 0
        kept: list[Floats] = []
        for i in range(len(subject)):
            j = (i + 1) % len(subject)
            if inside[i] >= 0:
                kept.append(subject[i])
            if inside[i] * inside[j] < 0:
                part = inside[i] / (inside[i] - inside[j])
                kept.append(subject[i] + part * (subject[j] - subject[i]))
        subject = np.array(kept).reshape(-1, 2)
    return subject


def _largest_triangle(corners: Floats, white: Floats) -> Floats:
    """(3, u'v') the largest triangle of corners that holds the white; of equal ones the first."""
    best, largest = None, _SMALLEST
    for triple in combinations(range(len(corners)), 3):
        triangle = corners[list(triple)]
        if area_of(triangle) > largest + _ROUNDING and _holds(triangle, white):
            best, largest = triangle, area_of(triangle)
    if best is None:
        raise InputError(
            "common gamut: the projectors must share a triangle of colours round their white, got "
            "none; check which readings are whose, or give another white"
        )
    return best


def _holds(triangle: Floats, point: Floats) -> bool:
    sides = [np.stack([triangle[i], triangle[(i + 1) % 3], point]) for i in range(3)]
    return all(area_of(side) > 0 for side in sides)


def _order(corners: Floats, own: Floats) -> list[int]:
    """Which corner is R, G and B: nearest to the projectors' own.

    Corners are as far apart as colours: no two orders are equally near.
    """
    wanted = (uv(own[0].T) + uv(own[1].T)) / 2
    orders = (list(order) for order in permutations(range(3)))
    return min(orders, key=lambda order: float(np.sum((corners[order] - wanted) ** 2)))


def _xyz_of(chromaticities: Floats) -> Floats:
    """(XYZ, primary) directions of (primary, u'v')."""
    u, v = chromaticities.T
    return np.stack([9 * u, 4 * v, 12 - 3 * u - 20 * v])
