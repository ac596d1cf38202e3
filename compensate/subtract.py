"""Exact clipped subtraction: the light that shows what is wanted, wherever any light can.

Showing ``wanted - phi(wanted)`` subtracts the pollution of a picture that is not shown. The exact
solution subtracts that of the light x that *is* shown:

    x = clip(D^-1 (wanted - ambient - phi(x)))                                      (eq. 1, exact)

It is no least-squares solution. A pixel that can show what is wanted does, and takes no error from
its neighbours. With crosstalk of 0.1 and (0.005, 0.4) wanted it shows (0, 0.4); least squares show
(0, 0.39653).

*What domes and pairs have in common.* Light reaches other places as s = K V'x, a few sums, and
other views pixel by pixel: what is seen is C (D x + S s + ambient), and so, in each view,

    x = clip(free - M x_u),          free = D^-1 (wanted - C S s - dark)

with x_u the other view's light, M the crosstalk, and `dark` what is seen without a picture. On a
flat screen s is empty; of one view M is 0. For a given s rounds solve x in each strip of pixels.
Each round multiplies the error by M: at 2 % crosstalk it shrinks fiftyfold. s is the root of
s - K V'x(s), which is piecewise linear: Newton's method on its pieces (semismooth Newton) takes a
few steps. Its slopes leave out M.

*Any other observation*, a table from grey to grey or one of your own, is solved by rounds of all
pixels; along a table, with each view's own light found exactly in every round. Each round
multiplies the error by the ratio of pollution to picture. Where rounds do not settle, pollution is
as strong as the picture.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache, reduce
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias, TypeVar, final

import numpy as np
import scipy
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.light import Array, Light, namespace
from domesim.light.planes import (
    Columns,
    Index,
    Planes,
    compact,
    dtype_of,
    empty_light,
    every,
    once,
    planes_of,
)
from domesim.light.strips import in_strips, product, summed
from domesim.observation.base import Observation
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.dome_pair import ReflectedViews
from domesim.observation.followed import Followed
from domesim.observation.grey_to_grey import GreyToGrey
from domesim.observation.lowrank import LowRank, LowRankObservation
from domesim.observation.stereo import StereoObservation

Floats = NDArray[Any]
At: TypeAlias = tuple[Index, Index]
"""Rows and columns."""
T = TypeVar("T")

MAX_ROUNDS = 1000
"""Most rounds, or Newton steps: crosstalk of 90 %, the largest possible, takes 340 rounds to
float64's rounding."""

_EVERY = 8  # a first estimate of s is made of every eighth row and column
_SETTLED = 1e-7  # of s
_FAR = 1e-3  # of s: Newton's steps that lead from nearer than that are not doubted
_NEAR = 1e-5
"""Distance of light from a bound, of white, that is near."""
_ROUNDING = 1e-8  # of a single-precision number near 1
_TINY = 1e-30  # so that nothing is divided by 0
_NOTHING = 1e-8
"""Light, of white, by which s may be off."""


def subtracted(
    observation: Observation,
    wanted: Light,
    bounds: tuple[Array | float, Array | float] = (0.0, 1.0),
    *,
    start: Light | None = None,
    out: Light | None = None,
    max_rounds: int = MAX_ROUNDS,
    columns: Columns | None = None,
) -> tuple[Light, int]:
    """Finds the light within bounds that shows what is wanted, wherever any light can.

    Parameters
    ----------
    observation
        What is seen of light, at one seat.
    wanted
        (view, row, col, primary) what should be seen, 1 = projector white.
    bounds
        Lower and upper bound of the light: numbers, or arrays that broadcast with it.
    start
        Light that is near the result: it saves rounds of all pixels.
    out
        Where the light may be put, such as `wanted` itself; a new array by default.
    max_rounds
        Rounds, or Newton steps, at most.
    columns
        What a dome's screen takes of strips, if nothing is wanted off it, nor may be shown.

    Returns
    -------
    light, rounds
        The light, and the rounds taken. If those are `max_rounds`, it has not been reached.

    Raises
    ------
    InputError
        If several seats look at once, or light is not seen where it is shown: D has a 0.
    """
    if observation.shape != observation.seen_shape:
        raise InputError(f"subtraction is of one seat, got {observation.seen_shape} seen")
    parts = None
    if isinstance(observation, LowRankObservation) and columns is not None:
        parts = _of_dome(observation.on_screen_like(wanted))
    elif isinstance(wanted, np.ndarray):
        parts = _parts(observation, wanted)
    if parts is not None:
        planes, shape, dtype = planes_of(wanted), wanted.shape, wanted.dtype
        strips = _Strips(parts, planes, shape, dtype, bounds, max_rounds, columns)
        s, steps = _settled(strips)
        light, written = strips.written(s, out)
        return light, max(steps, written)  # eq. 1
    return _by_rounds(observation, wanted, bounds, start, max_rounds)


