"""What each local worker does first; Dask imports it in the worker's main thread."""

import signal

from domesim.batch.crew import be_quiet
from domesim.strips import keep_freed_memory


def dask_setup(worker: object) -> None:
    """Ctrl-C is for the command, which tells its workers; what goes wrong, the command tells.

    Freed memory is kept for the next frame.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    be_quiet()
    keep_freed_memory()
