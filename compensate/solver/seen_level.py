"""A stereo pair's problem in what is seen: Fourier diagonalises it whatever the crosstalk.

Crosstalk that differs from pixel to pixel (a map, a linearised table), or is seen under a contrast
K that does, mixes no pixels. So, with d = x - x_a the change of the clipped subtraction and M the
small matrix of each pixel, let the variable be the change of what is seen

    w = K M d:     f(w) = 1/2 ||A (w + t)||²,   t: what is seen too much at the base

whose Hessian A'A Fourier diagonalises exactly, view by view. All that differs from pixel to pixel
is in the set of what can be seen, {K M d: lower <= x_a + d <= upper}, and the z-step's projection
on it is a small bound-constrained least squares of each pixel: of both eyes' light in one primary

    min_d  sum over eyes v of K_v² (M_v d - s_v / K_v)²

Its solution without bounds is M^-1 (s / K). Where that is out of bounds, the solution lies on the
edge of a light that is: the better of two candidates. (At the edge of another light alone, d would
have to be drawn beyond it, where M^-1 (s / K) is not.) Where primaries leak into others, three such
problems are solved in turn, again and again.

The lower bound of `certificate` is in d: with q = M' K g and any split q = q_B + q_F, the bounds
limit what q_B can win, and the quadratic what is left, g_F = g - g_B where M' K g_B = q_B.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from compensate.solver.blocks import Spectra
from compensate.solver.certificate import CURVATURE
from compensate.solver.fused import loops
from compensate.solver.hessian import Hessian
from compensate.solver.level import Level, Planes, padded
from domesim.light import Array, Light, dot, namespace, total
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.stereo import StereoObservation
from domesim.strips import in_parts


@final
@dataclass
class SeenLevel(Level):
    """The problem in w = K M d.

    Attributes
    ----------
    hessian, target, least_damping, cost
        See `Level`.
    observation
        Of both eyes; its linear part is M.
    contrast
        (view, row, col, 1) K.
    lower, upper
        (view, row, col, primary) bounds of d.
    offset
        (view, row, col, primary) o = K M (x_0 - x_a) of the regulariser's light x_0, or None where
        that is x_a.
    """

    hessian: Hessian
    target: Spectra
    least_damping: float
    observation: StereoObservation
    contrast: Light
    lower: Light
    upper: Light
    offset: Light | None = None
    cost: float = 0.0
    _own: Light = field(init=False)
    _other: Light = field(init=False)
    _leaks: list[Any] | None = field(init=False, default=None)
    _share: Light = field(init=False, default=None)
    _kept: tuple[Planes, Planes] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self._own, self._other = self.observation.slopes(self.lower)
        observation = self.observation
        if isinstance(observation, Crosstalk):
            matrices = observation.matrices
            if any(np.any(matrix - np.diag(np.diag(matrix))) for matrix in matrices):
                self._leaks = matrices.tolist()
                self._share = namespace(self.lower).asarray(
                    observation.share, dtype=self.lower.dtype, device=self.lower.device
                )

    def start(self, picture: Planes | None = None) -> Planes:
        """See `Level`."""
        views, _, _, primaries = self.lower.shape
        if picture is None:
            picture = [self.lower[0, :0, :, 0]] * (views * primaries)
        return [padded(plane, self.hessian.fourier) for plane in picture]

    def feasible(self, s: Planes, weights: list[float]) -> Planes:
        """See `Level`."""
        compiled = loops(*s)
        if self._leaks is None and self.offset is None and compiled:
            return self._compiled_feasible(compiled, s, weights)
        return self._planes(self.seen(self.change(self._inner(s), weights)))

    def _compiled_feasible(self, compiled: Any, s: Planes, weights: list[float]) -> Planes:
        views, rows, cols, primaries = self.lower.shape
        z = [np.empty((rows, cols), s[0].dtype) for _ in range(views * primaries)]
        pixelwise = (self._own, self._other, self.lower, self.upper)
        for p in range(primaries):
            number = s[0].dtype.type
            shrink = number(weights[p] / (weights[p] + self.least_damping))
            q = p + primaries
            compiled.nearest_pair(
                *(z[p], z[q], s[p], s[q], self.contrast[..., 0]),
                *(np.broadcast_to(array[..., p], (views, rows, cols)) for array in pixelwise),
                shrink,
            )
        return z

    def towards(self, s: Planes, weights: list[float]) -> Iterator[Array]:
        """See `Level`; z is kept for `move`."""
        z = self.feasible(s, weights)
        self._kept = s, z
        rows, cols = z[0].shape
        for plane, inner, weight in zip(s, z, weights, strict=True):
            result = plane * -weight
            result[:rows, :cols] += inner * (2 * weight)
            yield result

    def move(self, s: Planes, w: Planes, weights: list[float], relaxation: float) -> None:
        """See `Level`."""
        z = self._feasible_again(s, weights)
        self._kept = None
        rows, cols = z[0].shape
        for p, plane in enumerate(z):
            w[p] *= relaxation
            w[p][:rows, :cols] -= plane * relaxation
            s[p] += w[p]

    def _feasible_again(self, s: Planes, weights: list[float]) -> Planes:
        """`feasible`, as `towards` found it if s is the same still."""
        if self._kept is not None and self._kept[0] is s:
            return self._kept[1]
        return self.feasible(s, weights)

    def reweigh(self, s: Planes, weights: list[float], ratio: float) -> None:
        """See `Level`."""
        self._kept = None
        for p, z in enumerate(self.feasible(s, weights)):
            rows, cols = z.shape
            s[p] *= ratio
            s[p][:rows, :cols] += z * (1 - ratio)

    def lower_bound(
        self, s: Planes, w: Planes, weights: list[float]
    ) -> Iterator[tuple[float, Array]]:
        """See `Level`: the first part is everything that is known."""
        xp, mu = namespace(s[0]), self.least_damping
        z = self._feasible_again(s, weights)
        rows, cols = z[0].shape
        known, slopes = 0.0, []
        for p, weight in enumerate(weights):
            slope = (s[p] + w[p]) * -weight
            slope[:rows, :cols] += z[p] * (2 * weight)
            damped = w[p] * mu
            damped[:rows, :cols] = self.slope(p, w[p][:rows, :cols])
            known += 0.5 * float(total(w[p] * slope)) + 0.5 / mu * float(total(damped**2))
            slope += damped
            # The padding is pinned: all of it is known
            beyond = w[p] * slope
            known -= float(total(beyond)) - float(total(beyond[:rows, :cols]))
            slopes.append(slope[:rows, :cols])
        gradient = self._light(slopes)
        inside = self._light([plane[:rows, :cols] for plane in w])
        change = self.projected(inside)
        q = self._back(gradient)
        distance = xp.where(q > 0, change - self.lower, self.upper - change)
        size = xp.abs(q)
        # What bounds allow to win, against the quadratic's share
        curvature = 2 * CURVATURE * (self._own * self.contrast) ** 2
        at_bounds = self._from_back(xp.where(distance * curvature <= size, q, 0 * q))
        q = self._back(at_bounds)
        least = xp.where(q > 0, self.lower, self.upper)
        known += dot(q, least) - dot(at_bounds, inside)
        for number, plane in enumerate(self._planes(gradient - at_bounds)):
            yield known if number == 0 else 0.0, padded(plane, self.hessian.fourier)

    def regulariser_at_base(self) -> float:
        """See `Level`."""
        if self.offset is None:
            return 0.0
        return 0.5 * self.least_damping * dot(self.offset, self.offset)

    def regulariser(self, z: Planes) -> float:
        """See `Level`."""
        away = [self.slope(p, plane) for p, plane in enumerate(z)]
        return 0.5 / self.least_damping * sum(dot(plane, plane) for plane in away)

    def slope(self, p: int, z: Array) -> Array:
        """See `Level`."""
        if self.offset is not None:
            view, primary = divmod(p, self.lower.shape[3])
            z = z - self.offset[view, :, :, primary]
        return z * self.least_damping

    def seen(self, change: Light) -> Light:
        """K M d."""
        return self.observation.linear(change) * self.contrast

    def projected(self, seen: Light) -> Light:
        """M^-1 (w / K)."""
        return self._unmixed(seen / self.contrast)

    def change(self, target: Light, weights: list[float] | None = None) -> Light:
        """The change d within the bounds whose K M d is nearest to a `target`.

        Parameters
        ----------
        target
            (view, row, col, primary) s.
        weights
            Rho P, one a plane, by which the regulariser shrinks it; None for none.
        """
        xp = namespace(target)
        primaries = target.shape[3]
        shrink = [1.0] * primaries
        if weights is not None:
            shrink = [weight / (weight + self.least_damping) for weight in weights[:primaries]]
        metric = [weight + self.least_damping for weight in weights or [1.0] * primaries]
        factors, metric = (
            xp.asarray(numbers, dtype=target.dtype, device=target.device)
            for numbers in (shrink, metric[:primaries])
        )
        wanted = target * factors
        if weights is not None and self.offset is not None:
            wanted += self.offset * (1 - factors)
        wanted /= self.contrast
        free = self._unmixed(wanted)
        result = xp.empty_like(free)

        def work(_: int, rows: slice) -> None:
            part = (slice(None), rows)
            result[part] = self._nearest(wanted[part], free[part], rows, metric)

        in_parts(work, (1, *free.shape[1:]), free)
        return result

    def _nearest(self, wanted: Light, free: Light, rows: slice, metric: Array) -> Light:
        """The nearest lights within the bounds, of rows; `free` are those without.

        The `metric` of primaries counts only where they mix.
        """
        xp = namespace(free)
        part = (slice(None), rows)
        lower, upper = self.lower[part], self.upper[part]
        first = xp.minimum(xp.maximum(free, lower), upper)
        beyond = xp.any(first != free, axis=0)
        if self._leaks is not None:
            beyond = xp.any(beyond, axis=-1)
        if not bool(xp.any(beyond)):
            return first
        places = (slice(None), beyond)

        def there(array: Light) -> Light:
            return xp.broadcast_to(array, (*array.shape[:1], *first.shape[1:]))[places]

        k = there(self.contrast[part] ** 2)
        start, low, high = there(free), there(lower), there(upper)
        if self._leaks is None:
            own, other = (there(_rows(array, rows)) for array in (self._own, self._other))
            first[places] = nearest_of_two(start, low, high, *_curvature(k, own, other))
            return first
        share = self._share if self._share.shape[1] == 1 else self._share[part]
        share = xp.broadcast_to(share, (2, *first.shape[1:3]))[places]
        aim = there(wanted)
        first[places] = nearest_mixed(aim, start, low, high, k * metric, self._leaks, share)
        return first

    def _unmixed(self, seen: Light) -> Light:
        """M^-1."""
        return self._inverse(self.observation.linear, self._other, seen)

    def _from_back(self, gradient: Light) -> Light:
        """The g of which q = M' K g."""
        # A matrix's transpose has the other eye's entry
        other = namespace(gradient).flip(self._other, axis=0)
        return self._inverse(self.observation.adjoint, other, gradient) / self.contrast

    def _inverse(self, matrix: Callable[[Light], Light], other: Light, values: Light) -> Light:
        """Of a `matrix` M or M': of each primary alone, and of others' leaks little by little."""
        own = self._own
        result = _unmixed(values, own, other)
        for _ in range(0 if self._leaks is None else _ROUNDS):
            alone = own * result + other * namespace(result).flip(result, axis=0)
            before, result = result, _unmixed(values - (matrix(result) - alone), own, other)
            if _settled(result, before):
                break
        return result

    def _back(self, gradient: Light) -> Light:
        """M' K g."""
        return self.observation.adjoint(gradient * self.contrast)

    def _inner(self, s: Planes) -> Light:
        rows, cols = self.lower.shape[1:3]
        return self._light([plane[:rows, :cols] for plane in s])

    def _light(self, planes: Planes) -> Light:
        xp = namespace(planes[0])
        views, rows, cols, primaries = self.lower.shape
        stacked = xp.stack(planes)
        return xp.permute_dims(xp.reshape(stacked, (views, primaries, rows, cols)), (0, 2, 3, 1))

    def _planes(self, light: Light) -> Planes:
        xp = namespace(light)
        views, _, _, primaries = light.shape
        return [
            xp.asarray(light[v, :, :, p], copy=True) for v in range(views) for p in range(primaries)
        ]


