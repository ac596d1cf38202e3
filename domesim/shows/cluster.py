"""Frames in other processes: workers of Dask, on this machine or wherever a scheduler has some.

Each worker does one frame at a time, start to end, and sends back figures only: masters and results
stay on the disk that all share. No more frames are handed out than workers are free, so that when
one dies, only its own frame is done again; a frame that kills worker after worker is given up, and
the others go on. A worker that does not get done with a frame ends itself, and so counts as dead.
One that cannot, because it or its machine stands still, is ended when it has been silent as well.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeAlias, final

from domesim.errors import InputError
from domesim.frames.messages import joined
from domesim.frames.reading import use_threads
from domesim.host.console import duration
from domesim.host.endings import heard_by
from domesim.light.strips import threads
from domesim.shows.crew import DEATHS, Client, Crew, client_of
from domesim.shows.work import Failed, Finished, Order, Recipe, Steps

Future: TypeAlias = Any
"""Dask's, which is imported late."""

_LOOK = 1.0  # s: how often to look for new workers
_SETTLING = 1.0  # s: until the client has seen that what went wrong is its scheduler
_GLANCE = 0.02  # s: how often to look meanwhile
_SILENCE = 15.0  # s: that a worker says nothing, not even that it is there, if it stands still
_GOES_ON = "What is done is kept: the same command goes on with the rest"
_ANSWER = 2.0  # s: until a scheduler that works has said how many workers it has
_RESTART = 10.0  # s: for a worker to end


def in_cluster(
    orders: Sequence[Order],
    crew: Crew,
    begin: Callable[[Order], None],
    end: Callable[[Order, Finished | Failed], None],
    tell: Callable[[str], None],
    task: Callable[[Order], Finished | Failed] | None = None,
    take: Callable[[Order], bool] = lambda order: True,
) -> None:
    """Does all frames, in any order; begins none after one that fails for all.

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
    take
        Called before a frame is handed out: whether it is to be done.

    Raises
    ------
    InputError
        If the scheduler cannot be reached, is lost, or its workers lack this program.
    KeyboardInterrupt
        If Ctrl-C was typed, or the like; the first lets frames under way end.
    """
    with client_of(crew, tell) as client:
        hall = _Hall(client, crew, tell)
        desk = _Desk(orders, client, crew, task or partial(do, limit=crew.limit), take)
        interrupted = False
        asked = threading.Event()

        def end_soon() -> None:
            asked.set()
            desk.wake()

        # Ctrl-C would else break off between any two steps
        with heard_by(end_soon), _left_if_broken(client):
            while desk.waiting or desk.running:
                if asked.is_set() and not interrupted:
                    interrupted = True
                    desk.waiting.clear()
                    count = len(desk.running)
                    tell(f"Ending the {count} frames under way; Ctrl-C again leaves them")
                else:
                    _serve(desk, hall, begin, end)
        if interrupted:
            raise KeyboardInterrupt


def _serve(
    desk: _Desk,
    hall: _Hall,
    begin: Callable[[Order], None],
    end: Callable[[Order, Finished | Failed], None],
) -> None:
    """Hands out frames to free workers, and waits a little for one to end."""
    try:
        while desk.waiting and len(desk.running) < hall.places():
            order = desk.next_taken()
            if order is not None:
                begin(order)
                desk.hand_out(order)
        ended = desk.hear()
        if ended is None:
            hall.require_scheduler()
            hall.end_silent(desk.late())
            hall.require_workers()
        elif ended.outcome is None:
            hall.require_scheduler(_SETTLING)
        else:
            end(ended.order, ended.outcome)
    except Exception:
        hall.require_scheduler(_SETTLING)  # everything else may follow from it
        raise


def do(order: Order, limit: float | None = None) -> Finished | Failed:
    """One frame, in a worker, which ends if that takes longer than `limit`, s."""
    try:
        with _ONE_AT_A_TIME, _within(limit):
            return _steps(order.recipe).all(order)
    except InputError as error:
        return Failed(f"{order.moment[0]}: {error}")


_ONE_AT_A_TIME = threading.Lock()
"""Frames share what is kept between them; a worker of several threads does one all the same."""


@lru_cache(maxsize=1)
def _steps(recipe: Recipe) -> Steps:
    use_threads(threads())
    return Steps(recipe.work(lambda text: None))


