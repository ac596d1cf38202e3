"""Light as planes, and a problem as ADMM takes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from compensate.problem import Problem
from compensate.solver.admm.hessian import Planes
from compensate.solver.admm.level import Level
from compensate.solver.admm.pyramid import Value, halved, padded
from compensate.weighting import CsfWeighting
from domesim.light import Array, Light, namespace
from domesim.light.strips import in_parts

_SMALLEST = 32  # rows and columns of a coarser plane
_WORTH = 0.05  # of the squared weights


@final
@dataclass(frozen=True)
class Split:
    """A problem as a quadratic that Fourier diagonalises, and bounds that are apart.

    Attributes
    ----------
    problem
        The whole problem.
    level
        The problem on full planes.
    gain
        (1, row, col, 1) factor from light to planes; None for 1.
    """

    problem: Problem
    level: Level
    gain: Array | None = None

    @property
    def base(self) -> Any:
        """Light that planes are relative to: the regulariser's anchor."""
        return self.problem.anchor

    def planes(self, light: Light) -> Planes:
        """(row, col) planes d of `light`."""
        change = light - self.base
        return planes_of(change if self.gain is None else change * self.gain)

    def light(self, planes: Planes) -> Light:
        """The light of (row, col) planes d, within the bounds."""
        problem, base, xp = self.problem, self.base, namespace(self.base)
        result, primaries = xp.empty_like(base), base.shape[3]
        lower, upper = (xp.broadcast_to(b, base.shape) for b in (problem.lower, problem.upper))

        def work(view: int, rows: slice) -> None:
            for p in range(primaries):
                part = planes[view * primaries + p][rows, :]
                if self.gain is not None:
                    part = part / self.gain[0, rows, :, 0]
                place = (view, rows, slice(None), p)
                result[place] = xp.minimum(
                    xp.maximum(part + base[place], lower[place]), upper[place]
                )

        in_parts(work, base.shape[:3], base)
        return result

    def levels(self, residual: Light, *, coarser: bool) -> list[Level]:
        """Levels: the problem itself, and `coarser` ones; `residual` is that of the base.

        A level is worth while if its frequencies have a twentieth of the weights (squared).
        """
        fine = self.level
        planes = [padded(plane, fine.hessian.fourier) for plane in each_plane(residual)]
        levels, weights = [fine], fine.hessian.weights
        halves = planes
        while coarser:
            fourier = fine.hessian.fourier
            small = min(fourier.rows, fourier.cols) < 2 * _SMALLEST
            if small or fourier.rows % 4 or fourier.cols % 4:
                break
            if fine.hessian.coarser.weights < _WORTH * weights:
                break
            halves, fine = [halved(plane) for plane in halves], fine.coarser()
            fine.aim(list(halves))
            levels.append(fine)
        del halves
        self.level.aim(planes)
        return levels


def each_plane(light: Light) -> list[Array]:
    """(row, col) views of the planes, all primaries of one view after the other."""
    views, _, _, primaries = light.shape
    return [light[view, :, :, p] for view in range(views) for p in range(primaries)]


def planes_of(light: Light) -> Planes:
    """(row, col) planes, all primaries of one view after the other."""
    xp = namespace(light)
    return [xp.asarray(plane, copy=True) for plane in each_plane(light)]


def widths_of(problem: Problem, gain: Array | None = None) -> list[Value]:
    """Upper bounds above lower ones, times a `gain`: for each plane, as `Level` has.

    A width is one number if it is the same everywhere; planes share one if it is the same for all
    primaries and views.
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
    planes: list[Value] = list(planes_of(width))
    return planes if len(planes) > 1 else planes * (views * primaries)


def require_certifiable(problem: Problem) -> CsfWeighting:
    """The problem's weighting.

    Raises
    ------
    ValueError
        If it is not one that Fourier diagonalises, the problem has no regulariser, its bounds are
        not finite, its anchor is not within them, or its pixels are not pinned where the weighting
        has no support.
    """
    weighting: Any = problem.weighting
    if not isinstance(weighting, CsfWeighting):
        raise ValueError(f"ADMM takes a CsfWeighting, got {type(weighting).__name__}")
    xp = namespace(problem.desired)
    if not bool(xp.all(xp.isfinite(problem.lower)) & xp.all(xp.isfinite(problem.upper))):
        raise ValueError("ADMM takes finite bounds")
    if not problem.regularisation > 0:
        raise ValueError("ADMM certifies regularised problems only, got regularisation 0")
    if not _within(problem, problem.anchor):
        raise ValueError("ADMM takes an anchor within the bounds")
    if not weighting.support.all():
        off = xp.asarray(~weighting.support, device=problem.desired.device)
        if bool(xp.any((problem.lower != problem.upper) & off[None, :, :, None])):
            raise ValueError("ADMM takes a problem whose pixels off the support are pinned")
    return weighting


def residual_of(problem: Problem, weighting: CsfWeighting) -> Light:
    """Residual of the anchor; 0 where it does not count."""
    residual = problem.residual(problem.anchor)
    if not weighting.support.all():
        xp = namespace(residual)
        support = xp.asarray(weighting.support, dtype=residual.dtype, device=residual.device)

        def work(view: int, rows: slice) -> None:
            # Plane by plane: NumPy is slow where few numbers share a factor
            for p in range(residual.shape[3]):
                residual[view, rows, :, p] *= support[rows, :]

        in_parts(work, residual.shape[:3], residual)
    return residual


def _within(problem: Problem, light: Any) -> bool:
    """Whether light is within the bounds."""
    xp = namespace(light)
    lower, upper = (xp.broadcast_to(b, light.shape) for b in (problem.lower, problem.upper))

    def work(view: int, rows: slice) -> bool:
        part = light[view, rows, ...]
        return bool(xp.all(part >= lower[view, rows, ...])) and bool(
            xp.all(part <= upper[view, rows, ...])
        )

    return all(in_parts(work, light.shape, light))
