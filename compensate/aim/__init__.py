"""The aim: what can be shown of a master over light that cannot be taken away.

The product's default. A dome's master is lifted with its surroundings (`compensate.aim.dome`), a
pair gets veils that hide the edges of its ghosts (`pair`), a 3D dome both (`pair_in_a_dome`).
Several seats are shown what the mean one is. Exact subtraction (`compensate.subtract`) then shows
the aim: no solver and no transform is needed. Laws, and how the numbers were chosen:
``validation/notes/0007``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from compensate.aim.dome import lifted
from compensate.aim.pair import veiled
from compensate.aim.pair_in_a_dome import aimed
from compensate.aim.settings import Aim, Sight
from compensate.subtract import reflecting, subtracted
from domesim.light import Array, Light, namespace
from domesim.light.planes import Columns, Planes, dtype_of
from domesim.light.strips import in_strips
from domesim.observation.base import Observation
from domesim.observation.crosstalk import Crosstalk
from domesim.observation.lowrank import LowRankObservation

__all__ = ["Aim", "Sight", "aimed_light", "lifted_light"]


def lifted_light(
    aim: Aim,
    sight: Sight,
    observation: Observation,
    wanted: Light | Planes,
    floor: Light | Planes,
    upper: Array | float = 1.0,
    columns: Columns | None = None,
) -> Light:
    """Computes the light that shows what is aimed at in a dome.

    Parameters
    ----------
    aim, sight, wanted, floor
        As for `compensate.aim.dome.lifted`.
    observation
        What is seen of light, at one seat.
    upper
        Largest light, which broadcasts.
    columns
        As for `compensate.subtract.subtracted`.

    Returns
    -------
    light
        (view, row, col, primary) to project, from 0 to `upper`.
    """
    white = _white(observation, dtype_of(wanted) if callable(wanted) else wanted.dtype)
    target = lifted(aim, sight, wanted, floor, white)
    return subtracted(observation, target, (0.0, upper), start=target, out=target, columns=columns)[
        0
    ]


def aimed_light(
    aim: Aim,
    sight: Sight,
    observation: Observation,
    wanted: Light,
    subtractive: Light,
    seen: Light,
    bounds: tuple[Array | float, Array | float] = (0.0, 1.0),
) -> Light:
    """Computes the light that shows what is aimed at.

    Parameters
    ----------
    aim, sight
        Settings, and how the picture is seen.
    observation
        What is seen of light, at one seat.
    wanted
        (view, row, col, primary) what should be seen.
    subtractive, seen
        Light of exact clipped subtraction, and what is seen of it.
    bounds
        Least and largest light, which broadcast; the least is 0 where light is reflected.

    Returns
    -------
    light
        (view, row, col, primary) to project, within `bounds`.
    """
    if len(wanted) > 1 and reflecting(observation) is None:
        target = veiled(aim, sight, wanted, np.maximum(seen - _beside(observation, wanted), 0))
    else:
        floor = _less(seen, observation.direct(subtractive))
        if len(wanted) == 1:
            return lifted_light(aim, sight, observation, wanted, floor, bounds[1])
        target = aimed(
            aim, sight, observation, wanted, floor, _white(observation, wanted.dtype), bounds[1]
        )
        del floor  # it takes memory
    return subtracted(observation, target, bounds, start=subtractive)[0]


def _beside(observation: Observation, wanted: Light) -> Light:
    """Light beside which ghosts are seen: what is wanted, or the background if that is brighter."""
    if not isinstance(observation, Crosstalk) or observation.black.ndim == 2:
        return wanted
    xp = namespace(wanted)
    dark = xp.asarray(observation.dark, dtype=wanted.dtype, device=wanted.device)
    return xp.maximum(wanted, dark)


def _white(observation: Observation, dtype: Any) -> Light:
    """What is seen of white in its own place, (view, row, col, primary)."""
    shape, one = observation.shape, np.ones((), dtype)
    if isinstance(observation, LowRankObservation):
        gain = observation.on_screen_like(one).direct_gain
        return np.broadcast_to(gain[None, :, :, None], shape)
    return observation.direct(np.broadcast_to(one, shape))


def _less(light: Light, other: Light) -> Light:
    """`light` - `other`, by all threads: new memory takes longer than the difference."""
    difference = np.empty_like(light)

    def subtract(view: int, rows: slice) -> None:
        np.subtract(light[view, rows], other[view, rows], out=difference[view, rows])

    in_strips(subtract, light.shape)
    return difference
