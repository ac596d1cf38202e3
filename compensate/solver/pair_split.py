"""A stereo pair's problem for ADMM: crosstalk mixes views, Fourier diagonalises the rest.

What an eye sees of one frequency is a small matrix times what is projected at that frequency: with
the views' primaries stacked, C is (seen views x primaries) by (2 x primaries), the same for all
pixels, and the Hessian of 1/2 ||A (C x - t)||² is for each frequency

    H_0(f) = C' A'A C = sum over seen views v and channels c of Omega_c(f)² u_vc u_vc',
    u_vc = C_v' t_c           t_c: row c of the opponent transform T

a matrix of 6 x 6 planes. Where both directions leak alike it falls apart into two of 3 x 3, in the
sum and the difference of the views.

Where crosstalk differs from pixel to pixel (a map, a linearised table), C is its *central* matrix,
and H_0 is only near the true Hessian H. Then the x-step is solved up to one step of preconditioned
iteration, from the last w, which costs four FFTs a plane instead of two:

    w <- w + (H_0 + rho P)^-1 (b - H w + rho P (z - y - w)),      b = H z - grad f(z) for any z

A fixed point is a minimiser of the true cost. The iteration converges while H + rho P is below
twice H_0 + rho P; where crosstalk varies so much that it is not, H_0 is scaled up (by a few power
iterations at the least rho): smaller steps, and more of them. The certificate needs H^-1 itself;
for any y, with the remainder r = g - H y,

    g' H^-1 g = y'(g + r) + r' H^-1 r  <=  y'(g + r) + ||r||² / mu

and a few steps of conjugate gradients, preconditioned by H_0, make r small.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np

from compensate.problem import Problem
from compensate.solver.blocks import Spectrum, blocks_times, inverted
from compensate.solver.certificate import gap_bound
from compensate.solver.split import Planes, SpectralMap, Split, require_certifiable
from compensate.weighting import CsfWeighting
from domesim.light import Light, dot
from domesim.observation.stereo import StereoObservation

_STEPS = 12  # of conjugate gradients for a certificate
_ENOUGH = 0.05  # share of the certificate that may be the remainder's
_POWER_STEPS = 6
_SAFE = 1.4  # of H over H_0: up to there steps need no damping


@final
class PairSplit(Split):
    """The problem of two views on padded planes (view primary, row, col).

    Parameters
    ----------
    problem
        One of a `StereoObservation` (see `require_certifiable`).
    start
        Light (2, row, col, primary) from which f's gradient is first known.
    """

    def __init__(self, problem: Problem, start: Light) -> None:
        observation, weighting = problem.observation, require_certifiable(problem)
        if not isinstance(observation, StereoObservation):
            raise ValueError(f"PairSplit takes a stereo pair, got {type(observation).__name__}")
        self._problem, self._observation, self._weighting = problem, observation, weighting
        self.fourier, self.dtype = weighting.fourier, np.dtype(problem.desired.dtype)
        primaries = observation.shape[3]
        self._central = observation.central
        leak = self._central.reshape(-1, 2, primaries, 2, primaries).copy()
        for view in range(2):
            leak[:, view, :, view] -= np.eye(primaries)
        self.strength = 1 + float(
            max(np.linalg.norm(part.reshape(2 * primaries, -1), 2) for part in leak)
        )
        self._hessian = _Hessian(self._central, weighting, self.dtype)
        diagonal = np.sqrt(np.sum(weighting.opponent**2, axis=0))
        self.metric = np.tile(diagonal / diagonal.max(), 2)
        self.mu = problem.regularisation
        self.anchor = self.planes(problem.anchor)
        self.lower = self.planes(np.broadcast_to(problem.lower, start.shape))
        self.upper = self.planes(np.broadcast_to(problem.upper, start.shape))
        self._scale = 1.0
        self._certifying = self._hessian.inverse(np.full(2 * primaries, self.mu))
        planes = self.planes(start)
        data = self.quadratic(planes)[1] - self.mu * (planes - self.anchor)
        if observation.uniform:
            self._target = self._hessian(self.fourier.forward(planes))
            self._target -= self.fourier.forward(data)
        else:
            self._target = self._curved(planes)
            self._target -= data

    def planes(self, light: Light) -> Planes:
        """Planes of `light`, 0 on the padding."""
        views, rows, cols, primaries = light.shape
        result = np.zeros((views * primaries, self.fourier.rows, self.fourier.cols), self.dtype)
        for view in range(views):
            for p in range(primaries):
                result[view * primaries + p, :rows, :cols] = light[view, :, :, p]
        return result

    def light(self, planes: Planes) -> Light:
        """(2, row, col, primary) light of planes."""
        views, rows, cols, primaries = self._observation.shape
        inner = planes[:, :rows, :cols].reshape(views, primaries, rows, cols)
        return np.ascontiguousarray(np.moveaxis(inner, 1, -1))

    def prepare(self, floor: float) -> None:
        """Scale H_0 up where H is too far above it."""
        if self._observation.uniform:
            return
        inverse = self._hessian.inverse(floor * self.metric)
        weight = (floor * self.metric).astype(self.dtype)[:, None, None]
        x = np.random.default_rng(0).standard_normal(self.lower.shape).astype(self.dtype)
        largest = 1.0
        for _ in range(_POWER_STEPS):
            image = self._curved(x) + weight * x
            x = self.fourier.inverse(inverse(self.fourier.forward(image)))
            largest = float(np.sqrt(dot(x, x)))
            x /= self.dtype.type(largest)
        # The norm after normalisation; short of the limit by some tenths
        if largest > _SAFE:
            self._scale = 1.5 * largest

    def inverse(self, rho: float) -> SpectralMap:
        """(H_0 + rho P)^-1, of H_0 scaled up where that is needed."""
        plain = self._hessian.inverse(rho * self.metric / self._scale)
        if self._scale == 1:
            return plain
        share = self.dtype.type(1 / self._scale)
        return lambda spectrum: share * plain(spectrum)

    def step(self, inverse: SpectralMap, weight: Planes, towards: Planes, last: Planes) -> Planes:
        """The x-step: exact where crosstalk is uniform, else one iteration nearer to it."""
        if self._observation.uniform:
            right = self.fourier.forward(weight * towards)
            right += self._target
            return self.fourier.inverse(inverse(right))
        remainder = weight * (towards - last)
        remainder += self._target
        remainder -= self._curved(last)
        return last + self.fourier.inverse(inverse(self.fourier.forward(remainder)))

    def nearest(self, planes: Planes, weight: Planes) -> Planes:
        """The z-step: the regulariser's and the bounds' proximal map."""
        mu = self.dtype.type(self.mu)
        z = weight * planes
        z += mu * self.anchor
        z /= weight + mu
        return np.clip(z, self.lower, self.upper, out=z)

    def quadratic(self, planes: Planes) -> tuple[float, Planes]:
        """Cost, and gradient on the picture, with two FFTs a channel of each seen view."""
        cost, gradient = self._problem.quadratic(self.light(planes))
        return cost, self.planes(gradient)

    def gap(self, planes: Planes, gradient: Planes) -> float:
        """Certified upper bound of the cost's distance from the minimum."""
        return gap_bound(self._dual_energy, planes, gradient, (self.lower, self.upper))

    def _dual_energy(self, free: Planes) -> float:
        """Return g' H^-1 g: exact where crosstalk is uniform, else bounded from above."""
        spectrum = self.fourier.forward(free)
        preconditioned = self._certifying(spectrum)
        if self._observation.uniform:
            return self._dot(spectrum, preconditioned)
        remainder = free.copy()
        direction = step = self.fourier.inverse(preconditioned)
        y = np.zeros_like(free)
        product = dot(remainder, step)
        best = np.inf
        for _ in range(_STEPS):
            image = self._curved(direction) + self.mu * direction
            length = product / dot(direction, image)
            y += self.dtype.type(length) * direction
            remainder -= self.dtype.type(length) * image
            rest = dot(remainder, remainder) / self.mu
            known = dot(y, free + remainder)
            best = min(best, known + rest)
            if rest <= _ENOUGH * known:
                break
            step = self.fourier.inverse(self._certifying(self.fourier.forward(remainder)))
            previous, product = product, dot(remainder, step)
            direction = step + self.dtype.type(product / previous) * direction
        return best

    def _curved(self, planes: Planes) -> Planes:
        """C'A'A C of planes: on the padding, where nothing is projected, C is the central one."""
        seen = self._mixed(planes, self._central, self._observation.linear)
        spectrum = self.fourier.forward(seen)
        spectrum = self._weighted(spectrum)
        back = self.fourier.inverse(spectrum)
        turned = np.transpose(self._central, (2, 3, 0, 1))
        result = self._mixed(back, turned, self._observation.adjoint)
        return result.astype(self.dtype, copy=False)

    def _mixed(self, planes: Planes, matrix: Any, on_picture: Any) -> Planes:
        views, primaries = matrix.shape[:2]
        flat = matrix.reshape(views * primaries, -1).astype(self.dtype)
        _, rows, cols, _ = self._observation.shape
        result = np.tensordot(flat, planes, 1)
        inner = planes[:, :rows, :cols].reshape(-1, primaries, rows, cols)
        seen = on_picture(np.ascontiguousarray(np.moveaxis(inner, 1, -1)))
        result[:, :rows, :cols] = np.moveaxis(seen, -1, 1).reshape(-1, rows, cols)
        return result

    def _weighted(self, spectrum: Spectrum) -> Spectrum:
        """A'A of seen planes, view by view."""
        weighting = self._weighting
        primaries = weighting.opponent.shape[1]
        opponent = weighting.opponent.astype(self.dtype)
        squares = weighting.gains.astype(self.dtype) ** 2
        result = np.empty_like(spectrum)
        for view, importance in enumerate(weighting.importance):
            part = slice(view * primaries, (view + 1) * primaries)
            channels = np.tensordot(opponent, spectrum[part], 1)
            channels *= squares
            result[part] = self.dtype.type(importance) * np.tensordot(opponent.T, channels, 1)
        return result

    def _dot(self, left: Spectrum, right: Spectrum) -> float:
        return sum(self.fourier.dot(a, b) for a, b in zip(left, right, strict=True))


