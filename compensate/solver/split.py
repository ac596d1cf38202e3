"""What ADMM needs to know of a problem: its levels, and how its planes become light again."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from compensate.problem import Problem
from compensate.solver.blocks import each_strip
from compensate.solver.hessian import Hessian
from compensate.solver.level import BoxLevel, Computed, Level, Planes, coarsened, padded
from compensate.weighting import CsfWeighting
from domesim.light import Array, Light, namespace
from domesim.strips import in_parts

_SMALLEST = 32  # rows and columns of a coarser plane
_WORTH = 0.05  # of the squared weights


class Split(ABC):
    """A problem as a quadratic that Fourier (nearly) diagonalises, and separate bounds.

    Parameters
    ----------
    problem
        One that has a regulariser, under a weighting that Fourier diagonalises (see
        `require_certifiable`).

    Attributes
    ----------
    base
        The light that planes are relative to: the regulariser's, within the bounds.
    levels
        The problem, and from there on coarser and coarser ones; none before `prepare`.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.weighting = require_certifiable(problem)
        anchor: Any = problem.anchor
        self.base: Any = anchor if _within(problem, anchor) else problem.project(anchor)
        self._offset = None if self.base is anchor else anchor - self.base
        self._residual = _beyond(problem, self.base, self.weighting)
        self.levels: list[Level] = []

    @property
    def answered(self) -> bool:
        """Whether the base is what the regulariser wants, and shows what is desired to rounding."""
        limit = 8 * float(np.finfo(np.float32).eps)
        residual, xp = self._residual, namespace(self.base)

        def work(view: int, rows: slice) -> bool:
            return bool(xp.all(xp.abs(residual[view, rows, ...]) <= limit))

        return self._offset is None and all(in_parts(work, residual.shape, residual))

    @property
    def typical(self) -> float:
        """What a typical frequency counts: the median Omega², and damping where that matters."""
        return self.weighting.typical

    def prepare(self, *, coarser: bool) -> None:
        """Make the levels: the problem itself, and `coarser` ones.

        A level is worth while if its frequencies have a twentieth of the weights (squared).
        """
        level, fourier = self._finest(), self.weighting.fourier
        residual = level.of_light(_each_plane(self._residual))
        del self._residual
        residual = [padded(plane, fourier) for plane in residual]
        self.levels = [level]
        if coarser:
            _add_coarser(self.levels, residual)
        _aim(level, residual)

    def planes(self, light: Light) -> Planes:
        """(row, col) planes of `light`."""
        return planes_of(self._seen(light - self.base))

    @abstractmethod
    def light(self, planes: Planes) -> Light:
        """The light of (row, col) planes, within the bounds."""

    @abstractmethod
    def _finest(self) -> Level: ...

    @abstractmethod
    def _seen(self, light: Light) -> Light:
        """Light as planes have it, on the support."""


class BoxSplit(Split):
    """A problem in planes that bounds limit one by one."""

    @property
    def uniform(self) -> bool:
        """Whether all pixels are alike, so that Fourier diagonalises the quadratic itself."""
        return True

    def light(self, planes: Planes) -> Light:
        """See `Split`."""
        xp, base, problem = namespace(self.base), self.base, self.problem
        result = xp.empty_like(base)
        primaries = base.shape[3]
        lower, upper = (xp.broadcast_to(b, base.shape) for b in (problem.lower, problem.upper))

        def work(view: int, rows: slice) -> None:
            for p in range(primaries):
                place = (view, rows, slice(None), p)
                x = self._shown(planes[view * primaries + p][rows, :], rows) + base[place]
                result[place] = xp.minimum(xp.maximum(x, lower[place]), upper[place])

        in_parts(work, base.shape[:3], base)
        return result

    @abstractmethod
    def direction(self, planes: Planes) -> Light:
        """How the light changes as planes change."""

    @abstractmethod
    def from_gradient(self, gradient: Light) -> Planes:
        """The gradient in planes, of one in light."""

    @abstractmethod
    def pinned_gradient(self, weighted: Light) -> Planes:
        """The gradient in padded planes off the support, of lambda'lambda of the residual there."""

    @abstractmethod
    def _hessian(self) -> Hessian: ...

    def _finest(self) -> BoxLevel:
        damping, least = self._damping()
        offset = self._offset
        return BoxLevel(
            self._hessian(),
            [],
            self._lower(),
            self._widths(),
            damping,
            least,
            None if offset is None else planes_of(self._seen(offset)),
        )

    def _shown(self, plane: Array, rows: slice) -> Array:
        """1 / D of rows of a plane."""
        return plane

    def _damping(self) -> tuple[Any, float]:
        """M, and the least of it."""
        return self.problem.regularisation, self.problem.regularisation

    def _scaled(self, part: Array, rows: slice) -> Array:
        """D times rows of a plane."""
        return part

    def _lowest(self) -> Planes:
        """Lower bounds of planes' light, computed where they are asked for."""

        def of(bound: Array, plane: Array) -> Computed:
            return Computed(
                lambda rows: self._scaled(bound[rows, :] - plane[rows, :], rows), like=plane
            )

        bounds = namespace(self.base).broadcast_to(self.problem.lower, self.base.shape)
        return list(map(of, _each_plane(bounds), _each_plane(self.base)))

    def _lower(self) -> Planes:
        """Lower bounds of planes' light."""
        xp, base, lowest = namespace(self.base), self.base, self._lowest()
        result = [xp.empty(p.shape, dtype=p.dtype, device=base.device) for p in lowest]

        def work(rows: slice) -> None:
            for plane, computed in zip(result, lowest, strict=True):
                plane[rows, :] = computed[rows, :]

        each_strip(work, result[0])
        return result

    def _widths(self) -> list[Array | float]:
        return widths_of(self.problem)


