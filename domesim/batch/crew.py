"""Workers of Dask: processes of this machine, or those that a scheduler has elsewhere."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Any, TypeAlias, final

from domesim.batch.job import versions
from domesim.endings import ignored
from domesim.errors import InputError
from domesim.frames.messages import joined

Client: TypeAlias = Any
"""Dask's, which is imported late."""

DEATHS = 2
"""Workers that a frame may kill; the next is its last."""

_PATIENCE = 30.0  # s: for a scheduler to answer

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
    limit: float | None = None


@contextmanager
def client_of(crew: Crew, tell: Callable[[str], None]) -> Iterator[Client]:
    """Who hands work to a crew, whose own workers end with it; `tell` is told of differences.

    Raises
    ------
    InputError
        If the scheduler cannot be reached, or its workers lack this program.
    """
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
        with ignored():
            resource_tracker.ensure_running()  # it ends with the last of its processes
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
    warnings.filterwarnings("ignore", "Creating scratch directories")  # on a busy machine


def _environment(threads: int) -> dict[str, str]:
    """Of workers: one frame's threads, and BLAS within them."""
    single = dict.fromkeys(("MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return {**single, "OMP_NUM_THREADS": str(threads), "PYTHONWARNINGS": "ignore"}


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
