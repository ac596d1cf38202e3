"""Memory: what this process may have, and what the C library does with what is freed."""

from __future__ import annotations

import contextlib
import ctypes
import math
from functools import cache
from pathlib import Path

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8  # of glibc's malloc.h

_GROUPS = Path("/sys/fs/cgroup")
_LIMITS = ("memory.max", "memory.high", "memory/memory.limit_in_bytes")  # of versions 2 and 1

KEPT = 250_000_000
"""Bytes: more than RGB light of 4096 x 4096 in float32, less than a plane of 8192 x 8192."""


@cache
def keep_freed_memory() -> None:
    """Tell the C library to keep freed arrays for the next ones, where it can be told (glibc).

    Else each large array is fetched from the system and zeroed anew, page by page: a fifth of the
    time of a solution. Arrays of more than `KEPT` bytes go back: with the gaps that they leave, a
    frame of 8192 x 8192 would take a third more memory. All threads share one heap: those that read
    and write would have heaps too small for large arrays, and keep none.
    """
    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.mallopt(_TRIM_THRESHOLD, 2**31 - 1)
        library.mallopt(_MMAP_THRESHOLD, KEPT)
        library.mallopt(_ARENA_MAX, 1)


def give_back_memory() -> None:
    """Give what was kept of freed memory back, where the C library can (glibc)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def limit_of_group() -> float:
    """Bytes that this process's control group, such as a container, may have; inf for all."""
    limit = math.inf
    for name in _LIMITS:
        with contextlib.suppress(OSError, ValueError):  # "max"
            limit = min(limit, int((_GROUPS / name).read_text()))
    return limit
