"""What the experiment on costs computes. `make validate` runs the experiments themselves."""

from __future__ import annotations

from dataclasses import replace

import pytest

from validation.experiments.costs import Sequence, sequences


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
    assert clipping.solver > 10 * plain.solver
    assert min(clipping.files, plain.files) > 0
    assert max(clipping.outside, plain.outside) <= 1
