"""One problem at one resolution, as ADMM sees it: a quadratic in Fourier, bounds in pixels.

All light is relative to a *base* x_a near the solution (the exact clipped subtraction): with
w = D (x - x_a) on padded planes,

    f(w) = c_a - <b, w> + 1/2 <w, H_0 w>             b = - gradient at the base, c_a its cost
    g(w) = 1/2 <w - o, M (w - o)> + [lower <= w <= upper]        M = mu / D²

Near the base, what is clipped is sparse, so that b is small, sums lose few digits in float32, and a
solution on a coarser plane goes over to the finer one without blurring the picture.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias, final

from compensate.fourier import Fourier
from compensate.solver.blocks import Spectra, each_strip
from compensate.solver.certificate import parted
from compensate.solver.fused import loops
from compensate.solver.hessian import Hessian, halved
from domesim.light import Array, namespace, total

Planes: TypeAlias = list[Array]
"""One (padded row, padded col) array for each primary of each view."""

Value: TypeAlias = float | Array
"""Of all pixels, or (row, col)."""

Rows: TypeAlias = Callable[[slice], Array]
"""A plane's (row, col) picture, by its rows."""


@final
class Computed:
    """A plane that is computed where its rows are asked for, and takes no memory.

    Parameters
    ----------
    rows
        What computes them.
    like
        An array of its shape and type.
    """

    def __init__(self, rows: Rows, like: Array) -> None:
        self._rows, self.shape, self.dtype = rows, like.shape, like.dtype

    def __getitem__(self, place: tuple[slice, slice]) -> Array:
        return self._rows(place[0])[:, place[1]]


