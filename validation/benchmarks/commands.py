"""Whole commands, in a process of their own: time and peak memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from typing import Any, final

_WRAPPER = """
import resource, subprocess, sys, time
started = time.perf_counter()
done = subprocess.run([sys.executable, "-m", "domesim", *sys.argv[1:]])
seconds = time.perf_counter() - started
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print("\\n", used.ru_maxrss, used.ru_utime + used.ru_stime, seconds)
sys.exit(done.returncode)
"""
"""A small process in between: what a process begins in counts as its memory."""
_COMPILES_ANEW = "PYTHONDONTWRITEBYTECODE"
"""A setting of Python's by which every start compiles our modules anew, for 0.2 s."""


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
    done = subprocess.run(
        [sys.executable, "-c", _WRAPPER, *arguments],
        check=False,
        capture_output=True,
        text=True,
        env={name: text for name, text in os.environ.items() if name != _COMPILES_ANEW},
    )
    if done.returncode:
        raise RuntimeError(f"domesim {' '.join(arguments)}: {done.stderr.strip()[-500:]}")
    printed, _, used = done.stdout.rstrip().rpartition("\n")
    peak, cpu_s, seconds = used.split()
    return Job(float(seconds), float(cpu_s), int(peak) / 2**20, json.loads(printed or "{}"))
