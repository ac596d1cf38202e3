"""What commands call: do each frame of a show, alone or with workers, and tell of it."""

from __future__ import annotations

import os
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from math import inf
from pathlib import Path
from typing import Any, final

import psutil

from domesim.errors import InputError
from domesim.frames.colour import ColourTag
from domesim.frames.messages import joined
from domesim.frames.reading import size_of
from domesim.frames.timing import USUAL_RATE, timing_of
from domesim.frames.video import video_of
from domesim.host.console import Console, complain, sized
from domesim.host.cores import cores
from domesim.host.memory import limit_of_group
from domesim.host.system import address_space
from domesim.host.writing import note_written, prepare, prepare_folder
from domesim.shows.alone import alone
from domesim.shows.checksums import sha256
from domesim.shows.cinema import Cinema, becoming, dcp_hint
from domesim.shows.clips import judge_clips
from domesim.shows.crew import Crew
from domesim.shows.film import Films, record_of
from domesim.shows.first_look import keep, look
from domesim.shows.job import Job, Record, open_job, require_own_results
from domesim.shows.report import Report, page_name, unlike
from domesim.shows.sequences import refuse_inputs
from domesim.shows.show import Show
from domesim.shows.work import (
    Failed,
    Files,
    Finished,
    Order,
    Recipe,
    Writing,
    finished_before,
    program_of,
)

STEPS = ("reading", "solving", "writing")

FRAME_TIMEOUT = 3600.0
"""Seconds: a hundred times what a frame of 4096² takes one core."""

_PAGES, _FRAMES_A_PAGE = 3, 40
"""Pages that are written, at most, if nobody says how many; a page takes as long as 4 frames."""

_DIGITS = re.compile(r"[0-9]+")
_ALIKE = 3  # messages of one cause that are printed
_LOOK = 0.1  # s: how often to look for frames that others do
_SPARE = 0.8  # of the memory that is free: what workers may need together


@final
@dataclass(frozen=True)
class Running:
    """How a show is done.

    Parameters
    ----------
    workers
        Processes on this machine: 0 for none, all in the command's own; None for as many as
        cores and memory allow. A single frame needs none.
    threads
        Threads of each worker; None to share the cores.
    scheduler
        Address of a Dask scheduler whose workers do the frames.
    anew
        Do frames that are done already once more.
    mixed
        Take frames that are done already with other settings.
    pages
        Number of the worst frames of a sequence for which a page that compares methods is written;
        None for a few, which take less than a tenth of the time (`pages_of`).
    frame_timeout
        Seconds after which a worker that is not done with a frame ends; 0 for never.
    prune
        Remove results whose masters are gone.
    clips
        Number of the worst clips of a sequence (`domesim.shows.clips`) that are judged as films.
    """

    workers: int | None = None
    threads: int | None = None
    scheduler: str | None = None
    anew: bool = False
    mixed: bool = False
    pages: int | None = None
    frame_timeout: float = FRAME_TIMEOUT
    prune: bool = False
    clips: int = 0


@final
@dataclass
class Done:
    """Outcome of a show.

    Parameters
    ----------
    frames
        Figures of the masters that are done, in order, with ``input`` and ``output``: a path, or
        the paths of left and right.
    failed
        Messages of those that are not.
    seconds
        ``total``, from the first file to the last; and the sums of ``reading`` (and preparing),
        ``solving`` and ``writing`` (and finishing), of frames that may have been done at once.
    kept
        How many of the frames had been done before.
    report
        The page about all frames of the job, if it is a sequence and the page is there.
    films
        The videos that results became, if all of them are done.
    """

    frames: list[dict[str, Any]] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(("total", *STEPS), 0.0))
    kept: int = 0
    report: Path | None = None
    films: tuple[Path, ...] = ()

    def add_report(self, report: Report) -> None:
        """Writes the report; failing to do so is a failure of the show."""
        try:
            self.report = report.finish()
        except InputError as error:
            complain(error)
            self.failed.append(str(error))
            self.report = report.page if report.page.exists() else None