@final
class Floor:
    """Light of a dome that is not its picture's own, where a master is subtracted exactly.

    It is the room's light and reflected light. A few sums tell it, without what is projected.

    Parameters
    ----------
    observation
        What is seen of light.
    wanted
        What should be seen; 0 off the screen.
    upper
        Largest light, which broadcasts; the least is 0.
    columns
        What the screen takes of strips; all columns by default.
    """

    def __init__(
        self,
        observation: LowRankObservation,
        wanted: Planes,
        upper: Floats | float = 1.0,
        columns: Columns | None = None,
    ) -> None:
        dtype, shape = dtype_of(wanted), observation.shape
        parts = _of_dome(observation.on_screen_like(np.empty(0, dtype)))
        bounds, self._screen = (0.0, upper), observation.screen
        self._strips = _Strips(parts, wanted, shape, dtype, bounds, MAX_ROUNDS, columns)
        self._s, _ = _settled(self._strips)

    def planes(self, view: int, rows: Index, cols: Index) -> list[Floats]:
        """Computes a part of the floor.

        Parameters
        ----------
        view
            0: a dome of one view has one.
        rows, cols
            Which.

        Returns
        -------
        planes
            Of each primary: they broadcast with (row, col).
        """
        return self._strips.floor((rows, cols), self._s)

    def subtracted(self) -> Light:
        """Returns the light of exact clipped subtraction, (1, row, col, primary)."""
        return self._strips.written(self._s, None)[0]

    def projected(self, rows: Index, cols: Index) -> tuple[list[Floats], list[Floats]]:
        """Subtracts exactly from a part, (row, col) of each primary.

        Parameters
        ----------
        rows, cols
            Which.

        Returns
        -------
        light, left
            What is projected, and what is seen too much, negative for too little.
        """
        at = rows, cols
        shown, gain = self._strips.shown(at, self._s), self._strips.k.gain
        left = [x - free for x, free in zip(shown.light, shown.free, strict=True)]
        return shown.light, left if gain is None else [each * gain[at] for each in left]

    def leaves(self, most: float) -> bool:
        """Says whether more than `most` is seen too much, or too little, anywhere."""
        found = threading.Event()  # which ends the search

        def look(at: At) -> None:
            if not found.is_set():
                left, on = self.projected(*at)[1], self._screen[at]
                if max(float(np.abs(each).max(where=on, initial=0)) for each in left) > most:
                    found.set()

        self._strips.each(look)
        return found.is_set()


def reflecting(observation: Observation) -> LowRankObservation | None:
    """Returns what reflects light over the screen: of two views, how their sum is reflected.

    None if nothing reflects.
    """
    if isinstance(observation, LowRankObservation):
        return observation
    if isinstance(observation, ReflectedViews):
        return observation.summed
    if isinstance(observation, Followed):
        return reflecting(observation.first) or reflecting(observation.then)
    return None


def newton_step(core: Floats, sums: Floats, slopes: Floats, s: Floats) -> Floats:
    """Computes Newton's step of s towards K V'x(s).

    Parameters
    ----------
    core
        (group, n, n) K: primaries that do not mix are groups of their own.
    sums
        (group, n) V'x of the light x(s).
    slopes
        (group, n, n) how sums fall as s rises.
    s
        (group, n).

    Returns
    -------
    change
        (group, n) to add to s.
    """
    system = np.eye(s.shape[1]) + core @ slopes
    off = (core @ sums[..., None])[..., 0] - s
    return np.asarray(np.linalg.solve(system, off[..., None])[..., 0])


