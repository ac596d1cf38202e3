"""What a process of Windows or macOS would find, as far as a test on Linux can pretend it.

A folder with this as ``sitecustomize`` is put on the path of commands and of their workers. The
standard library and what rests on it are loaded first: they ask which system they are on while
they load.
"""

from __future__ import annotations

import asyncio  # noqa: F401
import builtins
import concurrent.futures.process  # noqa: F401
import ctypes
import multiprocessing.popen_spawn_posix
import multiprocessing.resource_tracker
import multiprocessing.synchronize  # noqa: F401
import os
import select
import shutil
import signal
import subprocess  # noqa: F401
import tempfile  # noqa: F401
from functools import wraps
from types import SimpleNamespace
from typing import Any

import psutil

OURS = ("domesim", "compensate", "validation", "scenes", "testing")
MISSING = {
    "win32": ("fcntl", "resource", "pwd", "grp", "termios", "pty", "select"),
    "darwin": (),
}
_WITHOUT = {
    "win32": {
        os: (
            "O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "readv", "killpg", "getloadavg",
            "sched_getaffinity", "memfd_create",
        ),
        signal: ("SIGHUP",),
        select: ("poll",),
    },
    "darwin": {os: ("sched_getaffinity", "memfd_create")},
}  # fmt: skip


def become(platform: str) -> None:
    """Pretend, in this process, for the project's own modules."""
    taken = builtins.__import__

    def imported(name: str, *rest: Any, **named: Any) -> Any:
        where = named.get("globals", rest[0] if rest else None) or {}
        if where.get("__name__", "").split(".")[0] in OURS and name in MISSING[platform]:
            raise ModuleNotFoundError(f"No module named {name!r}, as on {platform}", name=name)
        return taken(name, *rest, **named)

    builtins.__import__ = imported
    for module, names in _WITHOUT[platform].items():
        for name in names:
            if hasattr(module, name):
                delattr(module, name)
    if platform == "win32":
        setattr(shutil, "_use_fd_functions", False)  # noqa: B010 - 3.13 asks for O_NONBLOCK
        find = ctypes.CDLL

        def library(name: Any, *rest: Any, **settings: Any) -> Any:
            if name is None:
                raise TypeError("no library of all, as on Windows")
            return find(name, *rest, **settings)

        ctypes.CDLL = library  # type: ignore[assignment, misc]
        peak = psutil.Process.memory_info

        @wraps(peak)
        def memory_info(self: psutil.Process) -> Any:
            seen = peak(self)
            return type("Seen", (), {**seen._asdict(), "peak_wset": seen.rss})()

        psutil.Process.memory_info = memory_info  # type: ignore[method-assign]
    from domesim.host import system  # noqa: PLC0415 - after the rest is gone

    # Whole libraries ask it, too, and would look for files of Windows.
    system.sys = SimpleNamespace(platform=platform)  # type: ignore[attr-defined]


if pretended := os.environ.get("DOMESIM_TEST_SYSTEM"):
    import distributed  # noqa: F401 - asks while it loads

    become(pretended)