def each_frame(
    show: Show,
    folder: Path,
    recipe: Recipe,
    console: Console,
    *,
    what: str,
    writing: Writing | None = None,
    running: Running | None = None,
) -> Done:
    """Read each master of a show, do what a recipe asks for, write its result to `folder`.

    Results have their masters' names. A master that fails is named and leaves nothing behind; the
    others go on, unless the disk is full. Of a sequence, what is done is kept in `folder` (`job`):
    the same command goes on where it was ended, however it was. What was read is said of the first
    master, and of each that differs from the one before.

    Parameters
    ----------
    show
        The masters.
    folder
        It is made if it is not there.
    recipe
        What to do.
    console
        Who is told.
    what
        It, in one word for the progress bar.
    writing, running
        How.

    Raises
    ------
    InputError
        If its frames are no pairs where these are wanted, or are doubted (`Recipe.doubt`); if the
        folder cannot be made or written to, holds a job of other settings, an output would
        replace its input, or a scheduler fails.
    """
    running, writing = running or Running(), writing or Writing()
    looked = look(show, recipe, folder, repair=writing.repair)
    if running.scheduler is not None:
        # Its workers are in other folders
        here = tuple(tuple(path.absolute() for path in moment) for moment in show.moments)
        show, folder = replace(show, moments=here), folder.absolute()
    writing, films = becoming(show, folder, writing)
    outputs = writing.places(show, folder)
    beside = [tuple(recipe.beside(output)) for output in outputs]
    refuse_inputs(chain(*beside), chain(*show.moments))
    if show.numbered:
        made = zip(outputs, beside, strict=True)
        files = {path: f"{o[0].name}.json" for o, more in made for path in (*o, *more)}
        files |= {path: record_of(path) for path in (() if films is None else films.paths)}
        require_own_results(folder, files)
        for place in {path.parent for path in files} | {folder}:
            prepare_folder(place)
    else:
        prepare(*outputs[0], *beside[0], inputs=show.moments[0])
    _tell_size(show, recipe, console)
    crew = crew_of(running, recipe, show)
    with job_of(show, folder, outputs, recipe, writing, running) as job:
        if job is not None:
            keep(looked, job.folder)
        orders = orders_of(show, outputs, recipe, writing, job)
        done = _each(orders, job, crew, running, console, what, films)
    if not show.numbered and done.frames:
        # By a worker, perhaps
        note_written({path: sha256(path) for path in (*outputs[0], *beside[0])})
    return done


def _each(
    orders: list[Order],
    job: Job | None,
    crew: Crew | None,
    running: Running,
    console: Console,
    what: str,
    films: Films | Cinema | None,
) -> Done:
    """Do all frames of a job, and what is made of them together."""
    part = orders[0].show.part
    fresh, recorded = _by_record(orders, job)
    report = (
        None
        if job is None
        else Report(job, orders, what, part, checked_last=recorded, rate=_rate(orders, films))
    )
    telling = _Telling(console, orders, recorded, report)
    began = time.perf_counter()
    try:
        # To read all results of a long show takes hours, for which no worker should wait
        if recorded and fresh:
            console.say(f"{len(recorded)} of {len(orders)} have a record; they are checked last")
        shared = _Shared(job, telling, recorded)
        _do(fresh, crew, shared, console, what)
        if job is not None and recorded and telling.has_all(fresh):
            if running.scheduler is None:
                with console.progress("checking", len(recorded)) as start:
                    recorded = _changed(recorded, start, telling.end)
            _do(recorded, crew, shared, console, what)
        shared.tidy(orders)
    except BaseException:
        if job is not None:
            telling.interrupted(job, running)
        raise
    done = telling.done()
    done.seconds["total"] = time.perf_counter() - began
    if report is None or job is None:
        return done
    with shared.alone(report.page.name, console) as alone:
        if alone:
            _finish(orders, job, report, done, running, console, films)
        else:
            done.report = report.page
    kept = f", {done.kept} of them before" if done.kept else ""
    others = sum(frame["settings"] != job.settings for frame in done.frames)
    kept += f", {others} of them with other settings" if others else ""
    ending = "" if done.report is None else f" Report: {done.report}"
    console.say(f"{len(done.frames)} of {len(orders)} frames are done{kept}.{ending}")
    return done


