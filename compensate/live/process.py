"""A resident process: frames in, compensated frames out.

Three threads have a frame each: one reads, one compensates, one writes. The next frame is read
when the last begins to be compensated, so that none waits for longer than one other takes; and
whoever sends frames waits while all three threads are busy.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from queue import Empty, Full, Queue
from typing import Any, TypeAlias, final

import numpy as np

from domesim.errors import InputError
from domesim.host import system

Compensate: TypeAlias = Callable[[Any, int], Any]
"""Frame as it was read and its number -> the frame to write."""

_WAIT = 0.2  # seconds between looks at whether anybody still listens
_KEPT = 100_000  # latencies
_PIPE = 1 << 20  # bytes of a pipe: the most that Linux lets anybody have; 64 kB are usual
HELD = 3
"""Frames that are under way at once on either side: read or written, waiting, and computed."""


@final
class _GoneError(Exception):
    """Whoever reads what is written has gone."""


@final
@dataclass
class Report:
    """What became of the frames.

    Parameters
    ----------
    frames, dropped
        How many were written, and left out because newer ones had come.
    seconds, busy
        Until the last frame was written: by the clock from the first that was read, and of all
        cores by this process.
    size
        Bytes of a frame that was written.
    latencies
        Seconds from a frame read to the same frame written, of the last ones.
    """

    frames: int = 0
    dropped: int = 0
    seconds: float = 0.0
    busy: float = 0.0
    size: int = 0
    latencies: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT))

    def figures(self, fps: float | None) -> dict[str, Any]:
        """Returns figures for a program; latencies in frames if the stream's rate is known.

        `core_ms` is what a frame took of all cores, and `copies` how often it could be copied.
        """
        figures: dict[str, Any] = {"frames": self.frames, "dropped": self.dropped}
        if not self.frames:
            return figures
        latencies = np.array(self.latencies)
        figures["fps"] = self.frames / max(self.seconds, 1e-9)
        seconds = self.busy / self.frames
        figures["core_ms"] = seconds * 1e3
        figures["copies"] = seconds / copying(self.size)
        figures["latency_ms"] = {
            "median": float(np.median(latencies) * 1e3),
            "p99": float(np.quantile(latencies, 0.99) * 1e3),
            "largest": float(latencies.max() * 1e3),
        }
        if fps is not None:
            figures["latency_frames"] = float(np.median(latencies) * fps)
        return figures


def copying(size: int) -> float:
    """Seconds to copy that many bytes in memory: the median of some times."""
    source, place = np.ones(size, np.uint8), np.ones(size, np.uint8)
    times = []
    for _ in range(15):
        begin = time.perf_counter()
        np.copyto(place, source)
        times.append(time.perf_counter() - begin)
    return max(float(np.median(times)), 1e-9)


def read_into(source: int, view: memoryview, sink: int | None = None) -> int:
    """Fills a buffer from a file descriptor.

    Parameters
    ----------
    source
        The file descriptor.
    view
        The buffer.
    sink
        File descriptor of the results: reading ends if nobody reads them any more.

    Returns
    -------
    count
        Bytes that came: fewer than the buffer takes only at the end.

    Raises
    ------
    _GoneError
        If nobody reads `sink` any more.
    """
    got = 0
    while got < len(view):
        come, gone = system.ready(source, sink, _WAIT)
        if gone:
            raise _GoneError
        if not come:
            continue
        count = system.filled(source, view[got:])
        if not count:
            break
        got += count
    return got


def read_exactly(source: int, count: int, sink: int | None = None) -> bytearray:
    """Reads bytes of a file descriptor.

    Parameters
    ----------
    source, sink
        As for `read_into`.
    count
        How many bytes.

    Returns
    -------
    data
        Fewer bytes only at the end.
    """
    data = bytearray(count)
    with memoryview(data) as view:
        got = read_into(source, view, sink)
    return data[:got]


def widen(*pipes: int) -> None:
    """Lets pipes hold more, so that a frame takes fewer turns; others stay as they are."""
    for pipe in pipes:
        system.widen(pipe, _PIPE)


def read_line(source: int, longest: int, sink: int | None = None) -> bytes:
    """Reads bytes of a file descriptor up to the next end of a line, or to the end.

    Parameters
    ----------
    source, sink
        As for `read_into`.
    longest
        Bytes at most.

    Returns
    -------
    line
        The bytes without the end of the line.
    """
    line = bytearray()
    while len(line) < longest:
        byte = read_exactly(source, 1, sink)
        if bytes(byte) in (b"", b"\n"):
            break
        line += byte
    return bytes(line)


def stream(
    frames: Iterator[Any],
    compensate: Compensate,
    sink: int | Callable[[Any], None],
    *,
    drop: bool = False,
    head: Callable[[Any], list[Any]] = lambda frame: [frame],
) -> Report:
    """Compensates frames until there are no more.

    Parameters
    ----------
    frames
        Reads them, one after the other.
    compensate
        Makes what `head` takes, of a frame and its number among those that came, from 0; one at a
        time.
    sink
        File descriptor that they go to, or what takes a buffer.
    drop
        Leaves out frames that wait while a newer one has come; else the sender waits.
    head
        The buffers to write of a frame, which nothing changes while `HELD` - 1 more are made.

    Returns
    -------
    report
        What became of the frames.

    Raises
    ------
    InputError
        If a frame cannot be read, or nobody reads the results any more.
    """
    line = _Line(frames, sink, drop)
    for thread in line.threads:
        thread.start()
    try:
        while (item := line.get(line.came)) is not None:
            line.room.release()
            read_at, frame, number = item
            line.put(line.made, (read_at, head(compensate(frame, number))))
        line.put(line.made, None)
        line.threads[1].join()
    finally:
        line.stop.set()
    for error in line.errors:
        if isinstance(error, _GoneError | BrokenPipeError):
            raise InputError(
                f"standard output: whoever read the frames has gone, after {line.report.frames} of "
                f"them"
            ) from None
        raise error
    return line.report


@final
class _Line:
    """What the threads of a stream share: one that reads, one that writes, and whoever computes."""

    def __init__(
        self, frames: Iterator[Any], sink: int | Callable[[Any], None], drop: bool
    ) -> None:
        self._frames, self._drop = frames, drop
        self._send = partial(_write_all, sink) if isinstance(sink, int) else sink
        self._begun = time.process_time()
        self.report = Report()
        self.came: Queue[Any] = Queue(1)
        self.made: Queue[Any] = Queue(1)
        self.room = threading.Semaphore(1)
        self.stop = threading.Event()
        self.errors: list[BaseException] = []
        self.threads = [
            threading.Thread(
                target=self._guarded, args=(work,), name=f"domesim-live-{name}", daemon=True
            )
            for name, work in (("reads", self._read), ("writes", self._write))
        ]

    def put(self, queue: Queue[Any], item: Any) -> None:
        """Wait for a place, unless it is over."""
        while not self.stop.is_set():
            with contextlib.suppress(Full):
                queue.put(item, timeout=_WAIT)
                return

    def get(self, queue: Queue[Any]) -> Any:
        """Wait for something; None if it is over."""
        while not self.stop.is_set():
            with contextlib.suppress(Empty):
                return queue.get(timeout=_WAIT)
        return None

    def _guarded(self, work: Callable[[], None]) -> None:
        """Errors go to the main thread, which raises them."""
        try:
            work()
        except BaseException as error:
            self.errors.append(error)
            self.stop.set()

    def _read(self) -> None:
        number = 0
        while not self.stop.is_set():
            if not self._drop and not self.room.acquire(timeout=_WAIT):
                continue
            try:
                frame = next(self._frames, None)
            except InputError as error:  # told when those that came before have gone out
                self.errors.append(error)
                self.put(self.came, None)
                return
            if self._drop and frame is not None:
                with contextlib.suppress(Empty):
                    self.came.get_nowait()
                    self.report.dropped += 1
            self.put(self.came, None if frame is None else (time.perf_counter(), frame, number))
            if frame is None:
                return
            number += 1

    def _write(self) -> None:
        first = None
        while (item := self.get(self.made)) is not None:
            read_at, buffers = item
            for buffer in buffers:
                self._send(buffer)
            now = time.perf_counter()
            first = read_at if first is None else first
            self.report.frames += 1
            self.report.seconds = now - first
            self.report.busy = time.process_time() - self._begun
            self.report.size = sum(memoryview(buffer).nbytes for buffer in buffers)
            self.report.latencies.append(now - read_at)


def _write_all(sink: int, buffer: Any) -> None:
    view = memoryview(buffer).cast("B")
    done = 0
    while done < len(view):
        done += os.write(sink, view[done:])
