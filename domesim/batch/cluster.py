"""Frames in other processes: workers of Dask, on this machine or wherever a scheduler has some.

Each worker does one frame at a time, start to end, and sends back figures only: masters and results
stay on the disk that all share. No more frames are handed out than workers are free, so that when
one dies, only its own frame is done again; a frame that kills worker after worker is given up, and
the others go on.
"""

from __future__ import annotations

import contextlib
import logging
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from queue import Empty, SimpleQueue
from typing import Any, TypeAlias, final

from domesim.batch.job import versions
from domesim.batch.work import Failed, Finished, Order, Recipe, Steps
from domesim.errors import InputError
from domesim.frames.messages import joined
from domesim.frames.reading import use_threads
from domesim.strips import threads

Client: TypeAlias = Any
Future: TypeAlias = Any
"""Dask's, which are imported late."""

DEATHS = 2
"""Workers that a frame may kill; the next is its last."""

_PATIENCE = 30.0  # s: for a scheduler to answer
_LOOK = 1.0  # s: how often to look for new workers

_TALKERS = ("distributed", "tornado", "asyncio")
"""Whose log messages the command tells in its own words."""


@final
@dataclass(frozen=True)
class Crew:
    """Who does the frames.

    Parameters
    ----------
    workers
        Processes on this machine.
    threads
        Of each.
    scheduler
        Address of a Dask scheduler whose workers are used instead, such as ``tcp://node1:8786``.
    resources
        What each frame needs of a worker, and workers of this machine have: names and amounts, as
        of `Recipe.resources`.
    """

    workers: int = 1
    threads: int = 1
    scheduler: str | None = None
    resources: tuple[tuple[str, float], ...] = ()


def in_cluster(
    orders: Sequence[Order],
    crew: Crew,
    begin: Callable[[Order], None],
    end: Callable[[Order, Finished | Failed], None],
    tell: Callable[[str], None],
    task: Callable[[Order], Finished | Failed] | None = None,
) -> None:
    """Do each frame, in whatever order they end; none is begun after one that is hopeless.

    Parameters
    ----------
    orders
        The frames.
    crew
        Who does them.
    begin, end
        Called as each is handed out, and as each is done.
    tell
        Called with what a person should hear of the workers.
    task
        What a worker does with an order; `do` by default.

    Raises
    ------
    InputError
        If the scheduler cannot be reached, is lost, or its workers lack this program.
    KeyboardInterrupt
        If Ctrl-C was typed; the first lets frames under way end.
    """
    with _client(crew, tell) as client:
        hall = _Hall(client, crew, tell)
        running: dict[str, tuple[Order, Future]] = {}
        ended: SimpleQueue[str] = SimpleQueue()
        waiting = list(reversed(orders))
        cancelled: Counter[Order] = Counter()
        needed = dict(crew.resources) or None
        interrupted = False
        with _ctrl_c(lambda: ended.put("")) as asked, _left_if_broken(client):
            while waiting or running:
                if asked.is_set() and not interrupted:
                    interrupted, waiting = True, []
                    tell(f"Ending the {len(running)} frames under way; Ctrl-C again leaves them")
                    continue
                try:
                    while waiting and len(running) < hall.places():
                        order = waiting.pop()
                        begin(order)
                        future = client.submit(task or do, order, pure=False, resources=needed)
                        running[future.key] = order, future
                        future.add_done_callback(lambda future: ended.put(future.key))
                    try:
                        key = ended.get(timeout=_LOOK)
                    except Empty:
                        hall.require_scheduler()
                        continue
                    if not key:
                        continue
                    order, future = running.pop(key)
                    outcome = _outcome(order, future)
                    if outcome is None:
                        hall.require_scheduler()
                        cancelled[order] += 1
                        if cancelled[order] <= DEATHS:
                            waiting.append(order)
                            continue
                        outcome = Failed(f"{order.moment[0]}: the scheduler keeps cancelling it")
                    if isinstance(outcome, Failed) and outcome.hopeless:
                        waiting = []
                    end(order, outcome)
                except Exception:
                    hall.require_scheduler()  # of which everything else may be a consequence
                    raise
        if interrupted:
            raise KeyboardInterrupt


def do(order: Order) -> Finished | Failed:
    """One frame, in a worker."""
    try:
        with _ONE_AT_A_TIME:
            return _steps(order.recipe).all(order)
    except InputError as error:
        return Failed(f"{order.moment[0]}: {error}")


_ONE_AT_A_TIME = threading.Lock()
"""Frames share what is kept between them; a worker of several threads does one all the same."""


@lru_cache(maxsize=1)
def _steps(recipe: Recipe) -> Steps:
    use_threads(threads())
    return Steps(recipe.work(lambda text: None))


def _outcome(order: Order, future: Future) -> Finished | Failed | None:
    """What became of a frame; None if the scheduler let go of it."""
    from distributed import KilledWorker  # noqa: PLC0415

    if future.status == "finished":
        result: Finished | Failed = future.result()
        return result
    if future.status in ("cancelled", "lost"):
        return None
    error = future.exception()
    if isinstance(error, KilledWorker):
        return Failed(
            f"{order.moment[0]}: given up; {error.allowed_failures + 1} workers died of it, one "
            f"after the other. Too little memory for such frames (fewer --workers need less), or a "
            f"fault in a library"
        )
    told = joined(f"{type(error).__name__}: {error}")
    return Failed(f"{order.moment[0]}: {told}")


