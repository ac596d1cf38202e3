"""Each of these mistakes in the program turns an experiment red."""

from __future__ import annotations

import numpy as np
import pytest

import compensate.vision.csf
import domesim.observation.spherical
from domesim.light import namespace
from domesim.observation.lowrank import LowRankObservation, _project
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


def csf_constant(monkeypatch):
    """Daly's P 5 % too high."""
    peak = compensate.vision.csf.PEAK_SENSITIVITY
    monkeypatch.setattr(compensate.vision.csf, "PEAK_SENSITIVITY", 1.05 * peak)


def csf_frequency(monkeypatch):
    """Daly's frequencies 5 % too high: another of its constants."""
    honest = compensate.vision.csf._band
    monkeypatch.setattr(
        compensate.vision.csf, "_band", lambda rho, level, size: honest(1.05 * rho, level, size)
    )


def adjoint_without_area(monkeypatch):
    """The adjoint gives each pixel the mean area instead of its own."""

    def adjoint(self, light):
        f = self.factors_like(light)
        xp = namespace(light)
        sums = _project(f.spread, light)
        turned = xp.permute_dims(f.core, (0, 2, 1))
        even = xp.mean(f.collect, axis=(1, 2), keepdims=True) * xp.ones_like(f.collect)
        return self._spread(light, sums, turned, even)

    monkeypatch.setattr(LowRankObservation, "_adjoint", adjoint)


MUTATIONS = [
    ("eq15", wrong_gain),
    ("eq15", image_area),
    ("contrast_sensitivity", csf_constant),
    ("contrast_sensitivity", csf_frequency),
    ("convergence", adjoint_without_area),
]


@pytest.mark.parametrize(("experiment", "mutate"), MUTATIONS)
def test_mutations_turn_an_experiment_red(experiment, mutate, monkeypatch):
    mutate(monkeypatch)
    finding = load_experiment(experiment).run(Work(quick=True))
    assert not finding.passed


@pytest.mark.parametrize(
    "experiment",
    ["eq15", "contrast_sensitivity"],
)
def test_without_them_it_is_green(experiment):
    finding = load_experiment(experiment).run(Work(quick=True))
    assert [check for check in finding.checks if not check.passed] == []