@final
class _Parts(NamedTuple):
    """What is seen as C (D x + S s + ambient), s = K V'x.

    Attributes
    ----------
    gain
        (row, col) D; None for 1.
    spread, collect
        (rank, row, col) S and V.
    core
        (group, n, n) K: a group a primary, or one of all views and primaries.
    leaks
        (view primary, view primary) C; None for 1.
    dark
        What is seen without a picture, which broadcasts with light; None if nothing is.
    crosstalk
        M; None of one view.
    """

    gain: Floats | None
    spread: Floats
    collect: Floats
    core: Floats
    leaks: Floats | None
    dark: Floats | None
    crosstalk: Crosstalk | None

    def every(self, step: int) -> _Parts:
        """Those of every so many rows and columns, whose pixels stand for their neighbours'."""

        def some(array: Floats) -> Floats:
            return compact(array[..., ::step, ::step])

        dark = None if self.dark is None else compact(self.dark[:, ::step, ::step])
        return self._replace(
            gain=None if self.gain is None else some(self.gain),
            spread=some(self.spread),
            collect=some(self.collect),
            core=self.core * step**2,
            dark=dark,
        )


def _parts(observation: Observation, like: Floats) -> _Parts | None:
    """The parts of an observation that has them, else None."""
    if isinstance(observation, LowRankObservation):
        return _of_dome(observation.factors_like(like))
    if isinstance(observation, Crosstalk):
        none = np.zeros((0, *like.shape[1:3]), like.dtype)
        dark = observation.dark.astype(like.dtype)
        return _Parts(None, none, none, np.zeros((1, 0, 0)), None, dark, observation)
    if isinstance(observation, Followed):
        first, then = observation.first, observation.then
        if isinstance(first, ReflectedViews) and isinstance(then, Crosstalk):
            return _pair_in_a_dome(first, then, like.dtype)
    return None


def _of_dome(f: LowRank) -> _Parts:
    """The parts of a dome of one view."""
    gain = None if (once(f.direct_gain) == 1).all() else f.direct_gain
    dark = np.moveaxis(f.ambient, 0, -1)[None] if once(f.ambient).any() else None
    return _Parts(gain, f.spread, f.collect, f.core, None, dark, None)


@lru_cache(maxsize=1)
def _pair_in_a_dome(reflected: ReflectedViews, crosstalk: Crosstalk, dtype: Any) -> _Parts | None:
    """The parts of a 3D dome; None if crosstalk differs over the screen, or has a black."""
    if crosstalk.share.shape[1:] != (1, 1) or crosstalk.black.any():
        return None
    spread, collect, core = reflected.modes()
    size = core.shape[0] * core.shape[1]
    dark = reflected.ambient(np.zeros(reflected.shape, dtype))
    return _Parts(
        gain=np.where(reflected.screen, reflected.direct_gain, 1).astype(dtype),
        spread=np.asarray(spread, dtype),
        collect=np.asarray(collect, dtype),
        core=core.reshape(1, size * core.shape[2], -1),
        leaks=crosstalk.central.reshape(size, size),
        dark=None if dark is None else crosstalk.linear(dark),
        crosstalk=crosstalk,
    )


def _settled(strips: _Strips) -> tuple[Floats, int]:
    """s, and Newton's steps: of every eighth row and column first, and then of all.

    A step is exact but for light that comes to a bound on the way, or leaves it. Where few pixels
    are as near to one as the step is short, no further look at all of them is needed. Where
    reflected light is stronger than the picture, a step may lead further from the root, or to and
    fro: it is halved then.
    """
    s, near = np.zeros(strips.k.core.shape[:2]), 1.0
    if not s.size:
        return s, 0
    some = strips.every(_EVERY)
    for each in (some, strips):
        change, least = np.zeros_like(s), math.inf
        for steps in range(1, strips.max_rounds + 1):  # noqa: B007 - the last one is told
            step, off = each.newton(s)
            if off >= least and off > _FAR * np.abs(s).max():
                change = change / 2
                s -= change
                continue
            change, least = step, off
            s += change
            moved = float((np.abs(each.excited(change)) @ each.reach).max())
            if np.abs(change).max() <= _SETTLED * max(np.abs(s).max(), _SETTLED):
                break
            if moved <= _NEAR and moved * near <= _NOTHING:
                break
        near = some.near(s) if each is some else near
    return s, steps


