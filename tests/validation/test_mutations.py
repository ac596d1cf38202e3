"""Each of these mistakes in the program turns an experiment red; `make validate` has it green."""

from __future__ import annotations

import numpy as np
import pytest

import domesim.observation.spherical
from domesim.observation.lowrank import LowRankObservation
from domesim.observation.spherical import ClosedFormDome
from validation.experiment import Work, load_experiment


def wrong_gain(monkeypatch):
    """The closed form 0.5 % too bright."""
    honest = domesim.observation.spherical.closed_form_gain
    monkeypatch.setattr(
        domesim.observation.spherical, "closed_form_gain", lambda *parts: 1.005 * honest(*parts)
    )


def image_area(monkeypatch):
    """The area of the image in place of the screen's, as the paper prints it."""
    honest = LowRankObservation._linear

    def linear(self, light):
        if not isinstance(self, ClosedFormDome):
            return honest(self, light)
        direct = self._direct(light)
        areas = self.factors.collect[0] / self.factors.direct_gain
        gain, screen = self.factors.core[0, 0, 0], areas.sum()
        lit = areas[np.any(np.asarray(light)[0] > 0, axis=-1)].sum()
        sphere_over_albedo = 1 / gain + screen
        wrong = 1 / (sphere_over_albedo - lit) / gain
        return direct + wrong * (honest(self, light) - direct)

    monkeypatch.setattr(LowRankObservation, "_linear", linear)


@pytest.mark.parametrize("mutate", [pytest.param(wrong_gain, marks=pytest.mark.long), image_area])
def test_mutations_turn_an_experiment_red(mutate, monkeypatch):
    mutate(monkeypatch)
    finding = load_experiment("closed_form").run(Work(quick=True))
    assert not finding.passed
