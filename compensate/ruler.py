"""The ruler: how much worse what is seen looks than the master, whatever the method.

It is ColorVideoVDP's figure for a still (`compensate.vision.differences`): what it takes from 10,
in just-objectionable differences (JOD). Of two pictures 1 JOD apart, 75 of 100 people prefer the
better. So it is defined; how often people order two pictures as it does was asked (`PEOPLE`). No
setting of a method enters it.

The picture is what a display in the scene's place would show: linear BT.709, of at least
`BLACK` in each primary, and black where there is no screen. Both pictures are so, and all of
the rectangle counts: around a dome a fifth of it is black and cannot differ. Views are judged one
by one, and their mean counts. ColorVideoVDP cannot see all that matters: it compares each picture
with its own light, so that black that has become grey is nothing to it (`compensate.plain`).

Three choices are ours:

- Pictures of more than `FINEST` pixels a side are averaged first, for speed. What only finer
  pixels hold does not count: a photographed dome of 2048 x 2048 pixels loses 1.23 JOD here, 1.28
  by ColorVideoVDP; a pair of 1920 x 1080 loses 0.49 by both.
- Pixels of pictures coarser than `COARSEST` are squares of even light, which are seen.
- Seen from a seat, pixels per degree differ from place to place. Q is pooled over places by their
  own resolution (`compensate.vision.resolution`), as over the pixels of one picture.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property, reduce
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.vision.differences import Reference, quality_lost
from compensate.vision.resolution import shares
from domesim.errors import InputError
from domesim.light import (
    Array,
    Light,
    as_sent,
    namespace,
    on_host,
    require_finite,
    require_light,
    require_mask,
)
from domesim.light.blocks import light_sums
from domesim.observation.projector import conversion
from domesim.scene import Scene

FINEST = 1024
"""Pixels of a picture's larger side, at most: larger pictures are averaged."""
COARSEST = 2.0
"""Pixels per degree, at least: pixels of coarser pictures are repeated."""
BLACK = 0.005
"""Least light of a primary, cd/m²: below, ColorVideoVDP does not know."""
NO_DIFFERENCE = 0.02
"""JOD up to which two figures are the same."""
PEOPLE: Mapping[float, float] = {0.1: 0.51, 0.3: 0.60, 0.6: 0.72, 1.0: 0.81, math.inf: 0.91}
"""JOD -> share of pairs up to so far apart, and farther than those before, that people order as
ColorVideoVDP does: of AR-DAVID's 432 films (the experiment `people`)."""
PEOPLE_SAY = (
    "Of two pictures that it puts less than 0.1 JOD apart people order 51 of 100 pairs as it does, "
    "up to 0.3 JOD 60, up to 0.6 JOD 72, up to 1 JOD 81, and beyond 91 (AR-DAVID 2024)."
)
"""`PEOPLE`, in words."""


def agreeing(lost: float, other: float) -> str:
    """Says how often people order pictures so far apart as ColorVideoVDP does.

    Parameters
    ----------
    lost, other
        JOD.

    Returns
    -------
    words
        A clause, as "people order 60 of 100 such pairs so".
    """
    share = next(share for apart, share in PEOPLE.items() if abs(lost - other) < apart)
    return f"people order {100 * share:.0f} of 100 such pairs so"


def compared(lost: float, other: float) -> str:
    """Says in words how one loss of quality compares with another.

    Parameters
    ----------
    lost, other
        JOD.

    Returns
    -------
    words
        "better than", "no different from" or "worse than".
    """
    if abs(lost - other) < NO_DIFFERENCE:
        return "no different from"
    return "better than" if lost < other else "worse than"


