"""One problem at one resolution, as ADMM sees it: a quadratic in Fourier, bounds in pixels.

All light is relative to a *base* x_a near the solution (the exact clipped subtraction), and the
variable is what is seen of its change d, pixel by pixel (`AdjointObservation.local`), on padded
planes:

    w = M d:    f(w) = c_a - <b, w> + 1/2 <w, H_0 w>      b = - gradient at the base, c_a its cost
                g(w) = 1/2 mu ||w||²                      where w = M d, lower <= d <= upper

H_0 is diagonal in Fourier whatever M is, but for a dome's few modes. All that differs from pixel to
pixel is in g: its proximal map is a small bound-constrained least squares of each pixel. Near the
base, what is clipped is sparse, so that b is small, sums lose few digits in float32, and a solution
on a coarser plane goes over to the finer one without blurring the picture.

The lower bound of `certificate` is in d: with q = M' g and any split q = q_B + q_F, the bounds
limit what q_B can win, and the quadratic what is left, g_F = g - g_B where M' g_B = q_B.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias, final

from compensate.solver.admm.fused import loops
from compensate.solver.admm.hessian import Hessian, Planes, Spectra, each_strip
from compensate.solver.admm.pyramid import Value, doubled, halved, halved_value, padded, rows_of
from domesim.light import Array, namespace, total
from domesim.light.strips import is_large

Bounds: TypeAlias = Sequence[tuple[Array, Array]]
"""Lower and upper bounds of each plane, or of strips."""


class Mixing(ABC):
    """M: how pixels' light is seen in its own place. Planes are strips of rows."""

    @abstractmethod
    def seen(self, light: Planes, rows: slice) -> Planes:
        """Returns M d."""

    @abstractmethod
    def back(self, gradient: Planes, rows: slice) -> Planes:
        """Returns M' g."""

    @abstractmethod
    def light(self, seen: Planes, rows: slice) -> Planes:
        """The d for which M d is nearest to what is seen."""

    @abstractmethod
    def forward(self, gradient: Planes, rows: slice) -> Planes:
        """A g for which M' g is the gradient in light: M (M'M)^-1 of it."""

    @abstractmethod
    def nearest(
        self, wanted: Planes, metric: Sequence[float], bounds: Bounds, rows: slice
    ) -> Planes:
        """The d within bounds for which M d is nearest to `wanted`, by a (plane,) `metric`."""

    @abstractmethod
    def curvature(self, p: int, rows: slice) -> Value:
        """<M u, M u> of each pixel, where u is 1 in light plane `p` and 0 in all others."""

    @abstractmethod
    def coarser(self) -> Mixing:
        """The same on planes of half the rows and columns."""

    def compiled(self, level: Level, s: Planes, weights: Sequence[float]) -> Planes | None:
        """`Level.feasible` by compiled loops, if there are any."""
        return None


@final
class Apart(Mixing):
    """M = 1: a plane is seen as it is."""

    def seen(self, light: Planes, rows: slice) -> Planes:
        """See `Mixing`."""
        return light

    def back(self, gradient: Planes, rows: slice) -> Planes:
        """See `Mixing`."""
        return gradient

    def light(self, seen: Planes, rows: slice) -> Planes:
        """See `Mixing`."""
        return seen

    def forward(self, gradient: Planes, rows: slice) -> Planes:
        """See `Mixing`."""
        return gradient

    def nearest(
        self, wanted: Planes, metric: Sequence[float], bounds: Bounds, rows: slice
    ) -> Planes:
        """See `Mixing`."""
        xp = namespace(wanted[0])
        return [
            xp.minimum(xp.maximum(plane, lower), upper)
            for plane, (lower, upper) in zip(wanted, bounds, strict=True)
        ]

    def curvature(self, p: int, rows: slice) -> Value:
        """See `Mixing`."""
        return 1.0

    def coarser(self) -> Apart:
        """See `Mixing`."""
        return self


