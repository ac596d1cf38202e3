"""A dome's problem for ADMM: in w = D x, Fourier diagonalises all but a low-rank part."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from compensate.problem import Problem
from compensate.solver.certificate import gap_bound
from compensate.solver.fourier_step import NormalInverse, PlaneModel
from compensate.solver.split import Planes, SpectralMap, Split, require_certifiable
from domesim.light import Light, dot
from domesim.observation.lowrank import LowRankObservation


@final
class DomeSplit(Split):
    """The problem in w = D x, on padded planes (primary, row, col).

    Parameters
    ----------
    problem
        One of a `LowRankObservation` (see `require_certifiable`).
    start
        Light off the support, where pixels are pinned.
    """

    def __init__(self, problem: Problem, start: Light) -> None:
        observation, weighting = problem.observation, require_certifiable(problem)
        if not isinstance(observation, LowRankObservation):
            raise ValueError(f"ADMM takes a low-rank observation, got {type(observation).__name__}")
        off = ~weighting.support[None, :, :, None]
        self.model = model = PlaneModel(observation, weighting, problem.desired.dtype)
        self.fourier, self.dtype, self.strength = model.fourier, model.dtype, model.strength
        self._gain = observation.factors.direct_gain.astype(model.dtype)
        self._off_light = np.where(off, start, 0)
        self.mu = problem.regularisation
        self.gain = model.padded(
            np.broadcast_to(self._gain[None, :, :, None], (1, *self._gain.shape, model.primaries))
        )
        self.gain[self.gain == 0] = 1
        self.lower = self.planes(np.broadcast_to(problem.lower, start.shape))
        self.upper = self.planes(np.broadcast_to(problem.upper, start.shape))
        # What is seen of the pinned light off the support, and of ambient light, is given.
        given = observation.observe(self._off_light)
        target = model.fourier.forward(model.padded(problem.desired - given))
        self.constant = target
        self._target = model.polluted_adjoint(model.normal(target))
        self.anchor = self.planes(problem.anchor)
        diagonal = np.sqrt(np.sum(weighting.opponent**2, axis=0))
        self.metric = diagonal / diagonal.max()
        sigma = self.mu / float(self.gain.max()) ** 2
        self._certifying = NormalInverse(model, np.full(model.primaries, sigma))

    def planes(self, light: Light) -> Planes:
        """The planes w = D x of `light`."""
        return self.model.padded(light * self._gain[None, :, :, None])

    def light(self, planes: Planes) -> Light:
        """The light x = w / D on the support, the start's elsewhere."""
        rows, cols = self.model.support.shape
        inner = np.moveaxis(planes[:, :rows, :cols], 0, -1)[None] / self._gain[None, :, :, None]
        support = self.model.support[None, :, :, None]
        return np.where(support, inner, self._off_light).astype(self._off_light.dtype)

    def inverse(self, rho: float) -> SpectralMap:
        """(C'A'A C + rho P)^-1."""
        return NormalInverse(self.model, rho * self.metric)

    def step(self, inverse: SpectralMap, weight: Planes, towards: Planes, last: Planes) -> Planes:
        """The x-step, exact, with two FFTs a primary."""
        right = self.fourier.forward(weight * towards)
        right += self._target
        return self.fourier.inverse(inverse(right))

    def nearest(self, planes: Planes, weight: Planes) -> Planes:
        """The z-step: the regulariser's and the bounds' proximal map."""
        mu = self.mu / self.gain**2
        z = (weight * planes + mu * self.anchor) / (weight + mu)
        return np.clip(z, self.lower, self.upper)

    def quadratic(self, planes: Planes) -> tuple[float, Planes]:
        """Cost and gradient in w, with two FFTs a primary."""
        model = self.model
        residual = model.polluted(model.fourier.forward(planes)) - self.constant
        weighted = model.normal(residual)
        energy = sum(model.fourier.dot(r, s) for r, s in zip(residual, weighted, strict=True))
        change = (planes - self.anchor) / self.gain
        gradient = model.fourier.inverse(model.polluted_adjoint(weighted))
        gradient += self.mu * change / self.gain
        return 0.5 * (energy + self.mu * dot(change, change)), gradient

    def gap(self, planes: Planes, gradient: Planes) -> float:
        """Certified upper bound of the cost's distance from the minimum, one FFT a primary."""

        def dual_energy(free: Any) -> float:
            spectrum = self.fourier.forward(free)
            inverted = self._certifying(spectrum)
            return sum(self.fourier.dot(g, s) for g, s in zip(spectrum, inverted, strict=True))

        return gap_bound(dual_energy, planes, gradient, (self.lower, self.upper))
