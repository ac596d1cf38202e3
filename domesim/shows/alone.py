"""Frames in this process: while one is solved, the next is read and the last is written."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from domesim.shows.work import Failed, Finished, Order, Steps, Work


def alone(
    orders: Iterable[Order],
    work: Work[Any, Any],
    begin: Callable[[Order], None],
    end: Callable[[Order, Finished | Failed], None],
) -> None:
    """Do each frame, in order, up to one that is hopeless; never more than three are in memory.

    Parameters
    ----------
    orders
        The frames; each is asked for when there is room for it.
    work
        What their recipe asks for.
    begin, end
        Called as each is solved, and as each is done; `end` from another thread, one by one.
    """
    steps = Steps(work)
    reader, writer = (ThreadPoolExecutor(1, f"domesim-{name}") for name in ("read", "write"))

    def finish(order: Order, solved: Any) -> bool:
        outcome = steps.finish(order, solved)
        end(order, outcome)
        return isinstance(outcome, Failed) and outcome.hopeless

    try:
        behind: Future[bool] | None = None
        waiting = iter(orders)
        order = next(waiting, None)
        ahead = None if order is None else reader.submit(steps.read, order)
        while order is not None and ahead is not None:
            begin(order)
            read = ahead.result()
            following = next(waiting, None)
            ahead = None if following is None else reader.submit(steps.read, following)
            solved = steps.solve(order, read)
            hopeless = behind is not None and behind.result()
            behind = writer.submit(finish, order, solved)
            del read, solved
            if hopeless:
                break
            order = following
        if behind is not None:
            behind.result()
    finally:
        # What is being written gets its name; nothing else is begun.
        reader.shutdown(cancel_futures=True)
        writer.shutdown()