def _finish(
    orders: list[Order],
    job: Job,
    report: Report,
    done: Done,
    running: Running,
    console: Console,
    films: Films | Cinema | None,
) -> None:
    """Make what is made of all frames together: the report, videos, pages."""
    recipe, part = orders[0].recipe, orders[0].show.part
    if not part:
        _tell_left_over(orders, job, report, running, console)
    done.add_report(report)
    for line in (*unlike(done.frames), *report.warnings):
        complain(line)
    if films is None and (ending := dcp_hint(orders, done.frames)):
        console.say(ending)
    if films is not None and not done.failed:
        _make_films(films, orders, job, report, done, console)
    if recipe.compares and done.report is not None:
        done.failed += _compare(report.worst(pages_of(running, len(orders))), recipe, console)
        done.failed += judge_clips(report, orders, running.clips, console)
        done.add_report(report)


def _rate(orders: Sequence[Order], films: Films | Cinema | None) -> float:
    """Frames a second: of the video that is made, as the first master says, or the usual."""
    if isinstance(films, Films):
        return float(films.timing.rate)
    with suppress(InputError):  # whoever does it will say so
        return float(timing_of(orders[0].moment[0]).rate)
    return float(USUAL_RATE)


@contextmanager
def job_of(
    show: Show,
    folder: Path,
    outputs: Sequence[Files],
    recipe: Recipe,
    writing: Writing,
    running: Running,
) -> Iterator[Job | None]:
    """The job of a sequence, without what processes that are gone half wrote; None of a file."""
    if not show.numbered:
        yield None
        return
    settings = _settings(show, folder, outputs[0], recipe, writing)
    with open_job(folder, settings, mixed=running.mixed, anew=running.anew) as job:
        prepare_folder(job.folder)
        for output in outputs if running.anew else ():
            job.forget(output)
        if any(video_of(path) for path in show.moments[0]):
            job.sources(show.moments[0])  # once, not by each worker
        yield job


def _make_films(
    films: Films | Cinema,
    orders: Sequence[Order],
    job: Job,
    report: Report,
    done: Done,
    console: Console,
) -> None:
    """Makes the videos of a whole sequence, and lists them with its results."""
    if orders[0].show.part:
        console.say("A video is made of a whole sequence: leave --frames out for it")
        return
    films.make(orders, job, console)
    done.films = films.paths
    report.add_films({path: sha256(path) for path in films.paths})
    done.add_report(report)


def _tell_left_over(
    orders: Sequence[Order], job: Job, report: Report, running: Running, console: Console
) -> None:
    """Tells of results whose masters are gone, and removes them if that is asked for."""
    masters = {path.parent for order in orders for path in order.moment}
    left = job.left_over((order.output for order in orders), masters)
    report.leave_out(left)
    if not left:
        return
    named = left[0] if len(left) == 1 else f"{left[0]} to {left[-1]}"
    what = f"{len(left)} results whose masters are gone ({named})"
    if not running.prune:
        console.say(f"{what} stay in the folder; --prune removes them")
        return
    changed = [path for name in left for path in job.remove(name)]
    stay = f"; {len(changed)} of their files were changed and stay" if changed else ""
    console.say(f"{what} were removed{stay}")


def _by_record(orders: list[Order], job: Job | None) -> tuple[list[Order], list[Order]]:
    """Orders that no run has done, and those that some run says it has done."""
    if job is None:
        return orders, []
    recorded = job.recorded(order.output for order in orders)
    fresh = [order for order, known in zip(orders, recorded, strict=True) if not known]
    return fresh, [order for order, known in zip(orders, recorded, strict=True) if known]


def _do(
    orders: list[Order], crew: Crew | None, shared: _Shared, console: Console, what: str
) -> None:
    """Does the frames, beside a progress bar, and then those that other commands leave."""
    while orders:
        with console.progress(what, len(orders)) as start:
            do_all(orders, crew, start, shared.end, console, shared.take)
        orders = shared.left(console)


