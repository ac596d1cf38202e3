"""Cores that this process may use."""

from __future__ import annotations

import contextlib
import math
import os
from functools import cache
from pathlib import Path

_GROUPS = Path("/sys/fs/cgroup")


@cache
def cores() -> int:
    """By this process's affinity and its control group, such as a container."""
    affinity = getattr(os, "sched_getaffinity", None)
    count = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    return math.ceil(min(count, _quota(_GROUPS / _own_group()), _quota(_GROUPS)))


def _own_group() -> str:
    """Path of this process's control group of version 2, below the root of all."""
    with contextlib.suppress(OSError):
        return Path("/proc/self/cgroup").read_text().strip().split(":")[-1].strip("/")
    return ""


def _quota(groups: Path) -> float:
    """Cores that a control group may take, of version 2 or 1; inf for all."""
    with contextlib.suppress(OSError, ValueError):  # "max 100000"
        quota, period = map(int, (groups / "cpu.max").read_text().split())
        return quota / period
    for name in ("cpu,cpuacct", "cpuacct,cpu"):
        with contextlib.suppress(OSError, ValueError):
            quota, period = (
                int((groups / name / f"cpu.cfs_{kind}_us").read_text())
                for kind in ("quota", "period")
            )
            return quota / period if quota > 0 else math.inf  # -1: all
    return math.inf
