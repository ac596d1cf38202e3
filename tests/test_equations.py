"""Equations of the paper are found by a search for "# eq. N", in one line of one function."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LINES = {
    1: ("compensate/subtract.py", "subtracted"),
    2: ("domesim/observation/lowrank.py", "work"),
    3: ("compensate/problem.py", "cost"),
    4: ("compensate/weighting.py", "_apply"),
    5: ("compensate/weighting.py", "energy"),
    6: ("compensate/weighting.py", "_weighted_spectrum"),
    7: ("compensate/weighting.py", "_apply"),
    8: ("domesim/observation/crosstalk.py", "leaked"),
    9: ("domesim/observation/frozen.py", "_observe"),
    10: ("compensate/prediction.py", "_looks"),
    11: ("compensate/vision/masking.py", "add"),
    12: ("compensate/prediction.py", "predicts"),
    13: ("compensate/prediction.py", "predicts"),
    14: ("compensate/prediction.py", "_saliency"),
    15: ("domesim/observation/spherical.py", "closed_form_gain"),
}


def function_at(source: str, line: int) -> str:
    """The innermost named function round a line."""
    around = [
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef) and node.lineno <= line <= (node.end_lineno or 0)
    ]
    return max(around, key=lambda node: node.lineno).name


@pytest.mark.parametrize("number", LINES)
def test_one_line_implements_an_equation(number: int) -> None:
    found = [
        (str(path.relative_to(ROOT)), function_at(source, source[: match.start()].count("\n") + 1))
        for package in ("domesim", "compensate")
        for path in sorted((ROOT / package).rglob("*.py"))
        for source in (path.read_text(),)
        for match in re.finditer(rf"\S.*  # eq\. {number}$", source, re.MULTILINE)
    ]
    assert found == [LINES[number]]
