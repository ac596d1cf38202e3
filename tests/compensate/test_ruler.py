"""The ruler: it is ColorVideoVDP's figure, and no setting of a method enters it."""

from __future__ import annotations

import numpy as np
import pytest

from compensate import ruler
from compensate.aim import Aim
from compensate.figures import Appraisal
from compensate.pose import pose
from compensate.ruler import NO_DIFFERENCE, Ruler
from compensate.vision.csf import LowFrequencyFloor
from compensate.weighting import PerceptualWeighting
from domesim.room.viewing import DomeSeat
from domesim.scene import load_scene
from testing.judged import JUDGED, pictures
from testing.masters import night

PICTURES = {name: rest for name, *rest in pictures()}


@pytest.mark.parametrize("name", JUDGED)
def test_it_is_what_colorvideovdp_said(name):
    scene, light, seen = PICTURES[name]
    ours = Ruler(light, scene, scene.screen(*light.shape[1:3]))
    lost, judged = [ours.lost(each) for each in seen], JUDGED[name]
    assert lost == pytest.approx(judged, rel=0.005, abs=0.002)
    assert np.abs(np.subtract(lost, judged)).max() < NO_DIFFERENCE / 2
    assert np.sign(lost[1] - lost[0]) == np.sign(judged[1] - judged[0])


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


def test_what_is_lost_in_one_is_lost_in_the_other():
    """Nearly: both pictures mask alike, but the eye is adapted to the master."""
    scene, light = load_scene("stereo_shutter"), PICTURES["bars"][1]
    screen = scene.screen(*light.shape[1:3])
    ghosts = (light + 0.01 * light[::-1]).astype(np.float32)
    there, back = (
        Ruler(wanted, scene, screen).lost(seen)
        for wanted, seen in ((light, ghosts), (ghosts, light))
    )
    assert there > 0.05
    assert back == pytest.approx(there, rel=0.2)


def test_eyes_are_judged_one_by_one():
    scene, light, (seen, _) = PICTURES["lamps"]
    screen = scene.screen(*light.shape[1:3])
    both = Ruler(light, scene, screen).lost(seen)
    each = [Ruler(light[[v, v]], scene, screen).lost(seen[[v, v]]) for v in (0, 1)]
    assert each[0] != pytest.approx(each[1], rel=1e-3)
    assert both == pytest.approx(np.mean(each), rel=1e-6)


def test_from_a_seat_places_count_by_their_own_resolution(monkeypatch):
    """The scene assumes one resolution: a seat has more and less of it from place to place."""
    scene, light, (seen, _) = PICTURES["stars"]
    screen = scene.screen(384, 384)
    assumed = Ruler(light, scene, screen).lost(seen)
    seated = scene.seen_from("front")
    found = Ruler(light, seated, screen)
    assert found.lost(seen) != pytest.approx(assumed, rel=1e-3)
    assert found.lost(seen) == pytest.approx(assumed, rel=0.4)
    assert found.lost(light) == 0
    # Where all places have one resolution, it is that of the whole
    monkeypatch.setattr(DomeSeat, "scale", lambda seat, *size: np.ones(size, np.float32))
    assert Ruler(light, seated, screen).lost(seen) == pytest.approx(assumed, rel=0.02)
    whole = Ruler(light, scene, screen).lost_map(seen)[:, screen]
    np.testing.assert_allclose(
        Ruler(light, seated, screen).lost_map(seen)[:, screen], whole, rtol=1e-3, atol=1e-5
    )


def test_coarse_pixels_are_squares_of_even_light():
    scene, light = load_scene("dome_planetarium"), night(90)
    seen = light + np.float32(0.02)
    finer = [each.repeat(4, 1).repeat(4, 2) for each in (light, seen)]
    found = Ruler(light, scene, scene.screen(90, 90)).lost(seen)
    screen = scene.screen(90, 90).repeat(4, 0).repeat(4, 1)
    assert found == pytest.approx(Ruler(finer[0], scene, screen).lost(finer[1]), rel=1e-5)


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
