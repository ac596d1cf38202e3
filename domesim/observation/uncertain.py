"""Uncertainty of an observation: by how much what is seen of a light may differ.

A measured room is known within errors. To first order what is seen of a fixed light x is

    psi(x) + sum_k z_k c_k(x)        z_k independent, of mean 0 and variance 1

with changes c_k that are linear in x. Of a dome they are as smooth as reflected light is: functions
on a transport's nodes. Of a pair they are errors of the crosstalk matrices and of their maps; maps
are smooth, so that products are taken as if they were even in each of their cells.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from domesim.light import Light
from domesim.observation.base import Observation
from domesim.observation.basis import disc_quadrature
from domesim.observation.crosstalk import Crosstalk, over_pixels
from domesim.observation.stereo import StereoObservation
from domesim.observation.transport import TabulatedDome, Transport, sample_nodes
from domesim.room.dome import Dome

Floats = NDArray[np.float64]

SIGMAS = 1.96
"""Standard errors to either side of a 95 % interval."""
_RINGS = 48
"""Rings of points by which means over a dome are taken."""


class Changes(ABC):
    """The changes c_k(x) of one light."""

    @abstractmethod
    def seen(self, z: Floats) -> Light:
        """(seen view, row, col, primary): sum_k z_k c_k for (change,) z."""

    @abstractmethod
    def products(self, residual: Light) -> tuple[float, Floats, Floats]:
        """Means over the screen, seen views and primaries: of r², r c_k and c_k c_l."""


class Uncertain(ABC):
    """An observation with an uncertainty."""

    @property
    @abstractmethod
    def best(self) -> Observation:
        """The most likely observation."""

    @abstractmethod
    def changes(self, light: Light) -> Changes:
        """Returns by how much what is seen of `light` (NumPy) may differ from `best`."""


@final
@dataclass(frozen=True)
class Step:
    """Two transports of rooms that differ in one surface's albedo by (primary,) `size`."""

    base: Transport
    other: Transport
    size: Floats


@final
class UncertainDome(Uncertain):
    """A dome whose albedos, or whose transport itself, are known within errors.

    Parameters
    ----------
    best
        What is seen.
    steps
        A step for each surface.
    factor
        (surface, primary, change) L: albedos are off by L z.
    """

    def __init__(self, best: TabulatedDome, steps: Sequence[Step], factor: Floats) -> None:
        self._best, self._steps, self._factor = best, steps, factor

    @property
    def best(self) -> TabulatedDome:
        """See `Uncertain`."""
        return self._best

    def changes(self, light: Light) -> Changes:
        """See `Uncertain`."""
        collected = self._best.excitation(light)
        grids = [self._of_core(collected)]
        for step, factor in zip(self._steps, self._factor, strict=True):
            slope = _reflected(step.other, collected) - _reflected(step.base, collected)
            slope /= step.size[:, None, None]
            grids.append(factor.T[:, :, None, None] * slope)
        albedos = np.sum(grids[1:], axis=0) if len(grids) > 1 else grids[0][:0]
        return _DomeChanges(self._best, np.concatenate([grids[0], albedos]))

    def _of_core(self, collected: Floats) -> Floats:
        """(change, primary, node, node): each mode's error in each primary."""
        transport = self._best.transport
        sums = np.tensordot(collected, transport.modes, ((1, 2), (1, 2)))
        errors = np.sqrt(np.einsum("pij,pj->pi", transport.core_error**2, sums**2))
        primaries, rank = errors.shape
        grids = np.zeros((primaries, rank, primaries, *transport.modes.shape[1:]))
        for primary in range(primaries):
            grids[primary, :, primary] = errors[primary][:, None, None] * transport.modes
        kept = errors.ravel() > 0
        return np.asarray(grids.reshape(primaries * rank, *grids.shape[2:])[kept])


def _reflected(transport: Transport, collected: Floats) -> Floats:
    """(primary, node, node) reflected light of a picture that a transport's nodes collected."""
    sums = np.tensordot(collected, transport.modes, ((1, 2), (1, 2)))
    excited = np.einsum("pij,pj->pi", transport.core, sums)
    return np.tensordot(excited, transport.modes, 1)


@final
class _DomeChanges(Changes):
    """Changes of a dome: functions (change, primary, node, node)."""

    def __init__(self, dome: TabulatedDome, grids: Floats) -> None:
        self._dome, self._grids = dome, grids

    def seen(self, z: Floats) -> Light:
        grids = np.tensordot(z, self._grids, 1)
        return self._dome.on_pixels(grids, np.empty(0, np.float32))

    def products(self, residual: Light) -> tuple[float, Floats, Floats]:
        count, primaries, nodes, _ = self._grids.shape
        u, v, area = disc_quadrature(self._screen, _RINGS)
        sampled = sample_nodes(self._grids.reshape(-1, nodes, nodes), u, v)
        rows = sampled.reshape(count, primaries, -1) * np.sqrt(area / area.sum())
        rows = rows.reshape(count, -1)
        crossed = self._grids.reshape(count, -1) @ self._dome.means(residual).ravel()
        square = float(self._dome.means(residual**2).sum())
        return square / primaries, crossed / primaries, rows @ rows.T / primaries

    @property
    def _screen(self) -> Dome:
        return self._dome.transport.dome


