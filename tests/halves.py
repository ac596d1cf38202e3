"""Processor's time of a command that does a show, and of two that share it: ``python halves.py``.

Each command has one core, and no workers; starts are included. What the two take together, halved,
is the time of each where cores are equally free: who has the freer one does more frames.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from domesim.frames import ColourTag, Frame, write_frame

FRAMES, SIZE = 96, 384
SCENE = "dome_planetarium"


def seconds(masters: Path, out: Path, count: int) -> list[float]:
    """Of each of so many commands, s."""
    command = [sys.executable, "-m", "domesim", "compensate", str(masters), "--scene", SCENE]
    command += ["--out", str(out), "--workers", "0", "--threads", "1", "--quiet"]
    runs = []
    for core in sorted(os.sched_getaffinity(0))[:count]:
        run = subprocess.Popen(command)
        os.sched_setaffinity(run.pid, {core})
        runs.append(run)
    found = []
    for run in runs:
        _, status, used = os.wait4(run.pid, 0)
        assert status == 0
        found.append(used.ru_utime + used.ru_stime)
    return found


def main() -> None:
    noise, tag = np.random.default_rng(1), ColourTag("linear", "BT.709", "made up")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "in").mkdir()
        for number in range(1, FRAMES + 1):
            path = folder / f"in/a.{number:04d}.exr"
            pixels = noise.random((SIZE, SIZE, 3), np.float32)
            write_frame(Frame(pixels, path, tag, 16, floating=True), path)
        masters = folder / "in/a.####.exr"
        (one,), two = (seconds(masters, folder / f"out{n}", n) for n in (1, 2))
    half = sum(two) / 2
    print(
        f"one: {one:.1f} s; two: {two[0]:.1f} and {two[1]:.1f} s, halved {half / one:.2f} of one's"
    )


if __name__ == "__main__":
    main()
