"""What each local worker does first; Dask imports it in the worker's main thread."""

import signal

from domesim.host.endings import ENDINGS
from domesim.shows.crew import be_quiet


def dask_setup(worker: object) -> None:
    """Ctrl-C and the like are for the command, which tells its workers, also what goes wrong."""
    for each in ENDINGS:  # a terminal, SLURM and systemd send them to all processes
        signal.signal(each, signal.SIG_IGN)
    be_quiet()
