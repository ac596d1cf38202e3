"""The light within its bounds that is nearest in opponent channels, pixel by pixel.

    min_d  1/2 (T d - s)' R (T d - s) + 1/2 M |d - o|²,     lower <= d <= upper

Without bounds, and with one M for all pixels and no o, it is v = (Q + M)^-1 T' R s, Q = T' R T.
Where that is out of bounds, the primaries are set to their best, one after the other, and again
(projected Gauss-Seidel, over-relaxed: it converges for any bounds, as Q + M is positive definite;
Cottle, Pang & Stone 1992, *The Linear Complementarity Problem*, section 5.2). The compiled loops
find the active set instead, from that of the step before (`compiled.searched3`).

Where M differs from pixel to pixel, or there is an o, the same sweeps go on from there; as M is
small, one or two do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import numpy as np

from compensate.solver.hessian import combined, mixed
from domesim.light import Array, namespace

if TYPE_CHECKING:
    from compensate.solver.level import Planes
    from compensate.solver.opponent_level import OpponentLevel

_RELAXATION = 1.15
_SWEEPS = 200
_SETTLED = 250.0  # roundings: the sweeps end where no light moves by more


@final
class Nearest:
    """For one level and its weights.

    Parameters
    ----------
    level
        Whose bounds, damping M, offset o and T they are.
    weights
        R's diagonal, one a channel.
    """

    def __init__(self, level: OpponentLevel, weights: list[float]) -> None:
        self._level = level
        opponent = level.opponent
        back = opponent.T * np.asarray(weights)
        # Of M: sweeps do the rest
        self._least = level.damping if isinstance(level.damping, float) else level.least_damping
        self._coupled = back @ opponent + self._least * np.eye(len(opponent))
        self._free = np.linalg.solve(self._coupled, back)
        self._plain = isinstance(level.damping, float) and level.offset is None

    @property
    def compiled(self) -> bool:
        """Whether the compiled loops can do it."""
        return len(self._coupled) == 3 and self._level.offset is None

    def numbers(self, dtype: Any) -> tuple[Any, ...]:
        """What the compiled loops take."""
        level, number = self._level, dtype.type
        damping = number(level.damping) if isinstance(level.damping, float) else level.damping
        return (
            *(*level.bounds_as_numbers, damping, number(self._least)),
            *(matrix.astype(dtype) for matrix in (self._free, self._coupled, level.opponent)),
        )

    def __call__(self, s: Planes, rows: slice) -> Planes:
        """(row, col) planes of light's rows, for s (channel), padded planes."""
        level = self._level
        cols = level.lower[0].shape[1]
        strip = [plane[rows, :cols] for plane in s]
        bounds = [level.bounds(p, rows) for p in range(len(strip))]
        xp = namespace(strip[0])
        v = mixed(self._free, strip)
        z = [xp.minimum(xp.maximum(x, low), high) for x, (low, high) in zip(v, bounds, strict=True)]
        if not self._plain:
            damping = level.damping_of(rows)
            pull = level.offset and [damping * plane[rows, :] for plane in level.offset]
            self._sweep(z, v, bounds, damping - self._least, pull)
            return z
        if not isinstance(strip[0], np.ndarray):
            self._sweep(z, v, bounds)
            return z
        out = z[0] != v[0]
        for x, y in zip(z[1:], v[1:], strict=True):
            out |= x != y
        places = np.flatnonzero(out)
        if places.size:
            del out
            light = [x.ravel()[places] for x in z]
            limits = [(low.ravel()[places], high.ravel()[places]) for low, high in bounds]
            bounds.clear()
            free = [v.pop(0).ravel()[places] for _ in light]
            self._sweep(light, free, limits)
            for plane, found in zip(z, light, strict=True):
                plane.reshape(-1)[places] = found
        return z

    def _sweep(
        self,
        z: Planes,
        v: Planes,
        bounds: list[tuple[Array, Array]],
        extra: Any = None,
        pull: Planes | None = None,
    ) -> None:
        """Sweeps from z, in place, until it is the best.

        Of (z - v)' (Q + M) (z - v) / 2, and of extra |z|² / 2 - pull z if there are these.
        """
        xp, least = namespace(z[0]), _settled(z[0].dtype)
        away = [x - y for x, y in zip(z, v, strict=True)]
        for _ in range(_SWEEPS):
            moved = 0.0
            for p, (low, high) in enumerate(bounds):
                slope: Any = combined(away, self._coupled[p])
                curvature: Any = float(self._coupled[p, p])
                if pull is not None:
                    slope -= pull[p]
                if extra is not None:
                    slope += extra * z[p]
                    curvature = curvature + extra
                slope *= _RELAXATION / curvature
                best = xp.minimum(xp.maximum(z[p] - slope, low), high)
                moved = max(moved, float(xp.max(xp.abs(best - z[p]))))
                z[p] = best
                away[p] = best - v[p]
            if moved <= least:
                break


def _settled(dtype: Any) -> float:
    """The least move of light, of white, for another sweep."""
    return _SETTLED * float(np.finfo(str(dtype).rpartition(".")[2]).eps)
