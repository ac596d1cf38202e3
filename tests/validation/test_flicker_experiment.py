"""Flicker: the experiment, its films, and mistakes that must turn it red."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from mistakes import failed

from compensate.aim import dome
from validation import films
from validation.experiment import Work
from validation.experiments import flicker


@pytest.fixture(autouse=True)
def _quickly(monkeypatch):
    """Tiny."""
    monkeypatch.setattr(flicker, "QUICK_WIDTH", 48)
    monkeypatch.setattr(flicker, "QUICK_SIZE", 40)
    monkeypatch.setattr(flicker, "FADE", 24)
    monkeypatch.setattr(flicker, "QUICK_MOVES", 3)


def test_it_is_as_expected(tmp_path):
    finding = flicker.run(Work(store=tmp_path))
    assert failed(finding) == []
    assert flicker.run(Work(store=tmp_path)) == finding  # killed and resumed
    assert [len(table.rows) for table in finding.tables] == [6]


def test_frames_with_memory_turn_it_red(monkeypatch):
    honest, before = flicker.solved, []

    def warm(posed, method):
        found = honest(posed, method)
        light = found.light
        if before and before[-1].shape == light.shape:
            light = (light + before[-1]) / 2
        before.append(light)
        return replace(found, light=light)

    monkeypatch.setattr(flicker, "solved", warm)
    red = failed(flicker.run(Work()))
    for what in ("largest difference of light", "what stands still"):
        assert any(what in check for check in red), red


@pytest.fixture
def fading():
    """A domemaster that fades from a grey of which all pollution can be subtracted."""
    scene = flicker.dome_at(flicker.ALBEDO, flicker.WHITE)
    frames = partial(flicker._fade, partial(flicker._domemaster, 40), scene, "grey", 24)
    return flicker.Film(frames, scene)


def test_a_lift_in_steps_is_a_jump(fading, monkeypatch):
    honest = dome._darkest
    assert max(flicker.fade(fading).jumps) < flicker.JUMP
    monkeypatch.setattr(dome, "_darkest", lambda *of: np.ceil(honest(*of) / 0.01) * 0.01)
    assert max(flicker.fade(fading).jumps) > flicker.JUMP


# Films


def test_a_disc_moves_before_both_eyes():
    """Its centre is where it is told to be, between the places of both eyes; 2 % before it."""
    frames = list(
        films.moving_disc(np.zeros((2, 90, 160, 3), np.float32), (0.2, 0.2), (0.6, 0.3), 3)
    )
    cols = np.arange(160) + 0.5
    for frame, x in zip(frames, (0.2, 0.4, 0.6), strict=True):
        left, right = (float(np.average(cols, weights=eye.sum((0, 2)))) / 160 for eye in frame)
        assert (left + right) / 2 == pytest.approx(x, abs=1e-3)
        assert left - right == pytest.approx(films.DISPARITY, abs=1e-3)
        assert frame.max() == 1
        area = float(frame[0, ..., 0].sum()) / 160**2
        assert area == pytest.approx(np.pi * films.RADIUS**2, rel=0.02)


def test_a_jump_is_told_over_the_slope_around():
    levels = np.linspace(0, 2, 21)
    levels[12:] += 0.1  # twice the step of 0.1
    found = flicker.jumps(levels)
    assert found.argmax() == 11
    assert found.max() == pytest.approx(2)
    assert np.median(found) == pytest.approx(1)


def test_a_bend_is_no_slope():
    assert flicker.bend([0.0, 1.0, 2.0, 3.0]) == 0
    assert flicker.bend([0.0, 1.0, 3.0, 4.0]) == 1


# Measures
