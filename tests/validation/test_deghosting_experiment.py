"""Deghosting: the experiment, its pairs, and mistakes that must turn it red."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mistakes import change, failed, no_colorvideovdp

from compensate.solver.baselines import RaisedBlack
from domesim.light import namespace
from domesim.observation.crosstalk import Crosstalk
from domesim.scene import load_scene
from testing import pairs
from validation import data, judges
from validation.experiment import Missing, Work
from validation.experiments import deghosting


@pytest.fixture(autouse=True)
def _quickly(monkeypatch):
    """Tiny, one level, without the judge that takes seconds a picture."""
    monkeypatch.setattr(judges, "colorvideovdp", no_colorvideovdp)
    monkeypatch.setattr(deghosting, "QUICK_WIDTH", 48)
    monkeypatch.setattr(deghosting, "QUICK_LEVELS", (0.05,))


def test_it_is_as_expected(tmp_path):
    finding = deghosting.run(Work(store=tmp_path))
    assert failed(finding) == []
    assert deghosting.run(Work(store=tmp_path)) == finding  # killed and resumed
    assert finding.left_out[-1] == "ColorVideoVDP: it needs pip install 'domesim[metrics]'"
    assert len(finding.pictures[0].panels) == 5
    assert [len(table.rows) for table in finding.tables] == [8, 4]
    assert finding.figures["deghosting.generated.5%.none.left"] == pytest.approx(1)


def test_without_test_data_the_generated_pair_is_measured(monkeypatch, tmp_path):
    monkeypatch.setenv(data.FOLDER, str(tmp_path))
    monkeypatch.setattr(deghosting, "WIDEST", 48)
    monkeypatch.setattr(deghosting, "LEVELS", (0.05,))
    finding = deghosting.run(Work(quick=False))
    assert failed(finding) == []
    assert finding.tables[0].caption.startswith("The generated pair, 48 x 27")
    assert any("beachball 4" in why and data.FOLDER in why for why in finding.left_out)


def one_way(monkeypatch):
    """No light leaks to the left eye."""
    honest, seen = Crosstalk.leaked, Crosstalk._observe

    def leaked(self, light):
        found = honest(self, light)
        return namespace(light).stack([0 * found[0], found[1]])

    def observe(self, light):
        return seen(self, light) - honest(self, light) + leaked(self, light)

    monkeypatch.setattr(Crosstalk, "leaked", leaked)
    monkeypatch.setattr(Crosstalk, "_observe", observe)


def idle(monkeypatch):
    """Ours shows what subtraction does."""
    change(monkeypatch, deghosting, "perceptual", lambda posed, light: posed.subtractive)


def too_much(monkeypatch):
    """Subtraction takes a tenth of all light."""
    change(monkeypatch, deghosting, "subtractive", lambda posed, light: 0.9 * light)


def half_raised(monkeypatch):
    """Range compression by half as much as is needed: it clips."""
    honest = RaisedBlack.__call__

    def halfway(self, problem, start):
        found = honest(self, problem, start)
        return replace(found, light=problem.project(0.5 * (found.light + problem.desired)))

    monkeypatch.setattr(RaisedBlack, "__call__", halfway)


@pytest.mark.parametrize(
    ("mutate", "caught"),
    [
        (one_way, "untouched"),
        (idle, "ours"),
        (too_much, "subtraction"),
        (half_raised, "range compression"),
    ],
)
def test_mistakes_turn_it_red(mutate, caught, monkeypatch):
    mutate(monkeypatch)
    assert any(what.startswith(caught) for what in failed(deghosting.run(Work())))


def test_the_generated_pair_has_ghosts_on_black():
    light = pairs.generated(96, seed=3)
    assert light.shape == (2, 54, 96, 3)
    assert light.dtype == np.float32
    assert light.min() >= 0
    assert light.max() == 1
    grey = light.mean(axis=-1)
    on_black = (grey < 0.001) & (grey[::-1] > 0.1)
    assert np.all(on_black.mean(axis=(1, 2)) > 0.005)
    assert np.array_equal(light, pairs.generated(96, seed=3))
    assert not np.array_equal(light, pairs.generated(96, seed=4))
    assert not np.array_equal(light[0], light[1])


def test_what_is_near_is_farther_right_for_the_left_eye():
    """The red disc, 2 % before the screen, is 2 % of the width farther right for the left eye."""
    light = pairs.generated(400)
    red = (light[..., 0] > 0.2) & (light[..., 1] < 0.5 * light[..., 0])
    middle = red[:, 120:170, 120:230]
    places = [np.nonzero(view)[1].mean() for view in middle]
    assert places[0] - places[1] == pytest.approx(0.02 * 400, abs=1)


def test_averages_keep_the_light():
    light = np.random.default_rng(0).random((2, 7, 10, 3)).astype(np.float32)
    small = pairs.averaged(light, 3)
    assert small.shape == (2, 2, 3, 3)
    assert small.dtype == np.float32
    assert small[1, 1, 2] == pytest.approx(light[1, 3:6, 6:9].mean(axis=(0, 1)))
    assert np.array_equal(pairs.averaged(light, 1), light)


def test_a_missing_pair_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setenv(data.FOLDER, str(tmp_path))
    with pytest.raises(Missing, match=r"fog_multiview\.exr; set DOMESIM_DATA"):
        data.from_data("fog", load_scene(deghosting.STEREO_SCENE))


@pytest.mark.parametrize("name", data.FILES)
def test_the_test_data_are_pairs(name):
    try:
        light, clipped = data.from_data(name, load_scene(deghosting.STEREO_SCENE))
    except Missing as missing:
        pytest.skip(str(missing))
    assert len(light) == 2
    assert light.min() >= 0
    assert light.max() <= 1
    assert 0 <= clipped < 0.05
    assert not np.array_equal(light[0], light[1])
