"""A problem whose Hessian differs from pixel to pixel: Fourier diagonalises only one near it.

Crosstalk that varies over the picture (a map, a linearised table) has a *central* matrix, and a
spatial mask A_n a largest weight. The Hessian H_0 of the plain problem made of these is near the
true H, and ADMM's x-step becomes one step of iteration that is preconditioned by it. That converges
while H + rho P is below twice H_0 + rho P; where the picture varies so much that it is not, H_0 is
scaled up: smaller steps, and more of them. With ||A|| <= ||T|| and the largest deviation delta of a
pixel's matrix from the central one

    <x, H x>^1/2 <= <x, H_0 x>^1/2 + ||T|| delta ||x||
    H + rho P    <= (1 + ||T|| delta / (rho least(P))^1/2)² (H_0 + rho P)

which is enough to know of most maps; of wild ones, a few power iterations tell.

The certificate needs H^-1 itself; for any y, with the remainder r = g - H y,

    g' H^-1 g = y'(g + r) + r' H^-1 r  <=  y'(g + r) + ||r||² / mu

and a few steps of conjugate gradients, preconditioned by H_0, make r small.
"""

from __future__ import annotations

import math
from typing import Any, final

import numpy as np

from compensate.problem import Problem
from compensate.solver.blocks import Spectra
from compensate.solver.certificate import gap_bound
from compensate.solver.level import BoxLevel, Planes
from compensate.solver.split import BoxSplit
from compensate.weighting import Masked
from domesim.light import dot, namespace
from domesim.observation.stereo import StereoObservation

_STEPS = 12  # of conjugate gradients for a certificate
_ENOUGH = 0.05  # share of the certificate that may be the remainder's
_POWER_STEPS = 6
_SAFE = 1.4  # of H over H_0: up to there steps need no damping


