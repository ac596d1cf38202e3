"""Marks of a judge and masks: counts by hand, with a judge of our own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from compensate.pose import pose
from compensate.prediction import predict
from compensate.visible import SEEN
from domesim.scene import load_dome
from testing.places import dome_at, stereo_at
from validation import marks
from validation.experiments import only_visible
from validation.marks import LEVELS, Agreement, agreement, tuned


def counts(held: float, *, taken: float = 1.5, marked: int = 1000) -> Agreement:
    """An input of which the mask holds less the higher the threshold."""
    shares = np.clip(held + 0.5 * (LEVELS[10] - np.array(LEVELS)), 0, 1)
    return Agreement(
        seen=10_000,
        marked=marked,
        held=tuple(round(marked * share) for share in shares),
        taken=tuple(round(marked * taken * share) for share in shares),
        veils=(marked // 2, marked // 4),
    )


def test_the_threshold_is_that_of_the_input_that_needs_the_least():
    level = tuned([counts(0.99), counts(0.97)])
    assert level == LEVELS[11]
    assert counts(0.97).at(level)[0] == pytest.approx(0.96)
    assert tuned([counts(0.99)]) > level
    assert tuned([counts(0.3)]) == LEVELS[0]
    unmarked = Agreement(10, 0, (0,) * len(LEVELS), (3,) * len(LEVELS), (0, 3))
    assert tuned([counts(0.99), unmarked]) == tuned([counts(0.99)])


def test_inputs_count_by_their_pixels():
    both = counts(0.9, marked=3000) + counts(0.98, taken=3.0)
    assert (both.seen, both.marked, both.veils) == (20_000, 4000, (2000, 1000))
    held, taken = both.at(LEVELS[10])
    assert held == pytest.approx((3 * 0.9 + 0.98) / 4)
    assert taken == pytest.approx((3 * 1.5 * 0.9 + 3.0 * 0.98) / 4)
    assert both.before == (0.5, 0.25)


def test_pixels_are_counted_on_the_screen_where_the_judge_marks(monkeypatch):
    scene = load_dome("dome_hemisphere")
    scene = replace(scene, viewing=replace(scene.viewing, extent=8.0), ambient=0.01)
    size = 64
    light = np.full((1, size, size, 3), 0.02, np.float32)
    light[:, 26:40, 20:30] = 1
    posed = pose(light, scene)
    lost = np.zeros((1, size, size), np.float32)
    lost[:, :32] = 1.0
    lost[:, 32] = 0.99

    def judge(wanted, seen, where):
        assert where is scene
        room = (wanted - posed.problem.desired)[:, posed.screen]
        assert room.min() > 0
        assert (seen >= wanted - 1e-6).all()
        return 9.0, lost

    monkeypatch.setattr(marks, "colorvideovdp_map", judge)
    found = agreement(posed, posed.desired)
    upper = np.arange(size)[:, None] < 32
    assert found.seen == posed.screen.sum()
    assert found.marked == (posed.screen & upper).sum()
    level = 0.5
    mask = predict(posed, settings=SEEN).prediction[0] > 1 - 2**-level
    assert mask.any()
    at = LEVELS.index(level)
    assert found.taken[at] == (mask & posed.screen).sum()
    assert found.held[at] == (mask & posed.screen & upper).sum() < found.taken[at]
    assert found.taken == tuple(sorted(found.taken, reverse=True))
    assert found.veils[0] < found.veils[1] <= found.seen


def test_halves_are_apart_and_hold_all():
    pairs = {f"pair {k}": only_visible.Input(None, stereo_at, (), 0.0) for k in range(5)}
    domes = {f"dome {k}": only_visible.Input(None, dome_at, (), 0.0) for k in range(4)}
    one, other = only_visible.halves(pairs | domes)
    assert sorted(one + other) == sorted(pairs | domes)
    for half in (one, other):
        assert sum(name.startswith("pair") for name in half) in {2, 3}
        assert sum(name.startswith("dome") for name in half) == 2