def _add_coarser(levels: list[Level], residual: Planes) -> None:
    """Append coarser levels than the last one, as long as they are worth while."""
    fine = levels[-1]
    weights = fine.hessian.weights
    while True:
        fourier = fine.hessian.fourier
        if min(fourier.rows, fourier.cols) < 2 * _SMALLEST or fourier.rows % 4 or fourier.cols % 4:
            return
        if fine.hessian.coarser.weights < _WORTH * weights:
            return
        residual = [coarsened(plane) for plane in residual]
        fine = fine.coarser()
        _aim(fine, list(residual))
        levels.append(fine)


def _aim(level: Level, residual: Planes) -> None:
    """Set a level's target and cost by what is seen too much at the base; it is used up."""
    fourier, spectra = level.hessian.fourier, []
    while residual:
        spectra.append(fourier.forward(residual.pop(0)))
    energy, target = level.hessian.seen(spectra)
    for p in range(len(target)):
        target[p] *= -1
    level.target, level.cost = target, 0.5 * energy


def _within(problem: Problem, light: Light) -> bool:
    """Whether light is within the bounds."""
    xp = namespace(light)
    lower, upper = (xp.broadcast_to(b, light.shape) for b in (problem.lower, problem.upper))

    def work(view: int, rows: slice) -> bool:
        part = light[view, rows, ...]
        return bool(xp.all(part >= lower[view, rows, ...])) and bool(
            xp.all(part <= upper[view, rows, ...])
        )

    return all(in_parts(work, light.shape, light))


def _beyond(problem: Problem, light: Light, weighting: CsfWeighting) -> Light:
    """What is seen too much, where it counts."""
    residual = problem.residual(light)
    if not weighting.support.all():
        xp = namespace(light)
        support = xp.asarray(weighting.support, dtype=light.dtype, device=light.device)

        def work(view: int, rows: slice) -> None:
            # Plane by plane: NumPy is slow where few numbers share a factor
            for p in range(residual.shape[3]):
                residual[view, rows, :, p] *= support[rows, :]

        in_parts(work, residual.shape[:3], residual)
    return residual


def _each_plane(light: Light) -> list[Array]:
    """(row, col) views of the planes, all primaries of one view after the other."""
    views, _, _, primaries = light.shape
    return [light[view, :, :, p] for view in range(views) for p in range(primaries)]


def planes_of(light: Light) -> Planes:
    """(row, col) planes, all primaries of one view after the other."""
    xp = namespace(light)
    return [xp.asarray(plane, copy=True) for plane in _each_plane(light)]


def light_of(planes: Planes, views: int) -> Light:
    """(view, row, col, primary) light of planes."""
    xp = namespace(planes[0])
    rows, cols = planes[0].shape
    primaries = len(planes) // views
    shape = (views, rows, cols, primaries)
    result = xp.empty(shape, dtype=planes[0].dtype, device=planes[0].device)
    for k, plane in enumerate(planes):
        result[k // primaries, :, :, k % primaries] = plane
    return result


def require_certifiable(problem: Problem) -> CsfWeighting:
    """The problem's weighting.

    Raises
    ------
    ValueError
        If it is not one that Fourier diagonalises, the problem has no regulariser, its bounds are
        not finite, or its pixels are not pinned where the weighting has no support.
    """
    weighting: Any = problem.weighting
    if not isinstance(weighting, CsfWeighting):
        raise ValueError(f"ADMM takes a CsfWeighting, got {type(weighting).__name__}")
    xp = namespace(problem.desired)
    if not bool(xp.all(xp.isfinite(problem.lower)) & xp.all(xp.isfinite(problem.upper))):
        raise ValueError("ADMM takes finite bounds")
    if not problem.regularisation > 0:
        raise ValueError("ADMM certifies regularised problems only, got regularisation 0")
    if not weighting.support.all():
        off = xp.asarray(~weighting.support, device=problem.desired.device)
        if bool(xp.any((problem.lower != problem.upper) & off[None, :, :, None])):
            raise ValueError("ADMM takes a problem whose pixels off the support are pinned")
    return weighting


def widths_of(problem: Problem, gain: Any = None) -> list[Array | float]:
    """Upper bounds above lower ones, D times if there is a `gain`: for each plane, as `Level` has.

    One number where that is the same for all, one plane where it is for all primaries and views.
    """
    xp = namespace(problem.desired)
    width = problem.upper - problem.lower
    views, rows, cols, primaries = shape = problem.observation.shape
    if width.ndim == 0 and gain is None:
        return [float(width)] * (views * primaries)
    spread = xp.broadcast_to(width, np.broadcast_shapes(width.shape, (1, rows, cols, 1)))
    one = spread[:1, :, :, :1]
    width = one if bool(xp.all(spread == one)) else xp.broadcast_to(width, shape)
    if gain is not None:
        width = width * gain
    if bool(xp.all(width == width[0, 0, 0, 0])):
        return [float(width[0, 0, 0, 0])] * (views * primaries)
    planes: list[Array | float] = list(planes_of(width))
    return planes if len(planes) > 1 else planes * (views * primaries)
