"""A picture's problem in opponent channels: each has a penalty of its own.

Planes are y = T w, the channels of light w = K D d, so that Fourier's matrices are diagonal: the
weights Omega_c². The eye sees low frequencies of luminance a hundred times worse than those of
chroma, and no one penalty suits both. With one for each channel (`adapted_metric`), alternating
directions take a third of the iterations that a metric over the primaries takes.

The price is in the z-step: bounds are on the primaries, and each pixel has a small problem,

    min_d  1/2 (T d - s)' R (T d - s) + 1/2 M |d - o|²,     lower <= d <= upper,     R = diag(rho P)

see `boxes`. The regulariser on planes is known from below: M |d|² >= m |T d|².
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.solver.blocks import each_strip
from compensate.solver.boxes import Nearest
from compensate.solver.certificate import parted
from compensate.solver.fused import loops
from compensate.solver.hessian import mixed
from compensate.solver.level import BoxLevel, Level, Planes, Rows, by_rows
from domesim.light import Array, namespace, total
from domesim.strips import is_large


@final
@dataclass
class OpponentLevel(BoxLevel):
    """With bounds that are separate for each pixel of each primary.

    Attributes
    ----------
    hessian, target, lower, width, damping, least_damping, offset, cost
        See `BoxLevel`; Hessian, target and least damping (m) are of the channels' planes.
    opponent
        (channel, primary) T, square.
    """

    opponent: NDArray[np.floating[Any]] = field(kw_only=True)
    _kept: tuple[Planes, Planes] | None = field(init=False, default=None)
    _stepped: Planes | None = field(init=False, default=None)
    _active: NDArray[np.uint8] | None = field(init=False, default=None)

    @property
    def bounds_as_numbers(self) -> tuple[Any, Any]:
        """Lower bounds and widths as the compiled loops take them."""
        number = self.lower[0].dtype.type
        return tuple(self.lower), tuple(
            number(w) if isinstance(w, float) else w for w in self.width
        )

    @property
    def active(self) -> NDArray[np.uint8]:
        """(row, col) active sets of the compiled loops' last step; none at first."""
        if self._active is None:
            self._active = np.zeros(self.lower[0].shape, np.uint8)
        return self._active

    def damping_of(self, rows: slice) -> Any:
        """M of rows of the picture."""
        return self._damping(rows, inner=True)

    def of_light(self, light: Planes) -> Planes:
        """T of light's planes."""
        return self._planes_mixed(self.opponent, light)

    def answer(self, s: Planes, weights: list[float]) -> Planes:
        """The light of s."""
        nearest = Nearest(self, weights)
        rows, cols = self.lower[0].shape
        z = [namespace(s[0]).empty_like(plane[:rows, :cols]) for plane in s]
        if (compiled := loops(*s)) and nearest.compiled:
            compiled.nearest3(*z, *s, *self._numbers_of(nearest))
            return z

        def work(rows: slice) -> None:
            for plane, part in zip(z, nearest(s, rows), strict=True):
                plane[rows, :] = part

        each_strip(work, z[0])
        return z

    def gradient_in_light(self, gradient: Planes) -> Planes:
        """T' of the gradient's planes."""
        return self._planes_mixed(self.opponent.T, gradient, gradient)

    def feasible(self, s: Planes, weights: list[float]) -> Planes:
        """See `Level`: T of the light of s."""
        light = self.answer(s, weights)
        return self._planes_mixed(self.opponent, light, light)

    def towards(self, s: Planes, weights: list[float]) -> Iterator[Array]:
        """See `Level`; kept for `move` and `lower_bound` where finding it again is slow."""
        asked = [*self._towards_all(s, weights)]
        while asked:  # one by one: each becomes a spectrum
            yield asked.pop(0)

    def move(self, s: Planes, w: Planes, weights: list[float], relaxation: float) -> None:
        """See `Level`: z is half of s and what s went to, over the weight."""
        if self._stepped is w:
            self._stepped = None
            each_strip(lambda rows: _step(s, w, rows, relaxation), s[0])
            return
        if self._kept is None:
            self._move_all(s, w, weights, relaxation)
            return
        asked = self._towards_all(s, weights)
        self._kept = None

        def work(rows: slice) -> None:
            for plane, x, target, weight in zip(s, w, asked, weights, strict=True):
                x[rows, :] -= target[rows, :] * (0.5 / weight) + plane[rows, :] * 0.5
            _step(s, w, rows, relaxation)

        each_strip(work, s[0])

    def reweigh(self, s: Planes, weights: list[float], ratio: float) -> None:
        """See `Level`."""
        self._kept = None
        for plane, z in zip(s, self.feasible(s, weights), strict=True):
            self._reweigh_plane(plane, ratio, by_rows(z))

    def lower_bound(
        self, s: Planes, w: Planes, weights: list[float]
    ) -> Iterator[tuple[float, Array]]:
        """See `Level`: the first part is everything that is known.

        Planes are few, so that g_F takes the place of what s went to, and w - z that of w (but in
        compiled loops): `move`, which has to be next, knows.
        """
        free = self._towards_all(s, weights)
        if (compiled := loops(*s, *w)) and Nearest(self, weights).compiled:
            known = self._compiled_lower_bound(compiled, free, w, weights)
        else:
            known = self._lower_bound_in_strips(free, s, w, weights)
        while free:  # one by one: each becomes a spectrum
            yield known, free.pop(0)
            known = 0.0

    def _lower_bound_in_strips(
        self, free: Planes, s: Planes, w: Planes, weights: list[float]
    ) -> float:
        """As `_compiled_lower_bound`; w is w - z then."""
        self._kept, self._stepped = None, w
        inverse, least = np.linalg.inv(self.opponent), self.least_damping

        def work(strip: slice) -> float:
            known, inner = 0.0, self._inner(strip)
            at, slopes = [plane[strip, :] + 0 for plane in w], []
            for x, away, asked, plane, weight in zip(at, w, free, s, weights, strict=True):
                away[strip, :] -= (asked[strip, :] * (1 / weight) + plane[strip, :]) * 0.5
                slopes.append(asked[strip, :] - x * weight)
                # Light is pinned on the padding: all of its gradient is known
                known -= _energy(x, slopes[-1], least)
                asked[strip, :] = 0
            if not inner:
                return known
            part = (slice(0, inner[0].stop - inner[0].start), inner[1])
            at, slopes = ([plane[part] for plane in planes] for planes in (at, slopes))
            known += sum(_energy(x, slope, least) for x, slope in zip(at, slopes, strict=True))
            known += 0.5 * sum(float(total(x * g)) for x, g in zip(at, slopes, strict=True))
            gradient = mixed(self.opponent.T, slopes)
            damping = self._damping(inner[0], inner=True)
            for p, light in enumerate(mixed(inverse, at)):
                away = light if self.offset is None else light - self.offset[p][inner[0], :]
                damped = damping * away
                gradient[p] += damped
                limits = *self.bounds(p, inner[0]), self.hessian.curvature
                at_bounds, gradient[p] = parted(light, gradient[p], *limits)
                known += 0.5 * float(total(damped * away)) - at_bounds
            for plane, rest in zip(free, mixed(inverse.T, gradient), strict=True):
                plane[inner] = rest
            return known

        return sum(each_strip(work, s[0]))

    def _compiled_lower_bound(
        self, compiled: Any, free: Planes, w: Planes, weights: list[float]
    ) -> float:
        """What is known of `lower_bound`; `free` is g_F then."""
        dtype = free[0].dtype
        number = dtype.type
        lowers, widths, damping, *_ = Nearest(self, weights).numbers(dtype)
        matrices = self.opponent.astype(dtype), np.linalg.inv(self.opponent).astype(dtype)
        factors = tuple(number(weight) for weight in weights)
        bounds = lowers, widths, damping, number(self.least_damping)
        curvature = number(self.hessian.curvature)
        found = compiled.lower_bound3(*free, *w, *bounds, *matrices, factors, curvature)
        return float(found)

    def regulariser(self, z: Planes) -> float:
        """See `Level`."""
        inverse = np.linalg.inv(self.opponent)

        def work(rows: slice) -> float:
            energy = 0.0
            damping = self._damping(rows, inner=True)
            for p, light in enumerate(mixed(inverse, [plane[rows, :] for plane in z])):
                away = light if self.offset is None else light - self.offset[p][rows, :]
                energy += 0.5 * float(total(damping * away * away))
            return energy

        return sum(each_strip(work, z[0]))

    def state(self, s: Planes, weights: list[float]) -> tuple[Planes, Planes]:
        """See `Level`."""
        light = self.answer(s, weights)
        dual = [namespace(plane).asarray(plane, copy=True) for plane in s]
        cols = light[0].shape[1]

        def work(rows: slice) -> None:
            parts = mixed(self.opponent, [plane[rows, :] for plane in light])
            for plane, part in zip(dual, parts, strict=True):
                plane[rows, :cols] -= part

        each_strip(work, light[0])
        return light, dual

    def of_state(self, light: Sequence[Rows], dual: Planes) -> Planes:
        """See `Level`."""
        rows, cols = self.lower[0].shape

        def work(rows: slice) -> None:
            parts = mixed(self.opponent, self.bounded(light, rows))
            for plane, part in zip(dual, parts, strict=True):
                plane[rows, :cols] += part

        each_strip(work, dual[0][:rows, :cols])
        return dual

    def of_coarser(
        self, light: Planes, dual: Planes, were: list[float], weights: list[float]
    ) -> Planes:
        """See `Level`."""
        coarse, self._active = self._active, None
        compiled = loops(*light)
        if coarse is None or not compiled:
            return super().of_coarser(light, dual, were, weights)
        fourier, number = self.hessian.fourier, dual[0].dtype.type
        s = [np.empty((fourier.rows, fourier.cols), plane.dtype) for plane in dual]
        ratios = tuple(number(was / weight) for was, weight in zip(were, weights, strict=True))
        opponent = self.opponent.astype(dual[0].dtype)
        self._active = np.empty(self.lower[0].shape, np.uint8)
        given = tuple(light), tuple(dual), coarse, ratios, *self.bounds_as_numbers, opponent
        compiled.finer3(*s, self._active, *given)
        return s

    def follow(self, coarse: Level) -> None:
        """See `Level`: the active sets, until `of_coarser` enlarges them."""
        assert isinstance(coarse, OpponentLevel)
        self._active = coarse._active

    def _towards_all(self, s: Planes, weights: list[float]) -> Planes:
        """Weight (2 z - s) of all planes, as they were kept or anew."""
        if self._kept is not None and self._kept[0] is s:
            return self._kept[1]
        nearest = Nearest(self, weights)
        asked = [namespace(plane).empty_like(plane) for plane in s]
        compiled = loops(*s) if nearest.compiled else None
        if not (compiled or is_large(s[0])):
            self._kept = s, asked
        if compiled:
            number = s[0].dtype.type
            factors = tuple(number(weight) for weight in weights)
            compiled.towards3(*asked, *s, *self._numbers_of(nearest), factors)
            return asked

        doubled = 2 * np.asarray(weights)[:, None] * self.opponent

        def work(strip: slice) -> None:
            for plane, to, weight in zip(s, asked, weights, strict=True):
                to[strip, :] = plane[strip, :] * -weight
            if inner := self._inner(strip):
                for plane, to in zip(mixed(doubled, nearest(s, inner[0])), asked, strict=True):
                    to[inner] += plane

        each_strip(work, s[0])
        return asked

    def _move_all(self, s: Planes, w: Planes, weights: list[float], relaxation: float) -> None:
        """`move`, with z found anew; compiled loops take the active sets that `towards` left."""
        nearest = Nearest(self, weights)
        if (compiled := loops(*s, *w)) and nearest.compiled:
            number = s[0].dtype.type
            compiled.move3(*s, *w, *self._numbers_of(nearest), number(relaxation))
            return

        def work(strip: slice) -> None:
            if inner := self._inner(strip):
                z = mixed(self.opponent, nearest(s, inner[0]))
                for x, plane in zip(w, z, strict=True):
                    x[inner] -= plane
            _step(s, w, strip, relaxation)

        each_strip(work, s[0])

    def _numbers_of(self, nearest: Nearest) -> tuple[Any, ...]:
        """What the compiled loops take; they begin with the active sets of the step before."""
        return *nearest.numbers(self.lower[0].dtype), self.active

    @staticmethod
    def _planes_mixed(
        matrix: NDArray[np.floating[Any]], planes: Planes, to: Planes | None = None
    ) -> Planes:
        """A matrix times planes, in new ones or in their own place."""
        xp = namespace(planes[0])
        result = to or [
            xp.empty(plane.shape, dtype=plane.dtype, device=plane.device) for plane in planes
        ]

        def work(rows: slice) -> None:
            parts = mixed(matrix, [plane[rows, :] for plane in planes])
            for plane, part in zip(result, parts, strict=True):
                plane[rows, :] = part

        each_strip(work, result[0])
        return result


def _energy(x: Array, slope: Array, damping: float) -> float:
    """<x, slope> / 2 + damping ||x||² / 2."""
    return 0.5 * (float(total(x * slope)) + damping * float(total(x * x)))


def _step(s: Planes, away: Planes, rows: slice, relaxation: float) -> None:
    """In place, of rows: w - z to the residual, and s to s + r."""
    for plane, x in zip(s, away, strict=True):
        x[rows, :] *= relaxation
        plane[rows, :] += x[rows, :]
