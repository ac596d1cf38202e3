"""Estimate of a show's cost: a few frames are done, and thrown away.

So is what a run makes of all its frames when they are done: a page about one of the worst, and a
video. Both are made by the command itself, one after the other.
"""

from __future__ import annotations

import tempfile
import time
from collections import defaultdict
from collections.abc import Hashable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from statistics import mean
from typing import Any, final

import psutil

from domesim.errors import InputError
from domesim.frames import ColourTag
from domesim.host.console import Console, complain, duration, sized
from domesim.host.cores import cores
from domesim.host.numbers import decimal
from domesim.host.system import peak_memory
from domesim.shows.checksums import sha256
from domesim.shows.cinema import becoming
from domesim.shows.film import Films, encoding_of
from domesim.shows.first_look import look
from domesim.shows.report import Report
from domesim.shows.run import (
    Running,
    crew_of,
    do_all,
    free_memory,
    job_of,
    needed_memory,
    orders_of,
    pages_of,
    write_page,
)
from domesim.shows.show import Show
from domesim.shows.work import Failed, Files, Finished, Order, Recipe, Writing

A_WORKER, LIKE = 4, 2
"""Frames that each worker does; the first has also to get ready, and does not count. Of one master
that stands for all, whose frames take alike, fewer."""

_AT_WORK = 0.6
"""Share of its time below which a worker waits for more than frames usually do."""


@final
@dataclass(frozen=True)
class _Cost:
    """Seconds of the command alone, when all frames are done; and bytes on the disk."""

    seconds: float = 0.0
    disk: float = 0.0


@final
@dataclass
class _Tried:
    """Outcomes of the frames that were tried."""

    frames: dict[Order, Finished] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)
    ends: list[tuple[tuple[str, int], float]] = field(default_factory=list)  # whose, and when
    report: Report | None = None

    def end(self, order: Order, outcome: Finished | Failed) -> None:
        """Takes the outcome of a frame."""
        if isinstance(outcome, Finished):
            self.frames[order] = outcome
            maker = outcome.maker["host"], outcome.maker["pid"]
            self.ends.append((maker, time.perf_counter()))
        else:
            self.failed.append(outcome.reason)
            complain(outcome.reason)


def estimate(
    show: Show,
    folder: Path,
    recipe: Recipe,
    console: Console,
    writing: Writing,
    running: Running,
    like: int | None = None,
) -> dict[str, Any]:
    """Time, memory and disk that a show will take with the workers that would do it.

    Parameters
    ----------
    show, folder, recipe, console, writing, running
        As for `each_frame`; the folder may not be there yet, but its disk is tried. Of more workers
        than this machine has cores, as many are tried as it has, and the rest taken to be alike.
    like
        How many frames there will be like the show's only one; None if it has them all.

    Returns
    -------
    ``frames`` in all and ``sampled``; ``workers`` and ``threads``; ``seconds_frame`` and
    ``seconds_total``, of which ``seconds_pages`` and ``seconds_video``; ``core_hours`` of such
    cores, to be divided by those of other machines; and in bytes
    ``memory_worker``, ``memory_total``, ``disk_frame`` (a result and the files beside it) and
    ``disk_total``, of which ``disk_pages`` and ``disk_video``. Records and tables, some kB a frame,
    are not counted. Of frames that need more memory than is free, none is tried, and only memory
    told.

    Raises
    ------
    InputError
        If no frame can be done, or no video made of them.
    """
    if running.scheduler is not None:
        raise InputError(
            "--dry-run tries workers of this machine; leave --scheduler out, and say how many like "
            "these there are (--workers)"
        )
    look(show, recipe, folder, repair=writing.repair)
    only = show
    if like is not None:
        show = replace(show, moments=like * show.moments, numbered=True)
    writing, films = becoming(show, folder, writing)
    writing.places(only, folder)  # complains as the run would
    crew = crew_of(running, recipe, show)
    count = len(show.moments)
    workers = 1 if crew is None else crew.workers
    need = needed_memory(recipe, show)
    if need is not None and need > free_memory():
        console.say(
            f"{count} frames: about {sized(need)} of memory a worker, of which "
            f"{sized(free_memory())} are free here; none was tried"
        )
        known = {"frames": count, "sampled": 0, "workers": workers}
        return {**known, "memory_worker": need, "memory_total": need * workers}
    if crew is not None:
        crew = replace(crew, workers=min(workers, cores()))
    each = A_WORKER if like is None else LIKE
    wanted = min(count, each * (1 if crew is None else crew.workers))
    chosen = sorted({round(k * (count - 1) / max(wanted - 1, 1)) for k in range(wanted)})
    place = next(each for each in (folder, *folder.parents) if each.is_dir())
    tried = _Tried()
    with ExitStack() as stack:
        scratch = stack.enter_context(tempfile.TemporaryDirectory(prefix=".domesim-", dir=place))
        part = show.some(chosen)
        outputs = _outputs(part, writing, Path(scratch))
        job = stack.enter_context(job_of(part, Path(scratch), outputs, recipe, writing, running))
        orders = orders_of(part, outputs, recipe, writing, job)
        tried.report = None if job is None else Report(job, orders, "estimate")
        age, began = _age(), time.perf_counter()
        with console.progress("trying", len(orders)) as start:
            do_all(orders, crew, start, tried.end, console)
        if tried.report is not None:
            for order, outcome in tried.frames.items():
                tried.report.add(order, outcome)
            tried.report.finish()
        ended = time.perf_counter()
        if not tried.frames:
            raise InputError(f"no frame of {len(chosen)} could be done: {tried.failed[0]}")
        size = mean(_size(order) for order in tried.frames)
        pages = _pages(tried, show, recipe, running, Path(scratch), console)
        video = _Cost()
        if isinstance(films, Films) and not show.part:
            video = _video(tried, films, count, Path(scratch), console)
    peak = max(each.maker["peak"] for each in tried.frames.values())
    own = peak_memory()
    steady, around = _pace(tried.ends, began, ended)
    seconds = age + around + steady * count / workers + pages.seconds + video.seconds
    figures = {
        "frames": count,
        "sampled": len(tried.frames),
        "workers": workers,
        "threads": None if crew is None else crew.threads,
        "seconds_frame": steady,
        "seconds_pages": pages.seconds,
        "seconds_video": video.seconds,
        "seconds_total": seconds,
        "core_hours": _core_seconds(list(tried.frames.values())) * count / 3600,
        "memory_worker": peak,
        "memory_total": max(peak * workers, own),
        "disk_frame": size,
        "disk_pages": pages.disk,
        "disk_video": video.disk,
        "disk_total": size * count + pages.disk + video.disk,
    }
    _tell(figures, console)
    return figures


