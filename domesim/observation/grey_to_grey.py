"""Crosstalk of time-sequential displays: how much leaks depends on both pictures.

A liquid crystal that still turns when the shutter opens shows some of the other eye's picture; how
much depends on where it comes from and where it goes. That is measured as a table over the levels
of the eye's own picture and of the other's (Woods 2012, *Journal of Electronic Imaging* 21, 040902,
"grey-to-grey crosstalk"). The exact table is not linear, and so has no adjoint: solvers minimise
its linearisation at exact subtraction (`compensate.pose`).
"""

from __future__ import annotations

from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from domesim.errors import InputError
from domesim.light import Light, kind, namespace, on_host
from domesim.observation.base import Observation
from domesim.observation.stereo import StereoObservation, require_black


@final
class GreyToGrey(Observation):
    """Two views with a table of added light: psi(x)_v = x_v + table_v(x_v, x_u) + black_v.

    Between its entries the table is bilinear; beyond its ends it goes on as at its ends.

    Parameters
    ----------
    rows, cols
        Size of the views.
    levels
        (level,) light, rising from 0 to 1 (projector white), of both pictures.
    table
        (view, primary, own level, other level) light that the eye of that view sees besides its
        own picture, in units of white.
    black
        (view, primary) light that each eye sees without any picture.

    Raises
    ------
    InputError
        If levels do not rise from 0 to 1, or the table is not finite, has light without any
        picture (that is black), adds about as much as white, or would make a pixel darker than
        nothing or brighter as its own picture gets darker; or if black is no light.
    InputError
        If shapes disagree.
    """

    def __init__(
        self,
        rows: int,
        cols: int,
        levels: ArrayLike,
        table: ArrayLike,
        *,
        black: ArrayLike = 0.0,
    ) -> None:
        self._levels = np.asarray(levels, np.float64)
        self._table = np.asarray(table, np.float64)
        count = len(self._levels)
        if self._table.ndim != 4 or len(self._table) != 2:
            raise InputError(f"GreyToGrey takes a table (2, p, k, k), got {self._table.shape}")
        primaries = self._table.shape[1]
        if self._table.shape[2:] != (count, count):
            raise InputError(f"GreyToGrey takes {count} levels, got a table {self._table.shape}")
        _require_table(self._levels, self._table)
        self._shape = (2, rows, cols, primaries)
        self._black = require_black(black, primaries)

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(2, row, col, primary)."""
        return self._shape

    @property
    def levels(self) -> NDArray[np.float64]:
        """(level,) light that the table is for: the ends of its straight pieces."""
        return self._levels

    def linearised(self, at: Light) -> Linearised:
        """Linearises at the light `at`: same value, same slopes."""
        at = self._guarded(at, "is linearised at")
        added, own, other = self._looked_up(at)
        return Linearised(self, at, self._observed(at, added), 1 + own, other)

    def _observe(self, light: Light) -> Light:
        return self._observed(light, self._looked_up(light)[0])

    def _observed(self, light: Light, added: Light) -> Light:
        xp = namespace(light)
        black = xp.asarray(self._black[:, None, None, :], dtype=light.dtype, device=light.device)
        return light + added + black

    def _direct(self, light: Light) -> Light:
        return light

    def _looked_up(self, light: Light) -> tuple[Light, Light, Light]:
        """The table, and its slopes over own and other light."""
        xp = namespace(light)
        levels = xp.asarray(self._levels, dtype=light.dtype, device=light.device)
        table = xp.asarray(self._table, dtype=light.dtype, device=light.device)
        results: list[list[Any]] = [[], [], []]
        for view in range(2):
            planes: list[list[Any]] = [[], [], []]
            for p in range(self._shape[3]):
                looked_up = _bilinear(
                    levels, table[view, p, :, :], light[view, :, :, p], light[1 - view, :, :, p]
                )
                for plane, value in zip(planes, looked_up, strict=True):
                    plane.append(value)
            for result, plane in zip(results, planes, strict=True):
                result.append(xp.stack(plane, axis=-1))
        added, own, other = (xp.stack(result) for result in results)
        return added, own, other


@final
class Linearised(StereoObservation):
    """psi(x) = seen + own (x - at) + other (x_u - at_u), pixel by pixel.

    Parameters
    ----------
    exact
        The table that this linearises.
    at, seen
        (view, row, col, primary) light, and what is seen of it.
    own, other
        (view, row, col, primary) slopes over the eye's own light, and over the other's.
    """

    def __init__(self, exact: GreyToGrey, at: Light, seen: Light, own: Light, other: Light) -> None:
        self.exact = exact
        self._own, self._other = own, other
        self._kept = {kind(own): (own, other)}
        self._constant = seen - self._linear(at)

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(2, row, col, primary)."""
        shape: tuple[int, int, int, int] = self._own.shape
        return shape

    @property
    def central(self) -> NDArray[Any]:
        """(view, primary, view, primary): the mean of all pixels' slopes."""
        primaries = self.shape[3]
        result = np.zeros((2, primaries, 2, primaries))
        own = on_host(self._own).mean(axis=(1, 2), dtype=np.float64)
        other = on_host(self._other).mean(axis=(1, 2), dtype=np.float64)
        for view in range(2):
            result[view, :, view] = np.diag(own[view])
            result[view, :, 1 - view] = np.diag(other[view])
        return result

    def _observe(self, light: Light) -> Light:
        return self._linear(light) + self._like(light, self._constant)

    def _direct(self, light: Light) -> Light:
        return light

    def _linear(self, light: Light) -> Light:
        own, other = self._slopes(light)
        return own * light + other * namespace(light).flip(light, axis=0)

    def _adjoint(self, light: Light) -> Light:
        own, other = self._slopes(light)
        return own * light + namespace(light).flip(other * light, axis=0)

    def _direct_adjoint(self, light: Light) -> Light:
        return light

    def _slopes(self, light: Light) -> tuple[Light, Light]:
        key = kind(light)
        if key not in self._kept:
            self._kept[key] = self._like(light, self._own), self._like(light, self._other)
        return self._kept[key]

    def _like(self, light: Light, array: Light) -> Light:
        """An array that is constant, as one of `light`'s library, precision and device."""
        if kind(array) == kind(light):
            return array
        xp = namespace(light)
        return xp.asarray(on_host(array), dtype=light.dtype, device=light.device)