class Level(ABC):
    """The problem at one resolution.

    Attributes
    ----------
    hessian
        H_0.
    target
        b's spectra.
    least_damping
        The least of M.
    lower
        (row, col) lower bounds of each plane's light; they may be `Computed`.
    width
        How far up the upper ones are; planes may share one.
    offset
        (row, col) o on the picture's part of each plane, or None where it is 0.
    cost
        c_a, of f: without the regulariser.
    """

    hessian: Hessian
    target: Spectra
    least_damping: float
    lower: Planes
    width: Sequence[Value]
    offset: Planes | None
    cost: float

    def start(self, light: Planes | None = None) -> Planes:
        """Padded planes of light (row, col); 0 by default."""
        if light is None:
            light = [lower[:0, :] for lower in self.lower]
        return [padded(plane, self.hessian.fourier) for plane in self.of_light(light)]

    def of_light(self, light: Planes) -> Planes:
        """The planes of light's planes; they may be the same."""
        return light

    def answer(self, s: Planes, weights: list[float]) -> Planes:
        """What `Split.light` takes, of s."""
        return self.feasible(s, weights)

    def gradient_in_light(self, gradient: Planes) -> Planes:
        """The gradient in light of one in this level's planes (row, col)."""
        return gradient

    @abstractmethod
    def feasible(self, s: Planes, weights: list[float]) -> Planes:
        """Z of s, (row, col): the regulariser's and the bounds' proximal map."""

    @abstractmethod
    def towards(self, s: Planes, weights: list[float]) -> Iterator[Array]:
        """Weight (z - u) = weight (2 z - s): what the x-step goes to, plane by plane."""

    @abstractmethod
    def move(self, s: Planes, w: Planes, weights: list[float], relaxation: float) -> None:
        """In place: w to the residual r = relaxation (w - z), and s to s + r."""

    @abstractmethod
    def reweigh(self, s: Planes, weights: list[float], ratio: float) -> None:
        """In place: the same z of s, and `ratio` times its dual s - z."""

    @abstractmethod
    def lower_bound(
        self, s: Planes, w: Planes, weights: list[float]
    ) -> Iterator[tuple[float, Array]]:
        """The planes' parts of a lower bound of the minimum, at the x-step's w.

        The gradient of f at w is weight (z - u - w), without a transform; g's is M (w - o). See
        `certificate` for the split of their sum.

        Yields
        ------
        known
            1/2 <w, f'(w)> + 1/2 <w - o, M (w - o)> - sum over B of |g| dist.
        free
            g_F.
        """

    @abstractmethod
    def coarser(self) -> Level:
        """The problem on planes of half the rows and columns; its target and cost are to be set."""

    @abstractmethod
    def state(self, s: Planes, weights: list[float]) -> tuple[Planes, Planes]:
        """The bounded light (row, col) of s, and its dual s - z."""

    @abstractmethod
    def of_state(self, light: Sequence[Rows], dual: Planes) -> Planes:
        """S of light, which is taken into the bounds, and of a dual, whose planes it takes."""

    def regulariser_at_base(self) -> float:
        """`regulariser` of the base itself, of which o may be away."""
        return 0.0 if self.offset is None else self.regulariser([0 * at for at in self.offset])

    @abstractmethod
    def regulariser(self, z: Planes) -> float:
        """1/2 <z - o, M (z - o)> of the planes' picture (row, col)."""

    @abstractmethod
    def slope(self, p: int, z: Array) -> Array:
        """M (z - o) of a plane's picture (row, col)."""

    def weights(self, rho: float) -> list[float]:
        """Rho P, one a plane."""
        return [rho * value for value in self.hessian.metric]

    def follow(self, coarse: Level) -> None:
        """Take over what makes the next steps faster, where a coarser level has it."""
        return  # nothing, usually

    def of_coarser(
        self, light: Planes, dual: Planes, were: list[float], weights: list[float]
    ) -> Planes:
        """S of the coarser level's `state`, where weights `were` others; its dual is used up."""
        cols = self.lower[0].shape[1]
        for p, (was, weight) in enumerate(zip(were, weights, strict=True)):
            dual[p] = enlarged(dual[p], was / weight)
        return self.of_state([by_enlarged_rows(plane, cols) for plane in light], dual)

    def bounds(self, p: int, rows: slice) -> tuple[Array, Array]:
        """Lower and upper bounds of rows of a plane's light."""
        lower = self.lower[p][rows, :]
        return lower, lower + rows_of(self.width[p], rows)

    def bounded(self, light: Sequence[Rows], rows: slice) -> list[Array]:
        """Rows of light's planes, within the bounds."""
        result = []
        for p, plane in enumerate(light):
            part, (lower, upper) = plane(rows), self.bounds(p, rows)
            xp = namespace(part)
            result.append(xp.minimum(xp.maximum(part, lower), upper))
        return result

    def _inner(self, strip: slice) -> tuple[slice, slice] | None:
        """The picture's part of a strip of padded rows."""
        rows, cols = self.lower[0].shape
        if strip.start >= rows:
            return None
        return slice(strip.start, min(strip.stop, rows)), slice(0, cols)

    def _rows_of_padded(self, value: Any, rows: slice, *, inner: bool) -> Any:
        """Rows of a number or a padded plane, or of its picture's part."""
        if isinstance(value, float):
            return value
        return value[rows, : self.lower[0].shape[1]] if inner else value[rows, :]

    def _plane_towards(self, s: Array, weight: float, z: Rows) -> Array:
        """`towards` of a plane, whose z is given."""
        result = namespace(s).empty_like(s)

        def work(strip: slice) -> None:
            result[strip, :] = s[strip, :] * -weight
            if inner := self._inner(strip):
                result[inner] += z(inner[0]) * (2 * weight)

        each_strip(work, s)
        return result

    def _move_plane(self, s: Array, w: Array, relaxation: float, z: Rows) -> None:
        """`move` of a plane, whose z is given."""

        def work(strip: slice) -> None:
            w[strip, :] *= relaxation
            if inner := self._inner(strip):
                w[inner] -= z(inner[0]) * relaxation
            s[strip, :] += w[strip, :]

        each_strip(work, s)

    def _reweigh_plane(self, s: Array, ratio: float, z: Rows) -> None:
        """`reweigh` of a plane, whose z is given."""

        def work(strip: slice) -> None:
            inner = self._inner(strip)
            kept = z(inner[0]) * (1 - ratio) if inner else None
            s[strip, :] *= ratio
            if inner:
                s[inner] += kept

        each_strip(work, s)

    def _slope_at(
        self, p: int, s: Array, w: Array, weight: float, strip: slice, z: Rows, damping: Any
    ) -> tuple[float, Array]:
        """`lower_bound`'s gradient at w, of a strip of a plane, and what is known but for bounds.

        The padding is pinned: all of it is known.
        """
        at = w[strip, :]
        slope, away = (s[strip, :] + at) * -weight, at + 0
        if inner := self._inner(strip):
            part = (slice(0, inner[0].stop - inner[0].start), inner[1])
            slope[part] += z(inner[0]) * (2 * weight)
            if self.offset is not None:
                away[part] -= self.offset[p][inner[0], :]
        damped = away * damping
        known = 0.5 * (float(total(at * slope)) + float(total(damped * away)))
        slope += damped
        known -= float(total(at * slope))
        if not inner:
            return known, slope[:0, :]
        return known + float(total(at[part] * slope[part])), slope[part]


