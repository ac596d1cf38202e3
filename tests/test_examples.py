"""The programs of docs/examples run, and say what their docstrings promise."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

FOLDER = Path(__file__).parents[1] / "docs" / "examples"
SAYS = {
    "compare_solvers": r"ADMM +\S+ +\d+ +\S+  \d\.\de-",
    "ellipsoid": r"^Computed directly: the master, lifted(.|\n)*^above: 0\.0\d+ of white",
    "own_method": r"^\| brightened \| \d",
    "own_observation": r"^Accelerated, as .* got LinearObservation\n(.|\n)*requested accuracy",
    "own_weighting": r"^Accelerated, as .* got LinearWeighting\n(.|\n)*requested accuracy",
    "two_albedos": r"^Computed directly: the master, lifted(.|\n)*^old half: 0\.0\d+ of white",
    "paper_table1": r"48 GPCG, frozen pollution",
    "which_setting": r"^night .*\n(.|\n)*^space ",
}


@pytest.fixture(autouse=True)
def _unseen(monkeypatch):
    """Figures are drawn, and shown to nobody."""

    def draw():
        plt.gcf().canvas.draw()

    monkeypatch.setattr(plt, "show", draw)
    yield
    assert plt.get_fignums()
    plt.close("all")


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_an_example(path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [str(path), "48"])
    runpy.run_path(str(path), run_name="__main__")
    assert re.search(SAYS[path.stem], capsys.readouterr().out, re.MULTILINE)


@pytest.mark.parametrize(("name", "places"), [("two_albedos", 2), ("ellipsoid", 3)])
def test_mitsuba_finds_the_light_that_is_added(name, places, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["", "192"])
    runpy.run_path(str(FOLDER / f"{name}.py"))
    said = re.findall(r": (\S+) of white, traced (\S+)", capsys.readouterr().out)
    assert len(said) == places
    for found, traced in said:
        assert float(found) == pytest.approx(float(traced), rel=0.02)


def test_errors_fall_where_they_count(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["", "48"])
    names = runpy.run_path(str(FOLDER / "own_weighting.py"))
    assert names["error"][:, 24:].mean() < names["error"][:, :24].mean()
    names = runpy.run_path(str(FOLDER / "own_observation.py"))
    assert names["result"].light.max() <= 1
