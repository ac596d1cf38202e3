"""A method of one's own is measured as the project's are."""

from __future__ import annotations

import numpy as np
import pytest

from compensate import compensate
from validation.entry import enter
from validation.experiments.quality.measuring import DEFAULT, SUBTRACTION


def gamma_on_subtraction(master, scene):
    """What subtraction would show, of a master whose dark tones are crushed."""
    return compensate(master**1.2, scene, method="subtractive").light


@pytest.fixture(scope="module")
def entered():
    return enter("gamma", gamma_on_subtraction, quick=True)


def test_a_toy_method_is_entered(entered):
    assert len(entered.tables) == 2
    for table in entered.tables:
        assert [row[0] for row in table.rows] == ["nothing", SUBTRACTION, DEFAULT, "gamma"]
    assert "| gamma | " in str(entered)
    assert "| way | cases | laws broken |" in str(entered)


def test_a_method_that_breaks_laws_is_told():
    """Black that is raised harms all places; what nobody broke stays so."""
    (table,) = enter(
        "grey", lambda master, _: np.maximum(master, 0.2), quick=True, only=["night"]
    ).tables
    broken = {row[0]: row[2] for row in table.rows}
    assert broken["grey"] > broken[DEFAULT] == 0


def test_the_projects_own_method_has_the_projects_figures():
    found = enter("ours", lambda master, scene: compensate(master, scene).light, quick=True)
    for each in found.tables:
        rows = {row[0]: row[1:] for row in each.rows}
        assert rows["ours"] == rows[DEFAULT]
