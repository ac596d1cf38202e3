"""What Linux, macOS and Windows do each in its own way: nothing else asks which of them it is."""

from __future__ import annotations

import ctypes
import errno
import math
import os
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

# Flags for `os.open`: 0 where there is no such thing.
NOFOLLOW: int = getattr(os, "O_NOFOLLOW", 0)
NONBLOCK: int = getattr(os, "O_NONBLOCK", 0)
CLOEXEC: int = getattr(os, "O_CLOEXEC", 0)
BINARY: int = getattr(os, "O_BINARY", 0)
"""Windows would change the ends of lines."""

_NAMES = ("SIGTERM", "SIGHUP", "SIGBREAK")
ENDINGS: tuple[signal.Signals, ...] = (
    signal.SIGINT,
    *(getattr(signal, name) for name in _NAMES if hasattr(signal, name)),
)
"""Signals that ask a command to end: Ctrl-C first. SIGHUP is of Unix, SIGBREAK of Windows."""

_UNSUPPORTED = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


def address_space() -> float:
    """Bytes of addresses that this process may take; inf for all."""
    if sys.platform == "win32":
        return math.inf
    import resource  # noqa: PLC0415 - not on Windows

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return math.inf if limit == resource.RLIM_INFINITY else limit


def peak_memory() -> int:
    """Bytes that this process has had at most."""
    if sys.platform == "win32":
        import psutil  # noqa: PLC0415 - most commands need none

        return int(psutil.Process().memory_info().peak_wset)
    import resource  # noqa: PLC0415 - not on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def require_handles(needed: int) -> None:
    """Raise this process's limit of open files, which Windows has not.

    Raises
    ------
    OSError
        If fewer than are `needed` may be had.
    """
    if sys.platform == "win32":
        return
    import resource  # noqa: PLC0415 - not on Windows

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise OSError(errno.EMFILE, f"{hard} file handles instead of {needed} (ulimit -n)")
    if soft != resource.RLIM_INFINITY and soft < needed:
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


def locked(descriptor: int, *, alone: bool) -> bool | None:
    """Take the lock of an open file, which goes with the process.

    Parameters
    ----------
    descriptor
        Of the file.
    alone
        Whether nobody else may have it, too.

    Returns
    -------
    taken
        Whether it was free; None where there are no locks, as on Windows, whose own cannot be
        shared.
    """
    if sys.platform == "win32":
        return None
    import fcntl  # noqa: PLC0415 - not on Windows

    try:
        fcntl.flock(descriptor, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise
        return None
    return True


@contextmanager
def in_memory(suffix: str = "") -> Iterator[tuple[BinaryIO, str]]:
    """A file that is on no disk, for libraries that take names of files only.

    Parameters
    ----------
    suffix
        What its name ends with.

    Yields
    ------
    file, name
        The open file, and the name by which this process can open it, too. Where the system has
        no such files it is a temporary one, which is removed.

    Raises
    ------
    OSError
        If there is no room for it.
    """
    with ExitStack() as stack:
        if sys.platform == "linux":
            file = stack.enter_context(os.fdopen(os.memfd_create("domesim"), "rb+"))
            name = f"/proc/self/fd/{file.fileno()}"
            if suffix:
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="domesim-"))
                link = Path(folder) / f"frame{suffix}"
                link.symlink_to(name)
                name = str(link)
        else:
            folder = stack.enter_context(
                # Windows removes no file that somebody still reads.
                tempfile.TemporaryDirectory(prefix="domesim-", ignore_cleanup_errors=True)
            )
            name = str(Path(folder) / f"frame{suffix}")
            file = stack.enter_context(Path(name).open("wb+"))
        yield file, name


def filled(source: int, view: memoryview) -> int:
    """Bytes that one read of a file descriptor put into a buffer; 0 at the end."""
    with open(source, "rb", buffering=0, closefd=False) as file:
        return file.readinto(view) or 0


def ready(source: int, sink: int | None, seconds: float) -> tuple[bool, bool]:
    """Wait for something to read.

    Parameters
    ----------
    source, sink
        File descriptors: what is read, and where results go.
    seconds
        How long.

    Returns
    -------
    ready, gone
        Whether there is something to read, or the end; and whether nobody reads the sink any
        more. Windows cannot wait for a pipe: there reading itself waits, and a sink that is gone is
        found by writing.
    """
    if sys.platform == "win32":
        return True, False
    import select  # noqa: PLC0415 - not of pipes on Windows

    poll = select.poll()
    poll.register(source, select.POLLIN)
    if sink is not None:
        poll.register(sink, 0)  # errors only
    found = dict(poll.poll(seconds * 1e3))
    gone = sink is not None and bool(found.get(sink, 0) & (select.POLLERR | select.POLLHUP))
    return source in found, gone


def widen(pipe: int, size: int) -> None:
    """Let a pipe hold more, on Linux."""
    if sys.platform == "linux":
        import fcntl  # noqa: PLC0415 - not on Windows

        with suppress(OSError):
            fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, size)


def set_allocator(settings: Mapping[int, int]) -> None:
    """Set what `mallopt` knows by number, with glibc."""
    with suppress(OSError, AttributeError, TypeError):  # TypeError: Windows has no library of all
        library = ctypes.CDLL(None)
        for number, value in settings.items():
            library.mallopt(number, value)
