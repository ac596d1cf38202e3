"""What the experiment on costs computes. `make validate` runs the experiments themselves."""

from __future__ import annotations

import pytest

from validation.experiments.costs import Sequence, sequence


def test_what_a_sequence_takes_besides_its_files():
    # Of 4 frames 10 s and of 12 22 s: 1.5 s for each further one
    found = Sequence(seconds=10.0, longer=22.0, files=2.0)
    assert found.further == pytest.approx(1.5)
    # Four frames' files take 2 s, so that a frame's take half a second
    assert found.over_files == pytest.approx(3.0)


@pytest.mark.long
def test_a_sequence_is_timed():
    found = sequence(64, 0)
    assert found.files > 0
    assert found.seconds > 0
