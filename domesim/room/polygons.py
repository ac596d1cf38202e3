"""Polygons of a mesh file, made triangles.

trimesh fans every polygon out from its first corner, which fills its notches: an L becomes
triangles that overlap. So polygons that are not convex are cut by ears (Meisters 1975), by Mapbox's
earcut. Of one that crosses itself it makes triangles of another area.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Polygons = Sequence[Sequence[int]]
"""Corners of each polygon, by the vertices' numbers."""

_MOST = 20_000  # corners of a polygon with notches: the time grows with their square
_FLAT = 1e-12  # of a polygon's area: what a corner in a straight side comes to
_OFF = 1e-6  # of it: what triangles of a polygon that crosses itself are off at least


class PolygonError(ValueError):
    """A polygon crosses itself, or has too many corners."""


def read_obj(text: str) -> tuple[NDArray[np.float64], Polygons]:
    """Vertices (vertex, xyz), m, and polygons of a Wavefront OBJ."""
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    for line in text.replace("\\\n", " ").splitlines():
        words = line.partition("#")[0].split()
        if words[:1] == ["v"]:
            vertices.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"] and len(words) > 3:
            corners = [int(word.partition("/")[0]) for word in words[1:]]
            # Below 0 they count from the last vertex so far.
            polygons.append([each - 1 if each > 0 else len(vertices) + each for each in corners])
    return np.array(vertices, np.float64).reshape(-1, 3), polygons


def read_off(text: str) -> tuple[NDArray[np.float64], Polygons]:
    """As `read_obj`, of an OFF."""
    lines = [words for line in text.splitlines() if (words := line.partition("#")[0].split())]
    lines[0] = lines[0][1:] if lines[0][0].endswith("OFF") else lines[0]
    lines = lines if lines[0] else lines[1:]
    count, faces = int(lines[0][0]), int(lines[0][1])
    vertices = [[float(word) for word in words[:3]] for words in lines[1 : 1 + count]]
    held = lines[1 + count : 1 + count + faces]
    polygons = [[int(word) for word in words[1 : 1 + int(words[0])]] for words in held]
    return np.array(vertices, np.float64).reshape(-1, 3), polygons


def read_ply(raw: Any) -> tuple[NDArray[np.float64], Polygons] | None:
    """As `read_obj`, of what trimesh keeps of a PLY; None if that has no polygons."""
    vertices, faces = raw["vertex"]["data"], raw["face"]["data"]
    names = faces if isinstance(faces, dict) else faces.dtype.names
    name = next((each for each in ("vertex_indices", "vertex_index") if each in names), None)
    if name is None:
        return None
    lists = faces[name] if isinstance(faces, dict) else faces[name]["f1"]
    xyz = [np.asarray(vertices[axis], np.float64).ravel() for axis in "xyz"]
    return np.stack(xyz, -1), [np.asarray(each).ravel().tolist() for each in lists]


def triangles(vertices: NDArray[np.float64], polygons: Polygons) -> NDArray[np.int64]:
    """(triangle, 3) vertices' numbers of polygons that do not cross themselves.

    Parameters
    ----------
    vertices
        (vertex, xyz), m.
    polygons
        Corners of each, three or more.

    Raises
    ------
    PolygonError
        If one crosses itself, or has too many corners.
    ValueError
        If one names a vertex that there is not.
    """
    made: list[NDArray[np.int64]] = [np.zeros((0, 3), np.int64)]
    counts = np.array([len(each) for each in polygons])
    for count in sorted({*counts.tolist()} - {0, 1, 2}):
        corners = np.array([each for each in polygons if len(each) == count], np.int64)
        if corners.min() < 0 or corners.max() >= len(vertices):
            raise ValueError("a polygon of vertices that are not there")
        convex = np.full(len(corners), count == 3) | _convex(vertices[corners])
        fan = [corners[convex][:, [0, k, k + 1]] for k in range(1, count - 1)]
        made += [*fan, *_ears(vertices, corners[~convex])]
    return np.concatenate(made)


def _normals(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(polygon, xyz), twice the area long (Newell's), of (polygon, corner, xyz)."""
    relative = places - places[:, :1]
    return np.asarray(np.cross(relative, np.roll(relative, -1, 1)).sum(axis=1))


def _convex(places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(polygon,) whether each of (polygon, corner, xyz) turns one way, once around."""
    normals = _normals(places)
    sides = np.roll(places, -1, 1) - places
    turns = np.einsum("pcx,px->pc", np.cross(np.roll(sides, 1, 1), sides), normals)
    one_way = (turns >= -_FLAT * (normals**2).sum(-1)[:, None]).all(axis=1)
    # A fan of what goes around twice is larger than what is within.
    fan = np.cross(places[:, 1:-1] - places[:, :1], places[:, 2:] - places[:, :1])
    sizes = np.linalg.norm(fan, axis=-1).sum(axis=1)
    return np.asarray(one_way & (sizes <= np.linalg.norm(normals, axis=-1) * 1.01))


def _ears(
    vertices: NDArray[np.float64], polygons: NDArray[np.int64]
) -> Iterable[NDArray[np.int64]]:
    """(triangle, 3) vertices' numbers of each polygon."""
    from mapbox_earcut import triangulate_float64  # noqa: PLC0415 - few meshes have notches

    for corners, normal in zip(polygons, _normals(vertices[polygons]), strict=True):
        if len(corners) > _MOST:
            raise PolygonError(f"a polygon of {len(corners)} corners")
        # Seen along the axis on which the polygon is largest, from where it goes around to the left
        axis = int(np.abs(normal).argmax())
        seen = np.delete(vertices[corners], axis, axis=1)
        seen = seen * (1, np.sign(normal[axis]) * (-1 if axis == 1 else 1))
        cut = triangulate_float64(seen, np.array([len(seen)], np.uint32)).reshape(-1, 3)
        sides = seen[cut[:, 1:]] - seen[cut[:, :1]]
        size = np.linalg.det(sides).sum()
        if abs(size - abs(normal[axis])) > _OFF * size:
            raise PolygonError("a polygon that crosses itself")
        yield corners[cut]
