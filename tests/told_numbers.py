"""What a program says, compared number by number: a last digit may differ by one.

Last digits rest on how a processor rounds, as of figures that were fitted.
"""

from __future__ import annotations

import re
from decimal import Decimal

_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_COUNT = 1000
"""Whole numbers below it count something, and are the same."""


def assert_same_but_for_last_digits(told: str, wanted: str) -> None:
    """Words, signs and counts are the same; other numbers differ by one unit of the last digit.

    The unit is that of the number with more decimals: 3 for 2.99 is told by 3 digits, too.
    """
    assert _NUMBER.sub("#", told) == _NUMBER.sub("#", wanted)
    for one, other in zip(_NUMBER.findall(told), _NUMBER.findall(wanted), strict=True):
        a, b = Decimal(one), Decimal(other)
        unit = Decimal(1).scaleb(min(a.as_tuple().exponent, b.as_tuple().exponent))
        counted = unit == 1 and min(a, b) < _COUNT
        assert abs(a - b) <= (0 if counted else unit), f"told {one}, wanted {other}, of: {told}"
