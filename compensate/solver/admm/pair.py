"""A stereo problem for ADMM in what is seen: Fourier diagonalises it whatever the crosstalk.

Crosstalk mixes no pixels: each has a small matrix M of its own, of views and primaries, the same
for all pixels or not. So the variable is what all eyes see, w = M (x - x_a), and only the z-step
has to do with M: of one pixel's light d, two views and a few primaries,

    min_d  sum over eyes and primaries of P (M d - wanted)²,     lower <= d <= upper

Where primaries do not mix, two lights are found at once. The best of them is the one without bounds
if it lies within them, else the better of two candidates, each with one light at its bound. (At the
edge of another light alone, d would have to be drawn beyond it, where the free one is not.) Where
primaries leak into others, these pairs are solved in turn, again and again.

Eyes are left, right, left, right, ... of one seat after the other; planes of light are all
primaries of the left view and then those of the right one; planes of what is seen, those of each
eye.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias, final

import numpy as np

from compensate.problem import Problem
from compensate.solver.admm.fused import loops
from compensate.solver.admm.hessian import Planes, ViewsHessian
from compensate.solver.admm.level import Bounds, Level, Mixing
from compensate.solver.admm.planes import Split, planes_of, widths_of
from compensate.solver.admm.pyramid import Value, halved_value, rows_of
from compensate.weighting import CsfWeighting
from domesim.light import Light, namespace
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.seats import SeveralSeats
from domesim.observation.stereo import StereoObservation

Two: TypeAlias = tuple[Any, Any]
"""Values of the left view, and of the right one."""

_ROUNDS = 60  # of leaks into other primaries: each makes them less by a factor of them
_SWEEPS = 4  # over mixed primaries: ADMM does with nearly the best, its certificate holds for any
_SETTLED, _LEAST = 1e-7, 1e-30


def split_pair(problem: Problem, weighting: CsfWeighting) -> Split:
    """A problem of two views, from one seat or several, in what is seen."""
    observation: Any = problem.observation
    base: Any = problem.anchor
    lower = namespace(base).broadcast_to(problem.lower, base.shape)
    level = Level(
        ViewsHessian(weighting, weighting.squares(base), weighting.fourier),
        Eyes.of(observation, base),
        problem.regularisation,
        planes_of(lower - base),
        widths_of(problem),
    )
    return Split(problem, level)


@final
@dataclass(frozen=True)
class Eyes(Mixing):
    """Eye e sees ``own[e][p] d[v, p] + share[e][p] sum_q leak[e][p][q] d[1 - v, q]``, v = e mod 2.

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
    def of(observation: StereoObservation, like: Light) -> Eyes:
        """The eyes of an observation, with planes of `like`'s library."""
        if isinstance(observation, SeveralSeats):
            each = [Eyes.of(seat, like) for seat in observation.seats]
            own, share, leak = (
                [e for one in lists for e in one]
                for lists in zip(*((one.own, one.share, one.leak) for one in each), strict=True)
            )
            return Eyes(own, share, leak)
        primaries = like.shape[3]
        if isinstance(observation, Crosstalk):
            maps = [_value(plane, like) for plane in observation.share]
            ones = [[1.0] * primaries] * 2
            return Eyes(ones, [[s] * primaries for s in maps], observation.matrices.tolist())
        own, share = (
            [[_value(array[v, :, :, p], like) for p in range(primaries)] for v in range(2)]
            for array in observation.slopes(like)
        )
        return Eyes(own, share, [np.eye(primaries).tolist()] * 2)

    @property
    def primaries(self) -> int:
        """Number of primaries."""
        return len(self.own[0])

    @cached_property
    def mixed(self) -> bool:
        """Whether primaries leak into others."""
        return bool(np.any(np.asarray(self.leak) * (1 - np.eye(self.primaries))))

    def coarser(self) -> Eyes:
        """See `Mixing`."""
        own, share = (
            [[halved_value(value) for value in values] for values in each]
            for each in (self.own, self.share)
        )
        return Eyes(own, share, self.leak)

    def seen(self, light: Planes, rows: slice) -> Planes:
        """See `Mixing`."""
        count, result = self.primaries, []
        for e, p in np.ndindex(len(self.own), count):
            v = e % 2
            leaked = _sum(self.leak[e][p], light[(1 - v) * count :][:count])
            plane = _scaled(light[v * count + p], rows_of(self.own[e][p], rows))
            if leaked is not None:
                plane = plane + _scaled(leaked, rows_of(self.share[e][p], rows))
            result.append(plane)
        return result

    def back(self, gradient: Planes, rows: slice) -> Planes:
        """See `Mixing`."""
        count = self.primaries
        result: list[Any] = [0.0] * (2 * count)
        for e, p in np.ndindex(len(self.own), count):
            v, plane = e % 2, gradient[e * count + p]
            result[v * count + p] = (
                _scaled(plane, rows_of(self.own[e][p], rows)) + result[v * count + p]
            )
            shared = _scaled(plane, rows_of(self.share[e][p], rows))
            for q, leak in enumerate(self.leak[e][p]):
                if leak:
                    result[(1 - v) * count + q] = shared * leak + result[(1 - v) * count + q]
        return result

    def light(self, seen: Planes, rows: slice) -> Planes:
        """See `Mixing`: (M'M)^-1 M'."""
        return self._best(seen, [1.0] * len(seen), rows)

    def forward(self, gradient: Planes, rows: slice) -> Planes:
        """See `Mixing`."""
        return self.seen(self._solved(gradient, [1.0] * len(self.own) * self.primaries, rows), rows)

    def curvature(self, p: int, rows: slice) -> Value:
        """See `Mixing`."""
        v, q = divmod(p, self.primaries)
        squares = [value * value * 1.0 for value in self._column(v, q, rows).values()]
        return sum(squares[1:], start=squares[0])

    def nearest(
        self, wanted: Planes, metric: Sequence[float], bounds: Bounds, rows: slice
    ) -> Planes:
        """See `Mixing`; where primaries mix, d is only near the nearest."""
        free = self._best(wanted, metric, rows)
        xp = namespace(free[0])
        if not self.mixed:
            pairs = []
            for p, q in ((p, p + self.primaries) for p in range(self.primaries)):
                lower, upper = zip(bounds[p], bounds[q], strict=True)
                block = self._alone(p, metric, rows)
                pairs.append(nearest_of_two((free[p], free[q]), lower, upper, *block))
            return [pair[v] for v in range(2) for pair in pairs]
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
        found = Eyes(own, share, self.leak).swept(
            [there(plane) for plane in wanted],
            [there(plane) for plane in result],
            metric,
            [(there(lower), there(upper)) for lower, upper in bounds],
        )
        for plane, new in zip(result, found, strict=True):
            plane[beyond] = new
        return result

    def swept(
        self,
        wanted: Planes,
        light: Planes,
        metric: Sequence[float],
        bounds: Bounds,
        sweeps: int = _SWEEPS,
    ) -> Planes:
        """`nearest` of each primary in turn, from `light` within the bounds.

        Planes are of any shape. With few `sweeps` it is only near the nearest.
        """
        count, light = self.primaries, list(light)
        everything = slice(None)
        missing = [m - w for m, w in zip(self.seen(light, everything), wanted, strict=True)]
        # What each primary of the left view shows to all eyes, and of the right one
        columns = [
            (self._column(0, p, everything), self._column(1, p, everything)) for p in range(count)
        ]
        curvature = [_curvature(*both, metric) for both in columns]
        for _ in range(sweeps):
            steps = []
            for p, (hx, hy, cross) in enumerate(curvature):
                g, h = (
                    sum(c * metric[r] * missing[r] for r, c in each.items()) for each in columns[p]
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

    def compiled(self, level: Level, s: Planes, weights: Sequence[float]) -> Planes | None:
        """See `Mixing`: for one seat whose leaks stay in their primaries."""
        half = len(weights) // 2
        alike = len(self.own) == 2 and weights[:half] == weights[half:]
        compiled = loops(*s) if alike and not self.mixed else None
        if not compiled:
            return None
        count, number = self.primaries, s[0].dtype.type
        z = [np.empty_like(lower) for lower in level.lower]

        def given(value: Value) -> Any:
            return number(value) if isinstance(value, float) else value

        for p, q in ((p, p + count) for p in range(count)):
            own = [self.own[e][p] for e in range(2)]
            other = [self.share[e][p] * self.leak[e][p][p] for e in range(2)]
            shrink = weights[p] / (weights[p] + level.damping)
            compiled.nearest_pair(
                *(z[p], z[q], s[p], s[q], level.lower[p], level.lower[q]),
                *map(given, (*own, *other, level.width[p], level.width[q], shrink)),
            )
        return z

    def _best(self, wanted: Planes, metric: Sequence[float], rows: slice) -> Planes:
        """The d for which M d is nearest to what is wanted."""
        counted = [plane * each for plane, each in zip(wanted, metric, strict=True)]
        return self._solved(self.back(counted, rows), metric, rows)

    def _solved(self, right: Planes, metric: Sequence[float], rows: slice) -> Planes:
        """(M'P M)^-1 of planes: each primary alone, then leaks between primaries by iteration."""
        count = self.primaries
        blocks = [self._alone(p, metric, rows) for p in range(count)]

        def alone(planes: Planes) -> Planes:
            pairs = [
                _solved_two(*block, planes[p], planes[p + count]) for p, block in enumerate(blocks)
            ]
            return [pair[v] for v in range(2) for pair in pairs]

        result = alone(right)
        for _ in range(_ROUNDS if self.mixed else 0):
            seen = zip(self.seen(result, rows), metric, strict=True)
            images = self.back([plane * each for plane, each in seen], rows)
            step = alone([r - image for r, image in zip(right, images, strict=True)])
            result = [r + s for r, s in zip(result, step, strict=True)]
            if _settled(step, result):
                break
        return result

    def _alone(self, p: int, metric: Sequence[float], rows: slice) -> tuple[Any, Any, Any]:
        """M'P M of a primary by itself: its diagonal, and the other entry."""
        return _curvature(self._column(0, p, rows), self._column(1, p, rows), metric)

    def _column(self, v: int, p: int, rows: slice) -> dict[int, Value]:
        """M's entries of a primary of a view that are not 0, by the plane that sees it."""
        count, found = self.primaries, {}
        for e in range(len(self.own)):
            if e % 2 == v:
                found[e * count + p] = rows_of(self.own[e][p], rows)
                continue
            for r in range(count):
                if self.leak[e][r][p]:
                    found[e * count + r] = self.leak[e][r][p] * rows_of(self.share[e][r], rows)
        return found


def nearest_of_two(free: Two, lower: Two, upper: Two, hx: Any, hy: Any, cross: Any) -> Two:
    """The d within bounds that is nearest to `free` in the metric of 2 x 2 matrices.

    Parameters
    ----------
    free, lower, upper
        Both views' light without bounds, and the bounds.
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
    # Each view's best light where the other's is at its bound
    x2, y2 = clipped(x - cross / hx * dy, 0), clipped(y - cross / hy * dx, 1)
    u, v = x2 - x, y2 - y
    first = u * (hx * u + 2 * cross * dy) + hy * dy * dy
    second = v * (hy * v + 2 * cross * dx) + hx * dx * dx
    return xp.where(first <= second, x2, x1), xp.where(first <= second, y1, y2)


def _value(plane: Any, like: Light) -> Value:
    """A plane in `like`'s library; a number if it has only 1 x 1 pixels."""
    if plane.shape == (1, 1):
        return float(plane[0, 0])
    return namespace(like).asarray(plane, dtype=like.dtype, device=like.device)


def _scaled(plane: Any, value: Value) -> Any:
    """A plane times a value, which often is 1."""
    return plane if isinstance(value, float) and value == 1 else plane * value


def _sum(weights: Sequence[float], planes: Planes) -> Any:
    """Weighted sum of planes; None where all weights are 0."""
    result = None
    for weight, plane in zip(weights, planes, strict=True):
        if weight:
            term = plane * weight
            result = term if result is None else result + term
    return result


def _solved_two(hx: Any, hy: Any, cross: Any, g: Any, h: Any) -> Two:
    """Solves [[hx, cross], [cross, hy]] d = (g, h) for d."""
    scale = 1 / (hx * hy - cross * cross)
    return g * (hy * scale) - h * (cross * scale), h * (hx * scale) - g * (cross * scale)


def _curvature(
    left: dict[int, Value], right: dict[int, Value], metric: Sequence[float]
) -> tuple[Any, Any, Any]:
    """H = M' P M of a primary of both views: its diagonal, and the other entry."""

    def product(one: dict[int, Value], other: dict[int, Value]) -> Any:
        terms = [one[at] * other[at] * metric[at] for at in one.keys() & other.keys()]
        return sum(terms)

    return product(left, left), product(right, right), product(left, right)


def _settled(steps: Planes, values: Planes) -> bool:
    """Whether steps are negligible beside the values, at a precision that rounding allows."""
    xp = namespace(values[0])
    scale = max(_LEAST, *(float(xp.max(xp.abs(plane))) for plane in values))
    share = max(_SETTLED, 2 * float(xp.finfo(values[0].dtype).eps))
    return max(float(xp.max(xp.abs(plane))) for plane in steps) <= share * scale
