"""Work on pixels alone, strip by strip of rows: each fits a core's cache, and all cores share them.

A pass over a whole 2K pair costs more for bringing 50 MB from memory and back than for computing.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from domesim.host.cores import cores

T = TypeVar("T")

SAMPLES = 600_000
"""Samples of a strip. Of fewer, threads spend their time on handing over Python's lock."""
_NAME = "domesim-strips"  # of threads


def in_strips(work: Callable[[int, slice], T], shape: tuple[int, ...]) -> list[T]:
    """Calls `work(view, rows)` for strips of rows that together cover (view, row, col, primary).

    All strips share one set of threads, each of which takes the next strip as it has done one.

    Returns
    -------
    What it returned for each. The error that it raised for the first strip of all is raised.
    """
    views, rows = shape[:2]
    samples = 1
    for side in shape[2:]:
        samples *= side
    step = max(1, SAMPLES // max(samples, 1))
    places = [
        (view, slice(row, min(row + step, rows)))
        for view in range(views)
        for row in range(0, rows, step)
    ]
    if len(places) == 1 or threading.current_thread().name.startswith(_NAME):
        return [work(*place) for place in places]
    results: dict[int, T] = {}
    errors: dict[int, BaseException] = {}
    next_ones = iter(range(len(places)))

    def take() -> None:
        for k in next_ones:
            if errors:
                return
            try:
                results[k] = work(*places[k])
            except BaseException as error:
                errors[k] = error

    for each in [_pool().submit(take) for _ in range(threads())]:
        each.result()
    if errors:
        raise errors[min(errors)]
    return [results[k] for k in range(len(places))]


def all_within(values: NDArray[Any], least: float, most: float) -> bool:
    """Whether all of (view, row, col, primary) `values` are numbers from `least` to `most`."""

    def work(view: int, rows: slice) -> bool:
        part = values[view, rows]
        return bool(part.min() >= least and part.max() <= most)

    return all(in_strips(work, values.shape))


def summed(plane: NDArray[Any]) -> float:
    """Sum of (row, col): of each row in its own precision, and of rows in double precision."""
    return float(plane.sum(axis=-1).sum(dtype=np.float64))


def product(plane: NDArray[Any], other: NDArray[Any]) -> float:
    """Sum of the products of two planes (row, col), as `summed`.

    Not by BLAS, whose order of summation differs from processor to processor.
    """
    return float(np.einsum("rc,rc->r", plane, other).sum(dtype=np.float64))


def converted(picture: NDArray[Any], kind: np.dtype[Any]) -> NDArray[Any]:
    """Converts (row, col, ...) to another type by all threads: NumPy's half is slow."""
    if picture.dtype == kind:
        return picture
    result = np.empty(picture.shape, kind)

    def convert(_: int, rows: slice) -> None:
        result[rows] = picture[rows]

    in_strips(convert, (1, *picture.shape))
    return result


def in_parts(work: Callable[[int, slice], T], shape: tuple[int, ...], computes: object) -> list[T]:
    """`in_strips` where `computes`, an array, is NumPy's; else `work` of all rows of each view."""
    if isinstance(computes, np.ndarray):
        return in_strips(work, shape)
    return [work(view, slice(0, shape[1])) for view in range(shape[0])]


def threads() -> int:
    """Number of threads to use: ``OMP_NUM_THREADS`` or the number of cores, if that is less."""
    wanted = os.environ.get("OMP_NUM_THREADS", "")
    return min(int(wanted), cores()) if wanted.isdecimal() and int(wanted) else cores()


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads(), _NAME)
