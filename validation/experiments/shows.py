"""Whole shows: the same bytes whoever does the frames, time that workers share, even memory.

Rationale
    A show is tens of thousands of frames. Whoever does them, on one machine or many, the result
    must be the same; two workers on two cores should take less time than one; a worker must not
    grow; what a dry run promises must be what the show then takes; and one command must be able to
    keep very many workers busy.
Expected
    Frames of a dome show and pairs of a stereo show come out the same, byte for byte, from one
    worker, from two, and from the workers of a scheduler on loopback. Two workers of one thread
    each are at least 1.2 times as fast as one, with start and report (full run, at least two cores,
    nothing else running): one alone keeps 1.3 cores busy, for it writes a frame while it computes
    its figures.
    A worker holds as much memory after its last frame as after the first tenth, within 5 %. A dry
    run's estimate is within 25 % of what the show takes (full run: 20 frames of 4096²; a show of
    24 minutes at 30 frames a second is 2160 times that). In a full run at least 100 frames a
    second are handed out to 32 workers and to 1000; these spend at least 0.8 of their time on
    frames of 25 s, in which they sleep: all on this machine, which has to be worker, scheduler and
    command at once. A quick run tells its rate only, for other work may run beside it.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, final

import numpy as np

from domesim.host.cores import cores
from domesim.light import Light
from domesim.shows.checksums import sha256
from domesim.shows.cluster import in_cluster
from domesim.shows.crew import Crew
from domesim.shows.job import FOLDER
from domesim.shows.show import Show
from domesim.shows.work import Column as Figure
from domesim.shows.work import Failed, Finished, Note, Order, Recipe, Writing
from domesim.shows.work import Work as Duty
from testing.masters import night, write_exr
from testing.pairs import generated
from testing.schedulers import crowd, scheduler
from validation.benchmarks.commands import run_command
from validation.data import SEQUENCE, data_folder
from validation.experiment import Column, Finding, Missing, Table, Work, at_least, at_most

SHOW = 24 * 60 * 30
"""Frames of 24 minutes."""

CREWS = {
    "one worker": ("--workers", "1", "--threads", "1"),
    "two workers": ("--workers", "2", "--threads", "1"),
    "a scheduler's two workers": (),
}


TRIED = 20
"""Frames of 4096² that are done to see what a dry run's promise is worth."""

CROWD = 32
"""Workers that frames of no work are handed out to."""

MANY = 1000
"""Workers of a large farm, which only sleep."""

FRAME = 25.0
"""Seconds that a frame of 8192² takes one core."""


@final
@dataclass(frozen=True)
class Runs:
    """One show, done by each of `CREWS`.

    Attributes
    ----------
    seconds
        Seconds of each.
    different
        How many files differ from the first's.
    files
        How many there are.
    """

    seconds: tuple[float, ...]
    different: int
    files: int


@final
@dataclass(frozen=True)
class Estimate:
    """What a dry run promised, and what the show took, s; and bytes on the disk."""

    promised: float
    took: float
    promised_disk: float
    took_disk: float
    seconds_frame: float
    memory_worker: float


