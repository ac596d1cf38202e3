"""The light within its bounds that is nearest in opponent channels, pixel by pixel.

    min_d  1/2 (T d - s)' R (T d - s) + 1/2 M |d - o|²,     lower <= d <= upper

Without bounds, and with one M for all pixels and no o, it is v = (Q + M)^-1 T' R s, Q = T' R T.
Where one primary alone of v is out of bounds, it is set to the bound and the others to their best
with it: if they are within theirs, this is it, for a constraint that the minimum without it
violates holds with equality at the minimum with it. Elsewhere the primaries are set to their best,
one after the other, and again (projected Gauss-Seidel, over-relaxed: it converges for any bounds,
as Q + M is positive definite; Cottle, Pang & Stone 1992, *The Linear Complementarity Problem*,
section 5.2). The compiled loops find the active set instead, from that of the step before
(`compiled.searched3`).

Where M differs from pixel to pixel, or there is an o, the same sweeps go on from there; as M is
small, one or two do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.solver.hessian import combined, mixed
from domesim.light import Array, namespace

if TYPE_CHECKING:
    from compensate.solver.level import Planes
    from compensate.solver.opponent_level import OpponentLevel

_RELAXATION = 1.15
_SWEEPS = 200
_SETTLED = 20.0  # roundings: the sweeps end where no light moves by more


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
        self._moved = _moved_with(self._coupled)
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
        v = mixed(self._free, strip)
        z, others = self._pinned(v, bounds)
        if not self._plain:
            damping = level.damping_of(rows)
            pull = level.offset and [damping * plane[rows, :] for plane in level.offset]
            self._sweep(z, v, bounds, damping - self._least, pull)
            return z
        if not isinstance(strip[0], np.ndarray):
            self._sweep(z, v, bounds)
            return z
        places = np.flatnonzero(others)
        if places.size:
            light, free = ([x.ravel()[places] for x in planes] for planes in (z, v))
            limits = [(low.ravel()[places], high.ravel()[places]) for low, high in bounds]
            self._sweep(light, free, limits)
            for plane, found in zip(z, light, strict=True):
                plane.reshape(-1)[places] = found
        return z

    def _pinned(self, v: Planes, bounds: list[tuple[Array, Array]]) -> tuple[Planes, Array]:
        """The best light with the primary of v pinned that is out of bounds.

        Returns
        -------
        The light; and where it is but a start, as several are out of bounds.
        """
        xp = namespace(v[0])
        pinned = [_within(x, each) for x, each in zip(v, bounds, strict=True)]
        moves = [light - x for light, x in zip(pinned, v, strict=True)]
        z, others, one = [], None, None
        for p, light in enumerate(pinned):
            best = light + combined(moves, self._moved[p])
            z.append(_within(best, bounds[p]))
            out, moved = z[p] != best, moves[p] != 0
            if others is None:
                others, one = out, moved
            else:
                others, one = others | out | (one & moved), one | moved
        free = xp.asarray(bounds[0][0] < bounds[0][1])
        for low, high in bounds[1:]:
            free |= low < high
        return z, others & free

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


def _within(values: Array, bounds: tuple[Array, Array]) -> Array:
    xp = namespace(values)
    return xp.minimum(xp.maximum(values, bounds[0]), bounds[1])


def _moved_with(coupled: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """(primary, primary) how far each has to go to be the best, for another that goes by 1."""
    inverse = np.linalg.inv(coupled)
    return np.asarray(inverse / np.diag(inverse)) - np.eye(len(coupled))


def _settled(dtype: Any) -> float:
    """The least move of light, of white, for another sweep."""
    return _SETTLED * float(np.finfo(str(dtype).rpartition(".")[2]).eps)