_ROUNDS = 60  # of leaks into other primaries: each makes them less by a factor of them
_SWEEPS = 3000


def nearest_of_two(
    free: Light, lower: Light, upper: Light, curvature: Light, cross: Light
) -> Light:
    """The d within bounds that is nearest to `free` in the metric of 2 x 2 matrices.

    Parameters
    ----------
    free, lower, upper
        (2, ...) both eyes' light without bounds, and the bounds.
    curvature, cross
        (2, ...) diagonal, and (1, ...) the other entry, of the matrices H.
    """
    xp = namespace(free)

    def theirs(array: Light) -> Light:
        return xp.flip(array, axis=0)

    first = xp.minimum(xp.maximum(free, lower), upper)
    beyond = first != free
    # Each eye's best light where the other's is at its bound
    away = theirs(first - free)
    best = xp.minimum(xp.maximum(free - cross / curvature * away, lower), upper)
    moved = best - free
    error = curvature * moved**2 + 2 * cross * moved * away + theirs(curvature) * away**2
    # Where both are beyond, the better of the two; of two alike, any
    rank = xp.reshape(xp.asarray([0, 1], device=free.device), (2,) + (1,) * (free.ndim - 1))
    before = (error < theirs(error)) | ((error == theirs(error)) & (rank < theirs(rank)))
    return xp.where(theirs(beyond) & (~beyond | before), best, first)


