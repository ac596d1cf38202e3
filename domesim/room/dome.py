"""The dome screen: a spherical cap, and the domemaster that is projected on it.

A *domemaster* is a square picture of the whole cap in the equidistant azimuthal mapping: a pixel at
distance r from the centre (1 on the inscribed circle) lies r times the half-angle away from the
zenith. The front of the audience is at the bottom of the picture, their right is on its right; the
mapping is symmetric about the vertical.

The dome's frame has x to the right, y to the front and z to the zenith of the cap; its origin is
the centre of the sphere. The room's frame has z up instead: the zenith leans to the front by the
tilt. An ellipsoidal dome is a sphere stretched or flattened along its zenith; its domemaster is
mapped by directions from the centre as well. A truncated dome ends at a horizontal plane of the
room, and the pixels below are off the screen.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, TypeAlias, final

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light.strips import in_strips

Angles: TypeAlias = NDArray[np.floating[Any]]

_GAUSS = [np.polynomial.legendre.leggauss(nodes) for nodes in (6, 2)]
_SHORT = 1 / 256
"""Pieces of half a picture's side for which Gauss's rule of two nodes is exact to rounding."""
_TEMPORARIES = 10
"""Arrays of a strip of edges: all of them are to fit a core's cache."""


@final
@dataclass(frozen=True)
class Dome:
    """A spherical cap.

    Parameters
    ----------
    radius
        Radius of the sphere, m.
    half_angle
        Angle from the cap's zenith to its rim, radians, in (0, pi]; a hemisphere has pi / 2.
    tilt
        How far the zenith of the cap leans towards the front, radians.
    height_ratio
        Semi-axis towards the zenith over `radius`; 1 for a sphere.
    truncated_below
        Height in the room's frame below which there is no screen, m; None for a whole cap.
    """

    radius: float
    half_angle: float
    tilt: float = 0.0
    height_ratio: float = 1.0
    truncated_below: float | None = None

    def __post_init__(self) -> None:
        for name in ("radius", "half_angle", "tilt", "height_ratio"):
            # NumPy's scalars would make arrays of other libraries' their own.
            object.__setattr__(self, name, float(getattr(self, name)))
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise InputError(f"dome radius must be above 0 m, got {self.radius:g} m")
        if not 0 < self.half_angle <= np.pi:
            raise InputError(
                f"dome half-angle must be above 0 and at most 180 degrees, "
                f"got {np.degrees(self.half_angle):g}"
            )
        if not (np.isfinite(self.height_ratio) and self.height_ratio > 0):
            raise InputError(f"dome height ratio must be above 0, got {self.height_ratio:g}")
        if self.screen_area <= 0:
            raise InputError(
                f"dome truncated below {self.truncated_below:g} m: no screen is left above"
            )

    @cached_property
    def screen_area(self) -> float:
        """Area of the whole screen A_s, m²."""
        if self.height_ratio == 1 and self.truncated_below is None:
            return float(2 * np.pi * self.radius**2 * (1 - np.cos(self.half_angle)))
        return self._integrated(self.area_density)

    @cached_property
    def solid_angle(self) -> float:
        """Solid angle of the screen seen from the centre of the sphere, sr."""
        if self.truncated_below is None:
            return float(2 * np.pi * (1 - np.cos(self.half_angle)))
        return self._integrated(np.ones_like)

    @cached_property
    def lowest(self) -> float:
        """Height of the screen's lowest point in the room's frame, m."""
        around = np.linspace(0, 2 * np.pi, 721)
        points = self.surface(*np.meshgrid(np.linspace(0, self.half_angle, 181), around))
        lowest = float((points @ self.to_room.T)[..., 2].min())
        return lowest if self.truncated_below is None else max(lowest, self.truncated_below)

    @cached_property
    def widest(self) -> float:
        """Largest horizontal distance of the screen from the room's axis, m."""
        around = np.linspace(0, 2 * np.pi, 721)
        points = self.surface(*np.meshgrid(np.linspace(0, self.half_angle, 181), around))
        x, y, z = np.moveaxis(points @ self.to_room.T, -1, 0)
        away = np.hypot(x, y)
        if self.truncated_below is None:
            return float(away.max())
        above = z - self.truncated_below
        kept = above >= 0
        # Where meridians cross the cut, too
        i, j = np.nonzero(kept[:, 1:] != kept[:, :-1])
        crossing = above[i, j] / (above[i, j] - above[i, j + 1])
        edge = away[i, j] + crossing * (away[i, j + 1] - away[i, j])
        return float(np.concatenate([away[kept], edge]).max(initial=0.0))

    @property
    def whole(self) -> str:
        """The whole surface that the screen is a part of, in words."""
        if self.height_ratio == 1:
            return f"the sphere of radius {self.radius:g} m"
        return f"the ellipsoid of radius {self.radius:g} m and height ratio {self.height_ratio:g}"

    @property
    def to_room(self) -> NDArray[np.float64]:
        """(3, 3) rotation from the dome's frame to the room's."""
        c, s = np.cos(self.tilt), np.sin(self.tilt)
        return np.array([[1, 0, 0], [0, c, s], [0, -s, c]])

    def surface(self, theta: Angles, azimuth: Angles) -> NDArray[np.float64]:
        """(..., xyz): points of the screen's surface in the dome's frame, m.

        Parameters
        ----------
        theta
            Angle from the zenith, radians.
        azimuth
            From x (right) to y (front), radians.
        """
        ring = np.sin(theta)
        directions = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), np.cos(theta)], -1)
        return directions * self.distance(directions)[..., None]

    def distance(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """(...): distance from the centre to the screen along unit vectors (..., xyz), m."""
        across = directions[..., 0] ** 2 + directions[..., 1] ** 2
        along = (directions[..., 2] / self.height_ratio) ** 2
        return np.asarray(self.radius / np.sqrt(across + along))

    def normals(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., xyz): outward unit normals of the screen along unit vectors (..., xyz)."""
        stretched = directions / np.array([1, 1, self.height_ratio**2])
        return np.asarray(stretched / np.linalg.norm(stretched, axis=-1, keepdims=True))

    def inside(self, rows: int, cols: int) -> NDArray[np.bool_]:
        """(row, col): whether the centre of the domemaster pixel lies on the screen."""
        u, v = _pixel_centres(rows, cols)
        inside = np.empty((rows, cols), bool)
        for strip in strips(rows, cols):  # which have no planes of distances
            np.less_equal(u**2 + v[strip] ** 2, 1, out=inside[strip])
        if self.truncated_below is None:
            return inside
        return inside & (self._room_height(u, v) >= self.truncated_below)

    def toward(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., xyz): unit vectors of the dome's frame towards points of the room (..., xyz), m."""
        local = points @ self.to_room
        return np.asarray(local / np.maximum(np.linalg.norm(local, axis=-1, keepdims=True), 1e-300))

    def pixel_of(
        self, directions: NDArray[np.float64], size: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of the domemaster pixels that unit vectors (..., xyz) point at.

        Clipped to the picture; `directions` inverts it at the pixels' centres.
        """
        theta = np.arccos(np.clip(directions[..., 2], -1, 1))
        x, y = directions[..., 0], directions[..., 1]
        x = np.where(np.hypot(x, y) > 0, x, 1e-300)  # the antipode has a side, too
        scale = theta / self.half_angle / np.hypot(x, y)
        place = (np.stack([x * scale, y * scale], -1) + 1) * (size / 2)
        index = np.clip(place, 0, size - 1).astype(np.int64)
        return index[..., 1], index[..., 0]

    def encloses(self, point: tuple[float, float, float]) -> bool:
        """Whether a point of the dome's frame is inside the sphere or ellipsoid of the screen."""
        x, y, z = point
        return bool(np.linalg.norm([x, y, z / self.height_ratio]) < self.radius)

    def _room_height(self, u: Angles, v: Angles) -> NDArray[np.float64]:
        """Height in the room of the screen at points (u, v) of the domemaster, m."""
        points = self.surface(np.hypot(u, v) * self.half_angle, np.arctan2(v, u))
        return np.asarray(points @ self.to_room[2])

    def area_density(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Area per solid angle, m²: d² over the cosine between direction and normal."""
        directions = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], -1)
        cosine = np.sum(directions * self.normals(directions), -1)
        return np.asarray(self.distance(directions) ** 2 / cosine)

    def _integrated(self, density: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> float:
        """Integral over the screen of a density per solid angle that depends on theta only."""

        def ring(theta: float) -> float:
            angle = np.array([theta])
            return float(density(angle)[0] * np.sin(theta) * self.kept_azimuth(angle)[1][0])

        bounds = sorted({0.0, *self.cut_at(), self.half_angle})
        return float(
            sum(
                scipy.integrate.quad(ring, start, stop, limit=400, epsabs=1e-12, epsrel=1e-10)[0]
                for start, stop in itertools.pairwise(bounds)
            )
        )

    def kept_azimuth(self, theta: NDArray[np.float64]) -> tuple[Any, Any]:
        """Where the truncated ring at `theta` (any shape) starts, and how far it goes, radians."""
        whole = np.full_like(theta, 2 * np.pi)
        if self.truncated_below is None:
            return np.zeros_like(theta), whole
        # z = d (cos tilt cos theta - sin tilt sin theta sin azimuth) in the room
        level = np.cos(self.tilt) * np.cos(theta)
        level = level - self.truncated_below / self._ring_distance(theta)
        swing = np.sin(self.tilt) * np.sin(theta)
        with np.errstate(divide="ignore", invalid="ignore"):
            half = np.where(
                np.abs(swing) > np.abs(level),
                np.pi - np.arccos(np.clip(level / np.abs(swing), -1, 1)),
                np.where(level >= 0, np.pi, 0.0),
            )
        # It is the front (azimuth pi / 2) that dips when the zenith leans to it.
        highest = -np.pi / 2 if self.tilt >= 0 else np.pi / 2
        return highest - half, 2 * half

    def cut_at(self) -> list[float]:
        """Angles theta at which the truncation begins to cut rings, or has cut off whole ones."""
        if self.truncated_below is None:
            return []
        scan, cut = np.linspace(0, self.half_angle, 721), self.truncated_below

        def above(theta: Any, side: int) -> Any:
            # Height of a ring's lowest or highest point, in units of its distance, above the cut
            return np.cos(theta + side * self.tilt) - cut / self._ring_distance(theta)

        angles = []
        for side in (-1, 1):
            sign = above(scan, side) >= 0
            angles += [
                float(scipy.optimize.brentq(above, scan[i], scan[i + 1], args=(side,)))
                for i in np.flatnonzero(sign[1:] != sign[:-1])
            ]
        return angles

    def _ring_distance(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.distance(np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], -1))

    def directions(self, rows: int, cols: int, strip: slice = slice(None)) -> NDArray[np.float64]:
        """(row, col, xyz): unit vectors from the centre of the sphere to the pixels' centres.

        Outside the circle the mapping goes on, up to the antipode. With `strip`, of those rows.
        """
        u, v = _pixel_centres(rows, cols)
        v = v[strip]
        distance = np.hypot(u, v)
        theta = np.minimum(distance * self.half_angle, np.pi)
        # sin(theta) / distance, with its limit at the zenith
        scale = np.divide(
            np.sin(theta), distance, out=np.full_like(distance, self.half_angle), where=distance > 0
        )
        return np.stack([u * scale, v * scale, np.cos(theta)], -1)

    def points(self, rows: int, cols: int, strip: slice = slice(None)) -> NDArray[np.float64]:
        """(row, col, xyz): where the pixels' centres are in the room, m; as `directions`."""
        directions = self.directions(rows, cols, strip)
        return np.asarray(directions * self.distance(directions)[..., None] @ self.to_room.T)

    def pixel_areas(
        self, rows: int, cols: int, dtype: type[np.floating] = np.float64
    ) -> NDArray[Any]:
        """(row, col): screen area that each domemaster pixel covers (a_i), m².

        Exact up to rounding, also for the pixels that the rim cuts: by Green's theorem the solid
        angle of a region is the integral of (1 - cos theta) d(phi) along its boundary, whose pieces
        are the pixel's edges inside the circle and the arc of the rim within the pixel; along the
        arc it is what the edges leave of a whole turn, times that of the rim. Neighbours
        share edges, so the areas of any image size sum to the cap's area.

        Raises
        ------
        InputError
            If the image is not square.
        """
        size = _square_size(rows, cols)
        grid = (2 * np.arange(size + 1) - size) / size
        # One quadrant; the others are its reflections.
        half = (size + 1) // 2
        edges = _edge_integrals(grid[: half + 1], self.half_angle)
        # Counter-clockwise around pixel (i, j): bottom and top edges run along u, the others along
        # v; exchanging u and v turns a boundary around, hence the transpose's signs.
        along_u = edges[:-1, :] - edges[1:, :]
        quadrant = along_u + along_u.T
        # The pole is in the last
        quadrant[-1, -1] += 2 * np.pi * (1 - np.cos(self.half_angle)) / (1 if size % 2 else 4)
        np.maximum(quadrant, 0.0, out=quadrant)
        quadrant[~_touched(size)] = 0.0
        sphere = self.height_ratio == 1 and self.truncated_below is None
        if sphere:
            quadrant *= self.radius**2
        areas = np.empty((size, size), dtype)
        areas[:half, :half], areas[:half, -half:] = quadrant, quadrant[:, ::-1]
        areas[-half:] = areas[:half][::-1]
        if sphere:
            return areas
        u, v = _pixel_centres(rows, cols)
        theta = np.minimum(np.hypot(u, v), 1.0) * self.half_angle
        areas = areas * self.area_density(theta)
        if self.truncated_below is not None:
            areas = areas * self._share_above(grid, self.truncated_below)
        if not areas.any():
            raise InputError(f"no pixel of {cols} x {rows} is on the screen; use more of them")
        # The density at the pixels' centres is right to second order; the sum is exact.
        return np.asarray(areas * (self.screen_area / areas.sum()))

    def _share_above(
        self, grid: NDArray[np.float64], lowest: float, finer: int = 8
    ) -> NDArray[np.float64]:
        """(row, col): share of each pixel's part of the disc above `lowest` in the room, m."""
        centres = (grid[1:] + grid[:-1]) / 2
        height = self._room_height(centres[None, :], centres[:, None])
        share = (height >= lowest).astype(np.float64)
        reach = 4 * self.half_angle * self.radius * max(1.0, self.height_ratio) / len(centres)
        row, col = np.nonzero(np.abs(height - lowest) < reach)
        step = (np.arange(finer) + 0.5) / finer * (grid[1] - grid[0])
        u = grid[col][:, None, None] + step[None, None, :]
        v = grid[row][:, None, None] + step[None, :, None]
        disc = (u**2 + v**2 <= 1) + 1e-9
        above = self._room_height(u, v) >= lowest
        share[row, col] = np.sum(above * disc, axis=(1, 2)) / np.sum(disc, axis=(1, 2))
        return share

    def screen_areas(
        self, rows: int, cols: int, dtype: type[np.floating] = np.float64
    ) -> NDArray[Any]:
        """(row, col): `pixel_areas`, held by the pixels whose centre is on the screen.

        A pixel that the rim cuts and whose centre is off the screen gives its area to its neighbour
        towards the zenith: what lies outside the circle must not influence what is inside.

        Raises
        ------
        InputError
            If the image is not square, or no pixel's centre is on the screen.
        """
        areas, inside = self.pixel_areas(rows, cols, dtype), self.inside(rows, cols)
        if not inside.any():
            raise InputError(f"no pixel of {cols} x {rows} is on the screen; use more of them")
        row, col = np.nonzero((areas > 0) & ~inside)
        cut, result = areas[row, col], areas
        np.copyto(result, 0, where=~inside)
        if self.truncated_below is not None:
            nearest = scipy.ndimage.distance_transform_edt(
                ~inside, return_distances=False, return_indices=True
            )
            np.add.at(result, (nearest[0][row, col], nearest[1][row, col]), cut)
            return result
        down, right = 2 * row + 1 - rows, 2 * col + 1 - cols  # signed distances from the centre
        straight = np.where(np.abs(down) > np.abs(right), np.sign(down), 0)
        across = np.where(np.abs(right) > np.abs(down), np.sign(right), 0)
        blocked = (straight == 0) & (across == 0) | ~inside[row - straight, col - across]
        straight = np.where(blocked, np.sign(down), straight)
        across = np.where(blocked, np.sign(right), across)
        np.add.at(result, (row - straight, col - across), cut)
        return result

    def kept_areas(self, rows: int, cols: int) -> NDArray[np.floating]:
        """`screen_areas`, kept and not to be changed; large pictures' in single precision."""
        return _kept_areas(self, rows, cols)

    def lens_gain(
        self,
        rows: int,
        cols: int,
        lens: tuple[float, float, float],
        strip: slice = slice(None),
    ) -> NDArray[np.float64]:
        """(row, col): irradiance of the screen from a lens of equal intensity in all directions.

        r² cos(theta) / d², relative to a lens in the centre of the sphere, where it is 1
        everywhere (the projector-to-screen form factor of section 6.1 of the paper).

        Parameters
        ----------
        rows, cols
            Size of the domemaster, pixels.
        lens
            Position of the lens in the dome's frame, m, inside the sphere.
        strip
            Only these rows.

        Raises
        ------
        InputError
            If the lens is not inside the sphere.
        """
        position = np.asarray(lens, np.float64)
        if not self.encloses(lens):
            raise InputError(
                f"projector lens must be inside {self.whole}, "
                f"got {np.linalg.norm(position):g} m from its centre"
            )
        directions = self.directions(rows, cols, strip)
        normal = self.normals(directions)
        ray = directions * self.distance(directions)[..., None] - position
        distance = np.linalg.norm(ray, axis=-1)
        cosine = np.sum(ray * normal, -1) / distance
        return np.asarray(self.radius**2 * cosine / distance**2)


_LARGE = 1 << 23
"""Pixels of pictures for which memory counts for more than the last digits."""


@lru_cache(maxsize=1)
def _kept_areas(dome: Dome, rows: int, cols: int) -> NDArray[np.floating]:
    areas = dome.screen_areas(rows, cols, np.float32 if rows * cols > _LARGE else np.float64)
    areas.flags.writeable = False
    return areas


def strips(rows: int, cols: int) -> list[slice]:
    """Slices of rows, so that vectors of all pixels of a large picture need not be held at once."""
    height = max(1, (1 << 20) // cols)
    return [slice(first, min(first + height, rows)) for first in range(0, rows, height)]


def _square_size(rows: int, cols: int) -> int:
    if rows != cols:
        way = "crop or pad it to a square around the dome's circle"
        if cols in (2 * rows, 6 * rows):
            kind = "equirectangular" if cols == 2 * rows else "cube-strip"
            way += f", or, if it is a panorama, make one of it (domesim domemaster --from {kind})"
        raise InputError(
            f"a domemaster is square, got {cols} x {rows} pixels (width x height); {way}"
        )
    if rows < 2:
        raise InputError(f"a domemaster has at least 2 x 2 pixels, got {cols} x {rows}")
    return rows


def _pixel_centres(
    rows: int, cols: int
) -> tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]]]:
    """Broadcastable u (to the right) and v (to the front: down), 1 on the circle."""
    size = _square_size(rows, cols)
    centres = (np.arange(size) + 0.5) * (2 / size) - 1
    return centres[None, :], centres[:, None]


def _touched(size: int) -> NDArray[np.bool_]:
    """(row, col) of the upper left quadrant: whether the circle reaches into the pixel.

    In whole numbers: halves of pixels from the centre to the pixel's nearest point.
    """
    near = np.maximum(size - 2 * (np.arange((size + 1) // 2) + 1), 0)
    return np.asarray(near[:, None] ** 2 < size**2 - near**2)


def _edge_integrals(grid: NDArray[np.floating[Any]], half_angle: float) -> NDArray[np.float64]:
    """(line, piece): integrals of (cos H - cos theta) d(phi) along grid lines v = const.

    From u_j to u_j+1, clipped to the unit disc; H is the half-angle, at the rim.
    """
    edges = np.empty((len(grid), len(grid) - 1))

    def fill(_: int, lines: slice) -> None:
        v = grid[lines, None]
        rim = np.sqrt(np.maximum(1 - v**2, 0.0))
        start = np.clip(grid[None, :-1], -rim, rim)
        end = np.clip(grid[None, 1:], -rim, rim)
        middle, half = (start + end) / 2, (end - start) / 2
        # atan2 of the cross and dot products of the piece's ends; 0 along a line through the centre
        turn = np.arctan2(-v * (end - start), start * end + v**2)
        integral = (np.cos(half_angle) - 1) * np.where(v == 0, 0.0, turn)
        for node, weight in zip(*_GAUSS[int(grid[1] - grid[0] < _SHORT)], strict=True):
            square = (middle + node * half) ** 2 + v**2
            # (1 - cos(H r)) / r² = 2 sin²(H r / 2) / r²; no node lies in the zenith
            sine = np.sin(half_angle / 2 * np.sqrt(square))
            integral += (-2 * weight * v) * half * (sine * sine / square)
        edges[lines] = integral

    in_strips(fill, (1, *edges.shape, _TEMPORARIES))
    return edges
