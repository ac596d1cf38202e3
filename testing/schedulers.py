"""A Dask scheduler on loopback, in a process of its own, with workers in others."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

DASK = "import runpy, sys; runpy.run_module('distributed.cli.' + sys.argv.pop(1), None, '__main__')"


QUIET: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


@contextmanager
def scheduler(workers: int) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Its address, and its process."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    command = ["dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    head = subprocess.Popen([sys.executable, "-c", DASK, *command], **QUIET)
    try:
        with more_workers(address, *[""] * workers):
            yield address, head
    finally:
        head.kill()
        head.wait()


@contextmanager
def more_workers(address: str, *resources: str) -> Iterator[list[int]]:
    """One for each of the `resources`, such as "GPU=1"; the numbers of their processes."""
    # Without a nanny, so that the process that is started is the one that works
    command = ["dask_worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", DASK, *command, *(["--resources", each] if each else [])],
            **QUIET,
        )
        for each in resources
    ]
    try:
        yield [process.pid for process in processes]
    finally:
        for process in processes:
            process.kill()
            process.wait()


CROWD = """
import asyncio, logging, sys
import dask
from distributed import Worker

logging.disable()
dask.config.set({
    # What each does many times a second to watch itself, and web pages
    "distributed.admin.tick.interval": "10s",
    "distributed.admin.system-monitor.interval": "60s",
    "distributed.worker.profile.enabled": False,
    "distributed.worker.http.routes": [],
    "distributed.comm.timeouts.connect": "120s",
})


async def work(address, count):
    workers = [
        Worker(address, nthreads=1, heartbeat_interval="30s", memory_limit=0, dashboard=False)
        for _ in range(count)
    ]
    for k in range(0, count, 10):
        await asyncio.gather(*workers[k : k + 10])
    await asyncio.gather(*(worker.finished() for worker in workers))


asyncio.run(work(sys.argv[1], int(sys.argv[2])))
"""

A_PROCESS = 250
"""Workers of `crowd` that share a process: it then has 84 MiB, and a thread for each at work."""


@contextmanager
def crowd(address: str, count: int) -> Iterator[None]:
    """Very many workers in few processes, all there: they keep a scheduler busy, but do little."""
    from distributed import Client  # noqa: PLC0415

    shares = [min(A_PROCESS, count - k) for k in range(0, count, A_PROCESS)]
    processes = [
        subprocess.Popen([sys.executable, "-c", CROWD, address, str(share)], **QUIET)
        for share in shares
    ]
    try:
        with Client(address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=300)
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()