class _Shown(NamedTuple):
    """Light of some rows.

    Attributes
    ----------
    rounds
        That it took.
    free, light
        (row, col) of each view and primary: what would show what is wanted, and within bounds.
    bounds
        Lower and upper one of each.
    modes
        (rank, row, col) S over D.
    """

    rounds: int
    free: list[Floats]
    light: list[Floats]
    bounds: list[tuple[Floats, Floats]]
    modes: Floats


@final
class _Strips:
    """Light of a given s, strip by strip of rows."""

    def __init__(
        self,
        k: _Parts,
        wanted: Planes,
        shape: tuple[int, ...],
        dtype: np.dtype[Any],
        bounds: tuple[Floats | float, Floats | float],
        max_rounds: int,
        columns: Columns | None = None,
    ) -> None:
        self.k, self.max_rounds, self.planes = k, max_rounds, list(np.ndindex(shape[::3]))
        self._wanted, self._shape, self._dtype, self._columns = wanted, shape, dtype, columns
        self._lower, self._upper = (_bound(each, shape, dtype) for each in bounds)
        self._dark = None if k.dark is None else np.broadcast_to(k.dark, shape)
        self._mixing = None if k.crosstalk is None else _Mixing(k.crosstalk)

    @cached_property
    def reach(self) -> Floats:
        """(rank,) most light by which a unit of s shifts what is seen."""
        return np.asarray(np.abs(once(self.k.spread)).max(axis=(1, 2)))

    def every(self, step: int) -> _Strips:
        """Those of every so many rows and columns."""
        wanted, some = every(self._wanted, self._shape[0], step), slice(None, None, step)
        at = slice(None), some, some
        bounds = compact(self._lower[at]), compact(self._upper[at])
        return _Strips(
            self.k.every(step),
            planes_of(wanted),
            wanted.shape,
            self._dtype,
            bounds,
            self.max_rounds,
        )

    def each(self, work: Callable[[At], T]) -> list[T]:
        """What `work` returns for the rows and columns of each strip."""
        _, rows, cols, _ = self._shape

        def strip(_: int, some: slice) -> T:
            return work((some, slice(0, cols) if self._columns is None else self._columns.of(some)))

        return in_strips(strip, (1, rows, cols, len(self.planes)))

    def excited(self, s: Floats) -> Floats:
        """(plane, rank) by how much S is seen."""
        each = s.reshape(len(self.planes), len(self.k.spread))
        return each if self.k.leaks is None else self.k.leaks @ each

    def floor(self, at: At, s: Floats) -> list[Floats]:
        """What is seen without own light, of each view and primary: it broadcasts with a part."""
        k, floor, excited = self.k, [], self.excited(s).astype(self._dtype)
        for (v, p), by in zip(self.planes, excited, strict=True):
            modes = [once(mode) * each for mode, each in zip(k.spread[:, *at], by, strict=True)]
            plane = reduce(np.add, modes) if modes else np.zeros((), by.dtype)
            if self._dark is not None:
                plane = plane + once(self._dark[v, *at, p])
            floor.append(plane)
        return floor

    def shown(self, at: At, s: Floats) -> _Shown:
        """The light of s in a part."""
        k, free = self.k, []
        modes = k.spread[:, *at] if k.gain is None else k.spread[:, *at] / k.gain[at]
        wanted = [plane for view in range(self._shape[0]) for plane in self._wanted(view, *at)]
        for own, floor in zip(wanted, self.floor(at, s), strict=True):
            plane = np.subtract(own, floor, out=floor if floor.shape == own.shape else None)
            if k.gain is not None:
                plane /= k.gain[at]
            free.append(plane)
        bounds = [(self._lower[v, *at, p], self._upper[v, *at, p]) for v, p in self.planes]
        if self._mixing is None:
            light = [_clipped(*each) for each in zip(free, bounds, strict=True)]
            return _Shown(0, free, light, bounds, modes)
        rounds, light = self._mixing.settled(free, bounds, at, self.max_rounds)
        return _Shown(rounds, free, light, bounds, modes)

    def written(self, s: Floats, out: Floats | None) -> tuple[Floats, int]:
        """The light of s, and the rounds that it took."""
        light = empty_light(self._shape, self._dtype) if out is None else out

        def write(at: At) -> int:
            shown, (rows, cols) = self.shown(at, s), at
            for (v, p), plane in zip(self.planes, shown.light, strict=True):
                light[v, rows, cols, p] = plane
            assert isinstance(cols, slice)
            for beside in (slice(0, cols.start), slice(cols.stop, light.shape[2])):
                light[:, rows, beside] = 0
            return shown.rounds

        return light, max(self.each(write))

    def newton(self, s: Floats) -> tuple[Floats, float]:
        """Newton's step of s, and how far from the root s is."""
        sums, slopes = (
            sum(part) for part in zip(*self.each(lambda at: self._sums(at, s)), strict=True)
        )
        if len(s) == 1:
            slopes = scipy.linalg.block_diag(*slopes)[None]
        sums = sums.reshape(s.shape)
        off = np.abs((self.k.core @ sums[..., None])[..., 0] - s).max()
        return newton_step(self.k.core, sums, slopes, s), float(off)

    def _sums(self, at: At, s: Floats) -> tuple[Floats, Floats]:
        """(plane, rank) V'x of a part, and (plane, rank, rank) how it falls as s rises."""
        shown, collect = self.shown(at, s), self.k.collect[:, *at]
        overlaps = [[each * mode for mode in shown.modes] for each in collect]
        if self._mixing is None:
            moving = [x == free for x, free in zip(shown.light, shown.free, strict=True)]
        else:
            bounds = zip(shown.light, shown.bounds, strict=True)
            moving = [(x > low) & (x < high) for x, (low, high) in bounds]
        all_move = np.array([[summed(m) for m in line] for line in overlaps])
        return (
            np.array([[product(each, x) for each in collect] for x in shown.light]),
            np.array(
                [
                    all_move if on.all() else [[summed(on * m) for m in line] for line in overlaps]
                    for on in moving
                ]
            ),
        )

    def near(self, s: Floats) -> float:
        """Share of the light that lies within `_NEAR` of a bound and moves; very likely less."""

        def count(at: At) -> int:
            shown = self.shown(at, s)
            reach = np.abs(shown.modes).sum(axis=0) * (_NEAR / max(self.reach.max(), _TINY))
            near = [
                np.abs(free - bound) < reach
                for free, bounds in zip(shown.free, shown.bounds, strict=True)
                for bound in bounds
            ]
            return int(np.count_nonzero(near))

        # Of n that are drawn, the share of none is below 3 / n, 19 times of 20
        return (sum(self.each(count)) + 3) / math.prod(self._shape)


