"""The albedo of a dome's screen from the level at which its front answers its lit rear half."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from domesim.errors import InputError
from domesim.observation.radiosity import radiosity
from domesim.observation.spherical import bare_transport
from domesim.scene.dome import DomeScene
from domesim.scene.fields import three

Floats = NDArray[np.float64]

_SIZE = 64
"""Pixels of a domemaster: reflected light is smooth."""
_RINGS = 6
"""Resolution of radiosity."""
_LOOK = 0.5
"""Where the viewer looks, towards the front, of the half-angle."""
_HIGHEST = 0.98
_STEP = 1.02
_CLOSE = 1e-4


def answering_levels(scene: DomeScene, albedo: Floats) -> Floats:
    """(primary,) level of the front half that answers the lit rear half.

    Parameters
    ----------
    scene
        The dome. Its floor and wall are counted, furniture is not.
    albedo
        (primary,) of the screen, holes counted in.
    """
    kept = 1 - scene.theatre.perforation
    room = replace(scene.theatre.enclosure, albedo=three(albedo / kept))
    bare = room.floor is None and room.wall is None and room.dome.height_ratio == 1
    transport = bare_transport(room) if bare else radiosity(room, resolution=_RINGS)
    seen = replace(scene, theatre=room, transport=transport, stereo=None)
    observation = seen.one_view(_SIZE, _SIZE)
    rear = np.zeros((1, _SIZE, _SIZE, 3))
    rear[:, : _SIZE // 2] = 1
    look = (0, int(_SIZE * (1 + _LOOK) / 2), _SIZE // 2)
    black, by_rear, by_front = (
        observation.observe(light)[look] for light in (0 * rear, rear, 1 - rear)
    )
    return np.asarray((by_rear - black) / (by_front - black), np.float64)


def albedos_of(scene: DomeScene, levels: Floats) -> tuple[Floats, Floats]:
    """Albedo of the screen, holes counted in, for levels that answer.

    On a bare sphere level / (1 + level) is the albedo times a constant; a floor and a wall make
    little of that crooked, so that it is solved by a few steps of the rule of three.

    Parameters
    ----------
    scene
        See `answering_levels`.
    levels
        (primary,) light of the front half, of the rear half's.

    Returns
    -------
    albedo, slope
        (primary,), and its change by the level.

    Raises
    ------
    InputError
        If no screen reflects as much.
    """
    wanted = levels / (1 + levels)
    highest = _HIGHEST * (1 - scene.theatre.perforation)
    albedo = np.full(3, 0.5 * highest)
    for _ in range(12):
        found = answering_levels(scene, albedo)
        before, albedo = albedo, albedo * wanted * (1 + found) / found
        if not ((albedo > 0) & (albedo < highest)).all():
            raise InputError(
                f"{scene.name}: the front answered the lit rear half with "
                f"{', '.join(f'{each:.1%}' for each in levels)} of R, G, B, which no screen there "
                f"reflects: did the page fill the dome, front below? Is the dome's shape right?"
            )
        if np.abs(albedo / before - 1).max() < _CLOSE:
            break
    more = answering_levels(scene, albedo * _STEP)
    return albedo, albedo * (_STEP - 1) / (more - levels)
