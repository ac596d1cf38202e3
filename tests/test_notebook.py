"""The notebook runs, and has each of the paper's equations: its formula, a call, a figure."""

from __future__ import annotations

import json
import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

NOTEBOOK = Path(__file__).parents[1] / "docs" / "notebooks" / "paper.ipynb"
CELLS = [
    (cell["cell_type"], "".join(cell["source"]))
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
]


def test_it_goes_equation_by_equation():
    heads = [text for kind, text in CELLS if kind == "markdown"][1:]
    numbers = [re.match(r"## Equation (\d+)\n\n\$\$.+\$\$\n", text) for text in heads]
    assert [int(found[1]) for found in numbers] == list(range(1, 16))
    assert [kind for kind, _ in CELLS] == ["markdown", "code"] * 16


def test_it_runs(monkeypatch, capsys):
    """The cells in order, each of which draws something."""
    drawn = []

    def draw():
        plt.gcf().canvas.draw()
        drawn.append(plt.gcf())

    monkeypatch.setattr(plt, "show", draw)
    names = {"__name__": "__main__"}
    for number, (kind, text) in enumerate(CELLS):
        if kind == "code":
            before = len(drawn)
            exec(compile(text, f"{NOTEBOOK.name}, cell {number}", "exec"), names)
            assert len(drawn) > before, text
    plt.close("all")
    said = capsys.readouterr().out
    residuals = re.search(r"left: (\S+), of doing nothing: (\S+)", said)
    assert float(residuals[1]) < float(residuals[2])
    costs = dict(re.findall(r"^(untouched|subtracted|perceptual) +(\S+)$", said, re.MULTILINE))
    assert float(costs["perceptual"]) < float(costs["subtracted"]) < float(costs["untouched"])
    energies = re.search(r"by the spectrum (\S+), by the picture (\S+)", said)
    assert float(energies[1]) == pytest.approx(float(energies[2]), rel=0.05)
    held, whole = re.search(r"pollution held (\S+), as it is (\S+)", said).groups()
    assert float(whole) <= float(held)