@final
class _Hall:
    """The workers that are there."""

    def __init__(self, client: Client, crew: Crew, tell: Callable[[str], None]) -> None:
        self._client, self._crew, self._tell, self._told = client, crew, tell, False
        self._looked, self._places = -_LOOK, 0

    def places(self) -> int:
        """How many frames can be under way."""
        if self._crew.scheduler is None:
            return self._crew.workers
        now = time.monotonic()
        if now - self._looked >= _LOOK:
            self.require_scheduler()
            before = self._places
            with contextlib.suppress(OSError, TimeoutError):
                self._places = self._counted()
            if not self._places and (before or not self._told):
                self._told = True
                needed = " and ".join(f"{name}={least:g}" for name, least in self._crew.resources)
                with_it = f" with {needed}" if needed else ""
                self._tell(f"{self._crew.scheduler} has no workers{with_it}; waiting for them")
            self._looked = now
        return self._places

    def _counted(self) -> int:
        """The scheduler's workers that have what frames need."""
        needed = self._crew.resources
        if not needed:
            return len(self._client.nthreads())
        known = self._client.scheduler_info(n_workers=-1)["workers"].values()
        there = [worker.get("resources", {}) for worker in known]
        return sum(all(each.get(name, 0) >= least for name, least in needed) for each in there)

    def require_scheduler(self) -> None:
        """See that the scheduler is there."""
        if self._client.status != "running":
            raise InputError(
                f"{self._crew.scheduler or 'the scheduler'}: lost it. What is done is kept: the "
                f"same command goes on with the rest"
            )


@contextmanager
def _client(crew: Crew, tell: Callable[[str], None]) -> Iterator[Client]:
    import dask  # noqa: PLC0415
    from distributed import Client, LocalCluster  # noqa: PLC0415

    be_quiet()
    settings = {
        "distributed.scheduler.allowed-failures": DEATHS,
        # Results are figures: there is nothing to spill, and a worker that pauses never goes on
        "distributed.worker.memory.target": False,
        "distributed.worker.memory.spill": False,
        "distributed.worker.memory.pause": False,
        # Looking at each worker a hundred times a second takes a tenth of its core
        "distributed.worker.profile.enabled": False,
        "distributed.admin.tick.interval": "1s",
        "distributed.nanny.pre-spawn-environ": _environment(crew.threads),
    }
    with dask.config.set(settings):
        if crew.scheduler is not None:
            try:
                client = Client(crew.scheduler, timeout=_PATIENCE, set_as_default=False)
            except (OSError, ValueError, TimeoutError) as error:
                raise InputError(
                    f"--scheduler {crew.scheduler}: wanted a Dask scheduler, got "
                    f"'{joined(str(error))}'. Start one (dask scheduler), or leave --scheduler out"
                ) from None
            try:
                _require_alike(client, crew, tell)
                yield client
            finally:
                with contextlib.suppress(TimeoutError):
                    client.close(timeout=1)
            return
        cluster = LocalCluster(
            n_workers=crew.workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
            preload=["domesim.batch.preload"],
            resources=dict(crew.resources),
            memory_limit=None,  # an equal share each would end a worker whose frame needs more
            env=_environment(crew.threads),  # also where the command's own environment says else
        )
        try:
            with Client(cluster, set_as_default=False) as client:
                yield client
        finally:
            # On a busy machine they may take longer; they end with this process at the latest
            with contextlib.suppress(TimeoutError):
                cluster.close(timeout=10)


def be_quiet() -> None:
    """Let Dask print nothing: what goes wrong, the command tells."""
    for name in (*_TALKERS, *logging.root.manager.loggerDict):
        if name.split(".")[0] in _TALKERS:
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _environment(threads: int) -> dict[str, str]:
    """Of workers: one frame's threads, and BLAS within them."""
    single = dict.fromkeys(("MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return {**single, "OMP_NUM_THREADS": str(threads), "PYTHONWARNINGS": "ignore"}


@contextmanager
def _ctrl_c(wake: Callable[[], None]) -> Iterator[threading.Event]:
    """Set at the first Ctrl-C, which would else break off between any two steps; then `wake` is
    called. The second one is an exception as ever.
    """
    asked, before = threading.Event(), signal.getsignal(signal.SIGINT)
    main = threading.current_thread() is threading.main_thread()
    if not main or before is not signal.default_int_handler:
        yield asked
        return

    def note(number: int, frame: Any) -> None:
        signal.signal(signal.SIGINT, before)
        asked.set()
        wake()

    signal.signal(signal.SIGINT, note)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _left_if_broken(client: Client) -> Iterator[None]:
    """Let go of the workers at once if the run breaks off."""
    try:
        yield
    except BaseException:
        with contextlib.suppress(Exception):
            if client.cluster is not None:
                client.cluster.close(timeout=5)
        raise


def _require_alike(client: Client, crew: Crew, tell: Callable[[str], None]) -> None:
    """See that a scheduler's workers have this program."""
    try:
        found = client.run(versions)
    except Exception as error:
        raise InputError(
            f"--scheduler {crew.scheduler}: its workers cannot run domesim "
            f"('{joined(str(error))}'). Install the same domesim there"
        ) from None
    ours = versions()
    for worker, theirs in found.items():
        if theirs.get("domesim") != ours.get("domesim"):
            raise InputError(
                f"--scheduler {crew.scheduler}: wanted workers with domesim "
                f"{ours.get('domesim')}, got {theirs.get('domesim')} at {worker}"
            )
    unlike = {
        f"{name} {theirs.get(name, 'none')}"
        for theirs in found.values()
        for name in {*theirs, *ours}
        if theirs.get(name) != ours.get(name)
    }
    if unlike:
        tell(
            f"workers of {crew.scheduler} have other libraries than this machine "
            f"({', '.join(sorted(unlike))}): the last bits of results may differ"
        )