@final
class _Shared:
    """Divides a job's frames with other commands that work in its folder.

    Parameters
    ----------
    job
        The job; None if nobody else can do its frames.
    telling
        Told of frames that other commands did.
    recorded
        Frames that had a record before, which tells nothing of what other commands do now.
    """

    def __init__(self, job: Job | None, telling: _Telling, recorded: Sequence[Order]) -> None:
        self._job, self._claims = job, None if job is None else job.claims
        self._telling, self._recorded = telling, set(recorded)
        self._elsewhere: list[Order] = []

    def take(self, order: Order) -> bool:
        """Whether this command does a frame; if not, another one has it or has just done it."""
        if self._job is None or self._claims is None:
            return True
        if not self._claims.take(order.output[0].name):
            self._elsewhere.append(order)
            return False
        record = None if order in self._recorded else self._job.record(order.output)
        if record is not None:
            self.end(order, finished_before(record))
        return record is None

    def end(self, order: Order, outcome: Finished | Failed) -> None:
        """Takes the outcome of a frame, which is then free."""
        self._telling.end(order, outcome)
        if self._claims is not None:
            self._claims.give_back(order.output[0].name)

    def tidy(self, orders: Sequence[Order]) -> None:
        """Removes what killed commands left of frames that have ended."""
        if self._claims is not None and self._telling.has_all(orders):
            self._claims.tidy(order.output[0].name for order in orders)

    @contextmanager
    def alone(self, what: str, console: Console) -> Iterator[bool]:
        """Whether this command makes something of all frames; if not, another one has made it."""
        if self._claims is None:
            yield True
            return
        mine = self._claims.take(what)
        if not mine:
            console.say("Another command that works here makes the report; waiting for it")
        while not mine and self._claims.is_taken(what):
            time.sleep(_LOOK)
            mine = self._claims.is_taken(what) and self._claims.take(what)  # if it is gone
        try:
            yield mine
        finally:
            if mine:
                self._claims.give_back(what)

    def left(self, console: Console) -> list[Order]:
        """Waits for frames that other commands do; returns those that they left."""
        if self._elsewhere:
            console.say(f"{len(self._elsewhere)} frames are under way elsewhere; waiting for them")
        taken: list[Order] = []
        while self._elsewhere and not taken:
            time.sleep(_LOOK)
            waiting, self._elsewhere = self._elsewhere, []
            taken = [order for order in waiting if self.take(order)]
        return taken


def _changed(
    orders: list[Order],
    start: Callable[[str], None],
    end: Callable[[Order, Finished | Failed], None],
) -> list[Order]:
    """Orders that must be done again; the others end as they are."""

    def look(order: Order) -> Finished | None:
        try:
            record = order.kept()
        except InputError:  # whoever does it will say so
            return None
        return finished_before(record) if isinstance(record, Record) else None

    changed = []
    pool = ThreadPoolExecutor(cores())
    try:
        for order, kept in zip(orders, pool.map(look, orders), strict=True):
            start(order.name)
            if kept is None:
                changed.append(order)
            else:
                end(order, kept)
    finally:
        pool.shutdown(cancel_futures=True)
    return changed


