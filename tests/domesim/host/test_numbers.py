"""Numbers as people read them."""

from __future__ import annotations

import math

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
