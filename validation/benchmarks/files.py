"""Whole commands from file to file, beside copies of the same files.

A copy by `oiiotool` (`validation.benchmarks.copying`) is the least that reading and writing takes:
its core-seconds are taken before, between and after runs, for a machine's speed changes by a half
within a minute. So is the speed at which one core moves memory. Pictures are a night with lamps in
a dome, and a street at night with a sky in 3D: dark foregrounds, bright places. `compensate`
itself, called from Python, is timed on that street and on the photographed pairs of the test data.
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
from validation.benchmarks.passes import Pass, passes
from validation.data import from_data, present

NAME = "files.json"
"""Name of the file of figures."""

T = TypeVar("T")

DOME, PAIR = "dome_imax", "stereo_polarised_paper"
ACROSS, DOWN = 9, 5
"""Views of a quilt."""
OF_VIEWS = """
name = "45 views"
screen = {width_m = 0.6, height_m = 0.3333}
projector = {primaries = "BT.709", white_cd_m2 = 40.0, black_cd_m2 = 0.05}
crosstalk = {views = {count = 45, neighbours = [0.167, 0.03]}}
viewing = {distance_m = 1.0, adaptation_cd_m2 = 10.0}
"""
"""The scene that it is shown in: each view sees the two next ones on each side."""
PHOTOGRAPHS = ("trunks", "fog", "motorcycle")
"""Pairs of the test data that are called."""
RUNS = 5
SHORT, LONG = 2, 6
"""Frames of two sequences: what the longer one takes more is of further frames."""
HEADER = f"{'work':<34}{'seconds':>9}{'core-s':>8}{'a copy':>8}{'ratio':>7}{'MiB':>7}"


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
    copy_cpu_s
        Core-seconds of a copy of the same files, median; None of calls from Python.
    busy
        Share of all cores that was busy; None of single frames.
    """

    work: str
    seconds: float
    cpu_s: float
    gib: float | None
    copy_cpu_s: float | None = None
    busy: float | None = None

    @property
    def copies(self) -> float | None:
        """Copies of the same files that take as many core-seconds."""
        return None if self.copy_cpu_s is None else self.cpu_s / self.copy_cpu_s


def line(cost: FileCost) -> str:
    """What was measured, under `HEADER`."""
    mib = "" if cost.gib is None else f"{1024 * cost.gib:.0f}"
    copy = "" if cost.copy_cpu_s is None else f"{cost.copy_cpu_s:.2f}"
    ratio = "" if cost.copies is None else f"{cost.copies:.2f}"
    busy = "" if cost.busy is None else f"  {cost.busy:.0%} of {cores()} cores busy"
    figures = f"{cost.seconds:>9.2f}{cost.cpu_s:>8.2f}{copy:>8}{ratio:>7}{mib:>7}"
    return f"{cost.work:<34}{figures}{busy}"


