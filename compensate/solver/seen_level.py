"""A stereo pair's problem in what is seen: Fourier diagonalises it whatever the crosstalk.

Crosstalk that differs from pixel to pixel (a map, a linearised table), or is seen under a contrast
K that does, mixes no pixels. So, with d = x - x_a the change of the clipped subtraction and M the
small matrix of each pixel, let the variable be the change of what is seen

    w = K M d:     f(w) = 1/2 ||A (w + t)||²,   t: what is seen too much at the base
                   g(w) = 1/2 sum of mu m (w - o)²     over planes, each with its mu, and pixels

where Fourier diagonalises f's Hessian A'A exactly, view by view. All that differs from pixel to
pixel is in g and in the set of what can be seen, {K M d: lower <= x_a + d <= upper}, and the
z-step's projection on it is a small bound-constrained least squares of each pixel: see `two_eyes`.
It is plain as mu and m are the same for both eyes.

The lower bound of `certificate` is in d: with q = M' K g and any split q = q_B + q_F, the bounds
limit what q_B can win, and the quadratic what is left, g_F = g - g_B where M' K g_B = q_B.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, final

from compensate.solver.blocks import Spectra, each_strip
from compensate.solver.fused import loops
from compensate.solver.hessian import Hessian
from compensate.solver.level import (
    Level,
    Planes,
    Rows,
    Value,
    by_rows,
    coarsened,
    coarsened_value,
    rows_of,
)
from compensate.solver.two_eyes import TwoEyes
from domesim.light import Array, namespace, total


@final
@dataclass
class SeenLevel(Level):
    """The problem in w = K M d.

    Attributes
    ----------
    hessian, target, least_damping, lower, width, offset, cost
        See `Level`. Light is d.
    damping
        Mu of each plane.
    stiffness
        m, what mu is multiplied by: a number, or (padded row, padded col), 1 on the padding.
    eyes
        M.
    contrast
        (row, col) K of each eye.
    """

    hessian: Hessian
    target: Spectra
    least_damping: float
    damping: Sequence[float]
    eyes: TwoEyes
    contrast: Sequence[Array]
    lower: Planes
    width: Sequence[Value]
    offset: Planes | None = None
    cost: float = 0.0
    stiffness: Value = 1.0
    _kept: tuple[Planes, Planes] | None = field(init=False, default=None)

    def feasible(self, s: Planes, weights: list[float]) -> Planes:
        """See `Level`."""
        z = [namespace(s[0]).empty_like(lower) for lower in self.lower]
        compiled = loops(*s)
        if compiled and self.offset is None and not self.eyes.mixed:
            self._compiled_feasible(compiled, z, s, weights)
            return z

        def work(rows: slice) -> None:
            k = [plane[rows, :] for plane in self.contrast]
            seen = self.eyes.seen(self._nearest(s, rows, weights), rows)
            for p, plane in enumerate(seen):
                z[p][rows, :] = plane * k[p // self.eyes.primaries]

        each_strip(work, z[0])
        return z

    def change(self, target: Planes, weights: list[float] | None = None) -> Planes:
        """The change d within the bounds whose K M d is nearest to a `target`.

        Parameters
        ----------
        target
            (row, col) planes, or padded ones.
        weights
            Rho P, one a plane, by which the regulariser shrinks it; None for none.
        """
        result = [namespace(target[0]).empty_like(lower) for lower in self.lower]

        def work(rows: slice) -> None:
            for plane, d in zip(result, self._nearest(target, rows, weights), strict=True):
                plane[rows, :] = d

        each_strip(work, result[0])
        return result

    def towards(self, s: Planes, weights: list[float]) -> Iterator[Array]:
        """See `Level`; z is kept for `move`."""
        z = self.feasible(s, weights)
        self._kept = s, z
        return (
            self._plane_towards(plane, weight, by_rows(inner))
            for plane, inner, weight in zip(s, z, weights, strict=True)
        )

    def move(self, s: Planes, w: Planes, weights: list[float], relaxation: float) -> None:
        """See `Level`."""
        z = self._feasible_again(s, weights)
        self._kept = None
        for p, inner in enumerate(z):
            self._move_plane(s[p], w[p], relaxation, by_rows(inner))

    def reweigh(self, s: Planes, weights: list[float], ratio: float) -> None:
        """See `Level`."""
        self._kept = None
        for p, inner in enumerate(self.feasible(s, weights)):
            self._reweigh_plane(s[p], ratio, by_rows(inner))

    def state(self, s: Planes, weights: list[float]) -> tuple[Planes, Planes]:
        """See `Level`."""
        light = self.change(s, weights)
        dual = [namespace(plane).asarray(plane, copy=True) for plane in s]
        self._add_seen(dual, lambda rows: [plane[rows, :] for plane in light], -1.0)
        return light, dual

    def of_state(self, light: Sequence[Rows], dual: Planes) -> Planes:
        """See `Level`."""
        self._add_seen(dual, lambda rows: self.bounded(light, rows), 1.0)
        return dual

    def lower_bound(
        self, s: Planes, w: Planes, weights: list[float]
    ) -> Iterator[tuple[float, Array]]:
        """See `Level`: the first part is everything that is known."""
        z = [by_rows(plane) for plane in self._feasible_again(s, weights)]
        free = [namespace(plane).zeros_like(plane) for plane in s]

        def work(strip: slice) -> float:
            known, gradient = 0.0, []
            for p, weight in enumerate(weights):
                damping = self._damping(p, strip)
                part, slope = self._slope_at(p, s[p], w[p], weight, strip, z[p], damping)
                known += part
                gradient.append(slope)
            if not (inner := self._inner(strip)):
                return known
            at_bounds, rest = self._parted([plane[inner] for plane in w], gradient, inner[0])
            for plane, left in zip(free, rest, strict=True):
                plane[inner] = left
            return known + at_bounds

        known = sum(each_strip(work, s[0]))
        while free:  # one by one: each becomes a spectrum
            yield known, free.pop(0)
            known = 0.0

    def regulariser(self, z: Planes) -> float:
        """See `Level`."""

        def work(rows: slice) -> float:
            energy = 0.0
            for p, plane in enumerate(z):
                away = plane[rows, :]
                if self.offset is not None:
                    away = away - self.offset[p][rows, :]
                energy += float(total(self._damping(p, rows, inner=True) * away * away))
            return energy

        return 0.5 * sum(each_strip(work, z[0]))

    def slope(self, p: int, z: Array) -> Array:
        """See `Level`."""
        if self.offset is not None:
            z = z - self.offset[p]
        return z * self._damping(p, slice(0, z.shape[0]), inner=True)

    def coarser(self) -> SeenLevel:
        """See `Level`."""
        return SeenLevel(
            self.hessian.coarser,
            [],
            self.least_damping,
            self.damping,
            self.eyes.coarser(),
            [coarsened(plane) for plane in self.contrast],
            [coarsened(plane) for plane in self.lower],
            [coarsened_value(value) for value in self.width],
            None if self.offset is None else [coarsened(plane) for plane in self.offset],
            stiffness=coarsened_value(self.stiffness),
        )

    def _compiled_feasible(self, compiled: Any, z: Planes, s: Planes, weights: list[float]) -> None:
        count, number = self.eyes.primaries, s[0].dtype.type

        def given(value: Value) -> Any:
            return number(value) if isinstance(value, float) else value

        for p, q in ((p, p + count) for p in range(count)):
            own, other = self.eyes.alone(p, slice(None))
            numbers = weights[p], self.damping[p], self.stiffness
            compiled.nearest_pair(
                *(z[p], z[q], s[p], s[q], *self.contrast, self.lower[p], self.lower[q]),
                *map(given, (*own, *other, self.width[p], self.width[q], *numbers)),
            )

    def _nearest(self, target: Planes, rows: slice, weights: list[float] | None) -> Planes:
        """`change` of rows."""
        count, cols = self.eyes.primaries, self.lower[0].shape[1]
        k = self.contrast[0][rows, :], self.contrast[1][rows, :]
        inverse = 1 / k[0], 1 / k[1]
        wanted = []
        for p, plane in enumerate(target):
            strip, scale = plane[rows, :cols], inverse[p // count]
            if weights is not None:
                shrink = weights[p] / (weights[p] + self._damping(p, rows, inner=True))
                strip = strip * shrink
                if self.offset is not None:
                    strip += self.offset[p][rows, :] * (1 - shrink)
            wanted.append(strip * scale)
        metric: list[Value] = [1.0] * count
        if weights is not None and self.eyes.mixed:
            metric = [weights[p] + self._damping(p, rows, inner=True) for p in range(count)]
        bounds = [self.bounds(p, rows) for p in range(len(wanted))]
        return self.eyes.nearest(wanted, k, metric, bounds, rows)

    def _damping(self, p: int, rows: slice, *, inner: bool = False) -> Any:
        """Mu m of a plane's padded rows, or of its picture's."""
        return self._rows_of_padded(self.stiffness, rows, inner=inner) * self.damping[p]

    def _parted(self, w: Planes, gradient: Planes, rows: slice) -> tuple[float, Planes]:
        """What the bounds allow at most to win of a gradient at w, and the rest of it."""
        xp, eyes = namespace(w[0]), self.eyes
        k = [self.contrast[p // eyes.primaries][rows, :] for p in range(len(w))]
        change = eyes.unmixed([plane / scale for plane, scale in zip(w, k, strict=True)], rows)

        def back(planes: Planes) -> Planes:
            return eyes.back([plane * scale for plane, scale in zip(planes, k, strict=True)], rows)

        chosen = []
        for p, q in enumerate(back(gradient)):
            lower, upper = self.bounds(p, rows)
            distance = xp.where(q > 0, change[p] - lower, upper - change[p])
            own = k[p] * rows_of(eyes.own[p // eyes.primaries][p % eyes.primaries], rows)
            # What bounds allow to win, against the quadratic's share
            bound = distance * (2 * self.hessian.curvature * own * own) <= xp.abs(q)
            chosen.append(xp.where(bound, q, 0 * q))
        at_bounds = [
            plane / scale for plane, scale in zip(eyes.unmixed_back(chosen, rows), k, strict=True)
        ]
        known = 0.0
        for p, q in enumerate(back(at_bounds)):
            lower, upper = self.bounds(p, rows)
            known += float(total(q * xp.where(q > 0, lower, upper)))
            known -= float(total(at_bounds[p] * w[p]))
        return known, [g - part for g, part in zip(gradient, at_bounds, strict=True)]

    def _add_seen(self, planes: Planes, light: Callable[[slice], list[Array]], sign: float) -> None:
        """Add what is seen of light, `sign` K M d, to padded planes."""
        cols = self.lower[0].shape[1]

        def work(rows: slice) -> None:
            for p, plane in enumerate(self.eyes.seen(light(rows), rows)):
                k = self.contrast[p // self.eyes.primaries][rows, :]
                planes[p][rows, :cols] += plane * (sign * k)

        each_strip(work, self.lower[0])

    def _feasible_again(self, s: Planes, weights: list[float]) -> Planes:
        """`feasible`, as `towards` found it if s is the same still."""
        if self._kept is not None and self._kept[0] is s:
            return self._kept[1]
        return self.feasible(s, weights)
