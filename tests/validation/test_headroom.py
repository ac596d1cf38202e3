"""The climb's own parts: what torch differentiates is what judges and theatres say."""

from __future__ import annotations

import numpy as np
import pytest

from compensate.aim import Aim
from compensate.pose import pose
from validation.content import DOMES
from validation.experiment import Missing
from validation.experiments import headroom
from validation.experiments.headroom import _difference, _kept, _seen
from validation.inputs import dome_at
from validation.judges import climbable
from validation.panel import delta_e_itp


@pytest.fixture(scope="module")
def limb():
    """A planetary limb, subtracted."""
    light = np.asarray(DOMES["planetary limb"](32), np.float32)
    return pose(light, dome_at(0.5, 15.0), Aim())


@pytest.fixture(scope="module")
def torch():
    """Torch, with ColorVideoVDP."""
    try:
        return climbable(np.zeros((1, 32, 32, 3), np.float32), dome_at(0.5, 15.0))[0]
    except Missing as reason:
        pytest.skip(str(reason))


def test_its_difference_is_the_panels(torch, limb):
    shown = limb.seen(limb.subtractive)
    found = _difference(torch, limb.wanted, limb.scene)(torch.from_numpy(shown))
    assert found.item() == pytest.approx(delta_e_itp(limb.wanted, shown, limb.scene), rel=1e-3)


def test_light_is_seen_and_sent_back_through_the_theatre(torch, limb):
    random = np.random.default_rng(0).random((2, *limb.desired.shape)).astype(np.float32)
    light = torch.tensor(random[0], requires_grad=True)
    seen = _seen(torch, limb.observation)(light)
    assert seen.detach().numpy() == pytest.approx(limb.observation.observe(random[0]))
    (seen * torch.tensor(random[1])).sum().backward()
    wanted = np.vdot(random[1], limb.observation.linear(random[0]))
    assert np.vdot(light.grad.numpy(), random[0]) == pytest.approx(wanted, rel=1e-4)


def test_it_climbs_and_obeys(torch, limb, monkeypatch):
    """A judge that likes light, held back by the difference from the master alone."""
    screen = torch.from_numpy(limb.screen)
    judge = torch, lambda light: light[0][screen].mean()
    monkeypatch.setattr(headroom, "climbable", lambda *_: judge)

    def judged(light):
        shown = limb.seen(light)
        return shown[:, limb.screen].mean(), delta_e_itp(limb.wanted, shown, limb.scene)

    liked, limit = judged(limb.subtractive)
    better, difference = judged(headroom.climbed(limb, limb.subtractive, 1.2 * limit, 40))
    assert better > 1.02 * liked
    assert difference < 1.205 * limit
    free, far = judged(headroom.climbed(limb, limb.subtractive, 100 * limit, 40))
    assert free > better
    assert far > 1.5 * limit
    # The screen alone is lit
    dark = headroom.climbed(limb, limb.subtractive, 1.2 * limit, 2)[:, ~limb.screen]
    np.testing.assert_array_equal(dark, limb.subtractive[:, ~limb.screen])


def test_it_keeps_the_light_of_what_is_exact(torch, limb, monkeypatch):
    """A judge that likes the dark dims the picture, but where light must be kept."""
    screen = torch.from_numpy(limb.screen)
    judge = torch, lambda light: -light[0][screen].mean()
    monkeypatch.setattr(headroom, "climbable", lambda *_: judge)
    kept = _kept(torch, limb)

    def shares(**how):
        light = headroom.climbed(limb, limb.subtractive, 1000.0, 40, **how)
        return kept(torch.from_numpy(limb.seen(light)))

    assert kept(torch.from_numpy(limb.shown)).numpy() == pytest.approx(1, abs=1e-3)
    assert shares().median() < 0.9
    assert shares(keeps=True).median() >= headroom.KEPT