def pages_of(running: Running, count: int) -> int:
    """How many pages are written for a sequence of `count` frames, at most."""
    if running.pages is not None:
        return running.pages
    return min(_PAGES, count // _FRAMES_A_PAGE)


def _compare(orders: list[Order], recipe: Recipe, console: Console) -> list[str]:
    """Writes the pages of the worst frames; returns why some could not be written."""
    failed = []
    with console.progress("comparing", len(orders)) as start:
        for order in orders:
            start(order.name)
            assert order.job is not None
            page = order.job.folder / page_name(order.output[0].name)
            with suppress(OSError):
                if page.stat().st_mtime >= order.output[0].stat().st_mtime:
                    continue
            failed.append(write_page(order, page))
    return [reason for reason in failed if reason]


def write_page(order: Order, page: Path) -> str:
    """Writes the page about one frame; a failure is printed, and ends nothing."""
    try:
        order.recipe.compare(order.show.read(order.moment, repair=True), page)
    except (InputError, OSError, MemoryError) as error:
        reason = f"{page}: no page, '{joined(str(error))}'"
        complain(reason)
        return reason
    return ""


def orders_of(
    show: Show,
    outputs: Sequence[Files],
    recipe: Recipe,
    writing: Writing,
    job: Job | None = None,
) -> list[Order]:
    """One for each moment of a show, whose results go to `outputs`."""
    return [
        Order(show.some([place]), output, recipe, writing, job)
        for place, output in enumerate(outputs)
    ]


def figures_of_all(
    orders: Sequence[Order], crew: Crew | None, console: Console, what: str
) -> list[dict[str, Any]]:
    """Does all orders, and returns their figures, in order; the first that fails ends it.

    Parameters
    ----------
    orders, crew, console
        As for `do_all`.
    what
        It, in one word for the progress bar.

    Returns
    -------
    figures
        Of each.

    Raises
    ------
    InputError
        If one cannot be done.
    """
    ended: dict[Order, Finished] = {}

    def end(order: Order, outcome: Finished | Failed) -> None:
        if isinstance(outcome, Failed):
            raise InputError(outcome.reason)
        ended[order] = outcome

    with console.progress(what, len(orders)) as start:
        do_all(orders, crew, start, end, console)
    return [ended[order].figures for order in orders]


def do_all(
    orders: Sequence[Order],
    crew: Crew | None,
    start: Callable[[str], None],
    end: Callable[[Order, Finished | Failed], None],
    console: Console,
    take: Callable[[Order], bool] = lambda order: True,
) -> None:
    """Do each order, in this process if there is no crew.

    Parameters
    ----------
    orders, crew
        Which, and who does them.
    start, end
        Called with the name of each that is begun, and as each is done.
    console
        Where messages about the crew go.
    take
        Called before each is begun: whether it is to be done.

    Raises
    ------
    InputError
        As for `Recipe.work` and `in_cluster`.
    """

    def begin(order: Order) -> None:
        start(order.moment[0].name)

    if not orders:
        return
    if crew is None:
        alone(filter(take, orders), orders[0].recipe.work(console.note), begin, end)
        return
    from domesim.shows.cluster import in_cluster  # noqa: PLC0415 - for workers only

    console.say(_crew_in_words(crew))
    in_cluster(orders, crew, begin, end, console.say, take=take)


def crew_of(running: Running, recipe: Recipe, show: Show) -> Crew | None:
    """Returns the crew of a show; None if the command itself does the frames.

    Raises
    ------
    InputError
        If what is asked for cannot be.
    """
    needed = tuple(sorted(recipe.resources().items()))
    if not 0 <= running.frame_timeout < inf:
        raise InputError(
            f"--frame-timeout must be at least 0 (0 for never), got {running.frame_timeout:g}"
        )
    limit = running.frame_timeout or None
    if running.scheduler is not None:
        if running.workers is not None or running.threads is not None:
            raise InputError(
                "--scheduler has workers of its own; leave --workers and --threads out"
            )
        return Crew(scheduler=running.scheduler, resources=needed, limit=limit)
    for name, number, least in (("workers", running.workers, 0), ("threads", running.threads, 1)):
        if number is not None and number < least:
            raise InputError(f"--{name} must be at least {least}, got {number}")
    count = len(show.moments)
    if running.workers == 0 or (running.workers is None and count == 1):
        return None
    workers = running.workers
    if workers is None:
        # One GPU, unless a person knows of more
        workers = 1 if needed else min(cores(), count, _room(recipe, show))
    share = max(1, cores() // workers)
    return Crew(workers, running.threads or share, resources=needed, limit=limit)


def _room(recipe: Recipe, show: Show) -> int:
    """Number of frames that fit in memory at once; at least one."""
    need = needed_memory(recipe, show)
    return cores() if need is None else max(1, int(_SPARE * free_memory() / need))


def _tell_size(show: Show, recipe: Recipe, console: Console) -> None:
    """Warns if a frame needs more memory than is free."""
    need, free = needed_memory(recipe, show), free_memory()
    if need is not None and need > free:
        console.say(
            f"{show.moments[0][0].name}: a frame of this size needs about {sized(need)} of memory, "
            f"of which {sized(free)} are free"
        )


def needed_memory(recipe: Recipe, show: Show) -> int | None:
    """Estimates the bytes that a worker needs by a frame's header; None if none is readable."""
    for moment in show.moments[:3]:
        with suppress(InputError):
            return recipe.memory(*size_of(moment[0]))
    return None


def free_memory() -> int:
    """Returns the memory that this process can still take, bytes."""
    left = address_space() - psutil.Process().memory_info().vms
    return max(0, int(min(psutil.virtual_memory().available, limit_of_group(), left)))


def _crew_in_words(crew: Crew) -> str:
    if crew.scheduler is not None:
        return f"Workers of {crew.scheduler}"
    workers = "1 worker" if crew.workers == 1 else f"{crew.workers} workers"
    return f"{workers}, {crew.threads} of {cores()} cores each"


def _settings(
    show: Show, folder: Path, output: Files, recipe: Recipe, writing: Writing
) -> dict[str, Any]:
    """Returns the settings that results depend on."""
    colour = show.colour
    return {
        **recipe.settings(),
        "domesim": program_of(recipe),
        # From the results, so that both may be moved together
        "masters": [os.path.relpath(source, folder) for source in show.sources],
        "packing": show.packing,
        "layer": show.layer,
        "encoding": [colour.transfer, colour.primaries] if isinstance(colour, ColourTag) else None,
        **asdict(writing),
        "suffix": writing.suffix or output[0].suffix,
    }


@final
class _Telling:
    """Tells what becomes of frames, as they end, and gathers it."""

    def __init__(
        self, console: Console, orders: list[Order], recorded: list[Order], report: Report | None
    ) -> None:
        self._console, self._orders, self._report = console, orders, report
        self._recorded = set(recorded)
        self._ended: dict[Order, Finished | Failed] = {}
        self._described, self._hopeless = "", 0
        self._causes: Counter[str] = Counter()
        self._lock = threading.Lock()

    def end(self, order: Order, outcome: Finished | Failed) -> None:
        """Takes the outcome of one frame; others may end meanwhile."""
        with self._lock:
            self._ended[order] = outcome
            if self._report is not None:
                self._report.add(order, outcome)
            self._tell(order, outcome)

    def _tell(self, order: Order, outcome: Finished | Failed) -> None:
        if isinstance(outcome, Failed):
            # What would fail all frames is printed once, and what fails many alike a few times
            cause = _DIGITS.sub("#", outcome.reason)
            self._causes[cause] += 1
            if self._causes[cause] <= (1 if outcome.hopeless else _ALIKE):
                complain(outcome.reason)
            self._hopeless += outcome.hopeless
            return
        read = outcome.figures.get("read", "")
        if read != self._described:
            self._described = read
            self._console.say(f"{order.name}: {read}")
        if outcome.kept:
            self._console.say(f"{order.name} (done before): {outcome.line}")
            return
        if outcome.again:
            self._console.say(f"{order.name}: done again: {outcome.again}")
        self._console.say(f"{order.name}: {outcome.line}\n  -> {', '.join(map(str, order.output))}")

    def has_all(self, orders: Sequence[Order]) -> bool:
        """Whether each of these has ended, be it well or not."""
        return all(order in self._ended for order in orders)

    def done(self) -> Done:
        """Sums up all frames, in order."""
        done, left = Done(), 0
        for order in self._orders:
            outcome = self._ended.get(order)
            if outcome is None:
                left += order not in self._recorded
                continue
            if isinstance(outcome, Failed):
                done.failed.append(outcome.reason)
                continue
            done.frames.append(outcome.figures)
            done.kept += outcome.kept
            for step in STEPS:
                done.seconds[step] += outcome.seconds.get(step, 0.0) if not outcome.kept else 0.0
        for cause, count in self._causes.items():
            if count > _ALIKE and not self._hopeless:
                complain(f"{count - _ALIKE} more like it: {cause}")
        lines = []
        if left:
            lines = [f"{left} of {len(self._orders)} frames were not begun after that"]
            done.failed += lines
        if self._hopeless > 1:
            lines.append(f"{self._hopeless - 1} under way failed likewise")
        if lines:
            complain(f"{', and '.join(lines)}; the same command goes on with them")
        return done

    def interrupted(self, job: Job, running: Running) -> None:
        """Sums up a run that ends early."""
        if self._report is not None:
            self._report.interrupt()
        count = sum(job.recorded(order.output for order in self._orders))
        if count:
            complain(
                f"{count} of {len(self._orders)} frames are done; the same command goes on with "
                f"the rest{' without --anew' if running.anew else ''}"
            )