def _bilinear(levels: Any, table: Any, own: Any, other: Any) -> tuple[Any, Any, Any]:
    """table(own, other), and its slopes over own and other."""
    xp = namespace(own)
    count = levels.shape[0]

    def cell(light: Any) -> tuple[Any, Any, Any]:
        flat = xp.reshape(light, (-1,)) + 0  # PyTorch searches contiguous values
        first = xp.clip(xp.searchsorted(levels, flat, side="right") - 1, 0, count - 2)
        low, high = xp.take(levels, first), xp.take(levels, first + 1)
        # At 1 too: a white pixel can only get darker, along the slope of the last cell.
        inside = (flat >= levels[0]) & (flat <= levels[-1])
        part = xp.clip((flat - low) / (high - low), 0, 1)
        return first, part, xp.where(inside, 1 / (high - low), xp.zeros_like(flat))

    (i, a, da), (j, b, db) = cell(own), cell(other)
    flat_table = xp.reshape(table, (-1,))
    corner = i * count + j
    t00, t01 = xp.take(flat_table, corner), xp.take(flat_table, corner + 1)
    t10, t11 = xp.take(flat_table, corner + count), xp.take(flat_table, corner + count + 1)
    low, high = t00 + a * (t10 - t00), t01 + a * (t11 - t01)
    values = (
        low + b * (high - low),
        da * ((t10 - t00) * (1 - b) + (t11 - t01) * b),
        db * (high - low),
    )
    shape = own.shape
    value, over_own, over_other = (xp.reshape(v, shape) for v in values)
    return value, over_own, over_other


def _require_table(levels: NDArray[np.float64], table: NDArray[np.float64]) -> None:
    rising = len(levels) >= 2 and bool(np.all(np.diff(levels) > 0))
    if not rising or levels[0] != 0 or levels[-1] != 1:
        raise InputError(
            f"levels of a grey-to-grey table must rise from 0 to 1, got {levels.tolist()}"
        )
    if not np.isfinite(table).all():
        raise InputError("a grey-to-grey table must be finite, got NaN or infinity")
    if np.abs(table[:, :, 0, 0]).max() > 1e-9:
        raise InputError(
            f"a grey-to-grey table must start at 0 (two black pictures), got "
            f"{table[:, :, 0, 0].ravel().tolist()}. Subtract black, and give it as black"
        )
    if table.max() >= 0.9:
        raise InputError(
            f"a grey-to-grey table must be well below the picture itself, got {table.max():.0%}. "
            f"Is it in percent?"
        )
    seen = table + levels[None, None, :, None]
    if seen.min() < -1e-9:
        raise InputError(
            f"a grey-to-grey table must not take more light than there is, got {seen.min():.3g} "
            f"of white left. Is it in percent?"
        )
    if np.diff(seen, axis=2).min() <= 0:
        raise InputError(
            "a grey-to-grey table must let a brighter picture look brighter, got levels where it "
            "looks darker. Check the readings for noise"
        )
    steps = np.diff(levels)
    own = np.diff(seen, axis=2) / steps[:, None]
    other = np.abs(np.diff(table, axis=3)) / steps
    if other.max() >= 0.9 * own.min():
        raise InputError(
            f"a grey-to-grey table must rise more with the eye's own light than with the other's: "
            f"got slopes down to {own.min():.2g} and up to {other.max():.2g}. Steep slopes come "
            f"from levels that lie close together: check the readings of those"
        )
