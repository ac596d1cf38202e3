"""Numbers as people read them."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import pytest

from domesim.host.numbers import decimal, percent, ratio


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (6071.3, "6070"),
        (123456789, "123000000"),
        (0.0012, "0.0012"),
        (1.234e-7, "0.000000123"),
        (15.96, "16"),
        (-0.5, "-0.5"),
        (0.0, "0"),
        (math.inf, "inf"),
    ],
)
def test_no_number_has_an_exponent(value, told):
    assert decimal(value) == told


def test_digits_are_significant_ones():
    assert decimal(0.0123456, 2) == "0.012"
    assert percent(0.000391) == "0.039%"


def test_a_ratio_may_be_infinite():
    assert ratio(6071.3) == "6070 : 1"
    assert ratio(558.24, 4) == "558.2 : 1"
    assert ratio(None) == ratio(math.inf) == "infinite"


@pytest.mark.parametrize("package", ["domesim", "compensate"])
def test_no_message_asks_for_an_exponent(package):
    files = sorted((Path(__file__).parents[3] / package).rglob("*.py"))
    assert files
    assert [f"{path.name}:{line}" for path in files for line in exponents(path.read_text())] == []


def test_an_exponent_in_a_message_is_noticed():
    assert exponents('a = f"within {gap:.1e} of it"\nb = f"{gap:.1%}, {name}"\n') == [1]


def exponents(source):
    """Lines of f-strings whose format makes an exponent."""
    return [
        node.lineno
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FormattedValue) and node.format_spec is not None
        if ast.unparse(node.format_spec).strip("f'\"").endswith("e")
    ]