class _Hessian:
    """H_0 for each frequency, in blocks: of the views, or of their sum and difference."""

    def __init__(self, central: Any, weighting: CsfWeighting, dtype: np.dtype[Any]) -> None:
        seen, primaries = central.shape[:2]
        self._dtype = dtype
        squares = [gain.astype(dtype) ** 2 for gain in weighting.gains]
        channels = len(weighting.opponent)
        shared = len(squares) == 1
        coefficients = np.zeros((len(squares), 2 * primaries, 2 * primaries))
        for view in range(seen):
            mixing = central[view].reshape(primaries, 2 * primaries)
            for c in range(channels):
                u = weighting.opponent[c] @ mixing
                coefficients[0 if shared else c] += weighting.importance[view] * np.outer(u, u)
        turn = np.kron(np.array([[1, 1], [1, -1]]) / np.sqrt(2), np.eye(primaries))
        turned = turn @ coefficients @ turn.T
        apart = np.abs(turned[:, :primaries, primaries:]).max() <= 1e-9 * np.abs(turned).max()
        self._summed = bool(apart)
        parts = [slice(0, 2 * primaries)]
        if apart:
            coefficients = turned
            parts = [slice(0, primaries), slice(primaries, 2 * primaries)]
        self._parts = parts
        self._blocks = [_planes_of(coefficients[:, part, part], squares) for part in parts]

    def __call__(self, spectrum: Spectrum) -> Spectrum:
        return self._apply(self._blocks, spectrum)

    def inverse(self, sigma: Any) -> SpectralMap:
        """(H_0 + diag(sigma))^-1, sigma (plane,) the same for both views."""
        inverses = []
        for part, blocks in zip(self._parts, self._blocks, strict=True):
            damped = [list(row) for row in blocks]
            for k, value in enumerate(sigma[part]):
                damped[k][k] = damped[k][k] + self._dtype.type(value)
            inverses.append(inverted(damped))
        return lambda spectrum: self._apply(inverses, spectrum)

    def _apply(self, blocks: Any, spectrum: Spectrum) -> Spectrum:
        if not self._summed:
            return blocks_times(blocks[0], spectrum)
        turned = _sum_and_difference(spectrum)
        for b, part in zip(blocks, self._parts, strict=True):
            turned[part] = blocks_times(b, turned[part])
        result = _sum_and_difference(turned)
        result *= self._dtype.type(0.5)
        return result


def _sum_and_difference(spectrum: Spectrum) -> Spectrum:
    """L + R and L - R; done twice, twice the spectrum."""
    half = len(spectrum) // 2
    result = np.empty_like(spectrum)
    np.add(spectrum[:half], spectrum[half:], out=result[:half])
    np.subtract(spectrum[:half], spectrum[half:], out=result[half:])
    return result


def _planes_of(coefficients: Any, squares: list[Any]) -> list[list[Any]]:
    """Symmetric matrix of planes: sums of Omega_c² times (channel, i, j) coefficients."""
    size = coefficients.shape[1]
    blocks: list[list[Any]] = [[None] * size for _ in range(size)]
    for i in range(size):
        for j in range(i, size):
            block = sum(
                square.dtype.type(weight) * square
                for weight, square in zip(coefficients[:, i, j], squares, strict=True)
            )
            blocks[i][j] = blocks[j][i] = block
    return blocks
