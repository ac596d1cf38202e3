"""Which commands work in a job's folder: those of one kind of settings at a time.

All of them share a lock (``flock``) for as long as they work. Who changes the settings must have it
alone. The operating system keeps it and lets go of it when the process ends, however it ends. NFS
keeps it on its server, and lets go when a machine has been silent for a while (90 s by default).

Each leaves a small file that says who it is, for a person, and that beats while it works: its time
changes, for commands that wait for its frames (`claims`).
"""

from __future__ import annotations

import json
import os
import secrets
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any, final

import psutil

from domesim.errors import InputError
from domesim.host.system import locked
from domesim.host.writing import processes_seen, write_whole

_PATIENCE = 30.0  # s: another command looks at the settings and writes them in milliseconds
_GLANCE = 0.02  # s
BEAT = 15.0
"""Seconds from beat to beat."""
LEASE = 90.0
"""Seconds without a beat after which a command counts as gone."""


@final
class Clients:
    """The commands that work in a folder, and this one among them.

    Parameters
    ----------
    folder
        Folder of the files that tell who they are.
    lock
        Descriptor of the open lock file.
    """

    def __init__(self, folder: Path, lock: int) -> None:
        self._folder, self._lock = folder, lock
        self.name = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(8)}.json"
        self._own = folder / self.name
        self._left = threading.Event()
        self._heard: dict[str, tuple[int, float]] = {}

    def enter_alone(self) -> bool:
        """Takes the lock alone, if it is free."""
        if locked(self._lock, alone=True) is False:
            return False
        for left in self._folder.glob("*.json"):
            # Others may work there: some file systems keep locks for each machine alone
            with suppress(OSError, ValueError, LookupError, TypeError):
                if _is_gone(json.loads(left.read_bytes())):
                    left.unlink(missing_ok=True)
        return True

    def share(self) -> None:
        """Shares the lock with others, and leaves a note who has it.

        Raises
        ------
        InputError
            If another one has it alone for long.
        """
        sure = time.monotonic() + _PATIENCE
        while locked(self._lock, alone=False) is False:
            if time.monotonic() >= sure:
                raise InputError(
                    f"{self._folder}: wanted to look at the job's settings, got no answer from "
                    f"another command that has them locked for {_PATIENCE:.0f} s. End it"
                )
            time.sleep(_GLANCE)
        now = datetime.now().astimezone().isoformat(" ", "seconds")
        who = json.dumps({**_here(), "pid": os.getpid(), "since": now}).encode()
        write_whole(self._own, who)
        threading.Thread(target=self._beat, args=[who], name="domesim-beat", daemon=True).start()

    def _beat(self, who: bytes) -> None:
        while not self._left.wait(BEAT):
            with suppress(OSError, InputError):
                try:
                    os.utime(self._own)
                except FileNotFoundError:  # it was silent for long, and others took it for gone
                    write_whole(self._own, who)

    def works(self, name: str) -> bool:
        """Whether the command of that file is there, as far as can be known.

        One that is no process of this machine any more is not, nor one that has not beaten for as
        long as the lease; a command that is only just heard of is.
        """
        now = time.monotonic()
        try:
            with (self._folder / name).open("rb") as file:  # NFS looks anew when it opens
                beat = os.fstat(file.fileno()).st_mtime_ns
                who = json.load(file)
            if _is_gone(who):
                return False
        except FileNotFoundError:
            return False
        except (OSError, ValueError, LookupError, TypeError):  # half written: it is not heard of
            beat = 0
        before, since = self._heard.get(name, (None, now))
        if beat != before:
            since = now
        self._heard[name] = (beat, since)
        return now - since < LEASE

    def others(self) -> str:
        """Names the other commands in the folder, for a person; "" if they are unknown."""
        names = []
        for place in sorted(self._folder.glob("*.json")):
            with suppress(OSError, ValueError, LookupError, TypeError):
                who = json.loads(place.read_bytes())
                if place != self._own and not _is_gone(who):
                    names.append(f"{who['host']}, process {who['pid']}, since {who['since']}")
        return "; ".join(names)

    def leave(self) -> None:
        """Releases the lock."""
        self._left.set()
        with suppress(OSError):
            self._own.unlink(missing_ok=True)
        os.close(self._lock)


def _here() -> dict[str, str]:
    """Name of the machine, what tells when it was started, and which processes can be seen."""
    boot = Path("/proc/sys/kernel/random/boot_id")
    up = boot.read_text().strip() if boot.exists() else ""
    return {"host": socket.gethostname(), "up": up, "processes": processes_seen()}


def _is_gone(who: dict[str, Any]) -> bool:
    """Whether a command is known to have ended, by its file; of other machines none is."""
    here = _here()
    if who["host"] != here["host"]:
        return False
    again = who["up"] != here["up"]
    return again or (who["processes"] == here["processes"] and not psutil.pid_exists(who["pid"]))


@contextmanager
def clients_of(folder: Path) -> Iterator[Clients]:
    """Clients of a job's `folder`, which exists; the lock is let go of in the end.

    Raises
    ------
    OSError
        If there can be no lock.
    """
    place = folder / "clients"
    place.mkdir(exist_ok=True)
    clients = Clients(place, os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o666))
    try:
        yield clients
    finally:
        clients.leave()