def dome_show(folder: Path, count: int, size: int, seed: int) -> tuple[str, ...]:
    """Write a night that turns and darkens; the command's arguments."""
    picture = night(size, seed)[0]
    for number in range(count):
        turned = np.roll(picture, number * size // (4 * count), axis=1)
        write_exr(
            folder / f"dome.{number + 1:04}.exr", turned * np.float32(1 - 0.4 * number / count)
        )
    return (str(folder / "dome.####.exr"), "--scene", "dome_planetarium")


def stereo_show(folder: Path, width: int, seed: int) -> tuple[str, ...]:
    """The test data's sequence; drawn pairs where it is not there, or narrower ones are wanted."""
    scene = ("--scene", "stereo_polarised_paper")
    try:
        if width >= 2048:
            real = data_folder() / "sequence"
            return (
                *("--left", str(real / "beachball_####_L.exr")),
                *("--right", str(real / "beachball_####_R.exr")),
                *scene,
            )
    except Missing:
        pass
    light: Light = generated(width, seed)[:, : width * 1080 // 2048]
    for number in range(len(SEQUENCE)):
        for eye, picture in zip("LR", np.roll(light, number * width // 16, axis=2), strict=True):
            write_exr(folder / f"{eye}.{number + 1:04}.exr", picture)
    return ("--left", str(folder / "L.####.exr"), "--right", str(folder / "R.####.exr"), *scene)


def by_each_crew(arguments: Iterable[str], folder: Path) -> Runs:
    """``domesim compensate`` of a show, by each of `CREWS`."""
    # Loops are compiled once on a machine
    run_command("compensate", *arguments, "--out", str(folder / "warm"), "--frames", "1", "--json")
    seconds, results = [], []
    for number, crew in enumerate(CREWS.values()):
        out = folder / f"out{number}"
        command = ("compensate", *arguments, "--out", str(out), "--pages", "0", "--json")
        if crew:
            job = run_command(*command, *crew)
        else:
            with scheduler(2) as (address, _):
                job = run_command(*command, "--scheduler", address)
        seconds.append(job.figures["seconds_total"])
        results.append({path.name: sha256(path) for path in out.glob("*.exr")})
    first = results[0]
    different = sum(
        other.get(name) != digest for other in results[1:] for name, digest in first.items()
    )
    return Runs(tuple(seconds), different, len(first))


def memory(count: int, size: int, seed: int) -> tuple[float, float]:
    """MiB that one worker holds after a tenth of the frames, and after the last."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arguments = dome_show(folder, count, size, seed)
        out = folder / "out"
        crew = ("--workers", "1", "--pages", "0", "--json")
        run_command("compensate", *arguments, "--out", str(out), *crew)
        records = [json.loads(path.read_text()) for path in (out / FOLDER).glob("dome.*.json")]
    held = [record["maker"]["resident"] for record in sorted(records, key=_number)]
    return held[count // 10 - 1] / 2**20, held[-1] / 2**20


def _number(record: dict[str, Any]) -> int:
    return int(Path(record["figures"]["output"]).name.split(".")[1])


def estimate(count: int, size: int, seed: int) -> Estimate:
    """A dry run, and then the show."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        show = dome_show(folder, count, size, seed)
        arguments = ("compensate", *show, "--out", f"{name}/out", "--pages", "0", "--json")
        dry = run_command(*arguments, "--dry-run").figures["estimate"]
        done = run_command(*arguments)
        disk = sum(path.stat().st_size for path in (folder / "out").glob("*.exr"))
    return Estimate(
        dry["seconds_total"],
        done.figures["seconds_total"],
        dry["disk_total"],
        disk,
        dry["seconds_frame"],
        dry["memory_worker"],
    )


@final
@dataclass(frozen=True)
class _Nothing(Recipe):
    """Frames that are not even there: what is left is handing them out."""

    def work(self, note: Note) -> Duty[Any, Any]:
        raise NotImplementedError

    def settings(self) -> dict[str, Any]:
        return {}

    def columns(self) -> tuple[Figure, ...]:
        return ()

    def memory(self, rows: int, cols: int) -> int:
        return 1


def nothing(order: Order) -> Finished | Failed:
    """Do nothing."""
    return Finished({}, "")


def sleep(order: Order, seconds: float) -> Finished | Failed:
    """Take so long."""
    time.sleep(seconds)
    return Finished({}, "")


def ends(count: int, workers: int, task: Callable[[Order], Finished | Failed]) -> tuple[float, ...]:
    """When frames end that one command hands out to so many workers, s after the first is."""
    orders = [
        Order(Show(((Path(f"in.{k}.exr"),),)), (Path(f"out.{k}.exr"),), _Nothing(), Writing())
        for k in range(count)
    ]
    begun: list[float] = []
    times: list[float] = []
    with scheduler(0) as (address, _), crowd(address, workers):
        in_cluster(
            orders,
            Crew(scheduler=address),
            lambda order: begun.append(time.perf_counter()),
            lambda order, outcome: times.append(time.perf_counter()),
            lambda text: None,
            task=task,
        )
    return tuple(each - begun[0] for each in times)


def handed_out(count: int, workers: int) -> float:
    """Frames a second that one command hands out, if they take no time."""
    return count / ends(count, workers, nothing)[-1]


def kept_busy(workers: int, seconds: float, rounds: int) -> float:
    """The share of their time that workers spend on frames that take so long.

    From when as many have ended as there are workers, to when as many are left.
    """
    times = ends(rounds * workers, workers, partial(sleep, seconds=seconds))
    counted = (rounds - 2) * workers
    return counted * seconds / (workers * (times[-workers - 1] - times[workers - 1]))


def run(work: Work) -> Finding:
    """Do the shows."""
    width = 2048
    count, size = (4, 256) if work.quick else (12, width)

    def dome() -> Runs:
        with tempfile.TemporaryDirectory() as name:
            return by_each_crew(dome_show(Path(name), count, size, work.seed), Path(name))

    def stereo() -> Runs:
        with tempfile.TemporaryDirectory() as name:
            return by_each_crew(stereo_show(Path(name), width, work.seed), Path(name))

    shows = {f"dome, {count} frames of {size}²": work.step("dome", Runs, dome)}
    if not work.quick:
        pairs = f"stereo, {len(SEQUENCE)} pairs {width} wide"
        shows[pairs] = work.step("stereo", Runs, stereo)
    frames, small = (40, 64) if work.quick else (200, 128)
    held = work.step("memory", tuple[float, float], lambda: memory(frames, small, work.seed))
    rate = work.step("rate", float, lambda: handed_out(1000 if work.quick else 4000, CROWD))
    checks = [
        at_most(f"{name}: files that differ", runs.different, 0) for name, runs in shows.items()
    ]
    checks += [
        at_most(
            f"memory after {frames} frames over that after {frames // 10}", held[1] / held[0], 1.05
        ),
    ]
    gains = {name: runs.seconds[0] / runs.seconds[1] for name, runs in shows.items()}
    figures = {
        **{f"shows.{name.split(',')[0]}_gain": gain for name, gain in gains.items()},
        "shows.memory_early": held[0],
        "shows.memory_late": held[1],
        "shows.rate": rate,
    }
    words = (
        f"All files are the same, byte for byte, whoever does them. A worker holds {held[0]:.0f} "
        f"MiB after {frames // 10} frames and {held[1]:.0f} MiB after {frames}. {rate:.0f} frames "
        f"a second can be handed out to {CROWD} workers."
    )
    tables = [_crews(shows)]
    if not work.quick:
        promise = work.step("estimate", Estimate, lambda: estimate(TRIED, 4096, work.seed))
        ratio = promise.promised / promise.took
        checks += [
            at_least(f"{name}: two workers over one", gain, 1.2) for name, gain in gains.items()
        ]
        checks += [
            at_least("estimated time over the show's", ratio, 0.75),
            at_most("estimated time over the show's", ratio, 1.25),
        ]
        to_many = work.step("many", float, lambda: handed_out(6000, MANY))
        busy = work.step("busy", float, lambda: kept_busy(MANY, FRAME, 3))
        checks += [
            at_least(f"frames handed out to {CROWD} workers", rate, 100, "1/s"),
            at_least(f"frames handed out to {MANY} workers", to_many, 100, "1/s"),
            at_least(f"time that {MANY} workers spend on frames of {FRAME:.0f} s", busy, 0.8),
        ]
        hours = promise.took / TRIED * SHOW / 3600
        words += (
            f" Two workers are {' and '.join(f'{gain:.2f}' for gain in gains.values())} times as "
            f"fast as one (dome, stereo), on {cores()} cores. A dry run promised "
            f"{promise.promised:.0f} s for {TRIED} frames of 4096², which then took "
            f"{promise.took:.0f} s: a show of {SHOW} frames would take {hours:.0f} hours here, and "
            f"{hours * cores() / 32:.0f} on 32 such cores. {to_many:.0f} frames a second can be "
            f"handed out to {MANY} workers, which spend {busy:.0%} of their time on frames of "
            f"{FRAME:.0f} s."
        )
        tables.append(_promise(promise))
        figures |= {
            "shows.promised": promise.promised,
            "shows.took": promise.took,
            "shows.seconds_frame": promise.seconds_frame,
            "shows.memory_worker": promise.memory_worker / 1e9,
            "shows.hours": hours,
            "shows.rate_many": to_many,
            "shows.busy_many": busy,
        }
    return Finding(
        result=words,
        checks=tuple(checks),
        tables=tuple(tables),
        figures=figures,
        left_out=("Pairs, and large shows: with a full run.",) if work.quick else (),
    )


def _crews(shows: Mapping[str, Runs]) -> Table:
    return Table(
        caption="The same show by different workers, one thread each.",
        columns=(
            Column(name="show"),
            *(Column(name=name, unit="s", digits=".1f") for name in CREWS),
            Column(name="two over one", digits=".2f"),
        ),
        rows=tuple(
            (name, *runs.seconds, runs.seconds[0] / runs.seconds[1]) for name, runs in shows.items()
        ),
    )


def _promise(promise: Estimate) -> Table:
    return Table(
        caption=f"A dry run, and the show: {TRIED} frames of 4096².",
        columns=(
            Column(name=""),
            Column(name="time", unit="s", digits=".0f"),
            Column(name="disk", unit="GB", digits=".2f"),
        ),
        rows=(
            ("promised", promise.promised, promise.promised_disk / 1e9),
            ("took", promise.took, promise.took_disk / 1e9),
        ),
    )
