"""The experiments' claims, at sizes that take seconds."""

from __future__ import annotations

from dataclasses import replace

import pytest

from domesim.frames import Master
from validation.experiment import Work, load_experiment
from validation.experiments import fig9_dome
from validation.experiments.costs import Sequence, sequences


@pytest.fixture
def _half_as_large(monkeypatch):
    """The bundled night, two by two pixels averaged; `make validate` takes it as it is."""
    (night,) = fig9_dome.bundled_night().frames
    halved = night.pixels.reshape(512, 2, 512, 2, 3).mean(axis=(1, 3))
    small = Master((replace(night, pixels=halved),))
    monkeypatch.setattr(fig9_dome, "bundled_night", lambda: small)


@pytest.mark.usefixtures("_half_as_large")
@pytest.mark.parametrize(
    "name",
    [
        "fig4_one_dimension",
        "fig9_dome",
        pytest.param("table1", marks=pytest.mark.long),
        "gamma_coded",
        "channels_alone",
        "chroma_floor",
    ],
)
def test_experiments_are_as_expected(name):
    """`convergence` and others are in test_mutations.py; `make validate` runs them all."""
    finding = load_experiment(name).run(Work(quick=True))
    assert [check for check in finding.checks if not check.passed] == []


def test_what_a_sequence_takes_besides_its_solver():
    # Of 4 frames 10 s and of 12 22 s: 1.5 s for each further one
    found = Sequence(seconds=10.0, longer=22.0, solver=4.0, files=2.0)
    assert found.further == pytest.approx(1.5)
    assert found.first_outside == pytest.approx(0.6)
    assert found.outside == pytest.approx(1 - 12 / 22)
    assert found.further_outside == pytest.approx(1 - 1 / 1.5)
    # Work on other frames, beside the solver, may slow it down more than it waits
    assert replace(found, solver=12.0).first_outside == pytest.approx(-0.2)
    assert found.over_files == pytest.approx(5.0)
    # Four frames' files take 2 s, so that a frame's take half a second
    assert found.further_over_files == pytest.approx(3.0)


@pytest.mark.long
def test_only_a_sequence_that_clips_needs_the_solver():
    clipping, plain = sequences(64, 0)
    assert clipping.solver > 100 * plain.solver
    assert min(clipping.files, plain.files) > 0
    assert max(clipping.outside, plain.outside) <= 1
