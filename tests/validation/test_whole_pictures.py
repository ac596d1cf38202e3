"""Whole pictures: the experiment, with a judge of our own."""

from __future__ import annotations

import numpy as np
import pytest
from findings import failed

from validation import judges, pairs
from validation.experiment import Work
from validation.experiments import whole_pictures


@pytest.fixture(autouse=True)
def _judge(monkeypatch):
    """A judge that counts differences of the roots of light."""

    def quality(desired, seen, scene):
        roots = [np.sqrt(np.maximum(light, 0)) for light in (desired, seen)]
        return 10 - 20 * float(np.abs(roots[0] - roots[1]).mean())

    monkeypatch.setattr(judges, "colorvideovdp", quality)
    monkeypatch.setattr(whole_pictures, "QUICK_SIZE", 48)
    monkeypatch.setattr(whole_pictures, "SIZE", 32)


def test_every_way_is_judged_and_resumed(tmp_path):
    finding = whole_pictures.run(Work(store=tmp_path))
    assert whole_pictures.run(Work(store=tmp_path)) == finding
    (table,) = finding.tables
    assert [row[0] for row in table.rows] == ["generated (new)", "night", "generated dome (new)"]
    # A pair has no hue, and what is seen untouched is worse than what is subtracted
    assert table.rows[0][5:9] == (None,) * 4
    assert finding.figures["whole.generated (new).nothing.quality"] < 10
    assert table.rows[0][1] < table.rows[0][2]


def test_a_full_run_says_what_is_missing(monkeypatch, tmp_path):
    monkeypatch.setenv(pairs.FOLDER, str(tmp_path))
    finding = whole_pictures.run(Work(quick=False))
    assert any("trunks" in why and pairs.FOLDER in why for why in finding.left_out)
    assert any("pillars" in why for why in finding.left_out)
    assert any(check.what.startswith("shortfall") for check in finding.checks)


def test_doing_nothing_turns_it_red(monkeypatch):
    ways = dict(whole_pictures.WAYS)
    ways[whole_pictures.OURS] = ways["nothing"]
    monkeypatch.setattr(whole_pictures, "WAYS", ways)
    assert failed(whole_pictures.run(Work()))
