"""The sky in a comparison: of the master and of each method, in the page's table and in a line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from stored_masters import store

from compensate.page.comparison import Comparison, compare_methods, faintest_of
from domesim.frames import read_master
from domesim.scene import load_scene
from testing.content import charts


def compared(folder: Path, scene: str, *pictures: np.ndarray) -> Comparison:
    paths = [store(folder / f"{k}.exr", picture, "float") for k, picture in enumerate(pictures)]
    return compare_methods(read_master(paths), load_scene(scene), solver=None, weighting=None)


def test_a_dome_s_stars_fall_from_the_master_s(tmp_path: Path) -> None:
    found = compared(tmp_path, "dome_planetarium", charts.CHARTS["ten stars"](256)[0])
    rows = {row.name: row for row in found._table()}
    told = found.stars()
    assert told is not None
    master = faintest_of(found.appraisal.of_master)
    assert master is not None
    for method, outcome in found.outcomes.items():
        faintest = faintest_of(outcome.figures)
        assert faintest is not None
        assert faintest.crumey < master.crumey - 0.5
        factor = 10 ** (0.4 * (master.crumey - faintest.crumey))
        line = rf"{method} {faintest.told}, where it has ([0-9.]+) times the light"
        (said,) = re.findall(line, told)
        assert float(said) == pytest.approx(factor, rel=0.06)
    assert list(rows["Faintest star"].values) == list(rows["Sky"].values)
    assert len(rows["Sky"].values) == 1 + len(found.outcomes)
    assert rows["Faintest star"].values["Master"] == master.told
    skies = {name: float(text) for name, text in rows["Sky"].values.items()}
    assert skies["Seen, untouched"] < skies["Master"]
    assert skies["Seen, subtractive"] >= skies["Seen, untouched"]
