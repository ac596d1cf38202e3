"""What ColorVideoVDP says of a show's seconds as films (extra ``metrics``).

Its temporal model takes minutes for pictures of full size. So pictures are averaged to at most
`FINEST` pixels a side, in which coarse flicker, fades and lifts are all there. A seat's resolution
is that of the whole picture.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensate.pose import Posed
from compensate.ruler import COARSEST
from compensate.vision.colorvideovdp import film_lost
from domesim.light import Light
from domesim.light.blocks import light_means
from domesim.scene import Scene

FINEST = 512
"""Pixels of a picture's larger side, at most."""


def films_lost(
    moments: Iterable[tuple[Posed, Mapping[str, Light]]], rate: float
) -> dict[str, float]:
    """Judges films of one show.

    Parameters
    ----------
    moments
        Each master, and what is projected for it by each way to do so.
    rate
        Frames a second.

    Returns
    -------
    lost
        JOD lost, by way: the mean of the views.

    Raises
    ------
    InputError
        If cvvdp is not installed.
    """
    wanted: list[NDArray[np.float32]] = []
    seen: dict[str, list[NDArray[np.float32]]] = {}
    for posed, lights in moments:
        scene, screen = posed.scene, posed.screen
        wanted.append(_shown(posed.wanted[: scene.views], scene, screen))
        for way, light in lights.items():
            seen.setdefault(way, []).append(_shown(posed.seen(light), scene, screen))
    density = scene.viewing.pixels_per_degree(*wanted[0].shape[1:3])
    return {
        way: float(
            np.mean(
                [
                    film_lost([w[v] for w in wanted], [f[v] for f in film], density, rate)
                    for v in range(scene.views)
                ]
            )
        )
        for way, film in seen.items()
    }


def _shown(light: Light, scene: Scene, screen: NDArray[np.bool_]) -> NDArray[Any]:
    """(view, row, col, RGB) of a display in the scene's place, linear BT.709, cd/m²."""
    step = -(-max(screen.shape) // FINEST)
    small = light_means(light.astype(np.float32, copy=False), step, screen)
    shown = np.maximum(scene.projector.to_display(small), 0) * np.float32(scene.projector.white)
    times = int(np.ceil(COARSEST / scene.viewing.pixels_per_degree(*shown.shape[1:3])))
    return np.asarray(shown.repeat(times, 1).repeat(times, 2), np.float32)
