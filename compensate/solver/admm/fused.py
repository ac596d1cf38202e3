"""The solver's inner loops, where they are compiled (`compensate.compiled`)."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from compensate.compiled import compiles
from domesim.light import Array

_WORTH = 1 << 16
"""Samples of a plane from which on a compiled loop pays: to wake its threads takes milliseconds."""


def loops(*planes: Array) -> Any:
    """The module `loops` if Numba is there and a compiled loop pays for these planes; else None."""
    pays = all(isinstance(plane, np.ndarray) and plane.size >= _WORTH for plane in planes)
    return _compiled() if pays else None


def parts(spectra: Sequence[Array]) -> tuple[Array, ...]:
    """Spectra as the compiled loops take them: real and imaginary parts by turns."""
    return tuple(plane.view(plane.real.dtype) for plane in spectra)


def parts_or_zero(plus: Sequence[Array] | None, spectra: Sequence[Array]) -> tuple[Array, ...]:
    """`parts` of `plus`; if it is None, zeros like `spectra`, which take no memory."""
    if plus is not None:
        return parts(plus)
    (first, *_) = parts(spectra)
    return (np.broadcast_to(first.dtype.type(0), first.shape),) * len(spectra)


@cache
def _compiled() -> Any:
    if not compiles():
        return None
    try:
        return importlib.import_module("compensate.solver.admm.loops")
    except ImportError:
        return None
