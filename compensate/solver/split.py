"""What ADMM needs to know of a problem: how it splits into Fourier's part and the bounds' part.

Planes are padded pictures, (plane, padded row, padded col): one for each primary of each view.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from compensate.fourier import Fourier
from compensate.problem import Problem
from compensate.solver.blocks import Spectrum
from compensate.weighting import CsfWeighting
from domesim.light import Array, Light

Planes: TypeAlias = Array

SpectralMap: TypeAlias = Callable[[Spectrum], Spectrum]


class Split(ABC):
    """One problem as a quadratic f(w) that Fourier (nearly) diagonalises, and separate bounds.

    Attributes
    ----------
    fourier
        The padded grid's transforms.
    metric
        (plane,) diagonal metric P.
    lower, upper
        Bounds of the planes.
    strength
        How much pollution amplifies light at most; 1 without any.
    """

    fourier: Fourier
    metric: Any
    lower: Planes
    upper: Planes
    strength: float
    dtype: np.dtype[Any]

    @abstractmethod
    def planes(self, light: Light) -> Planes:
        """The planes of `light`."""

    @abstractmethod
    def light(self, planes: Planes) -> Light:
        """The light of planes."""

    def prepare(self, floor: float) -> None:  # noqa: B027 - an exact x-step needs no preparation
        """Told before the first step: the least rho that there will be."""

    @abstractmethod
    def inverse(self, rho: float) -> SpectralMap:
        """(H_0 + rho P)^-1, of the Hessian H_0 that Fourier diagonalises."""

    @abstractmethod
    def step(self, inverse: SpectralMap, weight: Planes, towards: Planes, last: Planes) -> Planes:
        """The x-step: argmin f(w) + 1/2 ||w - towards||², weighted by rho P.

        Parameters
        ----------
        inverse
            `inverse` of rho.
        weight
            rho P, (plane, 1, 1).
        towards
            z - y.
        last
            The last step's w, from which an inexact one goes on.
        """

    @abstractmethod
    def nearest(self, planes: Planes, weight: Planes) -> Planes:
        """The z-step: the regulariser's and the bounds' proximal map."""

    @abstractmethod
    def quadratic(self, planes: Planes) -> tuple[float, Planes]:
        """Cost, and gradient in the planes."""

    @abstractmethod
    def gap(self, planes: Planes, gradient: Planes) -> float:
        """Certified upper bound of the cost's distance from the minimum."""


def require_certifiable(problem: Problem) -> CsfWeighting:
    """The problem's weighting.

    Raises
    ------
    ValueError
        If it is not one that Fourier diagonalises, the problem has no regulariser, or its pixels
        are not pinned where the weighting has no support.
    """
    weighting = problem.weighting
    if not isinstance(weighting, CsfWeighting):
        raise ValueError(f"ADMM takes a CsfWeighting, got {type(weighting).__name__}")
    if not problem.regularisation > 0:
        raise ValueError("ADMM certifies regularised problems only, got regularisation 0")
    off = ~weighting.support[None, :, :, None]
    pinned = np.broadcast_to(problem.lower == problem.upper, problem.observation.shape)
    if bool(np.any(off & ~pinned)):
        raise ValueError("ADMM takes a problem whose pixels off the support are pinned")
    return weighting
