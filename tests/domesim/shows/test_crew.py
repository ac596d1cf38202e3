"""Workers that cannot start, and schedulers that are none, are one line with the way out."""

from __future__ import annotations

import asyncio
import os
import resource
import socket
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
from batches import copied, harmful_in, make_show
from command_line import Outcome, outcome

from domesim.errors import InputError
from domesim.shows import crew
from domesim.shows.crew import require_dask
from testing.schedulers import DASK

TESTS = Path(__file__).parents[2]
PROGRAM = [sys.executable, str(TESTS / "batches.py")]


def refused(folder: Path, before: str, *command: str) -> Outcome:
    """A show by two workers in a shell that has done something before."""
    make_show(folder / "in", 2)
    (folder / "log").mkdir()
    words = " ".join([*PROGRAM, str(folder), "2", "0"])
    done = subprocess.run(
        [*command, "bash", "-c", f"{before} && exec {words}"],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    return outcome(done.returncode, done.stdout, done.stderr)


@pytest.mark.parametrize("handles", [20, 100])
def test_too_few_file_handles_are_told(tmp_path: Path, handles: int) -> None:
    found = refused(tmp_path, f"ulimit -n {handles}")
    found.is_refused("2 workers", f"{handles} file handles instead of 120", "--workers 0")


def test_a_soft_limit_of_file_handles_is_raised(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    found = refused(tmp_path, "ulimit -Sn 64")
    assert (found.code, found.err) == (0, "")
    assert resource.getrlimit(resource.RLIMIT_NOFILE) == before


def test_shared_memory_that_cannot_be_written_to_is_told(tmp_path: Path) -> None:
    if subprocess.run(["unshare", "-m", "true"], check=False, capture_output=True).returncode:
        pytest.skip("a file system of one process needs the right to mount one")
    found = refused(tmp_path, "mount -t tmpfs -o ro none /dev/shm", "unshare", "-m")
    found.is_refused("2 workers", "read-only file system at /dev/shm", "--workers 0")


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("tls://127.0.0.1:9", "expects a `ssl_context`"),
        ("nonsense", "Must include protocol"),
        ("nothing://127.0.0.1:8786", "unknown address scheme"),
        ("tcp://127.0.0.1", "missing port number"),
        ("tcp://no.such.host.invalid:8786", "wanted a Dask scheduler"),
    ],
)
def test_a_wrong_address_is_told_at_once(tmp_path: Path, address: str, words: str) -> None:
    """By its cause, and not because no answer came for a while."""
    make_show(tmp_path / "in", 2)
    with pytest.raises(InputError) as told:
        copied(tmp_path, harmful_in(tmp_path), 0, scheduler=address)
    assert words in str(told.value)
    assert ("For tls:// name the certificates" in str(told.value)) == address.startswith("tls")
    assert "\n" not in str(told.value)


def test_the_caller_may_be_in_an_event_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a notebook."""
    monkeypatch.setattr(crew, "_ANSWER", 1.0)

    async def call() -> None:
        require_dask("tcp://127.0.0.1:9")

    # In a thread of its own: a browser's test may have left a loop in this one
    with ThreadPoolExecutor(1) as thread, pytest.raises(InputError) as told:
        thread.submit(lambda: asyncio.run(call())).result()
    assert "event loop" not in str(told.value)


def test_something_else_than_a_scheduler_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crew, "_ANSWER", 1.0)
    with (
        socket.create_server(("127.0.0.1", 0)) as other,
        pytest.raises(InputError, match="wanted a Dask scheduler"),
    ):
        require_dask(f"tcp://127.0.0.1:{other.getsockname()[1]}")


def test_a_scheduler_without_tls_in_a_network_is_warned_of(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def connect(*arguments: object, **options: object) -> Connected:
        return Connected()

    monkeypatch.setattr("distributed.comm.connect", connect)
    for address in ("tcp://127.0.0.1:8786", "tcp://[::1]:8786", "tcp://192.0.2.1:8786"):
        require_dask(address)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("domesim: --scheduler tcp://192.0.2.1:8786: it has no TLS")


class Connected:
    async def close(self) -> None: ...


@contextmanager
def encrypted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A scheduler and a worker as docs/shows.md says; what it says to others is in this process."""
    page = (Path(__file__).parents[3] / "docs/shows.md").read_text()
    certificate = next(line for line in page.splitlines() if line.startswith("openssl req"))
    subprocess.run(certificate, shell=True, check=True, capture_output=True, cwd=folder)
    for line in page.splitlines():
        if line.startswith("export DASK_DISTRIBUTED__COMM__"):
            name, value = line.removeprefix("export ").split("#")[0].strip().split("=")
            monkeypatch.setenv(name, value.replace("$PWD", str(folder)))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tls://127.0.0.1:{free.getsockname()[1]}"
    told = {"env": os.environ, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    python = [sys.executable, "-c", DASK]
    with (
        subprocess.Popen(
            [*python, "dask_scheduler", "--host", address, "--no-dashboard"], **told
        ) as head,
        subprocess.Popen([*python, "dask_worker", address, "--no-dashboard"], **told) as worker,
    ):
        try:
            yield address
        finally:
            head.terminate()
            worker.terminate()


@pytest.mark.long
def test_the_farm_of_the_docs_is_encrypted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_show(tmp_path / "in", 2)
    (tmp_path / "log").mkdir()
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(TESTS), str(TESTS.parent)]))
    with encrypted(tmp_path, monkeypatch) as address:
        plain = run_program(tmp_path, 0, 0, address.replace("tls", "tcp"))
        plain.is_refused("wanted a Dask scheduler")
        done = run_program(tmp_path, 0, 0, address)
        assert (done.code, done.err) == (0, "")


def run_program(*arguments: object) -> Outcome:
    command = [*PROGRAM, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    return outcome(done.returncode, done.stdout, done.stderr)
