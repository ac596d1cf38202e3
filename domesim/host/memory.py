"""Memory of this process: its limit, and how the C library treats freed memory."""

from __future__ import annotations

import contextlib
import math
from functools import cache
from pathlib import Path

from domesim.host.system import set_allocator

_GROUPS = Path("/sys/fs/cgroup")
_LIMITS = ("memory.max", "memory.high", "memory/memory.limit_in_bytes")  # of versions 2 and 1

KEPT = 250_000_000
"""Bytes: more than RGB light of 4096 x 4096 in float32, less than a plane of 8192 x 8192."""


_KEEPING = {"TRIM_THRESHOLD_": (-1, 2**31 - 1), "MMAP_THRESHOLD_": (-3, KEPT), "ARENA_MAX": (-8, 1)}
# By the names that glibc has in the environment: numbers in its malloc.h, and values

KEEPS_FREED_MEMORY = {f"MALLOC_{name}": str(value) for name, (_, value) in _KEEPING.items()}
"""Environment of processes whose threads begin before they could call `keep_freed_memory`."""


@cache
def keep_freed_memory() -> None:
    """Makes the C library keep freed arrays for the next ones (glibc only).

    Else each large array is fetched from the system and zeroed anew, page by page: a fifth of the
    time of a solution. Arrays of more than `KEPT` bytes go back: with the gaps that they leave, a
    frame of 8192 x 8192 would take a third more memory. All threads share one heap: those that read
    and write would have heaps too small for large arrays, and keep none. So it is to be called
    before there are others.
    """
    set_allocator(dict(_KEEPING.values()))


def limit_of_group() -> float:
    """Bytes that this process's control group, such as a container, may have; inf for all."""
    limit = math.inf
    for name in _LIMITS:
        with contextlib.suppress(OSError, ValueError):  # "max"
            limit = min(limit, int((_GROUPS / name).read_text()))
    return limit
