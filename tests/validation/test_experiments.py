"""The experiments' claims, at sizes that take seconds."""

from __future__ import annotations

import pytest

from validation.experiment import Work, load_experiment


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
