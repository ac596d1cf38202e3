"""The aim of the experiment without an eye is the product's."""

from __future__ import annotations

import numpy as np

from compensate.aim import Aim
from compensate.pose import pose
from compensate.solve import solved
from compensate.vision.glare import StrayLight
from domesim.scene import load_dome
from validation.experiments.stray_light import aimed
from validation.masters import night


def test_without_an_eye_the_aim_is_the_defaults():
    posed = pose(night(48).astype(np.float32), load_dome("dome_hemisphere"), Aim())
    default = solved(posed, "perceptual").light
    np.testing.assert_allclose(aimed(posed, None), default, atol=1e-6)
    with_eye = aimed(posed, StrayLight(70))
    assert 0.01 < np.abs(with_eye - default).max() < 0.5
