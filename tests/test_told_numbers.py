"""The comparison of printed numbers, itself."""

from __future__ import annotations

import pytest
from told_numbers import assert_same_but_for_last_digits


@pytest.mark.parametrize(
    ("told", "wanted"),
    [
        ("5: 0.19%, taken: 8", "5: 0.18%, taken: 8"),
        ("B 2.97 (2.92 to 3)", "B 2.96 (2.92 to 2.99)"),
        ("chi² 37060", "chi² 37061"),
        ("1.2e-05", "1.3e-05"),
    ],
)
def test_last_digits_may_differ(told, wanted):
    assert_same_but_for_last_digits(told, wanted)


@pytest.mark.parametrize(
    ("told", "wanted"),
    [
        ("5: 0.20%", "5: 0.18%"),
        ("taken: 7", "taken: 8"),
        ("+0.1", "-0.1"),
        ("B 2.97", "G 2.97"),
        ("chi² 37060", "chi² 37062"),
        ("1.2e-05", "1.2e-06"),
        ("1, 2", "1"),
    ],
)
def test_all_else_is_the_same(told, wanted):
    with pytest.raises(AssertionError):
        assert_same_but_for_last_digits(told, wanted)