def _bound(bound: Floats | float, shape: tuple[int, ...], dtype: np.dtype[Any]) -> Floats:
    """A bound of each sample; of a whole row, which NumPy takes faster than a single number."""
    bound = np.asarray(bound, dtype)
    if bound.size == 1:
        bound = np.full((1, 1, shape[2], 1), bound.item(), dtype)
    return np.broadcast_to(bound, shape)


@final
class _Mixing:
    """Crosstalk between planes (row, col) of light: of the first view in each primary, then on."""

    def __init__(self, crosstalk: Crosstalk) -> None:
        views, primaries = crosstalk.leaks.shape[:2]
        size = views * primaries
        inverse = np.linalg.inv(crosstalk.central.reshape(size, size))
        # Of many views most entries are rounding: views far apart
        self._inverse = np.where(np.abs(inverse) > _ROUNDING, inverse, 0)
        self._share = crosstalk.share
        self._leaks = crosstalk.leaks.reshape(views, primaries, size)

    def settled(
        self, free: Sequence[Floats], bounds: Sequence[Any], at: At, max_rounds: int
    ) -> tuple[int, list[Floats]]:
        """The rounds taken, and light x_v = clip(free_v - sum M_vu x_u) of a part, within bounds.

        It begins with what subtracts the mean of the map: where that is flat and nothing clips,
        this is the result.
        """
        light = [
            _clipped(_sum(line, free), each)
            for line, each in zip(self._inverse, bounds, strict=True)
        ]
        shares = [each if len(each) == 1 else each[at] for each in self._share]
        shares = [each.astype(free[0].dtype) for each in shares]
        settling = _Settling(float(np.finfo(free[0].dtype).eps))
        for rounds in range(1, max_rounds + 1):
            change = 0.0
            for view, lines in enumerate(self._leaks):
                leaks = [_sum(line, light) * shares[view] for line in lines]
                for k, leak in enumerate(leaks, view * len(lines)):
                    new = _clipped(free[k] - leak, bounds[k])
                    difference = new - light[k]
                    change = max(change, float(difference.max()), -float(difference.min()))
                    light[k] = new
            if settling.done(change):
                return rounds, light
        return max_rounds, light