@dataclass
class BoxLevel(Level):
    """With bounds that are separate for each pixel of each plane.

    Attributes
    ----------
    hessian, target, least_damping, lower, width, offset, cost
        See `Level`. Light is z, the picture's part of each plane.
    damping
        M: a number, or (padded row, padded col).
    """

    hessian: Hessian
    target: Spectra
    lower: Planes
    width: list[Array | float]
    damping: Any
    least_damping: float
    offset: Planes | None = None
    cost: float = 0.0

    def feasible(self, s: Planes, weights: list[float]) -> Planes:
        """See `Level`."""
        return [self._feasible(p, s[p], weight) for p, weight in enumerate(weights)]

    def towards(self, s: Planes, weights: list[float]) -> Iterator[Array]:
        """See `Level`."""
        return (self._towards(p, s[p], weight) for p, weight in enumerate(weights))

    def move(self, s: Planes, w: Planes, weights: list[float], relaxation: float) -> None:
        """See `Level`."""
        for p, weight in enumerate(weights):
            self._move(p, s[p], w[p], weight, relaxation)

    def reweigh(self, s: Planes, weights: list[float], ratio: float) -> None:
        """See `Level`."""
        for p, weight in enumerate(weights):
            self._reweigh_plane(s[p], ratio, self._z(p, s[p], weight))

    def lower_bound(
        self, s: Planes, w: Planes, weights: list[float]
    ) -> Iterator[tuple[float, Array]]:
        """See `Level`."""
        return (self._lower_bound(p, s[p], w[p], weight) for p, weight in enumerate(weights))

    def regulariser(self, z: Planes) -> float:
        """See `Level`."""
        return sum(self._regulariser(p, plane) for p, plane in enumerate(z))

    def kkt_residual(self, z: Planes, gradient: Planes, mu: float) -> float:
        """Largest |x - P(x - x's gradient)|, in light, of the planes' picture; D² = mu / M."""
        return max(self._kkt_residual(p, z[p], gradient[p], mu) for p in range(len(z)))

    def _feasible(self, p: int, s: Array, weight: float) -> Array:
        rows, cols = self.lower[0].shape
        z = namespace(s).empty_like(self.lower[p])

        def work(strip: slice) -> None:
            z[strip, :] = self._nearest(p, s, strip, weight)

        each_strip(work, s[:rows, :cols])
        return z

    def _towards(self, p: int, s: Array, weight: float) -> Array:
        if self.offset is None and (compiled := loops(s)):
            result = namespace(s).empty_like(s)
            compiled.towards(result, s, *self._numbers(p, weight))
            return result
        return self._plane_towards(s, weight, self._z(p, s, weight))

    def _move(self, p: int, s: Array, w: Array, weight: float, relaxation: float) -> None:
        if self.offset is None and (compiled := loops(s)):
            compiled.move(s, w, *self._numbers(p, weight), s.dtype.type(relaxation))
        else:
            self._move_plane(s, w, relaxation, self._z(p, s, weight))

    def _lower_bound(self, p: int, s: Array, w: Array, weight: float) -> tuple[float, Array]:
        if self.offset is None and (compiled := loops(s)):
            free, curvature = namespace(s).empty_like(s), s.dtype.type(self.hessian.curvature)
            known = compiled.lower_bound(free, s, w, *self._numbers(p, weight), curvature)
            return float(known), free
        free, z = namespace(s).zeros_like(s), self._z(p, s, weight)

        def work(strip: slice) -> float:
            known, slope = self._slope_at(p, s, w, weight, strip, z, self._damping(strip))
            if inner := self._inner(strip):
                limits = *self.bounds(p, inner[0]), self.hessian.curvature
                at_bounds, free[inner] = parted(w[inner], slope, *limits)
                known -= at_bounds
            return known

        return sum(each_strip(work, s)), free

    def _regulariser(self, p: int, z: Array) -> float:

        def work(strip: slice) -> float:
            away = self._away(p, z, strip)
            return float(0.5 * total(self._damping(strip, inner=True) * away * away))

        return sum(each_strip(work, z))

    def slope(self, p: int, z: Array) -> Array:
        """See `Level`."""
        everything = slice(0, z.shape[0])
        return self._damping(everything, inner=True) * self._away(p, z, everything)

    def _kkt_residual(self, p: int, z: Array, gradient: Array, mu: float) -> float:

        def work(rows: slice) -> float:
            xp = namespace(z)
            part, damping = z[rows, :], self._damping(rows, inner=True)
            lower, upper = self.bounds(p, rows)
            moved = part - gradient[rows, :] * (mu / damping)
            away = xp.abs(part - xp.minimum(xp.maximum(moved, lower), upper))
            return float(xp.max(away * (damping / mu) ** 0.5))

        return max(each_strip(work, z))

    def coarser(self) -> BoxLevel:
        """See `Level`."""
        halves: dict[int, Any] = {}

        def half(value: Any) -> Any:
            # Planes that are one stay one
            if id(value) not in halves:
                halves[id(value)] = coarsened_value(value)
            return halves[id(value)]

        return replace(
            self,
            hessian=self.hessian.coarser,
            target=[],
            lower=[coarsened(plane[:, :]) for plane in self.lower],
            width=[half(value) for value in self.width],
            damping=half(self.damping),
            offset=None if self.offset is None else [half(plane) for plane in self.offset],
        )

    def state(self, s: Planes, weights: list[float]) -> tuple[Planes, Planes]:
        """See `Level`."""
        light, dual = self.feasible(s, weights), []
        rows, cols = light[0].shape
        for plane, z in zip(s, light, strict=True):
            dual.append(namespace(plane).asarray(plane, copy=True))
            dual[-1][:rows, :cols] -= z
        return light, dual

    def of_state(self, light: Sequence[Rows], dual: Planes) -> Planes:
        """See `Level`."""
        rows, cols = self.lower[0].shape

        def work(rows: slice) -> None:
            for plane, part in zip(dual, self.bounded(light, rows), strict=True):
                plane[rows, :cols] += part

        each_strip(work, dual[0][:rows, :cols])
        return dual

    def _numbers(self, p: int, weight: float) -> tuple[Any, ...]:
        """What the compiled loops take: bounds, damping and weight of a plane, of its type."""
        lower, width = self.lower[p], self.width[p]
        number = lower.dtype.type
        plain = [number(x) if isinstance(x, float) else x for x in (width, self.damping)]
        return lower, *plain, number(weight)

    def _nearest(self, p: int, s: Array, rows: slice, weight: float) -> Array:
        xp, cols = namespace(s), self.lower[0].shape[1]
        damping = self._damping(rows, inner=True)
        z = s[rows, :cols] * (weight / (weight + damping))
        if self.offset is not None:
            z += self.offset[p][rows, :] * (damping / (weight + damping))
        lower, upper = self.bounds(p, rows)
        return xp.minimum(xp.maximum(z, lower), upper)

    def _z(self, p: int, s: Array, weight: float) -> Rows:
        return lambda rows: self._nearest(p, s, rows, weight)

    def _damping(self, rows: slice, *, inner: bool = False) -> Any:
        return self._rows_of_padded(self.damping, rows, inner=inner)

    def _away(self, p: int, z: Array, rows: slice) -> Array:
        return z[rows, :] if self.offset is None else z[rows, :] - self.offset[p][rows, :]