@final
@dataclass
class Level:
    """The problem at one resolution.

    Attributes
    ----------
    hessian
        H_0.
    mixing
        M.
    damping
        mu.
    lower
        (row, col) lower bounds of each plane of d.
    width
        Distance of the upper bounds from the lower ones; planes may share one.
    target
        b's spectra.
    cost
        c_a.
    """

    hessian: Hessian
    mixing: Mixing
    damping: float
    lower: Planes
    width: Sequence[Value]
    target: Spectra = field(default_factory=list)
    cost: float = 0.0
    _kept: tuple[Planes, Planes] | None = None

    def aim(self, residual: Planes) -> None:
        """Set target and cost by the residual at the base, whose planes are used up."""
        spectra = []
        while residual:
            spectra.append(self.hessian.fourier.forward(residual.pop(0)))
        energy, self.target = self.hessian.seen(spectra)
        for p in range(len(self.target)):
            self.target[p] *= -1
        self.cost = 0.5 * energy

    def start(self, light: Planes | None = None) -> Planes:
        """Padded planes of M d, from (row, col) planes d; 0 by default."""
        fourier = self.hessian.fourier
        like = self.lower[0]
        planes = [padded(like[:0, :], fourier) for _ in self.hessian.metric]
        return planes if light is None else self._added(planes, light, 1.0)

    def light(self, s: Planes, weights: list[float]) -> Planes:
        """(row, col) d of s: the proximal map of g."""
        result = [namespace(s[0]).empty_like(lower) for lower in self.lower]

        def work(rows: slice) -> None:
            for plane, d in zip(result, self._nearest(s, rows, weights), strict=True):
                plane[rows, :] = d

        each_strip(work, result[0])
        return result

    def feasible(self, s: Planes, weights: list[float]) -> Planes:
        """The iterate z of s: (row, col) planes M d within the bounds."""
        if (found := self.mixing.compiled(self, s, weights)) is not None:
            return found
        z = [namespace(s[0]).empty_like(self.lower[0]) for _ in s]

        def work(rows: slice) -> None:
            seen = self.mixing.seen(self._nearest(s, rows, weights), rows)
            for plane, strip in zip(z, seen, strict=True):
                plane[rows, :] = strip

        each_strip(work, z[0])
        return z

    def towards(self, s: Planes, weights: list[float]) -> Iterator[Array]:
        """Yields weight (z - u) = weight (2 z - s), where the x-step goes to, plane by plane.

        z is kept for `move` unless memory counts for more than time.
        """
        z = self.feasible(s, weights)
        self._kept = None if is_large(s[0]) else (s, list(z))
        for plane, weight in zip(s, weights, strict=True):
            yield self._towards(plane, z.pop(0), weight)

    def move(self, s: Planes, w: Planes, weights: list[float], relaxation: float) -> None:
        """Turns w into the residual r = relaxation (w - z), and s into s + r, in place."""
        for plane, to, z in zip(s, w, self._feasible(s, weights), strict=True):
            self._move(plane, to, z, relaxation)
        self._kept = None

    def reweigh(self, s: Planes, weights: list[float], ratio: float) -> None:
        """Keeps z of s and multiplies its dual s - z by `ratio`, in place."""
        rows, cols = self.lower[0].shape
        for p, z in enumerate(self.feasible(s, weights)):
            s[p] *= ratio
            s[p][:rows, :cols] += z * (1 - ratio)

    def regulariser(self, z: Planes) -> float:
        """1/2 mu ||z||²."""

        def work(rows: slice) -> float:
            return sum(float(total(plane[rows, :] * plane[rows, :])) for plane in z)

        return 0.5 * self.damping * sum(each_strip(work, z[0]))

    def lower_bound(
        self, s: Planes, w: Planes, weights: list[float]
    ) -> Iterator[tuple[float, Array]]:
        """Yields each plane's part of a lower bound of the minimum, at the x-step's w.

        The gradient of f at w is weight (z - u - w), without a transform; g's is mu w. The padding
        is pinned: all of its gradient is known.

        Yields
        ------
        known
            1/2 <w, f'(w)> + 1/2 mu ||w||² less the most that the bounds allow to win.
        free
            g_F.
        """
        self._kept = None  # a certificate takes memory
        free = [namespace(plane).zeros_like(plane) for plane in s]
        height, cols = self.lower[0].shape

        def work(strip: slice) -> float:
            known, gradient, at = 0.0, [], []
            rows = slice(strip.start, min(strip.stop, height))
            count = max(0, rows.stop - rows.start)
            z = self.mixing.seen(self._nearest(s, rows, weights), rows) if count else s
            for plane, x, inner, weight in zip(s, w, z, weights, strict=True):
                moved = x[strip, :]
                slope = (plane[strip, :] + moved) * -weight
                if count:
                    slope[:count, :cols] += inner * (2 * weight)
                known -= 0.5 * float(total(moved * slope + self.damping * moved * moved))
                slope += self.damping * moved
                gradient.append(slope[:count, :cols])
                at.append(moved[:count, :cols])
            if not count:
                return known
            known += sum(float(total(x * g)) for x, g in zip(at, gradient, strict=True))
            at_bounds, rest = self._parted(at, gradient, rows)
            for plane, left in zip(free, rest, strict=True):
                plane[rows, :cols] = left
            return known + at_bounds

        known = sum(each_strip(work, s[0]))
        while free:  # one by one: each becomes a spectrum
            yield known, free.pop(0)
            known = 0.0

    def weights(self, rho: float) -> list[float]:
        """Weights rho P, one a plane."""
        return [rho * value for value in self.hessian.metric]

    def coarser(self) -> Level:
        """The problem on planes of half the rows and columns; its `aim` is to be set."""
        widths: dict[int, Value] = {}
        for value in self.width:  # planes that are one stay one
            if id(value) not in widths:
                widths[id(value)] = halved_value(value)
        return Level(
            self.hessian.coarser,
            self.mixing.coarser(),
            self.damping,
            [halved(plane) for plane in self.lower],
            [widths[id(value)] for value in self.width],
        )

    def state(self, s: Planes, weights: list[float]) -> tuple[Planes, Planes]:
        """The (row, col) d of s, and its dual s - z."""
        light = self.light(s, weights)
        dual = [namespace(plane).asarray(plane, copy=True) for plane in s]
        return light, self._added(dual, light, -1.0)

    def of_coarser(
        self, light: Planes, dual: Planes, were: list[float], weights: list[float]
    ) -> Planes:
        """The iterate s from the coarser level's `state`, whose weights `were` others."""
        rows, cols = self.lower[0].shape
        for p, (was, weight) in enumerate(zip(were, weights, strict=True)):
            coarse = dual[p]
            dual[p] = doubled(coarse, 2 * coarse.shape[0], 2 * coarse.shape[1], was / weight)
        return self._added(dual, [doubled(plane, rows, cols) for plane in light], 1.0, clip=True)

    def bounds(self, rows: slice) -> list[tuple[Array, Array]]:
        """Lower and upper bounds of rows of each plane of d."""
        return [
            (lower[rows, :], lower[rows, :] + rows_of(width, rows))
            for lower, width in zip(self.lower, self.width, strict=True)
        ]

    def _nearest(self, s: Planes, rows: slice, weights: list[float]) -> Planes:
        """Rows of `light`: the d within bounds nearest to s, which the regulariser shrinks."""
        cols = self.lower[0].shape[1]
        wanted = [
            plane[rows, :cols] * (weight / (weight + self.damping))
            for plane, weight in zip(s, weights, strict=True)
        ]
        metric = [weight + self.damping for weight in weights]
        return self.mixing.nearest(wanted, metric, self.bounds(rows), rows)

    def _feasible(self, s: Planes, weights: list[float]) -> Planes:
        """`feasible`; it takes what `towards` found if s is still the same."""
        if self._kept is not None and self._kept[0] is s:
            return self._kept[1]
        return self.feasible(s, weights)

    def _towards(self, s: Array, z: Array, weight: float) -> Array:
        result = namespace(s).empty_like(s)
        if compiled := loops(s):
            compiled.towards(result, s, z, s.dtype.type(weight))
            return result
        height, cols = z.shape

        def work(strip: slice) -> None:
            result[strip, :] = s[strip, :] * -weight
            if strip.start < height:
                rows = slice(strip.start, min(strip.stop, height))
                result[rows, :cols] += z[rows, :] * (2 * weight)

        each_strip(work, s)
        return result

    def _move(self, s: Array, w: Array, z: Array, relaxation: float) -> None:
        if compiled := loops(s, w):
            compiled.move(s, w, z, s.dtype.type(relaxation))
            return
        height, cols = z.shape

        def work(strip: slice) -> None:
            if strip.start < height:
                rows = slice(strip.start, min(strip.stop, height))
                w[rows, :cols] -= z[rows, :]
            w[strip, :] *= relaxation
            s[strip, :] += w[strip, :]

        each_strip(work, s)

    def _parted(self, w: Planes, gradient: Planes, rows: slice) -> tuple[float, Planes]:
        """Splits a gradient at w: the most that bounds allow to win, below 0, and the rest."""
        xp, mixing, bounds = namespace(w[0]), self.mixing, self.bounds(rows)
        change, left = mixing.light(w, rows), []
        for p, q in enumerate(mixing.back(gradient, rows)):
            lower, upper = bounds[p]
            distance = xp.where(q > 0, change[p] - lower, upper - change[p])
            # Against the quadratic's share
            steep = 2 * self.hessian.curvature * mixing.curvature(p, rows)
            left.append(xp.where(distance * steep <= xp.abs(q), 0 * q, q))
        # What no light can be seen to follow goes with what the bounds limit
        rest = mixing.forward(left, rows)
        at_bounds = [g - part for g, part in zip(gradient, rest, strict=True)]
        known = -sum(float(total(g * x)) for g, x in zip(at_bounds, w, strict=True))
        for q, (lower, upper) in zip(mixing.back(at_bounds, rows), bounds, strict=True):
            known += float(total(q * xp.where(q > 0, lower, upper)))
        return known, rest

    def _added(self, planes: Planes, light: Planes, sign: float, *, clip: bool = False) -> Planes:
        """Adds `sign` M d to padded planes, in place; `clip` brings d within the bounds first."""
        cols = self.lower[0].shape[1]

        def work(rows: slice) -> None:
            part = [plane[rows, :] for plane in light]
            if clip:
                part = Apart().nearest(part, (), self.bounds(rows), rows)
            for plane, seen in zip(planes, self.mixing.seen(part, rows), strict=True):
                plane[rows, :cols] += seen * sign

        each_strip(work, self.lower[0])
        return planes
