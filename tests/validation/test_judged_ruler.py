"""The ruler against ColorVideoVDP's own code, where that is installed."""

from __future__ import annotations

import numpy as np
import pytest

from compensate.ruler import Ruler
from testing.judged import JUDGED, pictures
from validation import judges
from validation.experiment import Missing

PICTURES = {name: rest for name, *rest in pictures()}


@pytest.mark.long
@pytest.mark.parametrize("name", JUDGED)
def test_colorvideovdp_still_says_what_it_said(name):
    scene, light, seen = PICTURES[name]
    try:
        judged = tuple(10 - judges.colorvideovdp(light, each, scene) for each in seen)
    except Missing as reason:
        pytest.skip(str(reason))
    assert judged == pytest.approx(JUDGED[name], abs=0.001)


@pytest.mark.long
@pytest.mark.parametrize("name", ["bundled", "stars", "bars"])
def test_the_map_is_colorvideovdps(name):
    scene, light, (seen, _) = PICTURES[name]
    try:
        _, judged = judges.colorvideovdp_map(light, seen, scene)
    except Missing as reason:
        pytest.skip(str(reason))
    found = Ruler(light, scene, scene.screen(*light.shape[1:3])).lost_map(seen)
    assert np.abs(found - judged).max() < 0.02 * judged.max()
    assert judged.mean() < found.mean() < 1.1 * judged.mean()