def file_costs(*, quick: bool = False) -> Iterator[FileCost]:
    """Single frames and further frames of sequences; `quick` ones are of a quarter of the side."""
    small = 4 if quick else 1
    runs = 1 if quick else RUNS
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for side, suffix in ((2048 // small, "png"), (4096 // small, "exr")):
            files = _stored(folder, "dome", night(side, 0), suffix)
            work = f"dome {side}², {suffix.upper()}"
            yield _alone(work, files, folder, runs)
            yield _further(work, files, folder, runs)
        yield _alone(f"{work}, predicted", files, folder, runs, command="predict")
        side = 8192 // small
        large = night(side, 0).astype(np.float16)
        files = _stored(folder, "large", large, "exr")
        yield _alone(f"dome {side}², EXR", files, folder, runs)
        large = np.repeat(np.repeat(large, 2, 1), 2, 2)
        files = _stored(folder, "largest", large, "exr")
        del large
        yield _alone(f"dome {2 * side}², EXR, once", files, folder, 1)
        cols, rows = 1920 // small, 1080 // small
        pair = night_street(cols)[:, :rows]
        for suffix in ("png", "exr", "dpx"):
            files = _stored(folder, "pair", pair, suffix)
            work = f"pair {cols} x {rows}, {suffix.upper()}"
            yield _alone(work, files, folder, runs)
            yield _further(work, files, folder, runs)
        cols, rows = 819 // small, 455 // small
        files = _quilt(folder, night_street(cols)[0, :rows])
        yield _alone(f"45 views of {cols} x {rows}, PNG", files, folder, 1)
    scene = load_scene(PAIR)
    photographs, _ = present(() if quick else PHOTOGRAPHS)
    masters = {"night street": pair, **{name: from_data(name, scene)[0] for name in photographs}}
    for name, light in masters.items():
        yield _called(name, light, scene, runs)


def frame_passes(*, quick: bool = False) -> list[Pass]:
    """Passes of a further frame of 4096²; `quick` ones of a quarter of the side."""
    with tempfile.TemporaryDirectory() as name:
        (file,) = _stored(Path(name), "dome", night(1024 if quick else 4096, 0), "exr")
        return passes(file, DOME, Path(name) / "out.exr", 2 if quick else RUNS)


def bandwidth() -> float:
    """GB/s that one core reads and writes, as `numpy.copyto` moves 200 MB."""
    plane = np.ones(50_000_000, np.float32)
    other = np.empty_like(plane)

    def once() -> float:
        began = time.thread_time()
        np.copyto(other, plane)
        return time.thread_time() - began

    return 2 * plane.nbytes / min(once() for _ in range(9)) / 1e9


def write(folder: Path, found: Sequence[FileCost], parts: Sequence[Pass], gb_per_s: float) -> Path:
    """Write them into a folder; the path of the file."""
    path = folder / NAME
    told = {"cores": cores(), "gb_per_s": gb_per_s, "costs": figures(found)}
    told["passes"] = [asdict(each) for each in parts]
    write_whole(path, json.dumps(told, indent=1).encode())
    return path


def figures(found: Sequence[FileCost]) -> list[dict[str, float | str | None]]:
    """All of them, for JSON."""
    return [{**asdict(each), "copies": each.copies} for each in found]


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


def _quilt(folder: Path, view: Light) -> list[Path]:
    """A quilt of 45 views of a street, each a pixel further; and its scene's file."""
    (folder / f"{_VIEWS}.toml").write_text(OF_VIEWS)
    rows = [
        np.concatenate([np.roll(view, k, axis=1) for k in range(row, row + ACROSS)], axis=1)
        for row in range(0, ACROSS * DOWN, ACROSS)
    ]
    name = f"{_VIEWS}_qs{ACROSS}x{DOWN}a1.8"
    return _stored(folder, name, np.concatenate(rows[::-1])[None], "png")


_VIEWS = "views"


def _called(name: str, light: Light, scene: Scene, runs: int) -> FileCost:
    compensate(light, scene)  # what later calls share
    rows, cols = light.shape[1:3]
    took = []
    for _ in range(runs):
        began, busy = time.perf_counter(), time.process_time()
        compensate(light, scene)
        took.append((time.perf_counter() - began, time.process_time() - busy))
    seconds, cpu_s = (median(each) for each in zip(*took, strict=True))
    return FileCost(f"{name} {cols} x {rows}, Python", seconds, cpu_s, None)


def _beside(
    works: Sequence[Callable[[], T]], files: Sequence[Path], folder: Path
) -> tuple[list[T], float]:
    """What works give; the median of copies' core-seconds around them."""
    found: list[T] = []
    copies = [copied(files, 1, folder)[1]]
    for work in works:
        found.append(work())
        copies.append(copied(files, 1, folder)[1])
    return found, median(copies)


def _command(files: list[Path], folder: Path, *options: str, command: str = "compensate") -> Job:
    named = [str(files[0])]
    if len(files) > 1:
        named = ["--left", str(files[0]), "--right", str(files[1])]
    scene = PAIR if len(files) > 1 else DOME
    if files[0].name.startswith(_VIEWS):
        scene = str(folder / f"{_VIEWS}.toml")
    where = ("--scene", scene, "--out", str(folder / "out"), "--anew", "--mix", "--json")
    return run_command(command, *named, *where, *options)


def _alone(
    work: str, files: list[Path], folder: Path, runs: int, *, command: str = "compensate"
) -> FileCost:
    once = partial(_command, files, folder, command=command)
    jobs, copy = _beside([once] * runs, files, folder)
    seconds, cpu_s, gib = (
        median(getattr(job, name) for job in jobs) for name in ("seconds", "cpu_s", "gib")
    )
    return FileCost(work, seconds, cpu_s, gib, copy)


def _further(work: str, files: list[Path], folder: Path, runs: int) -> FileCost:
    patterns = [path.with_name(path.name.replace("0001", "####")) for path in files]

    def sequence(count: int) -> Job:
        return _command(patterns, folder, "--frames", f"1-{count}", "--pages", "0")

    jobs, copy = _beside(
        [partial(sequence, count) for count in (SHORT, LONG)] * runs, files, folder
    )
    shorts, longs = jobs[::2], jobs[1::2]
    seconds, cpu_s = (
        median(
            (getattr(long, name) - getattr(short, name)) / (LONG - SHORT)
            for short, long in zip(shorts, longs, strict=True)
        )
        for name in ("seconds", "cpu_s")
    )
    gib = median(job.gib for job in longs)
    busy = cpu_s / (seconds * cores())
    return FileCost(f"{work}, a further one", seconds, cpu_s, gib, copy, busy)
