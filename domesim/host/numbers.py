"""Numbers as people read them: a few digits, and never an exponent."""

from __future__ import annotations

import math
from decimal import Decimal


def decimal(value: float, digits: int = 3) -> str:
    """A number in so many significant digits: 6070 or 0.0012, where Python has 6.07e+03."""
    if not math.isfinite(value):
        return str(value)
    return f"{Decimal(f'{value:.{digits}g}'):f}"


def ratio(value: float | None, digits: int = 3) -> str:
    """A contrast: 6070 : 1; None is infinite."""
    return "infinite" if value is None or math.isinf(value) else f"{decimal(value, digits)} : 1"


def percent(share: float, digits: int = 2) -> str:
    """A share of which small ones count, in significant digits: 0.039%."""
    return f"{decimal(100 * share, digits)}%"