def nearest_mixed(
    wanted: Light, start: Light, lower: Light, upper: Light, k: Light, leaks: Any, share: Light
) -> Light:
    """The d within bounds whose M d is nearest to `wanted`, primary after primary in turn.

    Parameters
    ----------
    wanted, start, lower, upper
        (view, place, primary) what should be seen, where to start, and the bounds.
    k
        (view, place, primary) K², and the metric of primaries.
    leaks, share
        (view, primary, primary) as lists, and (view, place), of `Crosstalk`.
    """
    xp = namespace(wanted)
    d = xp.minimum(xp.maximum(start, lower), upper)
    primaries = range(wanted.shape[2])
    leak = [[[leaks[v][r][p] * share[v] for p in primaries] for r in primaries] for v in range(2)]

    def seen(v: int, r: int) -> Light:
        leaked = sum(leak[v][r][p] * d[1 - v, :, p] for p in primaries)
        return d[v, :, r] + leaked

    for _ in range(_SWEEPS):
        before = xp.asarray(d, copy=True)
        for p in primaries:
            missing = [
                [(seen(v, r) - wanted[v, :, r]) * k[v, :, r] for r in primaries] for v in range(2)
            ]
            slope, curvature = [], []
            for v in range(2):
                u, column = 1 - v, [leak[1 - v][r][p] for r in primaries]
                slope.append(missing[v][p] + sum(column[r] * missing[u][r] for r in primaries))
                others = sum(c * c * k[u, :, r] for r, c in enumerate(column))
                curvature.append(k[v, :, p] + others)
            cross = leak[0][p][p] * k[0, :, p] + leak[1][p][p] * k[1, :, p]
            h = xp.stack(curvature)
            determinant = h[0] * h[1] - cross * cross
            g = xp.stack(slope)
            step = (xp.flip(h, axis=0) * g - cross * xp.flip(g, axis=0)) / determinant
            low, high = lower[..., p], upper[..., p]
            d[..., p] = nearest_of_two(d[..., p] - step, low, high, h, cross[None, :])
        if _settled(d, before):
            break
    return d


