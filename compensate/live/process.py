"""A resident process: frames in, compensated frames out.

Three threads have a frame each: one reads, one compensates, one writes. The next frame is read
when the last begins to be compensated, so that none waits for longer than one other takes; and
whoever sends frames waits while all three threads are busy.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from queue import Empty, Full, Queue
from typing import Any, TypeAlias, final

import numpy as np

from domesim.errors import InputError

Compensate: TypeAlias = Callable[[Any, int], Any]
"""Frame as it was read and its number -> the frame to write."""

_WAIT = 0.2  # seconds between looks at whether anybody still listens
_KEPT = 100_000  # latencies


@final
class _Gone(Exception):
    """Whoever reads what is written has gone."""


@final
@dataclass
class Told:
    """What became of the frames.

    Parameters
    ----------
    frames, dropped
        How many were written, and left out because newer ones had come.
    seconds
        From the first frame that was read to the last that was written.
    latencies
        Seconds from a frame read to the same frame written, of the last ones.
    """

    frames: int = 0
    dropped: int = 0
    seconds: float = 0.0
    latencies: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT))

    def figures(self, fps: float | None) -> dict[str, Any]:
        """For a program; latencies in frames if the stream's rate is known."""
        found: dict[str, Any] = {"frames": self.frames, "dropped": self.dropped}
        if not self.frames:
            return found
        latencies = np.array(self.latencies)
        found["fps"] = self.frames / max(self.seconds, 1e-9)
        found["latency_ms"] = {
            "median": float(np.median(latencies) * 1e3),
            "p99": float(np.quantile(latencies, 0.99) * 1e3),
            "largest": float(latencies.max() * 1e3),
        }
        if fps is not None:
            found["latency_frames"] = float(np.median(latencies) * fps)
        return found


def read_exactly(source: int, wanted: int, sink: int | None = None) -> bytearray:
    """That many bytes of a file descriptor; fewer only at its end.

    Raises
    ------
    _Gone
        If nobody reads `sink` any more.
    """
    data = bytearray(wanted)
    view, got = memoryview(data), 0
    poll = select.poll()
    poll.register(source, select.POLLIN)
    if sink is not None:
        poll.register(sink, 0)  # errors only
    while got < wanted:
        ready = dict(poll.poll(_WAIT * 1e3))
        if sink is not None and ready.get(sink, 0) & (select.POLLERR | select.POLLHUP):
            raise _Gone
        if source not in ready:
            continue
        count = os.readv(source, [view[got:]])
        if not count:
            return data[:got]
        got += count
    return data


def read_line(source: int, longest: int, sink: int | None = None) -> bytes:
    """Bytes up to the next end of a line, which is taken off, or to the end; see `read_exactly`."""
    line = bytearray()
    while len(line) < longest:
        byte = read_exactly(source, 1, sink)
        if byte in (b"", b"\n"):
            break
        line += byte
    return bytes(line)


def stream(
    frames: Iterator[Any],
    compensate: Compensate,
    sink: int,
    *,
    drop: bool = False,
    head: Callable[[Any], list[Any]] = lambda frame: [frame],
) -> Told:
    """Compensate frames until there are no more.

    Parameters
    ----------
    frames
        Reads them, one after the other.
    compensate
        Makes what `head` takes; one at a time.
    sink
        File descriptor that they go to.
    drop
        Leave out frames that wait while a newer one has come; else whoever sends them waits.
    head
        The buffers to write of a frame, which nothing changes any more.

    Raises
    ------
    InputError
        If a frame cannot be read, or nobody reads the results any more.
    """
    told = Told()
    came: Queue[Any] = Queue(1)
    made: Queue[Any] = Queue(1)
    room = threading.Semaphore(1)
    stop = threading.Event()
    errors: list[BaseException] = []

    def put(queue: Queue[Any], item: Any) -> None:
        while not stop.is_set():
            try:
                queue.put(item, timeout=_WAIT)
            except Full:
                continue
            return

    def get(queue: Queue[Any]) -> Any:
        while not stop.is_set():
            try:
                return queue.get(timeout=_WAIT)
            except Empty:
                continue
        return None

    def guarded(work: Callable[[], None]) -> Callable[[], None]:
        def run() -> None:
            try:
                work()
            except BaseException as error:  # noqa: BLE001 - the main thread raises it
                errors.append(error)
                stop.set()

        return run

    def read() -> None:
        while not stop.is_set():
            if not drop and not room.acquire(timeout=_WAIT):
                continue
            frame = next(frames, None)
            if drop and frame is not None:
                with contextlib.suppress(Empty):
                    came.get_nowait()
                    told.dropped += 1
            put(came, None if frame is None else (time.perf_counter(), frame))
            if frame is None:
                return

    def write() -> None:
        first = None
        while (item := get(made)) is not None:
            read_at, buffers = item
            for buffer in buffers:
                _write_all(sink, buffer)
            now = time.perf_counter()
            first = read_at if first is None else first
            told.frames += 1
            told.seconds = now - first
            told.latencies.append(now - read_at)

    threads = [
        threading.Thread(target=guarded(work), name=f"domesim-live-{work.__name__}", daemon=True)
        for work in (read, write)
    ]
    for thread in threads:
        thread.start()
    try:
        number = 0
        while (item := get(came)) is not None:
            room.release()
            read_at, frame = item
            found = compensate(frame, number)
            number += 1
            put(made, (read_at, head(found)))
        put(made, None)
        if not stop.is_set():
            threads[1].join()
    except BaseException:
        stop.set()
        raise
    for error in errors:
        if isinstance(error, _Gone | BrokenPipeError):
            raise InputError(
                f"standard output: whoever read the frames has gone, after {told.frames} of them"
            ) from None
        raise error
    return told


def _write_all(sink: int, buffer: Any) -> None:
    view = memoryview(buffer).cast("B")
    done = 0
    while done < len(view):
        done += os.write(sink, view[done:])