@final
class Ruler:
    """How much worse things look than one master.

    Parameters
    ----------
    wanted
        (view, row, col, primary) what should be seen, or `averaged`.
    scene
        Where.
    screen
        (row, col) pixels that count.

    Raises
    ------
    InputError
        If `wanted` is no light, or the screen is not of its size or empty.
    """

    def __init__(self, wanted: Light, scene: Scene, screen: NDArray[np.bool_]) -> None:
        require_pictures("Ruler", screen, wanted)
        self.wanted = on_host(wanted)
        self._scene, self._screen = scene, screen

    def lost(self, seen: Light) -> float:
        """Returns what ColorVideoVDP takes from 10, JOD; 0 where the master is seen.

        Parameters
        ----------
        seen
            (view, row, col, primary), or `averaged`.
        """
        if not isinstance(seen, np.ndarray):
            return float(on_host(self.loss(seen)))
        xyz = self._shown(seen)
        squares = sum(reference.pooled(xyz, share) ** 2 for reference, share in self._references)
        return float(np.mean(quality_lost(np.sqrt(squares))))

    def loss(self, seen: Light) -> Array:
        """Computes `lost` by the library of the light, which may differentiate it.

        Parameters
        ----------
        seen
            (view, row, col, primary), or `averaged`; of PyTorch, to train a network by it.

        Returns
        -------
        lost
            () JOD, of the same library, precision and device.
        """
        xp, xyz = namespace(seen), self._shown(seen)
        squares = sum(
            reference.pooled_anywhere(xyz, share) ** 2 for reference, share in self._references
        )
        # A root has no slope at 0
        return xp.mean(quality_lost(xp.sqrt(xp.clip(squares, 1e-30, None))))

    def lost_map(self, seen: Light) -> NDArray[np.floating[Any]]:
        """Maps what is lost if all of the picture looks like a place, (view, row, col), JOD.

        It has the pixels of what is compared: see the module's docstring.
        """
        xyz = self._shown(on_host(seen))
        maps = [
            reference.difference(xyz) * (1 if share is None else share)
            for reference, share in self._references
        ]
        return np.asarray(reduce(np.add, maps))

    @cached_property
    def _references(self) -> list[tuple[Reference, NDArray[np.float32] | None]]:
        """The master at each resolution, and (row, col) how much a place has of that."""
        wanted, viewing = self._shown(self.wanted), self._scene.viewing
        size = wanted.shape[1:3]
        per_degree = viewing.pixels_per_degree(*size)
        if viewing.seat is None:
            return [(Reference(wanted, per_degree), None)]
        ones = np.broadcast_to(np.float32(1), (1, *self._screen.shape, 1))
        on_screen = self._repeated(averaged(ones, self._screen))[0, ..., 0] > 0
        return [
            (Reference(wanted, factor * per_degree), share)
            for factor, share in shares(viewing.seat.scale(*size), on_screen)
        ]

    def _shown(self, light: Light) -> Light:
        """XYZ of what a display would show, (view, row, col, 3), cd/m²; of NumPy's, float32."""
        require_pictures("Ruler", self._screen, light)
        projector, small, xp = (
            self._scene.projector,
            averaged(light, self._screen),
            namespace(light),
        )
        if xp is np:
            small = small.astype(np.float32, copy=False)
        to_display = projector.to_display(np.eye(3)[None, None])[0, 0]
        shown = xp.clip(small @ as_sent(projector.white * to_display, small), BLACK, None)
        return self._repeated(shown @ as_sent(conversion("BT.709", "XYZ").T, small))

    def _repeated(self, light: Light) -> Light:
        """Averaged light in pixels that are not coarser than `COARSEST`."""
        per_degree = self._scene.viewing.pixels_per_degree(*light.shape[1:3])
        times, xp = max(1, int(np.ceil(COARSEST / per_degree))), namespace(light)
        return light if times == 1 else xp.repeat(xp.repeat(light, times, axis=1), times, axis=2)


def require_pictures(who: str, screen: NDArray[np.bool_], *pictures: Light) -> None:
    """Refuse what is no light of three primaries on a screen.

    Parameters
    ----------
    who
        Name of the caller, for the message.
    screen
        (row, col) pixels that count.
    pictures
        (view, row, col, primary) light of the screen's size, or `averaged`.

    Raises
    ------
    InputError
        If one is no light or has a value that is not finite, or the screen is none or empty.
    """
    require_mask(screen, who=who)
    for light in pictures:
        require_light(light, who=who, primaries=3)
        require_finite(light, who=who)
        small = tuple(side // block_of(screen) for side in screen.shape)
        if tuple(light.shape[1:3]) not in (screen.shape, small) or 0 in light.shape:
            raise InputError(
                f"{who} takes a picture of the screen's {screen.shape} pixels, got one of "
                f"{tuple(light.shape)}"
            )


def averaged(light: Light, screen: NDArray[np.bool_]) -> Light:
    """Averages light over blocks of pixels, so that no side is longer than `FINEST`.

    Rows and columns that do not fill a block are left out.

    Parameters
    ----------
    light
        (view, row, col, primary); what is averaged already stays.
    screen
        (row, col) bool: light elsewhere counts as 0.

    Returns
    -------
    means
        (view, row, col, primary) of blocks.
    """
    block = block_of(screen)
    small = tuple(side // block for side in screen.shape)
    if block > 1 and light.shape[1:3] == small:
        return light
    rows, cols = (slice(side * block) for side in small)
    xp = namespace(light)
    on = xp.asarray(screen[rows, cols], device=light.device)
    sums = light_sums(light[:, rows, cols, :], block, on)
    return (np.ascontiguousarray(sums) if xp is np else sums) / block**2


def whole_block_of(rows: int, cols: int) -> int:
    """Pixels along a side of the largest blocks, up to `averaged`'s, that fill rows and columns.

    A picture of their means has the screen of the whole one.

    Parameters
    ----------
    rows, cols
        Of the picture.

    Returns
    -------
    block
        At least 1.
    """
    block = -(-max(rows, cols) // FINEST)
    while rows % block or cols % block:
        block -= 1
    return block


def block_of(screen: NDArray[np.bool_]) -> int:
    """Pixels along a side of the blocks of `averaged`."""
    return int(-(-max(screen.shape) // FINEST))
