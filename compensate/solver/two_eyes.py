"""What two eyes see of both views' light, pixel by pixel, and the light that shows it best.

Crosstalk mixes no pixels: each has a small matrix M of its own, of views and primaries. Planes are
(row, col), all primaries of the left view and then those of the right one; what is done with them
is done with strips of their rows.

The light d within its bounds that shows best what is wanted,

    min_d  sum over eyes and primaries of K² (M d - wanted)²,     lower <= d <= upper

is M^-1 wanted where that is within the bounds. Where it is not, and primaries do not mix, the best
light of both eyes lies on the edge of one that is out of bounds: the better of two candidates. (At
the edge of another light alone, d would have to be drawn beyond it, where M^-1 wanted is not.)
Where primaries leak into others, these problems of one primary are solved in turn, again and again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias, final

import numpy as np

from compensate.solver.level import Planes, Value, coarsened_value, rows_of
from domesim.light import Array, Light, namespace
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.stereo import StereoObservation

Two: TypeAlias = tuple[Any, Any]
"""Of the left view, and of the right one."""

_ROUNDS = 60  # of leaks into other primaries: each makes them less by a factor of them
_SWEEPS = 4  # over mixed primaries: ADMM does with nearly the best, its certificate holds for any
_SETTLED, _LEAST = 1e-7, 1e-30


@final
@dataclass(frozen=True)
class TwoEyes:
    """M: eye v sees ``own[v][p] d[v, p] + share[v][p] sum_q leak[v][p][q] d[1 - v, q]``.

    Attributes
    ----------
    own, share
        By eye and primary.
    leak
        By eye, primary that is seen, and primary that is shown.
    """

    own: Sequence[Sequence[Value]]
    share: Sequence[Sequence[Value]]
    leak: Sequence[Sequence[Sequence[float]]]

    @staticmethod
    def of(observation: StereoObservation, like: Light) -> TwoEyes:
        """Those of an observation of one seat, as planes of `like`'s library."""
        primaries = like.shape[3]
        if isinstance(observation, Crosstalk):
            maps = [_value(plane, like) for plane in observation.share]
            leak = observation.matrices.tolist()
            return TwoEyes([[1.0] * primaries] * 2, [[s] * primaries for s in maps], leak)
        own, other = (
            [[_value(array[v, :, :, p], like) for p in range(primaries)] for v in range(2)]
            for array in observation.slopes(like)
        )
        return TwoEyes(own, other, [np.eye(primaries).tolist()] * 2)

    @property
    def primaries(self) -> int:
        """How many there are."""
        return len(self.own[0])

    @cached_property
    def mixed(self) -> bool:
        """Whether primaries leak into others."""
        return bool(np.any(np.asarray(self.leak) * (1 - np.eye(self.primaries))))

    def coarser(self) -> TwoEyes:
        """The same on planes of half the rows and columns."""
        own, share = (
            [[coarsened_value(value) for value in values] for values in each]
            for each in (self.own, self.share)
        )
        return TwoEyes(own, share, self.leak)

    def alone(self, p: int, rows: slice) -> tuple[Two, Two]:
        """A primary's own part of M: what both eyes see of their own light, and of the other's."""
        own, share = (
            [rows_of(values[v][p], rows) for v in range(2)] for values in (self.own, self.share)
        )
        return (own[0], own[1]), (share[0] * self.leak[0][p][p], share[1] * self.leak[1][p][p])

    def seen(self, light: Planes, rows: slice) -> Planes:
        """M d of strips."""
        result = []
        for v, p in np.ndindex(2, self.primaries):
            other = [light[(1 - v) * self.primaries + q] for q in range(self.primaries)]
            leaked = _sum(self.leak[v][p], other)
            plane = _scaled(light[v * self.primaries + p], rows_of(self.own[v][p], rows))
            if leaked is not None:
                plane = plane + _scaled(leaked, rows_of(self.share[v][p], rows))
            result.append(plane)
        return result

    def back(self, gradient: Planes, rows: slice) -> Planes:
        """M' g of strips."""
        shared = [
            _scaled(gradient[v * self.primaries + p], rows_of(self.share[v][p], rows))
            for v, p in np.ndindex(2, self.primaries)
        ]
        result = []
        for v, p in np.ndindex(2, self.primaries):
            column = [self.leak[1 - v][q][p] for q in range(self.primaries)]
            leaked = _sum(column, shared[(1 - v) * self.primaries :][: self.primaries])
            plane = _scaled(gradient[v * self.primaries + p], rows_of(self.own[v][p], rows))
            result.append(plane if leaked is None else plane + leaked)
        return result

    def unmixed(self, seen: Planes, rows: slice) -> Planes:
        """M^-1 of strips."""
        return self._inverse(seen, rows, transposed=False)

    def unmixed_back(self, gradient: Planes, rows: slice) -> Planes:
        """M'^-1 of strips."""
        return self._inverse(gradient, rows, transposed=True)

    def nearest(
        self, wanted: Planes, k: Two, metric: Sequence[Value], bounds: Sequence[Two], rows: slice
    ) -> Planes:
        """The light within its bounds that shows best what is wanted.

        Parameters
        ----------
        wanted
            Strips of it.
        k
            K of both eyes: strips of K.
        metric
            (primary,) factors of K², numbers or strips; they count only where primaries mix.
        bounds
            Lower and upper ones, of each strip.
        rows
            Which rows they are.
        """
        free = self.unmixed(wanted, rows)
        squares = k[0] * k[0], k[1] * k[1]
        if self.mixed:
            return self._nearest_mixed(wanted, free, squares, metric, bounds, rows)
        count = self.primaries
        result = list(free)
        for p, q in ((p, p + count) for p in range(count)):
            lower, upper = zip(bounds[p], bounds[q], strict=True)
            h = _curvature(squares, *self.alone(p, rows))
            result[p], result[q] = nearest_of_two((free[p], free[q]), lower, upper, *h)
        return result

    def _inverse(self, values: Planes, rows: slice, *, transposed: bool) -> Planes:
        """Of each primary by itself, and of leaks into others little by little."""
        count = self.primaries
        matrix = self.back if transposed else self.seen

        def alone(planes: Planes) -> Planes:
            result = list(planes)
            for p, q in ((p, p + count) for p in range(count)):
                own, other = self.alone(p, rows)
                if transposed:
                    other = other[1], other[0]
                result[p], result[q] = _solved_pair(own, other, planes[p], planes[q])
            return result

        result = alone(values)
        for _ in range(_ROUNDS if self.mixed else 0):
            missing = [v - m for v, m in zip(values, matrix(result, rows), strict=True)]
            step = alone(missing)
            result = [r + s for r, s in zip(result, step, strict=True)]
            if _settled(step, result):
                break
        return result

    def _nearest_mixed(
        self,
        wanted: Planes,
        free: Planes,
        squares: Two,
        metric: Sequence[Value],
        bounds: Sequence[Two],
        rows: slice,
    ) -> Planes:
        xp = namespace(free[0])
        result = [xp.minimum(xp.maximum(d, a), b) for d, (a, b) in zip(free, bounds, strict=True)]
        beyond = result[0] != free[0]
        for d, start in zip(result[1:], free[1:], strict=True):
            beyond = beyond | (d != start)
        if not bool(xp.any(beyond)):
            return result

        def there(value: Any) -> Any:
            return value if isinstance(value, float) else value[beyond]

        own, share = (
            [[there(rows_of(value, rows)) for value in values] for values in each]
            for each in (self.own, self.share)
        )
        found = TwoEyes(own, share, self.leak).nearest_mixed(
            [there(plane) for plane in wanted],
            [there(plane) for plane in result],
            (there(squares[0]), there(squares[1])),
            [there(value) for value in metric],
            [(there(lower), there(upper)) for lower, upper in bounds],
        )
        for plane, new in zip(result, found, strict=True):
            plane[beyond] = new
        return result

    def nearest_mixed(
        self,
        wanted: Planes,
        light: Planes,
        squares: Two,
        metric: Sequence[Value],
        bounds: Sequence[Two],
        sweeps: int = _SWEEPS,
    ) -> Planes:
        """`nearest` where primaries mix: of each in turn, from `light` within the bounds.

        Planes are of any shape; `squares` are K² of both eyes. With few `sweeps` it is only near
        the nearest, the less so the more often an eye's contrast is the other's.
        """
        count, light = self.primaries, list(light)
        missing = [m - w for m, w in zip(self.seen(light, slice(None)), wanted, strict=True)]
        weights = [squares[v] * metric[r] for v, r in np.ndindex(2, count)]
        # What each primary of the left view shows to both eyes, and of the right one
        columns = [(self._column(0, p), self._column(1, p)) for p in range(count)]
        curvature = [_curvature_of(*both, weights) for both in columns]
        for _ in range(sweeps):
            steps = []
            for p, (hx, hy, cross) in enumerate(curvature):
                g, h = (
                    sum(c * weights[r] * missing[r] for r, c in each.items()) for each in columns[p]
                )
                determinant = hx * hy - cross * cross
                old = light[p], light[p + count]
                free = (
                    old[0] - (hy * g - cross * h) / determinant,
                    old[1] - (hx * h - cross * g) / determinant,
                )
                lower, upper = zip(bounds[p], bounds[p + count], strict=True)
                new = nearest_of_two(free, lower, upper, hx, hy, cross)
                light[p], light[p + count] = new
                for column, after, before in zip(columns[p], new, old, strict=True):
                    step = after - before
                    for r, c in column.items():
                        missing[r] = missing[r] + c * step
                    steps.append(step)
            if _settled(steps, light):
                break
        return light

    def _column(self, v: int, p: int) -> dict[int, Value]:
        """M's entries of a primary of a view that are not 0, by the plane that sees it."""
        count, u = self.primaries, 1 - v
        leaked = {
            u * count + r: self.leak[u][r][p] * self.share[u][r]
            for r in range(count)
            if self.leak[u][r][p]
        }
        return {v * count + p: self.own[v][p], **leaked}


