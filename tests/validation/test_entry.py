"""A method of one's own is measured as the project's are."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from compensate import compensate
from validation import readme
from validation.entry import HEADINGS, enter
from validation.experiments.quality.measuring import DEFAULT, SUBTRACTION
from validation.readme import ENTRIES
from validation.results import PUBLISHED, Results


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


def test_an_entry_is_lines_of_the_leaderboard(entered):
    lines = list(csv.DictReader([",".join(HEADINGS), *entered.entry("me, here").splitlines()]))
    assert [line["kind"] for line in lines] == ["pairs", "domemasters"]
    for line in lines:
        assert (line["method"], line["by"]) == ("gamma", "me, here")
        assert int(line["cases"]) > 0
        assert not line["ColorVideoVDP"]  # of a quick run there are none
    head = ENTRIES.read_text(encoding="utf-8").splitlines()[0]
    assert head == ",".join(HEADINGS)


def test_the_leaderboard_shows_methods_of_others(tmp_path, monkeypatch):
    others = tmp_path / "leaderboard.csv"
    told = dict.fromkeys(HEADINGS, "") | {"kind": "domemasters", "method": "moon", "by": "her"}
    told["ColorVideoVDP"] = "9.1234"
    others.write_text(f"{','.join(HEADINGS)}\n{','.join(told.values())}\n")
    monkeypatch.setattr(readme, "ENTRIES", others)
    page = readme.written("docs/leaderboard.md", Results.read(PUBLISHED))
    assert "\n| moon | her | 9.12 | – |" in page
    assert "\n| nothing done | this project | 9" in page
