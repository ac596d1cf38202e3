"""Docstrings name the thing before they say what is special about it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def fragments(text: str) -> Iterator[tuple[int, str]]:
    """Line and first words of each docstring, also of constants, that begins with "Of"."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            value = node.value.value
            if isinstance(value, str) and value.split()[:1] == ["Of"]:
                yield node.lineno, " ".join(value.split()[:6])


@pytest.mark.parametrize("package", ["domesim", "compensate", "testing", "validation", "scenes"])
def test_no_docstring_begins_with_of(package):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    found = [
        f"{path.relative_to(ROOT)}:{line}: {words}"
        for path in files
        for line, words in fragments(path.read_text(encoding="utf-8"))
    ]
    assert found == []


def test_a_fragment_is_found():
    text = 'WIDTH = 2\n"""Of a crop."""\n\n\ndef area():\n    """Of both."""\n'
    assert list(fragments(text)) == [(2, "Of a crop."), (6, "Of both.")]
