"""Array libraries beside NumPy, as parameters of tests."""

from __future__ import annotations

from typing import Any

import array_api_strict
import numpy as np
import pytest


def torch(array: Any) -> Any:
    """A tensor of the same numbers."""
    return pytest.importorskip("torch").tensor(np.asarray(array))


OTHERS = [
    pytest.param(array_api_strict.asarray, id="array_api_strict"),
    pytest.param(torch, id="torch"),
]
LIBRARIES = [pytest.param(np.asarray, id="numpy"), *OTHERS]
PRECISE = [
    pytest.param(np.float32, np.asarray, id="numpy-float32"),
    pytest.param(np.float64, np.asarray, id="numpy-float64"),
    pytest.param(np.float64, array_api_strict.asarray, id="array_api_strict-float64"),
    pytest.param(np.float32, torch, id="torch-float32"),
]
"""A precision and a library; of others than NumPy one each."""
