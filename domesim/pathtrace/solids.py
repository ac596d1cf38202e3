"""Solids as plain arrays of triangles: (triangle, corner, xyz), in metres.

Triangles share no corners, so every face is flat and joining solids is concatenation. Faces look
outwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

Triangles = NDArray[np.float64]
"""(triangle, corner, xyz), m."""


def join(solids: Sequence[Triangles]) -> Triangles:
    """All triangles of `solids`."""
    return np.concatenate(solids)


def moved(solid: Triangles, offset: ArrayLike) -> Triangles:
    """`solid` moved by `offset` (xyz)."""
    moved_solid: Triangles = solid + np.asarray(offset, dtype=np.float64)
    return moved_solid


def turned(solid: Triangles, azimuth: float) -> Triangles:
    """`solid` turned about the vertical by `azimuth` (degrees), clockwise seen from above."""
    a = np.radians(azimuth)
    turn = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    turned_solid: Triangles = solid @ turn.T
    return turned_solid


def quad(a: ArrayLike, b: ArrayLike, c: ArrayLike, d: ArrayLike) -> Triangles:
    """The flat face a b c d, seen counter-clockwise."""
    corners: Triangles = np.array([a, b, c, d], dtype=np.float64)
    faces: Triangles = corners[np.array([[0, 1, 2], [0, 2, 3]])]
    return faces


def box(low: ArrayLike, high: ArrayLike) -> Triangles:
    """The box between two opposite corners."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, float), np.asarray(high, float)
    return prism([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], z0, z1)


def prism(outline: ArrayLike, bottom: float, top: float) -> Triangles:
    """A convex `outline` (corner, xy), counter-clockwise, raised from `bottom` to `top`."""
    flat = np.asarray(outline, dtype=np.float64)
    low = np.column_stack([flat, np.full(len(flat), bottom)])
    high = np.column_stack([flat, np.full(len(flat), top)])
    return join([_fan(high), _fan(low[::-1]), _wall(low, high)])


def extruded(outline: ArrayLike, front: float, back: float) -> Triangles:
    """A convex `outline` (corner, xz), counter-clockwise seen from the front, from y to y."""
    flat = np.asarray(outline, dtype=np.float64)
    near = np.column_stack([flat[:, 0], np.full(len(flat), front), flat[:, 1]])
    far = np.column_stack([flat[:, 0], np.full(len(flat), back), flat[:, 1]])
    return join([_fan(near), _fan(far[::-1]), _wall(far, near)])


def lathe(profile: ArrayLike, sides: int = 48, sweep: tuple[float, float] = (0, 360)) -> Triangles:
    """A `profile` (point, (radius, z)) from bottom to top, turned about z.

    `sweep` gives its first and last azimuth in degrees, counter-clockwise from +x.
    """
    radius, z = np.asarray(profile, dtype=np.float64).T
    a = np.radians(np.linspace(*sweep, sides + 1))[:, None]
    rings = np.stack([radius * np.cos(a), radius * np.sin(a), z + 0 * a], axis=-1)
    p, q, r, s = rings[:-1, :-1], rings[1:, :-1], rings[1:, 1:], rings[:-1, 1:]
    faces = np.stack([np.stack([p, q, r], axis=-2), np.stack([p, r, s], axis=-2)])
    return faces.reshape(-1, 3, 3)


def tube(
    start: Triangles, end: Triangles, radius: tuple[float, float], sides: int = 6
) -> Triangles:
    """An open, tapering tube between two points."""
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    a = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)[:, None]
    ring = np.cos(a) * side + np.sin(a) * np.cross(axis, side)
    return _wall(start + radius[0] * ring, end + radius[1] * ring)


def ring(centre: ArrayLike, radius: float, thickness: float, axis: ArrayLike) -> Triangles:
    """A thin hoop about `axis`."""
    axis = np.asarray(axis, dtype=np.float64)
    axis /= np.linalg.norm(axis)
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    a = np.linspace(0.0, 2 * np.pi, 49)[:, None]
    path = np.asarray(centre) + radius * (np.cos(a) * side + np.sin(a) * np.cross(axis, side))
    return join([tube(p, q, (thickness, thickness)) for p, q in pairwise(path)])


def ball(centre: ArrayLike, radius: float, sides: int = 24) -> Triangles:
    """A faceted ball."""
    a = np.linspace(-np.pi / 2, np.pi / 2, sides // 2 + 1)
    return moved(lathe(np.column_stack([radius * np.cos(a), radius * np.sin(a)]), sides), centre)


def _fan(corners: Triangles) -> Triangles:
    first = np.broadcast_to(corners[0], (len(corners) - 2, 3))
    return np.stack([first, corners[1:-1], corners[2:]], axis=1)


def _wall(low: Triangles, high: Triangles) -> Triangles:
    """The strip between two closed outlines of the same number of corners."""
    low_next, high_next = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    first = np.stack([low, low_next, high_next], axis=1)
    return join([first, np.stack([low, high_next, high], axis=1)])
