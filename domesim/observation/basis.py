"""Smooth functions on a dome screen.

They span the Zernike functions up to a degree d: the polynomials of total degree d in the
domemaster's coordinates (u, v) in the unit disc [1, section 9.2]. A triangular matrix makes
products of two Chebyshev polynomials T_i(u) T_j(v) orthonormal over the screen's area:

    integral of B_i B_j dA = A_s delta_ij,     B_0 = 1

so that the coefficient of B_0 is a mean over the screen.

[1] M. Born, E. Wolf, *Principles of Optics*, 7th ed., Cambridge University Press 1999.
"""

from __future__ import annotations

from functools import cached_property
from typing import final

import numpy as np
import scipy
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.room.dome import Dome

Floats = NDArray[np.float64]

HIGHEST_DEGREE = 12
"""Beyond it, products of Chebyshev polynomials on a disc are too alike for float64."""


@final
class ScreenBasis:
    """Orthonormal polynomials on a screen.

    Parameters
    ----------
    dome
        The screen.
    degree
        Highest total degree d; there are (d + 1)(d + 2) / 2 functions.

    Raises
    ------
    InputError
        If the degree is negative or above `HIGHEST_DEGREE`.
    """

    def __init__(self, dome: Dome, degree: int) -> None:
        if not 0 <= degree <= HIGHEST_DEGREE:
            raise InputError(f"basis degree must lie in 0..{HIGHEST_DEGREE}, got {degree}")
        self.dome = dome
        self.degree = degree
        pairs = [(i, total - i) for total in range(degree + 1) for i in range(total + 1)]
        self._i, self._j = (np.array(column) for column in zip(*pairs, strict=True))

    def __len__(self) -> int:
        return len(self._i)

    @cached_property
    def mixing(self) -> Floats:
        """(function, product) L^-1, lower triangular: B = mixing @ products."""
        u, v, weight = disc_quadrature(self.dome, max(64, 3 * self.degree))
        products = self.at_products(u, v)
        gram = (products * weight) @ products.T / weight.sum()
        lower = np.linalg.cholesky(gram)
        return np.asarray(scipy.linalg.solve_triangular(lower, np.eye(len(self)), lower=True))

    def at(self, u: Floats, v: Floats) -> Floats:
        """(function, ...): the functions at points of the domemaster's disc."""
        products = self.at_products(np.ravel(u), np.ravel(v))
        return np.asarray((self.mixing @ products).reshape(-1, *np.shape(u)))

    @property
    def degrees(self) -> NDArray[np.int64]:
        """(function,) total degrees."""
        return np.asarray(self._i + self._j)

    @property
    def products(self) -> list[tuple[int, int]]:
        """Degrees (i, j) of the products T_i(u) T_j(v) that `mixing` takes."""
        return list(zip(self._i.tolist(), self._j.tolist(), strict=True))

    def at_products(self, u: Floats, v: Floats) -> Floats:
        """(product, point): T_i(u) T_j(v) at points (point,) of the disc."""
        along = chebyshev.chebvander(u, self.degree)
        down = chebyshev.chebvander(v, self.degree)
        return np.ascontiguousarray((along[:, self._i] * down[:, self._j]).T)


def disc_quadrature(dome: Dome, rings: int) -> tuple[Floats, Floats, Floats]:
    """Quadrature points (u, v) of the domemaster's disc, and their shares of the screen, m².

    Gauss-Legendre along theta and even steps round: exact for smooth functions. A truncated ring is
    covered by Gauss-Legendre nodes between its ends, and theta in pieces between the angles where
    rings begin to be cut or are cut off.
    """
    node, weight = np.polynomial.legendre.leggauss(rings)
    node, weight = (node + 1) / 2, weight / 2
    around = 2 * rings
    bounds = np.array([0.0, dome.half_angle])
    if dome.truncated_below is None:
        step, share = (np.arange(around) + 0.5) / around, np.full(around, 1 / around)
    else:
        step, share = np.polynomial.legendre.leggauss(around)
        step, share = (step + 1) / 2, share / 2
        bounds = np.unique(np.clip([*bounds, *dome.cut_at()], *bounds))
        # A ring's kept part grows like a square root from where the cut touches it.
        weight = weight * 6 * node * (1 - node)
        node = node**2 * (3 - 2 * node)
    extents = np.diff(bounds)[:, None]
    theta = (bounds[:-1, None] + extents * node).ravel()
    start, extent = dome.kept_azimuth(theta)
    azimuth = start[:, None] + extent[:, None] * step
    area = dome.area_density(theta) * np.sin(theta) * (extents * weight).ravel()
    areas = (area * extent)[:, None] * share
    radius = (theta / dome.half_angle)[:, None]
    kept = areas > 0
    return (radius * np.cos(azimuth))[kept], (radius * np.sin(azimuth))[kept], areas[kept]
