"""Pollution that a few numbers carry from all pixels of one view to all pixels: O(n).

The closed-form dome has one such number a primary (its total flux), a tabulated theatre a few.

    phi(x)[p] = sum_jk spread[j] core[p, j, k] <collect[k], x[p]>
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from domesim.light import Array, Light, kind, namespace, total
from domesim.light.planes import once
from domesim.light.strips import in_parts
from domesim.observation.base import AdjointObservation


@final
@dataclass(frozen=True)
class LowRank:
    """The factors of ``psi(x) = D x + spread core collect' x + ambient`` for one view.

    Parameters
    ----------
    direct_gain
        (row, col): D.
    spread
        (rank, row, col): how each mode shows on the screen.
    core
        (primary, rank, rank): how the modes excite each other.
    collect
        (rank, row, col): how each pixel's light excites the modes.
    ambient
        (primary, row, col): light that is there without a picture.
    """

    direct_gain: Array
    spread: Array
    core: Array
    collect: Array
    ambient: Array

    def every(self, step: int) -> LowRank:
        """Factors of a coarser picture: every `step`-th row and column."""
        return LowRank(
            self.direct_gain[::step, ::step],
            self.spread[:, ::step, ::step],
            self.core * step**2,
            self.collect[:, ::step, ::step],
            self.ambient[:, ::step, ::step],
        )

    def like(self, light: Light) -> LowRank:
        """These factors as arrays of `light`'s library, precision and device."""
        xp = namespace(light)

        def convert(array: Array, dtype: Any) -> Array:
            if not isinstance(array, np.ndarray):
                return xp.asarray(array, dtype=dtype, device=light.device)
            kept = once(array)
            if xp is not np:
                kept = np.require(kept, requirements="W")  # PyTorch has no read-only arrays
            return xp.broadcast_to(xp.asarray(kept, dtype=dtype, device=light.device), array.shape)

        return LowRank(
            convert(self.direct_gain, light.dtype),
            convert(self.spread, light.dtype),
            convert(self.core, xp.float64),
            convert(self.collect, light.dtype),
            convert(self.ambient, light.dtype),
        )


class LowRankObservation(AdjointObservation):
    """An observation of one view made of `LowRank` factors, on any array library.

    Parameters
    ----------
    factors
        As NumPy arrays.
    screen
        (row, col) bool: pixels whose centre is on the screen; all others observe D x.
    """

    def __init__(self, factors: LowRank, screen: NDArray[np.bool_]) -> None:
        self._factors, self._screen = factors, screen
        self._cache: dict[tuple[str, ...], LowRank] = {}

    def lit(self, added: NDArray[np.floating]) -> LowRankObservation:
        """Adds light without a picture: (row, col, primary), as it is seen."""
        factors = self.factors
        more = np.moveaxis(added, -1, 0).astype(factors.ambient.dtype)
        return LowRankObservation(replace(factors, ambient=factors.ambient + more), self._screen)

    @property
    def factors(self) -> LowRank:
        """The factors, as NumPy arrays."""
        return self._factors

    @cached_property
    def has_unit_gain(self) -> bool:
        """Whether D is 1 everywhere."""
        return bool(np.all(once(self._factors.direct_gain) == 1))

    @property
    def screen(self) -> NDArray[np.bool_]:
        """(row, col) bool: pixels whose centre is on the screen; all others observe D x."""
        return self._screen

    def screen_like(self, light: Light) -> Array:
        """(row, col) 1 on the screen and 0 elsewhere, as an array like `light`."""
        return namespace(light).asarray(self._screen, dtype=light.dtype, device=light.device)

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(1, row, col, primary)."""
        rows, cols = self._factors.direct_gain.shape
        return 1, rows, cols, self._factors.core.shape[0]

    def factors_like(self, light: Light) -> LowRank:
        """`factors` as arrays of `light`'s library, precision and device, kept for the next use."""
        key = kind(light)
        if key not in self._cache:
            self._cache[key] = self.factors.like(light)
        return self._cache[key]

    def on_screen_like(self, light: Light) -> LowRank:
        """`factors_like` that hold on the screen alone, for light that is 0 off it.

        What is the same all over the screen is kept once.
        """
        key = (*kind(light), "on the screen")
        if key not in self._cache:
            self._cache[key] = self._factors.like(light)
        return self._cache[key]

    def _observe(self, light: Light) -> Light:
        f = self.factors_like(light)
        return self._spread(light, _project(f.collect, light), f.core, f.spread, f.ambient)

    def _direct(self, light: Light) -> Light:
        if self.has_unit_gain:
            return light
        return light * self.factors_like(light).direct_gain[None, :, :, None]

    def _linear(self, light: Light) -> Light:
        f = self.factors_like(light)
        return self._spread(light, _project(f.collect, light), f.core, f.spread)

    def _adjoint(self, light: Light) -> Light:
        f = self.factors_like(light)
        turned = namespace(light).permute_dims(f.core, (0, 2, 1))
        return self._spread(light, _project(f.spread, light), turned, f.collect)

    def _spread(
        self, light: Light, sums: Array, core: Array, modes: Array, ambient: Array | None = None
    ) -> Light:
        """D times light, and modes times core times (primary, rank) sums, and ambient light."""
        gain, xp = self.factors_like(light).direct_gain, namespace(light)
        excited = xp.astype((core @ sums[:, :, None])[:, :, 0], modes.dtype)
        result = xp.empty_like(light)

        def work(_: int, rows: slice) -> None:
            for p in range(light.shape[-1]):
                direct = light[0, rows, :, p]
                part = expand(modes[:, rows, :], excited[p, :])
                part += direct if self.has_unit_gain else direct * gain[rows, :]  # eq. 2
                if ambient is not None:
                    part += ambient[p, rows, :]
                result[0, rows, :, p] = part

        in_parts(work, light.shape[:3], light)
        return result

    def _direct_adjoint(self, light: Light) -> Light:
        return self._direct(light)


def _project(modes: Array, light: Light) -> Array:
    """(primary, rank): sums over the pixels of light times modes, in float64."""
    xp = namespace(light)

    def work(_: int, rows: slice) -> Array:
        planes = [light[0, rows, :, p] for p in range(light.shape[-1])]
        ranks = range(modes.shape[0])
        return xp.stack(
            [xp.stack([total(modes[k, rows, :] * plane) for k in ranks]) for plane in planes]
        )

    first, *others = in_parts(work, light.shape[:3], light)
    for part in others:
        first = first + part
    return first


def expand(modes: Array, coefficients: Array) -> Array:
    """Sums modes.

    Parameters
    ----------
    modes
        (rank, row, col).
    coefficients
        (rank,) of the modes' type.

    Returns
    -------
    sum
        (row, col).
    """
    result = modes[0, :, :] * coefficients[0]
    for k in range(1, modes.shape[0]):
        result = result + modes[k, :, :] * coefficients[k]
    return result
