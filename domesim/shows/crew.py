"""Workers of Dask: processes of this machine, or those that a scheduler has elsewhere."""

from __future__ import annotations

import contextlib
import logging
import socket
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from ipaddress import ip_address
from multiprocessing import active_children, get_context
from typing import Any, TypeAlias, final

from domesim.errors import InputError, reason
from domesim.frames.messages import joined
from domesim.host.console import complain
from domesim.host.endings import ignored
from domesim.host.memory import KEEPS_FREED_MEMORY
from domesim.host.system import require_handles
from domesim.shows.job import versions

Client: TypeAlias = Any
"""Dask's, which is imported late."""

DEATHS = 2
"""Workers that a frame may kill; the next is its last."""

_PATIENCE = 30.0  # s: for a scheduler to answer
_ANSWER = 10.0  # s: for one that is just being started to say that it is one
_LOST = "5 minutes"  # for a worker that died to be there again, on a busy machine
_HANDLES = 10  # of files that the command has open for each worker; of its own they are 21

_TALKERS = ("distributed", "tornado", "asyncio")
"""Loggers whose messages the command prints in its own words."""


@final
@dataclass(frozen=True)
class Crew:
    """Who does the frames.

    Parameters
    ----------
    workers
        Processes on this machine.
    threads
        Threads of each worker.
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
    limit: float | None = None


@contextmanager
def client_of(crew: Crew, tell: Callable[[str], None]) -> Iterator[Client]:
    """Opens a client of a crew; workers of its own end with it; calls `tell` of differences.

    Raises
    ------
    InputError
        If the scheduler cannot be reached, its workers lack this program, or this machine cannot
        have so many.
    """
    import dask  # noqa: PLC0415
    from distributed import Client  # noqa: PLC0415

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
        "distributed.deploy.lost-worker-timeout": _LOST,
        "distributed.nanny.pre-spawn-environ": _environment(crew.threads),
    }
    with dask.config.set(settings):
        if crew.scheduler is not None:
            require_dask(crew.scheduler)
            client = Client(crew.scheduler, timeout=_PATIENCE, set_as_default=False)
            try:
                _require_alike(client, crew, tell)
                yield client
            finally:
                with contextlib.suppress(TimeoutError):
                    client.close(timeout=1)
            return
        with _own_workers(crew) as client:
            yield client


@contextmanager
def _own_workers(crew: Crew) -> Iterator[Client]:
    """Client of workers on this machine."""
    from distributed import Client, LocalCluster  # noqa: PLC0415

    with contextlib.ExitStack() as stack:
        stack.callback(_end_workers)
        try:
            _require_handles(crew.workers)
            _require_locks()
            cluster = LocalCluster(
                n_workers=crew.workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
                preload=["domesim.shows.preload"],
                resources=dict(crew.resources),
                memory_limit=None,  # an equal share each would end one whose frame needs more
                env=_environment(crew.threads),  # also where the command's own says else
            )
            stack.callback(_close, cluster)
            client = stack.enter_context(Client(cluster, set_as_default=False))
        except Exception as error:
            raise InputError(
                f"wanted {crew.workers} workers, got '{_cause(error)}'. Choose fewer (--workers), "
                f"or do the frames without any (--workers 0)"
            ) from None
        yield client


def _require_handles(workers: int) -> None:
    """Refuses more workers than there are file handles for: they would wait forever."""
    needed = _HANDLES * (workers + _HANDLES)
    require_handles(needed)


def _require_locks() -> None:
    """Refuses workers whose locks the system cannot make."""
    try:
        with ignored():  # by the process that looks after them, and ends with the command
            get_context("spawn").Lock()
    except OSError as error:
        raise OSError(error.errno, f"{reason(error)} at /dev/shm") from None


def _end_workers() -> None:
    """Ends workers that did not end when asked: Python would wait for them."""
    for process in active_children():
        if process.name.startswith("Dask Worker"):
            process.kill()


def _close(cluster: Any) -> None:
    # On a busy machine they may take longer
    with contextlib.suppress(TimeoutError):
        cluster.close(timeout=10)


def _cause(error: BaseException) -> str:
    """First cause of an error."""
    while error.__cause__ is not None:
        error = error.__cause__
    return (reason(error) if isinstance(error, OSError) else joined(str(error))) or "no answer"


def require_dask(address: str) -> None:
    """See that a scheduler is there, and tell a person who else may be.

    Raises
    ------
    InputError
        If it does not answer, or not as Dask's do.
    """
    import asyncio  # noqa: PLC0415 - as Dask's own

    from distributed.comm import connect, get_address_host_port  # noqa: PLC0415
    from distributed.security import Security  # noqa: PLC0415

    async def greet() -> None:
        arguments = Security().get_connection_args("client")
        comm = await asyncio.wait_for(connect(address, timeout=_ANSWER, **arguments), _ANSWER + 1)
        await comm.close()

    try:
        host, port = get_address_host_port(address, strict=True)
        addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        near = all(ip_address(place[0]).is_loopback for *_, place in addresses)
        # In a thread of its own: whoever calls may be in a loop, as a notebook is
        with ThreadPoolExecutor(1) as apart:
            apart.submit(lambda: asyncio.run(greet())).result()
    except Exception as error:  # Dask's own are of many kinds
        way = "Start one (dask scheduler), or leave --scheduler out"
        if address.startswith("tls:"):
            way += ". For tls:// name the certificates (docs/shows.md)"
        raise InputError(
            f"--scheduler {address}: wanted a Dask scheduler, got '{_cause(error)}'. {way}"
        ) from None
    if not near and not address.startswith("tls:"):
        complain(
            f"--scheduler {address}: it has no TLS. Whoever reaches it can run programs on all of "
            f"its machines: keep it in a private network, or use tls:// (docs/shows.md)"
        )


def be_quiet() -> None:
    """Silences Dask: the command reports what goes wrong."""
    for name in (*_TALKERS, *logging.root.manager.loggerDict):
        if name.split(".")[0] in _TALKERS:
            logging.getLogger(name).setLevel(logging.CRITICAL)
    warnings.filterwarnings("ignore", "Creating scratch directories")  # on a busy machine


def _environment(threads: int) -> dict[str, str]:
    """Environment of workers: threads of one frame, BLAS within them, and memory for the next."""
    single = dict.fromkeys(("MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    own = {"OMP_NUM_THREADS": str(threads), "PYTHONWARNINGS": "ignore"}
    return {**single, **KEEPS_FREED_MEMORY, **own}


def _require_alike(client: Client, crew: Crew, tell: Callable[[str], None]) -> None:
    """See that a scheduler's workers have this program."""
    try:
        known = client.run(versions)
    except Exception as error:
        raise InputError(
            f"--scheduler {crew.scheduler}: its workers cannot run domesim "
            f"('{joined(str(error))}'). Install the same domesim there"
        ) from None
    ours = versions()
    for worker, theirs in known.items():
        if theirs.get("domesim") != ours.get("domesim"):
            raise InputError(
                f"--scheduler {crew.scheduler}: wanted workers with domesim "
                f"{ours.get('domesim')}, got {theirs.get('domesim')} at {worker}"
            )
    unlike = {
        f"{name} {theirs.get(name, 'none')}"
        for theirs in known.values()
        for name in {*theirs, *ours}
        if theirs.get(name) != ours.get(name)
    }
    if unlike:
        tell(
            f"workers of {crew.scheduler} have other libraries than this machine "
            f"({', '.join(sorted(unlike))}): the last bits of results may differ"
        )
