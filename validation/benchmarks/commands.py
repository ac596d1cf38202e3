"""Whole commands, in a process of their own: time and peak memory."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any, final

_WRAPPER = """
import resource, subprocess, sys
done = subprocess.run([sys.executable, "-m", "domesim", *sys.argv[1:]])
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print("\\n", used.ru_maxrss, used.ru_utime + used.ru_stime)
sys.exit(done.returncode)
"""


@final
@dataclass(frozen=True)
class Job:
    """What one command cost.

    Attributes
    ----------
    seconds, cpu_s
        Wall-clock and CPU time, s.
    gib
        Peak memory, GiB.
    figures
        What it printed with --json; empty if nothing.
    """

    seconds: float
    cpu_s: float
    gib: float
    figures: dict[str, Any]


def run_command(*arguments: str) -> Job:
    """Run ``domesim`` with those arguments and measure it.

    Raises
    ------
    RuntimeError
        If it fails; with its last words.
    """
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", _WRAPPER, *arguments], check=False, capture_output=True, text=True
    )
    seconds = time.perf_counter() - started
    if done.returncode:
        raise RuntimeError(f"domesim {' '.join(arguments)}: {done.stderr.strip()[-500:]}")
    printed, _, used = done.stdout.rstrip().rpartition("\n")
    peak, cpu_s = used.split()
    return Job(seconds, float(cpu_s), int(peak) / 2**20, json.loads(printed or "{}"))