@contextmanager
def _within(limit: float | None) -> Iterator[None]:
    """End this process after so many seconds, even if a library holds the interpreter."""
    if limit is None:
        yield
        return
    with Path(os.devnull).open("w") as nowhere:  # for where each thread was
        faulthandler.dump_traceback_later(limit, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


@final
@dataclass(frozen=True)
class _Given:
    """A frame that was handed out, and the time, s."""

    order: Order
    future: Future
    time: float


@final
@dataclass(frozen=True)
class _Heard:
    """Outcome of a frame; None if its worker was lost, and it waits again."""

    order: Order
    outcome: Finished | Failed | None


@final
class _Desk:
    """Hands out frames, and collects their outcomes.

    Attributes
    ----------
    waiting
        Frames that nobody does yet, the next one last.
    running
        Those that are under way.
    """

    def __init__(
        self,
        orders: Sequence[Order],
        client: Client,
        crew: Crew,
        task: Callable[[Order], Finished | Failed],
        take: Callable[[Order], bool],
    ) -> None:
        self.waiting = list(reversed(orders))
        self.running: dict[str, _Given] = {}
        self._client, self._crew, self._task, self._take = client, crew, task, take
        self._ended: SimpleQueue[str] = SimpleQueue()
        self._cancelled: Counter[Order] = Counter()

    def wake(self) -> None:
        """Let `hear` come back at once."""
        self._ended.put("")

    def next_taken(self) -> Order | None:
        """Returns the next frame that is to be done, which does not wait any more."""
        while self.waiting:
            order = self.waiting.pop()
            if self._take(order):
                return order
        return None

    def hand_out(self, order: Order) -> None:
        """Hands out a frame."""
        needed = dict(self._crew.resources) or None
        future = self._client.submit(self._task, order, pure=False, resources=needed)
        self.running[future.key] = _Given(order, future, time.monotonic())
        self._listen_to(future)

    def _listen_to(self, future: Future) -> None:
        future.add_done_callback(lambda future: self._ended.put(future.key))

    def late(self) -> set[str]:
        """Frames whose time is up."""
        if self._crew.limit is None:
            return set()
        begun = time.monotonic() - self._crew.limit
        return {key for key, running in self.running.items() if running.time < begun}

    def hear(self) -> _Heard | None:
        """The next that ends; None if none does for a while.

        One that is hopeless leaves none waiting.
        """
        try:
            key = self._ended.get(timeout=_LOOK)
        except Empty:
            return None
        if not key:
            return None
        frame = self.running[key]
        try:
            outcome = self._outcome(frame)
        except TimeoutError:  # its worker died before it gave it away: another does the frame again
            self._listen_to(frame.future)
            return None
        del self.running[key]
        if outcome is None:
            self._cancelled[frame.order] += 1
            if self._cancelled[frame.order] <= DEATHS:
                self.waiting.append(frame.order)
                return _Heard(frame.order, None)
            outcome = Failed(f"{frame.order.moment[0]}: the scheduler keeps cancelling it")
        if isinstance(outcome, Failed) and outcome.hopeless:
            self.waiting.clear()
        return _Heard(frame.order, outcome)

    def _outcome(self, frame: _Given) -> Finished | Failed | None:
        """Outcome of a frame; None if the scheduler has lost it.

        Raises
        ------
        TimeoutError
            If it is done, and nobody has the result yet.
        """
        from distributed import KilledWorker  # noqa: PLC0415

        future = frame.future
        if future.status == "finished":
            result: Finished | Failed = future.result(_LOOK)
            return result
        if future.status in ("cancelled", "lost"):
            return None
        error = future.exception()
        if isinstance(error, KilledWorker):
            return Failed(f"{frame.order.moment[0]}: given up; {self._death(frame, error)}")
        problem = joined(f"{type(error).__name__}: {error}")
        return Failed(f"{frame.order.moment[0]}: {problem}")

    def _death(self, frame: _Given, error: Any) -> str:
        """Why workers died."""
        deaths, limit = error.allowed_failures + 1, self._crew.limit
        if limit is not None and time.monotonic() - frame.time >= deaths * limit:
            return (
                f"{deaths} workers, one after the other, were not done with it after "
                f"{duration(limit)}. If that is too short, raise --frame-timeout"
            )
        return (
            f"{deaths} workers died of it, one after the other. Too little memory for such frames "
            f"(fewer --workers need less), or a fault in a library"
        )


@final
class _Hall:
    """The workers that are there."""

    def __init__(self, client: Client, crew: Crew, tell: Callable[[str], None]) -> None:
        self._client, self._crew, self._tell, self._told = client, crew, tell, False
        self._looked, self._places = -_LOOK, 0
        self._answered, self._silent = time.monotonic(), False
        self._heard: dict[str, tuple[float, float]] = {}

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
                self._answered = time.monotonic()
            silence = time.monotonic() - self._answered
            if silence > _SILENCE and not self._silent:
                self._tell(f"{self._crew.scheduler} has not answered for {silence:.0f} s; waiting")
            self._silent = silence > _SILENCE
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
            # Bounded, so that Ctrl-C is heard meanwhile
            ask = self._client.scheduler.ncores
            return len(self._client.sync(ask, workers=None, callback_timeout=_ANSWER))
        known = self._client.scheduler_info(n_workers=-1)["workers"].values()
        there = [worker.get("resources", {}) for worker in known]
        return sum(all(each.get(name, 0) >= least for name, least in needed) for each in there)

    def end_silent(self, late: set[str]) -> None:
        """Ends workers that do not answer and whose frames' time is up."""
        now, heard, before = time.monotonic(), {}, self._heard
        if late:
            workers = self._client.scheduler_info(n_workers=-1)["workers"]
            for address, keys in self._client.processing().items():
                if address in workers and not late.isdisjoint(keys):
                    seen = workers[address]["last_seen"]  # by another machine's clock
                    known = before.get(address)
                    heard[address] = known if known and known[0] == seen else (seen, now)
        self._heard = heard
        silent = [each for each, (_, since) in heard.items() if now - since >= _SILENCE]
        if silent:
            self._client.sync(
                self._client.scheduler.restart_workers,
                workers=silent,
                timeout=_RESTART,
                wait_for_workers=False,
                on_error="return",
                stimulus_id="domesim-silent",
            )

    def require_workers(self) -> None:
        """See that this machine has a worker left: one that died, and stayed away, is given up."""
        if self._client.cluster is not None and not self._client.cluster.workers:
            raise InputError(
                f"wanted {self._crew.workers} workers, got none: they died, and did not start "
                f"again. {_GOES_ON}; fewer --workers need less memory"
            )

    def require_scheduler(self, patience: float = 0.0) -> None:
        """See that the scheduler is there, and that the client still thinks so after `patience`, s.

        It may be told of frames and calls that broke off before it has seen why.
        """
        sure = time.monotonic() + patience
        while self._client.status == "running":
            if time.monotonic() >= sure:
                return
            time.sleep(_GLANCE)
        raise InputError(f"{self._crew.scheduler or 'the scheduler'}: lost it. {_GOES_ON}")


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