def _settled(values: Light, before: Light) -> bool:
    """Whether they are the same, to a precision that rounding lets them reach."""
    xp = namespace(values)
    scale = max(float(xp.max(xp.abs(values))), _LEAST)
    share = max(_SETTLED, 2 * float(xp.finfo(values.dtype).eps))
    return float(xp.max(xp.abs(values - before))) <= share * scale


_SETTLED, _LEAST = 1e-7, 1e-30


def _curvature(k: Light, own: Light, other: Light) -> tuple[Light, Light]:
    """H = M' K² M of each primary alone: its diagonal (2, ...), and the other entry (1, ...)."""
    xp = namespace(k)
    diagonal = k * own**2 + xp.flip(k * other**2, axis=0)
    return diagonal, xp.sum(k * own * other, axis=0, keepdims=True)


def _unmixed(seen: Light, own: Light, other: Light) -> Light:
    """The inverse of each primary's 2 x 2 matrix."""
    xp = namespace(seen)
    their_own = xp.flip(own, axis=0)
    determinant = own * their_own - other * xp.flip(other, axis=0)
    return (their_own / determinant) * seen - (other / determinant) * xp.flip(seen, axis=0)


def _rows(array: Light, rows: slice) -> Light:
    """Rows of (view, row or 1, col or 1, primary)."""
    return array if array.shape[1] == 1 else array[:, rows, ...]
