"""What is seen of light, as small as figures are measured: averaged as the ruler averages.

What a dome reflects is the sum of a few modes (`domesim.observation.lowrank`), so that its small
picture is the small one of its own light and those of the modes: one look at the light is enough.
Any other picture is observed first, and then averaged.
"""

from __future__ import annotations

from functools import cached_property, partial
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from compensate.plain import Around, around_of, around_of_plane
from compensate.ruler import averaged, block_of
from domesim.light import Light
from domesim.light.blocks import block_sums_within
from domesim.light.planes import Columns, Planes, once, planes_of
from domesim.light.strips import in_strips, product, summed
from domesim.observation.base import Observation
from domesim.observation.lowrank import LowRank, LowRankObservation

Floats = NDArray[Any]


class Seen(NamedTuple):
    """What is seen of light.

    Attributes
    ----------
    small
        (seen view, row, col, primary) means: see `compensate.ruler.averaged`.
    own, excited
        Of a dome of one view: means of what should be seen, and (primary, rank) by how
        much each mode is seen. None of anything else.
    """

    small: Light
    own: Light | None
    excited: Floats | None


@final
class Overview:
    """Small pictures of what is seen in one place.

    Parameters
    ----------
    observation
        What is seen of light.
    screen
        (row, col) bool: pixels that count.
    areas
        (row, col) of the pixels, m².
    kept
        (view, primary) light without a picture that is no pollution; None for none.
    """

    def __init__(
        self,
        observation: Observation,
        screen: NDArray[np.bool_],
        areas: NDArray[np.floating],
        kept: Floats | None = None,
    ) -> None:
        self._observation, self._screen, self._areas = observation, screen, areas
        self._kept = kept
        self._columns = Columns(screen)

    def of(self, light: Light | Planes) -> Seen:
        """Looks at what is seen of light.

        Parameters
        ----------
        light
            (view, row, col, primary) that is projected; of a dome of one view also what tells it.
            Each pixel of the screen is asked for once.

        Returns
        -------
        seen
            See `Seen`.
        """
        observation = self._observation
        if not isinstance(observation, LowRankObservation):
            assert not callable(light)  # as of a dome of one view alone
            return Seen(averaged(observation.observe(light), self._screen), None, None)
        planes = light if callable(light) else planes_of(light)
        sums, collected = self._summed(planes)
        excited = (self._factors.core @ collected[:, :, None])[:, :, 0]
        modes, room = self._small
        own = sums / block_of(self._screen) ** 2
        small = own + room + np.tensordot(excited.astype(own.dtype), modes, 1)
        if self._kept is not None:
            own = own + self._kept[0].astype(own.dtype)[:, None, None] * self._on
        small, own = (np.ascontiguousarray(np.moveaxis(each, 0, -1)[None]) for each in (small, own))
        return Seen(small, own, excited)

    def around(self, light: Light | Planes, seen: Seen) -> Around:
        """Tells what is seen around places, of all pixels.

        Parameters
        ----------
        light
            As for `of`.
        seen
            What `of` found of it.

        Returns
        -------
        around
            A view, rows and columns of places -> (place, 5, 5, primary).
        """
        if seen.excited is None:
            assert not callable(light)
            return partial(around_of, planes_of(self._observation.observe(light)))
        f, excited = self._factors, seen.excited.astype(np.float32)
        planes = light if callable(light) else planes_of(light)

        def here(view: int, rows: NDArray[np.intp], cols: NDArray[np.intp]) -> Floats:
            gain, modes, room = (
                around_of_plane(np.moveaxis(each, 0, -1), rows, cols)
                for each in (f.direct_gain[None], f.spread, f.ambient)
            )
            return np.asarray(around_of(planes, view, rows, cols) * gain + modes @ excited.T + room)

        return here

    def pollution(self, excited: Floats, weights: Floats) -> float:
        """Computes the mean luminance over a dome's screen that is not its picture's own, of white.

        Parameters
        ----------
        excited
            See `Seen`.
        weights
            (primary,) of luminance.
        """
        modes, room = self._means
        return float(weights @ (excited @ modes + room))

    @property
    def _factors(self) -> LowRank:
        assert isinstance(self._observation, LowRankObservation)
        return self._observation.on_screen_like(np.empty(0, np.float32))

    def _summed(self, planes: Planes) -> tuple[Floats, Floats]:
        """(primary, row, col) sums of own light over blocks, and (primary, rank) V'x."""
        f, block = self._factors, block_of(self._screen)
        rows, cols = self._screen.shape
        gain = None if (once(f.direct_gain) == 1).all() else f.direct_gain

        def look(_: int, blocks: slice) -> tuple[Floats, Floats]:
            some = slice(blocks.start * block, min(blocks.stop * block, rows))
            at = some, self._columns.of(some, block)
            each, collect = planes(0, *at), f.collect[:, *at]
            collected = [[product(c, x) for c in collect] for x in each]
            on = (
                self._screen[at].astype(np.float32) if gain is None else self._screen[at] * gain[at]
            )
            sums = block_sums_within([x * on for x in each], block, at[1], cols)
            # Rows and columns that do not fill a block are left out
            full = (some.stop - some.start) // block, cols // block
            return sums[:, : full[0], : full[1]], np.array(collected)

        shape = 1, -(-rows // block), block * cols * len(f.core)
        sums, collected = zip(*in_strips(look, shape), strict=True)
        return np.concatenate(sums, axis=1), np.asarray(sum(collected))

    @cached_property
    def _small(self) -> tuple[Floats, Floats]:
        """(rank, row, col) of the modes, and (primary, row, col) of light without a picture."""

        def averages(plane: Floats) -> Floats:
            return np.asarray(averaged(plane[None, :, :, None], self._screen)[0, ..., 0])

        def small(planes: Floats) -> Floats:
            each = (once(plane) for plane in planes)
            return np.stack(
                [x[0, 0] * on if x.size == 1 else averages(x) for x in each], dtype=planes.dtype
            )

        on = averages(np.broadcast_to(np.float32(1), self._screen.shape))
        return small(self._factors.spread), small(self._factors.ambient)

    @cached_property
    def _on(self) -> Floats:
        """(row, col) how much of each block lies on the screen."""
        on = self._screen.astype(np.float32)[None, :, :, None]
        return np.asarray(averaged(on, self._screen)[0, ..., 0])

    @cached_property
    def _means(self) -> tuple[Floats, Floats]:
        """(rank,) and (primary,) means of the same over the screen's area, without what is kept."""
        areas, whole = self._areas, float(self._areas.sum())

        def mean(plane: Floats) -> float:
            one = once(plane)
            return float(one[0, 0]) if one.size == 1 else _summed(areas, plane) / whole

        modes, room = (
            np.array([mean(plane) for plane in planes])
            for planes in (self._factors.spread, self._factors.ambient)
        )
        if self._kept is not None:
            room -= self._kept[0] * _summed(areas, self._screen.astype(areas.dtype)) / whole
        return modes, room


def _summed(plane: Floats, other: Floats) -> float:
    """Sum of the products of two planes (row, col)."""
    return sum(in_strips(lambda _, rows: summed(plane[rows] * other[rows]), (1, *plane.shape)))
