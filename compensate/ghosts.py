"""How much of the ghosts is left: figures for tables and plots, never what a solver minimises.

With Y the luminance of light, the residual and the ghost of the untouched master are

    e = Y(psi(x) - desired)          g = Y(psi(desired) - desired)

(view, row, col) each. Three figures say what became of g:

*Ghost edge energy*:

    sqrt(sum |grad e|² / sum |grad g|²)

over both eyes' pixels, for it is edges that disturb stereopsis (van Baar et al. 2011, section 1).
1: the ghost's edges are all there, as when nothing is done. 0: none are. It has no unit, and does
not depend on the brightness of the projector. Gradients are of Gaussian-smoothed planes,

    grad e = e * grad G,    sigma = pixels per degree / (2 pi 3 cycles/degree),  at least 0.7 pixels

Such a derivative passes a frequency f as f exp(-2 pi² sigma² f²), most at 3 cycles/degree, where
the eye resolves contrast best. A ghost that is smoothed keeps its light and loses its edges: an
edge blurred by s keeps (1 + s²/sigma²)^(-1/4). Only the picture's pixels are counted, and its
border is no edge: beyond it planes go on as they are there. *All* of the residual's edges count,
so those of a veil, and of contrast that was lost everywhere (by range compression), do too.

*Ghost left*, with the same gradients, sums and pixels:

    sum(grad e . grad g) / sum |grad g|²

It is the least-squares share of g's edges in e: how much of the ghost itself is still to be seen,
with its sign. 1: the whole ghost. 0: none. Negative: overcorrected, a dark ghost instead. It cannot
exceed the edge energy (Cauchy and Schwarz), and equals it where the residual is a share of the
ghost; edges that lie elsewhere do not count. That makes it blind to all *other* errors, so it is
read beside the edge energy, never alone: a method that loses contrast may leave no ghost but much
edge energy. Contrast lost in a share b of the desired picture counts by what the picture has in
common with its own ghost: -b sum(grad Y(desired) . grad g) / sum |grad g|², which is small where
edges of left and right lie apart.

*Ghost contour*, of what subtraction cannot take away:

    C = sqrt(sum (grad e . n)² / sum (grad g . n)²),  n = grad g / |grad g|

over the strongest edges of the ghost where subtraction clips, with the same gradients. 1: all of
its edges are there. 0: none of them is. It does not count edges elsewhere, nor those of a veil that
run another way.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from domesim.light.guarded import guarded
from domesim.light.strips import in_strips

BEST_FREQUENCY = 3.0
"""Where the eye's contrast sensitivity is highest, cycles/degree."""

FINEST_SIGMA = 0.7
"""The narrowest Gaussian, pixels, whose sampled derivative still is one."""

EDGES = 0.9
"""Share of the ghost's squared slopes that the edges of its contour hold."""

Floats = NDArray[np.floating[Any]]


@guarded(error="view row col", ghost="view row col")
def edge_energy(error: Floats, ghost: Floats, pixels_per_degree: float) -> float:
    """Computes the ghost edge energy: 0 if no edge of a ghost is left, 1 if all are.

    Parameters
    ----------
    error, ghost
        (view, row, col) luminance that is seen too much: now, and of the untouched master.
    pixels_per_degree
        As the audience sees it.

    Returns
    -------
    energy
        Infinite if there was no ghost, and there is an error.
    """
    sigma = edge_sigma(pixels_per_degree)
    return float(
        np.sqrt(_ratio(_common_edges(error, error, sigma), _common_edges(ghost, ghost, sigma)))
    )


@guarded(error="view row col", ghost="view row col")
def ghost_left(error: Floats, ghost: Floats, pixels_per_degree: float) -> float:
    """Computes the share of the ghost's own edges in the error.

    Parameters
    ----------
    error, ghost, pixels_per_degree
        As for `edge_energy`.

    Returns
    -------
    share
        0 if there was no ghost.
    """
    sigma = edge_sigma(pixels_per_degree)
    edges = _common_edges(ghost, ghost, sigma)
    return _common_edges(error, ghost, sigma) / edges if edges > 0 else 0.0


