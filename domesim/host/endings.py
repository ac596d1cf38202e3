"""Ctrl-C, SIGTERM (SLURM, systemd) and SIGHUP (a lost terminal) end a command alike.

Each is a `KeyboardInterrupt`; only the exit code tells them apart. A second Ctrl-C is one more. A
second SIGTERM or SIGHUP is none: whoever sends them sends several, and means one.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from domesim.host.system import ENDINGS

_last: int = signal.SIGINT


def exit_code() -> int:
    """Exit code of a command that a signal ended, as shells have it."""
    return 128 + _last


def name() -> str:
    """Name of the signal that ended the command."""
    return "interrupted" if _last == signal.SIGINT else f"stopped by {signal.Signals(_last).name}"


def interrupt(number: int, frame: Any) -> None:
    """Treats a signal as Ctrl-C."""
    noted(number)
    raise KeyboardInterrupt


def noted(number: int) -> None:
    """Remembers the signal, and ignores others like it."""
    global _last  # noqa: PLW0603
    _last = number
    if number != signal.SIGINT:
        for each in ENDINGS[1:]:
            signal.signal(each, signal.SIG_IGN)


@contextmanager
def alike() -> Iterator[None]:
    """Treats SIGTERM and SIGHUP as Ctrl-C, unless the parent process has them ignored."""
    with _instead(interrupt, signal.SIG_DFL, signal.default_int_handler):
        yield


@contextmanager
def heard_by(note: Callable[[], None]) -> Iterator[None]:
    """Calls `note` instead of raising `KeyboardInterrupt`; a second Ctrl-C raises it."""

    def hear(number: int, frame: Any) -> None:
        noted(number)
        if number == signal.SIGINT:
            signal.signal(number, signal.default_int_handler)
        note()

    with _instead(hear, interrupt, signal.default_int_handler):
        yield


@contextmanager
def ignored() -> Iterator[None]:
    """Starts processes that ignore these signals, unless they handle them."""
    with _instead(signal.SIG_IGN, interrupt, signal.SIG_DFL, signal.default_int_handler):
        yield


@contextmanager
def _instead(handler: Any, *usual: Any) -> Iterator[None]:
    """Replaces the handlers of those signals that have a usual one."""
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        before = {each: former for each in ENDINGS if (former := signal.getsignal(each)) in usual}
    for each in before:
        signal.signal(each, handler)
    try:
        yield
    finally:
        for each, former in before.items():
            if signal.getsignal(each) in (handler, signal.default_int_handler):
                signal.signal(each, former)