def nearest_of_two(free: Two, lower: Two, upper: Two, hx: Any, hy: Any, cross: Any) -> Two:
    """The d within bounds that is nearest to `free` in the metric of 2 x 2 matrices.

    Parameters
    ----------
    free, lower, upper
        Both eyes' light without bounds, and the bounds.
    hx, hy, cross
        Diagonal, and the other entry, of the matrices H.
    """
    xp = namespace(free[0])

    def clipped(light: Any, v: int) -> Any:
        return xp.minimum(xp.maximum(light, lower[v]), upper[v])

    x, y = free
    x1, y1 = clipped(x, 0), clipped(y, 1)
    dx, dy = x1 - x, y1 - y
    if not (bool(xp.any(dx != 0)) or bool(xp.any(dy != 0))):
        return x1, y1
    # Each eye's best light where the other's is at its bound
    x2, y2 = clipped(x - cross / hx * dy, 0), clipped(y - cross / hy * dx, 1)
    u, v = x2 - x, y2 - y
    first = u * (hx * u + 2 * cross * dy) + hy * dy * dy
    second = v * (hy * v + 2 * cross * dx) + hx * dx * dx
    return xp.where(first <= second, x2, x1), xp.where(first <= second, y1, y2)


def _value(plane: Any, like: Light) -> Value:
    """A plane as one of `like`'s library; a number where it is one of 1 x 1."""
    if plane.shape == (1, 1):
        return float(plane[0, 0])
    return namespace(like).asarray(plane, dtype=like.dtype, device=like.device)


