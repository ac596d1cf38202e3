"""Without tracing, too, lamps are known to advice: their light is in black, and can be dimmed."""

from __future__ import annotations

import numpy as np
import pytest

from compensate.design import knobs, left_out, theatre
from domesim.scene.loading import scene_content

SIGN = {
    "name": "exit sign",
    "position_m": [0.0, -4.0, 1.0],
    "normal": [0.0, 1.0, 0.0],
    "width_m": 0.4,
    "height_m": 0.2,
    "luminance_cd_m2": [0.0, 30.0, 4.0],
}


def test_exit_signs_are_turned_without_tracing():
    content = {**scene_content("dome_hemisphere"), "lamps": [SIGN]}
    assert left_out(content, trace=False) == ()
    (stray,) = [knob for knob in knobs(content, trace=False) if knob.name == "stray light"]
    dark = np.zeros((1, 32, 32, 3), np.float32)
    black = [
        theatre(stray.at(content, times), trace=False).observation(32, 32).observe(dark).mean()
        for times in (0.0, 1.0, 2.0)
    ]
    assert black[1] > black[0]
    assert black[2] - black[1] == pytest.approx(black[1] - black[0], rel=1e-3)
