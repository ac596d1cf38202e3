"""The ruler: no setting of a method enters it."""

from __future__ import annotations

import numpy as np
import pytest

from compensate import ruler
from compensate.aim import Aim
from compensate.figures import Appraisal
from compensate.pose import pose
from compensate.ruler import Ruler
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import PerceptualWeighting
from domesim.scene import load_scene
from validation.masters import night


def test_no_setting_of_the_method_changes_it():
    scene, light = load_scene("dome_planetarium"), night(64)
    eyes = (
        Aim(),
        Aim(lift=4.0),
        PerceptualWeighting(),
        PerceptualWeighting(LowFrequencyFloor(1.0)),
    )
    appraisals = [Appraisal(pose(light, scene, eye)) for eye in eyes]
    for figure in ("loss", "visible_error"):
        found = {round(getattr(each, figure)(light), 9) for each in appraisals}
        assert len(found) == 1


def test_it_is_nothing_for_the_master_and_rises_with_the_veil():
    scene, light = load_scene("dome_planetarium"), night(64)
    screen = scene.screen(64, 64)
    lost = [Ruler(light, scene, screen).lost(light + veil) for veil in (0.0, 0.005, 0.05)]
    assert lost[0] == 0
    assert 0 < lost[1] < lost[2]


def test_what_lies_off_the_screen_does_not_count():
    scene, light = load_scene("dome_planetarium"), night(64)
    screen = scene.screen(64, 64)
    other = np.where(screen[..., None], light, 0.7)
    assert Ruler(light, scene, screen).lost(other) == 0


def test_large_pictures_are_averaged(monkeypatch):
    scene, light = load_scene("dome_planetarium"), night(64)
    seen = light + 0.02
    large = [np.repeat(np.repeat(one, 2, 1), 2, 2) for one in (light, seen)]
    monkeypatch.setattr(ruler, "FINEST", 64)
    whole = Ruler(light, scene, scene.screen(64, 64)).lost(seen)
    screen = np.repeat(np.repeat(scene.screen(64, 64), 2, 0), 2, 1)
    found = Ruler(large[0], scene, screen).lost(large[1])
    assert found == pytest.approx(whole, rel=1e-5)