@guarded(error="view row col", ghost="view row col", where="view row col")
def ghost_contour(
    error: Floats, ghost: Floats, where: NDArray[np.bool_], pixels_per_degree: float
) -> float | None:
    """Computes the ghost contour C (see the module).

    Parameters
    ----------
    error, ghost, pixels_per_degree
        As for `edge_energy`.
    where
        (view, row, col) bool: pixels whose edges count.

    Returns
    -------
    contour
        None where the ghost has no edges.
    """
    sigma = edge_sigma(pixels_per_degree)
    edges, slopes = (
        np.stack([_slopes(plane, slice(0, len(plane)), sigma) for plane in planes], axis=1)
        for planes in (ghost, error)
    )
    strength = np.sum(edges**2, axis=0)
    inside = np.sort(strength[where])[::-1]
    if not np.any(inside > 0):
        return None
    sums = np.cumsum(inside)
    # A slope more or less at this limit moves the mean by a share of its own
    weakest = inside[np.searchsorted(sums, EDGES * sums[-1])]
    at = where & (strength >= weakest)
    across = np.sum(edges * slopes, axis=0)[at] ** 2 / strength[at]
    return float(np.sqrt(across.sum() / strength[at].sum()))


@guarded
def edge_sigma(pixels_per_degree: float) -> float:
    """Returns sigma, pixels, of the derivative that passes 3 cycles/degree most."""
    return max(FINEST_SIGMA, pixels_per_degree / (2 * np.pi * BEST_FREQUENCY))


def _common_edges(first: Floats, second: Floats, sigma: float) -> float:
    """Sum of grad (G * first) . grad (G * second) over all pixels of all planes."""
    pair = (first,) if second is first else (first, second)

    def within(view: int, rows: slice) -> float:
        slopes = [_slopes(planes[view], rows, sigma) for planes in pair]
        common = zip(slopes[0], slopes[-1], strict=True)
        # Not `vdot`: BLAS would ask for threads of its own.
        return sum(float(np.sum(one * other, dtype=np.float64)) for one, other in common)

    return sum(in_strips(within, first.shape))


def _slopes(plane: Floats, rows: slice, sigma: float) -> tuple[Floats, Floats]:
    """Both slopes of G * plane in a strip of rows, in its own precision."""
    radius = round(4 * sigma)
    above, below = max(rows.start - radius, 0), min(rows.stop + radius, len(plane))
    beyond = (above - rows.start + radius, rows.stop + radius - below)
    around = np.pad(plane[above:below], (beyond, (radius, radius)), "edge")
    places = np.arange(-radius, radius + 1)
    bell = np.exp(-((places / sigma) ** 2) / 2)
    bell /= bell.sum()
    smooth, slope = (taps.astype(plane.dtype) for taps in (bell, places / sigma**2 * bell))
    return (
        _filtered(_filtered(around, smooth, 1, 0), slope, -1, 1),
        _filtered(_filtered(around, slope, -1, 0), smooth, 1, 1),
    )


def _filtered(values: Floats, taps: Floats, mirror: int, axis: int) -> Floats:
    """Filters along an axis by `taps` that equal `mirror` times their mirror image; borders go."""
    radius = len(taps) // 2
    count = values.shape[axis] - 2 * radius

    def shifted(by: int) -> Floats:
        where = slice(radius + by, radius + by + count)
        return values[where] if axis == 0 else values[:, where]

    result: Floats = taps[radius] * shifted(0)
    both = np.empty_like(result)
    together = np.add if mirror == 1 else np.subtract
    for by in range(1, radius + 1):
        together(shifted(by), shifted(-by), out=both)
        both *= taps[radius + by]
        result += both
    return result


def _rms(planes: Floats) -> float:
    return float(np.sqrt(np.mean(planes**2)))


def _ratio(part: float, whole: float) -> float:
    if whole == 0:
        return 0.0 if part == 0 else float("inf")
    return part / whole
