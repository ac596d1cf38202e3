"""The aim of a 3D dome: both views lifted by the same light, then veils for what ghosts are left.

Reflected light is missing all over the screen, and crosstalk in places. Over the lifted black most
ghosts can be subtracted. The floor is no ghost: less light of a pixel's own does not take it away.
"""

from __future__ import annotations

from compensate.aim.dome import lifted
from compensate.aim.pair import veiled
from compensate.aim.settings import Aim, Sight
from compensate.subtract import subtracted
from domesim.light import Array, Light, namespace
from domesim.observation.base import Observation


def aimed(
    aim: Aim,
    sight: Sight,
    observation: Observation,
    wanted: Light,
    floor: Light,
    brightest: Light,
    upper: Array | float,
) -> Light:
    """Lifts both views of a 3D dome, then adds veils around what ghosts are left.

    Parameters
    ----------
    aim, sight, wanted, floor, brightest
        As for `compensate.aim.dome.lifted`.
    observation
        What is seen of light.
    upper
        Largest light, which broadcasts.

    Returns
    -------
    light
        (2, row, col, primary).
    """
    xp = namespace(wanted)
    raised = lifted(aim, sight, wanted, floor, brightest)
    light, _ = subtracted(observation, raised, (0.0, upper))
    raised = xp.maximum(raised, floor)
    ghosts = xp.maximum(observation.observe(light) - raised, xp.zeros_like(raised))
    return veiled(aim, sight, raised, ghosts)
