"""How each pixel's light is seen in its own place, and the bounds: ADMM's step in pixels.

All light is relative to a *base* near the solution, exact clipped subtraction: d is its change.
Each pixel has a small matrix M of its own (`AdjointObservation.local`): a dome's lens, the
crosstalk of a pair, from one seat or several. The step in pixels is a bounded least squares of each

    d = argmin 1/2 <M d, P M d> - <r, d>,     lower <= d <= upper

M is nearly the identity, so that solving for one plane of light after the other, again and again,
soon ends (Gauss-Seidel). What the last step found is where the next begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias, final

import numpy as np

from compensate.problem import Problem
from domesim.light import Array, Light, namespace

Planes: TypeAlias = Array
"""(plane, row, col): all primaries of one view after the other."""

Value: TypeAlias = float | Array
"""One value for all pixels, or a (row, col) plane of them."""

_SWEEPS, _MOST_SWEEPS = 4, 60
"""Sweeps of a step, which ADMM takes up again, and of what must be solved to rounding."""


@final
class Pixels:
    """M and the bounds of a problem.

    Parameters
    ----------
    problem
        One with an anchor: the base.

    Attributes
    ----------
    lower, upper
        (plane, row, col) bounds of d.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        base: Any = problem.anchor
        xp = namespace(base)
        self._seen_planes = problem.desired.shape[0] * problem.desired.shape[3]
        self.lower, self.upper = (
            planes_of(xp.broadcast_to(bound, base.shape) - base)
            for bound in (problem.lower, problem.upper)
        )
        self._columns = [
            self._column(view, p) for view, p in np.ndindex(base.shape[0], base.shape[3])
        ]
        self._apart = all(len(column) <= 1 for column in self._columns)

    def change(self, light: Light) -> Planes:
        """Planes d of a light."""
        return planes_of(light - self._problem.anchor)

    def light(self, planes: Planes) -> Light:
        """The light of planes d, within the bounds."""
        base: Any = self._problem.anchor
        xp = namespace(base)
        views, rows, cols, primaries = base.shape
        change = xp.reshape(planes, (views, primaries, rows, cols))
        return self._problem.project(base + xp.permute_dims(change, (0, 2, 3, 1)))

    def seen(self, light: Planes) -> Planes:
        """M d."""
        xp = namespace(light)
        shape = (self._seen_planes, *light.shape[1:])
        result = xp.zeros(shape, dtype=light.dtype, device=light.device)
        for q, column in enumerate(self._columns):
            for r, value in column.items():
                result[r, ...] += light[q, ...] * value
        return result

    def back(self, gradient: Planes) -> Planes:
        """M' g."""
        return namespace(gradient).stack(
            [
                sum((gradient[r, ...] * v for r, v in column.items()), start=0 * gradient[0, ...])
                for column in self._columns
            ]
        )

    def nearest(self, wanted: Planes, metric: Sequence[float], start: Planes) -> Planes:
        """Returns about the d within bounds for which M d is nearest to `wanted`.

        Parameters
        ----------
        wanted
            (seen plane, row, col).
        metric
            (seen plane,) P.
        start
            A d to begin with.
        """
        xp = namespace(wanted)
        weights = xp.asarray(metric, dtype=wanted.dtype, device=wanted.device)
        right = self.back(wanted * weights[:, None, None])
        return self._swept(right, metric, start, (self.lower, self.upper), _SWEEPS)

    def forward(self, gradient: Planes) -> Planes:
        """The g of least norm for which M' g is a `gradient` of light: M (M'M)^-1 of it."""
        free = [1.0] * self._seen_planes
        return self.seen(self._swept(gradient, free, 0 * gradient, None, _MOST_SWEEPS))

    def curvature(self, metric: Sequence[float] | None = None) -> Planes:
        """Diagonal of M'P M; of M'M without a metric P."""
        like, metric = 0 * self.lower[0, ...], metric or [1.0] * self._seen_planes
        return namespace(like).stack(
            [
                sum((v * v * metric[r] for r, v in column.items()), start=like)
                for column in self._columns
            ]
        )

    def _swept(
        self,
        right: Planes,
        metric: Sequence[float],
        start: Planes,
        bounds: tuple[Planes, Planes] | None,
        sweeps: int,
    ) -> Planes:
        """The d with the least 1/2 <M d, P M d> - <right, d>."""
        xp = namespace(right)
        light = xp.asarray(start, copy=True)
        seen, curvature = self.seen(light), self.curvature(metric)
        curvature = xp.where(curvature == 0, 1 + curvature, curvature)  # off the screen
        least = 4 * float(xp.finfo(light.dtype).eps)
        for _ in range(sweeps):
            largest = 0.0
            for q, column in enumerate(self._columns):
                slope = -right[q, ...]
                for r, value in column.items():
                    slope += seen[r, ...] * (value * metric[r])
                new = light[q, ...] - slope / curvature[q, ...]
                if bounds is not None:
                    new = xp.minimum(xp.maximum(new, bounds[0][q, ...]), bounds[1][q, ...])
                change = new - light[q, ...]
                light[q, ...] = new
                for r, value in column.items():
                    seen[r, ...] += change * value
                largest = max(largest, float(xp.max(xp.abs(change))))
            if self._apart or largest <= least * float(xp.max(xp.abs(light))):
                break
        return light

    def _column(self, view: int, primary: int) -> dict[int, Value]:
        """What is seen of a plane of light: M's entries that are not 0, by the plane seen."""
        base: Any = self._problem.anchor
        xp = namespace(base)
        unit = xp.zeros_like(base)
        unit[view, :, :, primary] = 1
        column: dict[int, Value] = {}
        seen = planes_of(self._problem.observation.local(unit))
        for r in range(seen.shape[0]):
            plane = seen[r, ...]
            if bool(xp.any(plane != plane[0, 0])):
                column[r] = plane
            elif bool(plane[0, 0] != 0):
                column[r] = float(plane[0, 0])
        return column


def planes_of(light: Light) -> Planes:
    """(plane, row, col) of (view, row, col, primary)."""
    xp = namespace(light)
    views, rows, cols, primaries = light.shape
    planes = xp.reshape(xp.permute_dims(light, (0, 3, 1, 2)), (views * primaries, rows, cols))
    return xp.asarray(planes, copy=True)