def by_rows(plane: Array) -> Rows:
    """A plane's picture, by its rows."""
    return lambda rows: plane[rows, :]


def by_enlarged_rows(plane: Array, cols: int) -> Rows:
    """A picture of twice as many rows and `cols` columns, each pixel four times, by its rows."""

    def rows_of_it(rows: slice) -> Array:
        shape = (rows.stop - rows.start, cols)
        result = namespace(plane).empty(shape, dtype=plane.dtype, device=plane.device)
        _enlarge(plane, rows, result)
        return result

    return rows_of_it


def padded(picture: Array, fourier: Fourier) -> Array:
    """A (padded row, padded col) plane with a (row, col) one in its corner, and 0 around."""
    result = namespace(picture).zeros(
        (fourier.rows, fourier.cols), dtype=picture.dtype, device=picture.device
    )
    result[: picture.shape[0], : picture.shape[1]] = picture
    return result


def enlarged(plane: Array, times: float = 1.0) -> Array:
    """Twice as many rows and columns: each pixel four times, and all of it `times` a factor."""
    rows, cols = plane.shape
    shape = (2 * rows, 2 * cols)
    result = namespace(plane).empty(shape, dtype=plane.dtype, device=plane.device)

    def work(strip: slice) -> None:
        part = plane[strip, :] * times
        rows = slice(2 * strip.start, 2 * strip.stop)
        _enlarge(part, slice(0, 2 * part.shape[0]), result[rows, :])

    each_strip(work, plane)
    return result


def _enlarge(plane: Array, rows: slice, to: Array) -> None:
    """Set `to` to rows of a plane of which each pixel is there four times."""
    wide = to.shape[1]
    for i in range(2):
        first, number = (rows.start + i) // 2, (rows.stop - rows.start - i + 1) // 2
        for j in range(2):
            to[i::2, j::2] = plane[first : first + number, : (wide - j + 1) // 2]


def coarsened(plane: Array) -> Array:
    """Half as many rows and columns: means of 2 x 2, with a 0 beyond an odd edge."""
    rows, cols = plane.shape
    if rows % 2 == 0 and cols % 2 == 0:
        return halved(plane)
    xp = namespace(plane)
    even = xp.zeros((rows + rows % 2, cols + cols % 2), dtype=plane.dtype, device=plane.device)
    even[:rows, :cols] = plane
    return halved(even)


def coarsened_value(value: Value) -> Value:
    """`coarsened` where it is a plane."""
    return value if isinstance(value, float) else coarsened(value)


def rows_of(value: Value, rows: slice) -> Value:
    """Rows of a plane, where it is one."""
    return value if isinstance(value, float) else value[rows, ...]