def _scaled(plane: Array, value: Value) -> Array:
    """A plane times a value, which often is 1."""
    return plane if isinstance(value, float) and value == 1 else plane * value


def _sum(weights: Sequence[float], planes: Planes) -> Any:
    """Of planes times weights; None where all are 0."""
    result = None
    for weight, plane in zip(weights, planes, strict=True):
        if weight:
            term = plane * weight
            result = term if result is None else result + term
    return result


def _solved_pair(own: Two, other: Two, left: Array, right: Array) -> Two:
    """What solves [[own, other], [other, own]] d = (left, right)."""
    scale = 1 / (own[0] * own[1] - other[0] * other[1])
    return (
        left * (own[1] * scale) - right * (other[0] * scale),
        right * (own[0] * scale) - left * (other[1] * scale),
    )


def _curvature(squares: Two, own: Two, other: Two) -> tuple[Any, Any, Any]:
    """H = M' K² M of a primary by itself: its diagonal, and the other entry."""
    (kl, kr), (a, f), (b, e) = squares, own, other
    return (
        _scaled(kl, a * a) + kr * (e * e),
        kl * (b * b) + _scaled(kr, f * f),
        kl * (a * b) + kr * (e * f),
    )


def _curvature_of(
    left: Mapping[int, Value], right: Mapping[int, Value], weights: Sequence[Any]
) -> tuple[Any, Any, Any]:
    """H = M' K² M of a primary that leaks into others: its diagonal, and the other entry."""

    def product(one: Mapping[int, Value], other: Mapping[int, Value]) -> Any:
        return sum(one[at] * other[at] * weights[at] for at in one.keys() & other.keys())

    return product(left, left), product(right, right), product(left, right)


def _settled(steps: Planes, values: Planes) -> bool:
    """Whether steps are nothing beside the values, to a precision that rounding lets them reach."""
    xp = namespace(values[0])
    scale = max(_LEAST, *(float(xp.max(xp.abs(plane))) for plane in values))
    share = max(_SETTLED, 2 * float(xp.finfo(values[0].dtype).eps))
    return max(float(xp.max(xp.abs(plane))) for plane in steps) <= share * scale