@final
class Varying:
    """A problem beside the plain one near it.

    Parameters
    ----------
    problem
        Of a `StereoObservation`, or a `Masked` weighting, or both.
    plain
        The split of the plain problem, prepared.
    rho
        The least penalty that there will be.
    """

    def __init__(self, problem: Problem, plain: BoxSplit, rho: float) -> None:
        self._problem, self._plain = problem, plain
        level = plain.levels[0]
        assert isinstance(level, BoxLevel)
        self._level = level
        self._hessian = self._level.hessian
        self._mu = self._level.least_damping
        like = problem.desired
        self._support = namespace(like).asarray(
            plain.weighting.support, dtype=like.dtype, device=like.device
        )
        self.scale = self._needed_scale(rho)

    def quadratic(self, planes: Planes) -> tuple[float, Planes, Planes]:
        """With two FFTs a channel of each seen view.

        Returns
        -------
        Cost, its gradient on the picture, and the quadratic's gradient around it: on the padded
        planes, 0 on the support. (Light is pinned there. But the plain problem has a gradient
        there, and so its dual is not 0: without it the iteration diverges.)
        """
        plain, problem = self._plain, self._problem
        light = plain.light(planes)
        energy, whole = problem.weighting.quadratic(problem.residual(light), whole=True)
        rows, cols = self._support.shape
        weighted = whole[:, :rows, :cols, :] * self._support[None, :, :, None]
        penalty, gradient = problem.penalty_and_gradient(light, problem.contrasted(weighted))
        around = plain.pinned_gradient(whole)
        for plane in around:
            plane[:rows, :cols] *= 1 - self._support
        return 0.5 * energy + penalty, plain.from_gradient(gradient), around

    def solve(self, spectra: Spectra, sigma: list[float]) -> None:
        """(scale H_0 + diag(sigma))^-1, in place."""
        self._hessian.solve(spectra, [value / self.scale for value in sigma])
        if self.scale != 1:
            for p in range(len(spectra)):
                spectra[p] *= 1 / self.scale

    def gap(self, planes: Planes, gradient: Planes) -> float:
        """Certified upper bound of the cost's distance from the minimum."""
        level = self._level
        rows = slice(0, planes[0].shape[0])
        bounds = [level.bounds(p, rows) for p in range(len(planes))]
        return gap_bound(self._dual_energy, planes, gradient, bounds, self._hessian.curvature)

    def _dual_energy(self, free: Planes) -> float:
        """Return g' H^-1 g, bounded from above."""
        remainder = [plane + 0 for plane in free]
        direction = step = self._preconditioned(remainder)
        y = [0 * plane for plane in free]
        product = _dot(remainder, step)
        best = _dot(free, free) / self._mu
        for _ in range(_STEPS):
            if not product > 0:  # nothing is free, or all is known
                break
            image = self._curved(direction)
            length = product / _dot(direction, image)
            y = _plus(y, length, direction)
            remainder = _plus(remainder, -length, image)
            rest = _dot(remainder, remainder) / self._mu
            known = _dot(y, _plus(remainder, 1.0, free))
            best = min(best, known + rest)
            if rest <= _ENOUGH * known:
                break
            step = self._preconditioned(remainder)
            previous, product = product, _dot(remainder, step)
            direction = _plus(step, product / previous, direction)
        return best

    def _curved(self, planes: Planes) -> Planes:
        """H of planes: 0 on the padding."""
        _, product = self._problem.curvature(self._plain.direction(planes))
        return self._plain.from_gradient(product)

    def _preconditioned(self, planes: Planes) -> Planes:
        fourier = self._hessian.fourier
        spectra = [fourier.forward(plane) for plane in self._level.start(planes)]
        self._hessian.solve(spectra, [self._mu] * len(spectra))
        rows, cols = planes[0].shape
        return [fourier.inverse(spectrum)[:rows, :cols] for spectrum in spectra]

    def _needed_scale(self, rho: float) -> float:
        """How much H_0 must be scaled up."""
        weighting: Any = self._problem.weighting
        mask = 1.0
        if isinstance(weighting, Masked):
            mask, weighting = float(weighting.mask.max()) ** 2, weighting.inner
        opponent = np.linalg.norm(weighting.opponent, 2)
        importance = float(np.sqrt(np.max(weighting.importance)))
        reach = opponent * importance * self._deviation() / np.sqrt(rho * min(self._hessian.metric))
        bound = (1 + reach) ** 2
        if bound <= _SAFE:
            return mask
        return self._by_power(rho) if mask == 1 else mask * bound

    def _deviation(self) -> float:
        """The largest norm of a pixel's matrix of crosstalk less the central one."""
        observation = self._problem.observation
        if not isinstance(observation, StereoObservation) or observation.uniform:
            return 0.0
        like = self._problem.desired
        xp = namespace(like)
        shape = observation.shape
        squares = 0.0
        for view in range(shape[0]):
            for p in range(shape[3]):
                unit = xp.zeros(shape, dtype=like.dtype, device=like.device)
                unit[view, :, :, p] = 1
                away = observation.linear(unit)
                central = xp.asarray(
                    observation.central[:, :, view, p], dtype=like.dtype, device=like.device
                )
                away -= central[:, None, None, :]
                squares = squares + xp.sum(xp.sum(away * away, axis=3), axis=0)
        return math.sqrt(float(xp.max(squares)))

    def _by_power(self, rho: float) -> float:
        """The largest eigenvalue of (H_0 + rho P)^-1 (H + rho P), with some room; 1 if small."""
        fourier, metric = self._hessian.fourier, self._hessian.metric
        random = np.random.default_rng(0)
        like = self._level.lower[0]
        xp = namespace(like)
        x = [
            xp.asarray(random.standard_normal(like.shape), dtype=like.dtype, device=like.device)
            for _ in metric
        ]
        largest = 1.0
        for _ in range(_POWER_STEPS):
            image = self._curved(x)
            image = [a + b * (rho * m) for a, b, m in zip(image, x, metric, strict=True)]
            spectra = [fourier.forward(plane) for plane in self._level.start(image)]
            self._hessian.solve(spectra, [rho * m for m in metric])
            rows, cols = like.shape
            x = [fourier.inverse(spectrum)[:rows, :cols] for spectrum in spectra]
            largest = _dot(x, x) ** 0.5
            x = [plane / largest for plane in x]
        # The norm after normalisation; short of the limit by some tenths
        return 1.5 * largest if largest > _SAFE else 1.0


def _dot(left: Planes, right: Planes) -> float:
    return float(sum(dot(a, b) for a, b in zip(left, right, strict=True)))


def _plus(left: Planes, factor: float, right: Planes) -> Planes:
    return [a + b * factor for a, b in zip(left, right, strict=True)]
