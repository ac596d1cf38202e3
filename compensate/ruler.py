"""The ruler: how much worse what is seen looks than the master, whatever the method.

The reference model is `compensate.vision.differences`: a picture's contrasts at all scales, each
relative to the light around, with published constants. No setting of a method enters it. Its unit
is the just-objectionable difference (JOD): of two pictures 1 JOD apart, 75 of 100 people prefer the
better.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensate.vision.differences import visible_difference
from domesim.light import Light
from domesim.scene import Scene
from domesim.strips import in_strips

FINEST = 1024
"""Pixels of a picture's larger side, at most: larger pictures are averaged."""


def quality_lost(wanted: Light, seen: Light, scene: Scene, screen: NDArray[np.bool_]) -> float:
    """Mean of `lost_map` over the screen, JOD: 0 where the master is seen.

    Parameters
    ----------
    wanted, seen
        (view, row, col, primary) what should be seen, and what is.
    scene
        Where.
    screen
        (row, col) pixels that count.
    """
    lost = lost_map(wanted, seen, scene, screen)
    share = _reduced(np.ones((1, *screen.shape, 1), np.float32), screen)[..., 0]
    return float(np.sum(lost * share) / (share.sum() * len(lost)))


def lost_map(
    wanted: Light, seen: Light, scene: Scene, screen: NDArray[np.bool_]
) -> NDArray[np.floating[Any]]:
    """(view, row, col) JOD that are lost if all of the picture looks like that place.

    Parameters are as for `quality_lost`; the map is of the averaged picture.
    """
    shown = [_reduced(light, screen) for light in (wanted, seen)]
    to_xyz = (scene.projector.to_xyz * scene.projector.white).T.astype(np.float32)
    per_degree = scene.viewing.pixels_per_degree(*shown[0].shape[1:3])
    wanted, seen = (np.maximum(light, 0).astype(np.float32) @ to_xyz for light in shown)
    return visible_difference(wanted, seen, per_degree)


def _reduced(light: Light, screen: NDArray[np.bool_]) -> Light:
    """Means of squares of light on the screen, so that no side is longer than `FINEST`.

    What is left over is left out.
    """
    times = -(-max(screen.shape) // FINEST)
    rows, cols = (side // times for side in screen.shape)
    means = np.empty((len(light), rows, cols, light.shape[-1]), light.dtype)

    def average(view: int, lines: slice) -> None:
        part, across = slice(lines.start * times, lines.stop * times), slice(cols * times)
        on = np.repeat(screen[part, across].astype(light.dtype), light.shape[-1], axis=1)
        on *= light[view, part, across].reshape(on.shape)
        # Whole rows first, which are contiguous
        total = reduce(np.add, (on[k::times] for k in range(times)))
        total = total.reshape(-1, cols, times, light.shape[-1])
        total = reduce(np.add, (total[:, :, k] for k in range(times)))
        means[view, lines] = total / times**2

    in_strips(average, (len(light), rows, cols, times**2 * light.shape[-1]))
    return means