def _clipped(plane: Floats, bounds: tuple[Floats, Floats]) -> Floats:
    low, high = bounds
    light = np.maximum(plane, low)
    return np.minimum(light, high, out=light)


def _sum(weights: Floats, planes: Sequence[Floats]) -> Floats:
    """The sum of planes by weights, most of which are 0."""
    found = np.zeros_like(planes[0])
    for weight, plane in zip(weights.astype(found.dtype), planes, strict=True):
        if weight:
            found += weight * plane
    return found


@final
class _Settling:
    """Whether an iteration's changes have come down to rounding, of relative size `tiny`."""

    def __init__(self, tiny: float) -> None:
        self._tiny = tiny
        self._best, self._since_best = np.inf, 0

    def done(self, change: float) -> bool:
        """Note the largest change of a round."""
        self._since_best = 0 if change < self._best else self._since_best + 1
        self._best = min(self._best, change)
        # Rounding can keep the last digits moving
        return change <= self._tiny or (change <= 16 * self._tiny and self._since_best > 2)


def _by_rounds(
    observation: Observation,
    wanted: Light,
    bounds: tuple[Array | float, Array | float],
    start: Light | None,
    max_rounds: int,
) -> tuple[Light, int]:
    """`subtracted` of any observation: each view's own light beside the others' last."""
    xp = namespace(wanted)
    lower, upper = (xp.asarray(each, dtype=wanted.dtype, device=wanted.device) for each in bounds)
    slopes = None if isinstance(observation, GreyToGrey) else _own_slopes(observation, wanted)
    if slopes is not None and not float(xp.min(slopes)) > 0:
        raise InputError("subtraction takes a direct gain above 0 everywhere")
    light = xp.minimum(xp.maximum(wanted if start is None else start, lower), upper)
    settling = _Settling(float(xp.finfo(wanted.dtype).eps))
    for rounds in range(1, max_rounds + 1):
        if isinstance(observation, GreyToGrey):
            own = _along_table(observation, wanted, light)
        else:
            own = light + (wanted - observation.observe(light)) / slopes
        new = xp.minimum(xp.maximum(own, lower), upper)
        change = float(xp.max(xp.abs(new - light)))
        light = new
        if settling.done(change):
            return light, rounds
        if not np.isfinite(change):
            break
    return light, max_rounds


def _own_slopes(observation: Observation, like: Light) -> Light:
    """(view, row, col, primary) what a view shows of its own light, in its own place."""
    xp = namespace(like)
    if not isinstance(observation, StereoObservation):
        return observation.direct(xp.ones_like(like))
    one, none = xp.ones_like(like[:1, ...]), xp.zeros_like(like[:1, ...])
    views = range(like.shape[0])
    alone = (xp.concat([one if u == v else none for u in views]) for v in views)
    each = [observation.linear(light)[v : v + 1, ...] for v, light in enumerate(alone)]
    return xp.concat(each)


def _along_table(observation: GreyToGrey, seen: Light, light: Light) -> Light:
    """Each eye's own light that shows it `seen` beside the other's `light`.

    psi rises with own light, in straight pieces between the levels: each piece gives its share.
    """
    xp = namespace(seen)
    levels = [float(level) for level in observation.levels]

    def at(level: float) -> Light:
        own = xp.full_like(light[:1, ...], level)
        left = observation.observe(xp.concat([own, light[1:, ...]]))[:1, ...]
        right = observation.observe(xp.concat([light[:1, ...], own]))[1:, ...]
        return xp.concat([left, right])

    low = at(levels[0])
    own = xp.minimum(seen - low, xp.zeros_like(seen))
    for first, last in pairwise(levels):
        high = at(last)
        own = own + (last - first) * xp.clip((seen - low) / (high - low), 0, 1)
        low = high
    return own + xp.maximum(seen - low, xp.zeros_like(seen))