def _tell(figures: Mapping[str, Any], console: Console) -> None:
    steady, workers = figures["seconds_frame"], _counted(figures["workers"], "worker")
    frames, tried = (_counted(figures[key], "frame") for key in ("frames", "sampled"))
    console.say(
        f"{frames}, by {tried} tried:",
        f"  time: {duration(figures['seconds_total'])} with {workers}, {decimal(steady)} s a frame;"
        f" {decimal(figures['core_hours'])} core-hours",
        f"  memory: {sized(figures['memory_total'])}",
        f"  disk: {sized(figures['disk_total'])}",
    )
    at_work = figures["core_hours"] * 3600 / (figures["frames"] * max(steady, 1e-9))
    if at_work < _AT_WORK:
        console.say(
            f"  a worker had a core for {at_work:.0%} of it: others had it, or files are slow"
        )
    for what, key in (("pages", "pages"), ("the video", "video")):
        if seconds := figures[f"seconds_{key}"]:
            told = sized(figures[f"disk_{key}"])
            console.say(f"  in it, {what}: {duration(seconds)}, {told}")


def _outputs(part: Show, writing: Writing, scratch: Path) -> Sequence[Files]:
    """Where trials go: each has a folder of its own, for all may be of one master."""
    outputs = [
        writing.places(part.some([k]), scratch / str(k))[0] for k in range(len(part.moments))
    ]
    for path in chain(*outputs):
        path.parent.mkdir(parents=True, exist_ok=True)
    return outputs


def _counted(count: int, thing: str) -> str:
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def _pages(
    tried: _Tried, show: Show, recipe: Recipe, running: Running, scratch: Path, console: Console
) -> _Cost:
    """Cost of the pages of the worst frames, estimated by one of the worst that was tried."""
    count = min(pages_of(running, len(show.moments)), len(show.moments))
    if not (recipe.compares and show.numbered and count):
        return _Cost()
    key = recipe.columns()[0].key  # of equal ones the first, whose page takes as long
    worst = max(tried.frames, key=lambda order: float(tried.frames[order].figures[key]))
    page = scratch / "page.html"
    began = time.perf_counter()
    with console.progress("comparing", 1) as start:
        start(worst.name)
        if write_page(worst, page):
            return _Cost()
    seconds = time.perf_counter() - began
    if tried.report is not None:  # which is written again, with the pages
        tried.report.finish()
    again = time.perf_counter() - began - seconds
    return _Cost(count * seconds + again, count * page.stat().st_size)


def _video(tried: _Tried, films: Films, count: int, scratch: Path, console: Console) -> _Cost:
    """Cost of the videos that the frames become, estimated by the frames that were tried."""
    orders = list(tried.frames)
    transfer, primaries = encoding_of(tried.frames[orders[0]].figures)
    seconds = disk = 0.0
    for view, path in enumerate(films.paths):
        place = scratch / path.name
        frames = {order.output[view]: sha256(order.output[view]) for order in orders}
        began = time.perf_counter()
        with console.progress("assembling", len(frames)) as start:
            films.write(view, place, frames, ColourTag(transfer, primaries, "domesim"), start)
        seconds += (time.perf_counter() - began) * count / len(frames)
        disk += place.stat().st_size * count / len(frames)
    return _Cost(seconds, disk)


def _age() -> float:
    """Seconds since this process began: a command starts before it does anything."""
    return time.time() - float(psutil.Process().create_time())


def _pace(
    ends: Sequence[tuple[Hashable, float]], began: float, ended: float
) -> tuple[float, float]:
    """Seconds from a worker's frame to its next, and what its start and the end take besides.

    Parameters
    ----------
    ends
        Who ended a frame, and when, in order.
    began, ended
        When all of it began and ended.
    """
    known = defaultdict[Hashable, list[float]](list)
    for maker, second in ends:
        known[maker].append(second)
    first = mean(each[0] for each in known.values()) - began
    paces = [(each[-1] - each[0]) / (len(each) - 1) for each in known.values() if each[1:]]
    steady = mean(paces) if paces else first
    return steady, max(0.0, first - steady) + ended - ends[-1][1]


def _core_seconds(trials: Sequence[Finished]) -> float:
    """Core-seconds of a frame: of those after a worker's first, or of one alone with its start."""
    ends: dict[tuple[str, int], list[float]] = {}
    for each in trials:
        ends.setdefault((each.maker["host"], each.maker["pid"]), []).append(each.maker["cpu"])
    if further := sum(len(known) - 1 for known in ends.values()):
        return sum(max(known) - min(known) for known in ends.values()) / further
    return mean(chain(*ends.values()))


def _size(order: Order) -> int:
    """Bytes of a result, and of the files beside it."""
    files = (*order.output, *order.recipe.beside(order.output))
    return sum(path.stat().st_size for path in files if path.exists())
