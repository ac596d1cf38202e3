"""What each local worker does first; Dask imports it in the worker's main thread."""

import signal

from domesim.host.system import ENDINGS
from domesim.shows.crew import be_quiet


def dask_setup(worker: object) -> None:
    """Leaves Ctrl-C and errors to the command, which tells its workers."""
    for each in ENDINGS:  # a terminal, SLURM and systemd send them to all processes
        signal.signal(each, signal.SIG_IGN)
    be_quiet()
