"""A room measured without geometry: what the experiment's quick run says."""

from __future__ import annotations

import pytest

from validation.experiment import Work, load_experiment


@pytest.mark.long
def test_it_is_as_expected():
    finding = load_experiment("measured_transport").run(Work(quick=True))
    assert [check for check in finding.checks if not check.passed] == []
