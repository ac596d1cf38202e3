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
from distributed import Worker

logging.disable()


async def work(address, count):
    workers = [Worker(address, nthreads=1, heartbeat_interval="30s") for _ in range(count)]
    await asyncio.gather(*workers)
    await asyncio.gather(*(worker.finished() for worker in workers))


asyncio.run(work(sys.argv[1], int(sys.argv[2])))
"""


@contextmanager
def crowd(address: str, count: int) -> Iterator[None]:
    """Very many workers in one process: enough to keep a scheduler busy, not to do much."""
    process = subprocess.Popen([sys.executable, "-c", CROWD, address, str(count)], **QUIET)
    try:
        yield
    finally:
        process.kill()
        process.wait()
