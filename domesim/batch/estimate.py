"""What a show will take: a few of its frames are done, and thrown away."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean
from typing import Any, final

from domesim.batch.film import films_of
from domesim.batch.run import Running, crew_of, do_all, orders_of
from domesim.batch.work import Failed, Finished, Order, Recipe, Writing
from domesim.console import Console, complain, duration
from domesim.errors import InputError
from domesim.shows import Show
from domesim.strips import cores

A_WORKER = 4
"""Frames that each worker does; the first has also to get ready, and does not count."""


@final
@dataclass(frozen=True)
class _Sampled:
    """Of one frame: its time, s, and its result's size, bytes."""

    worker: tuple[str, int]
    seconds: float
    size: int
    peak: int


def estimate(
    show: Show,
    folder: Path,
    recipe: Recipe,
    console: Console,
    writing: Writing,
    running: Running,
) -> dict[str, Any]:
    """Time, memory and disk that a show will take with the workers that would do it.

    Parameters
    ----------
    show, folder, recipe, console, writing, running
        As for `each_frame`; the folder may not be there yet, but its disk is tried. Of more workers
        than this machine has cores, as many are tried as it has, and the rest taken to be alike.

    Returns
    -------
    ``frames`` in all and ``sampled``; ``workers`` and ``threads``; ``seconds_frame`` and
    ``seconds_total``; and in bytes ``memory_worker``, ``memory_total``, ``disk_frame`` and
    ``disk_total``.

    Raises
    ------
    InputError
        If no frame can be done.
    """
    if running.scheduler is not None:
        raise InputError(
            "--dry-run tries workers of this machine; leave --scheduler out, and say how many like "
            "these there are (--workers)"
        )
    writing, _ = films_of(show, folder, writing)
    show.outputs(folder, writing.suffix)  # complains as the run would
    crew = crew_of(running, recipe, show)
    count = len(show.moments)
    workers = 1 if crew is None else crew.workers
    if crew is not None:
        crew = replace(crew, workers=min(workers, cores()))
    wanted = min(count, A_WORKER * (1 if crew is None else crew.workers))
    chosen = sorted({round(k * (count - 1) / max(wanted - 1, 1)) for k in range(wanted)})
    place = folder
    while not place.is_dir():
        place = place.parent
    failed: list[str] = []
    found: list[_Sampled] = []
    with tempfile.TemporaryDirectory(prefix=".domesim-", dir=place) as scratch:
        part = replace(show, moments=tuple(show.moments[k] for k in chosen))
        outputs = part.outputs(Path(scratch), writing.suffix)
        for output in outputs:
            for path in output:
                path.parent.mkdir(parents=True, exist_ok=True)
        orders = orders_of(part, outputs, recipe, writing)

        def end(order: Order, outcome: Finished | Failed) -> None:
            if isinstance(outcome, Failed):
                failed.append(outcome.reason)
                complain(outcome.reason)
                return
            size = 0
            for path in order.output:
                size += path.stat().st_size
                path.unlink()
            maker = outcome.maker
            worker = (maker["host"], maker["pid"])
            found.append(_Sampled(worker, sum(outcome.seconds.values()), size, maker["peak"]))

        with console.progress("trying", len(orders)) as start:
            do_all(orders, crew, start, end, console)
    if not found:
        raise InputError(f"no frame of {len(chosen)} could be done: {failed[0]}")
    steady, first = _steady(found)
    size, peak = mean(each.size for each in found), max(each.peak for each in found)
    total = first + steady * count / workers
    figures = {
        "frames": count,
        "sampled": len(found),
        "workers": workers,
        "threads": None if crew is None else crew.threads,
        "seconds_frame": steady,
        "seconds_total": total,
        "memory_worker": peak,
        "memory_total": peak * workers,
        "disk_frame": size,
        "disk_total": size * count,
    }
    console.say(
        f"{count} frames: {duration(total)} with {workers} worker{'s' if workers > 1 else ''} "
        f"({steady:.3g} s a frame each, from {len(found)} that were tried), "
        f"{_size(peak * workers)} of memory, {_size(size * count)} on the disk"
    )
    return figures


def _steady(found: Sequence[_Sampled]) -> tuple[float, float]:
    """Seconds of a frame once a worker is ready, and what getting ready takes besides."""
    firsts: list[float] = []
    others: list[float] = []
    seen = set()
    for each in found:
        (others if each.worker in seen else firsts).append(each.seconds)
        seen.add(each.worker)
    if not others:
        return mean(firsts), 0.0
    return mean(others), max(0.0, mean(firsts) - mean(others))


def _size(count: float) -> str:
    return f"{count / 1e9:.3g} GB" if count >= 1e9 else f"{count / 1e6:.3g} MB"
