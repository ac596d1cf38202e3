"""Shows done by N workers, in multiples of N copies at once of the same frames by oiiotool.

A copy (``oiiotool IN -o OUT``) reads a frame and writes it as it is: the least that any program
takes that makes files of files. Copies are timed right before and right after the show, for a
machine's speed changes within minutes.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, final

import OpenImageIO as oiio  # noqa: N813 (its own documentation calls it so)

from domesim.errors import InputError
from domesim.host.cores import cores
from domesim.host.writing import write_whole
from testing.masters import night, write_exr
from validation.benchmarks.commands import run_command

NAME = "workers.json"
"""Name of the file of figures."""

SCENE = "dome_imax"
SIDE, QUICK_SIDE = 4096, 512
"""Pixels of a frame's side."""
FRAMES = 6
"""Frames for each worker; the first one waits for its start."""
OIIOTOOL = Path(oiio.__file__).with_name("bin") / "oiiotool"
"""The one of the package that domesim reads its files with."""
HEADER = f"{'workers':>7}{'frames':>8}{'s':>8}{'copies, s':>11}{'ratio':>7}{'core-s a frame':>16}"


@final
@dataclass(frozen=True)
class Compared:
    """A show, and copies of its frames.

    Parameters
    ----------
    workers, frames
        How many; as many copies as workers are made at once.
    seconds, cpu_s
        Wall-clock time and core-seconds of the whole command, with its start.
    copy_seconds, copy_cpu_s
        Those of copying all frames once, mean of before and after.
    """

    workers: int
    frames: int
    seconds: float
    cpu_s: float
    copy_seconds: float
    copy_cpu_s: float

    @property
    def ratio(self) -> float:
        """How many times as long as the copies the show takes."""
        return self.seconds / self.copy_seconds

    @property
    def busy(self) -> float:
        """Cores that the show kept busy."""
        return self.cpu_s / self.seconds

    def figures(self) -> dict[str, float]:
        """All of it, for JSON."""
        return {**asdict(self), "ratio": self.ratio, "busy": self.busy}


def line(found: Compared) -> str:
    """What was measured, under `HEADER`."""
    a_frame, a_copy = (cpu_s / found.frames for cpu_s in (found.cpu_s, found.copy_cpu_s))
    return (
        f"{found.workers:>7}{found.frames:>8}{found.seconds:>8.1f}{found.copy_seconds:>11.1f}"
        f"{found.ratio:>7.2f}{a_frame:>16.2f}  ({a_copy:.2f} a copy)"
        f"  {found.busy:.1f} of {cores()} cores busy"
    )


def comparisons(workers: Sequence[int], *, quick: bool = False) -> Iterator[Compared]:
    """One for each number of workers; `quick` ones are of small frames.

    Raises
    ------
    InputError
        If oiiotool is not there.
    """
    if not OIIOTOOL.exists():
        raise InputError(
            f"--workers compares with {OIIOTOOL}, which is not there; install the wheel of "
            f"OpenImageIO (pip install --force-reinstall openimageio)"
        )
    side = QUICK_SIDE if quick else SIDE
    with tempfile.TemporaryDirectory() as name:
        masters = _masters(Path(name), side, FRAMES * max(workers))
        for count in workers:
            yield _compared(masters[: FRAMES * count], count, Path(name))


def write(folder: Path, found: Sequence[Compared]) -> Path:
    """Write them into a folder; the path of the file."""
    path = folder / NAME
    told: dict[str, Any] = {"cores": cores(), "shows": [each.figures() for each in found]}
    write_whole(path, json.dumps(told, indent=1).encode())
    return path


def _masters(folder: Path, side: int, count: int) -> list[Path]:
    """A sequence of links to one frame."""
    paths = [folder / f"night.{number:04}.exr" for number in range(1, count + 1)]
    write_exr(paths[0], night(side)[0])
    for path in paths[1:]:
        path.hardlink_to(paths[0])
    return paths


def _compared(masters: Sequence[Path], workers: int, folder: Path) -> Compared:
    before = copied(masters, workers, folder)
    job = run_command(
        "compensate", str(folder / "night.####.exr"), "--scene", SCENE, "--out",
        str(folder / "out"), "--frames", f"1-{len(masters)}", "--workers", str(workers), "--anew",
        "--mix", "--pages", "0", "--json",
    )  # fmt: skip
    after = copied(masters, workers, folder)
    seconds, cpu_s = ((early + late) / 2 for early, late in zip(before, after, strict=True))
    return Compared(workers, len(masters), job.seconds, job.cpu_s, seconds, cpu_s)


def copied(masters: Sequence[Path], at_once: int, folder: Path) -> tuple[float, float]:
    """Copies masters.

    Parameters
    ----------
    masters
        Files.
    at_once
        How many copies are made at once.
    folder
        Where to.

    Returns
    -------
    seconds, cpu_s
        Time and core-seconds of all.
    """

    def copy(master: Path) -> None:
        _copy(master, folder / f"copy-{master.name}")

    busy, began = _of_children(), time.perf_counter()
    with ThreadPoolExecutor(at_once) as pool:
        list(pool.map(copy, masters))
    return time.perf_counter() - began, _of_children() - busy


def _copy(master: Path, copied: Path) -> None:
    subprocess.run([OIIOTOOL, master, "-o", copied], check=True)


def _of_children() -> float:
    """Core-seconds of all processes that this one has waited for."""
    used = os.times()
    return used.children_user + used.children_system
