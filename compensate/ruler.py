"""The ruler: how much worse what is seen looks than the master, whatever the method.

The reference model is `compensate.vision.differences`: a picture's contrasts at all scales, each
relative to the light around, with published constants. No setting of a method enters it. Its unit
is the just-objectionable difference (JOD): of two pictures 1 JOD apart, 75 of 100 people prefer the
better.
"""

from __future__ import annotations

from functools import cached_property, reduce
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from compensate.vision.differences import Reference, visible_difference
from compensate.vision.resolution import by_resolution
from domesim.light import Light
from domesim.light.strips import in_strips
from domesim.scene import Scene

FINEST = 1024
"""Pixels of a picture's larger side, at most: larger pictures are averaged."""


@final
class Ruler:
    """How much worse things look than one master.

    Parameters
    ----------
    wanted
        (view, row, col, primary) what should be seen.
    scene
        Where.
    screen
        (row, col) pixels that count.
    """

    def __init__(self, wanted: Light, scene: Scene, screen: NDArray[np.bool_]) -> None:
        self.wanted = wanted
        self._scene, self._screen = scene, screen

    def lost(self, seen: Light) -> float:
        """Mean of `lost_map` over the screen, JOD: 0 where the master is seen.

        Parameters
        ----------
        seen
            (view, row, col, primary).
        """
        lost = self.lost_map(seen)
        return float(np.sum(lost * self._share) / (self._share.sum() * len(lost)))

    def lost_map(self, seen: Light) -> NDArray[np.floating[Any]]:
        """(view, row, col) JOD that are lost if all of the picture looks like that place.

        It is computed from the averaged picture.
        """
        found, viewing = self._averaged(seen), self._scene.viewing
        if viewing.seat is None:
            return self._reference.difference(found)
        wanted = self._averaged_master
        per_degree = viewing.pixels_per_degree(*wanted.shape[1:3])
        (lost,) = by_resolution(
            viewing.seat.scale(*wanted.shape[1:3]),
            self._share[0] > 0,
            lambda factor: (visible_difference(wanted, found, factor * per_degree),),
        )
        return lost

    @cached_property
    def _reference(self) -> Reference:
        wanted = self._averaged_master
        return Reference(wanted, self._scene.viewing.pixels_per_degree(*wanted.shape[1:3]))

    @cached_property
    def _share(self) -> NDArray[np.float32]:
        """(1, row, col) of the averaged picture: how much of a pixel is screen."""
        ones = np.broadcast_to(np.float32(1), (1, *self._screen.shape, 1))
        return np.asarray(_reduced(ones, self._screen)[..., 0])

    @cached_property
    def _averaged_master(self) -> NDArray[np.float32]:
        return self._averaged(self.wanted)

    def _averaged(self, light: Light) -> NDArray[np.float32]:
        """XYZ of the averaged picture, (view, row, col, 3), cd/m²."""
        projector = self._scene.projector
        to_xyz = (projector.to_xyz * projector.white).T.astype(np.float32)
        averaged = np.maximum(_reduced(light, self._screen), 0).astype(np.float32)
        return np.asarray(averaged @ to_xyz)


def _reduced(light: Light, screen: NDArray[np.bool_]) -> Light:
    """Means of squares of light on the screen, so that no side is longer than `FINEST`.

    What is left over is left out.
    """
    times = -(-max(screen.shape) // FINEST)
    rows, cols = (side // times for side in screen.shape)
    means = np.empty((len(light), rows, cols, light.shape[-1]), light.dtype)

    def average(view: int, lines: slice) -> None:
        part, across = slice(lines.start * times, lines.stop * times), slice(cols * times)
        for p in range(light.shape[-1]):
            on = light[view, part, across, p] * screen[part, across]
            # Whole rows first, which are contiguous
            total = reduce(np.add, (on[k::times] for k in range(times)))
            total = reduce(np.add, (total[:, k::times] for k in range(times)))
            means[view, lines, :, p] = total / times**2

    in_strips(average, (len(light), rows, cols, times**2 * light.shape[-1]))
    return means