@final
@dataclass(frozen=True)
class UncertainMap:
    """A seat's crosstalk map.

    Parameters
    ----------
    share
        (view, row, col) coarse, means over cells of the screen.
    changes
        (change, view, row, col) changes of `share`.
    """

    share: Floats
    changes: Floats


@final
class UncertainPair(Uncertain):
    """Crosstalk that is known within errors.

    Parameters
    ----------
    best
        What is seen.
    seats
        What is seen from each seat, by what `best` has.
    matrices
        (change, view, primary, primary) changes of the matrices, the same at all seats.
    maps
        Map of each seat.
    """

    def __init__(
        self,
        best: StereoObservation,
        seats: Sequence[Crosstalk],
        matrices: Floats,
        maps: Sequence[UncertainMap],
    ) -> None:
        self._best, self._seats = best, seats
        self._matrices, self._maps = matrices, maps

    @property
    def best(self) -> StereoObservation:
        """See `Uncertain`."""
        return self._best

    def changes(self, light: Light) -> Changes:
        """See `Uncertain`."""
        starts = np.cumsum([len(self._matrices), *(len(each.changes) for each in self._maps)])
        seats = [
            _SeatChanges(seat, self._matrices, map_, int(start), int(starts[-1]), light)
            for seat, map_, start in zip(self._seats, self._maps, starts[:-1], strict=True)
        ]
        return _PairChanges(seats)


@final
class _PairChanges(Changes):
    """Changes of a pair, as several seats see them."""

    def __init__(self, seats: Sequence[_SeatChanges]) -> None:
        self._seats = seats

    def seen(self, z: Floats) -> Light:
        return np.concatenate([seat.seen(z) for seat in self._seats])

    def products(self, residual: Light) -> tuple[float, Floats, Floats]:
        products = [
            seat.products(residual[2 * n : 2 * n + 2]) for n, seat in enumerate(self._seats)
        ]
        square, crossed, own = (np.mean(part, axis=0) for part in zip(*products, strict=True))
        return float(square), crossed, own


@final
class _SeatChanges(Changes):
    """Changes of a seat: those of the matrices are first, those of its map begin at `start`."""

    def __init__(
        self,
        seat: Crosstalk,
        matrices: Floats,
        map_: UncertainMap,
        start: int,
        count: int,
        light: Light,
    ) -> None:
        self._seat, self._matrices, self._map, self._light = seat, matrices, map_, light
        self._mine = slice(start, start + len(map_.changes))
        self._count = count

    def seen(self, z: Floats) -> Light:
        rows, cols = self._light.shape[1:3]
        matrices = np.tensordot(z[: len(self._matrices)], self._matrices, 1)
        share = over_pixels(np.tensordot(z[self._mine], self._map.changes, 1), rows, cols)
        result = np.empty_like(self._light)
        for view in range(2):
            other = self._light[1 - view]
            turned = (matrices[view].T, self._seat.matrices[view].T)
            even, uneven = (other @ matrix.astype(other.dtype) for matrix in turned)
            result[view] = self._seat.share[view][..., None] * even
            result[view] += share[view][..., None] * uneven
        return result

    def products(self, residual: Light) -> tuple[float, Floats, Floats]:
        # Light of the other view becomes light of this one by (change, view, row, col, own, other)
        even = self._matrices[:, :, None, None] * self._map.share[..., None, None]
        own = self._seat.matrices[:, None, None]
        changed = np.zeros((self._count, *even.shape[1:]))
        changed[: len(even)] = even
        changed[self._mine] = self._map.changes[..., None, None] * own
        squares, crossed = self._moments(residual)
        turned = (changed @ squares).reshape(self._count, -1)
        flat = changed.reshape(self._count, -1)
        square = float(np.mean(np.square(residual, dtype=np.float64)))
        return square, flat @ crossed.ravel(), turned @ flat.T

    def _moments(self, residual: Light) -> tuple[Floats, Floats]:
        """(view, row, col, primary, primary) products in cells: other light's, residual's with it.

        Their sums over all cells are means over pixels, views and primaries.
        """
        _, cell_rows, cell_cols = self._map.share.shape
        rows, cols, primaries = self._light.shape[1:]
        shape = (2, cell_rows, cell_cols, primaries, primaries)
        squares, crossed = np.zeros(shape), np.zeros(shape)
        row_ends, col_ends = (
            np.round(np.linspace(0, count, cells + 1)).astype(int)
            for count, cells in ((rows, cell_rows), (cols, cell_cols))
        )
        for view, row, col in np.ndindex(2, cell_rows, cell_cols):
            here = (
                slice(row_ends[row], row_ends[row + 1]),
                slice(col_ends[col], col_ends[col + 1]),
            )
            other = self._light[1 - view][here].reshape(-1, primaries)
            squares[view, row, col] = other.T @ other
            crossed[view, row, col] = residual[view][here].reshape(-1, primaries).T @ other
        size = 2 * rows * cols * primaries
        return squares / size, crossed / size
