"""Whole commands from file to file, in multiples of a copy, and of one FFT pair of a plane.

A copy of the same files by `oiiotool` (`validation.benchmarks.copying`) is the least that reading
and writing takes: its core-seconds are taken before, between and after runs.

A pair is a forward and an inverse `scipy.fft` of one float32 plane on all cores, timed before and
after each command, for a machine's speed changes by a half within a minute: what one transform of
the picture would take at least. Pictures are a night with lamps in a
dome, and a street at night with a sky in 3D: dark foregrounds, bright places. `compensate` itself,
called from Python, is timed on that street and on the photographed pairs of the test data.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import TypeVar, final

import numpy as np
import scipy.fft

from compensate import compensate
from domesim.frames import ColourTag, Frame, write_frame
from domesim.host.cores import cores
from domesim.host.writing import write_whole
from domesim.light import Light
from domesim.light.transfer import SRGB
from domesim.scene import Scene, load_scene
from testing.content.street import night_street
from testing.masters import night, write_exr
from validation.benchmarks.commands import Job, run_command
from validation.benchmarks.copying import copied
from validation.data import from_data, present

NAME = "files.json"
"""Name of the file of figures."""

T = TypeVar("T")

DOME, PAIR = "dome_imax", "stereo_polarised_paper"
PHOTOGRAPHS = ("trunks", "fog", "motorcycle")
"""Pairs of the test data that are called."""
RUNS = 5
SHORT, LONG = 4, 24
"""Frames of two sequences: what the longer one takes more is of further frames."""
HEADER = f"{'work':<34}{'seconds':>9}{'pairs':>7}{'core-s':>8}{'copies':>8}{'MiB':>7}{'unit, s':>9}"


@final
@dataclass(frozen=True)
class FileCost:
    """What a command took, medians of some runs.

    Parameters
    ----------
    work
        What it did.
    seconds, cpu_s, gib
        Time, core-seconds and peak memory of the whole process; for a further frame of a sequence,
        without the start, and the memory of all. A call from Python has no memory of its own.
    unit
        Seconds of one FFT pair, median.
    copy_cpu_s
        Core-seconds of a copy of the same files, median; None of calls from Python.
    busy
        Share of all cores that was busy; None of single frames.
    """

    work: str
    seconds: float
    cpu_s: float
    gib: float | None
    unit: float
    copy_cpu_s: float | None = None
    busy: float | None = None

    @property
    def copies(self) -> float | None:
        """Copies of the same files that take as many core-seconds."""
        return None if self.copy_cpu_s is None else self.cpu_s / self.copy_cpu_s

    @property
    def pairs(self) -> float:
        """FFT pairs that take as long."""
        return self.seconds / self.unit


def line(cost: FileCost) -> str:
    """What was measured, under `HEADER`."""
    mib = "" if cost.gib is None else f"{1024 * cost.gib:.0f}"
    copies = "" if cost.copies is None else f"{cost.copies:.2f}"
    figures = f"{cost.seconds:>9.2f}{cost.pairs:>7.0f}{cost.cpu_s:>8.2f}{copies:>8}{mib:>7}"
    busy = "" if cost.busy is None else f"  {cost.busy:.0%} of {cores()} cores busy"
    return f"{cost.work:<34}{figures}{cost.unit:>9.4f}{busy}"


def file_costs(*, quick: bool = False) -> Iterator[FileCost]:
    """Single frames and further frames of sequences; `quick` ones are of a quarter of the side."""
    small = 4 if quick else 1
    runs = 1 if quick else RUNS
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for side, suffix in ((2048 // small, "png"), (4096 // small, "exr")):
            files = _stored(folder, "dome", night(side, 0), suffix)
            work = f"dome {side}², {suffix.upper()}"
            yield _alone(work, files, folder, (side, side), runs)
            yield _further(work, files, folder, (side, side))
        side = 8192 // small
        files = _stored(folder, "large", night(side, 0), "exr")
        yield _alone(f"dome {side}², EXR", files, folder, (side, side), runs)
        cols, rows = 1920 // small, 1080 // small
        pair = night_street(cols)[:, :rows]
        for suffix in ("png", "exr", "dpx"):
            files = _stored(folder, "pair", pair, suffix)
            work = f"pair {cols} x {rows}, {suffix.upper()}"
            yield _alone(work, files, folder, (rows, cols), runs)
            yield _further(work, files, folder, (rows, cols))
    scene = load_scene(PAIR)
    photographs, _ = present(() if quick else PHOTOGRAPHS)
    masters = {"night street": pair, **{name: from_data(name, scene)[0] for name in photographs}}
    for name, light in masters.items():
        yield _called(name, light, scene, runs)


def fft_pair(rows: int, cols: int) -> float:
    """Seconds of a forward and an inverse transform of one float32 plane, on all cores."""
    plane = np.random.default_rng(0).random((rows, cols), np.float32)

    def once() -> float:
        began = time.perf_counter()
        scipy.fft.irfft2(scipy.fft.rfft2(plane, workers=cores()), s=plane.shape, workers=cores())
        return time.perf_counter() - began

    return median(once() for _ in range(9))


def write(folder: Path, found: Sequence[FileCost]) -> Path:
    """Write them into a folder; the path of the file."""
    path = folder / NAME
    told = [{**asdict(each), "pairs": each.pairs, "copies": each.copies} for each in found]
    write_whole(path, json.dumps({"cores": cores(), "costs": told}, indent=1).encode())
    return path


def _stored(folder: Path, name: str, light: Light, suffix: str) -> list[Path]:
    """The first frame of a sequence of links to it, by view."""
    firsts = []
    for view, picture in zip("lr", light, strict=False):
        first = folder / f"{name}-{view}-{suffix}.0001.{suffix}"
        if suffix == "exr":
            write_exr(first, picture)
        else:
            colour = ColourTag("srgb", "BT.709", "made so")
            codes = SRGB().encode(picture).astype(np.float32)
            bits = 10 if suffix == "dpx" else 16
            write_frame(Frame(codes, first, colour, bits, floating=False), first)
        for number in range(2, LONG + 1):
            link = folder / first.name.replace("0001", f"{number:04}")
            if not link.exists():
                link.hardlink_to(first)
        firsts.append(first)
    return firsts


def _called(name: str, light: Light, scene: Scene, runs: int) -> FileCost:
    compensate(light, scene)  # what later calls share
    rows, cols = light.shape[1:3]

    def called() -> tuple[float, float]:
        began, busy = time.perf_counter(), time.process_time()
        compensate(light, scene)
        return time.perf_counter() - began, time.process_time() - busy

    took, unit, _ = _beside([called] * runs, (rows, cols), (), Path())
    seconds, cpu_s = (median(each) for each in zip(*took, strict=True))
    return FileCost(f"{name} {cols} x {rows}, Python", seconds, cpu_s, None, unit)


def _beside(
    works: Sequence[Callable[[], T]], shape: tuple[int, int], files: Sequence[Path], folder: Path
) -> tuple[list[T], float, float]:
    """What works give; medians of FFT pairs' seconds, and of copies' core-seconds, around them."""
    found: list[T] = []
    units, copies = [], []
    for work in (None, *works):
        if work is not None:
            found.append(work())
        units.append(fft_pair(*shape))
        copies.append(copied(files, 1, folder)[1])
    return found, median(units), median(copies)


def _command(files: list[Path], folder: Path, *options: str) -> Job:
    named = [str(files[0])]
    if len(files) > 1:
        named = ["--left", str(files[0]), "--right", str(files[1])]
    scene = PAIR if len(files) > 1 else DOME
    where = ("--scene", scene, "--out", str(folder / "out"), "--anew", "--mix", "--json")
    return run_command("compensate", *named, *where, *options)


def _alone(
    work: str, files: list[Path], folder: Path, shape: tuple[int, int], runs: int
) -> FileCost:
    jobs, unit, copy = _beside([partial(_command, files, folder)] * runs, shape, files, folder)
    seconds, cpu_s, gib = (
        median(getattr(job, name) for job in jobs) for name in ("seconds", "cpu_s", "gib")
    )
    return FileCost(work, seconds, cpu_s, gib, unit, copy)


def _further(work: str, files: list[Path], folder: Path, shape: tuple[int, int]) -> FileCost:
    patterns = [path.with_name(path.name.replace("0001", "####")) for path in files]
    (short, long), unit, copy = _beside(
        [
            partial(_command, patterns, folder, "--frames", f"1-{count}", "--pages", "0")
            for count in (SHORT, LONG)
        ],
        shape,
        files,
        folder,
    )
    more = LONG - SHORT
    seconds, cpu_s = (long.seconds - short.seconds) / more, (long.cpu_s - short.cpu_s) / more
    busy = cpu_s / (seconds * cores())
    return FileCost(f"{work}, a further one", seconds, cpu_s, long.gib, unit, copy, busy)
