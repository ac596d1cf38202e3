"""Where a bright picture ends in a photograph: its corners, within a fraction of a pixel.

Near a side the light is that of a blurred step: with d the distance from where the side is said to
be, inwards, and s = -1..1 along it,

    light = outside + (a + polynomial of degree 2) Phi((d - x - y s - z (1 - s²)) / w)

fitted to all pixels there by least squares, the polynomial in s and d, w the blur's width and z how
far the side is bent. The corners are where neighbouring lines x + y s meet. What is between the
corners of a bent side is not where a perspective has it, so bends add to the corners' variance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

Floats = NDArray[np.float64]

REACH = 8.0
"""Distance from a side, pixels, within which light is looked at; corners may be off by half."""
BESIDES = 0.05
"""Standard error of corners, pixels, that noise does not tell: chosen, as lenses blur unevenly
and a picture whose last pixels are not like the others."""
_SHARE = 1 / 6
"""Largest `REACH`, as a share of the shortest side."""
_ENDS = 0.9
"""Share of each half of a side that is looked at; beyond, the neighbouring side is near."""
_LEAST_STEP = 5.0
"""Height of a step over its residuals (root mean square) from which it is one."""
_WIDEST_BLUR = 3.0
"""Widest blur of a side, pixels."""
_BLURRED, _LEAST_OUTSIDE = 2.0, 2.0
"""Distance from a side, pixels, within which light is blurred; and how many more of the
surroundings the photograph must have."""


class _Side(NamedTuple):
    line: Floats
    covariance: Floats
    bend: float


def found_corners(light: Floats, at: Floats) -> tuple[Floats, Floats] | None:
    """Corners (4, 2) and their covariance (8, 8), px²; None if an edge cannot be seen.

    Parameters
    ----------
    light
        (row, col) of a photograph whose picture is bright and whose surroundings are darker.
    at
        (4, 2) [col, row] of corners as they are stated, one beside the other and clockwise.
    """
    sides = []
    for start, end in zip(at, np.roll(at, -1, axis=0), strict=True):
        reach = min(REACH, _SHARE * float(np.linalg.norm(np.roll(at, -1, 0) - at, axis=1).min()))
        side = _side(light, start, end, reach)
        if side is None:
            return None
        sides.append(side)
    lines = np.concatenate([side.line for side in sides])
    covariance = np.zeros((8, 8))
    for number, side in enumerate(sides):
        mine = slice(2 * number, 2 * number + 2)
        covariance[mine, mine] = side.covariance
    steps = 1e-4 * np.eye(8)
    middle = _crossings(at, lines)
    slopes = np.array([(_crossings(at, lines + step) - middle).ravel() for step in steps]).T / 1e-4
    besides = (BESIDES**2 + np.mean([side.bend**2 for side in sides])) * np.eye(8)
    return middle, slopes @ covariance @ slopes.T + besides


def _side(light: Floats, start: Floats, end: Floats, reach: float) -> _Side | None:
    rows, cols = light.shape
    along, inward = _axes(start, end)
    across, down = np.meshgrid(np.arange(cols) + 0.5, np.arange(rows) + 0.5)
    away = np.stack([across, down], -1) - (start + end) / 2
    d, s = away @ inward, away @ along / (np.linalg.norm(end - start) / 2)
    near = (np.abs(d) < reach) & (np.abs(s) < _ENDS)
    d, s, seen = d[near], s[near], light[near]
    outside, inside = d < -_BLURRED, d > _BLURRED
    if outside.sum() < _LEAST_OUTSIDE * _ENDS * np.linalg.norm(end - start):
        return None
    low, high = float(seen[outside].mean()), float(seen[inside].mean())
    if not high > low:
        return None
    step = high - low

    def off(p: Floats) -> Floats:
        x, y, z, width, base = p[:5]
        blurred = ndtr((d - x - y * s - z * (1 - s**2)) / width)
        return np.asarray(base + (terms @ p[5:]) * blurred - target)

    out = d / reach
    terms = np.stack([np.ones_like(s), s, out, s**2, s * out, out**2], -1)
    target = (seen - low) / step
    first = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    free = np.full(len(first), np.inf)
    least, most = -free, free.copy()
    least[3], most[3] = 0.1, _WIDEST_BLUR
    solution = least_squares(off, first, bounds=(least, most))
    variance = 2 * solution.cost / max(1, len(seen) - len(first))
    height = solution.x[5]
    shift = abs(solution.x[0]) + abs(solution.x[1])
    if not solution.success or height < _LEAST_STEP * np.sqrt(variance) or shift > reach / 2:
        return None
    jacobian = np.asarray(solution.jac, np.float64)
    # Pixels on both sides of an edge tell all parameters: no singular value is lost in rounding
    spread = np.asarray(np.linalg.pinv(jacobian.T @ jacobian) * variance, np.float64)
    return _Side(solution.x[:2], spread[:2, :2], float(solution.x[2]))


def _crossings(at: Floats, lines: Floats) -> Floats:
    """(4, 2) where sides meet whose ends are moved inwards by x - y and x + y each."""
    moved = []
    for start, end, (x, y) in zip(at, np.roll(at, -1, axis=0), lines.reshape(4, 2), strict=True):
        _, inward = _axes(start, end)
        first, last = start + (x - y) * inward, end + (x + y) * inward
        moved.append((_axes(first, last)[1], first))
    corners = []
    for number in range(4):
        (one, through), (other, past) = moved[number - 1], moved[number]
        corners.append(np.linalg.solve(np.stack([one, other]), [one @ through, other @ past]))
    return np.array(corners)


def _axes(start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Unit vectors along a side, and inwards (rows count downwards)."""
    along = (end - start) / np.linalg.norm(end - start)
    return along, np.array([-along[1], along[0]])
