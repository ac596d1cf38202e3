"""A dome's problem for ADMM: in w = K D x, Fourier diagonalises all but a low-rank part.

K is the problem's contrast, if it has one. The pollution's modes are seen under it as well; the
regulariser mu ||K D x||² is the same for all pixels then.
"""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache
from typing import Any, final

import numpy as np

from compensate.problem import Problem
from compensate.solver.dome_hessian import DomeHessian
from compensate.solver.fused import loops
from compensate.solver.level import BoxLevel, Planes
from compensate.solver.opponent_level import OpponentLevel
from compensate.solver.split import BoxSplit, light_of, planes_of, widths_of
from compensate.weighting import CsfWeighting
from domesim.light import Array, Light, namespace, on_host
from domesim.observation.lowrank import LowRankObservation


@final
class DomeSplit(BoxSplit):
    """The problem in w = K D x; "gain" below is K D.

    Parameters
    ----------
    problem
        One of a `LowRankObservation`.
    by_primary
        Keep planes of primaries, where they could be of opponent channels.
    """

    def __init__(self, problem: Problem, *, by_primary: bool = False) -> None:
        observation = problem.observation
        if not isinstance(observation, LowRankObservation):
            raise ValueError(f"ADMM takes a low-rank observation, got {type(observation).__name__}")
        if problem.stiffness is not None:
            raise ValueError("ADMM takes a dome's problem without a stiffness")
        super().__init__(problem)
        support = self.weighting.support
        if bool(np.any(support & ~observation.screen)):
            raise ValueError("the weighting's support reaches outside the observation's screen")
        xp, base = namespace(self.base), self.base

        def like(array: Any, dtype: Any) -> Array:
            return xp.asarray(array, dtype=dtype, device=base.device)[None, :, :, None]

        self._observation = observation
        gain = observation.factors.direct_gain
        self._gain = None
        if not bool(np.all(gain == 1)):
            self._gain = like(np.where(gain == 0, 1, gain), base.dtype)
        if problem.contrast is not None:
            kept = problem.contrast
            self._gain = kept if self._gain is None else kept * self._gain
        self._support = None if bool(support.all()) else like(support, xp.bool)
        opponent = self.weighting.opponent
        channels, primaries = opponent.shape
        self._opponent = None
        regular = channels == primaries > 1 and np.linalg.cond(opponent) < _REGULAR
        if regular and not by_primary:
            self._opponent = opponent

    def direction(self, planes: Planes) -> Light:
        """The light w / D."""
        light = light_of(planes, 1)
        return light if self._gain is None else light / self._gain

    def from_gradient(self, gradient: Light) -> Planes:
        """1 / D times the gradient in x, on the support."""
        gradient = self._on_support(gradient)
        return planes_of(gradient if self._gain is None else gradient / self._gain)

    def pinned_gradient(self, weighted: Light) -> Planes:
        """See `BoxSplit`: no light goes there."""
        return planes_of(weighted)

    def _finest(self) -> BoxLevel:
        level = super()._finest()
        if self._opponent is None:
            return level
        plain = {each.name: getattr(level, each.name) for each in fields(BoxLevel)}
        plain["least_damping"] /= float(np.linalg.norm(self._opponent, 2)) ** 2
        return OpponentLevel(**plain, opponent=self._opponent)

    def _hessian(self) -> DomeHessian:
        by_channel = self._opponent is not None
        if self.problem.contrast is None:
            return hessian_of(self._observation, self.weighting, self.base, by_channel=by_channel)
        contrast = on_host(self.problem.contrast)[0, :, :, 0]
        return _made(self._observation, self.weighting, self.base, by_channel, contrast)

    def _seen(self, light: Light) -> Light:
        return self._on_support(light if self._gain is None else light * self._gain)

    def _on_support(self, light: Light) -> Light:
        if self._support is None:
            return light
        return light * namespace(light).astype(self._support, light.dtype)

    def _shown(self, plane: Array, rows: slice) -> Array:
        return plane if self._gain is None else plane / self._gain[0, rows, :, 0]

    def _scaled(self, part: Array, rows: slice) -> Array:
        return part if self._gain is None else part * self._gain[0, rows, :, 0]

    def _damping(self) -> tuple[Any, float]:
        mu = self.problem.regularisation
        if self._gain is None or self.problem.contrast is not None:
            return mu, mu
        xp, fourier, base = namespace(self.base), self.weighting.fourier, self.base
        rows, cols = base.shape[1:3]
        around = xp.ones((fourier.rows, fourier.cols), dtype=base.dtype, device=base.device)
        around[:rows, :cols] = self._gain[0, :, :, 0]
        return mu / around**2, mu / max(float(xp.max(around)), 1.0) ** 2

    def _lower(self) -> Planes:
        by_channel = self._opponent is not None and isinstance(self.base, np.ndarray)
        # NumPy's operations hardly notice; the compiled loops take arrays
        return self._lowest() if by_channel and not loops(self.base) else super()._lower()

    def _widths(self) -> list[Array | float]:
        if self._gain is None and self._support is None:
            return widths_of(self.problem)
        one = namespace(self.base).ones_like(self.base[:1, :1, :1, :1])
        return widths_of(self.problem, self._seen(one))


def hessian_of(
    observation: LowRankObservation,
    weighting: CsfWeighting,
    like: Light,
    *,
    by_channel: bool = False,
) -> DomeHessian:
    """The Hessian of w = D x of a theatre, in arrays like `like`; kept for the next frame.

    Of planes of primaries, or T w, `by_channel`.
    """
    return _hessian(observation, weighting, namespace(like), like.dtype, like.device, by_channel)


@lru_cache(maxsize=2)
def _hessian(
    observation: LowRankObservation,
    weighting: CsfWeighting,
    library: Any,
    dtype: Any,
    device: Any,
    by_channel: bool,
) -> DomeHessian:
    like = library.zeros((1, 1, 1, 1), dtype=dtype, device=device)
    return _made(observation, weighting, like, by_channel)


def _made(
    observation: LowRankObservation,
    weighting: CsfWeighting,
    like: Light,
    by_channel: bool,
    contrast: Any = 1.0,
) -> DomeHessian:
    """The Hessian of w = K D x, of K (row, col), or of T w."""
    factors, support, fourier = observation.factors, weighting.support, weighting.fourier

    def modes(planes: Any) -> Array:
        large = np.zeros((len(planes), fourier.rows, fourier.cols))
        large[:, : support.shape[0], : support.shape[1]] = planes * support
        return namespace(like).asarray(large, dtype=like.dtype, device=like.device)

    opponent, planes = weighting.opponent, np.eye(len(factors.core))
    to = opponent if by_channel else planes
    core = np.einsum("cp,pjk,pd->cdjk", to, factors.core, np.linalg.inv(to))
    # In w = K D x, a pixel's light has passed K D already.
    gain = contrast * np.where(factors.direct_gain == 0, 1, factors.direct_gain)
    return DomeHessian(
        modes(factors.spread * contrast),
        modes(factors.collect / gain),
        core,
        planes if by_channel else opponent,
        weighting.squares(like),
        fourier,
    )


_REGULAR = 30.0  # condition of T
