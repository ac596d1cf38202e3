"""The experiments' claims, at sizes that take seconds."""

from __future__ import annotations

import pytest

from validation.experiment import Work, load_experiment
from validation.experiments.costs import Sequence, sequences


@pytest.mark.parametrize(
    "name",
    [
        "fig4_one_dimension",
        "fig9_dome",
        "table1",
        "gamma_coded",
        "channels_alone",
        "frozen_pollution",
        "chroma_floor",
    ],
)
def test_experiments_are_as_expected(name):
    """`convergence` and others are in test_mutations.py."""
    finding = load_experiment(name).run(Work(quick=True))
    assert [check for check in finding.checks if not check.passed] == []


def test_what_a_sequence_takes_besides_its_solver():
    assert Sequence(seconds=10.0, solver=7.0, files=4.0).outside == pytest.approx(0.3)
    assert Sequence(seconds=10.0, solver=12.0, files=4.0).outside == pytest.approx(-0.2)
    assert Sequence(seconds=10.0, solver=7.0, files=4.0).over_files == pytest.approx(2.5)


def test_only_a_sequence_that_clips_needs_the_solver():
    clipping, plain = sequences(64, 0)
    assert clipping.solver > 100 * plain.solver
    assert min(clipping.files, plain.files) > 0
    assert max(clipping.outside, plain.outside) <= 1
