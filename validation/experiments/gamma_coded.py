"""Light adds up; gamma-coded values do not.

Rationale
    The paper (section 4) gamma-corrects the RGB values and transforms the pollution to YCbCr before
    it computes the compensation. Pollution is linear in light, not in code values.
Expected
    The same solver on gamma-coded values, decoded and observed in linear light, does worse than on
    linear light; perhaps worse than nothing.
"""

from __future__ import annotations

import numpy as np

from compensate.master import pose
from compensate.solver.admm import ADMM
from domesim.scene import load_scene
from validation.masters import night


def measure(size: int = 256, scene: str = "dome_imax", gamma: float = 2.2) -> dict[str, float]:
    """Visible errors (JND rms) with linear and gamma-coded values, with nothing, subtracted."""
    theatre = load_scene(scene)
    light = night(size)
    posed, coded = pose(light, theatre), pose(light ** np.float32(1 / gamma), theatre)
    linear = ADMM()(posed.problem, posed.subtractive).light
    decoded = ADMM()(coded.problem, coded.subtractive).light ** np.float32(gamma)
    return {
        "error_linear": posed.visible_error(linear),
        "error_gamma_coded": posed.visible_error(decoded),
        "error_subtractive": posed.visible_error(posed.subtractive),
        "error_nothing": posed.visible_error(posed.desired),
    }


if __name__ == "__main__":
    print(measure())
