"""The dome screen: a spherical cap, and the domemaster that is projected on it.

A *domemaster* is a square picture of the whole cap in the equidistant azimuthal mapping: a pixel at
distance r from the centre (1 on the inscribed circle) lies r times the half-angle away from the
zenith. The front of the audience is at the bottom of the picture, their right is on its right; the
mapping is symmetric about the vertical.

The dome's frame has x to the right, y to the front and z to the zenith of the cap; its origin is
the centre of the sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError

_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(6)


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
    """

    radius: float
    half_angle: float
    tilt: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise InputError(f"dome radius must be above 0 m, got {self.radius:g} m")
        if not 0 < self.half_angle <= np.pi:
            raise InputError(
                f"dome half-angle must be above 0 and at most 180 degrees, "
                f"got {np.degrees(self.half_angle):g}"
            )

    @property
    def screen_area(self) -> float:
        """Area of the whole screen A_s, m²."""
        return float(2 * np.pi * self.radius**2 * (1 - np.cos(self.half_angle)))

    @property
    def solid_angle(self) -> float:
        """Solid angle of the screen seen from the centre of the sphere, sr."""
        return self.screen_area / self.radius**2

    def inside(self, rows: int, cols: int) -> NDArray[np.bool_]:
        """(row, col): whether the centre of the domemaster pixel lies on the screen."""
        u, v = _pixel_centres(rows, cols)
        return u**2 + v**2 <= 1

    def directions(self, rows: int, cols: int) -> NDArray[np.float64]:
        """(row, col, xyz): unit vectors from the centre of the sphere to the pixels' centres.

        Outside the circle the mapping goes on, up to the antipode.
        """
        u, v = _pixel_centres(rows, cols)
        distance = np.hypot(u, v)
        theta = np.minimum(distance * self.half_angle, np.pi)
        # sin(theta) / distance, with its limit at the zenith
        scale = np.divide(
            np.sin(theta), distance, out=np.full_like(distance, self.half_angle), where=distance > 0
        )
        return np.stack([u * scale, v * scale, np.cos(theta)], -1)

    def pixel_areas(self, rows: int, cols: int) -> NDArray[np.float64]:
        """(row, col): screen area that each domemaster pixel covers (a_i), m².

        Exact up to rounding, also for the pixels that the rim cuts: by Green's theorem the solid
        angle of a region is the integral of (1 - cos theta) d(phi) along its boundary, whose pieces
        are the pixel's edges inside the circle and the arc of the rim within the pixel. Neighbours
        share edges, so the areas of any image size sum to the cap's area.

        Raises
        ------
        InputError
            If the image is not square.
        """
        size = _square_size(rows, cols)
        grid = np.linspace(-1.0, 1.0, size + 1)
        cap, angle = _edge_integrals(grid, self.half_angle)
        # Counter-clockwise around pixel (i, j): bottom and top edges run along u, the others along
        # v; exchanging u and v turns a boundary around, hence the transposes' signs.
        around_cap = cap[:-1, :] - cap[1:, :] + cap.T[:, :-1] - cap.T[:, 1:]
        around_angle = angle[:-1, :] - angle[1:, :] + angle.T[:, :-1] - angle.T[:, 1:]
        pole = np.zeros((size, size))
        centre = slice((size - 1) // 2, size // 2 + 1)
        pole[centre, centre] = 1 / (1 if size % 2 else 4)
        arc = 2 * np.pi * pole - around_angle
        solid_angle = around_cap + (1 - np.cos(self.half_angle)) * arc
        reached = _nearest_distance(grid) < 1
        return np.where(reached, np.maximum(solid_angle, 0.0), 0.0) * self.radius**2

    def screen_areas(self, rows: int, cols: int) -> NDArray[np.float64]:
        """(row, col): `pixel_areas`, held by the pixels whose centre is on the screen.

        A pixel that the rim cuts and whose centre is off the screen gives its area to its neighbour
        towards the zenith: what lies outside the circle must not influence what is inside.
        """
        areas, inside = self.pixel_areas(rows, cols), self.inside(rows, cols)
        result = np.where(inside, areas, 0.0)
        row, col = np.nonzero((areas > 0) & ~inside)
        down, right = 2 * row + 1 - rows, 2 * col + 1 - cols  # signed distances from the centre
        straight = np.where(np.abs(down) > np.abs(right), np.sign(down), 0)
        across = np.where(np.abs(right) > np.abs(down), np.sign(right), 0)
        blocked = (straight == 0) & (across == 0) | ~inside[row - straight, col - across]
        straight = np.where(blocked, np.sign(down), straight)
        across = np.where(blocked, np.sign(right), across)
        np.add.at(result, (row - straight, col - across), areas[row, col])
        return result

    def lens_gain(
        self, rows: int, cols: int, lens: tuple[float, float, float]
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
        """
        position = np.asarray(lens, np.float64)
        if not np.linalg.norm(position) < self.radius:
            raise InputError(
                f"projector lens must be inside the sphere of radius {self.radius:g} m, "
                f"got {np.linalg.norm(position):g} m from its centre"
            )
        normal = self.directions(rows, cols)
        ray = self.radius * normal - position
        distance = np.linalg.norm(ray, axis=-1)
        cosine = np.sum(ray * normal, -1) / distance
        return np.asarray(self.radius**2 * cosine / distance**2)


def _square_size(rows: int, cols: int) -> int:
    if rows != cols:
        raise InputError(
            f"a domemaster is square, got {cols} x {rows} pixels (width x height); "
            f"crop or pad it to a square around the dome's circle"
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


def _nearest_distance(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """(row, col): distance from the image's centre to the pixel's nearest point."""
    near = np.maximum(np.maximum(grid[:-1], -grid[1:]), 0.0)
    return np.hypot(near[:, None], near[None, :])


def _edge_integrals(
    grid: NDArray[np.floating[Any]], half_angle: float
) -> tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]]]:
    """(line, piece): integrals of (1 - cos theta) d(phi) and of d(phi) along grid lines v = const.

    From u_j to u_j+1, clipped to the unit disc.
    """
    v = grid[:, None]
    rim = np.sqrt(np.maximum(1 - v**2, 0.0))
    start = np.clip(grid[None, :-1], -rim, rim)
    end = np.clip(grid[None, 1:], -rim, rim)
    middle, half = (start + end) / 2, (end - start) / 2
    cap = np.zeros_like(middle)
    for node, weight in zip(_GAUSS_NODES, _GAUSS_WEIGHTS, strict=True):
        u = middle + node * half
        square = u**2 + v**2
        # (1 - cos(H r)) / r² = H²/2 sinc²(H r / 2): smooth through the zenith
        half_theta = half_angle / 2 * np.sqrt(square)
        density = half_angle**2 / 2 * np.sinc(half_theta / np.pi) ** 2
        cap += weight * half * density * -v
    # atan2 of the cross and dot products of the piece's ends; 0 along a line through the centre
    angle = np.arctan2(-v * (end - start), start * end + v**2)
    angle = np.where(v == 0, 0.0, angle)
    return cap, angle
